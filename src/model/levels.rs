//! One bit for each input of the machine.

use core::ops::{BitAnd, BitOr, BitXor, Not};

use super::HAS_SECOND_MOTORS;

/// One bit for each input, bits 0 to 5 the limit switches of X, Y, Z, A, B and C.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Levels(pub u16);

/// Number of the bit of the second switch of X.
const SECOND_SHIFT: u32 = 11;

impl Levels {
    /// No input.
    pub const NONE: Self = Self(0);
    /// All limit switches.
    pub const LIMITS: Self = Self(0x3f);
    /// The probe.
    pub const PROBE: Self = Self(1 << 6);
    /// The safety door.
    pub const DOOR: Self = Self(1 << 7);
    /// The feed hold button.
    pub const HOLD: Self = Self(1 << 8);
    /// The reset button.
    pub const RESET: Self = Self(1 << 9);
    /// The cycle start button.
    pub const START: Self = Self(1 << 10);

    /// The limit switches of second motors: of X, Y and Z.
    pub const SECOND_LIMITS: Self = Self(0x7 << SECOND_SHIFT);

    /// The inputs that request something when they close: door, hold, reset and start.
    pub const BUTTONS: Self = Self(0xf << 7);

    /// Returns whether any input is in both sets.
    #[must_use]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Returns the limit switches of some axes, bit 0 = X.
    #[must_use]
    pub const fn limits(axes: u8) -> Self {
        Self(axes as u16 & Self::LIMITS.0)
    }

    /// Returns the limit switches of the second motors of some axes, bit 0 = X.
    #[must_use]
    pub const fn second_limits(axes: u8) -> Self {
        Self((axes as u16) << SECOND_SHIFT & Self::SECOND_LIMITS.0)
    }

    /// Returns the axes of which the switch of the second motor is among these, bit 0 = X.
    #[must_use]
    pub const fn second_axes(self) -> u8 {
        ((self.0 & Self::SECOND_LIMITS.0) >> SECOND_SHIFT) as u8
    }

    /// Returns the inputs where the switch of a second motor counts as that of its axis, too.
    #[must_use]
    #[inline]
    pub const fn with_second_as_first(self) -> Self {
        if HAS_SECOND_MOTORS {
            Self(self.0 | self.second_axes() as u16)
        } else {
            self
        }
    }

    /// Returns the inputs with the switches of the second motors of axes whose first switch is among them.
    #[must_use]
    #[inline]
    pub const fn with_second(self) -> Self {
        if HAS_SECOND_MOTORS {
            Self(self.0 | Self::second_limits(self.0 as u8).0)
        } else {
            self
        }
    }
}

impl BitOr for Levels {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitAnd for Levels {
    type Output = Self;

    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitXor for Levels {
    type Output = Self;

    fn bitxor(self, other: Self) -> Self {
        Self(self.0 ^ other.0)
    }
}

impl Not for Levels {
    type Output = Self;

    fn not(self) -> Self {
        Self(!self.0)
    }
}
