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
    /// The fraction in hundredths, rounded; 100 where the number is no command number at all.
    pub hundredths: u8,
}

impl CodeNumber {
    /// Hundredths that no command has.
    const NONE: u8 = 100;

    /// A number as the number of a command, in the single precision of Grbl: it decides whether half
    /// a hundredth counts.
    #[must_use]
    pub fn of(number: Decimal) -> Self {
        if !number.has_decimals() {
            let whole = number.trunc();
            let is_code = u8::try_from(whole).is_ok();
            return Self {
                whole: whole as u8,
                hundredths: if is_code { 0 } else { Self::NONE },
            };
        }
        let value = number.to_grbl_f32();
        let whole = value as i32;
        let hundredths = 100.0 * (value - whole as f32);
        let is_code = u8::try_from(whole).is_ok() && hundredths >= 0.0;
        let below = hundredths as u8;
        let rounds_up = hundredths - f32::from(below) >= 0.5;
        Self {
            whole: whole as u8,
            hundredths: if is_code {
                below + u8::from(rounds_up)
            } else {
                Self::NONE
            },
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
    fn codes_wrap_as_in_grbl() {
        for (text, whole, hundredths) in [
            ("38.2", 38, 20),
            ("38.25", 38, 25),
            ("1.999", 1, 100),
            ("0.004", 0, 0),
            ("21.0", 21, 0),
            ("256", 0, 100),
            ("257", 1, 100),
            ("-1", 255, 100),
            ("-0.5", 0, 100),
            ("-0", 0, 0),
            ("3.005", 3, 0),
            ("0.005", 0, 1),
            ("17.005", 17, 1),
            ("1.005", 1, 0),
            ("28.095", 28, 9),
            ("38.195", 38, 19),
            ("43.105", 43, 10),
            ("3.006", 3, 1),
            ("1.99999999", 2, 0),
        ] {
            let (number, _) = Decimal::parse(text.as_bytes()).unwrap();
            let code = CodeNumber::of(number);
            assert_eq!((code.whole, code.hundredths), (whole, hundredths), "{text}");
        }
    }
}
