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
pub(super) const SLOT: i32 = SLOT_TICKS.cast_signed();
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
    used: [u32; WORDS as usize],
    /// What happens, with ticks from the slot's start.
    marks: [StepEvent; SLOTS as usize],
}

/// Where the list of events has come to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor {
    /// The first slot after that of the last event.
    pub(super) free: u32,
    /// Time of the last event, ticks from the start of the slot that the segment begins in.
    pub(super) last: i32,
    /// No event of the segment has been put.
    pub(super) is_boundary: bool,
}

impl Cursor {
    /// An event at a time, or as soon after it as it may be.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "keeps the cursor in registers")]
    pub(super) fn next(&mut self, time: i32, what: StepEvent) -> StepEvent {
        let time = time.max(self.last + SLOT);
        let ticks = (time - self.last).cast_unsigned();
        debug_assert!(
            ticks <= StepEvent::MAX_TICKS,
            "{ticks} ticks without an event"
        );
        self.last = time;
        what.with_ticks(ticks)
    }

    /// The first event of the segment, or another.
    #[inline]
    pub(super) fn mark(&mut self, what: StepEvent) -> StepEvent {
        if core::mem::take(&mut self.is_boundary) {
            what.at_boundary()
        } else {
            what
        }
    }
}

impl Slots {
    /// Without a mark.
    pub(super) const NONE: Self = Self {
        used: [0; WORDS as usize],
        marks: [StepEvent::NONE; SLOTS as usize],
    };

    /// What happens in a slot.
    #[inline]
    fn mark(&mut self, slot: u32) -> &mut StepEvent {
        &mut self.marks[(slot % SLOTS) as usize]
    }

    /// The bits of a slot and its neighbours.
    #[inline]
    fn word(&mut self, slot: u32) -> &mut u32 {
        &mut self.used[(slot % SLOTS / WORD_BITS) as usize]
    }

    /// Marks a step of the axes in `mask`, so many ticks from the slot's start: those of other axes
    /// in the slot come then, too.
    #[inline]
    pub(super) fn step(&mut self, slot: u32, mask: u32, ticks: u32) {
        let mark = self.mark(slot);
        *mark = mark
            .with_slot_ticks(ticks)
            .merged_with(StepEvent::new(0, mask, 0));
        *self.word(slot) |= bit(slot);
    }

    /// Has what happens in the slots next before a step happen so early that the step need not wait:
    /// no later in its slot than the step in its own. As far as nothing happens to the axes in
    /// `stop`.
    #[inline]
    pub(super) fn make_way(&mut self, slot: u32, stop: u32, ticks: u32) {
        let mut before = slot.wrapping_sub(1);
        // wcet-bound: 2048, wcet-total: neighbours
        while let Some(mark) = self.in_the_way(before, stop) {
            *mark = mark.with_slot_ticks(mark.ticks().min(ticks));
            before = before.wrapping_sub(1);
        }
    }

    /// Whether something happens in a slot.
    #[inline]
    pub(super) fn is_used(&mut self, slot: u32) -> bool {
        *self.mark(slot) != StepEvent::NONE
    }

    /// [`Slots::make_way`] where something is in the way.
    #[inline(never)]
    pub(super) fn clear_way(&mut self, slot: u32, stop: u32, ticks: u32) {
        self.make_way(slot, stop, ticks);
    }

    /// What happens in a slot, if something does and to none of the axes in `stop`.
    #[inline]
    fn in_the_way(&mut self, slot: u32, stop: u32) -> Option<&mut StepEvent> {
        let mark = self.mark(slot);
        let stops = mark.bits() & StepEvent::new(0, stop, stop).bits() != 0;
        (*mark != StepEvent::NONE && !stops).then_some(mark)
    }

    /// Has what happens in the slots next before another happen as early as it can.
    pub(super) fn hurry(&mut self, slot: u32, stop: u32) {
        // wcet-bound: 8
        for before in 1..=8 {
            let Some(mark) = self.in_the_way(slot.wrapping_sub(before), stop) else {
                break;
            };
            *mark = mark.with_ticks(0);
        }
    }

    /// Marks the end of pulses.
    #[inline]
    pub(super) fn end(&mut self, slot: u32, mask: u32) {
        self.add(slot, StepEvent::new(0, 0, mask));
    }

