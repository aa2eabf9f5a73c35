//! One bit for each input of the machine.

use core::ops::{BitAnd, BitOr, BitXor, Not};

/// One bit for each input, bits 0 to 5 the limit switches of X, Y, Z, A, B and C.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Levels(pub u16);

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
