//! Bytes without a pause, from which whoever receives them takes the baud rate.

use super::{
    Facts, clock, emulation,
    fault_port::FaultPort,
    line::Line,
    sequence::{STREAM, Sequence},
};

/// Bytes: 6 s on a board.
const BYTES: u32 = 1 << 16;
const EMULATED_BYTES: u32 = 1 << 12;

/// Returns how many bytes there are.
pub(super) fn length() -> u32 {
    if emulation::is_emulated() {
        EMULATED_BYTES
    } else {
        BYTES
    }
}

/// Sends the bytes when one comes that asks for them, and says how long they took by this clock.
pub(super) fn send(facts: &mut Facts, line: &mut Line) {
    if !line.await_byte() {
        return;
    }
    let _ = line.next_byte();
    let mut sequence = Sequence::new(STREAM);
    let mut left = length();
    let start = clock::now();
    while left != 0 || !line.is_sent() {
        if left != 0 && line.has_room() {
            line.queue(sequence.next_byte());
            left -= 1;
        }
        line.send_next();
    }
    FaultPort::drain();
    let taken = clock::now().wrapping_sub(start);
    facts.put("stream.cycles", clock::cycles(taken));
}
