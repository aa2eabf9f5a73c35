//! Realtime bytes: taken out of the stream by the receive interrupt, never part of a line.
//!
//! A realtime byte may stand inside a line. Read with Grbl 1.1 `serial.c` and the table of realtime
//! commands. Text is none: a byte from 0x80 on is a request only where it stands alone, and part of a character
//! in UTF-8 anywhere else. U+0080 to U+009F are such bytes as some senders write them: [`super::Utf8RequestWatch`].
//!
//! # Cost
//! A byte costs O(1). The receiver also runs from RAM while the flash is erased, and can call nothing
//! there: all of it is inlined, without tables.

use core::hint::cold_path;

use super::{ByteWriter, bytes::CharacterRest};
use crate::model::{Release, Requests, queues::RECEIVED_RING};

/// Bytes between two releases of `interpret` without the end of a line, at most: a quarter of the
/// receive queue (`tests/protocol/receiving.rs`).
pub(super) const MAX_UNRELEASED_BYTES: usize = RECEIVED_RING / 4;

/// The last of the bytes that are requests where they stand alone.
pub(super) const LAST_REQUEST: u8 = 0xa3;

/// A byte that was received wrong, or behind which another byte is lost.
#[derive(Debug, Clone, Copy)]
pub struct DamagedByte;

/// Sorts one received byte. Returns the task to release.
///
/// `before` is the number of bytes enqueued so far. A damaged byte is lost.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
pub fn receive(
    byte: Result<u8, DamagedByte>,
    before: usize,
    requests: &Requests,
    received: &mut ByteWriter<'_>,
) -> Release {
    match byte {
        Ok(byte @ 0x80..) => {
            cold_path();
            let rest = match request_from_0x80(byte, before, requests, received) {
                Ok(release) => return release,
                Err(rest) => rest,
            };
            if let Ok(number) = received.enqueue_behind(before, byte) {
                received.await_rest(number, rest);
                // It may be taken, but releases nobody: `idle` does, at the latest.
                received.end_line(number);
                return Release::Nobody;
            }
            received.await_rest(before, rest);
        }
        Ok(byte) => {
            if matches!(byte, b'~' | b'!' | b'?' | 0x18) && !requests.is_deferred() {
                cold_path();
                return requests.accept(byte, before);
            }
            if let Ok(number) = received.enqueue_behind(before, byte) {
                return enqueued(byte, number, requests, received);
            }
            // The bytes that fill the queue have released `interpret`.
            cold_path();
        }
        Err(_) => cold_path(),
    }
    requests.lose(before);
    Release::Nobody
}

/// Makes the request of a byte from 0x80 on, if the byte stands alone. Otherwise returns the part of its character that
/// is missing behind it.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `receive`")]
fn request_from_0x80(
    byte: u8,
    before: usize,
    requests: &Requests,
    received: &ByteWriter<'_>,
) -> Result<Release, CharacterRest> {
    match received.rest_of_character(before, byte) {
        Some(rest) => Err(rest),
        None if byte <= LAST_REQUEST && !requests.is_deferred() => {
            cold_path();
            Ok(requests.accept_from_0x80(byte, before))
        }
        None => Err(CharacterRest::NOTHING),
    }
}

/// Makes the request of a byte of a packet, if the byte is a realtime byte, also while the queue is full. `before` is the
/// number of bytes of lines before the byte, enqueued or waiting for room. Returns the task to release; nothing for a byte
/// of a line, which [`enqueue`] takes later.
pub fn take_request(
    byte: u8,
    before: usize,
    requests: &Requests,
    received: &mut ByteWriter<'_>,
) -> Option<Release> {
    if byte >= 0x80 {
        return match request_from_0x80(byte, before, requests, received) {
            Ok(release) => Some(release),
            Err(rest) => {
                received.await_rest(before.wrapping_add(1), rest);
                None
            }
        };
    }
    let is_request = matches!(byte, b'~' | b'!' | b'?' | 0x18) && !requests.is_deferred();
    is_request.then(|| requests.accept(byte, before))
}

/// Enqueues bytes of lines that [`take_request`] has left, as many as there is room for. Returns how many these are, and
/// the task to release.
pub fn enqueue(
    bytes: &[u8],
    requests: &Requests,
    received: &mut ByteWriter<'_>,
) -> (usize, Release) {
    let before = received.enqueued();
    let (count, may_end_line) = received.enqueue_some(bytes);
    let number = before.wrapping_add(count);
    if may_end_line || number / MAX_UNRELEASED_BYTES != before / MAX_UNRELEASED_BYTES {
        received.end_line(number);
        if requests.awaits_line() {
            return (count, Release::Interpret);
        }
    }
    (count, Release::Nobody)
}

/// Whether a byte is a realtime byte, where it counts as one.
pub(super) const fn is_request(byte: u8) -> bool {
    matches!(byte, b'~' | b'!' | b'?' | 0x18 | 0x80..=LAST_REQUEST)
}

/// Follows a byte of a line into the queue. A line end releases `interpret` if the task waits for one, and so
/// does every [`MAX_UNRELEASED_BYTES`]th byte. Control characters up to 13 count as line ends: a tab
/// releases the task for nothing.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `receive`")]
fn enqueued(
    byte: u8,
    number: usize,
    requests: &Requests,
    received: &mut ByteWriter<'_>,
) -> Release {
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
