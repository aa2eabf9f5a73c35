//! Recorded check-mode tables: every line of a program, and the state of the parser after it.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use leadscrew::sim::Simulator;

use super::{
    compare::{Difference, code, follows_from_answers},
    deviation::{Deviation, has_long_number, of_answers},
    golden::sorted,
};
use simulation::{
    program::Program,
    sender::{self, Response},
    session::{
        player::{Patience, Player},
        state::End,
    },
    settings,
};

/// One table and the program it belongs to.
#[derive(Debug, Clone)]
pub(super) struct Table {
    /// `CATEGORY/NAME`.
    pub(super) name: String,
    program: PathBuf,
    table: PathBuf,
    is_laser: bool,
}

/// One line of a table.
#[derive(Debug, Clone, PartialEq)]
struct Row {
    response: String,
    position: [f64; 3],
    feed: f64,
    speed: f64,
    tool: u8,
    modal: String,
    messages: String,
}

/// Names of the column by which a row is compared.
const COLUMNS: &str = "line,response,x,y,z,f,s,t,modal,messages";

/// Finds every table.
pub(super) fn load(dir: &Path) -> Result<Vec<Table>> {
    let mut tables = Vec::new();
    for folder in sorted(&dir.join("golden"))? {
        let category = folder
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if !folder.is_dir() {
            continue;
        }
        for table in sorted(&folder)? {
            let file = table
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            let Some(name) = file.strip_suffix(".check.csv") else {
                continue;
            };
            let programs = sorted(&dir.join("programs").join(&category))?;
            let program = programs
                .into_iter()
                .find(|path| path.file_stem().is_some_and(|stem| stem == name))
                .with_context(|| format!("there is no program {category}/{name}"))?;
            tables.push(Table {
                name: format!("{category}/{name}"),
                program,
                is_laser: category == "laser",
                table,
            });
        }
    }
    Ok(tables)
}

impl Row {
    fn read(text: &str) -> Option<Self> {
        let fields: Vec<&str> = text.splitn(10, ',').collect();
        let number = |index: usize| fields.get(index)?.parse::<f64>().ok();
        Some(Self {
            response: (*fields.get(1)?).to_owned(),
            position: [number(2)?, number(3)?, number(4)?],
            feed: number(5)?,
            speed: number(6)?,
            tool: number(7)? as u8,
            modal: (*fields.get(8)?).to_owned(),
            messages: (*fields.get(9)?).trim_matches('"').to_owned(),
        })
    }

    /// What our machine shows after a line.
    fn of(end: &End, received: Vec<String>) -> Self {
        let is_answer = |text: &String| Response::parse(text).is_some();
        let (answers, messages): (Vec<_>, Vec<_>) = received.into_iter().partition(is_answer);
        let mut position = [0.0; 3];
        for (at, mm) in position.iter_mut().zip(&end.parser_pos_mm) {
            *at = *mm;
        }
        let modal: Vec<_> = end.modal.iter().map(u8::to_string).collect();
        Self {
            response: if answers.is_empty() {
                "no answer".into()
            } else {
                answers.join(" ")
            },
            position,
            feed: end.feed,
            speed: end.speed,
            tool: end.tool.unwrap_or_default(),
            modal: modal.join("/"),
            messages: messages.join("|"),
        }
    }

    /// What differs, by column; and why it may.
    fn differences(&self, theirs: &Self, line: &str) -> Vec<(String, Option<Deviation>)> {
        let mut found = Vec::new();
        let mut push = |column: &str, ours: &str, theirs: &str, by_design| {
            if ours != theirs {
                found.push((format!("{column} {ours}, Grbl {theirs}"), by_design));
            }
        };
        let reason = of_answers(&code(line), &self.response, &theirs.response);
        push("answer", &self.response, &theirs.response, reason);
        push("modes", &self.modal, &theirs.modal, None);
        let has_tool_word = sender::code(line.as_bytes()).contains(&b'T');
        // A refused line leaves another tool than the line before it in Grbl only.
        let is_refused = theirs.response != "ok";
        let is_kept = theirs.tool == 0 && (is_refused || !has_tool_word);
        push(
            "T",
            &self.tool.to_string(),
            &theirs.tool.to_string(),
            is_kept.then_some(Deviation::ToolIsModal),
        );
        let (our_status, their_status) =
            (without_tool(&self.messages), without_tool(&theirs.messages));
        let is_tool = our_status == their_status && theirs.messages.contains(" T0 ");
        push(
            "message",
            &self.messages,
            &theirs.messages,
            is_tool.then_some(Deviation::ToolIsModal),
        );
        let numbers = [
            ("X", self.position[0], theirs.position[0]),
            ("Y", self.position[1], theirs.position[1]),
            ("Z", self.position[2], theirs.position[2]),
            ("F", self.feed, theirs.feed),
            ("S", self.speed, theirs.speed),
        ];
        for (column, ours, theirs) in numbers {
            if (ours - theirs).abs() > 0.002_f64.max(theirs.abs() * 1e-6) {
                let is_by_inches = column == "F" && (ours - theirs * 25.4).abs() <= ours * 1e-6;
                let is_long = has_long_number(&code(line));
                let reason = is_by_inches
                    .then_some(Deviation::FeedUnits)
                    .or(is_long.then_some(Deviation::Digits));
                push(column, &ours.to_string(), &theirs.to_string(), reason);
            }
        }
        found
    }
}

