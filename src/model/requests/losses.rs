//! Received bytes that are lost, and which of the lines that wait have lost them.
//!
//! The receiver notes where bytes are missing: the number of the first byte behind the gap. The line with that
//! byte is not what the sender has sent. Where bytes are missing in two places before `interpret` has come to
//! the first, the lines between them count as well.

use crate::atomic::{
    AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

/// How often [`Losses::spread`] looks whether another loss has come.
const TRIES: u32 = 4;

/// Bytes that the receiver has lost.
#[derive(Debug)]
pub(super) struct Losses {
    /// Number of losses, wrapping.
    count: AtomicU32,
    /// Number of losses whose lines have been refused: written by `interpret`.
    handled: AtomicU32,
    /// The first byte behind the oldest gap whose line has not been refused, and behind the newest.
    first: AtomicU32,
    last: AtomicU32,
}

impl Losses {
    pub(super) const fn new() -> Self {
        Self {
            count: AtomicU32::new(0),
            handled: AtomicU32::new(0),
            first: AtomicU32::new(0),
            last: AtomicU32::new(0),
        }
    }

    /// Notes a loss in front of the byte of this number; for the receiver alone.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `Requests::accept`")]
    pub(super) fn note(&self, next: usize) {
        let count = self.count.load(Relaxed);
        let next = next as u32;
        if count == self.handled.load(Relaxed) {
            self.first.store(next, Relaxed);
        }
        self.last.store(next, Relaxed);
        // The reader must not see the count before the places.
        compiler_fence(SeqCst);
        self.count.store(count.wrapping_add(1), Relaxed);
    }

    pub(super) fn count(&self) -> u32 {
        self.count.load(Relaxed)
    }

    /// Returns whether there is a loss whose line has not been refused.
    #[inline]
    pub(super) fn has_any(&self) -> bool {
        self.count() != self.handled.load(Relaxed)
    }

    /// Returns whether the line that ends before the byte of this number has lost bytes; forgets losses in the line and
    /// before it. A loss that comes meanwhile is kept.
    pub(super) fn take_before(&self, end: usize) -> bool {
        let count = self.count();
        if count == self.handled.load(Relaxed) {
            return false;
        }
        compiler_fence(SeqCst);
        let is_before = |place: &AtomicU32| {
            let distance = (end as u32).wrapping_sub(place.load(Relaxed));
            distance.cast_signed() > 0
        };
        if is_before(&self.last) {
            self.handled.store(count, Relaxed);
            return true;
        }
        is_before(&self.first)
    }

    /// Moves the newest gap, if there is one, to the end of what has been received.
    pub(super) fn spread(&self, next: impl Fn() -> usize) {
        // A loss that comes meanwhile is behind what `next` has told: once more.
        for _ in 0..TRIES {
            let count = self.count();
            if !self.has_any() {
                return;
            }
            compiler_fence(SeqCst);
            self.last.store(next() as u32, Relaxed);
            compiler_fence(SeqCst);
            if count == self.count() {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_behind_a_gap_has_lost_bytes_and_no_other() {
        let losses = Losses::new();
        assert!(!losses.take_before(10));
        losses.note(12);
        assert!(losses.has_any());
        assert!(!losses.take_before(11) && !losses.take_before(12));
        assert!(losses.take_before(20));
        assert!(!losses.has_any() && !losses.take_before(30));
        assert_eq!(losses.count(), 1);
    }

    #[test]
    fn lines_between_two_gaps_count_as_having_lost_bytes() {
        let losses = Losses::new();
        losses.note(usize::MAX);
        losses.note(20);
        assert!(!losses.take_before(usize::MAX));
        assert!(losses.take_before(4) && losses.take_before(12) && losses.take_before(30));
        assert!(!losses.take_before(40));
        losses.note(44);
        assert!(!losses.take_before(42) && losses.take_before(46));
        assert_eq!(losses.count(), 3);
    }

    #[test]
    fn what_gets_other_numbers_counts_as_having_lost_bytes_and_what_comes_later_does_not() {
        let losses = Losses::new();
        losses.spread(|| 30);
        assert!(!losses.take_before(31));
        losses.note(12);
        losses.spread(|| 30);
        assert!(losses.take_before(20) && losses.take_before(30) && losses.take_before(36));
        assert!(!losses.take_before(50));
    }
}
