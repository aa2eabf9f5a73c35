//! The first of the methods in [`super::method`]: the events of an axis straight into the ring.

use super::{
    StepEvent,
    ring::EventBatch,
    slots::Cursor,
    step_times::{AxisSteps, TIME_FRACTION_BITS},
};
use crate::model::timing::PULSE_LOW_TICKS;

/// The only axis that has steps. Times are ticks from the segment's start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direct {
    /// The axis' bit.
    pub(super) axis_mask: u32,
    /// When the pulse ends that the axis brings along, if there is one.
    pub(super) pulse_end_ticks: Option<i32>,
}

impl Direct {
    /// Returns whether every pulse ends before the next step, and nothing delays the first step,
    /// which may come at `earliest_ticks`.
    pub(super) fn is_possible(steps: &AxisSteps, pulse_ticks: u32, earliest_ticks: i32) -> bool {
        steps.has_period(pulse_ticks + PULSE_LOW_TICKS)
            && steps.next_ticks.cast_signed() >= earliest_ticks
    }

    /// Pushes the events of all steps, of which there is one at least. Returns when the last pulse
    /// ends.
    pub(super) fn push(
        self,
        mut steps: AxisSteps,
        pulse_ticks: u32,
        cursor: &mut Cursor,
        events: &mut EventBatch<'_>,
    ) -> i32 {
        let step = StepEvent::new(0, self.axis_mask, 0);
        let time = steps.next_ticks.cast_signed();
        let reserved = events.reserve_first();
        let first = if let Some(pulse_end_ticks) = self.pulse_end_ticks {
            let end = cursor.mark_boundary(StepEvent::new(0, 0, self.axis_mask));
            let end = cursor.schedule(pulse_end_ticks, end);
            events.push_uncommitted(cursor.schedule(time, step));
            end
        } else {
            let begin = cursor.mark_boundary(step);
            cursor.schedule(time, begin)
        };
        steps.advance_periodic();
        let pulse_end = StepEvent::new(pulse_ticks, 0, self.axis_mask);
        if steps.remaining > 1 {
            cursor.last_ticks = push_all_but_last(&mut steps, cursor.last_ticks, pulse_end, events);
        }
        if steps.remaining != 0 {
            // The last step is not later than the segment's end.
            events.push_uncommitted(pulse_end);
            cursor.last_ticks += pulse_ticks.cast_signed();
            let low = cursor.last_ticks + PULSE_LOW_TICKS.cast_signed();
            let time = steps.next_ticks.cast_signed().max(low);
            events.push_uncommitted(cursor.schedule(time, step));
        }
        events.commit_first(reserved, first);
        events.publish();
        cursor.last_ticks + pulse_ticks.cast_signed()
    }
}

/// Pushes all steps but the last one, each behind the end of the pulse before it. Returns the time
/// of the last of them.
fn push_all_but_last(
    steps: &mut AxisSteps,
    last_ticks: i32,
    pulse_end: StepEvent,
    events: &mut EventBatch<'_>,
) -> i32 {
    let axis_mask = pulse_end.drop();
    let pulse_ticks = pulse_end.ticks();
    let (mut time_fixed, period_fixed) = (steps.time_fixed, steps.period_fixed);
    let mut last_ticks = last_ticks.cast_unsigned();
    let mut batch = *events;
    // wcet-bound: segment_steps, wcet-total: segment_steps
    for _ in 1..steps.remaining {
        let time = time_fixed >> TIME_FRACTION_BITS;
        let low_ticks = time.wrapping_sub(last_ticks).wrapping_sub(pulse_ticks);
        batch.push_uncommitted(pulse_end);
        batch.push_uncommitted(StepEvent::new(low_ticks, axis_mask, 0));
        last_ticks = time;
        time_fixed = time_fixed.wrapping_add(period_fixed);
    }
    *events = batch;
    steps.remaining = 1;
    steps.time_fixed = time_fixed;
    steps.next_ticks = time_fixed >> TIME_FRACTION_BITS;
    last_ticks.cast_signed()
}
