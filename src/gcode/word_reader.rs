//! The lexer: a line as words, each of a letter and a number, and the plain words that a line begins with:
//! `G0`, `G1`, axes, `F`, `N`, with small numbers.
//!
//! Plain words are read where the line waits, so blanks, comments and lower case may stand between
//! them. A plain word is no error, whatever words follow. Where a line has another word,
//! [`ParsedLine`](super::ParsedLine) continues there, with the plain words as they have been read.
//!
//! # Cost
//! The bytes are read in two parts, as they lie in a ring: a line across the end of the ring is
//! continued out of line, so that the other lines have one end of bytes to look at.

use core::iter::Chain;

use super::{LineError, MotionMode, Word, Words};
use crate::{
    axis::{AXES, Axes, LETTERS},
    decimal::{Decimal, Scanner, SmallDecimal},
};

/// Highest line number: Grbl 1.1 `gcode.h`, `MAX_LINE_NUMBER`.
pub(super) const MAX_LINE_NUMBER: u32 = 10_000_000;

/// Reads the words of a line from left to right.
///
/// As an iterator, the reader returns the words of a text without blanks and comments. The other
/// methods read from the bytes of a sender, as far as words are plain.
#[derive(Debug, Clone)]
pub struct WordReader<I>(Scanner<I>);

/// The kind of the byte after a word and the blanks and comments behind it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Boundary {
    /// A letter, or a byte that is part of a number as little as a letter is.
    Letter,
    /// The end of the line.
    LineEnd,
    /// Any other byte, which may be part of the number before it, or the end of the bytes.
    Other,
}

impl Boundary {
    /// Whether a byte is [`Self::Letter`].
    #[inline]
    const fn is_letter(byte: u8) -> bool {
        byte > b';'
    }
}

impl<I: Iterator<Item = u8>> WordReader<I> {
    /// A reader at the beginning of a line.
    #[inline]
    #[must_use]
    pub fn new(line: I) -> Self {
        Self(Scanner::new(line))
    }

    /// Skips blanks and comments between words. Returns what is next.
    #[inline]
    fn skip_blanks(&mut self) -> Boundary
    where
        I: Clone,
    {
        loop {
            let next = self.0.peek();
            if Boundary::is_letter(next) {
                return Boundary::Letter;
            }
            match next {
                b' ' => self.0.advance(),
                b'\n' | b'\r' => return Boundary::LineEnd,
                b'(' | b';' => match self.clone().after_comment() {
                    Some(after) => *self = after,
                    None => return Boundary::Other,
                },
                _ => return Boundary::Other,
            }
        }
    }

    /// The reader after a comment, of which a semicolon's goes up to the end of the line; `None` for what may be a message
    /// to the operator, `(MSG, text)`, which is no plain part of a line.
    #[cold]
    #[inline(never)]
    fn after_comment(mut self) -> Option<Self> {
        let end = if self.0.is_at(b'(') { b')' } else { b'\n' };
        self.0.advance();
        if end == b')' && matches!(self.0.peek(), b'M' | b'm' | b' ' | b'\t') {
            return None;
        }
        while !self.0.is_at_end() && !matches!(self.0.peek(), b'\n' | b'\r') {
            let is_last = self.0.is_at(end);
            self.0.advance();
            if is_last {
                break;
            }
        }
        Some(self)
    }

    /// Whether the bytes have come to an end, and that of the line was not among them.
    #[inline]
    fn is_cut_off(&self) -> bool {
        self.0.is_at_end()
    }

    /// The bytes after the end of the line, when that is next.
    #[inline]
    fn following(self) -> I {
        self.0.following()
    }

    /// The reader with more bytes after its own.
    fn chain<J: Iterator<Item = u8>>(self, more: J) -> WordReader<Chain<I, J>> {
        WordReader(self.0.chain(more))
    }

