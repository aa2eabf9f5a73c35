//! The events of an axis that moves alone at an even pace: every pulse ends before the next begins, so
//! they are in order as they come.

use super::{
    StepEvent,
    ring::EventBatch,
    slots::Cursor,
    step_times::{AxisSteps, TIME_FRACTION_BITS},
};
use crate::model::timing::PULSE_LOW_TICKS;

/// [`PULSE_LOW_TICKS`] as a difference of times.
const LOW: i32 = PULSE_LOW_TICKS.cast_signed();

/// An axis that moves alone. Times are ticks from the segment's start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Alone {
    /// Which, as a bit.
    pub(super) mask: u32,
    /// When its pulse ends, if it is high: so early that the first step is on time.
    pub(super) due: Option<i32>,
}

impl Alone {
    /// Puts the events of all steps, of which there is one at least. When the last pulse ends.
    pub(super) fn put(
        self,
        mut steps: AxisSteps,
        pulse_ticks: u32,
        cursor: &mut Cursor,
        events: &mut EventBatch<'_>,
    ) -> i32 {
        let step = StepEvent::new(0, self.mask, 0);
        let time = steps.next_ticks.cast_signed();
        let held = events.reserve_first();
        let first = if let Some(due) = self.due {
            let end = cursor.mark_boundary(StepEvent::new(0, 0, self.mask));
            let end = cursor.schedule(due, end);
            events.push_uncommitted(cursor.schedule(time, step));
            end
        } else {
            let begin = cursor.mark_boundary(step);
            cursor.schedule(time, begin)
        };
        steps.advance_periodic();
        let pulse_end = StepEvent::new(pulse_ticks, 0, self.mask);
        if steps.remaining > 1 {
            cursor.last_ticks = put_evenly(&mut steps, cursor.last_ticks, pulse_end, events);
        }
        if steps.remaining != 0 {
            // The last one is not later than the segment's end.
            events.push_uncommitted(pulse_end);
            cursor.last_ticks += pulse_ticks.cast_signed();
            let time = steps.next_ticks.cast_signed().max(cursor.last_ticks + LOW);
            events.push_uncommitted(cursor.schedule(time, step));
        }
        events.commit_first(held, first);
        events.publish();
        cursor.last_ticks + pulse_ticks.cast_signed()
    }
}

/// All steps but the last one: each ends the pulse before it. The time of the last of them.
fn put_evenly(
    steps: &mut AxisSteps,
    last: i32,
    pulse_end: StepEvent,
    out: &mut EventBatch<'_>,
) -> i32 {
    let mask = pulse_end.drop();
    let pulse_ticks = pulse_end.ticks();
    let (mut fine, period) = (steps.time_fixed, steps.period_fixed);
    let mut last = last.cast_unsigned();
    let mut batch = *out;
    // wcet-bound: segment_steps, wcet-total: segment_steps
    for _ in 1..steps.remaining {
        let time = fine >> TIME_FRACTION_BITS;
        let low_ticks = time.wrapping_sub(last).wrapping_sub(pulse_ticks);
        batch.push_uncommitted(pulse_end);
        batch.push_uncommitted(StepEvent::new(low_ticks, mask, 0));
        last = time;
        fine = fine.wrapping_add(period);
    }
    *out = batch;
    steps.remaining = 1;
    steps.time_fixed = fine;
    steps.next_ticks = fine >> TIME_FRACTION_BITS;
    last.cast_signed()
}
