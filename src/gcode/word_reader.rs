//! The lexer: a line as words, each of a letter and a number.

use super::LineError;
use crate::decimal::{Decimal, Scanner, SmallDecimal};

/// Reads the words of a line from left to right.
///
/// As an iterator, the reader returns the words of a text without blanks and comments. The other
/// methods read from the bytes of a sender, as far as words are plain.
#[derive(Debug, Clone)]
pub struct WordReader<I>(Scanner<I>);

impl<I: Iterator<Item = u8>> WordReader<I> {
    /// A reader at the beginning of a line.
    #[inline]
    #[must_use]
    pub fn new(line: I) -> Self {
        Self(Scanner::new(line))
    }

    /// Skips blanks and comments between words, and returns whether the end of the line is next.
    #[inline]
    #[must_use]
    pub fn is_at_line_end(&mut self) -> bool {
        loop {
            let next = self.0.peek();
            if next > b';' {
                return false;
            }
            match next {
                b' ' => self.0.advance(),
                b'\n' | b'\r' => return true,
                b'(' | b';' => self.skip_comment(),
                _ => return false,
            }
        }
    }

    /// Skips a comment, of which a semicolon's goes up to the end of the line.
    #[cold]
    #[inline(never)]
    fn skip_comment(&mut self) {
        let end = if self.0.is_at(b'(') { b')' } else { b'\n' };
        while !self.0.is_at_end() && !matches!(self.0.peek(), b'\n' | b'\r') {
            let is_last = self.0.is_at(end);
            self.0.advance();
            if is_last {
                break;
            }
        }
    }

    /// Whether the bytes have come to an end, and that of the line was not among them.
    #[inline]
    #[must_use]
    pub fn is_cut_off(&self) -> bool {
        self.0.is_at_end()
    }

    /// The bytes after the end of the line, when that is next.
    #[inline]
    #[must_use]
    pub fn following(self) -> I {
        self.0.following()
    }

    /// Reads a word; `None` where the number is missing or not small. The letter is in upper case; in
    /// place of a letter there may be any byte.
    #[inline]
    #[must_use]
    pub fn small_word(&mut self) -> Option<(u8, SmallDecimal)> {
        let letter = self.0.peek() & !0x20;
        self.0.advance();
        Some((letter, self.0.small_decimal()?))
    }
}

impl<I: Iterator<Item = u8> + Clone> Iterator for WordReader<I> {
    type Item = Result<(u8, Decimal), LineError>;

    /// Reads a word.
    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_at_end() {
            return None;
        }
        let letter = self.0.peek();
        if !letter.is_ascii_uppercase() {
            return Some(Err(LineError::ExpectedLetter));
        }
        self.0.advance();
        let number = self.0.decimal().ok_or(LineError::BadNumber);
        Some(number.map(|number| (letter, number)))
    }
}
