//! The link to the sender: one byte each way per interrupt.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering::Relaxed};

use leadscrew::{
    protocol::{
        ByteReader, ByteWriter,
        realtime::{self, Awaited, Release, Requests},
    },
    sim::SENT_RING,
};

use super::{
    chosen::{self, Usart},
    emulation,
    release::{PREPARE, WAKE},
};

/// Bytes left to send when a task that waits for room is woken, besides none.
const SENT_HALF: usize = SENT_RING / 2;

/// The serial port, owned by its interrupt.
pub(crate) struct SerialPort {
    usart: Usart,
    is_sending: bool,
}

impl SerialPort {
    /// Switches reception on. Baud rate and pins must be set up.
    pub(super) fn new(usart: Usart) -> Self {
        let mut port = Self {
            usart,
            is_sending: false,
        };
        port.set_sending(false);
        port
    }

    /// Takes one byte in or puts one out, and releases who has to know.
    #[inline]
    pub(crate) fn serve(
        &mut self,
        requests: &Requests,
        received: &mut ByteWriter<'_>,
        sent: &mut ByteReader<'_>,
    ) {
        if let Some(byte) = self.receive() {
            match realtime::receive(byte, requests, received) {
                Release::Nobody => {}
                Release::Interpret | Release::Report => rtic::pend(WAKE),
                Release::Prepare => rtic::pend(PREPARE),
            }
            // What is to be sent may have been pended by the same vector.
            if !sent.is_empty() {
                again();
            }
        } else if self.can_send() {
            let byte = sent.dequeue();
            self.send(byte);
            let is_room = byte.is_some() && matches!(sent.len(), 0 | SENT_HALF);
            if is_room && requests.awaits(Awaited::ROOM) {
                rtic::pend(WAKE);
            }
        }
    }

    /// The byte that has arrived; clears an overrun.
    #[inline]
    fn receive(&mut self) -> Option<u8> {
        if let Some(byte) = take_kept() {
            again();
            return Some(byte);
        }
        let status = self.usart.sr().read();
        let is_new = status.rxne().bit_is_set();
        if !is_new && status.ore().bit_is_clear() {
            return None;
        }
        let byte = self.usart.dr().read().dr().bits() as u8;
        is_new.then_some(byte)
    }

    /// Whether a byte can be sent.
    #[inline]
    fn can_send(&self) -> bool {
        self.usart.sr().read().txe().bit_is_set()
    }

    /// Sends a byte, or with `None` stops asking for more.
    #[inline]
    fn send(&mut self, byte: Option<u8>) {
        if let Some(byte) = byte {
            self.usart.dr().write(|w| w.dr().set(u16::from(byte)));
            // The emulator has no interrupt for "ready to send".
            if emulation::is_emulated() {
                again();
                return;
            }
        }
        if self.is_sending != byte.is_some() {
            self.set_sending(byte.is_some());
        }
    }

    fn set_sending(&mut self, is_sending: bool) {
        self.is_sending = is_sending;
        self.usart.cr1().write(|w| {
            w.ue().enabled().te().enabled().re().enabled();
            w.rxneie().enabled().txeie().bit(is_sending)
        });
    }
}

/// Lets the interrupt send what is queued.
pub(crate) fn start(sent: &ByteWriter<'_>) {
    if !sent.is_empty() {
        again();
    }
}

/// Runs the interrupt once more.
#[inline]
fn again() {
    rtic::pend(chosen::USART_VECTOR);
}

/// Bytes that may come while no task runs: more than senders have on their way.
const KEPT: usize = 256;

/// Bytes that have come while no task ran, how many they are, and how many have been taken.
static KEPT_BYTES: [AtomicU8; KEPT] = [const { AtomicU8::new(0) }; KEPT];
static KEPT_COUNT: AtomicUsize = AtomicUsize::new(0);
static KEPT_TAKEN: AtomicUsize = AtomicUsize::new(0);

/// Keeps the byte that has arrived, if one has, for the interrupt that is held up.
///
/// For code in RAM, with all tasks held up: it is inlined there.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
#[expect(unsafe_code, reason = "the interrupt owns the port")]
pub(super) fn keep() {
    // SAFETY: the interrupt does not run now.
    let usart = unsafe { &*Usart::ptr() };
    if usart.sr().read().rxne().bit_is_clear() {
        return;
    }
    let byte = usart.dr().read().dr().bits() as u8;
    let count = KEPT_COUNT.load(Relaxed);
    if let Some(place) = KEPT_BYTES.get(count) {
        place.store(byte, Relaxed);
        KEPT_COUNT.store(count + 1, Relaxed);
        again();
    }
}

/// The oldest byte that was kept.
#[inline]
fn take_kept() -> Option<u8> {
    let count = KEPT_COUNT.load(Relaxed);
    if count == 0 {
        return None;
    }
    let taken = KEPT_TAKEN.load(Relaxed);
    let byte = KEPT_BYTES.get(taken)?.load(Relaxed);
    let is_last = taken + 1 >= count;
    KEPT_COUNT.store(if is_last { 0 } else { count }, Relaxed);
    KEPT_TAKEN.store(if is_last { 0 } else { taken + 1 }, Relaxed);
    Some(byte)
}
