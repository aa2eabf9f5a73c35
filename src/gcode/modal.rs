//! The modal state: modes and values that hold for the lines after a line, too.

use core::ops::RangeInclusive;

use crate::model::{
    Coolant, OverrideSwitches, PathControl, Plane, Probing, Rotation, Spindle, WorkCoordinates,
};

/// The feeds that there are, mm/min or degrees/min: from Grbl's slowest to where single precision has every
/// whole number.
pub(super) const FEEDS_MM_MIN: RangeInclusive<f32> = 1.0..=1.0e7;
/// The feeds of [`FeedMode::InverseTime`], 1/min: up to the longest dwell.
pub(super) const INVERSE_TIMES: RangeInclusive<f32> = 60_000.0 / u32::MAX as f32..=1.0e7;

/// The modes and values that stay until they are changed. The default is the power-up state.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Modal {
    /// The motion mode.
    pub motion: MotionMode,
    /// The meaning of an `F` word.
    pub feed_mode: FeedMode,
    /// The unit of coordinates.
    pub units: Units,
    /// The origin of coordinates.
    pub distance: Distance,
    /// The origin of `I`, `J` and `K`.
    pub arc_distance: ArcDistance,
    /// The plane of arcs.
    pub plane: Plane,
    /// Cutter radius compensation.
    pub compensation: CompensationMode,
    /// Whether a tool length is in effect.
    pub tool_length: ToolLength,
    /// The work coordinate system in use.
    pub coordinates: WorkCoordinates,
    /// The path control mode.
    pub path: PathControl,
    /// The level to which a canned cycle retracts.
    pub retract: RetractMode,
    /// The overrides that the program allows.
    pub overrides: OverrideSwitches,
    /// State of the spindle.
    pub spindle: Spindle,
    /// State of the coolant.
    pub coolant: Coolant,
    /// `T`: the tool selected last.
    pub tool: u8,
    /// `F`: mm/min, or 1/min with [`FeedMode::InverseTime`]. 0: not set.
    pub feed: f32,
    /// The unit of `F`: degrees have no inches.
    pub feed_units: Units,
    /// `S`: programmed spindle speed, rpm.
    pub speed_rpm: f32,
}

/// The motion mode, which axis words without a command use.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum MotionMode {
    /// `G0`.
    #[default]
    Rapid,
    /// `G1`.
    Linear,
    /// `G2`, `G3`.
    Arc(Rotation),
    /// `G38.2` to `G38.5`.
    Probe(ProbeMode),
    /// `G73` to `G89`.
    Cycle(Cycle),
    /// `G80`: axis words are an error.
    Cancelled,
}

impl MotionMode {
    /// The command as reports write it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Rapid => "G0",
            Self::Linear => "G1",
            Self::Arc(Rotation::Clockwise) => "G2",
            Self::Arc(Rotation::CounterClockwise) => "G3",
            Self::Probe(ProbeMode::Contact) => "G38.2",
            Self::Probe(ProbeMode::TryContact) => "G38.3",
            Self::Probe(ProbeMode::Release) => "G38.4",
            Self::Probe(ProbeMode::TryRelease) => "G38.5",
            Self::Cycle(cycle) => cycle.word(),
            Self::Cancelled => "G80",
        }
    }
}

/// A canned cycle: what is done at each hole. The discriminant is the number of the code.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Cycle {
    /// Drills in pecks, each followed by a small retract that breaks the chip.
    G73 = 73,
    /// Taps a left-hand thread.
    G74 = 74,
    /// Drills.
    #[default]
    G81 = 81,
    /// Drills, with a dwell at the bottom.
    G82 = 82,
    /// Drills in pecks, each followed by a retract to `R` that clears the hole.
    G83 = 83,
    /// Taps a right-hand thread.
    G84 = 84,
    /// Bores: out at feed.
    G85 = 85,
    /// Bores: out with the spindle stopped.
    G86 = 86,
    /// Bores: the spindle stops and the operator takes over.
    G88 = 88,
    /// Bores, with a dwell at the bottom: out at feed.
    G89 = 89,
}

impl Cycle {
    /// The cycle of a whole G number.
    #[must_use]
    pub const fn of_code(whole: u8) -> Option<Self> {
        Some(match whole {
            73 => Self::G73,
            74 => Self::G74,
            81 => Self::G81,
            82 => Self::G82,
            83 => Self::G83,
            84 => Self::G84,
            85 => Self::G85,
            86 => Self::G86,
            88 => Self::G88,
            89 => Self::G89,
            _ => return None,
        })
    }

