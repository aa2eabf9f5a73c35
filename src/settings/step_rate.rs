//! How many steps a second the machine may be asked for.

/// Pulses of all axes together, per second, that the machine may be asked for.
///
/// Not a setting, and never stored: it belongs to the image of the firmware. The build finds the
/// highest rate at which every task is proven to meet its deadline, and writes it there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum StepRate {
    /// So many are proven.
    Proven(u32),
    /// Nothing is proven of this image.
    #[default]
    Unproven,
}

impl StepRate {
    /// What an image keeps to that nothing is proven of, steps per second: as many as Grbl 1.1
    /// makes on a processor of 16 MHz and 8 bits.
    pub const UNPROVEN_HZ: u32 = 30_000;

    /// From the number in an image, in which 0 stands for none.
    #[must_use]
    pub const fn of_image(hz: u32) -> Self {
        match hz {
            0 => Self::Unproven,
            hz => Self::Proven(hz),
        }
    }

    /// The number in an image, in which 0 stands for none.
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
