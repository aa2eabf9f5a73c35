//! Everything that outlives power, but for the tool table: settings, offsets, startup lines and build
//! information.

use heapless::Vec;

use super::{Settings, StepRate, TOOLS};
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

/// A set of changes: the changes that wait to be stored, or the changes whose records are damaged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Changes(u64);

const _: () = assert!(
    FIRST_TOOL + TOOLS <= 64,
    "make Changes larger: it must have a bit for each tool"
);
/// Number of the change of the first tool.
const FIRST_TOOL: usize = 6 + STARTUP_LINES;

impl Changes {
    /// Adds a change.
    pub const fn insert(&mut self, change: Change) {
        self.0 |= Self::bit(change);
    }

    /// Removes a change.
    pub const fn remove(&mut self, change: Change) {
        self.0 &= !Self::bit(change);
    }

    /// Removes a change, which has been stored anew, and the changes that it restores.
    pub const fn mend(&mut self, change: Change) {
        self.remove(change);
        match change {
            Change::RestoreAll => self.0 = 0,
            Change::RestoreOrigins => {
                self.remove(Change::Origins);
                self.0 &= (1 << FIRST_TOOL) - 1;
            }
            Change::RestoreSettings => self.remove(Change::Settings),
            Change::Settings
            | Change::Origins
            | Change::Startup(_)
            | Change::BuildInfo
            | Change::Tool(_) => {}
        }
    }

    /// Clears the startup lines among them: an older one is not executed.
    pub(super) fn clear_lines(self, stored: &mut Stored) {
        for (line, text) in stored.startup.iter_mut().enumerate() {
            if self.contains(Change::Startup(line)) {
                text.clear();
            }
        }
    }

    /// Returns whether a change is among them.
    #[must_use]
    pub const fn contains(self, change: Change) -> bool {
        self.0 & Self::bit(change) != 0
    }

    /// Returns whether there are none.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns how many there are.
    #[must_use]
    pub const fn count(self) -> u32 {
        self.0.count_ones()
    }

    /// Returns how many of them are tools.
    #[must_use]
    pub const fn tools(self) -> u32 {
        (self.0 >> FIRST_TOOL).count_ones()
    }

    /// Returns the change to be stored first: what clears records comes before new ones.
    #[must_use]
    pub const fn first(self) -> Option<Change> {
        /// Number of the first startup line.
        const STARTUP: usize = FIRST_TOOL - STARTUP_LINES;
        if self.is_empty() {
            return None;
        }
        Some(match self.0.trailing_zeros() as usize {
            0 => Change::RestoreAll,
            1 => Change::RestoreOrigins,
            2 => Change::RestoreSettings,
            3 => Change::Settings,
            4 => Change::Origins,
            5 => Change::BuildInfo,
            number if number < FIRST_TOOL => Change::Startup(number - STARTUP),
            number => Change::Tool(number - FIRST_TOOL),
        })
    }

    const fn bit(change: Change) -> u64 {
        let number = match change {
            Change::RestoreAll => 0,
            Change::RestoreOrigins => 1,
            Change::RestoreSettings => 2,
            Change::Settings => 3,
            Change::Origins => 4,
            Change::BuildInfo => 5,
            Change::Startup(line) => FIRST_TOOL - STARTUP_LINES + line,
            Change::Tool(slot) => FIRST_TOOL + slot,
        };
        1 << (number % 64)
    }
}

/// Whether the store may erase a part of the flash now, for which the chip stands still.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Erasing {
    /// The machine is idle, with spindle and laser off.
    Allowed,
    /// Not now: a change that needs it has to wait.
    Postponed,
}

/// The reason for which a change is not stored. The contents of before are still stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoreError {
    /// The flash refused to be read, programmed or erased.
    Flash,
    /// There is no room, or no startup line or slot with that number.
    NoRoom,
    /// The flash must be erased first, and [`Erasing::Postponed`] says not now.
    MustWait,
}
