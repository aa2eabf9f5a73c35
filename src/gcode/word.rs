//! Words by their letters, sets of them, and the numbers of commands.

use crate::{
    axis::{AXES, LETTERS},
    decimal::Decimal,
};

/// A word by its letter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Word(u32);

impl Word {
    /// The axes that there are.
    pub const AXES: Self = {
        let (mut axes, mut axis) = (0, 0);
        while axis < AXES {
            axes |= Self::axis(axis).0;
            axis += 1;
        }
        Self(axes)
    };
    /// Tool or diameter of cutter compensation.
    pub const D: Self = Self::new(b'D');
    /// Feed rate.
    pub const F: Self = Self::new(b'F');
    /// Tool of which the offset is used.
    pub const H: Self = Self::new(b'H');
    /// Offsets of an arc's centre.
    pub const IJK: Self = Self(Self::new(b'I').0 | Self::new(b'J').0 | Self::new(b'K').0);
    /// What `G10` does.
    pub const L: Self = Self::new(b'L');
    /// Line number.
    pub const N: Self = Self::new(b'N');
    /// Dwell time, coordinate system, turns, path tolerance.
    pub const P: Self = Self::new(b'P');
    /// Path tolerance of short lines.
    pub const Q: Self = Self::new(b'Q');
    /// Radius.
    pub const R: Self = Self::new(b'R');
    /// Spindle speed.
    pub const S: Self = Self::new(b'S');
    /// Tool.
    pub const T: Self = Self::new(b'T');

    /// The word of an upper case letter.
    #[must_use]
    pub const fn new(letter: u8) -> Self {
        Self(1 << (letter & 31))
    }

    /// The word of an axis.
    #[must_use]
    pub const fn axis(axis: usize) -> Self {
        Self::new(LETTERS[axis])
    }

    /// The word of an `I`, `J` or `K` by the axis it belongs to.
    #[must_use]
    pub const fn offset_of(axis: usize) -> Self {
        Self(Self::new(b'I').0 << (axis & 3))
    }
}

/// A set of words.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Words(u32);

impl Words {
    /// No word.
    pub const NONE: Self = Self(0);

    /// Whether one of the words is in the set.
    #[must_use]
    pub const fn contains(self, word: Word) -> bool {
        self.0 & word.0 != 0
    }

    /// The number of words.
    #[must_use]
    pub const fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Adds a word.
    pub const fn insert(&mut self, word: Word) {
        self.0 |= word.0;
    }

    /// Takes words out.
    pub const fn remove(&mut self, word: Word) {
        self.0 &= !word.0;
    }

    /// Whether no word is left.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

/// The number of a `G` or `M` command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CodeNumber {
    /// The whole part. Grbl keeps it in eight bits and finds the rest in the fraction.
    pub whole: u8,
    /// The fraction in hundredths; 100 where the number is no command number at all.
    pub hundredths: u8,
}

impl CodeNumber {
    /// Hundredths that no command has.
    const NONE: u8 = 100;

    /// A number as the number of a command: no digit behind hundredths counts for nothing.
    #[must_use]
    pub fn of(number: Decimal) -> Self {
        let whole = number.trunc();
        let hundredths = match (u8::try_from(whole), number.hundredths()) {
            (Ok(whole), Some(all)) => all - 100 * i64::from(whole),
            (_, _) => -1,
        };
        Self {
            whole: whole as u8,
            hundredths: u8::try_from(hundredths).unwrap_or(Self::NONE),
        }
    }

    /// Whether there is no fraction.
    #[must_use]
    pub const fn is_whole(self) -> bool {
        self.hundredths == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_have_hundredths_and_wrap_as_in_grbl() {
        for (text, whole, hundredths) in [
            ("38.2", 38, 20),
            ("38.25", 38, 25),
            ("1.999", 1, 100),
            ("0.004", 0, 100),
            ("21.0", 21, 0),
            ("256", 0, 100),
            ("257", 1, 100),
            ("-1", 255, 100),
            ("-0.5", 0, 100),
            ("-0", 0, 0),
            ("21.000000000", 21, 0),
            ("59.10", 59, 10),
            ("59.100000001", 59, 100),
            ("3.005", 3, 100),
            ("1.99999999", 1, 100),
            ("99999999999999999999", 255, 100),
            ("99999999999.5", 255, 100),
        ] {
            let (number, _) = Decimal::parse(text.as_bytes()).unwrap();
            let code = CodeNumber::of(number);
            assert_eq!((code.whole, code.hundredths), (whole, hundredths), "{text}");
        }
    }
}
