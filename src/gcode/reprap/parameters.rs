//! The fields of a line: letters with numbers, texts and lists.

use crate::{
    axis::{LETTERS, LINEAR},
    decimal::Decimal,
    gcode::LineError,
};

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
                [b'(', tail @ ..] => {
                    let end = tail.iter().position(|byte| *byte == b')');
                    self.0 = end.map_or(&[], |end| tail.get(end + 1..).unwrap_or_default());
                }
                _ => return,
            }
        }
    }

    fn take(&mut self, n: usize) -> &'a [u8] {
        let (taken, tail) = self.0.split_at_checked(n).unwrap_or((self.0, &[]));
        self.0 = tail;
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
        let (number, tail) = Decimal::parse(self.number)?;
        tail.is_empty().then_some(number)
    }

    /// The number of a code, `None` for what is none.
    pub(super) fn code(&self) -> Option<u16> {
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

/// The axes among X, Y and Z that a line has, bit 0 = X.
pub(super) fn axes(line: &[u8]) -> u8 {
    let mut axes = 0;
    for (axis, letter) in LETTERS.iter().enumerate().take(LINEAR) {
        axes |= u8::from(has(line, *letter)) << axis;
    }
    axes
}

/// The value of a letter, `None` without it.
///
/// # Errors
/// 1, 2 for a line that cannot be read.
pub fn value(line: &[u8], letter: u8) -> Result<Option<Decimal>, LineError> {
    for parameter in Parameters::new(line) {
        let parameter = parameter?;
        if parameter.letter == letter {
            return parameter.value().map(Some).ok_or(LineError::BadNumber);
        }
    }
    Ok(None)
}

/// Whether a line has more than its code.
pub(super) fn has_words(line: &[u8]) -> bool {
    Parameters::new(line).count() > 1
}

/// Whether a line has a letter, with or without a number.
pub(super) fn has(line: &[u8], letter: u8) -> bool {
    Parameters::new(line)
        .any(|parameter| parameter.is_ok_and(|parameter| parameter.letter == letter))
}
