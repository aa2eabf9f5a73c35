//! The state of the machine as every task may read it.
//!
//! # Cost
//! [`Snapshot::copy_from`] copies field by field: each is too small for the library's loop over
//! memory, whose time is not known.

use super::Inputs;
use crate::{
    axis::Axes,
    model::{Coolant, Levels, Notices, Overrides, Probed, Spindle, State},
    stepper::SegmentRing,
};

/// The machine as `prepare` last published it, and its position. Read by copy, under RTIC's lock.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Snapshot {
    /// The state.
    pub state: State,
    /// Step count of each axis, as output so far.
    pub steps: Axes<i32>,
    /// Speed along the path now, mm/min.
    pub feed_mm_min: f32,
    /// Spindle speed as commanded, rpm, with its override; 0 when it is off.
    pub spindle_rpm: f32,
    /// Spindle direction as it is switched now.
    pub spindle: Spindle,
    /// Coolant as it is switched now.
    pub coolant: Coolant,
    /// Coolant as programmed, or toggled since.
    pub coolant_asked: Coolant,
    /// Counts realtime toggles of the coolant, wrapping.
    pub coolant_toggles: u8,
    /// Counts what the next status report has to show of spindle, coolant and overrides, wrapping.
    pub accessory_changes: u8,
    /// The overrides in effect.
    pub overrides: Overrides,
    /// Inputs that are active.
    pub inputs: Levels,
    /// The last probing move.
    pub probed: Probed,
    /// Notices to the sender.
    pub notices: Notices,
    /// `N` word of the block in execution, 0 without.
    pub line: u32,
    /// Free places for blocks.
    pub blocks_free: u16,
    /// Entries taken from the queue and finished, wrapping. Equal to the number sent: all is done.
    pub finished: u32,
    /// No axis moves and no event is queued.
    pub is_at_rest: bool,
    /// The newest reset that has been acted on.
    pub reset_count: u32,
    /// Counts motions that were ended before their target otherwise than by a reset, as a cancelled
    /// jog is, wrapping. The interpreter takes over the position anew, at rest; an entry that was
    /// made before is void: [`crate::path::Entry::reset_count`].
    pub cancelled_motions: u32,
    /// Whether that reset found the machine in motion, so that it rises `ALARM:3`.
    pub reset_in_motion: bool,
    /// Whether the step events ran out in motion: a fault that only a reset ends.
    pub has_underrun: bool,
    /// Whether an alarm has come that only a reset ends: a hard or soft limit.
    pub is_critical: bool,
}

impl Snapshot {
    /// Copies the fields that `prepare` publishes, and reads the position and the inputs, which it
    /// does not publish. Under the lock of the published snapshot: no motion begins meanwhile that
    /// its fields do not show yet.
    #[inline]
    pub fn copy_from(&mut self, published: &Self, segments: &SegmentRing, inputs: &Inputs) {
        (self.steps, self.feed_mm_min, self.line) = segments.status();
        self.inputs = inputs.active();
        macro_rules! copy {
            ($($field:ident),* $(,)?) => {
                let Self { steps: _, feed_mm_min: _, inputs: _, line: _, $($field),* } = published;
                $(self.$field = *$field;)*
            };
        }
        copy!(
            state,
            spindle_rpm,
            spindle,
            coolant,
            coolant_asked,
            coolant_toggles,
            accessory_changes,
            overrides,
            probed,
            notices,
            blocks_free,
            finished,
            is_at_rest,
            reset_count,
            cancelled_motions,
            reset_in_motion,
            has_underrun,
            is_critical,
        );
    }
}
