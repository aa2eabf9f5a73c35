//! The queue of step events: lock-free, one writer, one reader, one word per event.
//!
//! Two events pass through it for every step, so it is made for that alone: words instead of any
//! type, a constant power of two instead of a length that must be divided by, and no barriers,
//! which a single core does not need between its own tasks (the compiler is told to keep the
//! order). Measured against `heapless::spsc` in `docs/decisions.md`.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed, Ordering::SeqCst, compiler_fence};

use super::{SEGMENT_EVENTS, StepCounts, StepEvent};

/// Events that may wait in a ring.
///
/// The beginning of a segment releases `prepare`, so a full ring must hold one, and enough events
/// behind it for `prepare` to catch up: at the shortest spacing 1 ms, or 2 ms where no segment is
/// longer than it is meant to be.
pub const EVENT_RING: usize = 2048;
const _: () = assert!(EVENT_RING as u32 >= SEGMENT_EVENTS * 3 / 2);
/// Words of a ring, a power of two: as many events as may wait, and those played last, from which
/// `prepare` learns where the machine was at an event.
const WORDS: usize = 2 * EVENT_RING;
const MASK: u32 = WORDS as u32 - 1;
/// Events that a cut marks, so that the step interrupt comes to one even while it preempts.
const CUT_EVENTS: u32 = 4;

/// The ring itself.
#[derive(Debug)]
#[repr(C)]
pub struct EventRing {
    /// Events written so far, wrapping.
    written: AtomicU32,
    /// Events read so far, wrapping.
    read: AtomicU32,
    words: [AtomicU32; WORDS],
}

impl EventRing {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            words: [const { AtomicU32::new(0) }; WORDS],
            written: AtomicU32::new(0),
            read: AtomicU32::new(0),
        }
    }

    /// Its two ends, each for one task.
    pub const fn split(&mut self) -> (EventWriter<'_>, EventReader<'_>) {
        let ring: &Self = self;
        (EventWriter { ring }, EventReader { ring })
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

    /// Drops the events that have not been taken, and tells the number of the next. Only while the
    /// step interrupt stands.
    pub(super) fn drop_waiting(&mut self) -> u32 {
        let read = self.ring.read.load(Relaxed);
        self.ring.written.store(read, Relaxed);
        read
    }

    /// The event of a number, while it is among the last [`EVENT_RING`] taken or waits.
    pub(super) fn event(&self, number: u32) -> StepEvent {
        StepEvent::from_bits(self.ring.word(number).load(Relaxed))
    }

    /// Events that can be put now.
    #[inline]
    #[must_use]
    pub fn room(&self) -> u32 {
        EventBatch {
            ring: self.ring,
            number: self.ring.written.load(Relaxed),
        }
        .room()
    }

    /// Begins to put events.
    #[inline]
    pub(super) fn begin(&mut self) -> EventBatch<'_> {
        EventBatch {
            ring: self.ring,
            number: self.ring.written.load(Relaxed),
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
}

impl EventBatch<'_> {
    /// Events that can still be put.
    #[inline]
    pub(super) fn room(&self) -> u32 {
        // The others are those played last.
        EVENT_RING as u32 - self.number.wrapping_sub(self.ring.read.load(Relaxed))
    }

    /// The number of the next event.
    #[inline]
    pub(super) const fn number(&self) -> u32 {
        self.number
    }

    /// Puts an event. The caller has seen to it that there is room.
    #[inline]
    pub(super) fn put(&mut self, event: StepEvent) {
        self.ring.word(self.number).store(event.bits(), Relaxed);
        self.number = self.number.wrapping_add(1);
    }

    /// Makes an event that has not been published the first of a segment.
    pub(super) fn mark_boundary(&mut self, number: u32) {
        let word = self.ring.word(number);
        let event = StepEvent::from_bits(word.load(Relaxed));
        word.store(event.at_boundary().bits(), Relaxed);
    }

    /// Shows the reader all events put.
    #[inline]
    pub(super) fn publish(&mut self) {
        // The reader must not see the number before the words.
        compiler_fence(SeqCst);
        self.ring.written.store(self.number, Relaxed);
    }
}

/// What the input interrupt sees of a ring.
#[derive(Debug, Clone, Copy)]
pub struct EventTap<'a> {
    ring: &'a EventRing,
}

