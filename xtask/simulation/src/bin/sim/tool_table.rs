//! Tool tables as LinuxCNC keeps them in files: a line for each tool, `T1 P1 X0 Y0 Z10.16 D3.048 ;drill`.

use std::{collections::BTreeSet, fs, path::Path};

use anyhow::{Context, Result, anyhow, ensure};
use common::ui;

/// The words that the machine has a use for, or reads and forgets.
const WORDS: &str = "TPXYZD";

/// A tool of a file.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Tool {
    /// Its line in the file, from 1.
    pub(crate) line: usize,
    /// What sets it: `TT1=T1 P1 Z10.16`.
    pub(crate) statement: String,
}

/// Reads a file, of which all lengths are mm. Words of lathes and of more axes are left out.
pub(crate) fn read(path: &Path) -> Result<Vec<Tool>> {
    let name = path.display();
    let text = fs::read_to_string(path).with_context(|| format!("cannot read the tools {name}"))?;
    let mut left_out = BTreeSet::new();
    let tools = parse(&text, &mut left_out).with_context(|| format!("in {name}"))?;
    if !left_out.is_empty() {
        let letters: Vec<_> = left_out.iter().map(char::to_string).collect();
        let letters = letters.join(", ");
        ui::warning(&format!(
            "{name}: left out {letters}, which the machine does not have"
        ));
    }
    Ok(tools)
}

fn parse(text: &str, left_out: &mut BTreeSet<char>) -> Result<Vec<Tool>> {
    let mut tools = Vec::new();
    for (line, text) in (1..).zip(text.lines()) {
        let words = text.split(';').next().unwrap_or_default();
        if words.trim().is_empty() {
            continue;
        }
        let tool = tool(words, left_out).with_context(|| format!("line {line}"))?;
        tools.push(Tool {
            line,
            statement: tool,
        });
    }
    Ok(tools)
}

/// Returns what sets the tool of a line.
fn tool(line: &str, left_out: &mut BTreeSet<char>) -> Result<String> {
    let mut number = None;
    let mut known = Vec::new();
    for (letter, value) in words(line)? {
        if letter == 'T' {
            number = value.parse::<u8>().ok().filter(|number| *number != 0);
            ensure!(number.is_some(), "T{value} is no tool from 1 to 255");
        }
        if WORDS.contains(letter) {
            known.push(format!("{letter}{value}"));
        } else if value.parse::<f64>().is_ok_and(|value| value != 0.0) {
            left_out.insert(letter);
        }
    }
    let number = number.context("there is no T word")?;
    Ok(format!("TT{number}={}", known.join(" ")))
}

/// Splits a line into words, whose number may stand behind a blank.
fn words(line: &str) -> Result<Vec<(char, String)>> {
    let line = line.to_ascii_uppercase();
    let mut words: Vec<(char, String)> = Vec::new();
    for letter in line.chars().filter(|letter| !letter.is_whitespace()) {
        if letter.is_ascii_alphabetic() {
            words.push((letter, String::new()));
        } else {
            let (_, value) = words
                .last_mut()
                .ok_or_else(|| anyhow!("`{letter}` stands before any word"))?;
            value.push(letter);
        }
    }
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_of_linuxcnc_is_read() {
        let text = "; tools\n\nT1 P1 D3.048 Z+10.16 ;1/8 end mill\nt2p2 x 1.27 i90 a0\n";
        let mut left_out = BTreeSet::new();
        let tools = parse(text, &mut left_out).unwrap();
        let tools: Vec<_> = tools
            .iter()
            .map(|tool| (tool.line, &*tool.statement))
            .collect();
        assert_eq!(
            tools,
            [(3, "TT1=T1 P1 D3.048 Z+10.16"), (4, "TT2=T2 P2 X1.27")]
        );
        assert_eq!(left_out, BTreeSet::from(['I']));
    }

    #[test]
    fn a_line_without_a_tool_is_refused() {
        for (text, reason) in [
            ("T1 Z1\nP2 Z3", "line 2: there is no T word"),
            ("T0 Z1", "line 1: T0 is no tool from 1 to 255"),
            ("T256", "line 1: T256 is no tool from 1 to 255"),
            ("5 T1", "line 1: `5` stands before any word"),
        ] {
            let error = parse(text, &mut BTreeSet::new()).unwrap_err();
            assert_eq!(format!("{error:#}"), reason);
        }
    }
}
