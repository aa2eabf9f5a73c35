//! The dialect of the sender, `$780`.

use crate::settings::Settings;

/// What lines mean, and how they are answered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Dialect {
    /// Grbl 1.1.
    #[default]
    Grbl,
    /// RepRap, as Marlin speaks it: lines with numbers and checksums, and without.
    RepRap,
    /// Grbl 1.1; a line may have a number and a checksum.
    CheckedGrbl,
}

impl Dialect {
    /// Returns the dialect that the settings ask for.
    #[must_use]
    pub const fn of(settings: &Settings) -> Self {
        match settings.dialect {
            1 => Self::RepRap,
            2 => Self::CheckedGrbl,
            _ => Self::Grbl,
        }
    }
}
