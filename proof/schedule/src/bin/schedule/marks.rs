//! Marks for the optimiser, and what each is for.
//!
//! Marks are taken out of a copy of the firmware, many at a time and in halves where that changes something, and the
//! copy is built and proven. What is left are those without which a proven rate falls, the image grows, or the proof
//! does not find what `schedule.toml` names. With `--write` the others are taken out of the sources.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use anstream::println;
use anyhow::{Context, Result};
use common::{cargo, document, text::separated, ui};
use firmware::boards::Board;
use schedule::{Report, SourceFile};

use crate::project_copy::ProjectCopy;

/// Where the documents show what was found.
const TEXT: &str = "docs/marks.md";
const BEGIN: &str = "<!-- begin: cargo xtask schedule --marks --write -->\n";
const END: &str = "<!-- end of marks -->\n";
/// Part of a proven rate that all that is taken out together may cost.
const LEAST_RATE: f64 = 0.99;
/// Bytes by which the image may grow where marks are taken out.
const MOST_GROWTH: usize = 512;
/// What counts as a mark, alone in its line.
const MARKS: [&str; 4] = [
    "#[inline]",
    "#[inline(always)]",
    "#[inline(never)]",
    "#[cold]",
];

/// What excuses a mark without which code in RAM may call a function in flash. Images of tests are not analysed.
const IN_RAM: &str = "nothing in flash may be called";

/// Code that is in no image for a chip: no trial would miss its marks.
const EMULATOR: &str = "src/board/qemu/";

/// A mark: its file from the root of the project, its line from 0, and its text.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct OptimiserMark {
    file: String,
    line: usize,
    text: &'static str,
}

/// Takes marks out of a copy.
struct Trial<'a> {
    copy: ProjectCopy<'a>,
    /// What is proven with all marks.
    base: BTreeMap<String, u32>,
    /// The code of the copy as it is now.
    code: Vec<u8>,
    sources: BTreeMap<String, String>,
    removed: BTreeSet<OptimiserMark>,
    /// Those that stay, and why.
    kept: BTreeMap<OptimiserMark, String>,
}

/// Finds out what each mark in files whose names begin so is for.
pub(super) fn run(board: &Board, prefix: &str, write: bool) -> Result<()> {
    let copy = ProjectCopy::new(board, &cargo::target_dir().join("marks"))?;
    let files = SourceFile::all(&copy.folder).map_err(anyhow::Error::msg)?;
    let files = files
        .into_iter()
        .filter(|file| file.name.starts_with(prefix) && !file.name.starts_with(EMULATOR));
    let sources: BTreeMap<_, _> = files.map(|file| (file.name, file.text)).collect();
    let marks: Vec<OptimiserMark> = sources
        .iter()
        .flat_map(|(file, text)| marks(file, text))
        .collect();
    ui::status("Found", &format!("{} marks", separated(marks.len() as u64)));
    let mut trial = Trial {
        base: copy.analyse()?.proven_step_rate_hz,
        code: copy.code()?,
        copy,
        sources,
        removed: BTreeSet::new(),
        kept: BTreeMap::new(),
    };
    // Those of one kind in one folder mostly have one reason.
    let folder = |mark: &OptimiserMark| {
        let name = Path::new(&mark.file).iter().nth(1);
        name.map(|it| it.to_string_lossy().into_owned())
    };
    let mut groups: BTreeMap<_, Vec<OptimiserMark>> = BTreeMap::new();
    for mark in marks {
        groups
            .entry((mark.text, folder(&mark)))
            .or_default()
            .push(mark);
    }
    let named = fs::read_to_string(cargo::root().join("schedule.toml"))?;
    for group in groups.values() {
        let mut tried = group.clone();
        tried.retain(|mark| match trial.known_reason(mark, &named) {
            Some(reason) => trial.kept.insert(mark.clone(), reason.into()).is_some(),
            None => true,
        });
        if !tried.is_empty() {
            trial.reduce(&tried)?;
        }
    }
    let shown = fs::read_to_string(cargo::root().join(TEXT))?;
    let table = trial.table(others(&shown, prefix));
    println!("\n{table}");
    if write {
        let root = cargo::root();
        for (file, text) in &trial.sources {
            let text = without(
                text,
                trial.removed.iter().filter(|mark| mark.file == *file),
                "",
            );
            fs::write(root.join(file), text).with_context(|| format!("cannot write {file}"))?;
        }
        document::write_part(TEXT, BEGIN, END, &table)?;
    }
    Ok(())
}

