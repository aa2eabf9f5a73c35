//! The dialect of the sender, `$780`.

use crate::{model::HAS_REPRAP, settings::Settings};

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
    /// Returns whether lines and answers are those of a 3D printer's host. Ask by no comparison: this is also
    /// what keeps the code for them out of firmware without the feature `reprap`.
    #[must_use]
    pub const fn is_reprap(self) -> bool {
        HAS_REPRAP && matches!(self, Self::RepRap)
    }

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
