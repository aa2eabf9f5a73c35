//! Bytes to lines: comments and blanks dropped, letters in upper case.
//!
//! Each carriage return and each line feed ends a line, so that a sender gets one answer for each;
//! dropped characters do not count towards the length. Read with Grbl 1.1 `protocol.c`: its rules, except for the
//! length, and for characters other than ASCII. Outside of comments such characters stay in the line, which is refused,
//! but for a non-breaking space and for realtime bytes in UTF-8.

use heapless::Vec;

use super::utf8_requests::{LATIN_1_LEAD, is_utf8_request};

/// Length of the longest line, without comments and blanks, bytes.
pub const LINE_BYTES: usize = 256;

/// Bytes of a comment that are kept, as a message to the operator.
pub(super) const COMMENT_BYTES: usize = 64;

/// The line is longer than [`LINE_BYTES`]: all of it is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong;

/// The part of a line to which the next byte belongs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Region {
    #[default]
    Text,
    /// Between `(` and `)`.
    Parentheses,
    /// After `;`.
    Semicolon,
    /// Behind the first byte of U+0080 to U+00BF, outside of comments.
    Latin,
}

/// Second byte of U+00A0 in UTF-8, a blank.
const NO_BREAK_SPACE: u8 = 0xa0;

/// Marks of a byte that is dropped, and of a byte that ends the line or begins a comment.
const DROPPED: u8 = 0;
const TEXT_END: u8 = 1;

/// The character, or the mark, that replaces each byte outside comments.
const REPLACEMENTS: [u8; 256] = {
    let mut table = [DROPPED; 256];
    table[b'\n' as usize] = TEXT_END;
    table[b'\r' as usize] = TEXT_END;
    let mut byte = b' ' + 1;
    while byte < u8::MAX {
        table[byte as usize] = match byte {
            b'(' | b';' | LATIN_1_LEAD => TEXT_END,
            b'/' => DROPPED,
            _ => byte.to_ascii_uppercase(),
        };
        byte += 1;
    }
    table[u8::MAX as usize] = u8::MAX;
    table
};

/// The line being received.
#[derive(Debug, Clone)]
pub struct Line {
    bytes: [u8; LINE_BYTES],
    /// Bytes so far.
    length: usize,
    region: Region,
    is_too_long: bool,
    /// The last comment in parentheses, or the first that is a message.
    comment: Vec<u8, COMMENT_BYTES>,
    is_comment_kept: bool,
}

