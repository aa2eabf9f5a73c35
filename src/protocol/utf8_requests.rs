//! Realtime bytes as some senders write them: U+0080 to U+009F in UTF-8, which are no text.
//!
//! U+00A0 to U+00A3 may be text, a non-breaking space among them: they are requests only directly behind the end of a
//! line, or when the line has been silent. `idle` looks for all of them: to `serial_rx` they are text, as its time
//! limits the rate of steps. `Line` drops what is a request here.

use super::{ByteCount, realtime::LAST_REQUEST};
use crate::model::{Requests, queues::RECEIVED_RING};

/// First byte of U+0080 to U+00BF.
pub(super) const LATIN_1_LEAD: u8 = 0xc2;

/// Time without a byte after which the line counts as silent, ms.
const SILENT_MS: u8 = 100;

/// Returns whether U+0080 to U+00BF, by its second byte, is a request; `is_first` in front of anything else of its line.
pub(super) const fn is_utf8_request(byte: u8, is_first: bool) -> bool {
    matches!(byte, 0x80..=0x9f) || is_first && matches!(byte, 0xa0..=LAST_REQUEST)
}

/// What has come since the last look.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct NewBytes {
    /// Requests, which have been made.
    pub has_requests: bool,
    /// Text other than ASCII, whose bytes release nobody.
    pub has_text: bool,
}

/// The watch of `idle` over the received bytes.
#[derive(Debug, Default)]
pub struct Utf8RequestWatch {
    /// Number of the next byte.
    next: usize,
    /// Milliseconds since a byte came.
    silent: u8,
    /// Number of the byte that came after silence.
    fresh: usize,
}

impl Utf8RequestWatch {
    /// Returns a watch that has not scanned.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            next: 0,
            silent: 0,
            fresh: 0,
        }
    }

    /// Scans the new bytes, so many milliseconds after the last scan, and makes the requests that have come.
    pub fn scan(
        &mut self,
        elapsed_ms: u8,
        received: ByteCount<'_>,
        requests: &Requests,
    ) -> NewBytes {
        let mut seen = NewBytes::default();
        let written = received.enqueued();
        self.silent = self.silent.saturating_add(elapsed_ms);
        if written == self.next {
            return seen;
        }
        if self.silent >= SILENT_MS {
            self.fresh = self.next;
        }
        self.silent = 0;
        let is_late = written.wrapping_sub(self.next) >= RECEIVED_RING;
        if is_late || requests.is_deferred() {
            self.next = written;
            return seen;
        }
        // wcet-bound: RECEIVED_RING: more new bytes than the ring holds are left out above
        while self.next != written {
            let number = self.next;
            let byte = received.byte(number);
            if !byte.is_ascii() {
                seen.has_text = true;
                if self.is_utf8_request(number, byte, received) {
                    if !requests.accept_utf8(byte, number.wrapping_add(1)) {
                        break;
                    }
                    seen.has_requests = true;
                }
            }
            self.next = number.wrapping_add(1);
        }
        seen
    }

    /// Returns whether a byte ends a request.
    fn is_utf8_request(&self, number: usize, byte: u8, received: ByteCount<'_>) -> bool {
        let (first, before) = (number.wrapping_sub(1), number.wrapping_sub(2));
        let is_first = first == self.fresh || received.byte(before) <= b'\r';
        received.byte(first) == LATIN_1_LEAD
            && is_utf8_request(byte, is_first)
            // What lies there now has been there all the time.
            && before.wrapping_sub(received.oldest_kept()) < RECEIVED_RING
    }
}
