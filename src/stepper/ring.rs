//! The queue of step events: lock-free, one writer, one reader, one word per event.
//!
//! Two events pass through it for every step, so it is made for that alone: words instead of any
//! type, a constant power of two instead of a length that must be divided by, and no barriers,
//! which a single core does not need between its own tasks (the compiler is told to keep the
//! order). Measured against `heapless::spsc` in `docs/decisions.md`.
//!
//! The step timer is told in advance when the event comes that follows the one which is set up. So
//! the reader is two events ahead of the pins, and what it knows is in the ring:
//!
//! ```text
//! output so far          set up      known next        not looked at            not an event
//! …  output-2  output-1 │ output │ output+1 = `next` │ output+2 …  written-1 │ written
//! ```
//!
//! The word behind the last event is none, and becomes one when there is an event for it, and behind
//! that none or another: so the step interrupt sees what has been put by the word itself, and counts
//! nothing.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed, Ordering::SeqCst, compiler_fence};

use super::{SegmentRing, StepEvent};
use crate::model::queues::EVENT_RING;

/// Words of a ring, a power of two: as many events as may wait, the word behind them, and those
/// played last, from which `prepare` learns where the machine was at an event.
const WORDS: usize = 2 * EVENT_RING;
const MASK: u32 = WORDS as u32 - 1;

/// The ring itself.
#[derive(Debug)]
#[repr(C)]
pub struct EventRing {
    /// Events written so far, wrapping: for the writer.
    written_count: AtomicU32,
    /// Events output so far, wrapping.
    output_count: AtomicU32,
    /// The event behind the one that is set up, or [`StepEvent::NONE`].
    following: AtomicU32,
    /// Events that may have come too late, wrapping. Here, because the step interrupt counts them, and
    /// one address is enough for all that it uses of the ring.
    late_count: AtomicU32,
    words: [AtomicU32; WORDS],
}

impl EventRing {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            words: [const { AtomicU32::new(0) }; WORDS],
            written_count: AtomicU32::new(0),
            output_count: AtomicU32::new(0),
            following: AtomicU32::new(StepEvent::NONE.bits()),
            late_count: AtomicU32::new(0),
        }
    }

    /// Its two ends, each for one task.
    pub const fn split(&mut self) -> (EventWriter<'_>, EventReader<'_>) {
        let ring: &Self = self;
        (EventWriter { ring }, EventReader { ring })
    }

    /// Events that may have come too late, wrapping, as the step interrupt had come too late to tell
    /// the timer of them.
    #[must_use]
    pub fn late(&self) -> u32 {
        self.late_count.load(Relaxed)
    }

    /// Events that can be put now. The other places hold those played last.
    #[inline]
    fn room(&self) -> u32 {
        let waiting = self.written_count.load(Relaxed);
        EVENT_RING as u32 - waiting.wrapping_sub(self.output_count.load(Relaxed))
    }

    /// The event of a number that has not been output, or [`StepEvent::NONE`] if it has not been
    /// written: it is the one that will be written next at most.
    #[inline]
    fn pending_event(&self, number: u32) -> StepEvent {
        StepEvent::from_bits(self.word(number).load(Relaxed))
    }

    /// The event behind the one that is set up.
    #[inline]
    fn following(&self) -> StepEvent {
        StepEvent::from_bits(self.following.load(Relaxed))
    }

    #[inline]
    fn set_following(&self, event: StepEvent) {
        self.following.store(event.bits(), Relaxed);
    }

    /// The place of an event.
    #[inline]
    fn word(&self, number: u32) -> &AtomicU32 {
        &self.words[(number & MASK) as usize]
    }
}

impl Default for EventRing {
    fn default() -> Self {
        Self::new()
    }
}

/// The end of `prepare`.
#[derive(Debug)]
pub struct EventWriter<'a> {
    ring: &'a EventRing,
}

