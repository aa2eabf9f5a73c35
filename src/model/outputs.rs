//! The outputs beside those of the axes.

use super::{Coolant, Spindle};

/// The outputs as `prepare` sets them; its platform switches those that have changed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Outputs {
    /// Spindle enable and direction; in laser mode off whenever the beam is.
    pub spindle: Spindle,
    /// Spindle PWM at rest, 0 to [`Self::FULL`]; in motion it goes with the segments.
    pub duty: u16,
    /// Flood and mist.
    pub coolant: Coolant,
    /// Whether the stepper drivers are switched on.
    pub drivers: bool,
}

impl Outputs {
    /// Duty of a PWM that is always high: 255 steps of Grbl, each divided by four.
    pub const FULL: u16 = 1020;
}
