//! The link to the sender: what comes interrupts, what goes is sent in the time that is left.
//!
//! A received byte must be taken before the next one has come, so each is a run of `serial_rx`, the
//! task with the highest priority but `step`. Sending can wait: the line is merely silent meanwhile.
//! So it is done by the tasks that have something to say, as far as the port takes it at once, and
//! by `idle`. That costs no task with a deadline anything, and there is never more than one
//! interrupt in the time of a byte.
//!
//! # Cost
//!
//! What receives is inlined into code in RAM, too: nothing in flash may run while flash is erased.

use leadscrew::{
    model::{Awaited, Requests, queues::SENT_RING},
    protocol::{ByteReader, ByteWriter},
    tasks::{self, Platform as _, Task},
};

use super::{ChipPlatform, chosen::Usart, pac::usart1::RegisterBlock as UsartRegisters};

/// Bytes left to send when a task that waits for room is woken, besides none.
const SENT_HALF: usize = SENT_RING / 2;

/// The receiving half of the port, owned by its interrupt.
pub(crate) struct Receiver(Usart);

impl Receiver {
    /// Switches the port on. Baud rate and pins must be set up.
    pub(super) fn new(usart: Usart) -> Self {
        usart.cr1().write(|w| {
            w.ue().enabled().te().enabled().re().enabled();
            w.rxneie().enabled()
        });
        Self(usart)
    }

    /// Takes the byte that has come, and releases who has to know.
    #[inline]
    pub(crate) fn serve(&mut self, requests: &Requests, received: &mut ByteWriter<'_>) {
        receive(&self.0, requests, received);
    }
}

/// Takes the byte that has come, if one has, and releases who has to know.
///
/// A byte that could not be taken in time is lost. Bytes with a framing error count as they are.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
fn receive(usart: &UsartRegisters, requests: &Requests, received: &mut ByteWriter<'_>) {
    let status = usart.sr().read();
    if status.rxne().bit_is_clear() {
        core::hint::cold_path();
        // The data register must not be read for nothing, as a byte might come just then; but an
        // overrun, which may come without a byte, is cleared like this. RM0090 30.6.1.
        if status.ore().bit_is_set() {
            let _ = usart.dr().read();
        }
        return;
    }
    let byte = usart.dr().read().dr().bits() as u8;
    tasks::serial_rx(byte, requests, received, &mut ChipPlatform);
}

/// The receiver while flash is erased, when `serial_rx` cannot run.
pub(super) struct FlashEraseReceiver {
    requests: &'static Requests,
    received: ByteWriter<'static>,
}

impl FlashEraseReceiver {
    /// Receives into the queue of `serial_rx`.
    pub(super) const fn new(requests: &'static Requests, received: ByteWriter<'static>) -> Self {
        Self { requests, received }
    }

    /// Takes the byte that has come, if one has. Only while no task can run.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "nothing in flash may be called")]
    #[expect(unsafe_code, reason = "the interrupt owns the receiver")]
    pub(super) fn receive(&mut self) {
        // SAFETY: the interrupt does not run now.
        receive(unsafe { &*Usart::ptr() }, self.requests, &mut self.received);
    }
}

/// The sending half of the port, and what waits to be sent.
pub(super) struct Transmitter(ByteReader<'static>);

impl Transmitter {
    /// For what comes out of a queue.
    pub(super) const fn new(sent: ByteReader<'static>) -> Self {
        Self(sent)
    }

    /// Returns whether nothing waits.
    pub(super) fn is_done(&self) -> bool {
        self.0.is_empty()
    }

    /// Puts out the next byte, if the port takes one now.
    pub(super) fn send_next(&mut self, requests: &Requests) {
        self.send(1, requests);
    }

    /// Puts out what the port takes now.
    pub(super) fn send_all(&mut self, requests: &Requests) {
        self.send(SENT_RING, requests);
    }

    #[expect(unsafe_code, reason = "the interrupt owns the receiver")]
    fn send(&mut self, most: usize, requests: &Requests) {
        // SAFETY: the interrupt neither writes the data register, nor does it depend on when its
        // status is read.
        let usart = unsafe { &*Usart::ptr() };
        let before = self.0.len();
        let mut left = most;
        self.0.take_until(|bytes| {
            // wcet-bound: 1024
            while left != 0 && usart.sr().read().txe().bit_is_set() {
                let Some(byte) = bytes.next() else {
                    return false;
                };
                usart.dr().write(|w| w.dr().set(byte.into()));
                left -= 1;
            }
            true
        });
        let after = self.0.len();
        let has_come_to = |waiting| after <= waiting && waiting < before;
        if (has_come_to(0) || has_come_to(SENT_HALF)) && requests.awaits(Awaited::ROOM) {
            ChipPlatform.pend(Task::Wake);
        }
    }
}
