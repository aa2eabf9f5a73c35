//! Speed and duty of the spindle, or power of the laser.

/// Speed and duty of the spindle, or power of the laser.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Power {
    /// Speed with the override, between `$31` and `$30`, rpm; 0 when off.
    pub rpm: f32,
    /// Duty of the PWM, 0 to [`Outputs::FULL`](super::Outputs::FULL).
    pub duty: u16,
}

impl Power {
    /// Off.
    pub const OFF: Self = Self { rpm: 0.0, duty: 0 };
}
