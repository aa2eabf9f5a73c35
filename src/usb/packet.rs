//! The packet of the host that has come last: its requests are made, its bytes of lines wait for room.

use super::{PACKET_BYTES, PACKET_WORDS};
use crate::{
    model::Requests,
    protocol::{ByteWriter, realtime},
    tasks::Platform,
};

/// The bytes of lines of a packet that have not been enqueued.
#[derive(Debug)]
pub(super) struct Packet {
    bytes: [u8; PACKET_BYTES],
    next: usize,
    end: usize,
    /// The byte enqueued last.
    last: u8,
}

impl Packet {
    pub(super) const fn new() -> Self {
        Self {
            bytes: [0; PACKET_BYTES],
            next: 0,
            end: 0,
            last: b'\n',
        }
    }

    /// Returns whether every byte has been enqueued.
    pub(super) const fn is_empty(&self) -> bool {
        self.next >= self.end
    }

    /// Takes a packet of so many bytes, behind which every byte of the packet before has been enqueued: makes its
    /// requests, and keeps the others.
    pub(super) fn fill(
        &mut self,
        length: usize,
        words: &[u32; PACKET_WORDS],
        requests: &Requests,
        received: &mut ByteWriter<'_>,
        platform: &mut impl Platform,
    ) {
        (self.next, self.end) = (0, 0);
        let enqueued = received.enqueued();
        let bytes = words.iter().flat_map(|word| word.to_le_bytes());
        // wcet-bound: PACKET_BYTES: the bytes of a packet
        for byte in bytes.take(length) {
            let before = enqueued.wrapping_add(self.end);
            match realtime::take_request(byte, before, requests, received) {
                Some(release) => platform.release(release),
                None => {
                    if let Some(slot) = self.bytes.get_mut(self.end) {
                        *slot = byte;
                        self.end += 1;
                    }
                }
            }
        }
    }

    /// Enqueues as many bytes as there is room for.
    pub(super) fn drain(
        &mut self,
        requests: &Requests,
        received: &mut ByteWriter<'_>,
        platform: &mut impl Platform,
    ) {
        // wcet-bound: PACKET_BYTES: the bytes of a packet
        while let Some(&byte) = self.bytes.get(self.next..self.end).and_then(<[u8]>::first) {
            let Ok(release) = realtime::enqueue(byte, requests, received) else {
                return;
            };
            platform.release(release);
            self.last = byte;
            self.next += 1;
        }
    }

    /// Ends the line whose end nobody will send: it counts as damaged. Only while no byte waits. Returns false where there
    /// is no room.
    pub(super) fn end_line(
        &mut self,
        requests: &Requests,
        received: &mut ByteWriter<'_>,
        platform: &mut impl Platform,
    ) -> bool {
        if self.last == b'\n' || self.last == b'\r' {
            return true;
        }
        let before = received.enqueued();
        let Ok(release) = realtime::enqueue(b'\n', requests, received) else {
            return false;
        };
        requests.lose(before);
        platform.release(release);
        self.last = b'\n';
        true
    }
}
