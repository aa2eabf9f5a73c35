//! Why lines were refused: each cause once, with how many lines it cost.

use std::cmp::Reverse;

use crate::{
    meaning,
    playing::RaisedAlarm,
    sender::{Response, code},
};
use common::text::separated;
use leadscrew::{
    axis::{AXES, LETTERS},
    gcode::{LineError, Modal, ParsedLine},
};
use serde::{Deserialize, Serialize};

/// Refused lines that are printed one by one; the table has all of them.
const PRINTED: u64 = 20;
/// The letters of all axes that a build may have.
const ALL_AXES: &[u8] = b"XYZABC";
/// What only a machine with an interpreter of its own reads.
const EXPRESSIONS: &str = "O-words and expressions";

/// What was refused, by cause.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Refusals {
    causes: Vec<Cause>,
    count: u64,
    /// The newest alarm.
    alarm: Option<RaisedAlarm>,
}

/// One cause.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cause {
    /// The answer to its lines.
    pub response: Response,
    /// The word or the kind of line; empty for the line as a whole.
    pub what: String,
    /// The reason, to read.
    pub why: String,
    /// Number of lines.
    pub count: u64,
    /// Number of the first line.
    pub first: u64,
}

impl Cause {
    /// The reason, and what to do about the error where that is all that is known.
    pub fn why_with_remedy(&self) -> String {
        let Response::Error(number) = self.response else {
            return self.why.clone();
        };
        let is_of_error = line_error(number).is_some_and(|error| error.text() == self.why);
        let with_remedy = is_of_error.then(|| meaning::error_with_remedy(number));
        with_remedy.flatten().unwrap_or_else(|| self.why.clone())
    }
}

/// A cause in a table that is kept as JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefusalRow {
    /// Number of lines.
    pub count: u64,
    /// The word or the kind of line; empty for the line as a whole.
    pub what: String,
    /// The reason, and what to do.
    pub why: String,
    /// `error:20`.
    pub answer: String,
    /// Number of the first line.
    pub first: u64,
}

impl RefusalRow {
    /// The row of a cause.
    pub fn of(cause: &Cause) -> Self {
        Self {
            count: cause.count,
            what: cause.what.clone(),
            why: cause.why_with_remedy(),
            answer: cause.response.to_string(),
            first: cause.first,
        }
    }
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

    /// Takes note of an alarm: it is why the lines that follow are refused.
    pub fn raise(&mut self, alarm: RaisedAlarm) {
        self.alarm = Some(alarm);
    }

    /// The newest alarm.
    pub fn alarm(&self) -> Option<&RaisedAlarm> {
        self.alarm.as_ref()
    }

    /// Returns the causes, most frequent first.
    pub fn causes(&self) -> Vec<&Cause> {
        let mut causes: Vec<_> = self.causes.iter().collect();
        causes.sort_by_key(|cause| Reverse(cause.count));
        causes
    }

    /// What made the machine refuse a line, and why that is none of its commands.
    fn cause(&self, code: &[u8], response: Response) -> (String, String) {
        let Response::Error(number) = response else {
            return (String::new(), String::new());
        };
        let error = line_error(number);
        let text = error.map_or("an unknown error", LineError::text);
        if error == Some(LineError::Locked)
            && let Some(RaisedAlarm {
                line, name, why, ..
            }) = &self.alarm
        {
            let at = separated(*line);
            return (
                String::new(),
                format!("locked by {name} at line {at}, {why}"),
            );
        }
        if is_expression(code) {
            return (
                EXPRESSIONS.into(),
                "the machine has no interpreter for them".into(),
            );
        }
        if code.contains(&grbl_client::sender::REFUSED) {
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

/// The error of a number.
pub fn line_error(number: u16) -> Option<LineError> {
    let mut errors = LineError::ALL.into_iter();
    errors.find(|error| u16::from(error.number()) == number)
}
