//! Everything that outlives power, but for the tool table: settings, offsets, startup lines and build
//! information.

use heapless::Vec;

use super::{Settings, StepRate};
use crate::{
    axis::Axes,
    model::PerSystem,
    units::{MicroDegrees, Nm},
};

/// Lines that are executed after power-up, a reset and homing: `$N0` and `$N1`.
pub const STARTUP_LINES: usize = 2;
/// Longest startup line or build information, bytes.
pub const STORED_LINE: usize = 127;

/// A startup line or build information, as the line assembler leaves it.
pub type StoredLine = Vec<u8, STORED_LINE>;

/// Offsets and positions that are stored, in the machine frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Origins {
    /// Origins of the work coordinate systems.
    pub coordinates: PerSystem<Axes<Nm>>,
    /// Rotations of the work coordinate systems about their origins, in the plane of X and Y.
    pub rotations: PerSystem<MicroDegrees>,
    /// The target of `G28`.
    pub g28: Axes<Nm>,
    /// The target of `G30`.
    pub g30: Axes<Nm>,
}

/// Everything that is stored beside the tool table. The default is that of a new machine.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Stored {
    /// All settings.
    pub settings: Settings,
    /// `G54` to `G59.3`, `G28`, `G30`.
    pub origins: Origins,
    /// `$N0`, `$N1`.
    pub startup: [StoredLine; STARTUP_LINES],
    /// `$I=`.
    pub build_info: StoredLine,
}

impl Stored {
    /// Returns what is stored in a new machine.
    #[must_use]
    pub fn new(step_rate: StepRate) -> Self {
        Self {
            settings: Settings::new(step_rate),
            ..Self::default()
        }
    }
}

/// A change of [`Stored`] or of the tool table. After a power cut, all of it is stored or nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// The settings.
    Settings,
    /// The offsets.
    Origins,
    /// The startup line with a number.
    Startup(usize),
    /// The build information.
    BuildInfo,
    /// The tool in a slot of the tool table.
    Tool(usize),
    /// `$RST=$`: default settings.
    RestoreSettings,
    /// `$RST=#`: no offsets and no tools.
    RestoreOrigins,
    /// `$RST=*`: everything as it was when new.
    RestoreAll,
}

impl Change {
    /// Returns whether the tool table is empty after the change.
    #[must_use]
    pub const fn clears_tools(self) -> bool {
        match self {
            Self::RestoreOrigins | Self::RestoreAll => true,
            Self::Settings
            | Self::Origins
            | Self::Startup(_)
            | Self::BuildInfo
            | Self::Tool(_)
            | Self::RestoreSettings => false,
        }
    }
}

/// The reason for which a change is not stored. The contents of before are still stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoreError {
    /// The flash refused to be read, programmed or erased.
    Flash,
    /// There is no room, or no startup line or slot with that number.
    NoRoom,
}
