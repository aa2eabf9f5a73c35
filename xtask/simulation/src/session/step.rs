//! The steps of an exchange, as the files have them.

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::machine::Pin;

/// One step: exactly one of its first fields.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Step {
    /// Sent with a line feed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<String>,
    /// Sent as it is, hexadecimal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub raw: Option<String>,
    /// One byte, hexadecimal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rt: Option<String>,
    /// Seconds to wait.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wait: Option<f64>,
    /// Wait for standstill, at most so many seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub idle: Option<f64>,
    /// An input and its level: 0 is a closed contact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pin: Option<(String, Value)>,
    /// Recordings list what arrived at power-up as a first step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub boot: Option<Value>,
    /// Earliest time of the step, seconds from the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub t: Option<f64>,
    /// Run this long before the next step, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after: Option<f64>,
    /// Do not wait for the answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nowait: Option<Value>,
    /// Lines that arrived, without line ends.
    pub recv: Vec<String>,
    /// When, seconds from the first step.
    pub recv_t: Vec<f64>,
    /// Why nothing was done.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// What a step does, read from its text.
#[derive(Debug, Clone, PartialEq)]
pub enum Act {
    /// What arrived at power-up.
    Boot,
    /// A line to be sent.
    Line {
        /// The line.
        text: String,
        /// Whether its answer is waited for.
        waits: bool,
    },
    /// Bytes to be sent.
    Bytes(Vec<u8>),
    /// So many seconds pass.
    Wait(f64),
    /// Standstill is waited for, so many seconds at most.
    Idle(f64),
    /// A contact opens or closes.
    Pin {
        /// Which.
        pin: Pin,
        /// Whether it closes.
        closed: bool,
    },
}

impl Step {
    /// Reads the step.
    ///
    /// # Errors
    /// It is none or more than one of the kinds, or its text means nothing.
    pub fn act(&self) -> Result<Act> {
        for seconds in [self.wait, self.idle, self.after, self.t]
            .into_iter()
            .flatten()
        {
            ensure!(
                (0.0..=1e6).contains(&seconds),
                "{seconds} is no time in seconds"
            );
        }
        let kinds = [
            self.boot.as_ref().map(|_| Ok(Act::Boot)),
            self.line.as_ref().map(|text| {
                Ok(Act::Line {
                    text: text.clone(),
                    waits: self.nowait.as_ref().is_none_or(is_false),
                })
            }),
            self.raw.as_ref().map(|raw| bytes(raw).map(Act::Bytes)),
            self.rt.as_ref().map(|rt| realtime(rt)),
            self.wait.map(|seconds| Ok(Act::Wait(seconds))),
            self.idle.map(|seconds| Ok(Act::Idle(seconds))),
            self.pin.as_ref().map(|(name, level)| pin(name, level)),
        ];
        let mut kinds = kinds.into_iter().flatten();
        match (kinds.next(), kinds.next()) {
            (Some(act), None) => act,
            (None, _) => bail!("it has none of line, raw, rt, wait, idle, pin"),
            (Some(_), Some(_)) => bail!("it has more than one of line, raw, rt, wait, idle, pin"),
        }
    }

    /// What the step does, for a reader.
    pub fn name(&self) -> String {
        match self.act() {
            Ok(Act::Line { text, .. }) => format!("`{text}`"),
            Ok(Act::Bytes(bytes)) if bytes.len() == 1 => match bytes[0] {
                byte @ b'!'..=b'~' => format!("`{}`", char::from(byte)),
                byte => format!("0x{byte:02x}"),
            },
            Ok(Act::Bytes(bytes)) => format!("{} bytes", bytes.len()),
            Ok(Act::Wait(seconds)) => format!("wait {seconds} s"),
            Ok(Act::Idle(_)) => "wait for standstill".into(),
            Ok(Act::Pin { pin, closed }) => {
                format!("{pin} {}", if closed { "closes" } else { "opens" })
            }
            Ok(Act::Boot) => "power-up".into(),
            Err(_) => "no step".into(),
        }
    }

