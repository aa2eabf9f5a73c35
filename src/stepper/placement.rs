//! How the steps of a segment become events in order of time, without sorting.
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
//! [`Direct::is_possible`] makes the first choice, [`Placement::method`] the others.
//!
//! Time is divided into slots as long as the shortest time between two events, so a slot has room for
//! one event. Each axis adds its steps and the ends of its pulses to their slots; then
//! [`Slots::drain`] makes the list of events. Steps of several axes in one slot share an event. A
//! step has its own time within the slot; where an event in the slot before is too close, the step
//! comes later, at the end of its slot at most. A step of the dominant axis, the one with most steps,
//! keeps its time: the events right before it move.
//!
//! # Cost
//! A step costs the same with any number of axes: 50 cycles at most by `Periodic`, 70 of the dominant
//! axis, and 83 by `Delayed` (`docs/benchmarks.md`). Each method is a loop of its own, so short that it stays in the
//! instruction cache beside the most frequent tasks: hence `inline(always)` on the parts of two loops, and
//! `inline(never)` on the loops. [`Cursor::schedule`] is inlined so that a loop keeps the cursor in registers. Where
//! neighbours seldom have to move, the function for it is out of line. The order of the fields of [`Slots`] in memory
//! is fixed: the bits are where one instruction reaches them.

use core::num::NonZeroU32;

use super::{
    StepEvent,
    ring::EventBatch,
    step_times::{AxisSteps, TIME_FRACTION_BITS},
};
use crate::{
    axis::AXES,
    model::timing::{PULSE_LOW_TICKS, SLOT_TICKS},
};

/// [`SLOT_TICKS`] as a difference of times.
pub(super) const SLOT_TICKS_SIGNED: i32 = SLOT_TICKS.cast_signed();
/// Number of slots: for a segment of 1.5 ms, 985 slots, that delayed events make longer, and the
/// pulses after it. `SLOT_SHIFT` relies on the power of two.
pub const SLOTS: u32 = 2048;
/// Events that move away from the end of a segment, at most: bounds the cost of moving them. In a longer row
/// the events come up to a spacing later, and so does the first event of the next segment: within
/// [`STEP_JITTER_TICKS`](super::STEP_JITTER_TICKS).
const MAX_MOVED_NEIGHBOURS: u32 = 8;
/// Slots of a word of bits.
pub const WORD_BITS: u32 = 32;
const WORDS: u32 = SLOTS / WORD_BITS;
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
    // wcet-bound: segment_steps, wcet-total: segment_steps: one axis has all steps of the segment
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
    /// The axes whose events keep their time when a step needs room before it, bit 0 = X.
    pub(super) fixed_axes: u32,
    /// From a step to the end of its pulse.
    pub(super) pulse_slots: u32,
    /// From the end of a pulse to the next step at least.
    pub(super) low_slots: u32,
    /// The first slot in which the next step may be: the pulse before has ended, and been low.
    pub(super) earliest_slot: u32,
    /// The slot of the last step.
    pub(super) last_step_slot: u32,
}

impl Placement {
    /// Returns the method for the steps of the axis.
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
        // wcet-bound: segment_steps, wcet-total: segment_steps per add_steps: a segment has no more, of all axes
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
        // wcet-bound: segment_steps, wcet-total: segment_steps per add_steps: a segment has no more, of all axes
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

/// The slots with their events: a ring, in which slot numbers wrap.
#[derive(Debug)]
#[repr(C)]
pub(super) struct Slots {
    /// A bit for each slot that has an event, the first slot in the highest bit.
    occupied: [u32; WORDS as usize],
    /// The events, with ticks from the slot's start.
    events: [StepEvent; SLOTS as usize],
}

/// The end of the list of events.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor {
    /// The first slot after that of the last event.
    pub(super) free_slot: u32,
    /// Time of the last event, ticks from the start of the slot that the segment begins in.
    pub(super) last_ticks: i32,
    /// No event of the segment has been pushed.
    pub(super) is_at_boundary: bool,
}

