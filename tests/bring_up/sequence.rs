//! The bytes of the exchange, as both sides make them.

/// Seeds of the bytes in both directions at once, of the bytes without a pause, and of the bytes in bursts.
pub(super) const TO_BOARD: u8 = b'>';
pub(super) const FROM_BOARD: u8 = b'<';
pub(super) const STREAM: u8 = b'=';
pub(super) const BURSTS: u8 = b'+';

/// Bytes of a burst: they fit into the queue of those that wait, and last 69 ms at 115 200 baud, less than any
/// erase.
pub(super) const BURST: u32 = 800;

/// Bytes that look random: lines of 63 characters without any that the firmware acts on.
pub(super) struct Sequence(u32, u32);

const CHARACTERS: &[u8; 64] = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz.-";

impl Sequence {
    pub(super) const fn new(seed: u8) -> Self {
        Self(0x2545_f491 ^ seed as u32, 0)
    }

    /// Returns the next one.
    pub(super) fn next_byte(&mut self) -> u8 {
        self.1 = self.1.wrapping_add(1);
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        if self.1.is_multiple_of(64) {
            return b'\n';
        }
        CHARACTERS[(self.0 >> 16) as usize % CHARACTERS.len()]
    }
}