    /// Reads a word; `None` where the number is missing or not small. The letter is in upper case; in
    /// place of a letter there may be any byte.
    #[inline]
    fn small_word(&mut self) -> Option<(u8, SmallDecimal)> {
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

/// The reason why a line has not been executed as a plain one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotPlain {
    /// The line has other words, or an error.
    OtherWords,
    /// The bytes end before the line, which may be plain yet.
    Incomplete,
}

/// The plain words that a line begins with, up to the first that is not plain. The default has none.
///
/// A value counts only if its letter is among the words.
#[derive(Debug, Clone, Copy, Default)]
pub struct PlainPrefix {
    /// Letters of the words.
    pub words: Words,
    /// Values of the axis words.
    pub coordinates: Axes<SmallDecimal>,
    /// `G0` or `G1`.
    pub motion: MotionMode,
    /// `F`.
    pub feed: f32,
    /// `N`.
    pub line: u32,
}

impl PlainPrefix {
    /// Reads the words of a line from bytes in two parts. Returns the number of bytes after the line.
    ///
    /// # Errors
    /// [`NotPlain`] for a line with any other word, of which the words before that one are kept.
    #[inline]
    pub fn read<I>(&mut self, [first, second]: [I; 2]) -> Result<usize, NotPlain>
    where
        I: ExactSizeIterator<Item = u8> + Clone,
    {
        self.words = Words::NONE;
        match self.read_words(WordReader::new(first)) {
            Ok(following) => Ok(following.len() + second.len()),
            Err((word, NotPlain::Incomplete)) if second.len() != 0 => {
                self.continue_in(second, word)
            }
            Err((_, refusal)) => Err(refusal),
        }
    }

    /// Continues with the word in which the first part of the bytes ends.
    #[cold]
    #[inline(never)]
    fn continue_in<I>(&mut self, second: I, word: WordReader<I>) -> Result<usize, NotPlain>
    where
        I: ExactSizeIterator<Item = u8> + Clone,
    {
        match self.read_words(word.chain(second)) {
            Ok(following) => Ok(following.size_hint().0),
            Err((_, refusal)) => Err(refusal),
        }
    }

    /// Reads words up to the end of the line. Returns the bytes after the line.
    ///
    /// # Errors
    /// [`NotPlain`] and a reader at the word that is not plain, or that is cut off.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    fn read_words<I>(&mut self, mut reader: WordReader<I>) -> Result<I, (WordReader<I>, NotPlain)>
    where
        I: Iterator<Item = u8> + Clone,
    {
        let line = reader.clone();
        let mut boundary = reader.skip_blanks();
        if boundary == Boundary::Other {
            // The bytes may end in a comment.
            let refusal = not_plain_at(&reader);
            return Err((line, refusal));
        }
        while boundary != Boundary::LineEnd {
            let word = reader.clone();
            let Some(next) = self.read_word(&mut reader) else {
                let refusal = not_plain_at(&reader);
                return Err((word, refusal));
            };
            boundary = next;
        }
        Ok(reader.following())
    }

    /// Reads a word. Returns what follows the word; `None` where it is not plain.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "for each word")]
    fn read_word<I: Iterator<Item = u8> + Clone>(
        &mut self,
        reader: &mut WordReader<I>,
    ) -> Option<Boundary> {
        let (letter, number) = reader.small_word()?;
        match letter {
            b'G' => {
                self.motion = match number.natural()? {
                    0 => MotionMode::Rapid,
                    1 => MotionMode::Linear,
                    _ => return None,
                }
            }
            b'F' => self.feed = number.non_negative()?,
            b'N' => {
                self.line = number.natural().filter(|line| *line <= MAX_LINE_NUMBER)?;
            }
            letter => {
                let mut axes = LETTERS.iter().take(AXES);
                let axis = axes.position(|known| *known == letter)?;
                *self.coordinates.0.get_mut(axis)? = number;
            }
        }
        let word = Word::new(letter);
        let boundary = reader.skip_blanks();
        // A digit after a blank belongs to the number.
        if boundary == Boundary::Other || self.words.contains(word) {
            return None;
        }
        self.words.insert(word);
        Some(boundary)
    }

    /// Returns the part of a line after these words: upper case, without blanks and comments.
    #[must_use]
    pub fn rest_of<'a>(&self, line: &'a [u8]) -> &'a [u8] {
        let n = self.words.len();
        if n == 0 {
            return line;
        }
        let is_letter = |(_, byte): &(usize, &u8)| Boundary::is_letter(**byte);
        let next = line.iter().enumerate().filter(is_letter).nth(n);
        next.and_then(|(start, _)| line.get(start..))
            .unwrap_or_default()
    }
}

/// Returns why the next word is not read.
fn not_plain_at<I: Iterator<Item = u8>>(reader: &WordReader<I>) -> NotPlain {
    if reader.is_cut_off() {
        NotPlain::Incomplete
    } else {
        NotPlain::OtherWords
    }
}
