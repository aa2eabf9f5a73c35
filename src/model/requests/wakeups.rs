//! Wake-ups of `interpret`: the events for which the task waits, and how those of several entries become one.

use core::sync::atomic::{
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use super::Requests;

/// Budget of one wait for [`Awaited::ENTRIES_BATCHED`].
///
/// An entry costs [`ENTRY_COST`]; after the first entry each segment costs 1. The wait ends with
/// four entries, or with 48 segments (34 ms at 0.7 ms each) after one, which bounds the delay of an
/// answer: `tests/protocol/receiving.rs`,
/// `a_wait_for_several_entries_ends_with_four_or_some_time_after_one`.
pub(super) const BATCH_BUDGET: u8 = 64;
const ENTRY_COST: u8 = 16;

/// A set of events that release `interpret`, besides a change of the machine's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Awaited(pub(super) u8);

impl Awaited {
    /// The empty set.
    pub const NONE: Self = Self(0);
    /// The end of a line.
    pub const LINE: Self = Self(1);
    /// Room in the send queue.
    pub const ROOM: Self = Self(2);
    /// An entry dequeued by `prepare`.
    pub const ENTRIES: Self = Self(4);
    /// A segment made by `prepare`: the end of the known motion comes nearer.
    pub const SEGMENTS: Self = Self(8);
    /// Several entries dequeued by `prepare`, or one entry and a number of segments: with many
    /// entries to enqueue, `interpret` need not run for each.
    pub const ENTRIES_BATCHED: Self = Self(16);
    /// Every event.
    pub const ALL: Self = Self(15);

    /// Returns the union of two sets.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Requests {
    /// Sets the events that release `interpret`; for that task alone.
    ///
    /// The task awaits [`Awaited::ALL`] before it looks for work, and afterwards the events that it
    /// needs: no event is lost in between.
    pub fn wake_on(&self, awaited: Awaited) {
        compiler_fence(SeqCst);
        self.awaited.store(awaited.0, Relaxed);
        compiler_fence(SeqCst);
    }

    /// Begins a wait for [`Awaited::ENTRIES_BATCHED`]; for `interpret` alone, before it looks for
    /// work.
    pub fn begin_batch(&self) {
        self.batch_budget.store(BATCH_BUDGET, Relaxed);
    }

    /// Returns whether an event releases `interpret`; for the task that causes the event alone.
    #[inline]
    #[must_use]
    pub fn awaits(&self, event: Awaited) -> bool {
        let awaited = self.awaited.load(Relaxed);
        awaited & event.0 != 0
            || awaited & Awaited::ENTRIES_BATCHED.0 != 0 && self.completes_batch(event)
    }

    /// Counts an event of a batch. Returns whether the batch is complete.
    #[inline]
    fn completes_batch(&self, event: Awaited) -> bool {
        let budget = self.batch_budget.load(Relaxed);
        let cost = match event {
            Awaited::ENTRIES => ENTRY_COST,
            Awaited::SEGMENTS if budget < BATCH_BUDGET => 1,
            _ => return false,
        };
        let remaining = budget.saturating_sub(cost);
        self.batch_budget.store(remaining, Relaxed);
        remaining == 0
    }

    /// Returns whether the end of a line releases `interpret`; for the receiver alone.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    pub(crate) fn awaits_line(&self) -> bool {
        self.awaited.load(Relaxed) & Awaited::LINE.0 != 0
    }
}
