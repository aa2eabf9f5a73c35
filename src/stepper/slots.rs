//! The steps of a segment in order of time, without sorting.
//!
//! Time is cut into slots as long as events must be apart, so a slot has room for one event. Each
//! axis marks the slots of its steps and of the ends of its pulses; then one sweep turns the marks
//! into events. So a step costs the same with any number of axes, and steps of several axes that
//! fall into one slot share an event. A step has its own time within the slot; where an event in
//! the slot before is too close, it comes later, at the end of the slot at most.

use core::num::NonZeroU32;

use super::{StepEvent, ring::EventBatch};
use crate::model::timing::SLOT_TICKS;

/// The same as a difference of times.
pub(super) const SLOT_TICKS_SIGNED: i32 = SLOT_TICKS.cast_signed();
/// Slots, a power of two: for a segment with what it may be stretched by, and the pulses after it.
pub(super) const SLOTS: u32 = 2048;
/// Slots that a word tells of.
const WORD_BITS: u32 = 32;
const WORDS: u32 = SLOTS / WORD_BITS;

/// Slots and what is to happen in them: a ring, in which numbers wrap.
///
/// In this order in memory: the bits are where one instruction reaches them.
#[derive(Debug)]
#[repr(C)]
pub(super) struct Slots {
    /// A bit for each slot that is marked, the first one in the highest bit.
    occupied: [u32; WORDS as usize],
    /// What happens, with ticks from the slot's start.
    events: [StepEvent; SLOTS as usize],
}

/// Where the list of events has come to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor {
    /// The first slot after that of the last event.
    pub(super) free_slot: u32,
    /// Time of the last event, ticks from the start of the slot that the segment begins in.
    pub(super) last_ticks: i32,
    /// No event of the segment has been put.
    pub(super) is_at_boundary: bool,
}

impl Cursor {
    /// An event at a time, or as soon after it as it may be.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "keeps the cursor in registers")]
    pub(super) fn schedule(&mut self, time: i32, what: StepEvent) -> StepEvent {
        let time = time.max(self.last_ticks + SLOT_TICKS_SIGNED);
        let ticks = (time - self.last_ticks).cast_unsigned();
        debug_assert!(
            ticks <= StepEvent::MAX_TICKS,
            "{ticks} ticks without an event"
        );
        self.last_ticks = time;
        what.with_ticks(ticks)
    }

    /// The first event of the segment, or another.
    #[inline]
    pub(super) fn mark_boundary(&mut self, what: StepEvent) -> StepEvent {
        if core::mem::take(&mut self.is_at_boundary) {
            what.at_boundary()
        } else {
            what
        }
    }
}

impl Slots {
    /// Without a mark.
    pub(super) const NONE: Self = Self {
        occupied: [0; WORDS as usize],
        events: [StepEvent::NONE; SLOTS as usize],
    };

    /// What happens in a slot.
    #[inline]
    fn event_in(&mut self, slot: u32) -> &mut StepEvent {
        &mut self.events[(slot % SLOTS) as usize]
    }

    /// The bits of a slot and its neighbours.
    #[inline]
    fn occupied_word(&mut self, slot: u32) -> &mut u32 {
        &mut self.occupied[(slot % SLOTS / WORD_BITS) as usize]
    }

    /// Marks a step of the axes in `mask`, so many ticks from the slot's start: those of other axes
    /// in the slot come then, too.
    #[inline]
    pub(super) fn add_step(&mut self, slot: u32, mask: u32, ticks: u32) {
        let mark = self.event_in(slot);
        *mark = mark
            .with_slot_ticks(ticks)
            .merged_with(StepEvent::new(0, mask, 0));
        *self.occupied_word(slot) |= bit(slot);
    }

    /// Has what happens in the slots next before a step happen so early that the step need not wait:
    /// no later in its slot than the step in its own. As far as nothing happens to the axes in
    /// `stop`.
    #[inline]
    pub(super) fn move_neighbours_earlier(&mut self, slot: u32, stop: u32, ticks: u32) {
        let mut before = slot.wrapping_sub(1);
        // wcet-bound: 2048, wcet-total: neighbours
        while let Some(mark) = self.movable_event(before, stop) {
            *mark = mark.with_slot_ticks(mark.ticks().min(ticks));
            before = before.wrapping_sub(1);
        }
    }

    /// Whether something happens in a slot.
    #[inline]
    pub(super) fn is_occupied(&mut self, slot: u32) -> bool {
        *self.event_in(slot) != StepEvent::NONE
    }

