//! The serial line of the sender: receiving is an interrupt, sending is done in the time that is left.
//!
//! A received byte must be read before the next one is complete, so each byte is a run of
//! `serial_rx`, whose priority is the highest but that of `step`. Sending can wait: the line is
//! silent meanwhile. `interpret` and `report` send what the USART takes at once, `idle` sends the
//! rest. So sending delays no task with a deadline, and there is at most one interrupt in the time
//! of a byte.
//!
//! # Cost
//!
//! The receiving functions are inlined into `serial_rx` and into code in RAM: nothing in flash may
//! run while flash is erased. A run without a byte, or with a damaged byte, is off the path of the other runs: one
//! comparison finds both. What all paths need is read once, before they part: each line of flash more takes some of the
//! cache from all others.

use core::hint::cold_path;

use leadscrew::{
    model::{Requests, queues::SENT_RING},
    protocol::{ByteReader, DamagedByte, IncomingWriter},
    tasks,
};

use super::{
    chosen::{self, Usart},
    pac::usart1::RegisterBlock as UsartRegisters,
    release::ChipPlatform,
};

chosen::forward_sender!();

/// The receiving half of the USART, owned by `serial_rx`.
pub(crate) struct Receiver(Usart);

impl Receiver {
    /// Switches the USART on. Baud rate and pins must be set up.
    pub(super) fn new(usart: Usart) -> Self {
        usart.cr1().write(|w| {
            w.ue().enabled().te().enabled().re().enabled();
            w.rxneie().enabled()
        });
        Self(usart)
    }

    /// Runs `serial_rx`.
    pub(crate) fn serve(&mut self, reception: &mut IncomingWriter<'_>) {
        receive(&self.0, reception);
    }
}

/// Flags of the status: RM0090 30.6.1.
const FRAMING_ERROR: u16 = 1 << 1;
const NOISE: u16 = 1 << 2;
const OVERRUN: u16 = 1 << 3;
const RECEIVED: u16 = 1 << 5;
const STATUS_FLAGS: u16 = FRAMING_ERROR | NOISE | OVERRUN | RECEIVED;

/// Whether the flags are those of a byte that is whole, and behind which none was lost.
const fn is_whole(flags: u16) -> bool {
    flags == RECEIVED
}

/// Whether the flags are those of no byte, and of none that was lost: neither of the two highest is set.
const fn is_nothing(flags: u16) -> bool {
    flags < OVERRUN
}

// By each flag, for each of their combinations.
const _: () = {
    let mut status = 0;
    while status <= STATUS_FLAGS {
        let flags = status & STATUS_FLAGS;
        let (is_received, is_overrun) = (flags & RECEIVED != 0, flags & OVERRUN != 0);
        let is_damaged = is_overrun || flags & FRAMING_ERROR != 0 || flags & NOISE != 0;
        assert!(is_whole(flags) == (is_received && !is_damaged));
        assert!(is_nothing(flags) != (is_received || is_overrun));
        status += 1;
    }
};

/// Takes the received byte, if any, and releases the task that waits for it.
///
/// A damaged byte is lost, as are a byte that was not taken in time and the byte before it: their line is refused.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
fn receive(usart: &UsartRegisters, reception: &mut IncomingWriter<'_>) {
    let (requests, mut received) = reception.parts();
    let before = received.enqueued();
    let flags = usart.sr().read().bits() & STATUS_FLAGS;
    let is_whole = is_whole(flags);
    // The data register is read only for a byte or after an overrun, which may be reported without a byte and
    // is cleared by the read (RM0090 30.6.1): another read could take a byte that comes just then.
    if !is_whole {
        cold_path();
        if is_nothing(flags) {
            return;
        }
    }
    let byte = usart.dr().read().dr().bits() as u8;
    let byte = if is_whole { Ok(byte) } else { Err(DamagedByte) };
    tasks::serial_rx(byte, before, requests, &mut received, &mut ChipPlatform);
}

/// The receiver for the time of an erase of flash, in which `serial_rx` cannot run.
#[cfg_attr(
    feature = "eeprom",
    allow(dead_code, reason = "the bring-up erases flash on every board")
)]
pub(super) struct FlashEraseReceiver(IncomingWriter<'static>);

#[cfg_attr(
    feature = "eeprom",
    allow(dead_code, reason = "the bring-up erases flash on every board")
)]
impl FlashEraseReceiver {
    /// Returns a receiver into the queue of `serial_rx`.
    pub(super) const fn new(reception: IncomingWriter<'static>) -> Self {
        Self(reception)
    }

    /// Takes the received byte, if there is one. Only while no task can run.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "nothing in flash may be called")]
    #[expect(unsafe_code, reason = "the interrupt owns the receiver")]
    pub(super) fn receive(&mut self) {
        // SAFETY: `serial_rx`, which owns the receiver, does not run meanwhile.
        receive(unsafe { &*Usart::ptr() }, &mut self.0);
    }
}

/// The sending half of the USART, with the queue of bytes to be sent.
pub(crate) struct Transmitter(ByteReader<'static>);

impl Transmitter {
    /// Returns a transmitter of the bytes of a queue.
    pub(crate) const fn new(sent: ByteReader<'static>) -> Self {
        Self(sent)
    }

    /// Returns whether no byte waits.
    pub(super) fn is_done(&self) -> bool {
        self.0.is_empty()
    }

    /// Sends the next byte, if the USART takes one now.
    pub(super) fn send_next(&mut self, requests: &Requests) {
        self.send(1, requests);
    }

    /// Sends the bytes that the USART takes now.
    pub(super) fn send_all(&mut self, requests: &Requests) {
        self.send(SENT_RING, requests);
    }

    #[expect(unsafe_code, reason = "the interrupt owns the receiver")]
    fn send(&mut self, max_bytes: usize, requests: &Requests) {
        // SAFETY: `serial_rx` does not write the data register, and a read of the status changes
        // nothing for it.
        let usart = unsafe { &*Usart::ptr() };
        let before = self.0.len();
        let mut left = max_bytes;
        self.0.take_until(|bytes| {
            // wcet-bound: SENT_RING: the ring has no more bytes
            while left != 0 && usart.sr().read().txe().bit_is_set() {
                let Some(byte) = bytes.next() else {
                    return false;
                };
                usart.dr().write(|w| w.dr().set(byte.into()));
                left -= 1;
            }
            true
        });
        tasks::serial_tx(before, self.0.len(), requests, &mut ChipPlatform);
    }
}