impl<'a> EventWriter<'a> {
    /// What the input interrupt sees of the ring.
    #[must_use]
    pub const fn tap(&self) -> EventTap<'a> {
        EventTap { ring: self.ring }
    }

    /// Drops the events that have not been output, and tells the number of the next. Only while the
    /// step interrupt stands.
    pub(super) fn discard_pending(&mut self) -> u32 {
        let output = self.ring.output_count.load(Relaxed);
        self.ring.written_count.store(output, Relaxed);
        self.ring
            .word(output)
            .store(StepEvent::NONE.bits(), Relaxed);
        output
    }

    /// Whether there are events that have not been output.
    #[must_use]
    pub fn has_pending(&self) -> bool {
        self.ring.output_count.load(Relaxed) != self.ring.written_count.load(Relaxed)
    }

    /// Before the step timer is started: what is to be set up, if there is an event.
    #[must_use]
    pub fn set_up(&mut self) -> Option<Upcoming> {
        let number = self.ring.output_count.load(Relaxed);
        let event = self.ring.pending_event(number);
        if event == StepEvent::NONE {
            return None;
        }
        let then = self.ring.pending_event(number.wrapping_add(1));
        self.ring.set_following(then);
        Some(Upcoming {
            event,
            following: then,
        })
    }

    /// The event that has come too late for the step interrupt to know of it: it takes the one that
    /// is set up for the last. To be asked once after events have been put; what it tells is for
    /// the step timer and, after that, for [`EventWriter::append`].
    #[inline]
    #[must_use]
    pub fn appended_late(&self, segments: &SegmentRing) -> Option<StepEvent> {
        if self.ring.following() != StepEvent::NONE || !segments.is_running() {
            return None;
        }
        // As long as it knows of no more, the step interrupt can only stop.
        let set_up = self.ring.output_count.load(Relaxed);
        let event = self.ring.pending_event(set_up.wrapping_add(1));
        (event != StepEvent::NONE).then_some(event)
    }

    /// Lets the step interrupt go on with an event, now that the step timer knows its time. If it
    /// has stopped meanwhile, or is stopped, that is of no effect.
    #[inline]
    pub fn append(&mut self, event: StepEvent) {
        // Not earlier: whoever finds the event relies on the timer.
        compiler_fence(SeqCst);
        self.ring.set_following(event);
    }

    /// The event of a number, while it waits or is among those output last, one less than [`EVENT_RING`].
    pub(super) fn event(&self, number: u32) -> StepEvent {
        StepEvent::from_bits(self.ring.word(number).load(Relaxed))
    }

    /// Events that can be put now.
    #[inline]
    #[must_use]
    pub fn room(&self) -> u32 {
        self.ring.room()
    }

    /// Begins to put events.
    #[inline]
    pub(super) fn begin(&mut self) -> EventBatch<'_> {
        let number = self.ring.written_count.load(Relaxed);
        EventBatch {
            ring: self.ring,
            number,
            end_number: number.wrapping_add(self.ring.room()),
        }
    }
}

/// Events being put: what the writer knows of the ring.
///
/// A copy takes over from the original; a loop has its own, which stays in registers.
#[derive(Debug, Clone, Copy)]
pub(super) struct EventBatch<'a> {
    ring: &'a EventRing,
    number: u32,
    /// The number of the first for which there was no room at the beginning.
    end_number: u32,
}

