//! The ring of step events: lock-free, a single writer, a single reader, one word per event.
//!
//! The step timer knows in advance when the event comes that follows the one which is set up. So the
//! reader is two events ahead of the pins:
//!
//! ```text
//! output so far          set up      following                       pending               no event
//! …  output-2  output-1 │ output │ output+1 = `following` │ output+2 …  written-1 │ written
//! ```
//!
//! The word behind the last event is no event. It becomes an event when the writer has stored the word behind it, so
//! the step interrupt knows from the word itself whether there is an event.
//!
//! # Cost
//! Two events pass through the ring for every step: hence words instead of any type, a constant
//! power of two instead of a length, no count of events for the reader to compare, and no barriers,
//! which a single core does not need between its own tasks (compiler fences keep the order).
//! `docs/decisions.md`, 1, has the comparison with `heapless::spsc`. One address is enough for all
//! that the step interrupt uses of the ring, so late events are counted here, without a branch. A
//! copy of [`EventBatch`] replaces the original: a loop has its own, which stays in registers.

use super::{SegmentRing, StepEvent};
use crate::{
    atomic::{
        AtomicU32,
        Ordering::{Relaxed, SeqCst},
        compiler_fence,
    },
    model::queues::EVENT_RING,
};

/// Words of a ring, a power of two: as many events as may wait, the word behind them, and the events
/// played last, for the position lookup.
const WORDS: usize = 2 * EVENT_RING;
const MASK: u32 = WORDS as u32 - 1;

/// The ring.
#[derive(Debug)]
#[repr(C)]
pub struct EventRing {
    /// Events written so far, wrapping: for the writer.
    written_count: AtomicU32,
    /// Events output so far, wrapping.
    output_count: AtomicU32,
    /// The event behind the one that is set up, or [`StepEvent::NONE`].
    following: AtomicU32,
    /// Events that may have come too late, wrapping.
    late_count: AtomicU32,
    words: [AtomicU32; WORDS],
}

impl EventRing {
    /// Returns an empty ring.
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

    /// Returns the two ends, each for one task.
    pub const fn split(&mut self) -> (EventWriter<'_>, EventReader<'_>) {
        let ring: &Self = self;
        (EventWriter { ring }, EventReader { ring })
    }

    /// Returns the number of events that may have come too late, wrapping, as the step interrupt ran
    /// too late to set the timer's reload value for them.
    #[must_use]
    pub fn late(&self) -> u32 {
        self.late_count.load(Relaxed)
    }

    /// Returns how many events can be pushed now. The other words hold the events played last.
    fn room(&self) -> u32 {
        let waiting = self.written_count.load(Relaxed);
        EVENT_RING as u32 - waiting.wrapping_sub(self.output_count.load(Relaxed))
    }

    /// Returns the event of a number that has not been output, or [`StepEvent::NONE`] if the number
    /// is that of the event to be written next.
    fn pending_event(&self, number: u32) -> StepEvent {
        StepEvent::from_bits(self.word(number).load(Relaxed))
    }

    /// Returns the event behind the one that is set up.
    fn following(&self) -> StepEvent {
        StepEvent::from_bits(self.following.load(Relaxed))
    }

    fn set_following(&self, event: StepEvent) {
        self.following.store(event.bits(), Relaxed);
    }

    /// Returns the word of an event.
    fn word(&self, number: u32) -> &AtomicU32 {
        &self.words[(number & MASK) as usize]
    }
}

impl Default for EventRing {
    fn default() -> Self {
        Self::new()
    }
}

/// The end of the ring that `prepare` has.
#[derive(Debug)]
pub struct EventWriter<'a> {
    ring: &'a EventRing,
}