impl Cursor {
    /// Returns an event at a time, or as soon after it as the event before allows.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "see `Cost`")]
    pub(super) fn schedule(&mut self, time: i32, event: StepEvent) -> StepEvent {
        let time = time.max(self.last_ticks + SLOT_TICKS_SIGNED);
        let ticks = (time - self.last_ticks).cast_unsigned();
        debug_assert!(
            ticks <= StepEvent::MAX_TICKS,
            "{ticks} ticks without an event"
        );
        self.last_ticks = time;
        event.with_ticks(ticks)
    }

    /// Returns an event, marked if it is the first of the segment.
    pub(super) fn mark_boundary(&mut self, event: StepEvent) -> StepEvent {
        if core::mem::take(&mut self.is_at_boundary) {
            event.at_boundary()
        } else {
            event
        }
    }
}

impl Slots {
    /// Slots without events.
    pub(super) const NONE: Self = Self {
        occupied: [0; WORDS as usize],
        events: [StepEvent::NONE; SLOTS as usize],
    };

    /// The event of a slot, or none.
    fn event_in(&mut self, slot: u32) -> &mut StepEvent {
        &mut self.events[(slot % SLOTS) as usize]
    }

    /// The bits of a slot and its neighbours in a word.
    fn occupied_word(&mut self, slot: u32) -> &mut u32 {
        &mut self.occupied[(slot % SLOTS / WORD_BITS) as usize]
    }

    /// Adds a step of the axes in `axes` at `ticks` from the slot's start: steps of other axes in the
    /// slot move there, too.
    pub(super) fn add_step(&mut self, slot: u32, axes: u32, ticks: u32) {
        let event = self.event_in(slot);
        *event = event
            .with_slot_ticks(ticks)
            .merged_with(StepEvent::new(0, axes, 0));
        *self.occupied_word(slot) |= bit(slot);
    }

    /// Moves the events in the slots right before a step, so that the step need not wait: each comes
    /// no later in its slot than the step in its own. An event of `fixed_axes` ends the row.
    fn move_neighbours_earlier(&mut self, slot: u32, fixed_axes: u32, ticks: u32) {
        let mut before = slot.wrapping_sub(1);
        // wcet-bound: SLOTS, wcet-total: neighbours per add_steps: an event moves for one step of the dominant axis
        while let Some(event) = self.movable_event(before, fixed_axes) {
            *event = event.with_slot_ticks(event.ticks().min(ticks));
            before = before.wrapping_sub(1);
        }
    }

    /// Returns whether a slot has an event.
    fn is_occupied(&mut self, slot: u32) -> bool {
        *self.event_in(slot) != StepEvent::NONE
    }

    /// Does the same as [`Slots::move_neighbours_earlier`].
    #[inline(never)]
    fn move_neighbours_earlier_out_of_line(&mut self, slot: u32, fixed_axes: u32, ticks: u32) {
        self.move_neighbours_earlier(slot, fixed_axes, ticks);
    }

    /// Returns the event of a slot, if there is one and it is of none of `fixed_axes`.
    fn movable_event(&mut self, slot: u32, fixed_axes: u32) -> Option<&mut StepEvent> {
        let event = self.event_in(slot);
        let is_fixed = event.bits() & StepEvent::new(0, fixed_axes, fixed_axes).bits() != 0;
        (*event != StepEvent::NONE && !is_fixed).then_some(event)
    }

    /// Moves the events in the slots right before another to the start of their slots,
    /// [`MAX_MOVED_NEIGHBOURS`] at most.
    pub(super) fn move_neighbours_to_slot_start(&mut self, slot: u32, fixed_axes: u32) {
        for before in 1..=MAX_MOVED_NEIGHBOURS {
            let Some(event) = self.movable_event(slot.wrapping_sub(before), fixed_axes) else {
                break;
            };
            *event = event.with_ticks(0);
        }
    }

    /// Adds the end of pulses.
    pub(super) fn add_pulse_end(&mut self, slot: u32, axes: u32) {
        self.add(slot, StepEvent::new(0, 0, axes));
    }

    /// Adds a change of the direction outputs, alone in the first slot from `slot` on without an
    /// event, and returns that slot.
    pub(super) fn add_direction_change(&mut self, mut slot: u32, directions: u8) -> u32 {
        // Pulses of the other axes end in some, one of each.
        for _ in 0..AXES {
            if *self.occupied_word(slot) & bit(slot) == 0 {
                break;
            }
            slot = slot.wrapping_add(1);
        }
        self.add(slot, StepEvent::set_directions(0, directions));
        slot
    }

