//! The highest step rate of the firmware.

/// The highest rate of the pulses of all axes together.
///
/// The rate is no setting and is not stored: it belongs to the image of the firmware. The build finds
/// the highest rate at which every task is proven to meet its deadline, and writes it into the image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum StepRate {
    /// The proven rate.
    Proven(u32),
    /// No rate is proven for the image.
    #[default]
    Unproven,
}

impl StepRate {
    /// The rate without a proof, Hz: that of Grbl 1.1 on an AVR at 16 MHz (`stepper.c`).
    pub const UNPROVEN_HZ: u32 = 30_000;

    /// Returns the rate of a number in an image; 0 is no proven rate.
    #[must_use]
    pub const fn of_image(hz: u32) -> Self {
        match hz {
            0 => Self::Unproven,
            hz => Self::Proven(hz),
        }
    }

    /// Returns the steps per second of an axis that motors driven by phases follow after a ramp: of a 28BYJ-48 1000 half
    /// steps (data sheet, idle out-traction frequency).
    pub(super) const fn of_phases_hz(has_half_steps: bool) -> f32 {
        if has_half_steps { 1000.0 } else { 500.0 }
    }

    /// Returns the number in an image; 0 without a proven rate.
    #[must_use]
    pub const fn in_image(self) -> u32 {
        match self {
            Self::Proven(hz) => hz,
            Self::Unproven => 0,
        }
    }

    /// Returns the steps per second.
    #[must_use]
    pub const fn hz(self) -> u32 {
        match self {
            Self::Proven(hz) => hz,
            Self::Unproven => Self::UNPROVEN_HZ,
        }
    }
}
