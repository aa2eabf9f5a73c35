//! What the machine switches beside its axes.

use super::{Coolant, Spindle};

/// The outputs as `prepare` wants them; its shell applies what has changed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Outputs {
    /// Spindle enable and direction. In laser mode it is off whenever the beam is.
    pub spindle: Spindle,
    /// Spindle PWM at rest, 0 to [`Self::FULL`]; in motion it goes with the segments.
    pub duty: u16,
    /// Flood and mist.
    pub coolant: Coolant,
    /// Whether the stepper drivers are switched on.
    pub drivers: bool,
}

impl Outputs {
    /// Duty of a PWM that is always on. Grbl's 255 steps are 4 of ours each.
    pub const FULL: u16 = 1020;
}
