//! How long the motion lasts that has been sent to the machine: what `$797` bounds.
//!
//! Owns the duration of all moves sent so far, at the end of each of the newest entries: a difference of two is that of
//! what lies between. Dwells have none: few entries can wait behind one. Entries are finished in their order, but for
//! speeds of the spindle, which are not in it.

use crate::{model::queues::ENTRY_RING, motion::BLOCKS};

/// Ends of entries that are known, a power of two: more than can be unfinished.
const KNOWN_ENTRIES: usize = 256;
const _: () = assert!(BLOCKS + 2 * ENTRY_RING < KNOWN_ENTRIES);

/// The durations of what has been sent.
#[derive(Debug)]
pub(super) struct QueuedDuration {
    /// Number of entries, wrapping.
    count: u32,
    /// Duration up to the end of each of the newest, ms, wrapping; in a ring.
    ends_ms: [u32; KNOWN_ENTRIES],
}

impl Default for QueuedDuration {
    fn default() -> Self {
        Self {
            count: 0,
            ends_ms: [0; KNOWN_ENTRIES],
        }
    }
}

impl QueuedDuration {
    /// Adds an entry; `end_ms` is [`Router::duration_ms`](crate::path::Router::duration_ms), its own included.
    pub(super) fn add(&mut self, end_ms: u32) {
        self.count = self.count.wrapping_add(1);
        self.ends_ms[self.count as usize % KNOWN_ENTRIES] = end_ms;
    }

    /// Returns the duration of so many of the newest entries, ms.
    pub(super) fn of_newest_ms(&self, entries: u32) -> u32 {
        self.end_ms(0).wrapping_sub(self.end_ms(entries))
    }

    /// Returns the duration up to the end of the entry that is so many before the newest, ms, wrapping.
    fn end_ms(&self, entries: u32) -> u32 {
        self.ends_ms[self.count.wrapping_sub(entries) as usize % KNOWN_ENTRIES]
    }
}
