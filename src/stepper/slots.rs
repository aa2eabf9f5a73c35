//! The steps of a segment in order of time, without sorting.
//!
//! Time is divided into slots as long as the shortest time between two events, so a slot has room for
//! one event. Each axis adds its steps and the ends of its pulses to their slots; then
//! [`Slots::drain`] makes the list of events. Steps of several axes in one slot share an event. A
//! step has its own time within the slot; where an event in the slot before is too close, the step
//! comes later, at the end of its slot at most.
//!
//! # Cost
//! A step costs the same with any number of axes. The order of the fields of [`Slots`] in memory is
//! fixed: the bits are where one instruction reaches them. [`Cursor::schedule`] is inline so that a
//! loop keeps the cursor in registers. Where neighbours seldom have to move, the function for it is
//! out of line.

use core::num::NonZeroU32;

use super::{StepEvent, ring::EventBatch};
use crate::model::timing::SLOT_TICKS;

/// [`SLOT_TICKS`] as a difference of times.
pub(super) const SLOT_TICKS_SIGNED: i32 = SLOT_TICKS.cast_signed();
/// Number of slots: for a segment of 1.5 ms, 985 slots, that delayed events make longer, and the
/// pulses after it. `method` relies on the power of two.
pub(super) const SLOTS: u32 = 2048;
/// Events that move away from the end of a segment, at most: bounds the time of that. In a longer row
/// the events come up to a spacing later, and so does the first event of the next segment: within
/// [`STEP_JITTER_TICKS`](super::STEP_JITTER_TICKS).
const MAX_MOVED_NEIGHBOURS: u32 = 8;
/// Slots of a word of bits.
const WORD_BITS: u32 = 32;
const WORDS: u32 = SLOTS / WORD_BITS;

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
    #[inline]
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
    #[inline]
    fn event_in(&mut self, slot: u32) -> &mut StepEvent {
        &mut self.events[(slot % SLOTS) as usize]
    }

    /// The bits of a slot and its neighbours in a word.
    #[inline]
    fn occupied_word(&mut self, slot: u32) -> &mut u32 {
        &mut self.occupied[(slot % SLOTS / WORD_BITS) as usize]
    }

    /// Adds a step of the axes in `axes` at `ticks` from the slot's start: steps of other axes in the
    /// slot move there, too.
    #[inline]
    pub(super) fn add_step(&mut self, slot: u32, axes: u32, ticks: u32) {
        let event = self.event_in(slot);
        *event = event
            .with_slot_ticks(ticks)
            .merged_with(StepEvent::new(0, axes, 0));
        *self.occupied_word(slot) |= bit(slot);
    }

    /// Moves the events in the slots right before a step, so that the step need not wait: each comes
    /// no later in its slot than the step in its own. An event of `fixed_axes` ends the row.
    #[inline]
    pub(super) fn move_neighbours_earlier(&mut self, slot: u32, fixed_axes: u32, ticks: u32) {
        let mut before = slot.wrapping_sub(1);
        // wcet-bound: 2048, wcet-total: neighbours
        while let Some(event) = self.movable_event(before, fixed_axes) {
            *event = event.with_slot_ticks(event.ticks().min(ticks));
            before = before.wrapping_sub(1);
        }
    }

    /// Returns whether a slot has an event.
    #[inline]
    pub(super) fn is_occupied(&mut self, slot: u32) -> bool {
        *self.event_in(slot) != StepEvent::NONE
    }

    /// Does the same as [`Slots::move_neighbours_earlier`].
    #[inline(never)]
    pub(super) fn move_neighbours_earlier_out_of_line(
        &mut self,
        slot: u32,
        fixed_axes: u32,
        ticks: u32,
    ) {
        self.move_neighbours_earlier(slot, fixed_axes, ticks);
    }

    /// Returns the event of a slot, if there is one and it is of none of `fixed_axes`.
    #[inline]
    fn movable_event(&mut self, slot: u32, fixed_axes: u32) -> Option<&mut StepEvent> {
        let event = self.event_in(slot);
        let is_fixed = event.bits() & StepEvent::new(0, fixed_axes, fixed_axes).bits() != 0;
        (*event != StepEvent::NONE && !is_fixed).then_some(event)
    }

    /// Moves the events in the slots right before another to the start of their slots,
    /// [`MAX_MOVED_NEIGHBOURS`] at most.
    pub(super) fn move_neighbours_to_slot_start(&mut self, slot: u32, fixed_axes: u32) {
        // wcet-bound: 8
        for before in 1..=MAX_MOVED_NEIGHBOURS {
            let Some(event) = self.movable_event(slot.wrapping_sub(before), fixed_axes) else {
                break;
            };
            *event = event.with_ticks(0);
        }
    }

    /// Adds the end of pulses.
    #[inline]
    pub(super) fn add_pulse_end(&mut self, slot: u32, axes: u32) {
        self.add(slot, StepEvent::new(0, 0, axes));
    }

    /// Adds a change of the direction outputs, alone in the first slot from `slot` on without an
    /// event, and returns that slot.
    pub(super) fn add_direction_change(&mut self, mut slot: u32, directions: u8) -> u32 {
        // wcet-bound: axes
        while *self.occupied_word(slot) & bit(slot) != 0 {
            slot = slot.wrapping_add(1);
        }
        self.add(slot, StepEvent::set_directions(0, directions));
        slot
    }

    /// Adds an event to a slot.
    #[inline]
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
    #[inline]
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
        // wcet-bound: segment_words, wcet-total: segment_words
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
                // wcet-bound: 32, wcet-total: segment_events
                while let Some(index) = first_set(bits) {
                    bits &= !bit(index);
                    let event = core::mem::take(&mut events[index as usize]);
                    let time = begin.wrapping_add(index * SLOT_TICKS);
                    let time = time.wrapping_add(event.ticks()).cast_signed();
                    out.push_uncommitted(here.schedule(time, event));
                }
            };
        let last = end / WORD_BITS * WORD_BITS;
        // wcet-bound: segment_words, wcet-total: segment_words
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
#[inline]
fn first_set(bits: u32) -> Option<u32> {
    NonZeroU32::new(bits).map(NonZeroU32::leading_zeros)
}

/// Returns the bit of a slot in its word.
#[inline]
const fn bit(slot: u32) -> u32 {
    1 << (WORD_BITS - 1) >> (slot % WORD_BITS)
}
