//! The timer of the delay that `prepare` asks for: TIM9, whose vector the task binds.

use super::{chosen::TIMERS_MHZ, pac};

/// Counts of the timer in a millisecond: its prescaler has 16 bits.
const COUNTS_PER_MS: u16 = 4;
/// Divider of the timer's clock.
const PRESCALER: u16 = (TIMERS_MHZ as u32 * 1000 / COUNTS_PER_MS as u32) as u16;
/// Longest delay, ms.
const LONGEST_MS: u16 = u16::MAX / COUNTS_PER_MS;

/// The timer, owned by `prepare`.
pub(crate) struct DelayTimer(pac::TIM9);

impl DelayTimer {
    /// Sets the timer up. Its clock must run.
    pub(super) fn new(timer: pac::TIM9) -> Self {
        timer.psc().write(|w| w.psc().set(PRESCALER - 1));
        timer.cr1().write(|w| w.urs().set_bit());
        timer.egr().write(|w| w.ug().set_bit());
        timer.dier().write(|w| w.uie().set_bit());
        Self(timer)
    }

    /// Takes the end of the delay: returns whether it has come since the last call. Acknowledges the
    /// interrupt.
    pub(crate) fn take_end(&mut self) -> bool {
        let is_over = self.0.sr().read().uif().bit_is_set();
        if is_over {
            self.0.sr().write(|w| w.uif().clear_bit());
        }
        is_over
    }

    /// Begins a delay of at least 1 ms, instead of the one begun before.
    pub(crate) fn start(&mut self, delay_ms: u16) {
        let counts = delay_ms.clamp(1, LONGEST_MS) * COUNTS_PER_MS;
        self.0.cr1().write(|w| w.urs().set_bit());
        self.0.arr().write(|w| w.arr().set(counts));
        self.0.egr().write(|w| w.ug().set_bit());
        // The delay begun before may have ended just now.
        self.0.sr().write(|w| w.uif().clear_bit());
        self.0
            .cr1()
            .write(|w| w.urs().set_bit().opm().set_bit().cen().set_bit());
    }
}
