//! Bytes that have come to lines, and lines to what they mean.

use std::fmt;

use crate::Report;

/// Longest line that is kept, bytes: those of machines are shorter.
const LONGEST: usize = 4096;

/// Lines out of bytes, however these come.
#[derive(Debug, Default)]
pub struct Lines {
    received: Vec<u8>,
    /// The line that has begun is too long; what comes of it is passed over.
    is_too_long: bool,
}

impl Lines {
    /// Takes bytes that have come.
    pub fn push(&mut self, bytes: &[u8]) {
        self.received.extend(bytes);
    }

    /// The next whole line, without its end. What is no UTF-8 becomes U+FFFD, and control characters, which a terminal
    /// would obey, become their pictures; a line that is [too long](Self::is_too_long) is left out.
    pub fn next_line(&mut self) -> Option<String> {
        loop {
            let Some(length) = self.received.iter().position(|byte| *byte == b'\n') else {
                if self.received.len() > LONGEST {
                    self.received.clear();
                    self.is_too_long = true;
                }
                return None;
            };
            let line: Vec<u8> = self.received.drain(..=length).collect();
            if !std::mem::take(&mut self.is_too_long) && length <= LONGEST {
                let text = String::from_utf8_lossy(&line);
                let text = text.trim_matches(['\r', '\n']);
                return Some(text.chars().map(printable).collect());
            }
        }
    }

    /// Whether what has come since the last line is longer than any line of a machine: it is no text, or the baud
    /// rate is another.
    #[must_use]
    pub fn is_too_long(&self) -> bool {
        self.is_too_long || self.received.len() > LONGEST && !self.received.contains(&b'\n')
    }

    /// Whether nothing of a line has come.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.received.is_empty()
    }
}

/// A character, or the picture of a control character: U+2400 to U+2421. Those above ASCII have none.
fn printable(character: char) -> char {
    match character {
        '\t' => '\t',
        '\0'..=' ' if character != ' ' => {
            char::from_u32(0x2400 + u32::from(character)).unwrap_or(char::REPLACEMENT_CHARACTER)
        }
        '\x7f' => '␡',
        _ if character.is_control() => char::REPLACEMENT_CHARACTER,
        _ => character,
    }
}

/// The machine's answer to one line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Response {
    /// `ok`.
    Ok,
    /// `error:N`.
    Error(u16),
}

impl Response {
    /// Reads an answer; `None` for every other text.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        match text.strip_prefix("error:") {
            Some(number) => number.trim().parse().ok().map(Self::Error),
            None => (text == "ok").then_some(Self::Ok),
        }
    }
}

