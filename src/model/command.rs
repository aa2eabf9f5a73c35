//! What the interpreter asks for, in program order.

use super::{Coolant, Plane, Rotation, Spindle};

use crate::{axis::Axes, units::Nm};

/// One thing to do. Positions are machine coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// A straight move of all axes from the present position.
    Line {
        /// Where it ends.
        target: Target,
        /// How fast.
        feed_rate: FeedRate,
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
        feed_rate: FeedRate,
        /// `N` word of the line, 0 without.
        line: u32,
    },
    /// A straight move that the probe ends.
    Probe {
        /// Where it ends at the latest.
        target: Target,
        /// How fast.
        feed_rate: FeedRate,
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
pub enum FeedRate {
    /// As fast as the axes allow.
    Rapid,
    /// A speed along the path, mm/min.
    Feed(f32),
    /// The time for the whole move, as its inverse in 1/min (`G93`).
    InverseTime(f32),
    /// A speed along the path, mm/min, of a jog.
    Jog(f32),
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

/// What the laser does during a move, or that there is none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Laser {
    /// Laser mode is off: moves leave the spindle as it is.
    #[default]
    None,
    /// This power, as a spindle speed in rpm.
    Constant(f32),
    /// Power in proportion to the actual speed, this at the programmed speed.
    Proportional(f32),
}

/// What ends a probing move.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Probing {
    /// The probe opens (`G38.4`, `G38.5`), instead of closing.
    pub is_away: bool,
    /// It is no error when it does not (`G38.3`, `G38.5`).
    pub may_miss: bool,
}
