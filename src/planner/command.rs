//! What the interpreter asks for, in program order.

use super::{Laser, Probing};
use crate::{axis::Axes, units::Nm};

/// One thing to do. Positions are machine coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// A straight move of all axes from the present position.
    Line {
        /// Where it ends.
        target: Target,
        /// How fast.
        pace: Pace,
        /// `N` word of the line, 0 without.
        line: u32,
    },
    /// An arc or a helix from the present position: one command however long it is.
    Arc {
        /// Where it ends.
        target: Target,
        /// Its circle.
        circle: Circle,
        /// How fast along the path.
        pace: Pace,
        /// `N` word of the line, 0 without.
        line: u32,
    },
    /// A straight move that the probe ends.
    Probe {
        /// Where it ends at the latest.
        target: Target,
        /// How fast.
        pace: Pace,
        /// What ends it.
        probing: Probing,
        /// `N` word of the line, 0 without.
        line: u32,
    },
    /// What the laser does during the moves that follow.
    Power(Laser),
    /// Standstill for a time.
    Dwell {
        /// Its length, ms.
        milliseconds: u32,
    },
    /// A new state of the spindle.
    Spindle {
        /// Direction or off.
        spindle: Spindle,
        /// Programmed speed, rpm.
        rpm: f32,
    },
    /// A new state of the coolant.
    Coolant(Coolant),
    /// Program pause, `M0`: waits for cycle start.
    Pause,
}

/// Where a move ends.
#[derive(Debug, Clone, Copy, Default)]
pub struct Target {
    /// Exact machine coordinates.
    pub position: Axes<Nm>,
    /// The same as Grbl's single-precision arithmetic has them, mm. Nothing but the choice between
    /// two steps that are equally near depends on them.
    pub single_mm: Axes<f32>,
}

/// The exact positions decide.
impl PartialEq for Target {
    fn eq(&self, other: &Self) -> bool {
        self.position == other.position
    }
}

impl From<Axes<Nm>> for Target {
    fn from(position: Axes<Nm>) -> Self {
        Self {
            position,
            single_mm: position.map(Nm::to_mm),
        }
    }
}

/// How fast a move is asked to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// As fast as the axes allow.
    Rapid,
    /// A speed along the path, mm/min.
    Feed(f32),
    /// The time for the whole move, as its inverse in 1/min (`G93`).
    InverseTime(f32),
    /// A speed along the path, mm/min, of a jog.
    Jog(f32),
}

/// How moves follow each other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum PathControl {
    /// `G61`: along the programmed path, as fast as the corners allow.
    #[default]
    ExactPath,
    /// `G61.1`: to a standstill at the end of each move.
    ExactStop,
    /// `G64`: near the programmed path, without losing more speed than needed.
    Continuous {
        /// Farthest from the programmed path, nm (`P`); 0 for as far as half of each line.
        tolerance_nm: u32,
        /// Farthest from short lines that become one, nm (`Q`); 0 when none do.
        merging_nm: u32,
    },
}

impl PathControl {
    /// The command as reports write it; `None` in the power-up mode, which Grbl does not report.
    #[must_use]
    pub const fn word(self) -> Option<&'static str> {
        match self {
            Self::ExactPath => None,
            Self::ExactStop => Some("G61.1"),
            Self::Continuous { .. } => Some("G64"),
        }
    }
}

/// The circle that an arc follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Circle {
    /// Its plane.
    pub plane: Plane,
    /// Centre minus start, along the plane's first and second axis.
    pub centre: [Nm; 2],
    /// Sense of rotation, seen against the plane's normal.
    pub rotation: Rotation,
    /// Turns begun: 1 for up to one full turn, more with a `P` word.
    pub turns: u16,
}

/// Sense of rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rotation {
    /// `G2`.
    Clockwise,
    /// `G3`.
    CounterClockwise,
}

/// The plane of arcs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Plane {
    /// `G17`.
    #[default]
    Xy,
    /// `G18`.
    Zx,
    /// `G19`.
    Yz,
}

impl Plane {
    /// First axis, second axis, and the axis along the normal.
    #[must_use]
    pub const fn axes(self) -> (usize, usize, usize) {
        use crate::axis::{X, Y, Z};
        match self {
            Self::Xy => (X, Y, Z),
            Self::Zx => (Z, X, Y),
            Self::Yz => (Y, Z, X),
        }
    }
}

/// What the spindle does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Spindle {
    /// `M5`.
    #[default]
    Off,
    /// `M3`.
    Clockwise,
    /// `M4`.
    CounterClockwise,
}

/// What the coolant does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Coolant {
    /// `M8`.
    pub flood: bool,
    /// `M7`.
    pub mist: bool,
}

impl Coolant {
    /// `M9`.
    pub const OFF: Self = Self {
        flood: false,
        mist: false,
    };
}
