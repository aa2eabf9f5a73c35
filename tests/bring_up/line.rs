//! The serial line for the main program: queues of the firmware's receiver and transmitter, and their far end.

use leadscrew::{
    model::{Requests, queues::SENT_RING},
    protocol::{ByteReader, ByteWriter, Bytes, Incoming, IncomingWriter},
};

use super::{clock, emulation, fault_port::FaultPort, sequence::Sequence, serial::Transmitter};

/// Longest silence in the middle of bytes, and before them, cycles: half a second, and ten.
const SILENCE_CYCLES: i64 = 84_000_000;
const BEGIN_CYCLES: i64 = 20 * SILENCE_CYCLES;

/// The queues.
pub(super) struct Line {
    /// What the receiver notes beside the bytes.
    requests: &'static Requests,
    received: ByteReader<'static>,
    answers: ByteWriter<'static>,
    transmitter: Transmitter,
}

/// Number of received bytes, and of bytes other than expected.
#[derive(Default)]
pub(super) struct Compared {
    pub(super) count: u32,
    pub(super) wrong: u32,
}

impl Line {
    /// Returns the line, once, and the end for its receiver.
    pub(super) fn take() -> (Self, IncomingWriter<'static>) {
        let incoming = cortex_m::singleton!(: Incoming = Incoming::new());
        let (requests, reception, received) = incoming.expect("this is the first time").split();
        let sent = cortex_m::singleton!(: Bytes<SENT_RING> = Bytes::new());
        let (answers, sent) = sent.expect("this is the first time").split();
        let line = Self {
            requests,
            received,
            answers,
            transmitter: Transmitter::new(sent),
        };
        (line, reception)
    }

    /// Returns how many losses the receiver has noted, wrapping.
    pub(super) fn lost(&self) -> u32 {
        self.requests.lost()
    }

    /// Returns how many bytes have come and wait.
    pub(super) fn waiting(&self) -> usize {
        self.received.len()
    }

    /// Returns whether everything has been handed to the USART.
    pub(super) fn is_sent(&self) -> bool {
        self.transmitter.is_done()
    }

    /// Hands the next byte to the USART, if that takes one now.
    pub(super) fn send_next(&mut self) {
        self.transmitter.send_next(self.requests);
    }

    /// Returns whether another byte can be queued.
    pub(super) fn has_room(&self) -> bool {
        self.answers.len() != self.answers.capacity()
    }

    /// Queues a byte, where there is room.
    pub(super) fn queue(&mut self, byte: u8) {
        self.answers.append(&[byte]);
    }

    /// Takes the oldest byte that waits.
    pub(super) fn next_byte(&mut self) -> Option<u8> {
        self.received.dequeue()
    }

    /// Waits for a byte, and leaves it where it is. Returns whether it has come.
    pub(super) fn await_byte(&self) -> bool {
        let begin = clock::now();
        while self.received.is_empty() {
            if is_over(begin, BEGIN_CYCLES) {
                return false;
            }
        }
        true
    }

    /// Takes so many bytes, or those that come before a silence, and compares each.
    pub(super) fn compare(&mut self, expected: &mut Sequence, bytes: u32) -> Compared {
        let mut compared = Compared::default();
        let mut last = clock::now();
        while compared.count < bytes && !is_silent(last) {
            if let Some(byte) = self.next_byte() {
                last = clock::now();
                compared.count += 1;
                compared.wrong += u32::from(byte != expected.next_byte());
            }
        }
        compared
    }

    /// Sends a byte, and waits for its end.
    pub(super) fn send(&mut self, byte: u8) {
        self.queue(byte);
        while !self.is_sent() {
            self.send_next();
        }
        FaultPort::drain();
    }
}

/// Returns whether nothing has come for longer than it may; in the emulator a busy computer looks the same.
pub(super) fn is_silent(last: u32) -> bool {
    is_over(last, SILENCE_CYCLES)
}

fn is_over(begin: u32, limit: i64) -> bool {
    !emulation::is_emulated() && clock::cycles(clock::now().wrapping_sub(begin)) > limit
}