/// The marks of a source.
fn marks(file: &str, text: &str) -> Vec<OptimiserMark> {
    let lines = text.lines().enumerate();
    let found = lines.filter_map(|(line, text)| {
        let text = MARKS.into_iter().find(|mark| *mark == text.trim())?;
        let file = file.to_owned();
        Some(OptimiserMark { file, line, text })
    });
    found.collect()
}

/// A source without some marks, and without the words that excuse them; `instead` stands in each line.
fn without<'a>(
    text: &str,
    marks: impl Iterator<Item = &'a OptimiserMark>,
    instead: &str,
) -> String {
    let removed: BTreeSet<usize> = marks.map(|mark| mark.line).collect();
    let mut kept = String::new();
    let mut is_excuse = false;
    for (number, line) in text.lines().enumerate() {
        let begins_excuse = removed.contains(&number.wrapping_sub(1))
            && text
                .lines()
                .nth(number)
                .is_some_and(|it| it.trim_start().starts_with("#[expect("))
            && text
                .lines()
                .skip(number)
                .take(3)
                .any(|it| it.contains("clippy::inline_always"));
        is_excuse |= begins_excuse;
        if is_excuse || removed.contains(&number) {
            is_excuse &= !line.trim_end().ends_with(")]");
            kept.push_str(instead);
        } else {
            kept.push_str(line);
            kept.push('\n');
        }
    }
    kept
}

impl Trial<'_> {
    /// Why a mark stays without a trial, if it does; `named` is `schedule.toml`.
    fn known_reason(&self, mark: &OptimiserMark, named: &str) -> Option<&'static str> {
        let text = self.sources.get(&mark.file).map_or("", String::as_str);
        if mark.text == "#[inline(never)]" && names(named, &self.item(mark)) {
            Some("named in `schedule.toml`")
        } else if { text.lines().skip(mark.line + 1).take(3) }.any(|line| line.contains(IN_RAM)) {
            Some("code in RAM, that of the tests on a board too, would call it in flash")
        } else {
            None
        }
    }

    /// Takes out all of some marks, or each half of them by itself.
    fn reduce(&mut self, marks: &[OptimiserMark]) -> Result<()> {
        let Some(reason) = self.try_without(marks)? else {
            let what = format!("{} of {}", marks.len(), marks[0].file);
            ui::status("Removed", &format!("{} {what}", marks[0].text));
            return Ok(());
        };
        if let [mark] = marks {
            ui::status(
                "Kept",
                &format!("{} {}:{}: {reason}", mark.text, mark.file, mark.line + 1),
            );
            self.kept.insert(mark.clone(), reason);
            return Ok(());
        }
        let (first, second) = marks.split_at(marks.len() / 2);
        self.reduce(first)?;
        self.reduce(second)
    }

    /// Takes out marks besides those that are out; why they have to stay, if they have.
    fn try_without(&mut self, marks: &[OptimiserMark]) -> Result<Option<String>> {
        let mut removed = self.removed.clone();
        removed.extend(marks.iter().cloned());
        self.write(&removed)?;
        if !self.copy.build()? {
            return Ok(Some("does not compile".into()));
        }
        let code = self.copy.code()?;
        let reason = if code == self.code {
            None
        } else {
            match self.copy.analyse() {
                Ok(report) => self.reason(&report, code.len()),
                Err(error) => Some(first_line(&error.to_string())),
            }
        };
        if reason.is_none() {
            self.removed = removed;
            self.code = code;
        }
        Ok(reason)
    }

    /// Why a firmware is worse than with all marks.
    fn reason(&self, report: &Report, bytes: usize) -> Option<String> {
        if let Some(flaw) = report.flaws.first() {
            return Some(format!("the proof: {}", first_line(&flaw.what)));
        }
        for (baud, rate) in &report.proven_step_rate_hz {
            let before = self.base.get(baud).copied().unwrap_or_default();
            if f64::from(*rate) < LEAST_RATE * f64::from(before) {
                return Some(format!(
                    "{} steps/s in place of {} at {baud} baud",
                    separated((*rate).into()),
                    separated(before.into())
                ));
            }
        }
        let growth = bytes.saturating_sub(self.code.len());
        (growth > MOST_GROWTH).then(|| format!("{} bytes more", separated(growth as u64)))
    }

    /// Writes the sources of the copy without some marks. Lines keep their numbers.
    fn write(&self, removed: &BTreeSet<OptimiserMark>) -> Result<()> {
        for (file, text) in &self.sources {
            let marks = removed.iter().filter(|mark| mark.file == *file);
            let path = self.copy.folder.join(file);
            let text = without(text, marks, "\n");
            // Cargo looks at the time of a file.
            if fs::read_to_string(&path)? != text {
                fs::write(&path, text)?;
            }
        }
        Ok(())
    }

    /// What stays, with the rows of other files.
    fn table<'t>(&self, others: impl Iterator<Item = &'t str>) -> String {
        let mut rows: BTreeSet<String> = others.map(str::to_owned).collect();
        rows.extend(self.kept.iter().map(|(mark, reason)| {
            let OptimiserMark { file, text, .. } = mark;
            format!(
                "| `{file}`, before `{}` | `{text}` | {reason} |",
                self.item(mark)
            )
        }));
        let mut text = format!(
            "{} marks stay:\n\n| where | mark | without it |\n|---|---|---|\n",
            rows.len()
        );
        text.extend(rows.iter().flat_map(|row| [row, "\n"]));
        text
    }

    /// The beginning of what a mark stands before.
    fn item(&self, mark: &OptimiserMark) -> String {
        let text = self.sources.get(&mark.file).map_or("", String::as_str);
        let mut lines = text.lines().skip(mark.line + 1).map(str::trim);
        let item = lines.find(|line| line.contains("fn "));
        let item = item
            .and_then(|line| line.split_once("fn "))
            .map_or("", |(_, name)| name);
        item.split(['(', '<']).next().unwrap_or_default().to_owned()
    }
}

