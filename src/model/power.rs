//! What the spindle or the laser gets.

/// What the spindle or the laser gets.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Power {
    /// Speed, rpm, within `$30` and `$31`, with the override; 0 when off.
    pub rpm: f32,
    /// PWM, 0 to [`Outputs::FULL`](super::Outputs::FULL).
    pub duty: u16,
}

impl Power {
    /// Off.
    pub const OFF: Self = Self { rpm: 0.0, duty: 0 };
}