/// A `$G` without its tool.
fn without_tool(text: &str) -> String {
    let words = text.split(' ').filter(|word| !word.starts_with('T'));
    words.collect::<Vec<_>>().join(" ")
}

/// Sends a program line by line in check mode. Also says how many lines were compared.
///
/// # Errors
/// A file cannot be read, or the table does not belong to the program.
pub(super) fn replay(table: &Table) -> Result<(usize, Vec<Difference>)> {
    let mut program = Program::recorded(&table.program)?;
    let mut lines = Vec::new();
    while let Some(line) = program.next_line()? {
        lines.push(line);
    }
    let text = fs::read_to_string(&table.table)
        .with_context(|| format!("cannot read {}", table.table.display()))?;
    let mut rows = text.lines();
    ensure!(
        rows.next() == Some(COLUMNS),
        "{} does not have the columns {COLUMNS}",
        table.table.display()
    );
    let rows: Vec<&str> = rows.collect();
    ensure!(
        rows.len() == lines.len(),
        "{} has {} rows for {} lines",
        table.table.display(),
        rows.len(),
        lines.len()
    );
    let mut values = settings::named_set("grbl_default")?;
    if table.is_laser {
        settings::apply(&mut values, "$32=1")?;
    }
    let mut player = Player::with(Simulator::new(&values), Vec::new());
    send(&mut player, b"$C");
    let mut found = Vec::new();
    for (number, (line, row)) in (1..).zip(lines.iter().zip(rows)) {
        let theirs = Row::read(row)
            .with_context(|| format!("row {number} of {} cannot be read", table.table.display()))?;
        let received = send(&mut player, line);
        let ours = Row::of(&End::of(&player.machine), received);
        let line = String::from_utf8_lossy(line);
        let differences = ours.differences(&theirs, &line).into_iter();
        let before = found.len();
        found.extend(differences.map(|(text, by_design)| Difference {
            what: "row",
            text: format!("line {number} `{line}`: {text}"),
            by_design,
        }));
        let follows = follows_from_answers(&found);
        for difference in &mut found[before..] {
            difference.by_design = difference.by_design.or(follows);
        }
    }
    Ok((lines.len(), found))
}

/// Sends a line and returns what comes back.
fn send(player: &mut Player, line: &[u8]) -> Vec<String> {
    const TIMEOUT: Patience = Patience::of(1.0);
    player.machine.send(line);
    player.machine.send(b"\n");
    player.wait_for_answer(TIMEOUT);
    player
        .take_lines()
        .into_iter()
        .map(|(_, text)| text)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROW: &str = "3,ok,1,2,-3.5,100,50,0,1/0/0/0/0/0/0/0/0/16,[MSG:Pgm End]";

    #[test]
    fn a_row_is_read() {
        let row = Row::read(ROW).unwrap();
        assert_eq!(row.position, [1.0, 2.0, -3.5]);
        assert_eq!((row.feed, row.speed, row.tool), (100.0, 50.0, 0));
        assert_eq!(row.messages, "[MSG:Pgm End]");
        assert_eq!(Row::read("3,ok,1"), None);
    }

    #[test]
    fn every_column_is_compared() {
        let theirs = Row::read(ROW).unwrap();
        assert_eq!(theirs.differences(&theirs, "G1 X1"), []);
        for other in [
            "3,error:2,1,2,-3.5,100,50,0,1/0/0/0/0/0/0/0/0/16,[MSG:Pgm End]",
            "3,ok,1.01,2,-3.5,100,50,0,1/0/0/0/0/0/0/0/0/16,[MSG:Pgm End]",
            "3,ok,1,2,-3.5,101,50,0,1/0/0/0/0/0/0/0/0/16,[MSG:Pgm End]",
            "3,ok,1,2,-3.5,100,51,0,1/0/0/0/0/0/0/0/0/16,[MSG:Pgm End]",
            "3,ok,1,2,-3.5,100,50,0,0/0/0/0/0/0/0/0/0/16,[MSG:Pgm End]",
            "3,ok,1,2,-3.5,100,50,0,1/0/0/0/0/0/0/0/0/16,",
        ] {
            let ours = Row::read(other).unwrap();
            let found = ours.differences(&theirs, "G1 X1");
            assert_eq!(found.len(), 1, "{other}");
            assert_eq!(found[0].1, None, "{other}");
        }
        let mut ours = theirs.clone();
        ours.tool = 3;
        let found = ours.differences(&theirs, "G1 X1");
        assert_eq!(found[0].1, Some(Deviation::ToolIsModal));
        let found = ours.differences(&theirs, "T0");
        assert_eq!(found[0].1, None);
        let refused = Row::read(&ROW.replace("ok", "error:20")).unwrap();
        ours.response = "error:20".into();
        let found = ours.differences(&refused, "T5G33");
        assert_eq!(found[0].1, Some(Deviation::ToolIsModal));
        let mut ours = theirs.clone();
        ours.feed = 2540.0;
        let found = ours.differences(&theirs, "G94F100");
        assert_eq!(found[0].1, Some(Deviation::FeedUnits));
        let mut ours = theirs.clone();
        ours.position[0] = 1.5;
        let found = ours.differences(&theirs, "G0X00000001.5");
        assert_eq!(found[0].1, Some(Deviation::Digits));
    }
}