impl<'a> EventWriter<'a> {
    /// Returns the view of the input interrupt.
    #[must_use]
    pub const fn tap(&self) -> EventTap<'a> {
        EventTap { ring: self.ring }
    }

    /// Discards the events that have not been output, and returns the number of the next. Only while
    /// the step interrupt is stopped.
    pub(super) fn discard_pending(&mut self) -> u32 {
        let output = self.ring.output_count.load(Relaxed);
        self.ring.written_count.store(output, Relaxed);
        self.ring
            .word(output)
            .store(StepEvent::NONE.bits(), Relaxed);
        output
    }

    /// Returns whether there are events that have not been output.
    #[must_use]
    pub fn has_pending(&self) -> bool {
        self.ring.output_count.load(Relaxed) != self.ring.written_count.load(Relaxed)
    }

    /// Returns what is to be set up before the step timer is started, if there is an event.
    #[must_use]
    pub fn set_up(&mut self) -> Option<Upcoming> {
        let number = self.ring.output_count.load(Relaxed);
        let event = self.ring.pending_event(number);
        if event == StepEvent::NONE {
            return None;
        }
        let following = self.ring.pending_event(number.wrapping_add(1));
        self.ring.set_following(following);
        Some(Upcoming { event, following })
    }

    /// Returns the event unknown to the step interrupt: it has been pushed behind an event that was the last when set
    /// up. To be called once after events have been pushed; the event is for the step timer and, after that, for
    /// [`EventWriter::append`].
    #[must_use]
    pub fn appended_late(&self, segments: &SegmentRing) -> Option<StepEvent> {
        if self.ring.following() != StepEvent::NONE || !segments.is_running() {
            return None;
        }
        // As long as it knows of no other event, the step interrupt can only stop. The number must be that of the event
        // set up then.
        compiler_fence(SeqCst);
        let set_up = self.ring.output_count.load(Relaxed);
        let event = self.ring.pending_event(set_up.wrapping_add(1));
        (event != StepEvent::NONE).then_some(event)
    }

    /// Appends an event for the step interrupt, now that the step timer knows its time. Without
    /// effect if the step interrupt has stopped meanwhile.
    pub fn append(&mut self, event: StepEvent) {
        // Not earlier: the step interrupt relies on the timer when it finds the event.
        compiler_fence(SeqCst);
        self.ring.set_following(event);
    }

    /// Returns the event of a number, which waits or is among those output last, one less than
    /// [`EVENT_RING`].
    pub(super) fn event(&self, number: u32) -> StepEvent {
        StepEvent::from_bits(self.ring.word(number).load(Relaxed))
    }

    /// Returns how many events can be pushed now.
    #[must_use]
    pub fn room(&self) -> u32 {
        self.ring.room()
    }

    /// Pushes an event, if there is room, and returns whether there was. For programs that play events of their
    /// own: the [`Generator`](super::Generator) pushes many at once.
    pub fn push(&mut self, event: StepEvent) -> bool {
        let mut batch = self.begin();
        let has_room = batch.room() != 0;
        if has_room {
            batch.push(event);
            batch.publish();
        }
        has_room
    }

    /// Begins to push events.
    pub(super) fn begin(&mut self) -> EventBatch<'_> {
        let number = self.ring.written_count.load(Relaxed);
        EventBatch {
            ring: self.ring,
            number,
            end_number: number.wrapping_add(self.ring.room()),
        }
    }
}

/// Events being pushed: the writer's counters of the ring.
#[derive(Debug, Clone, Copy)]
pub(super) struct EventBatch<'a> {
    ring: &'a EventRing,
    number: u32,
    /// The number of the first event for which there was no room at the beginning.
    end_number: u32,
}

