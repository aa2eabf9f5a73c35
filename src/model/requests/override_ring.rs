//! The queue of overrides from the receiver to `prepare`, oldest first.

use core::sync::atomic::{
    AtomicU8, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

/// Overrides that may wait: more than the bytes of 1 ms at 115 200 baud (11.5). `prepare` runs
/// after each override. An override that finds no room is dropped.
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
        if number.wrapping_sub(self.read.load(Relaxed)) < OVERRIDES as u32 {
            if let Some(slot) = self.bytes.get(number as usize % OVERRIDES) {
                slot.store(byte, Relaxed);
            }
            compiler_fence(SeqCst);
            self.written.store(number.wrapping_add(1), Relaxed);
        }
    }

    pub(super) fn dequeue(&self) -> Option<u8> {
        let number = self.read.load(Relaxed);
        if number == self.written.load(Relaxed) {
            return None;
        }
        compiler_fence(SeqCst);
        let byte = self.bytes.get(number as usize % OVERRIDES)?;
        let byte = byte.load(Relaxed);
        compiler_fence(SeqCst);
        self.read.store(number.wrapping_add(1), Relaxed);
        Some(byte)
    }
}
