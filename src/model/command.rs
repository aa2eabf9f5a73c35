//! Commands of the interpreter to the machine, in program order.

use super::{Coolant, OverrideSwitches, Plane, Rotation, Spindle};

use crate::{
    axis::Axes,
    units::{MicroDegrees, Nm},
};

/// A command. Positions are machine coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// A straight move of all axes from the present position.
    Line {
        /// End of the move.
        target: Target,
        /// Feed rate.
        feed_rate: FeedRate,
        /// `N` word of the line, 0 without one.
        line: u32,
    },
    /// An arc or a helix from the present position: one command however long it is.
    Arc {
        /// End of the move.
        target: Target,
        /// Circle of the arc.
        circle: Circle,
        /// Feed rate along the path.
        feed_rate: FeedRate,
        /// `N` word of the line, 0 without one.
        line: u32,
    },
    /// A straight move that the probe ends.
    Probe {
        /// End of the move without a contact.
        target: Target,
        /// Feed rate.
        feed_rate: FeedRate,
        /// Contact that ends the move.
        probing: Probing,
        /// `N` word of the line, 0 without one.
        line: u32,
    },
    /// A new state of the laser for the moves that follow.
    Power(Laser),
    /// A dwell.
    Dwell {
        /// Time, ms.
        milliseconds: u32,
    },
    /// A new state of the spindle.
    Spindle {
        /// Direction or off.
        spindle: Spindle,
        /// Programmed speed, rpm.
        rpm: f32,
    },
    /// A new speed of a turning spindle, rpm: it changes where the following moves begin, without a stop.
    Speed(f32),
    /// The other direction of a spindle whose tap is at the bottom of its hole: it feeds out at once.
    ReverseTap {
        /// Direction.
        spindle: Spindle,
        /// Programmed speed, rpm.
        rpm: f32,
    },
    /// A new state of the coolant.
    Coolant(Coolant),
    /// The overrides that count from here on.
    Overrides(OverrideSwitches),
    /// Program pause, `M0`: waits for cycle start.
    Pause,
    /// Waits for a tool, `M6`.
    ToolPause,
}

impl Command {
    /// Returns the end of the move; `None` for a command that does not move.
    #[must_use]
    pub const fn moved_to(&self) -> Option<&Target> {
        match self {
            Self::Line { target, .. } | Self::Arc { target, .. } | Self::Probe { target, .. } => {
                Some(target)
            }
            Self::Power(_)
            | Self::Dwell { .. }
            | Self::Spindle { .. }
            | Self::Speed(_)
            | Self::ReverseTap { .. }
            | Self::Coolant(_)
            | Self::Overrides(_)
            | Self::Pause
            | Self::ToolPause => None,
        }
    }
}

/// The end of a move.
#[derive(Debug, Clone, Copy, Default)]
pub struct Target {
    /// Exact machine coordinates.
    pub position: Axes<Nm>,
    /// The coordinates in Grbl's single-precision arithmetic, mm. Only the choice between two
    /// equally near steps depends on them.
    pub single_mm: Axes<f32>,
}

/// Compares the exact positions.
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

/// The programmed feed rate of a move.
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
    /// The angle by which the plane is turned about Z: none in the plane of X and Y.
    pub tilt: MicroDegrees,
}

/// The state of the laser, or the speed of the spindle, during a move.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Laser {
    /// Laser mode is off: moves leave the spindle as it is.
    #[default]
    None,
    /// This power, as a spindle speed in rpm (`M3`), or the new speed of a spindle that was turning already.
    Constant(f32),
    /// Power in proportion to the actual speed, this value at the programmed speed (`M4`).
    Proportional(f32),
}

/// The contact that ends a probing move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Probing {
    /// The probe changes.
    Probe {
        /// It opens (`G38.4`, `G38.5`) instead of closing.
        is_away: bool,
        /// A missing contact is no error (`G38.3`, `G38.5`).
        may_miss: bool,
    },
    /// The limit switch of an axis that moves is closed. A missing contact is no error.
    LimitSwitch,
}
