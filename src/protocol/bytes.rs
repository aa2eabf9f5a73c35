//! The queues of bytes from and to the sender: one writer, one reader, lock-free.
//!
//! # Cost
//! As the ring of step events: no barriers, which a single core does not need between its own tasks
//! (compiler fences keep the order), and no division. The receiver also enqueues from RAM, where it
//! can call nothing in flash. Measured in `docs/benchmarks.md`.

use core::{hint::cold_path, slice::Iter};

use crate::{
    atomic::{
        AtomicU8, AtomicUsize,
        Ordering::{Relaxed, SeqCst},
        compiler_fence,
    },
    model::ReceivedPosition,
};

/// What is missing of a character, as [`ByteRing`] keeps it.
#[derive(Clone, Copy)]
pub(super) struct CharacterRest(usize);

impl CharacterRest {
    /// Nothing is missing.
    pub(super) const NOTHING: Self = Self(0);
}

/// A queue of bytes stored in `B`: see [`Bytes`].
#[derive(Debug)]
pub struct ByteRing<B: ?Sized = [AtomicU8]> {
    /// Number of bytes written so far, wrapping: the next byte's number. Its slot is the number modulo
    /// the slots.
    written: AtomicUsize,
    /// Number of the first byte without room: bytes read so far plus the capacity, wrapping.
    limit: AtomicUsize,
    /// Number of bytes written up to the last possible line end, wrapping.
    ended: AtomicUsize,
    /// The number of the byte that continues a character in UTF-8, plus the missing part of the character, wrapping:
    /// its first byte in the highest eight bits, shifted left by the number of bytes so far. The highest bit is set
    /// while another byte follows.
    character: AtomicUsize,
    bytes: B,
}

/// A queue of up to `N - 1` bytes; `N` is a power of two.
pub type Bytes<const N: usize> = ByteRing<[AtomicU8; N]>;

impl<const N: usize> Bytes<N> {
    /// An empty queue.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two(), "slots wrap by a mask") };
        Self {
            written: AtomicUsize::new(0),
            limit: AtomicUsize::new(N - 1),
            ended: AtomicUsize::new(0),
            character: AtomicUsize::new(0),
            bytes: [const { AtomicU8::new(0) }; N],
        }
    }

    /// Returns a writer.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `ByteWriter::enqueue`")]
    pub(super) const fn writer(&self) -> ByteWriter<'_> {
        ByteWriter { ring: self }
    }

    /// Returns the two ends, each for one task.
    pub const fn split(&mut self) -> (ByteWriter<'_>, ByteReader<'_>) {
        let ring: &Self = self;
        (ring.writer(), ring.reader())
    }

    pub(super) const fn reader(&self) -> ByteReader<'_> {
        ByteReader { ring: self }
    }

    /// Returns the number of bytes that there is room for.
    #[must_use]
    pub fn free(&self) -> usize {
        let ring: &ByteRing = self;
        ring.room()
    }

    /// Returns whether no byte waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let ring: &ByteRing = self;
        ring.has_none()
    }

    /// Returns the number of the next byte to be enqueued, wrapping.
    #[must_use]
    pub fn written(&self) -> usize {
        self.written.load(Relaxed)
    }
}

impl<const N: usize> Default for Bytes<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl ByteRing {
    /// Returns the slot of a byte by its number.
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

    /// Returns the number of bytes that there is room for.
    #[inline]
    fn room(&self) -> usize {
        let limit = self.limit.load(Relaxed);
        limit.wrapping_sub(self.written.load(Relaxed))
    }

    /// Returns the number of the oldest byte.
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

/// The writing end.
#[derive(Debug)]
pub struct ByteWriter<'a> {
    ring: &'a ByteRing,
}

