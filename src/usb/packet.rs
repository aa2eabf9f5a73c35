//! The packet of the host that has come last: its requests are made, its bytes of lines wait for room.

use super::{PACKET_BYTES, Registers, registers::fifo};
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

    /// Takes a packet of so many bytes out of the receive FIFO, when every byte of the packet before has been enqueued:
    /// makes its requests, and keeps the others.
    pub(super) fn fill(
        &mut self,
        length: usize,
        otg: &mut impl Registers,
        requests: &Requests,
        received: &mut ByteWriter<'_>,
        platform: &mut impl Platform,
    ) {
        let words = self.bytes.as_chunks_mut().0;
        // wcet-bound: PACKET_WORDS: the words of a packet
        for bytes in words.iter_mut().take(length.div_ceil(4)) {
            *bytes = otg.read(fifo(0)).to_le_bytes();
        }
        let enqueued = received.enqueued();
        let mut kept = 0;
        // wcet-bound: PACKET_BYTES: the bytes of a packet
        for index in 0..length {
            let byte = self.bytes.get(index).copied().unwrap_or_default();
            let before = enqueued.wrapping_add(kept);
            match realtime::take_request(byte, before, requests, received) {
                Some(release) => platform.release(release),
                None => {
                    if let Some(slot) = self.bytes.get_mut(kept) {
                        *slot = byte;
                        kept += 1;
                    }
                }
            }
        }
        (self.next, self.end) = (0, kept);
    }

    /// Enqueues as many bytes as there is room for.
    pub(super) fn drain(
        &mut self,
        requests: &Requests,
        received: &mut ByteWriter<'_>,
        platform: &mut impl Platform,
    ) {
        let bytes = self.bytes.get(self.next..self.end).unwrap_or_default();
        let (enqueued, release) = realtime::enqueue(bytes, requests, received);
        if let Some(last) = bytes.get(..enqueued).and_then(<[u8]>::last) {
            self.last = *last;
            self.next += enqueued;
            platform.release(release);
        }
    }

    /// Ends the line whose end nobody will send: it counts as damaged. Only while no byte waits.
    pub(super) fn end_line(&mut self, requests: &Requests, received: &ByteWriter<'_>) {
        if self.last != b'\n' && self.last != b'\r' {
            requests.lose(received.enqueued());
            self.bytes[0] = b'\n';
            (self.next, self.end) = (0, 1);
        }
    }
}
