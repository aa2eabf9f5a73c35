//! The queue of step events: lock-free, one writer, one reader, one word per event.
//!
//! Two events pass through it for every step, so it is made for that alone: words instead of any
//! type, a constant power of two instead of a length that must be divided by, and no barriers,
//! which a single core does not need between its own tasks (the compiler is told to keep the
//! order). Measured against `heapless::spsc` in `docs/decisions.md`.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed, Ordering::SeqCst, compiler_fence};

use super::{SEGMENT_EVENTS, StepEvent};

/// Events that a ring holds: a power of two.
///
/// The beginning of a segment releases `prepare`, so a full ring must hold one, and enough events
/// behind it for `prepare` to catch up: at the shortest spacing 1 ms, or 2 ms where no segment is
/// longer than it is meant to be.
pub const EVENT_RING: usize = 2048;
const MASK: u32 = EVENT_RING as u32 - 1;
const _: () = assert!(EVENT_RING as u32 >= SEGMENT_EVENTS * 3 / 2);

/// The ring itself.
#[derive(Debug)]
#[repr(C)]
pub struct EventRing {
    /// Events written so far, wrapping.
    written: AtomicU32,
    /// Events read so far, wrapping.
    read: AtomicU32,
    words: [AtomicU32; EVENT_RING],
}

impl EventRing {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            words: [const { AtomicU32::new(0) }; EVENT_RING],
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

impl EventWriter<'_> {
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