/// The rows of a shown table about files whose names begin otherwise.
fn others<'t>(shown: &'t str, prefix: &str) -> impl Iterator<Item = &'t str> {
    let rows = shown.lines().filter(|line| line.starts_with("| `src/"));
    rows.filter(move |row| !row["| `".len()..].starts_with(prefix))
}

/// Whether the file of the proof names a function.
fn names(toml: &str, function: &str) -> bool {
    let words = toml.split(|it: char| !it.is_alphanumeric() && it != '_');
    words.into_iter().any(|word| word == function)
}

/// The first line of a text.
fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "/// A.\n#[inline(always)]\n#[expect(clippy::inline_always, reason = \"hot\")]\nfn a() {}\n\
                          \n#[inline]\nfn b() {}\n#[inline(always)]\n#[expect(\n    clippy::inline_always,\n    \
                          reason = \"hot\"\n)]\nfn c() {}\n";

    #[test]
    fn marks_are_taken_out_with_what_excuses_them() {
        let found = marks("a.rs", SOURCE);
        let lines: Vec<_> = found.iter().map(|mark| (mark.line, mark.text)).collect();
        let always = "#[inline(always)]";
        assert_eq!(lines, [(1, always), (5, "#[inline]"), (7, always)]);
        assert_eq!(
            without(SOURCE, found.iter(), ""),
            "/// A.\nfn a() {}\n\nfn b() {}\nfn c() {}\n"
        );
        assert_eq!(without(SOURCE, found[..0].iter(), ""), SOURCE);
        let shown = "| `src/a.rs`, before `a` | `#[cold]` | x |\n| `src/b/c.rs`, before `b` | `#[cold]` | x |\nEnd\n";
        assert_eq!(others(shown, "src/a").count(), 1);
        assert!(names("function = \"a::b_c\"", "b_c") && !names("function = \"a::b_c\"", "b"));
        let blank = without(SOURCE, found[1..].iter(), "\n");
        assert_eq!(blank.lines().count(), SOURCE.lines().count());
        assert!(blank.contains("#[inline(always)]\n#[expect"));
    }
}