impl EventTap<'_> {
    /// How many events have been output, wrapping: at any instant, also between any two
    /// instructions of `prepare`, and from any task below the step interrupt.
    ///
    /// While the step interrupt runs, the event taken last is only set up.
    #[inline]
    #[must_use]
    pub fn output(self, counts: &StepCounts) -> u32 {
        // In this order: an interrupt in between that stops has only output what it had set up.
        let set_up = u32::from(counts.is_running());
        compiler_fence(SeqCst);
        self.ring.read.load(Relaxed).wrapping_sub(set_up)
    }

    /// Stops the step interrupt: the event that is set up is the last one. For tasks above
    /// `prepare`, which then calls [`Generator::cut_off`](super::Generator::cut_off).
    ///
    /// The step interrupt looks for this only where segments begin, to pay nothing for it
    /// elsewhere; so the events that wait are made to look like that.
    pub fn cut(self, counts: &StepCounts) {
        counts.ask_cut();
        compiler_fence(SeqCst);
        // It may take events meanwhile.
        // wcet-bound: 4
        for _ in 0..4 {
            let next = self.ring.read.load(Relaxed);
            // wcet-bound: 4
            for number in (0..CUT_EVENTS).map(|ahead| next.wrapping_add(ahead)) {
                self.mark(number);
            }
            compiler_fence(SeqCst);
            if self.ring.read.load(Relaxed).wrapping_sub(next) < CUT_EVENTS {
                return;
            }
        }
    }

    /// Makes an event that waits look like the first of a segment.
    fn mark(self, number: u32) {
        let waiting = self.ring.written.load(Relaxed).wrapping_sub(number);
        // What is not published yet, `prepare` may be changing.
        if waiting != 0 && waiting <= EVENT_RING as u32 {
            let word = self.ring.word(number);
            let event = StepEvent::from_bits(word.load(Relaxed));
            word.store(event.at_boundary().bits(), Relaxed);
        }
    }
}

/// The end of the step interrupt.
#[derive(Debug)]
pub struct EventReader<'a> {
    ring: &'a EventRing,
}

impl EventReader<'_> {
    /// Takes the oldest event unless a segment begins with it.
    #[inline]
    pub fn take_within_segment(&mut self) -> Option<StepEvent> {
        let number = self.ring.read.load(Relaxed);
        if number == self.ring.written.load(Relaxed) {
            return None;
        }
        compiler_fence(SeqCst);
        let event = StepEvent::from_bits(self.ring.word(number).load(Relaxed));
        if event.is_boundary() {
            return None;
        }
        compiler_fence(SeqCst);
        self.ring.read.store(number.wrapping_add(1), Relaxed);
        Some(event)
    }

    /// Takes the oldest event.
    #[inline]
    pub fn take(&mut self) -> Option<StepEvent> {
        let number = self.ring.read.load(Relaxed);
        if number == self.ring.written.load(Relaxed) {
            return None;
        }
        compiler_fence(SeqCst);
        let bits = self.ring.word(number).load(Relaxed);
        // The writer must not reuse the place before the word has been read.
        compiler_fence(SeqCst);
        self.ring.read.store(number.wrapping_add(1), Relaxed);
        Some(StepEvent::from_bits(bits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_come_out_in_order_over_many_turns_of_the_ring() {
        let mut ring = EventRing::new();
        let (mut writer, mut reader) = ring.split();
        let (mut put, mut taken) = (0, 0);
        for batch in (0..5000_u32).map(|k| k * 7 % (EVENT_RING as u32 + 1)) {
            for _ in 0..batch.min(writer.room()) {
                let mut events = writer.begin();
                events.put(StepEvent::new(put % StepEvent::MAX_TICKS, put, 0));
                events.publish();
                put += 1;
            }
            for _ in 0..(batch * 5 % EVENT_RING as u32) {
                let Some(event) = reader.take() else { break };
                assert_eq!(event.ticks(), taken % StepEvent::MAX_TICKS);
                taken += 1;
            }
            assert_eq!(writer.room(), EVENT_RING as u32 - (put - taken));
        }
        assert!(taken > 100_000);
    }

    #[test]
    fn a_full_ring_has_no_room_and_an_empty_one_no_event() {
        let mut ring = EventRing::new();
        let (mut writer, mut reader) = ring.split();
        assert_eq!(reader.take(), None);
        for _ in 0..EVENT_RING {
            let mut events = writer.begin();
            events.put(StepEvent::default());
            events.publish();
        }
        assert_eq!(writer.room(), 0);
    }
}