    /// Marks a change of the direction outputs, alone in the first of a few slots that is not
    /// marked. That slot.
    pub(super) fn turn(&mut self, slot: u32, directions: u8) -> u32 {
        let mut slot = slot;
        // wcet-bound: axes
        while *self.word(slot) & bit(slot) != 0 {
            slot = slot.wrapping_add(1);
        }
        self.add(slot, StepEvent::set_directions(0, directions));
        slot
    }

    #[inline]
    fn add(&mut self, slot: u32, what: StepEvent) {
        let mark = self.mark(slot);
        *mark = mark.merged_with(what);
        *self.word(slot) |= bit(slot);
    }

    /// Takes away what happens in a slot.
    pub(super) fn clear(&mut self, slot: u32) {
        *self.mark(slot) = StepEvent::NONE;
        *self.word(slot) &= !bit(slot);
    }

    /// Takes the bits of a word of slots but for those of `later`, and the marks of all of them.
    #[inline]
    fn take_before(
        &mut self,
        first: u32,
        later: u32,
    ) -> (u32, &mut [StepEvent; WORD_BITS as usize]) {
        let place = (first % SLOTS / WORD_BITS) as usize;
        let word = &mut self.used[place];
        let bits = *word & !later;
        *word &= later;
        (bits, &mut self.marks.as_chunks_mut().0[place])
    }

    /// Puts the events of all slots before `end`, for which there is room. Times count from the start
    /// of the slot `base`.
    #[inline(never)]
    pub(super) fn sweep(
        &mut self,
        base: u32,
        end: u32,
        cursor: &mut Cursor,
        events: &mut EventBatch<'_>,
    ) {
        let (mut here, mut out) = (*cursor, *events);
        let mut first = here.free / WORD_BITS * WORD_BITS;
        here.free = end;
        let is_before = |first: u32| first.wrapping_sub(end).cast_signed() < 0;
        let later = |first: u32| {
            let ahead = end.wrapping_sub(first);
            u32::MAX.checked_shr(ahead).unwrap_or(0)
        };
        let mut bits = 0;
        // wcet-bound: segment_words, wcet-total: segment_words
        while is_before(first) {
            bits = *self.word(first) & !later(first);
            if bits != 0 {
                break;
            }
            first = first.wrapping_add(WORD_BITS);
        }
        let Some(place) = first_of(bits) else {
            *cursor = here;
            return;
        };
        // The reader sees them together: so none has to tell that there is none behind it.
        let held = out.hold();
        let slot = first.wrapping_add(place);
        let begin = core::mem::take(self.mark(slot));
        let time = slot.wrapping_sub(base).wrapping_mul(SLOT_TICKS);
        let time = time.wrapping_add(begin.ticks()).cast_signed();
        let begin = here.next(time, begin);
        let begin = here.mark(begin);
        *self.word(slot) &= !bit(slot);
        let mut put =
            |first: u32, (mut bits, marks): (u32, &mut [StepEvent; WORD_BITS as usize])| {
                let begin = first.wrapping_sub(base).wrapping_mul(SLOT_TICKS);
                // wcet-bound: 32, wcet-total: segment_events
                while let Some(place) = first_of(bits) {
                    bits &= !bit(place);
                    let what = core::mem::take(&mut marks[place as usize]);
                    let time = begin.wrapping_add(place * SLOT_TICKS);
                    let time = time.wrapping_add(what.ticks()).cast_signed();
                    out.put_behind(here.next(time, what));
                }
            };
        let last = end / WORD_BITS * WORD_BITS;
        // wcet-bound: segment_words, wcet-total: segment_words
        while first != last {
            put(first, self.take_before(first, 0));
            first = first.wrapping_add(WORD_BITS);
        }
        put(first, self.take_before(first, later(first)));
        out.release(held, begin);
        out.publish();
        (*cursor, *events) = (here, out);
    }
}

/// The place of the first bit that is set.
#[inline]
fn first_of(bits: u32) -> Option<u32> {
    NonZeroU32::new(bits).map(NonZeroU32::leading_zeros)
}

/// The bit of a slot in its word.
#[inline]
const fn bit(slot: u32) -> u32 {
    1 << (WORD_BITS - 1) >> (slot % WORD_BITS)
}
