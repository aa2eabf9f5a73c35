//! The step rate that the machine may be asked for.

/// Pulses of all axes together, per second, that the machine may be asked for.
///
/// Not a setting, and never stored: the rate belongs to the image of the firmware. The build finds
/// the highest rate at which every task is proven to meet its deadline, and writes it there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum StepRate {
    /// The proven rate.
    Proven(u32),
    /// No rate is proven of this image.
    #[default]
    Unproven,
}

impl StepRate {
    /// The rate of an image of which nothing is proven, steps per second: that of Grbl 1.1 on a
    /// processor of 16 MHz and 8 bits.
    pub const UNPROVEN_HZ: u32 = 30_000;

    /// Returns the rate that a number in an image stands for; 0 stands for none.
    #[must_use]
    pub const fn of_image(hz: u32) -> Self {
        match hz {
            0 => Self::Unproven,
            hz => Self::Proven(hz),
        }
    }

    /// Returns the number in an image; 0 stands for none.
    #[must_use]
    pub const fn in_image(self) -> u32 {
        match self {
            Self::Proven(hz) => hz,
            Self::Unproven => 0,
        }
    }

    /// Steps per second.
    #[must_use]
    pub const fn hz(self) -> u32 {
        match self {
            Self::Proven(hz) => hz,
            Self::Unproven => Self::UNPROVEN_HZ,
        }
    }
}
