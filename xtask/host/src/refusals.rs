//! Why lines were refused: each cause once, with how many lines it cost.

use std::cmp::Reverse;

use common::text::{row, separated};
use leadscrew::{
    axis::{AXES, LETTERS},
    gcode::{LineError, Modal, ParsedLine},
    model::Alarm,
};
use owo_colors::OwoColorize;

use crate::{
    refusal::line_error,
    sender::{Response, code},
};

/// Refused lines that are printed one by one; the table has all of them.
const PRINTED: u64 = 20;
/// Causes that are printed: a file that is no program has one in each line.
const CAUSES: usize = 24;
/// The letters of all axes that a build may have.
const ALL_AXES: &[u8] = b"XYZABC";
/// What only a machine with an interpreter of its own reads.
const EXPRESSIONS: &str = "O-words and expressions";

/// What was refused, by cause.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Refusals {
    causes: Vec<Cause>,
    count: u64,
    /// The newest alarm, and how many lines had been answered.
    alarm: Option<(u64, String)>,
}

/// One cause.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Cause {
    response: Response,
    /// The word or the kind of line; empty for the line as a whole.
    what: String,
    why: String,
    count: u64,
    /// Number of the first line.
    first: u64,
}

impl Refusals {
    /// Adds the refused line of a number. Returns whether it is one of the few that are printed at once.
    pub fn add(&mut self, number: u64, line: &[u8], response: Response) -> bool {
        self.count += 1;
        let (what, why) = self.cause(&code(line), response);
        let mut causes = self.causes.iter_mut();
        let known = causes
            .find(|cause| (cause.response, &cause.what, &cause.why) == (response, &what, &why));
        match known {
            Some(cause) => cause.count += 1,
            None => self.causes.push(Cause {
                response,
                what,
                why,
                count: 1,
                first: number,
            }),
        }
        self.count <= PRINTED
    }

    /// Takes note of an alarm after so many answers: it is why the lines behind it are refused.
    pub fn alarm(&mut self, answers: u64, text: &str) {
        self.alarm = Some((answers, text.to_owned()));
    }

    /// Returns whether lines were refused that have not been printed.
    pub fn has_unprinted(&self) -> bool {
        self.count > PRINTED
    }

    /// Prints the table, most frequent first; nothing when no line was refused.
    pub fn print(&self) {
        for (index, line) in self.table().iter().enumerate() {
            row(if index == 0 { "refused" } else { "" }, line);
        }
    }

    /// The lines of the table.
    fn table(&self) -> Vec<String> {
        let mut causes: Vec<_> = self.causes.iter().collect();
        causes.sort_by_key(|cause| Reverse(cause.count));
        let width = causes.first().map_or(0, |most| separated(most.count).len());
        let rows = causes.iter().take(CAUSES).map(|cause| {
            let count = separated(cause.count);
            let what = match cause.what.as_str() {
                "" => String::new(),
                what => format!("{}: ", what.red()),
            };
            let (why, response, first) = (&cause.why, cause.response, separated(cause.first));
            format!("{count:>width$} × {what}{why} ({response}, first in line {first})")
        });
        let mut rows: Vec<_> = rows.collect();
        if let Some(others) = causes.len().checked_sub(CAUSES + 1) {
            rows.push(format!("and {} more causes", separated(others as u64 + 1)));
        }
        rows
    }

    /// What made the machine refuse a line, and why that is none of its commands.
    fn cause(&self, code: &[u8], response: Response) -> (String, String) {
        let Response::Error(number) = response else {
            return (String::new(), String::new());
        };
        let error = line_error(number);
        let text = error.map_or("an unknown error", LineError::text);
        if error == Some(LineError::Locked)
            && let Some((answers, alarm)) = &self.alarm
        {
            let after = separated(*answers);
            let reason = alarm_text(alarm).map_or(String::new(), |text| format!(", {text}"));
            return (
                String::new(),
                format!("locked by {alarm} after line {after}{reason}"),
            );
        }
        if is_expression(code) {
            return (
                EXPRESSIONS.into(),
                "the machine has no interpreter for them".into(),
            );
        }
        if code.contains(&crate::program::REFUSED) {
            return (
                "a byte of a realtime command".into(),
                "it is not sent in a program: `?`, `!`, `~`, 0x18 and all above 0x7f".into(),
            );
        }
        if code.starts_with(b"$H") && error == Some(LineError::HomingDisabled) {
            return ("$H".into(), format!("{text}: --set '$22=1' --switches"));
        }
        if error == Some(LineError::Unsupported)
            && let Some(word) = words(code).find(|word| !is_supported(word))
        {
            return (name(word), axis_that_lacks(word).unwrap_or(text.into()));
        }
        (String::new(), text.into())
    }
}

/// What an alarm such as `ALARM:2` means.
fn alarm_text(alarm: &str) -> Option<&'static str> {
    let mut alarms = Alarm::ALL.into_iter();
    let found = alarms.find(|known| known.to_string() == alarm);
    found.map(Alarm::text)
}

