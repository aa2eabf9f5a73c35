//! The state of the machine as every task may read it.

use crate::axis::Axes;

/// What the machine does, with Grbl's names.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum State {
    /// Nothing to do, everything at rest.
    #[default]
    Idle,
    /// Executing blocks.
    Run,
    /// Feed hold: still slowing down (`Hold:1`).
    HoldSlowing,
    /// Feed hold: at rest (`Hold:0`).
    HoldComplete,
    /// Locked until unlocked or homed; the machine may still be slowing down.
    Alarm,
}

impl State {
    /// Grbl's name, as reports have it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "Idle",
            Self::Run => "Run",
            Self::HoldSlowing => "Hold:1",
            Self::HoldComplete => "Hold:0",
            Self::Alarm => "Alarm",
        }
    }
}

/// What `prepare` last published: read by copy, under RTIC's lock.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Snapshot {
    /// The state.
    pub state: State,
    /// Step count of each axis, as output so far.
    pub steps: Axes<i32>,
    /// Speed along the path now, mm/min.
    pub feed_mm_min: f32,
    /// Spindle speed as commanded, rpm; 0 when it is off.
    pub spindle_rpm: f32,
    /// `N` word of the block in execution, 0 without.
    pub line: u32,
    /// Free places for blocks.
    pub blocks_free: u16,
    /// Entries taken from the queue and finished, wrapping. Equal to the number sent: all is done.
    pub finished: u32,
    /// No axis moves and no event is queued.
    pub is_at_rest: bool,
    /// The newest reset that has been acted on.
    pub epoch: u32,
    /// Whether that reset found the machine in motion, so that it rises `ALARM:3`.
    pub reset_in_motion: bool,
    /// Whether the step events ran out in motion: a fault that only a reset ends.
    pub is_starved: bool,
}
