//! The timer that releases `prepare` after a time: TIM6, on whose vector the task is.

use super::{emulation, pac};

/// Counts of the timer in a millisecond. A power of two would not divide 84 MHz.
const COUNTS_PER_MS: u32 = 2;
/// Longest time, ms: who waits longer asks again.
const LONGEST_MS: u32 = u16::MAX as u32 / COUNTS_PER_MS;

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

    /// Ends the interrupt now being served.
    #[inline]
    pub(crate) fn acknowledge(&mut self) {
        self.0.sr().write(|w| w.uif().clear_bit());
    }

    /// Releases the task after so many milliseconds, at least 1, instead of any earlier wish.
    pub(crate) fn set(&mut self, milliseconds: u32) {
        let milliseconds = milliseconds.clamp(1, LONGEST_MS);
        let counts = milliseconds * COUNTS_PER_MS;
        self.0.cr1().write(|w| w.urs().set_bit());
        self.0.arr().write(|w| w.arr().set(counts as u16));
        self.0.egr().write(|w| w.ug().set_bit());
        self.0
            .cr1()
            .write(|w| w.urs().set_bit().opm().set_bit().cen().set_bit());
        emulation::wake_in(milliseconds);
    }
}
