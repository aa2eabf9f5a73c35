//! The timer that releases `prepare` after a time: TIM6, on whose vector the task is.

use super::{emulation, pac};

/// Counts of the timer in a millisecond: its prescaler has 16 bits.
const COUNTS_PER_MS: u16 = 2;
/// Longest time, ms.
const LONGEST_MS: u16 = u16::MAX / COUNTS_PER_MS;

/// The timer, owned by `prepare`.
pub(crate) struct WakeTimer(pac::TIM6);

impl WakeTimer {
    /// Sets the timer up. Its clock must run, at 84 MHz.
    pub(super) fn new(timer: pac::TIM6) -> Self {
        timer.psc().write(|w| w.psc().set(42_000 - 1));
        timer.cr1().write(|w| w.urs().set_bit());
        timer.egr().write(|w| w.ug().set_bit());
        timer.dier().write(|w| w.uie().set_bit());
        Self(timer)
    }

    /// Returns once whether the time is over. Ends the interrupt.
    #[inline]
    pub(crate) fn take_end(&mut self) -> bool {
        if emulation::is_emulated() {
            return emulation::take_wake();
        }
        let is_over = self.0.sr().read().uif().bit_is_set();
        if is_over {
            self.0.sr().write(|w| w.uif().clear_bit());
        }
        is_over
    }

    /// Releases the task after some milliseconds, at least 1, instead of at the time set before.
    pub(crate) fn set(&mut self, milliseconds: u16) {
        let counts = milliseconds.clamp(1, LONGEST_MS) * COUNTS_PER_MS;
        self.0.cr1().write(|w| w.urs().set_bit());
        self.0.arr().write(|w| w.arr().set(counts));
        self.0.egr().write(|w| w.ug().set_bit());
        // The earlier wish may have come true just now.
        self.0.sr().write(|w| w.uif().clear_bit());
        self.0
            .cr1()
            .write(|w| w.urs().set_bit().opm().set_bit().cen().set_bit());
        emulation::wake_in(milliseconds);
    }
}
