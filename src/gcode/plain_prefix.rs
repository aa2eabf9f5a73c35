//! The plain words that a line begins with: `G0`, `G1`, axes, `F`, `N`, with small numbers.
//!
//! Plain words are read where the line waits, so blanks, comments and lower case may stand between
//! them. A plain word is no error, whatever words follow. Where a line has another word,
//! [`ParsedLine`](super::ParsedLine) continues there, with the plain words as they have been read.
//!
//! # Cost
//! The bytes are read in two parts, as they lie in a ring: a line across the end of the ring is
//! continued out of line, so that the other lines have one end of bytes to look at.

use super::{MotionMode, Word, WordReader, Words, word_reader::Boundary};
use crate::{
    axis::{AXES, Axes, LETTERS},
    decimal::SmallDecimal,
};

/// Highest line number: Grbl 1.1 `gcode.h`, `MAX_LINE_NUMBER`.
pub(super) const MAX_LINE_NUMBER: u32 = 10_000_000;

/// The reason why a line has not been executed as a plain one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The line has other words, or an error.
    NotPlain,
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
    /// [`Refusal`] for a line with any other word, of which the words before that one are kept.
    #[inline]
    pub fn read<I>(&mut self, [first, second]: [I; 2]) -> Result<usize, Refusal>
    where
        I: ExactSizeIterator<Item = u8> + Clone,
    {
        self.words = Words::NONE;
        match self.read_words(WordReader::new(first)) {
            Ok(following) => Ok(following.len() + second.len()),
            Err((word, Refusal::Incomplete)) if second.len() != 0 => self.continue_in(second, word),
            Err((_, refusal)) => Err(refusal),
        }
    }

    /// Continues with the word in which the first part of the bytes ends.
    #[cold]
    #[inline(never)]
    fn continue_in<I>(&mut self, second: I, word: WordReader<I>) -> Result<usize, Refusal>
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
    /// [`Refusal`] and a reader at the word that is not plain, or that is cut off.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    fn read_words<I>(&mut self, mut reader: WordReader<I>) -> Result<I, (WordReader<I>, Refusal)>
    where
        I: Iterator<Item = u8> + Clone,
    {
        let line = reader.clone();
        let mut boundary = reader.skip_blanks();
        if boundary == Boundary::Other {
            // The bytes may end in a comment.
            let refusal = refusal_at(&reader);
            return Err((line, refusal));
        }
        while boundary != Boundary::LineEnd {
            let word = reader.clone();
            let Some(next) = self.read_word(&mut reader) else {
                let refusal = refusal_at(&reader);
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
fn refusal_at<I: Iterator<Item = u8>>(reader: &WordReader<I>) -> Refusal {
    if reader.is_cut_off() {
        Refusal::Incomplete
    } else {
        Refusal::NotPlain
    }
}
