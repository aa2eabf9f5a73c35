//! How the steps of an axis become events: the cheapest of four methods that keeps their times.
//!
//! ```text
//! one axis has steps, at a constant rate, each pulse
//! ends before the next, nothing delays the first      ──▶ Direct:   straight into the ring
//!   │ else each axis on its own, into the slots:
//!   ├─ a constant rate, nothing delays a step         ──▶ Periodic: add the period to the slot
//!   ├─ a constant rate                                ──▶ Delayed:  compare with the pulse before
//!   └─ the rate changes                               ──▶ Solved:   a root and a division for each
//! ```
//!
//! [`Direct::is_possible`] makes the first choice,
//! [`Placement::method`] the others. A step of the dominant axis, the one with most steps, keeps its
//! time: the events right before it move.
//!
//! # Cost
//! A step takes 50 cycles at most by `Periodic`, 70 of the dominant axis, and 83 by `Delayed`
//! (`docs/benchmarks.md`). Each method is a loop of its own, so short that it stays in the instruction
//! cache beside the tasks that interrupt it most: hence `inline(always)` on what two loops are made
//! from, and `inline(never)` on the loops.

use super::{
    StepEvent,
    ring::EventBatch,
    slots::{Cursor, SLOTS, Slots},
    step_times::{AxisSteps, TIME_FRACTION_BITS},
};
use crate::model::timing::{PULSE_LOW_TICKS, SLOT_TICKS};

/// Where the slot begins in a time with [`TIME_FRACTION_BITS`] binary places, with the ticks in the
/// slot below it. Above are as many bits as number the slots.
const SLOT_SHIFT: u32 = TIME_FRACTION_BITS + SLOT_TICKS.ilog2();
const _: () = assert!(SLOTS == 1 << (32 - SLOT_SHIFT));

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

/// How the steps of an axis get into the slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    /// One period after the other, each step at its time.
    Periodic,
    /// One period after the other, steps later where the pulse before demands it.
    Delayed,
    /// Times solved for, steps later where the pulse before demands it.
    Solved,
}

/// Where the steps of an axis go. Slots count from the one that the segment begins in.
pub(super) struct Placement {
    /// The slot that the segment begins in.
    pub(super) base_slot: u32,
    /// Start of the segment, ticks after the start of that slot.
    pub(super) offset_ticks: u32,
    /// The axis' bit.
    pub(super) axis_mask: u32,
    /// The axes whose events do not move for it, bit 0 = X.
    pub(super) fixed_axes: u32,
    /// From a step to the end of its pulse.
    pub(super) pulse_slots: u32,
    /// From the end of a pulse to the next step at least.
    pub(super) low_slots: u32,
    /// The first slot in which the next step may be.
    pub(super) earliest_slot: u32,
    /// The slot of the last step.
    pub(super) last_step_slot: u32,
}

impl Placement {
    /// Returns the method for the steps of the axis.
    #[inline]
    pub(super) fn method(&self, steps: &AxisSteps) -> Method {
        let min_period = (self.pulse_slots + self.low_slots) * SLOT_TICKS;
        let slot = (self.offset_ticks + steps.next_ticks) / SLOT_TICKS;
        if steps.has_period(min_period) && steps.is_in_time() && slot >= self.earliest_slot {
            Method::Periodic
        } else if steps.is_periodic() {
            Method::Delayed
        } else {
            Method::Solved
        }
    }

    /// Adds steps by [`Method::Periodic`].
    #[inline(never)]
    pub(super) fn add_periodic(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        self.add_in_time(slots, steps, |_, _| ());
    }

    /// Adds the steps of the dominant axis by [`Method::Periodic`].
    #[inline(never)]
    pub(super) fn add_periodic_dominant(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        let fixed_axes = self.fixed_axes;
        self.add_in_time(slots, steps, |slots, time_fixed| {
            let slot = time_fixed >> SLOT_SHIFT;
            if slots.is_occupied(slot.wrapping_sub(1)) {
                let ticks = (time_fixed >> TIME_FRACTION_BITS) % SLOT_TICKS;
                slots.move_neighbours_earlier_out_of_line(slot, fixed_axes, ticks);
            }
        });
    }

    /// Adds steps by [`Method::Delayed`].
    #[inline(never)]
    pub(super) fn add_delayed(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        self.add_later(slots, steps, AxisSteps::advance_periodic);
    }

    /// Adds steps by [`Method::Solved`].
    #[inline(never)]
    pub(super) fn add_solved(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        self.add_later(slots, steps, AxisSteps::advance_solved);
    }

    /// Adds steps at their times. The slot and the ticks in it are in one word, which wraps as slots
    /// do.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "two loops are made from it")]
    fn add_in_time(
        &mut self,
        slots: &mut Slots,
        steps: &AxisSteps,
        move_neighbours: impl Fn(&mut Slots, u32),
    ) {
        let base_fixed = self.base_slot << SLOT_SHIFT;
        let begin_fixed = (self.offset_ticks << TIME_FRACTION_BITS).wrapping_add(base_fixed);
        let period_fixed = steps.period_fixed;
        let mut time_fixed = begin_fixed.wrapping_add(steps.time_fixed);
        let end_fixed = time_fixed.wrapping_add(period_fixed.wrapping_mul(steps.remaining));
        let (axis_mask, pulse_slots) = (self.axis_mask, self.pulse_slots);
        let mut add = |time_fixed: u32| {
            let slot = time_fixed >> SLOT_SHIFT;
            slots.add_step(slot, axis_mask, time_fixed >> TIME_FRACTION_BITS);
            move_neighbours(slots, time_fixed);
            slots.add_pulse_end(slot + pulse_slots, axis_mask);
        };
        // wcet-bound: segment_steps, wcet-total: segment_steps
        while time_fixed != end_fixed {
            add(time_fixed);
            time_fixed = time_fixed.wrapping_add(period_fixed);
        }
        let last = end_fixed.wrapping_sub(period_fixed) >> SLOT_SHIFT;
        self.last_step_slot = last.wrapping_sub(self.base_slot) % SLOTS;
        self.earliest_slot = self.last_step_slot + self.pulse_slots + self.low_slots;
    }

    /// Adds steps at their times, or as soon after them as the pulse before allows.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "two loops are made from it")]
    fn add_later(
        &mut self,
        slots: &mut Slots,
        steps: &AxisSteps,
        advance: impl Fn(&mut AxisSteps),
    ) {
        let mut steps = *steps;
        let (mut slot, mut earliest) = (0, self.earliest_slot);
        // wcet-bound: segment_steps, wcet-total: segment_steps
        while steps.remaining != 0 {
            let time = self.offset_ticks + steps.next_ticks;
            slot = time / SLOT_TICKS;
            let mut ticks = time % SLOT_TICKS;
            if slot < earliest {
                (slot, ticks) = (earliest, 0);
            }
            let at = self.base_slot.wrapping_add(slot);
            slots.add_step(at, self.axis_mask, ticks);
            slots.move_neighbours_earlier(at, self.fixed_axes, ticks);
            slots.add_pulse_end(at.wrapping_add(self.pulse_slots), self.axis_mask);
            earliest = slot + self.pulse_slots + self.low_slots;
            advance(&mut steps);
        }
        (self.last_step_slot, self.earliest_slot) = (slot, earliest);
    }
}
