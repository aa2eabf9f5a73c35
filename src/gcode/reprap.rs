//! Lines in the RepRap dialect: fields, and what their code asks for.
//!
//! What Grbl has, too, is written out in Grbl's words for the interpreter; the rest is an [`HostCommand`]. Read
//! with the G-code pages of the RepRap wiki and with Marlin 2.1.

use super::LineError;
use crate::decimal::Decimal;

/// What a line asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// What has been written in Grbl's words.
    Words,
    /// Something that Grbl has no words for.
    HostCommand(HostCommand),
}

/// What Grbl has no words for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostCommand {
    /// Nothing: the line is answered.
    Nothing,
    /// `M105`: temperatures.
    Temperature,
    /// `M114`: the position of the last line, or of now.
    Position {
        /// `R`.
        is_now: bool,
    },
    /// `M115`: what the firmware is and can.
    Firmware,
    /// `M118`: the text behind the code.
    Echo,
    /// `M20`: the files on a card that is not there.
    Files,
    /// `M400`: standstill.
    Standstill,
    /// `M112`.
    Kill,
    /// `M999`: ends the lock.
    Restart,
    /// A part that this machine does not have, of this M code.
    NotPresent(u16),
    /// `T1` and above.
    InvalidTool(u16),
    /// `M113 S`: the interval of the messages that a line is not done, s.
    BusyInterval(u8),
}

/// A field of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parameter<'a> {
    /// The letter, in upper case.
    pub letter: u8,
    /// The number as it is written, empty without one.
    pub number: &'a [u8],
    /// What is between the quotation marks, with all escapes, if it is a text.
    pub text: Option<&'a [u8]>,
}

/// The fields of a line, from left to right.
#[derive(Debug, Clone)]
pub struct Parameters<'a>(&'a [u8]);

impl<'a> Parameters<'a> {
    /// The fields of a line without number and checksum.
    #[must_use]
    pub const fn new(line: &'a [u8]) -> Self {
        Self(line)
    }

    /// Skips blanks and comments. A comment without an end takes the rest.
    fn skip(&mut self) {
        loop {
            self.0 = self.0.trim_ascii_start();
            match self.0 {
                [b';', ..] => self.0 = &[],
                [b'(', rest @ ..] => {
                    let end = rest.iter().position(|byte| *byte == b')');
                    self.0 = end.map_or(&[], |end| rest.get(end + 1..).unwrap_or_default());
                }
                _ => return,
            }
        }
    }

    fn take(&mut self, n: usize) -> &'a [u8] {
        let (taken, rest) = self.0.split_at_checked(n).unwrap_or((self.0, &[]));
        self.0 = rest;
        taken
    }

    fn take_number(&mut self) -> &'a [u8] {
        let is_part = |byte: &u8| matches!(byte, b'0'..=b'9' | b'.' | b'+' | b'-');
        let n = self.0.iter().take_while(|byte| is_part(byte)).count();
        self.take(n)
    }

    /// Takes a text, of which the quotation mark at the beginning has been taken.
    fn take_text(&mut self) -> Result<&'a [u8], LineError> {
        let mut bytes = self.0.iter().enumerate();
        while let Some((index, byte)) = bytes.next() {
            if *byte != b'"' {
                continue;
            }
            if self.0.get(index + 1) == Some(&b'"') {
                bytes.next();
                continue;
            }
            let text = self.take(index);
            self.take(1);
            return Ok(text);
        }
        Err(LineError::BadNumber)
    }
}

impl<'a> Iterator for Parameters<'a> {
    type Item = Result<Parameter<'a>, LineError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.skip();
        let letter = self.0.first()?.to_ascii_uppercase();
        if !letter.is_ascii_uppercase() {
            self.0 = &[];
            return Some(Err(LineError::ExpectedLetter));
        }
        self.take(1);
        self.skip();
        let mut field = Parameter {
            letter,
            number: &[],
            text: None,
        };
        if self.0.first() == Some(&b'"') {
            self.take(1);
            match self.take_text() {
                Ok(text) => field.text = Some(text),
                Err(error) => {
                    self.0 = &[];
                    return Some(Err(error));
                }
            }
        } else {
            field.number = self.take_number();
            // A list: the first of its numbers counts.
            while self.0.first() == Some(&b':') {
                self.take(1);
                self.take_number();
            }
        }
        Some(Ok(field))
    }
}

