//! What a run shows: answers, messages, and where the machine ended.
//!
//! The JSON form is fixed: other tools read it. Answers are kept as runs of equal ones, so a
//! program of a million accepted lines takes no memory.

use std::{
    fs::File,
    io::{BufWriter, Write as _},
    path::Path,
};

use anstream::println;
use anyhow::{Context, Result};
use leadscrew::settings::Settings;
use owo_colors::OwoColorize;
use serde::{Serialize, Serializer, ser::SerializeSeq};

use crate::{quality::Quality, sender::Response};

/// The answers to all lines, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Responses {
    runs: Vec<(Response, u64)>,
}

impl Responses {
    /// Adds the answer to the next line.
    pub(crate) fn push(&mut self, response: Response) {
        match self.runs.last_mut() {
            Some((last, count)) if *last == response => *count += 1,
            _ => self.runs.push((response, 1)),
        }
    }

    /// The answers with their line numbers, from 1.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u64, Response)> {
        let each = self
            .runs
            .iter()
            .flat_map(|(response, count)| (0..*count).map(|_| *response));
        (1..).zip(each)
    }

    /// Number of lines that were refused.
    pub(crate) fn refused(&self) -> u64 {
        let errors = self.runs.iter().filter(|(run, _)| *run != Response::Ok);
        errors.map(|(_, count)| count).sum()
    }
}

impl Serialize for Responses {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut sequence = serializer.serialize_seq(None)?;
        for answer in self.iter() {
            sequence.serialize_element(&answer)?;
        }
        sequence.end()
    }
}

/// Where the machine ended.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Final {
    /// State, with Grbl's name.
    pub(crate) state: String,
    /// Machine position, mm.
    pub(crate) mpos_mm: Vec<f64>,
    /// Machine position, steps.
    pub(crate) steps: Vec<i32>,
}

impl Final {
    /// The positions in mm follow from those in steps.
    pub(crate) fn new(state: String, steps: &[i32], settings: &Settings) -> Self {
        let scales = settings.steps_per_mm.iter();
        let mm = steps.iter().zip(scales).map(|(steps, scale)| {
            // Millionths of a step per mm: whole, so the quotient is the nearest number.
            f64::from(*steps) * 1e6 / scale.millionths() as f64
        });
        Self {
            state,
            mpos_mm: mm.collect(),
            steps: steps.to_vec(),
        }
    }
}

/// Everything a run shows.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Figures {
    /// Number of lines sent.
    pub(crate) lines: u64,
    /// The answers.
    pub(crate) responses: Responses,
    /// Everything else the machine said, after how many answers.
    pub(crate) messages: Vec<(u64, String)>,
    /// Where it ended.
    #[serde(rename = "final")]
    pub(crate) end: Final,
    /// Step pulses per axis.
    pub(crate) steps_axis: Vec<u64>,
    /// From the first to the last step, s.
    pub(crate) motion_time_s: f64,
    /// Step events: axes that step together count once.
    pub(crate) events: u64,
    /// Step events that came late.
    pub(crate) late: u64,
    /// Hash over all step events, 16 hexadecimal digits.
    pub(crate) event_hash: String,
    /// How good the motion is, where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) quality: Option<Quality>,
}

impl Figures {
    /// Whether an alarm rose.
    pub(crate) fn has_alarm(&self) -> bool {
        let mut messages = self.messages.iter();
        self.end.state == "Alarm" || messages.any(|(_, text)| text.starts_with("ALARM:"))
    }

    /// Whether every line was accepted and no alarm rose.
    pub(crate) fn is_clean(&self) -> bool {
        self.responses.refused() == 0 && !self.has_alarm()
    }

    /// Writes the JSON form.
    pub(crate) fn write_json(&self, path: &Path) -> Result<()> {
        write_json(path, self)
    }

