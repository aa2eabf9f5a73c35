//! The inputs of the machine: limit switches, probe, buttons and door.
//!
//! Written by the input interrupt alone, after its filter; every other task reads.

use core::{
    ops::{BitAnd, BitOr, BitXor, Not},
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use crate::settings::Settings;

/// One bit for each input, bits 0 to 5 the limit switches of X, Y, Z, A, B and C.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Levels(pub u16);

impl Levels {
    /// Nothing.
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

    /// Whether it has a bit of another.
    #[must_use]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// What is active, of contacts that are closed, under `$5` and `$6`.
    #[must_use]
    pub fn active(self, settings: &Settings) -> Self {
        let mut inverted = Self::NONE;
        if settings.limit_invert {
            // Only axes that exist have a switch.
            inverted = Self((1 << crate::axis::AXES) - 1);
        }
        if settings.probe_invert {
            inverted = inverted | Self::PROBE;
        }
        self ^ inverted
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

/// The inputs as every task may read them. A set bit is a closed contact: the pin is low.
#[derive(Debug, Default)]
pub struct Inputs {
    closed: AtomicU32,
}

impl Inputs {
    /// All contacts open.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            closed: AtomicU32::new(0),
        }
    }

    /// The contacts that are closed.
    #[must_use]
    pub fn closed(&self) -> Levels {
        Levels(self.closed.load(Relaxed) as u16)
    }

    /// Stores the contacts that are closed; for the input interrupt alone.
    pub fn set_closed(&self, closed: Levels) {
        self.closed.store(u32::from(closed.0), Relaxed);
    }
}
