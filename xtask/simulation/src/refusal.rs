//! Refused lines and alarms, for the reader.

use owo_colors::OwoColorize;

use crate::{
    meaning,
    playing::RaisedAlarm,
    sender::{Response, shown},
};

/// A refused line with the reason: `12:  G999 X1   error:20 this command …`.
pub fn refusal(number: u64, line: &[u8], response: Response) -> String {
    let reason = match response {
        Response::Error(number) => {
            meaning::error_with_remedy(number).unwrap_or_else(|| "an unknown error".into())
        }
        Response::Ok => String::new(),
    };
    row(number, &shown(line), &response.to_string(), &reason)
}

/// An alarm with its line and the reason, as a refused line.
pub fn alarm_row(alarm: &RaisedAlarm) -> String {
    row(alarm.line, &alarm.text, &alarm.name, &alarm.why)
}

fn row(number: u64, text: &str, label: &str, reason: &str) -> String {
    let place = format!("{number}:");
    let gap = if text.is_empty() { "" } else { "  " };
    let label = label.red().bold().to_string();
    format!("{place:>8}  {text}{gap}{label} {reason}")
}