impl<'a> ByteWriter<'a> {
    /// Returns what tells how many bytes are enqueued.
    #[must_use]
    pub const fn count(&self) -> ByteCount<'a> {
        ByteCount { ring: self.ring }
    }

    /// Enqueues a byte. Returns the number of bytes enqueued so far, wrapping.
    ///
    /// # Errors
    /// The byte, when the queue is full.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "called from RAM, where nothing in flash may be"
    )]
    pub fn enqueue(&mut self, byte: u8) -> Result<usize, u8> {
        self.enqueue_behind(self.enqueued(), byte)
    }

    /// Enqueues a byte behind as many as have been enqueued so far, as [`Self::enqueue`] does.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `enqueue`")]
    pub(super) fn enqueue_behind(&mut self, number: usize, byte: u8) -> Result<usize, u8> {
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

    /// Enqueues as many bytes as there is room for. Returns how many, and whether one may end a line.
    pub(super) fn enqueue_some(&mut self, bytes: &[u8]) -> (usize, bool) {
        let first = self.enqueued();
        let limit = self.ring.limit.load(Relaxed);
        let (mut number, mut may_end_line) = (first, false);
        // wcet-bound: PACKET_BYTES: the bytes of a packet
        for &byte in bytes {
            // Counted out instead, the loop is unrolled: that takes more lines of flash, and more time in the worst case.
            if number == limit {
                break;
            }
            if let Some(slot) = self.ring.slot(number) {
                slot.store(byte, Relaxed);
            }
            number = number.wrapping_add(1);
            may_end_line |= byte <= b'\r' || byte >= 0x80;
        }
        // The reader must not see the number before the bytes.
        compiler_fence(SeqCst);
        self.ring.written.store(number, Relaxed);
        (number.wrapping_sub(first), may_end_line)
    }

    /// Returns the part of a character that is missing after a byte from 0x80 on; `None` where the byte stands alone.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `enqueue`")]
    pub(super) fn rest_of_character(&self, number: usize, byte: u8) -> Option<CharacterRest> {
        let next = self.ring.character.load(Relaxed);
        let rest = if byte < 0xc0 {
            next.wrapping_sub(number)
        } else {
            usize::from(byte) << 24
        };
        (rest & 0x80ff_ffff == 1 << 31).then_some(CharacterRest(rest << 1))
    }

    /// Awaits the rest of a character at a number.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `enqueue`")]
    pub(super) fn await_rest(&mut self, number: usize, rest: CharacterRest) {
        let next = number.wrapping_add(rest.0);
        self.ring.character.store(next, Relaxed);
    }

    /// Returns the number of bytes enqueued so far, wrapping.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `enqueue`")]
    #[must_use]
    pub fn enqueued(&self) -> usize {
        self.ring.written.load(Relaxed)
    }

    /// Marks the byte enqueued last, of this number, as a possible line end.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `enqueue`")]
    pub fn end_line(&mut self, number: usize) {
        self.ring.ended.store(number, Relaxed);
    }

    /// Enqueues all bytes, or none when there is no room for all. Returns whether there was room.
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

    /// Returns the number of bytes that may wait.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.ring.capacity()
    }

    /// Returns the number of bytes that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// Returns whether no byte waits.
    #[inline]
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ring.has_none()
    }
}

/// Tells how many bytes are enqueued, for a task that neither enqueues nor takes them.
#[derive(Debug, Clone, Copy)]
pub struct ByteCount<'a> {
    ring: &'a ByteRing,
}

impl ByteCount<'_> {
    /// Returns the number of bytes enqueued so far, wrapping.
    #[inline]
    #[must_use]
    pub fn enqueued(&self) -> usize {
        self.ring.written.load(Relaxed)
    }

    /// Returns the number of the oldest byte whose slot no other one has.
    pub(super) fn oldest_kept(&self) -> usize {
        self.enqueued().wrapping_sub(self.ring.capacity())
    }

    /// Returns a byte by its number, also one that has been taken.
    pub(super) fn byte(&self, number: usize) -> u8 {
        let slot = self.ring.slot(number);
        slot.map_or(0, |slot| slot.load(Relaxed))
    }
}

/// The reading end, oldest byte first.
#[derive(Debug)]
pub struct ByteReader<'a> {
    ring: &'a ByteRing,
}