impl EventBatch<'_> {
    /// Events that can still be put.
    #[inline]
    pub(super) fn room(&self) -> u32 {
        self.end_number.wrapping_sub(self.number)
    }

    /// The number of the next event.
    #[inline]
    pub(super) const fn number(&self) -> u32 {
        self.number
    }

    /// Puts an event, for the reader to see. The caller has seen to it that there is room.
    #[inline]
    pub(super) fn push(&mut self, event: StepEvent) {
        let behind = self.number.wrapping_add(1);
        self.ring
            .word(behind)
            .store(StepEvent::NONE.bits(), Relaxed);
        self.commit(event);
        self.number = behind;
    }

    /// Puts an event that the reader must not see yet: see [`EventBatch::hold`].
    #[inline]
    pub(super) fn push_uncommitted(&mut self, event: StepEvent) {
        self.ring.word(self.number).store(event.bits(), Relaxed);
        self.number = self.number.wrapping_add(1);
    }

    /// Begins to put events that the reader is to see together, the first of which will be shown by
    /// [`EventBatch::release`].
    #[inline]
    pub(super) fn reserve_first(&mut self) -> Self {
        let held = *self;
        self.number = self.number.wrapping_add(1);
        held
    }

    /// Shows the reader what has been put since a [`EventBatch::hold`], which begins with this event.
    #[inline]
    pub(super) fn commit_first(&mut self, mut held: Self, event: StepEvent) {
        let ring = self.ring;
        ring.word(self.number)
            .store(StepEvent::NONE.bits(), Relaxed);
        held.commit(event);
    }

    #[inline]
    fn commit(&mut self, event: StepEvent) {
        // The reader must not see it before what is behind it.
        compiler_fence(SeqCst);
        self.ring.word(self.number).store(event.bits(), Relaxed);
    }

    /// Counts all events put.
    #[inline]
    pub(super) fn publish(&mut self) {
        self.ring.written_count.store(self.number, Relaxed);
    }
}

/// What is to be set up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Upcoming {
    /// The event that comes next: the timer knows when.
    pub event: StepEvent,
    /// The one behind it, or [`StepEvent::NONE`]: the timer has to be told now how long after that.
    pub following: StepEvent,
}

/// What the input interrupt sees of a ring.
#[derive(Debug, Clone, Copy)]
pub struct EventTap<'a> {
    ring: &'a EventRing,
}

impl EventTap<'_> {
    /// How many events have been output, wrapping: exactly, at any instant, also between any two
    /// instructions of `prepare`, and from any task below the step interrupt.
    #[inline]
    #[must_use]
    pub fn output_count(self) -> u32 {
        self.ring.output_count.load(Relaxed)
    }

    /// How many events have been output or are set up, wrapping, and whether the step interrupt
    /// runs. If it sets up a segment's first event or stops meanwhile, it releases `segment_start` again.
    #[inline]
    pub(super) fn committed(self, segments: &SegmentRing) -> (u32, bool) {
        let output = self.output_count();
        compiler_fence(SeqCst);
        if segments.is_running() {
            return (output.wrapping_add(1), true);
        }
        // It may have stopped in between.
        compiler_fence(SeqCst);
        (self.output_count(), false)
    }

    /// Ends the motion where it is, the step interrupt having been stopped by force: the event that
    /// was set up will not happen. For `inputs`; [`Generator::discard_unplayed`](super::Generator::discard_unplayed)
    /// is `prepare`'s part.
    pub fn halt(self, segments: &SegmentRing) {
        self.ring.set_following(StepEvent::NONE);
        segments.halt();
    }
}

/// The end of the step interrupt.
#[derive(Debug)]
pub struct EventReader<'a> {
    ring: &'a EventRing,
}

impl EventReader<'_> {
    /// What was set up has been output: counts it, and tells what is to be set up next; `None` after
    /// the last event. An event that is put behind one that was the last when it was set up comes
    /// too late, but for [`EventWriter::append`].
    #[inline]
    pub fn advance(&mut self) -> Option<Upcoming> {
        let ring = self.ring;
        let set_up = ring.output_count.load(Relaxed).wrapping_add(1);
        ring.output_count.store(set_up, Relaxed);
        let then = ring.pending_event(set_up.wrapping_add(1));
        let event = ring.following();
        ring.set_following(then);
        (event != StepEvent::NONE).then_some(Upcoming {
            event,
            following: then,
        })
    }

    /// Counts so many late events, one or none: the step interrupt takes the same time for both.
    #[inline]
    pub fn count_late(&mut self, late: u32) {
        let late = self.ring.late().wrapping_add(late);
        self.ring.late_count.store(late, Relaxed);
    }
}

#[cfg(test)]
mod tests;
