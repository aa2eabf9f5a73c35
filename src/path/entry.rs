//! Entries of the queue from `interpret` to `prepare`.
//!
//! # Cost
//! The discriminant of [`Work`] is a whole word, so that the fields after it are copied by words.

use super::Block;
use crate::{
    model::{Alarm, Coolant, OverrideSwitches, Probing, Spindle},
    settings::Settings,
};

/// One entry of the queue from `interpret` to `prepare`.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Resets and cancelled motions before the entry was made, `reset_count` plus
    /// `cancelled_motions` of the snapshot: `prepare` drops an older entry.
    pub cancellation_count: u32,
    /// The work to do.
    pub work: Work,
}

/// Axes with backlash that are about to move, bit 0 = X: their motors come to the side of it from which they move them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TakeUp {
    /// Those that move in the positive direction.
    pub positive: u8,
    /// Those that move in the negative direction.
    pub negative: u8,
    /// The move is a jog, which a feed hold ends.
    pub is_jog: bool,
}

/// The work of an entry.
#[derive(Debug, Clone, Copy)]
#[repr(u32)]
pub enum Work {
    /// A move along a line or an arc.
    Move(Block),
    /// Motors take up backlash, and no axis moves.
    TakeUp(TakeUp),
    /// A dwell, ms.
    Dwell(u32),
    /// A probing move. Finished when the machine is at a standstill again.
    Probe(Block, Probing),
    /// A spindle state and its speed, rpm.
    Spindle(Spindle, f32),
    /// The new speed of a turning spindle, rpm, which the following moves carry as well: it changes with them, or at
    /// rest.
    Speed(f32),
    /// The other direction of a spindle whose tap is in its hole, and its speed, rpm: the tap follows at once.
    ReverseTap(Spindle, f32),
    /// A coolant state.
    Coolant(Coolant),
    /// The overrides that count from here on.
    Overrides(OverrideSwitches),
    /// Drivers on, up to the idle delay, or off up to the next motion.
    Drivers(bool),
    /// Wait for cycle start.
    Pause,
    /// Wait for a tool: as a pause, in which 0xA3 has the operator's lines executed.
    ToolPause,
    /// Leave the alarm state.
    Unlock,
    /// Home these axes together, bit 0 = X; 0 homes all, Z first. Finished when done or failed.
    Home(u8),
    /// Enter check mode; a reset leaves it.
    Check,
    /// Switch everything off until a reset.
    Sleep,
    /// Decelerate, then lock the machine with this alarm: a target is outside the travel.
    Fault(Alarm),
    /// All overrides back to 100 %, and allowed.
    EndOverrides,
    /// New settings. Sent at a standstill only; the machine keeps its whole steps.
    Configure(Settings),
}