    /// Prints the summary.
    pub(crate) fn print(&self) {
        let refused = match self.responses.refused() {
            0 => String::new(),
            count => format!(", {} refused", separated(count)).red().to_string(),
        };
        row("lines", &format!("{}{refused}", separated(self.lines)));
        let letters = "XYZABC".chars();
        let axes = letters.zip(&self.end.mpos_mm).zip(&self.end.steps);
        let ends: Vec<_> = axes
            .map(|((letter, position), steps)| {
                let unit = if "ABC".contains(letter) { "°" } else { "mm" };
                format!("{letter} {position:.3} {unit} ({} steps)", grouped(*steps))
            })
            .collect();
        row(
            "final position",
            &format!("{}, {}", ends.join(", "), self.end.state),
        );
        row("motion time", &duration(self.motion_time_s));
        let pulses: Vec<_> = "XYZABC"
            .chars()
            .zip(&self.steps_axis)
            .map(|(letter, count)| format!("{letter} {}", separated(*count)))
            .collect();
        row("steps", &pulses.join(", "));
        let late = match self.late {
            0 => String::new(),
            count => format!(", {} late", separated(count)).red().to_string(),
        };
        row(
            "step events",
            &format!("{}{late}, hash {}", separated(self.events), self.event_hash),
        );
    }
}

/// Writes a value as JSON, streaming.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let name = path.display();
    let file = File::create(path).with_context(|| format!("cannot create {name}"))?;
    let mut writer = BufWriter::new(file);
    serde_json::to_writer(&mut writer, value).with_context(|| format!("cannot write {name}"))?;
    writeln!(writer)
        .and_then(|()| writer.flush())
        .with_context(|| format!("cannot write {name}"))
}

/// Prints one row of a summary.
pub(crate) fn row(name: &str, value: &str) {
    println!("{:>16}  {value}", name.dimmed());
}

/// A time to read: `1 h 02 min 03.4 s`.
pub(crate) fn duration(seconds: f64) -> String {
    let (hours, rest) = ((seconds / 3600.0).floor(), seconds % 3600.0);
    let (minutes, rest) = ((rest / 60.0).floor(), rest % 60.0);
    if hours > 0.0 {
        format!("{hours} h {minutes:02} min {rest:04.1} s")
    } else if minutes > 0.0 {
        format!("{minutes} min {rest:04.1} s")
    } else {
        format!("{rest:.3} s")
    }
}

/// A number with its digits in groups of three.
pub(crate) fn separated(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// The same for numbers with a sign.
fn grouped(number: i32) -> String {
    let sign = if number < 0 { "-" } else { "" };
    format!("{sign}{}", separated(u64::from(number.unsigned_abs())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_json_form_is_the_documented_one() {
        let mut responses = Responses::default();
        for response in [Response::Ok, Response::Ok, Response::Error(20)] {
            responses.push(response);
        }
        let figures = Figures {
            lines: 3,
            responses,
            messages: vec![(2, "[MSG:Pgm End]".into())],
            end: Final {
                state: "Idle".into(),
                mpos_mm: vec![1.5, 0.0, -2.0],
                steps: vec![375, 0, -500],
            },
            steps_axis: vec![375, 0, 500],
            motion_time_s: 0.25,
            events: 800,
            late: 0,
            event_hash: "cbf29ce484222325".into(),
            quality: None,
        };
        let expected = r#"{"lines":3,"responses":[[1,"ok"],[2,"ok"],[3,"error:20"]],"messages":[[2,"[MSG:Pgm End]"]],"final":{"state":"Idle","mpos_mm":[1.5,0.0,-2.0],"steps":[375,0,-500]},"steps_axis":[375,0,500],"motion_time_s":0.25,"events":800,"late":0,"event_hash":"cbf29ce484222325"}"#;
        assert_eq!(serde_json::to_string(&figures).unwrap(), expected);
        assert!(!figures.is_clean());
    }

    #[test]
    fn durations_are_readable() {
        assert_eq!(duration(3.25), "3.250 s");
        assert_eq!(duration(63.0), "1 min 03.0 s");
        assert_eq!(duration(3723.4), "1 h 02 min 03.4 s");
        assert_eq!(separated(1_234_567), "1 234 567");
    }
}
