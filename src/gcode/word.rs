//! Words by their letters, and sets of them.

use crate::axis::{AXES, LETTERS};

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
    /// Feed rate.
    pub const F: Self = Self::new(b'F');
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