impl fmt::Display for Response {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ok => formatter.write_str("ok"),
            Self::Error(number) => write!(formatter, "error:{number}"),
        }
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for Response {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// What a line of a machine means.
#[derive(Debug, Clone, PartialEq)]
pub enum Line<'a> {
    /// `ok` or `error:N`.
    Response(Response),
    /// `<Idle|MPos:0.000,0.000,0.000|FS:0,0>`.
    Report(Report),
    /// `ALARM:N`: what stands behind the colon.
    Alarm(&'a str),
    /// `Grbl 1.1h ['$' for help]`, and the like of others: the machine has been reset.
    Welcome,
    /// `[MSG:Pgm End]`: what stands behind the colon.
    Message(&'a str),
    /// `[GC:G0 G54]`, `[G54:0.000,0.000,0.000]`, `[VER:1.1h.20190830:]`: the name, and what stands behind its colon.
    Answer(&'a str, &'a str),
    /// `$110=500.000`, with whatever some firmware says behind it: the number, and the value.
    Setting(u16, &'a str),
    /// Anything else, such as nothing at all, or what has lost bytes.
    Other,
}

impl<'a> Line<'a> {
    /// Reads a line without its end.
    #[must_use]
    pub fn read(text: &'a str) -> Self {
        if let Some(response) = Response::parse(text) {
            Self::Response(response)
        } else if let Some(report) = Report::read(text) {
            Self::Report(report)
        } else if let Some(number) = text.strip_prefix("ALARM:") {
            Self::Alarm(number.trim())
        } else if text.starts_with("Grbl") {
            Self::Welcome
        } else if let Some((name, rest)) = bracketed(text) {
            match name {
                "MSG" => Self::Message(rest),
                _ => Self::Answer(name, rest),
            }
        } else if let Some((number, value)) = setting(text) {
            Self::Setting(number, value)
        } else {
            Self::Other
        }
    }
}

fn bracketed(text: &str) -> Option<(&str, &str)> {
    text.strip_prefix('[')?.strip_suffix(']')?.split_once(':')
}

fn setting(text: &str) -> Option<(u16, &str)> {
    let (number, rest) = text.strip_prefix('$')?.split_once('=')?;
    let value = rest.trim_start().split([' ', '(']).next()?;
    Some((number.trim_end().parse().ok()?, value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_the_same_however_their_bytes_come() {
        let bytes = b"Grbl 1.1h ['$' for help]\r\n\r\nok\nerror:2\r\n\xff\xfe\r\nno end";
        for size in 1..bytes.len() {
            let mut lines = Lines::default();
            let mut seen = Vec::new();
            for piece in bytes.chunks(size) {
                lines.push(piece);
                seen.extend(std::iter::from_fn(|| lines.next_line()));
            }
            let welcome = "Grbl 1.1h ['$' for help]";
            assert_eq!(seen, [welcome, "", "ok", "error:2", "\u{fffd}\u{fffd}"]);
            assert!(!lines.is_empty());
        }
    }

    #[test]
    fn a_terminal_obeys_nothing_of_a_line() {
        let mut lines = Lines::default();
        lines.push("[MSG:\x1b]52;c;ZWNobwo=\x07\u{9b}2J\x7f\ttext é]\r\n".as_bytes());
        let line = lines.next_line().unwrap();
        assert_eq!(line, "[MSG:␛]52;c;ZWNobwo=␇\u{fffd}2J␡\ttext é]");
    }

    #[test]
    fn a_line_that_has_no_end_is_left_out_and_takes_no_room() {
        for size in [100, 5000, 20_000] {
            let mut lines = Lines::default();
            for piece in vec![b'x'; 20_000].chunks(size) {
                lines.push(piece);
                assert_eq!(lines.next_line(), None);
                assert!(lines.received.len() <= LONGEST);
            }
            assert!(lines.is_too_long());
            lines.push(b"xok\nok\n");
            assert_eq!(lines.next_line().as_deref(), Some("ok"));
            assert!(!lines.is_too_long() && lines.is_empty());
        }
        let mut lines = Lines::default();
        lines.push(&[&[b'x'; 5000][..], b"\nok\n"].concat());
        assert_eq!(lines.next_line().as_deref(), Some("ok"));
    }

    #[test]
    fn every_kind_of_line_of_three_firmwares_is_known() {
        for (text, line) in [
            ("ok", Line::Response(Response::Ok)),
            ("error:20", Line::Response(Response::Error(20))),
            ("error: 20", Line::Response(Response::Error(20))),
            ("ALARM:1", Line::Alarm("1")),
            ("ALARM: Hard limit", Line::Alarm("Hard limit")),
            ("Grbl 1.1h ['$' for help]", Line::Welcome),
            ("GrblHAL 1.1f ['$' or '$HELP' for help]", Line::Welcome),
            (
                "Grbl 3.7 [FluidNC v3.7.13 (wifi) '$' for help]",
                Line::Welcome,
            ),
            (
                "[MSG:Caution: Unlocked]",
                Line::Message("Caution: Unlocked"),
            ),
            (
                "[MSG:INFO: Axis count 4]",
                Line::Message("INFO: Axis count 4"),
            ),
            ("[OPT:V,15,128]", Line::Answer("OPT", "V,15,128")),
            (
                "[PRB:0.000,0.000,0.000:0]",
                Line::Answer("PRB", "0.000,0.000,0.000:0"),
            ),
            ("$110=500.000", Line::Setting(110, "500.000")),
            (
                "$0=20.0        (Sets time length per step.)",
                Line::Setting(0, "20.0"),
            ),
            (
                "$1 = 25    (Step idle delay, milliseconds)",
                Line::Setting(1, "25"),
            ),
            ("$N0=", Line::Other),
            ("[no name]", Line::Other),
            ("[G54:0.000,", Line::Other),
            ("okok", Line::Other),
            ("error:x", Line::Other),
            ("", Line::Other),
        ] {
            assert_eq!(Line::read(text), line, "{text}");
        }
        assert!(matches!(Line::read("<Alarm>"), Line::Report(_)));
    }
}
