//! The USART of the sender after a fault, when no task runs any more; also on a board whose sender is at the USB socket.

use core::fmt;

use super::chosen::Usart;

/// Reads of the status before the port counts as dead, after a fault: some ms, many times a byte.
const FAULT_READS: u32 = 100_000;

/// The port after a fault, when no task runs any more.
pub(super) struct FaultPort;

impl FaultPort {
    /// Switches the sending half on, where the firmware does not start. Baud rate and pins must be set up.
    #[expect(unsafe_code, reason = "nothing else runs")]
    pub(super) fn open() {
        // SAFETY: no task has begun.
        let usart = unsafe { &*Usart::ptr() };
        usart.cr1().write(|w| w.ue().enabled().te().enabled());
    }

    /// Waits until everything has been sent, for a bounded time.
    #[expect(unsafe_code, reason = "nothing else runs")]
    pub(super) fn drain() {
        // SAFETY: reads a register without side effects.
        let usart = unsafe { &*Usart::ptr() };
        let _ = (0..FAULT_READS).any(|_| usart.sr().read().tc().bit_is_set());
    }
}

impl FaultPort {
    /// Sends a text; one copy of this is enough.
    #[inline(never)]
    #[expect(unsafe_code, reason = "nothing else runs")]
    fn send(text: &str) -> fmt::Result {
        // SAFETY: no task runs any more.
        let usart = unsafe { &*Usart::ptr() };
        for byte in text.bytes() {
            let is_ready = (0..FAULT_READS).any(|_| usart.sr().read().txe().bit_is_set());
            if !is_ready {
                return Err(fmt::Error);
            }
            usart.dr().write(|w| w.dr().set(byte.into()));
        }
        Ok(())
    }
}

impl fmt::Write for FaultPort {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        Self::send(text)
    }
}