/// Whether a line belongs to a program with variables, subroutines or loops.
fn is_expression(code: &[u8]) -> bool {
    let is_call = |word: &[u8]| matches!(name(word).as_str(), "M98" | "M99");
    !code.starts_with(b"$")
        && (code.starts_with(b"O")
            || code.iter().any(|byte| matches!(byte, b'#' | b'['))
            || words(code).any(is_call))
}

/// The words of a line: each begins with a letter.
fn words(code: &[u8]) -> impl Iterator<Item = &[u8]> {
    let words = code.chunk_by(|_, next| !next.is_ascii_alphabetic());
    words.filter(|word| word[0].is_ascii_alphabetic())
}

/// Whether a word is known, whatever else is in its line.
fn is_supported(word: &[u8]) -> bool {
    let read = ParsedLine::new(&Modal::default()).read(word);
    read != Err(LineError::Unsupported)
}

/// What a word is called: a command with its number, anything else by its letter.
fn name(word: &[u8]) -> String {
    let letter = char::from(word[0]);
    let number = String::from_utf8_lossy(&word[1..]);
    match number.parse::<f64>() {
        Ok(number) if matches!(letter, 'G' | 'M') => format!("{letter}{number}"),
        _ => letter.into(),
    }
}

/// Says of the word of an axis that another build has it.
fn axis_that_lacks(word: &[u8]) -> Option<String> {
    let axis = ALL_AXES.iter().position(|letter| *letter == word[0])?;
    let built = ["three", "four", "five", "six"].get(AXES - 3)?;
    let wanted = axis + 1;
    (!LETTERS[..AXES].contains(&word[0]))
        .then(|| format!("this build has {built} axes, --axes {wanted}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(lines: &[(&str, u16)]) -> Vec<String> {
        let mut refusals = Refusals::default();
        for (number, (line, error)) in (1..).zip(lines) {
            refusals.add(number, line.as_bytes(), Response::Error(*error));
        }
        plain(&refusals)
    }

    fn plain(refusals: &Refusals) -> Vec<String> {
        let table = refusals.table();
        let lines = table.iter();
        lines
            .map(|line| anstream::adapter::strip_str(line).to_string())
            .collect()
    }

    #[test]
    fn causes_are_counted_and_the_most_frequent_comes_first() {
        let mut lines = vec![("T1 M0106", 20), ("o100 call", 20), ("#1=3", 1)];
        lines.extend([("G1 X[#1+2]", 2), ("M98 P100", 20), ("M106", 20)]);
        lines.extend(vec![("G0 X1 C5.5 (turn)", 20); 1000]);
        let table = refused(&lines);
        if AXES < 6 {
            let built = ["three", "four", "five"][AXES - 3];
            let axis = format!("1 000 × C: this build has {built} axes, --axes 6");
            assert!(table[0].starts_with(&axis), "{table:?}");
            assert!(
                table[0].ends_with("(error:20, first in line 7)"),
                "{table:?}"
            );
        }
        let expected =
            "    2 × M106: this command or word is not supported (error:20, first in line 1)";
        assert!(table.contains(&expected.to_owned()), "{table:#?}");
        let expressions = "O-words and expressions: the machine has no interpreter for them";
        let of_them = table.iter().filter(|line| line.contains(expressions));
        // Each error once: 1, 2, 20.
        assert_eq!(of_them.count(), 3, "{table:#?}");
    }

    #[test]
    fn lines_behind_an_alarm_are_one_cause_that_names_it() {
        let mut refusals = Refusals::default();
        refusals.alarm(12, "ALARM:2");
        for number in 13..40 {
            let is_printed = refusals.add(number, b"G1 A5 M6", Response::Error(9));
            assert_eq!(is_printed, number < 33);
        }
        assert!(refusals.has_unprinted());
        let table = plain(&refusals);
        assert_eq!(table.len(), 1);
        let reason = "locked by ALARM:2 after line 12, the target is outside the machine's travel";
        assert!(table[0].starts_with(&format!("27 × {reason}")), "{table:?}");
    }

    #[test]
    fn what_has_a_remedy_names_it() {
        for (line, error, part) in [
            ("$H", 5, "--set '$22=1' --switches"),
            ("G1 X1\x7f5", 2, "a byte of a realtime command"),
            ("G33 X1", 20, "1 × G33: this"),
            ("G5.1 I1", 20, "1 × G5.1: this"),
            ("G1 X1 D3", 20, "1 × D: this"),
            ("G1 G2 X1", 21, "1 × two commands"),
        ] {
            let table = refused(&[(line, error)]);
            assert!(table[0].contains(part), "{line}: {table:?}");
        }
        assert!(refused(&[]).is_empty());
    }

    #[test]
    fn a_file_that_is_no_program_fills_no_page() {
        let numbers: Vec<_> = (200..256).map(|number| format!("G{number}")).collect();
        let lines: Vec<_> = numbers.iter().map(|line| (line.as_str(), 20)).collect();
        let table = refused(&lines);
        assert_eq!(table.len(), CAUSES + 1);
        assert_eq!(table[CAUSES], "and 32 more causes");
    }
}