impl Parameter<'_> {
    /// The value, `None` for what is no number.
    #[must_use]
    pub fn value(&self) -> Option<Decimal> {
        let (number, rest) = Decimal::parse(self.number)?;
        rest.is_empty().then_some(number)
    }

    /// The number of a code, `None` for what is none.
    fn code(&self) -> Option<u16> {
        let is_whole = !self.number.is_empty() && self.number.iter().all(u8::is_ascii_digit);
        let value = if is_whole { self.value()? } else { return None };
        u16::try_from(value.trunc()).ok()
    }
}

/// Copies a text without its escapes: `""` is a quotation mark, `'` makes the next letter small, `''` is
/// an apostrophe.
pub fn unescaped(text: &[u8]) -> impl Iterator<Item = u8> {
    let mut bytes = text.iter().copied();
    core::iter::from_fn(move || match bytes.next()? {
        b'"' => bytes.next(),
        b'\'' => bytes.next().map(|byte| byte.to_ascii_lowercase()),
        byte => Some(byte),
    })
}

/// Reads a line without number and checksum, and writes what Grbl has words for.
///
/// # Errors
/// 1, 2 for a line that cannot be read; 20 for a code that is not known.
pub fn read(line: &[u8], mut write: impl FnMut(&[u8])) -> Result<Meaning, LineError> {
    let mut code = None;
    let mut tool = None;
    for field in Parameters::new(line) {
        let field = field?;
        match field.letter {
            b'M' if code.is_none() && matches!(field.code(), Some(117 | 118)) => {
                let is_echo = field.code() == Some(118);
                let act = if is_echo {
                    HostCommand::Echo
                } else {
                    HostCommand::Nothing
                };
                return Ok(Meaning::HostCommand(act));
            }
            b'G' | b'M' if code.is_none() => code = Some(field),
            b'T' => tool = Some(field),
            _ => {}
        }
    }
    if let Some(field) = code
        && field.letter == b'M'
    {
        let number = field.code().ok_or(LineError::Unsupported)?;
        if let Some(act) = m_code(number, line)? {
            return Ok(Meaning::HostCommand(act));
        }
    }
    if let (None, Some(tool)) = (code, tool) {
        return Ok(Meaning::HostCommand(match tool.code() {
            Some(0) => HostCommand::Nothing,
            Some(number) => HostCommand::InvalidTool(number),
            None => return Err(LineError::BadNumber),
        }));
    }
    for field in Parameters::new(line) {
        let field = field?;
        write(&[field.letter]);
        write(field.number);
    }
    Ok(Meaning::Words)
}

/// What an M code asks for, `None` where Grbl has words for it.
fn m_code(number: u16, line: &[u8]) -> Result<Option<HostCommand>, LineError> {
    Ok(Some(match number {
        0..=9 | 30 | 48..=53 | 61 => return Ok(None),
        20 => HostCommand::Files,
        21 | 27 | 31 | 108 | 155 | 410 => HostCommand::Nothing,
        80 | 81 | 280 => HostCommand::NotPresent(number),
        104 | 109 | 140 | 190 => match value(line, b'S')? {
            Some(degrees) if !degrees.is_zero() => HostCommand::NotPresent(number),
            Some(_) | None => HostCommand::Nothing,
        },
        105 => HostCommand::Temperature,
        112 => HostCommand::Kill,
        113 => match value(line, b'S')? {
            Some(seconds) => HostCommand::BusyInterval(
                u8::try_from(seconds.trunc()).map_err(|_| LineError::ValueOutOfRange)?,
            ),
            None => HostCommand::Nothing,
        },
        114 => HostCommand::Position {
            is_now: has(line, b'R'),
        },
        115 => HostCommand::Firmware,
        400 => HostCommand::Standstill,
        999 => HostCommand::Restart,
        _ => return Err(LineError::Unsupported),
    }))
}

/// The value of a letter, `None` without it.
fn value(line: &[u8], letter: u8) -> Result<Option<Decimal>, LineError> {
    for field in Parameters::new(line) {
        let field = field?;
        if field.letter == letter {
            return field.value().map(Some).ok_or(LineError::BadNumber);
        }
    }
    Ok(None)
}

/// Whether a line has a letter, with or without a number.
fn has(line: &[u8], letter: u8) -> bool {
    Parameters::new(line).any(|field| field.is_ok_and(|field| field.letter == letter))
}