impl EventBatch<'_> {
    /// Returns how many events can still be pushed.
    pub(super) fn room(&self) -> u32 {
        self.end_number.wrapping_sub(self.number)
    }

    /// Returns the number of the next event.
    pub(super) const fn number(&self) -> u32 {
        self.number
    }

    /// Pushes an event, for the reader to see; there must be room.
    pub(super) fn push(&mut self, event: StepEvent) {
        let following = self.number.wrapping_add(1);
        self.ring
            .word(following)
            .store(StepEvent::NONE.bits(), Relaxed);
        self.commit(event);
        self.number = following;
    }

    /// Pushes an event behind a reserved event: the reader does not see it yet.
    pub(super) fn push_uncommitted(&mut self, event: StepEvent) {
        self.ring.word(self.number).store(event.bits(), Relaxed);
        self.number = self.number.wrapping_add(1);
    }

    /// Reserves the word of the first of several events that the reader is to see together, for
    /// [`EventBatch::commit_first`].
    pub(super) fn reserve_first(&mut self) -> Self {
        let held = *self;
        self.number = self.number.wrapping_add(1);
        held
    }

    /// Stores the first event in the word reserved: with it the reader sees the events behind it.
    pub(super) fn commit_first(&mut self, mut held: Self, event: StepEvent) {
        let ring = self.ring;
        ring.word(self.number)
            .store(StepEvent::NONE.bits(), Relaxed);
        held.commit(event);
    }

    fn commit(&mut self, event: StepEvent) {
        // The reader must not see the event before the word behind it.
        compiler_fence(SeqCst);
        self.ring.word(self.number).store(event.bits(), Relaxed);
    }

    /// Counts all events pushed, for the writer.
    pub(super) fn publish(&mut self) {
        self.ring.written_count.store(self.number, Relaxed);
    }
}

/// The events that are to be set up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Upcoming {
    /// The event that comes next, whose time the timer knows.
    pub event: StepEvent,
    /// The event behind it, or [`StepEvent::NONE`]: the timer needs its time now.
    pub following: StepEvent,
}

/// The view that `inputs`, `segment_start` and `interpret` have of a ring: its counts.
#[derive(Debug, Clone, Copy)]
pub struct EventTap<'a> {
    ring: &'a EventRing,
}

impl EventTap<'_> {
    /// Returns how many events have been output, wrapping: exactly, at any instant, in any task below
    /// the step interrupt.
    #[must_use]
    pub fn output_count(self) -> u32 {
        self.ring.output_count.load(Relaxed)
    }

    /// Returns the number of events that may have come too late, wrapping.
    #[must_use]
    pub fn late(self) -> u32 {
        self.ring.late()
    }

    /// Returns how many events have been output or are set up, wrapping, and whether the step
    /// interrupt runs. If it sets up a segment's first event or stops meanwhile, it releases
    /// `segment_start` again.
    pub(super) fn committed(self, segments: &SegmentRing) -> (u32, bool) {
        let output = self.output_count();
        compiler_fence(SeqCst);
        if segments.is_running() {
            return (output.wrapping_add(1), true);
        }
        // The step interrupt may have stopped in between.
        compiler_fence(SeqCst);
        (self.output_count(), false)
    }

    /// Ends the motion where it is, after the step timer has been halted: the event that was set up
    /// will not happen. For `inputs`; `prepare` then calls
    /// [`Generator::discard_unplayed`](super::Generator::discard_unplayed).
    pub fn halt(self, segments: &SegmentRing) {
        self.ring.set_following(StepEvent::NONE);
        segments.halt();
    }
}

/// The end of the ring that the step interrupt has.
#[derive(Debug)]
pub struct EventReader<'a> {
    ring: &'a EventRing,
}

impl EventReader<'_> {
    /// Counts the event that was set up as output, and returns what is to be set up next; `None`
    /// after the last event. An event that is pushed behind the last event, after the last was set up, comes too late,
    /// but for [`EventWriter::append`].
    pub fn advance(&mut self) -> Option<Upcoming> {
        let ring = self.ring;
        let set_up = ring.output_count.load(Relaxed).wrapping_add(1);
        ring.output_count.store(set_up, Relaxed);
        let following = ring.pending_event(set_up.wrapping_add(1));
        let event = ring.following();
        ring.set_following(following);
        (event != StepEvent::NONE).then_some(Upcoming { event, following })
    }

    /// Counts `late` late events, one or none.
    pub fn count_late(&mut self, late: u32) {
        let late = self.ring.late().wrapping_add(late);
        self.ring.late_count.store(late, Relaxed);
    }
}

#[cfg(test)]
mod tests;
