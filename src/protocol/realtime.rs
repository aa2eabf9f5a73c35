//! Realtime bytes: taken out of the stream by the receive interrupt, never part of a line.
//!
//! A realtime byte may stand inside a line. Read with Grbl 1.1 `serial.c` and the table of realtime
//! commands.
//!
//! # Cost
//! A byte costs O(1). The receiver also runs from RAM while the flash is erased, and can call nothing
//! there: all of it is inlined, without tables.

use core::hint::cold_path;

use super::ByteWriter;
use crate::model::{Release, Requests, queues::RECEIVED_RING};

/// Bytes between two releases of `interpret` without the end of a line, at most: a quarter of the
/// receive queue (`tests/protocol/receiving.rs`).
pub(super) const MAX_UNRELEASED_BYTES: usize = RECEIVED_RING / 4;

/// Sorts one received byte. Returns the task to release.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
pub fn receive(byte: u8, requests: &Requests, received: &mut ByteWriter<'_>) -> Release {
    if !is_request(byte) || requests.are_sorted_later() {
        return enqueue(byte, requests, received);
    }
    cold_path();
    requests.accept(byte, || received.enqueued())
}

/// Drops a byte that is not what was sent, or behind which one is lost. Returns the task to release.
///
/// The byte of a break, which is 0, is a feed hold.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
pub fn receive_fault(byte: u8, requests: &Requests, received: &ByteWriter<'_>) -> Release {
    requests.lose(received.enqueued());
    if byte == 0 {
        requests.accept(b'!', || received.enqueued())
    } else {
        Release::Nobody
    }
}

/// Whether a byte is a realtime byte, where it counts as one.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `receive`")]
pub(super) fn is_request(byte: u8) -> bool {
    matches!(byte, b'~' | 0x80..) || matches!(byte, b'!' | b'?' | 0x18)
}

/// Enqueues a byte of a line. A line end releases `interpret` if the task waits for one, and so does
/// every [`MAX_UNRELEASED_BYTES`]th byte. Control characters up to 13 count as line ends: a tab
/// releases the task for nothing.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `receive`")]
fn enqueue(byte: u8, requests: &Requests, received: &mut ByteWriter<'_>) -> Release {
    let Ok(number) = received.enqueue(byte) else {
        // The bytes that fill the queue have released `interpret`.
        requests.lose(received.enqueued());
        return Release::Nobody;
    };
    let is_release = byte <= b'\r' || number.is_multiple_of(MAX_UNRELEASED_BYTES);
    if is_release {
        cold_path();
        received.end_line(number);
        if requests.awaits_line() {
            return Release::Interpret;
        }
    }
    Release::Nobody
}
