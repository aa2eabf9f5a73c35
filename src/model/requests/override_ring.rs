//! The queue of overrides from the receiver to `prepare`, oldest first.

use crate::atomic::{
    AtomicU8, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

/// Overrides that may wait: more than the bytes of 1 ms at 115 200 baud (11.5). `prepare` runs
/// after each override. Of more the oldest are dropped.
pub const OVERRIDES: usize = 16;

#[derive(Debug)]
pub(super) struct OverrideRing {
    bytes: [AtomicU8; OVERRIDES],
    written: AtomicU32,
    read: AtomicU32,
}

impl OverrideRing {
    pub(super) const fn new() -> Self {
        Self {
            bytes: [const { AtomicU8::new(0) }; OVERRIDES],
            written: AtomicU32::new(0),
            read: AtomicU32::new(0),
        }
    }

    /// Returns the number of overrides so far, wrapping.
    pub(super) fn written(&self) -> u32 {
        self.written.load(Relaxed)
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `Requests::accept`")]
    pub(super) fn enqueue(&self, byte: u8) {
        let number = self.written.load(Relaxed);
        if let Some(slot) = self.bytes.get(number as usize % OVERRIDES) {
            slot.store(byte, Relaxed);
        }
        compiler_fence(SeqCst);
        self.written.store(number.wrapping_add(1), Relaxed);
    }

    /// Dequeues all bytes, with one more in front of them unless it is 0.
    pub(super) fn dequeue_all(&self, first: u8) -> Option<TakenOverrides> {
        let (read, written) = (self.read.load(Relaxed), self.written.load(Relaxed));
        compiler_fence(SeqCst);
        let mut bytes = self.bytes.each_ref().map(|byte| byte.load(Relaxed));
        compiler_fence(SeqCst);
        self.read.store(written, Relaxed);
        // Of more than there is room for, also while they were read, the oldest have been overwritten.
        let lost = self.written.load(Relaxed).wrapping_sub(read);
        let lost = lost.saturating_sub(OVERRIDES as u32);
        let mut next = read.wrapping_add(lost);
        let mut remaining = written.wrapping_sub(read).saturating_sub(lost);
        if first != 0 {
            if remaining < OVERRIDES as u32 {
                next = next.wrapping_sub(1);
                remaining += 1;
            }
            if let Some(slot) = bytes.get_mut(next as usize % OVERRIDES) {
                *slot = first;
            }
        }
        let taken = TakenOverrides {
            bytes,
            next,
            remaining,
        };
        (remaining != 0).then_some(taken)
    }
}

/// Bytes that have been dequeued, oldest first.
#[derive(Debug)]
pub(super) struct TakenOverrides {
    bytes: [u8; OVERRIDES],
    next: u32,
    remaining: u32,
}

impl Iterator for TakenOverrides {
    type Item = u8;

    #[inline]
    fn next(&mut self) -> Option<u8> {
        self.remaining = self.remaining.checked_sub(1)?;
        let byte = self.bytes.get(self.next as usize % OVERRIDES).copied();
        self.next = self.next.wrapping_add(1);
        byte
    }
}