    /// [`Slots::make_way`] where something is in the way.
    #[inline(never)]
    pub(super) fn move_neighbours_earlier_out_of_line(&mut self, slot: u32, stop: u32, ticks: u32) {
        self.move_neighbours_earlier(slot, stop, ticks);
    }

    /// What happens in a slot, if something does and to none of the axes in `stop`.
    #[inline]
    fn movable_event(&mut self, slot: u32, stop: u32) -> Option<&mut StepEvent> {
        let mark = self.event_in(slot);
        let stops = mark.bits() & StepEvent::new(0, stop, stop).bits() != 0;
        (*mark != StepEvent::NONE && !stops).then_some(mark)
    }

    /// Has what happens in the slots next before another happen as early as it can.
    pub(super) fn move_neighbours_to_slot_start(&mut self, slot: u32, stop: u32) {
        // wcet-bound: 8
        for before in 1..=8 {
            let Some(mark) = self.movable_event(slot.wrapping_sub(before), stop) else {
                break;
            };
            *mark = mark.with_ticks(0);
        }
    }

    /// Marks the end of pulses.
    #[inline]
    pub(super) fn add_pulse_end(&mut self, slot: u32, mask: u32) {
        self.add(slot, StepEvent::new(0, 0, mask));
    }

    /// Marks a change of the direction outputs, alone in the first of a few slots that is not
    /// marked. That slot.
    pub(super) fn add_direction_change(&mut self, slot: u32, directions: u8) -> u32 {
        let mut slot = slot;
        // wcet-bound: axes
        while *self.occupied_word(slot) & bit(slot) != 0 {
            slot = slot.wrapping_add(1);
        }
        self.add(slot, StepEvent::set_directions(0, directions));
        slot
    }

    #[inline]
    fn add(&mut self, slot: u32, what: StepEvent) {
        let mark = self.event_in(slot);
        *mark = mark.merged_with(what);
        *self.occupied_word(slot) |= bit(slot);
    }

    /// Takes away what happens in a slot.
    pub(super) fn remove(&mut self, slot: u32) {
        *self.event_in(slot) = StepEvent::NONE;
        *self.occupied_word(slot) &= !bit(slot);
    }

    /// Takes the bits of a word of slots but for those of `later`, and the marks of all of them.
    #[inline]
    fn drain_word(
        &mut self,
        first: u32,
        later: u32,
    ) -> (u32, &mut [StepEvent; WORD_BITS as usize]) {
        let place = (first % SLOTS / WORD_BITS) as usize;
        let word = &mut self.occupied[place];
        let bits = *word & !later;
        *word &= later;
        (bits, &mut self.events.as_chunks_mut().0[place])
    }

    /// Puts the events of all slots before `end`, for which there is room. Times count from the start
    /// of the slot `base`.
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
        let Some(place) = first_set(bits) else {
            *cursor = here;
            return;
        };
        // The reader sees them together: so none has to tell that there is none behind it.
        let held = out.reserve_first();
        let slot = first.wrapping_add(place);
        let begin = core::mem::take(self.event_in(slot));
        let time = slot.wrapping_sub(base).wrapping_mul(SLOT_TICKS);
        let time = time.wrapping_add(begin.ticks()).cast_signed();
        let begin = here.schedule(time, begin);
        let begin = here.mark_boundary(begin);
        *self.occupied_word(slot) &= !bit(slot);
        let mut put =
            |first: u32, (mut bits, marks): (u32, &mut [StepEvent; WORD_BITS as usize])| {
                let begin = first.wrapping_sub(base).wrapping_mul(SLOT_TICKS);
                // wcet-bound: 32, wcet-total: segment_events
                while let Some(place) = first_set(bits) {
                    bits &= !bit(place);
                    let what = core::mem::take(&mut marks[place as usize]);
                    let time = begin.wrapping_add(place * SLOT_TICKS);
                    let time = time.wrapping_add(what.ticks()).cast_signed();
                    out.push_uncommitted(here.schedule(time, what));
                }
            };
        let last = end / WORD_BITS * WORD_BITS;
        // wcet-bound: segment_words, wcet-total: segment_words
        while first != last {
            put(first, self.drain_word(first, 0));
            first = first.wrapping_add(WORD_BITS);
        }
        put(first, self.drain_word(first, later(first)));
        out.commit_first(held, begin);
        out.publish();
        (*cursor, *events) = (here, out);
    }
}

/// The place of the first bit that is set.
#[inline]
fn first_set(bits: u32) -> Option<u32> {
    NonZeroU32::new(bits).map(NonZeroU32::leading_zeros)
}

/// The bit of a slot in its word.
#[inline]
const fn bit(slot: u32) -> u32 {
    1 << (WORD_BITS - 1) >> (slot % WORD_BITS)
}
