//! The queues of bytes from and to the sender: one writer, one reader, lock-free.
//!
//! As the ring of step events, and for the same reasons: a byte is queued and taken for every byte
//! of a program, so there are no barriers, which a single core does not need between its own tasks
//! (the compiler is told to keep the order), and no division. Measured in `docs/benchmarks.md`.

use core::{
    hint::cold_path,
    slice::Iter,
    sync::atomic::{
        AtomicU8, AtomicUsize,
        Ordering::{Relaxed, SeqCst},
        compiler_fence,
    },
};

/// A queue of bytes in `B`: see [`Bytes`].
#[derive(Debug)]
pub struct ByteRing<B: ?Sized = [AtomicU8]> {
    /// Bytes written so far, wrapping: the next one's place is its number, modulo the places.
    written: AtomicUsize,
    /// The number of the byte for which there is no room: bytes read so far and what may wait,
    /// wrapping.
    limit: AtomicUsize,
    /// Bytes written up to the last one that may end a line, wrapping.
    ended: AtomicUsize,
    bytes: B,
}

/// A queue of up to `N - 1` bytes; `N` is a power of two.
pub type Bytes<const N: usize> = ByteRing<[AtomicU8; N]>;

impl<const N: usize> Bytes<N> {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two(), "places wrap by a mask") };
        Self {
            written: AtomicUsize::new(0),
            limit: AtomicUsize::new(N - 1),
            ended: AtomicUsize::new(0),
            bytes: [const { AtomicU8::new(0) }; N],
        }
    }

    /// Its two ends, each for one task.
    pub const fn split(&mut self) -> (ByteWriter<'_>, ByteReader<'_>) {
        let ring: &ByteRing = self;
        (ByteWriter { ring }, ByteReader { ring })
    }

    /// Bytes that there is room for.
    #[must_use]
    pub fn free(&self) -> usize {
        let ring: &ByteRing = self;
        ring.room()
    }

    /// Whether no byte waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let ring: &ByteRing = self;
        ring.has_none()
    }
}

impl<const N: usize> Default for Bytes<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl ByteRing {
    /// The place of a byte by its number.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `ByteWriter::enqueue`")]
    fn slot(&self, number: usize) -> Option<&AtomicU8> {
        self.bytes.get(number & self.bytes.len().wrapping_sub(1))
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `ByteWriter::enqueue`")]
    const fn capacity(&self) -> usize {
        self.bytes.len().saturating_sub(1)
    }

    /// Bytes that there is room for.
    #[inline]
    fn room(&self) -> usize {
        let limit = self.limit.load(Relaxed);
        limit.wrapping_sub(self.written.load(Relaxed))
    }

    /// The number of the oldest byte.
    #[inline]
    fn oldest(&self) -> usize {
        self.limit.load(Relaxed).wrapping_sub(self.capacity())
    }

    #[inline]
    fn has_none(&self) -> bool {
        self.room() == self.capacity()
    }

    #[inline]
    fn len(&self) -> usize {
        self.capacity().wrapping_sub(self.room())
    }
}

/// The end that bytes are put in.
#[derive(Debug)]
pub struct ByteWriter<'a> {
    ring: &'a ByteRing,
}

impl ByteWriter<'_> {
    /// The same end once more, for one who may use it while its task cannot run.
    #[must_use]
    pub const fn second_writer(&self) -> Self {
        Self { ring: self.ring }
    }

    /// Puts a byte, and tells how many have been put so far, wrapping.
    ///
    /// # Errors
    /// The byte, when there is no room.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "called from RAM, where nothing in flash may be"
    )]
    pub fn enqueue(&mut self, byte: u8) -> Result<usize, u8> {
        let number = self.ring.written.load(Relaxed);
        if number == self.ring.limit.load(Relaxed) {
            cold_path();
            return Err(byte);
        }
        let slot = self.ring.slot(number).ok_or(byte)?;
        slot.store(byte, Relaxed);
        // The reader must not see the number before the byte.
        compiler_fence(SeqCst);
        let next = number.wrapping_add(1);
        self.ring.written.store(next, Relaxed);
        Ok(next)
    }

    /// Has the reader know that a line may end with the byte put last, which this is the number of.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `enqueue`")]
    pub fn end_line(&mut self, number: usize) {
        self.ring.ended.store(number, Relaxed);
    }

    /// Puts all of some bytes, or none where there is no room for all; whether it has.
    pub fn append(&mut self, bytes: &[u8]) -> bool {
        if self.ring.room() < bytes.len() {
            return false;
        }
        let mut number = self.ring.written.load(Relaxed);
        for &byte in bytes {
            if let Some(slot) = self.ring.slot(number) {
                slot.store(byte, Relaxed);
            }
            number = number.wrapping_add(1);
        }
        // The reader must not see the number before the bytes.
        compiler_fence(SeqCst);
        self.ring.written.store(number, Relaxed);
        true
    }

    /// Bytes that may wait.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.ring.capacity()
    }

    /// Bytes that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// Whether no byte waits.
    #[inline]
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ring.has_none()
    }
}

