//! Bytes in front of their lines: realtime bytes and emergencies.
//!
//! In the RepRap dialect `serial_rx` enqueues every byte. Here the bytes are scanned as soon as the task runs, long
//! before their lines are read. A realtime byte counts directly behind a line end, or when the line has been silent; an
//! emergency (`M112`, `M108`, `M410`) counts as soon as its line is whole. Lines are only taken from bytes that have
//! been looked at.
//!
//! A host that sends more than the queue holds loses lines, but no emergency: a line that begins behind [`KEPT_BYTES`]
//! is read and dropped. A line that goes on behind [`TRUNCATION_BYTES`] is truncated and refused, so there is always
//! room for the next bytes.
//!
//! # Cost
//! Dropping copies the bytes that stay, less than 1 KiB, and `serial_rx` is as without it. A quarter of
//! the queue is what comes within 22 ms at 115 200 baud, and `interpret` runs within 5.3 ms of its release
//! (`LEADSCREW_FEATURES=reprap cargo xtask schedule`).

use super::{RepRap, RestartKind};
use crate::{
    model::{Requests, State, queues::RECEIVED_RING},
    protocol::{
        ByteReader, Emergency, RawLine,
        checked_lines::TAKEN,
        dialect::SessionContext,
        realtime::is_request,
        utf8_requests::{LATIN_1_LEAD, is_utf8_request},
    },
};

/// Longest line of an emergency, bytes.
const EMERGENCY_BYTES: usize = 32;
/// What takes the place of the first byte that a line has lost, and of such a byte of a sender: no line has a
/// use for either.
pub(super) const LOST: u8 = 1;
const NO_WORD: u8 = 2;
/// A line that begins behind so many bytes is dropped.
const KEPT_BYTES: usize = RECEIVED_RING - RECEIVED_RING / 4;
/// A line that goes on behind so many bytes is truncated: longer than those of hosts. What comes in a period of
/// the clock at 115 200 baud finds room behind them, also where no line end releases the task.
const TRUNCATION_BYTES: usize = KEPT_BYTES + RECEIVED_RING / 16;

/// How far the received bytes have been looked at.
#[derive(Debug, Default)]
pub(super) struct Scan {
    /// The line to which the next byte belongs.
    pub(super) line: RawLine<EMERGENCY_BYTES>,
    /// Number of the next byte.
    pub(super) next: usize,
    /// Number of bytes received when the line fell silent.
    pub(super) silent_at: Option<usize>,
    /// Number of the byte behind one that may be the first of a request in UTF-8.
    utf8_request_at: Option<usize>,
    /// The line is being dropped, or its rest.
    is_dropping: bool,
    is_truncated: bool,
    /// Bytes of lines that wait have been replaced by [`TAKEN`].
    has_taken: bool,
}

impl Scan {
    /// Begins a line with a byte.
    pub(super) fn begin(&mut self, next: usize) {
        self.line.clear();
        self.next = next;
        self.is_dropping = false;
        self.is_truncated = false;
    }

    /// Returns the number of bytes that have been looked at, from the oldest on that waits.
    pub(super) const fn bytes_from(&self, oldest: usize) -> usize {
        self.next.wrapping_sub(oldest)
    }
}

impl RepRap {
    /// Removes the places of bytes that have been taken out of waiting lines, where the room is needed.
    fn make_room(&mut self, received: &mut ByteReader<'_>, requests: &Requests) {
        if !self.scan.has_taken || received.len() < KEPT_BYTES / 2 {
            return;
        }
        self.scan.has_taken = false;
        let end = self.scan.next;
        let stale_before = self.stale_before.unwrap_or(end);
        let moved = received.remove(TAKEN, end, stale_before);
        self.stale_before = self.stale_before.map(|_| moved);
        requests.spread_losses(|| received.written());
    }

    /// Looks at the bytes that have come since the last time.
    pub(super) fn scan(&mut self, session: &mut SessionContext<'_>, received: &mut ByteReader<'_>) {
        if self.scan.bytes_from(received.oldest()) > received.capacity() {
            // A reset has dropped bytes.
            self.scan.begin(received.oldest());
        }
        self.make_room(received, session.requests);
        let oldest = received.oldest();
        let [older, newer] = received.waiting();
        let first = self.scan.bytes_from(oldest);
        for (place, byte) in older.chain(newer).enumerate().skip(first) {
            let scan = &mut self.scan;
            let number = scan.next;
            scan.next = number.wrapping_add(1);
            let is_silent = scan.silent_at == Some(number);
            let may_be_request = scan.line.is_empty() || is_silent;
            let is_utf8_request =
                scan.utf8_request_at.take() == Some(number) && is_utf8_request(byte, true);
            if is_utf8_request {
                received.replace(number.wrapping_sub(1), TAKEN);
                scan.line.clear();
            }
            if is_utf8_request || is_request(byte) && may_be_request {
                received.replace(number, TAKEN);
                scan.has_taken = true;
                if is_silent {
                    scan.silent_at = Some(scan.next);
                }
                self.accept_realtime(byte, number, session);
                continue;
            }
            if byte == LATIN_1_LEAD && may_be_request {
                scan.utf8_request_at = Some(scan.next);
            }
            scan.is_dropping |= scan.line.is_empty() && place >= KEPT_BYTES;
            let is_end = matches!(byte, b'\n' | b'\r');
            if scan.is_dropping || scan.is_truncated && !is_end {
                received.replace(number, TAKEN);
                scan.has_taken = true;
            } else if place >= TRUNCATION_BYTES && !is_end {
                received.replace(number, LOST);
                scan.is_truncated = true;
            } else if byte == LOST {
                received.replace(number, NO_WORD);
            }
            if is_end {
                self.end_scanned_line(number, session);
            } else {
                scan.line.push(byte);
            }
        }
        self.make_room(received, session.requests);
    }

    /// Requests what a realtime byte asks for.
    fn accept_realtime(&mut self, byte: u8, number: usize, session: &mut SessionContext<'_>) {
        match byte {
            b'?' => session.reports.is_status_due = true,
            0x18 => self.stop(RestartKind::Plain, session),
            _ => session.requests.accept_from_interpret(byte, number),
        }
        *session.has_release_request = true;
    }

    /// Stops the machine by a reset, on which it has to act.
    fn stop(&mut self, kind: RestartKind, session: &mut SessionContext<'_>) {
        self.begin_restart(kind);
        session.requests.reset();
        *session.has_release_request = true;
    }

    /// Ends a line that has been looked at.
    fn end_scanned_line(&mut self, number: usize, session: &mut SessionContext<'_>) {
        let scan = &mut self.scan;
        let emergency = scan.line.emergency();
        scan.line.clear();
        scan.is_dropping = false;
        scan.is_truncated = false;
        match emergency {
            Some(Emergency::Kill) => self.stop(RestartKind::Killing, session),
            Some(Emergency::Stop) if session.machine.state != State::Alarm => {
                self.stop(RestartKind::Stopping, session);
            }
            Some(Emergency::GoOn) => self.accept_realtime(b'~', number, session),
            Some(Emergency::Stop) | None => {}
        }
    }
}
