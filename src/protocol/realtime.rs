//! Realtime bytes: taken out of the stream by the receive interrupt, never part of a line.
//!
//! A byte costs O(1) and may stand inside a line. Read with Grbl 1.1 `serial.c` and the table of
//! realtime commands.

use core::hint::cold_path;

use super::ByteWriter;
use crate::model::{Release, Requests};

/// After so many places of the queue `interpret` is released, also without the end of a line.
const UNRELEASED_BYTES: usize = 256;

/// Sorts one received byte.
///
/// Also runs from RAM, where it can call nothing: all of it is inlined, and looks nothing up in a
/// table.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
pub fn receive(byte: u8, requests: &Requests, line: &mut ByteWriter<'_>) -> Release {
    let is_request = matches!(byte, b'~' | 0x80..) || matches!(byte, b'!' | b'?' | 0x18);
    if !is_request {
        return put(byte, requests, line);
    }
    cold_path();
    requests.accept(byte)
}

/// Queues a byte of a line. The end of the line releases `interpret`, if it waits for one (so does a
/// tab, for nothing: telling them apart would take longer), and so does so much of a line that the queue must not be left to fill up with it.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `receive`")]
fn put(byte: u8, requests: &Requests, line: &mut ByteWriter<'_>) -> Release {
    let Ok(number) = line.enqueue(byte) else {
        // Whoever takes bytes has been released by those that fill the queue.
        requests.lose();
        return Release::Nobody;
    };
    let is_release = byte <= b'\r' || number.is_multiple_of(UNRELEASED_BYTES);
    if is_release {
        cold_path();
        line.end_line(number);
        if requests.awaits_line() {
            return Release::Interpret;
        }
    }
    Release::Nobody
}