/// The end that bytes are taken from, oldest first.
#[derive(Debug)]
pub struct ByteReader<'a> {
    ring: &'a ByteRing,
}

impl ByteReader<'_> {
    /// Takes the oldest byte.
    #[inline]
    pub fn dequeue(&mut self) -> Option<u8> {
        if self.ring.has_none() {
            return None;
        }
        compiler_fence(SeqCst);
        let number = self.ring.oldest();
        let byte = self.ring.slot(number)?.load(Relaxed);
        // The writer must not reuse the place before the byte has been read.
        compiler_fence(SeqCst);
        let limit = self.ring.limit.load(Relaxed).wrapping_add(1);
        self.ring.limit.store(limit, Relaxed);
        Some(byte)
    }

    /// Whether a byte may wait that ends a line.
    #[inline]
    #[must_use]
    pub fn may_have_line(&self) -> bool {
        let ended = self.ring.ended.load(Relaxed);
        let ahead = ended.wrapping_sub(self.ring.oldest()).cast_signed();
        ahead > 0
    }

    /// Lets a function take bytes that wait now, until it has what it wants; whether it has. It is
    /// called again where the ring begins anew, as the bytes that it gets lie in a row.
    #[inline]
    pub fn take_until(&mut self, mut take: impl FnMut(&mut Waiting<'_>) -> bool) -> bool {
        let bytes = &self.ring.bytes;
        let mut number = self.ring.oldest();
        let mut left = self.ring.len();
        compiler_fence(SeqCst);
        let mut has_all = false;
        while left != 0 && !has_all {
            let rest = bytes.get(number & (bytes.len() - 1)..).unwrap_or_default();
            let in_a_row = rest.get(..left).unwrap_or(rest);
            let mut waiting = Waiting(in_a_row.iter());
            has_all = take(&mut waiting);
            let taken = in_a_row.len() - waiting.0.len();
            number = number.wrapping_add(taken);
            left -= taken;
            if waiting.0.len() != 0 {
                break;
            }
        }
        compiler_fence(SeqCst);
        let limit = number.wrapping_add(self.ring.capacity());
        self.ring.limit.store(limit, Relaxed);
        has_all
    }

    /// Bytes that may wait.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.ring.capacity()
    }

    /// Bytes that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// Whether no byte waits.
    #[inline]
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ring.has_none()
    }
}

/// Bytes that waited when [`ByteReader::take_until`] was called.
#[derive(Debug, Clone)]
pub struct Waiting<'a>(Iter<'a, AtomicU8>);

impl Waiting<'_> {
    /// How many they are.
    #[inline]
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    #[inline]
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.len() == 0
    }
}

impl Iterator for Waiting<'_> {
    type Item = u8;

    #[inline]
    fn next(&mut self) -> Option<u8> {
        self.0.next().map(|byte| byte.load(Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_out_in_order_and_never_more_wait_than_fit() {
        let mut ring = Bytes::<8>::new();
        let (mut writer, mut reader) = ring.split();
        let (mut put, mut taken) = (0_u8, 0_u8);
        for round in 0..1000_usize {
            for _ in 0..round * 5 % 10 {
                let is_full = writer.len() == writer.capacity();
                assert_eq!(writer.enqueue(put).is_err(), is_full);
                put = put.wrapping_add(u8::from(!is_full));
            }
            for _ in 0..round * 3 % 9 {
                let is_empty = reader.is_empty();
                let byte = reader.dequeue();
                assert_eq!(byte, (!is_empty).then_some(taken));
                taken = taken.wrapping_add(u8::from(!is_empty));
            }
            let mut wanted = round % 3;
            let waiting = reader.len();
            let has_all = reader.take_until(|bytes| {
                for byte in bytes.take(wanted) {
                    assert_eq!(byte, taken);
                    taken = taken.wrapping_add(1);
                    wanted -= 1;
                }
                wanted == 0
            });
            assert_eq!(has_all, waiting != 0 && waiting >= round % 3);
            assert_eq!(reader.len(), usize::from(put.wrapping_sub(taken)));
        }
    }
}