    /// Adds an event to a slot.
    fn add(&mut self, slot: u32, event: StepEvent) {
        let slot_event = self.event_in(slot);
        *slot_event = slot_event.merged_with(event);
        *self.occupied_word(slot) |= bit(slot);
    }

    /// Removes the event of a slot.
    pub(super) fn remove(&mut self, slot: u32) {
        *self.event_in(slot) = StepEvent::NONE;
        *self.occupied_word(slot) &= !bit(slot);
    }

    /// Clears the bits of a word of slots but for those of `later`. Returns the bits cleared and the
    /// events of the word's slots.
    fn drain_word(
        &mut self,
        first: u32,
        later: u32,
    ) -> (u32, &mut [StepEvent; WORD_BITS as usize]) {
        let index = (first % SLOTS / WORD_BITS) as usize;
        let word = &mut self.occupied[index];
        let bits = *word & !later;
        *word &= later;
        (bits, &mut self.events.as_chunks_mut().0[index])
    }

    /// Moves the events of all slots before `end` to the ring, which has room for them. Times count
    /// from the start of the slot `base`.
    #[inline(never)]
    pub(super) fn drain(
        &mut self,
        base: u32,
        end: u32,
        cursor: &mut Cursor,
        events: &mut EventBatch<'_>,
    ) {
        let (mut here, mut out) = (*cursor, *events);
        let mut first = here.free_slot / WORD_BITS * WORD_BITS;
        here.free_slot = end;
        let is_before = |first: u32| first.wrapping_sub(end).cast_signed() < 0;
        let later = |first: u32| {
            let ahead = end.wrapping_sub(first);
            u32::MAX.checked_shr(ahead).unwrap_or(0)
        };
        let mut bits = 0;
        // wcet-bound: segment_words, wcet-total: segment_words per drain: the loops pass the words of a segment
        while is_before(first) {
            bits = *self.occupied_word(first) & !later(first);
            if bits != 0 {
                break;
            }
            first = first.wrapping_add(WORD_BITS);
        }
        let Some(index) = first_set(bits) else {
            *cursor = here;
            return;
        };
        // The reader sees them together: no event needs the mark that none follows.
        let reserved = out.reserve_first();
        let slot = first.wrapping_add(index);
        let begin = core::mem::take(self.event_in(slot));
        let time = slot.wrapping_sub(base).wrapping_mul(SLOT_TICKS);
        let time = time.wrapping_add(begin.ticks()).cast_signed();
        let begin = here.schedule(time, begin);
        let begin = here.mark_boundary(begin);
        *self.occupied_word(slot) &= !bit(slot);
        let mut push =
            |first: u32, (mut bits, events): (u32, &mut [StepEvent; WORD_BITS as usize])| {
                let begin = first.wrapping_sub(base).wrapping_mul(SLOT_TICKS);
                // wcet-bound: WORD_BITS, wcet-total: segment_events per drain: each bit of a word is an event of the segment
                while let Some(index) = first_set(bits) {
                    bits &= !bit(index);
                    let event = core::mem::take(&mut events[index as usize]);
                    let time = begin.wrapping_add(index * SLOT_TICKS);
                    let time = time.wrapping_add(event.ticks()).cast_signed();
                    out.push_uncommitted(here.schedule(time, event));
                }
            };
        let last = end / WORD_BITS * WORD_BITS;
        // wcet-bound: segment_words, wcet-total: segment_words per drain: it goes on where the first has ended
        while first != last {
            push(first, self.drain_word(first, 0));
            first = first.wrapping_add(WORD_BITS);
        }
        push(first, self.drain_word(first, later(first)));
        out.commit_first(reserved, begin);
        out.publish();
        (*cursor, *events) = (here, out);
    }
}

/// Returns the index of the first bit that is set, from the highest.
fn first_set(bits: u32) -> Option<u32> {
    NonZeroU32::new(bits).map(NonZeroU32::leading_zeros)
}

/// Returns the bit of a slot in its word.
const fn bit(slot: u32) -> u32 {
    1 << (WORD_BITS - 1) >> (slot % WORD_BITS)
}