impl ByteReader<'_> {
    /// Dequeues the oldest byte.
    #[inline]
    pub fn dequeue(&mut self) -> Option<u8> {
        if self.ring.has_none() {
            return None;
        }
        compiler_fence(SeqCst);
        let number = self.ring.oldest();
        let byte = self.ring.slot(number)?.load(Relaxed);
        // The writer must not reuse the slot before the byte has been read.
        compiler_fence(SeqCst);
        let limit = self.ring.limit.load(Relaxed).wrapping_add(1);
        self.ring.limit.store(limit, Relaxed);
        Some(byte)
    }

    /// Returns the number of the oldest byte that waits, or of the next to come, wrapping.
    #[must_use]
    pub fn oldest(&self) -> usize {
        self.ring.oldest()
    }

    /// Returns the number of the next byte to come, wrapping.
    #[must_use]
    pub fn written(&self) -> usize {
        self.ring.written.load(Relaxed)
    }

    /// Returns the byte of a number, if it waits; it stays.
    #[inline]
    #[must_use]
    pub fn peek(&self, number: usize) -> u8 {
        let slot = self.ring.slot(number);
        slot.map_or(0, |slot| slot.load(Relaxed))
    }

    /// Replaces a byte that waits, by its number.
    pub fn replace(&self, number: usize, byte: u8) {
        if let Some(slot) = self.ring.slot(number) {
            slot.store(byte, Relaxed);
        }
    }

    /// Returns whether a possible line end waits.
    #[inline]
    #[must_use]
    pub fn may_have_line(&self) -> bool {
        let ended = self.ring.ended.load(Relaxed);
        let ahead = ended.wrapping_sub(self.ring.oldest()).cast_signed();
        ahead > 0
    }

    /// Dequeues the waiting bytes that a function consumes. Returns whether the function returned true. The function
    /// gets contiguous bytes: it is called a second time where the ring wraps, unless it returned true or left bytes.
    #[inline]
    pub fn take_until(&mut self, mut consume: impl FnMut(&mut Waiting<'_>) -> bool) -> bool {
        let bytes = &self.ring.bytes;
        let mut number = self.ring.oldest();
        let mut remaining = self.ring.len();
        compiler_fence(SeqCst);
        let mut is_complete = false;
        while remaining != 0 && !is_complete {
            let to_end = bytes.get(number & (bytes.len() - 1)..).unwrap_or_default();
            let contiguous = to_end.get(..remaining).unwrap_or(to_end);
            let mut waiting = Waiting(contiguous.iter());
            is_complete = consume(&mut waiting);
            let consumed = contiguous.len() - waiting.0.len();
            number = number.wrapping_add(consumed);
            remaining -= consumed;
            if waiting.0.len() != 0 {
                break;
            }
        }
        compiler_fence(SeqCst);
        let limit = number.wrapping_add(self.ring.capacity());
        self.ring.limit.store(limit, Relaxed);
        is_complete
    }

    /// Returns the number of waiting bytes that were received before a mark.
    #[must_use]
    pub fn waiting_before(&self, mark: ReceivedPosition) -> usize {
        mark.distance_from(self.ring.oldest()).min(self.ring.len())
    }

    /// Returns whether a line ends among the waiting bytes from one number to another.
    #[must_use]
    pub fn has_line_end(&self, start: usize, end: usize) -> bool {
        let [older, newer] = self.waiting();
        let mut bytes = older.chain(newer).take(end).skip(start);
        bytes.any(|byte| matches!(byte, b'\n' | b'\r'))
    }

    /// Dequeues bytes behind the `kept` oldest ones, up to one for which a function returns true. Those
    /// that are kept move up, over the places of the others.
    pub fn take_behind(&mut self, kept: usize, mut ends: impl FnMut(u8) -> bool) {
        let oldest = self.ring.oldest();
        let [older, newer] = self.waiting();
        let mut consumed = 0;
        for byte in older.chain(newer).skip(kept) {
            consumed += 1;
            if ends(byte) {
                break;
            }
        }
        for back in 1..=kept {
            let place = oldest.wrapping_add(kept - back);
            let to = place.wrapping_add(consumed);
            if let (Some(from), Some(to)) = (self.ring.slot(place), self.ring.slot(to)) {
                to.store(from.load(Relaxed), Relaxed);
            }
        }
        self.consume(consumed);
    }

    /// Removes all waiting bytes of a value before the number `end`; the other bytes move up to this number. Returns
    /// the new number of `place`.
    pub fn remove(&mut self, value: u8, end: usize, place: usize) -> usize {
        let n = end.wrapping_sub(self.ring.oldest());
        let mut to = end;
        let mut moved = place;
        for back in 1..=n.min(self.ring.len()) {
            let from = end.wrapping_sub(back);
            let byte = self
                .ring
                .slot(from)
                .map_or(value, |slot| slot.load(Relaxed));
            if byte != value {
                to = to.wrapping_sub(1);
                self.replace(to, byte);
            }
            if from == place {
                moved = to;
            }
        }
        let removed = to.wrapping_sub(self.ring.oldest());
        self.consume(removed);
        moved
    }

    /// Returns the waiting bytes: first up to the end of the ring, then from its beginning.
    #[inline]
    #[must_use]
    pub fn waiting(&self) -> [Waiting<'_>; 2] {
        let bytes = &self.ring.bytes;
        let oldest = self.ring.oldest() & (bytes.len() - 1);
        let n = self.ring.len();
        compiler_fence(SeqCst);
        let older = bytes.get(oldest..).unwrap_or_default();
        let older = older.get(..n).unwrap_or(older);
        let newer = bytes.get(..n - older.len()).unwrap_or_default();
        [Waiting(older.iter()), Waiting(newer.iter())]
    }

    /// Removes the `n` oldest bytes, which wait.
    #[inline]
    pub fn consume(&mut self, n: usize) {
        // The writer must not reuse their places before the bytes have been read.
        compiler_fence(SeqCst);
        let limit = self.ring.limit.load(Relaxed).wrapping_add(n);
        self.ring.limit.store(limit, Relaxed);
    }

    /// Returns the number of bytes that may wait.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.ring.capacity()
    }

    /// Returns the number of bytes that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// Returns whether no byte waits.
    #[inline]
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ring.has_none()
    }
}