impl Line {
    /// An empty line.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bytes: [0; LINE_BYTES],
            length: 0,
            region: Region::Text,
            is_too_long: false,
            comment: Vec::new(),
            is_comment_kept: false,
        }
    }

    /// Returns whether the line has neither a character nor an open comment.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.length == 0 && self.region == Region::Text && !self.is_too_long
    }

    /// Consumes bytes up to the end of the line. Returns false when the bytes end before the line.
    /// After the end, [`Line::text`] is the line, which must be cleared before the next byte.
    #[must_use]
    pub fn take_from(&mut self, mut bytes: impl Iterator<Item = u8>) -> bool {
        loop {
            let byte = if self.region == Region::Text {
                self.push_text(&mut bytes)
            } else {
                bytes.next()
            };
            let Some(byte) = byte else {
                return false;
            };
            if self.ends_with(byte) {
                return true;
            }
        }
    }

    /// Appends bytes outside comments. Returns the delimiter that ends them.
    #[inline]
    fn push_text(&mut self, bytes: &mut impl Iterator<Item = u8>) -> Option<u8> {
        let free = self.bytes.get_mut(self.length..).unwrap_or_default();
        let mut free = free.iter_mut();
        let delimiter = loop {
            let Some(byte) = bytes.next() else {
                break None;
            };
            let replacement = REPLACEMENTS[usize::from(byte)];
            if replacement > TEXT_END {
                match free.next() {
                    Some(end) => *end = replacement,
                    None => self.is_too_long = true,
                }
            } else if replacement == TEXT_END {
                break Some(byte);
            }
        };
        self.length = LINE_BYTES - free.len();
        delimiter
    }

    /// Enters or leaves a comment at a byte. Returns whether the byte ends the line.
    fn ends_with(&mut self, byte: u8) -> bool {
        if self.region == Region::Latin {
            self.region = Region::Text;
            if byte == NO_BREAK_SPACE || is_utf8_request(byte, self.is_empty()) {
                return false;
            }
            // No line has a use for it.
            self.push(&[LATIN_1_LEAD]);
        }
        match (byte, self.region) {
            (LATIN_1_LEAD, Region::Text) => self.region = Region::Latin,
            (b'\n' | b'\r', _) => return true,
            (b')', Region::Parentheses) => {
                self.region = Region::Text;
                self.is_comment_kept |= !self.message().is_empty();
            }
            (b'(', Region::Text) => {
                self.region = Region::Parentheses;
                if !self.is_comment_kept {
                    self.comment.clear();
                }
            }
            (b' '..=b'~', Region::Parentheses) if !self.is_comment_kept => {
                let _ = self.comment.push(byte);
            }
            (0xc0.., Region::Parentheses) if !self.is_comment_kept => {
                let _ = self.comment.push(b'?');
            }
            (b';', Region::Text) => self.region = Region::Semicolon,
            (_, Region::Text | Region::Parentheses | Region::Semicolon | Region::Latin) => {}
        }
        false
    }

    /// Appends what is already in upper case, without blanks and comments.
    pub fn push(&mut self, text: &[u8]) {
        let end = self.length + text.len();
        match self.bytes.get_mut(self.length..end) {
            Some(place) => {
                place.copy_from_slice(text);
                self.length = end;
            }
            None => self.is_too_long = true,
        }
    }

    /// Returns the text of the line so far.
    ///
    /// # Errors
    /// [`TooLong`] when the line is longer than [`LINE_BYTES`].
    pub fn text(&self) -> Result<&[u8], TooLong> {
        if self.is_too_long {
            Err(TooLong)
        } else {
            Ok(self.bytes.get(..self.length).unwrap_or_default())
        }
    }

    /// Returns the text of a comment `(MSG, text)`, or nothing; what is too long is cut.
    #[must_use]
    pub fn message(&self) -> &[u8] {
        self.message_text().unwrap_or_default()
    }

    /// Returns the text of a comment, with or without `MSG,` before it.
    #[must_use]
    pub fn comment_text(&self) -> &[u8] {
        self.message_text().unwrap_or_else(|| self.comment())
    }

    /// Returns what follows `MSG,` in the comment, `None` without that.
    fn message_text(&self) -> Option<&[u8]> {
        match self.comment() {
            [b'M' | b'm', b'S' | b's', b'G' | b'g', b',', text @ ..] => Some(text.trim_ascii()),
            _ => None,
        }
    }

    /// Returns the last comment in parentheses, or the one that is the message.
    #[must_use]
    pub fn comment(&self) -> &[u8] {
        self.comment.trim_ascii()
    }

    /// Forgets the comment.
    pub fn clear_comment(&mut self) {
        self.comment.clear();
    }

    /// Becomes a copy of another line, in place.
    pub fn copy_from(&mut self, other: &Self) {
        self.bytes.copy_from_slice(&other.bytes);
        self.length = other.length;
        self.region = other.region;
        self.is_too_long = other.is_too_long;
        self.comment.clone_from(&other.comment);
        self.is_comment_kept = other.is_comment_kept;
    }

    /// Begins a new line.
    pub fn clear(&mut self) {
        self.comment.clear();
        self.is_comment_kept = false;
        self.length = 0;
        self.region = Region::Text;
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
    use std::string::String;

    use proptest::prelude::*;

    use super::*;

    fn lines(bytes: &[u8]) -> std::vec::Vec<Result<String, TooLong>> {
        let mut line = Line::new();
        let mut lines = std::vec::Vec::new();
        let mut bytes = bytes.iter().copied();
        while line.take_from(&mut bytes) {
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
    fn the_message_of_a_line_is_that_of_its_first_comment_that_has_one() {
        for (text, expected) in [
            ("T2M6(MSG, Insert 6 mm)", "Insert 6 mm"),
            ("( msg,a)T2(b)(MSG,c)", "a"),
            ("(b)T2(MSG,c", "c"),
            ("T2(MSGc)(d)", ""),
            ("T2;(MSG,c)", ""),
        ] {
            let mut line = Line::new();
            assert!(!line.take_from(text.bytes()));
            assert_eq!(String::from_utf8_lossy(line.message()), expected, "{text}");
            line.clear();
            assert!(line.message().is_empty());
        }
        let mut line = Line::new();
        assert!(!line.take_from(std::format!("(MSG,{}", "x".repeat(300)).bytes()));
        assert_eq!(line.message().len(), COMMENT_BYTES - 4);
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
        #![proptest_config(crate::cases(64))]

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
