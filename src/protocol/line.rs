//! Bytes to lines: comments and blanks dropped, letters in upper case.
//!
//! Owns the line in the making. Each carriage return and each line feed ends a line, so that a
//! sender gets one answer for each; what is dropped does not count towards its length. Read with
//! Grbl 1.1 `protocol.c`, whose rules these are except for the length.

/// Bytes of the longest line after comments and blanks have been dropped.
pub const LINE_BYTES: usize = 256;

/// A line longer than [`LINE_BYTES`]: all of it is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong;

/// Where in the text the next byte stands.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Place {
    #[default]
    Code,
    /// Between `(` and `)`.
    Parentheses,
    /// After `;`.
    Semicolon,
}

/// What stands for a byte that is dropped, and for one that ends the line or begins a comment.
const DROPPED: u8 = 0;
const OTHER: u8 = 1;

/// What a byte of code becomes.
const CODE: [u8; 256] = {
    let mut code = [DROPPED; 256];
    code[b'\n' as usize] = OTHER;
    code[b'\r' as usize] = OTHER;
    let mut byte = b' ' + 1;
    while byte < u8::MAX {
        code[byte as usize] = match byte {
            b'(' | b';' => OTHER,
            b'/' => DROPPED,
            _ => byte.to_ascii_uppercase(),
        };
        byte += 1;
    }
    code[u8::MAX as usize] = u8::MAX;
    code
};

/// The line in the making.
#[derive(Debug, Clone)]
pub struct Line {
    bytes: [u8; LINE_BYTES],
    /// Bytes of it so far.
    length: usize,
    place: Place,
    is_too_long: bool,
}

impl Line {
    /// An empty line.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bytes: [0; LINE_BYTES],
            length: 0,
            place: Place::Code,
            is_too_long: false,
        }
    }

    /// Whether nothing of the line has been taken that counts.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.length == 0 && self.place == Place::Code && !self.is_too_long
    }

    /// Takes bytes up to the end of the line; false when they come to an end before. [`Line::text`]
    /// then has the line, which must be cleared before the byte after.
    #[must_use]
    pub fn take_from(&mut self, mut bytes: impl Iterator<Item = u8>) -> bool {
        loop {
            let byte = if self.place == Place::Code {
                self.take_code(&mut bytes)
            } else {
                bytes.next()
            };
            let Some(byte) = byte else {
                return false;
            };
            if self.take_rest(byte) {
                return true;
            }
        }
    }

    /// Takes bytes of code up to another, which it tells.
    #[inline]
    fn take_code(&mut self, bytes: &mut impl Iterator<Item = u8>) -> Option<u8> {
        let places = self.bytes.get_mut(self.length..).unwrap_or_default();
        let mut places = places.iter_mut();
        let other = loop {
            let Some(byte) = bytes.next() else {
                break None;
            };
            let code = CODE[usize::from(byte)];
            if code > OTHER {
                match places.next() {
                    Some(place) => *place = code,
                    None => self.is_too_long = true,
                }
            } else if code == OTHER {
                break Some(byte);
            }
        };
        self.length = LINE_BYTES - places.len();
        other
    }

    /// Takes a byte that is neither code nor dropped, or in a comment.
    fn take_rest(&mut self, byte: u8) -> bool {
        match (byte, self.place) {
            (b'\n' | b'\r', _) => return true,
            (b')', Place::Parentheses) => self.place = Place::Code,
            (b'(', Place::Code) => self.place = Place::Parentheses,
            (b';', Place::Code) => self.place = Place::Semicolon,
            (_, Place::Code | Place::Parentheses | Place::Semicolon) => {}
        }
        false
    }

    /// The text of the line so far.
    ///
    /// # Errors
    /// [`TooLong`] when more was taken than a line may have.
    pub fn text(&self) -> Result<&[u8], TooLong> {
        if self.is_too_long {
            Err(TooLong)
        } else {
            Ok(self.bytes.get(..self.length).unwrap_or_default())
        }
    }

    /// Begins a new line.
    pub fn clear(&mut self) {
        self.length = 0;
        self.place = Place::Code;
        self.is_too_long = false;
    }
}

impl Default for Line {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use std::{string::String, vec::Vec};

    use proptest::prelude::*;

    use super::*;

    fn lines(bytes: &[u8]) -> Vec<Result<String, TooLong>> {
        let mut line = Line::new();
        let mut lines = Vec::new();
        let mut rest = bytes.iter().copied();
        while line.take_from(&mut rest) {
            let text = line.text().map(|t| String::from_utf8_lossy(t).into_owned());
            lines.push(text);
            line.clear();
        }
        lines
    }

    fn only(text: &str) -> String {
        let all = lines((String::from(text) + "\n").as_bytes());
        assert_eq!(all.len(), 1, "{text}");
        all[0].clone().unwrap()
    }

    #[test]
    fn carriage_return_and_line_feed_each_end_a_line() {
        let empty = || Ok(String::new());
        assert_eq!(
            lines(b"G0\r\n\n\rG1\n"),
            [
                Ok(String::from("G0")),
                empty(),
                empty(),
                empty(),
                Ok(String::from("G1"))
            ]
        );
    }

    #[test]
    fn comments_blanks_and_block_delete_are_dropped() {
        for (text, expected) in [
            ("\t g0\tx1 \0\x1f", "G0X1"),
            ("G0 X1 (c)", "G0X1"),
            ("G0 (a(b)c) X1", "G0C)X1"),
            ("(open G0 X1", ""),
            ("G0 X1 ; (a", "G0X1"),
            ("; (a) G0", ""),
            ("(a;b) G0", "G0"),
            ("/G0 /X1", "G0X1"),
            (") G0", ")G0"),
            ("$I=unit test 42", "$I=UNITTEST42"),
        ] {
            assert_eq!(only(text), expected, "{text}");
        }
    }

    #[test]
    fn the_length_counts_only_what_is_kept() {
        let longest = "X".repeat(LINE_BYTES);
        let comment = "c".repeat(10_000);
        assert_eq!(only(&std::format!("{longest}({comment})  /")), longest);
        let too_long = std::format!("{longest} Y\nG0\n");
        assert_eq!(
            lines(too_long.as_bytes()),
            [Err(TooLong), Ok(String::from("G0"))]
        );
    }

    proptest! {
        #[test]
        fn there_are_as_many_lines_as_line_ends(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
            let ends = bytes.iter().filter(|b| matches!(b, b'\r' | b'\n')).count();
            prop_assert_eq!(lines(&bytes).len(), ends);
        }

        #[test]
        fn a_line_taken_again_is_unchanged(text in "[ -~]{0,300}") {
            if let Some(Ok(once)) = lines((text + "\n").as_bytes()).first() {
                prop_assume!(!once.contains([')']));
                prop_assert_eq!(&only(once), once);
            }
        }
    }
}
