//! A refused line, for the reader.

use crate::line_error;
use leadscrew::gcode::LineError;
use owo_colors::OwoColorize;

use crate::sender::Response;

/// A refused line with the reason: `12:  G999 X1   error:20 this command …`.
pub fn refusal(number: u64, line: &[u8], response: Response) -> String {
    const WIDTH: usize = 60;
    let text = String::from_utf8_lossy(line);
    let mut shown: String = text
        .chars()
        .map(|c| if c.is_control() { '·' } else { c })
        .collect();
    if shown.chars().count() > WIDTH {
        shown = shown.chars().take(WIDTH - 1).chain(['…']).collect();
    }
    let reason = match response {
        Response::Error(number) => line_error(number).map_or("an unknown error", LineError::text),
        Response::Ok => "",
    };
    let label = response.to_string();
    format!(
        "{:>8}  {shown}  {} {reason}",
        format!("{number}:"),
        label.red().bold()
    )
}