    /// The bytes that the step sends.
    pub fn sends(&self) -> Vec<u8> {
        match self.act() {
            Ok(Act::Line { text, .. }) => [text.as_bytes(), b"\n"].concat(),
            Ok(Act::Bytes(bytes)) => bytes,
            Ok(Act::Boot | Act::Wait(_) | Act::Idle(_) | Act::Pin { .. }) | Err(_) => Vec::new(),
        }
    }
}

fn realtime(hexadecimal: &str) -> Result<Act> {
    let bytes = bytes(hexadecimal)?;
    ensure!(bytes.len() == 1, "{hexadecimal:?} is not one byte");
    Ok(Act::Bytes(bytes))
}

fn pin(name: &str, level: &Value) -> Result<Act> {
    let closed = match level {
        Value::Bool(level) => !level,
        level => match level.as_f64() {
            Some(0.0) => true,
            Some(1.0) => false,
            _ => bail!("{level} is no level: 0 is a closed contact, 1 an open one"),
        },
    };
    Ok(Act::Pin {
        pin: name.parse()?,
        closed,
    })
}

/// Reads hexadecimal bytes.
fn bytes(hexadecimal: &str) -> Result<Vec<u8>> {
    let digit = |byte: u8| {
        let value = char::from(byte).to_digit(16);
        value.with_context(|| format!("{hexadecimal:?} is not hexadecimal"))
    };
    let digits = hexadecimal.as_bytes();
    ensure!(
        digits.len().is_multiple_of(2),
        "{hexadecimal:?} has half a byte"
    );
    let pairs = digits.chunks_exact(2);
    pairs
        .map(|pair| Ok((digit(pair[0])? * 16 + digit(pair[1])?) as u8))
        .collect()
}

/// `nowait` may be written as a number or as a truth value.
fn is_false(value: &Value) -> bool {
    matches!(value, Value::Null | Value::Bool(false)) || value.as_f64() == Some(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn act(json: &str) -> Result<Act> {
        serde_json::from_str::<Step>(json)?.act()
    }

    #[test]
    fn every_recorded_kind_of_step_is_read() {
        for json in [
            r#"{"line": "G0X1", "t": 0.5, "after": 0.1, "nowait": 1, "recv": ["ok"]}"#,
            r#"{"rt": "3f"}"#,
            r#"{"raw": "4730203f58310a", "recv_t": [0.1]}"#,
            r#"{"wait": 0.6}"#,
            r#"{"idle": 2}"#,
            r#"{"boot": true, "recv": ["", "Grbl"]}"#,
            r#"{"pin": ["XLIM", 0]}"#,
            r#"{"pin": ["RESET", 1], "after": 0.3}"#,
            r#"{"pin": ["FEED_HOLD", 0]}"#,
            r#"{"pin": ["CYCLE_START", 0]}"#,
            r#"{"pin": ["DOOR", 0]}"#,
        ] {
            act(json).unwrap();
        }
        let waits = |json| matches!(act(json).unwrap(), Act::Line { waits: true, .. });
        assert!(waits(r#"{"line": "", "nowait": 0}"#));
        assert!(!waits(r#"{"line": "", "nowait": true}"#));
    }

    #[test]
    fn a_step_that_cannot_be_replayed_says_why() {
        for (json, part) in [
            (r#"{"t": 1}"#, "none of"),
            (r#"{"line": "", "wait": 1}"#, "more than one"),
            (r#"{"pin": ["KNOCK", 0]}"#, "KNOCK"),
            (r#"{"pin": ["XLIM", 2]}"#, "no level"),
            (r#"{"rt": "3f21"}"#, "one byte"),
            (r#"{"raw": "3"}"#, "half"),
            (r#"{"raw": "zz"}"#, "hexadecimal"),
            (r#"{"wait": -1}"#, "no time"),
        ] {
            let error = act(json).unwrap_err().to_string();
            assert!(error.contains(part), "{json}: {error}");
        }
        assert_eq!(bytes("0aFf").unwrap(), [10, 255]);
    }
}
