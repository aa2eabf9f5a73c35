//! The clock of `trace`: QEMU has no cycle counter, and its TIM5 counts its virtual time in ns.

use super::pac;

/// Returns the time, ns.
#[inline]
#[expect(unsafe_code, reason = "a timer that nobody owns")]
pub(super) fn now() -> u32 {
    // SAFETY: reads a register without side effects.
    unsafe { (*pac::TIM5::ptr()).cnt().read().cnt().bits() }
}

/// Returns how late an event is: none ever is.
pub(super) const fn lateness() -> u32 {
    0
}