/// Contiguous bytes that waited when they were asked for.
#[derive(Debug, Clone)]
pub struct Waiting<'a>(Iter<'a, AtomicU8>);

impl Iterator for Waiting<'_> {
    type Item = u8;

    #[inline]
    fn next(&mut self) -> Option<u8> {
        self.0.next().map(|byte| byte.load(Relaxed))
    }

    #[inline]
    fn size_hint(&self) -> (usize, Option<usize>) {
        self.0.size_hint()
    }
}

impl ExactSizeIterator for Waiting<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_that_are_kept_stay_while_those_behind_them_are_taken() {
        /// Where a line ends.
        const END: usize = 12;
        for begin in 0..16 {
            let line_end = if begin % 2 == 0 { b'\n' } else { b'\r' };
            let byte = |number: usize| {
                if number == END {
                    line_end
                } else {
                    b'a' + number as u8
                }
            };
            for kept in 0..=15 {
                let mut ring = Bytes::<16>::new();
                let (mut writer, mut reader) = ring.split();
                for _ in 0..begin {
                    assert!(writer.enqueue(0).is_ok() && reader.dequeue().is_some());
                }
                let mut mark = ReceivedPosition::new(writer.enqueued());
                for number in 0..15 {
                    assert!(writer.enqueue(byte(number)).is_ok());
                    if number + 1 == kept {
                        mark = ReceivedPosition::new(writer.enqueued());
                    }
                }
                assert_eq!(reader.waiting_before(mark), kept);
                assert_eq!(reader.has_line_end(kept, 15), kept <= END);
                assert!(!reader.has_line_end(kept, END));
                let mut taken = std::vec::Vec::new();
                reader.take_behind(kept, |byte| {
                    taken.push(byte);
                    byte == line_end
                });
                let end = if kept <= END { END + 1 } else { 15 };
                let expected = |numbers: core::ops::Range<usize>| numbers.map(byte);
                assert!(taken.into_iter().eq(expected(kept..end)));
                let others = expected(0..kept).chain(expected(end..15));
                let left = core::iter::from_fn(|| reader.dequeue());
                assert!(left.eq(others), "{begin} {kept}");
            }
        }
    }

    #[test]
    fn bytes_of_a_value_are_removed_from_those_that_wait() {
        for begin in 0..16_usize {
            for pattern in 0..1_u32 << 8 {
                let mut ring = Bytes::<16>::new();
                let (mut writer, mut reader) = ring.split();
                for _ in 0..begin {
                    assert!(writer.enqueue(0).is_ok() && reader.dequeue().is_some());
                }
                let is_kept = |index: u8| pattern >> index & 1 != 0;
                let byte = |index| if is_kept(index) { b'a' + index } else { 0 };
                for index in 0..8 {
                    assert!(writer.enqueue(byte(index)).is_ok());
                }
                let end = reader.oldest() + 6;
                let place = reader.oldest() + 3;
                let moved = reader.remove(0, end, place);
                let moved_over = (3..6).filter(|index| is_kept(*index)).count();
                assert_eq!(moved, end - moved_over, "{pattern:b}");
                // Those behind the end stay as they are.
                let left = core::iter::from_fn(|| reader.dequeue());
                let expected = (0..8).filter(|index| *index >= 6 || is_kept(*index));
                assert!(left.eq(expected.map(byte)), "{begin} {pattern:b}");
            }
        }
    }

    #[test]
    fn bytes_come_out_in_order_and_never_more_wait_than_fit() {
        let mut ring = Bytes::<8>::new();
        let (mut writer, mut reader) = ring.split();
        let (mut pushed, mut taken) = (0_u8, 0_u8);
        for round in 0..1000_usize {
            for _ in 0..round * 5 % 10 {
                let is_full = writer.len() == writer.capacity();
                assert_eq!(writer.enqueue(pushed).is_err(), is_full);
                pushed = pushed.wrapping_add(u8::from(!is_full));
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
            let [older, newer] = reader.waiting();
            assert_eq!(older.len() + newer.len(), reader.len());
            let mut n = 0;
            for byte in older.chain(newer).take(round % 3) {
                assert_eq!(byte, taken);
                taken = taken.wrapping_add(1);
                n += 1;
            }
            reader.consume(n);
            assert_eq!(reader.len(), usize::from(pushed.wrapping_sub(taken)));
        }
    }
}
