//! Axes with two motors, as a gantry has them: which of the motors stand while their axis moves.

use crate::axis::{AXES, LINEAR};

/// Whether an axis may have a second motor: firmware for a board with one, and the simulator.
pub const HAS_SECOND_MOTORS: bool = cfg!(any(feature = "second-motors", not(target_os = "none")));

/// Number of axes that may have a second motor: X, Y and Z, or none.
pub const GANGED_AXES: usize = if HAS_SECOND_MOTORS { LINEAR } else { 0 };

/// Number of limit switches: one for each axis, and behind them those of second motors.
pub const LIMIT_SWITCHES: usize = AXES + GANGED_AXES;

/// Motors that stand while their axis moves: a bit for each axis, bit 0 = X.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct StandingMotors {
    /// Of the first motors.
    pub first: u8,
    /// Of the second motors.
    pub second: u8,
}

impl StandingMotors {
    /// Every motor moves with its axis.
    pub const NONE: Self = Self {
        first: 0,
        second: 0,
    };

    /// Returns the motors in one word.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.first as u32 | (self.second as u32) << 8
    }

    /// Returns the motors of a word.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self {
            first: bits as u8,
            second: (bits >> 8) as u8,
        }
    }
}
