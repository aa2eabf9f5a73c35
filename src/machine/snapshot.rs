//! The state of the machine as every task may read it.
//!
//! # Cost
//! `prepare` waits while [`Snapshot::copy_from`] copies, field by field.

use super::Inputs;
use crate::{
    axis::Axes,
    model::{Coolant, Levels, Notices, Overrides, Probed, Spindle, State, ToolChangeSpan},
    stepper::SegmentRing,
};

/// The state of the machine. `prepare` publishes it, other tasks copy it under RTIC's lock.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Snapshot {
    /// The state.
    pub state: State,
    /// Step count of each axis at the start of the segment being played; at rest, where the axis is.
    pub steps: Axes<i32>,
    /// Speed along the path, mm/min.
    pub feed_mm_min: f32,
    /// Commanded spindle speed with its override, rpm; 0 when the spindle is off.
    pub spindle_rpm: f32,
    /// State of the spindle outputs.
    pub spindle: Spindle,
    /// State of the coolant outputs.
    pub coolant: Coolant,
    /// The programmed coolant, with realtime toggles since.
    pub programmed_coolant: Coolant,
    /// Number of realtime toggles of the coolant, wrapping.
    pub coolant_toggles: u8,
    /// Number of changes of spindle, coolant and overrides that a status report shows, wrapping.
    pub accessory_changes: u8,
    /// The overrides in effect.
    pub overrides: Overrides,
    /// Active inputs.
    pub inputs: Levels,
    /// The last probing move.
    pub probed: Probed,
    /// Where the operator's lines begin and end, in the last change of a tool.
    pub tool_marks: ToolChangeSpan,
    /// Notices to the sender.
    pub notices: Notices,
    /// `N` word of the block in execution, 0 without one.
    pub line: u32,
    /// Number of blocks for which the look-ahead has room.
    pub blocks_free: u16,
    /// Number of entries finished, wrapping: all are when it equals the number of entries sent.
    pub finished: u32,
    /// Whether the machine stands still with nothing left to execute: a hold with moves left is a standstill, but no
    /// rest.
    pub is_at_rest: bool,
    /// Number of resets handled so far, wrapping.
    pub reset_count: u32,
    /// Number of motions that ended before their target otherwise than by a reset, as a cancelled
    /// jog, wrapping. After one, the interpreter adopts the position at rest, and entries sent
    /// before are void: [`crate::path::Entry::cancellation_count`].
    pub cancelled_motions: u32,
    /// Whether the last reset found the machine in motion, which is `ALARM:3`.
    pub reset_in_motion: bool,
    /// Whether the step events ran out in motion: a fault that only a reset ends.
    pub has_underrun: bool,
    /// Whether an alarm has come that only a reset ends: a hard or soft limit.
    pub is_critical: bool,
    /// Whether the self-test at power-up has failed: nothing moves, and nothing unlocks the machine.
    pub failed_self_test: bool,
}

impl Snapshot {
    /// Copies what `prepare` publishes, and reads the position and the inputs, which it does not
    /// publish. Under the lock of the published snapshot: no motion begins meanwhile that its fields
    /// do not show yet.
    #[inline]
    pub fn copy_from(&mut self, published: &Self, segments: &SegmentRing, inputs: &Inputs) {
        let (steps, feed_mm_min, line) = segments.status();
        *self = Self {
            steps,
            feed_mm_min,
            line,
            inputs: inputs.active(),
            ..*published
        };
    }
}