    /// The command as reports write it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::G73 => "G73",
            Self::G74 => "G74",
            Self::G81 => "G81",
            Self::G82 => "G82",
            Self::G83 => "G83",
            Self::G84 => "G84",
            Self::G85 => "G85",
            Self::G86 => "G86",
            Self::G88 => "G88",
            Self::G89 => "G89",
        }
    }

    /// Whether it drills in pecks, of `Q`.
    #[must_use]
    pub const fn has_pecks(self) -> bool {
        matches!(self, Self::G73 | Self::G83)
    }

    /// Whether it dwells at the bottom, for `P`.
    #[must_use]
    pub const fn has_dwell(self) -> bool {
        self.needs_dwell() || self.is_tapping() || self.has_pecks()
    }

    /// Whether it lacks a `P` where there is none.
    #[must_use]
    pub const fn needs_dwell(self) -> bool {
        matches!(self, Self::G82 | Self::G86 | Self::G88 | Self::G89)
    }

    /// Whether it cuts a thread.
    #[must_use]
    pub const fn is_tapping(self) -> bool {
        matches!(self, Self::G74 | Self::G84)
    }

    /// Whether it switches a spindle that must be on.
    #[must_use]
    pub const fn needs_spindle(self) -> bool {
        self.is_tapping() || matches!(self, Self::G86 | Self::G88)
    }

    /// Whether the spindle turns as the cycle needs it: a thread is cut by the way in which the tap turns.
    #[must_use]
    pub const fn accepts(self, spindle: Spindle) -> bool {
        match self {
            Self::G84 => matches!(spindle, Spindle::Clockwise),
            Self::G74 => matches!(spindle, Spindle::CounterClockwise),
            Self::G86 | Self::G88 => !matches!(spindle, Spindle::Off),
            Self::G73 | Self::G81 | Self::G82 | Self::G83 | Self::G85 | Self::G89 => true,
        }
    }
}

/// The change of the probe that a probing move waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProbeMode {
    /// `G38.2`: contact, an alarm without.
    Contact,
    /// `G38.3`: contact, if there is any.
    TryContact,
    /// `G38.4`: loss of contact, an alarm without.
    Release,
    /// `G38.5`: loss of contact, if there is any.
    TryRelease,
}

impl ProbeMode {
    /// Returns the contact that ends the move.
    pub(super) const fn probing(self) -> Probing {
        let (is_away, may_miss) = match self {
            Self::Contact => (false, false),
            Self::TryContact => (false, true),
            Self::Release => (true, false),
            Self::TryRelease => (true, true),
        };
        Probing::Probe { is_away, may_miss }
    }
}

/// The meaning of an `F` word.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FeedMode {
    /// `G94`: length units per minute.
    #[default]
    PerMinute,
    /// `G93`: the inverse of the move's time in minutes.
    InverseTime,
}

impl FeedMode {
    /// The command as reports write it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::PerMinute => "G94",
            Self::InverseTime => "G93",
        }
    }
}

/// The unit of coordinates and feeds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Units {
    /// `G21`.
    #[default]
    Millimetres,
    /// `G20`.
    Inches,
}

impl Units {
    /// The command as reports write it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Millimetres => "G21",
            Self::Inches => "G20",
        }
    }
}

/// The origin of coordinates.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Distance {
    /// `G90`: the work coordinate system.
    #[default]
    Absolute,
    /// `G91`: the position before.
    Incremental,
}

impl Distance {
    /// The command as reports write it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Absolute => "G90",
            Self::Incremental => "G91",
        }
    }
}

/// The origin of `I`, `J` and `K`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ArcDistance {
    /// `G91.1`: the start of the arc.
    #[default]
    Incremental,
    /// `G90.1`: the work coordinate system.
    Absolute,
}

/// Cutter radius compensation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum CompensationMode {
    /// `G40`.
    #[default]
    Off,
    /// `G41`: the tool of the tool table on the left.
    Left,
    /// `G41.1`: a cutter of the diameter `D` on the left.
    LeftDynamic,
    /// `G42`: the tool of the tool table on the right.
    Right,
    /// `G42.1`: a cutter of the diameter `D` on the right.
    RightDynamic,
}

impl CompensationMode {
    /// The command as reports write it; `None` where Grbl does not report it.
    #[must_use]
    pub const fn word(self) -> Option<&'static str> {
        match self {
            Self::Off => None,
            Self::Left => Some("G41"),
            Self::LeftDynamic => Some("G41.1"),
            Self::Right => Some("G42"),
            Self::RightDynamic => Some("G42.1"),
        }
    }

    /// Whether `D` is a diameter, not a tool.
    #[must_use]
    pub const fn is_dynamic(self) -> bool {
        matches!(self, Self::LeftDynamic | Self::RightDynamic)
    }
}

/// Whether a tool length is in effect.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ToolLength {
    /// `G49`.
    #[default]
    None,
    /// `G43`: that of a tool in the tool table.
    OfTool,
    /// `G43.1`: given by axis words.
    Dynamic,
    /// `G43.2`: a sum.
    Added,
}

impl ToolLength {
    /// The command as reports write it; `None` where Grbl does not report it.
    #[must_use]
    pub const fn word(self) -> Option<&'static str> {
        match self {
            Self::None | Self::Dynamic => None,
            Self::OfTool => Some("G43"),
            Self::Added => Some("G43.2"),
        }
    }
}

/// The level to which a canned cycle retracts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum RetractMode {
    /// `G98`: where the axis was when the cycle began, or `R` if that is higher.
    #[default]
    InitialLevel,
    /// `G99`: to `R`.
    ReferencePlane,
}

/// The flow of the program after a line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Flow {
    /// The program goes on.
    #[default]
    Run,
    /// `M0`: the program waits for cycle start.
    Pause,
    /// `M1`: as `M0`, while optional stops are switched on.
    OptionalPause,
    /// `M2`, `M30`: the program has ended.
    End,
}
