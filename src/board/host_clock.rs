//! The clock of `interpret` in firmware with the RepRap dialect: TIM4, whose vector `wake` binds.

use leadscrew::model::{HAS_REPRAP, timing::TICK_MS};

use super::{chosen::SLOW_TIMERS_HZ, pac};

/// Counts of the timer in a second.
const COUNTS_HZ: u32 = 10_000;
/// Divider of the timer's clock, less one.
const PRESCALER: u16 = (SLOW_TIMERS_HZ / COUNTS_HZ - 1) as u16;
const _: () = assert!(
    SLOW_TIMERS_HZ.is_multiple_of(COUNTS_HZ) && SLOW_TIMERS_HZ / COUNTS_HZ <= 1 << 16,
    "the timer cannot count 10 kHz"
);

/// Sets the timer up: 100 counts are [`TICK_MS`].
pub(super) fn init(timer: &pac::TIM4) {
    const PERIOD: u16 = (COUNTS_HZ / 1000 * TICK_MS - 1) as u16;
    if !HAS_REPRAP {
        return;
    }
    timer.psc().write(|w| w.psc().set(PRESCALER));
    timer.arr().write(|w| w.arr().set(PERIOD));
    timer.cr1().write(|w| w.urs().set_bit());
    timer.egr().write(|w| w.ug().set_bit());
    timer.dier().write(|w| w.uie().set_bit());
    timer.cr1().write(|w| w.urs().set_bit().cen().set_bit());
}

/// Takes a tick, for `wake`: returns whether one has come since the last call.
#[expect(unsafe_code, reason = "the task that binds the vector owns the timer")]
pub(crate) fn take_tick() -> bool {
    if !HAS_REPRAP {
        return false;
    }
    // SAFETY: only this function uses the timer once it runs.
    let timer = unsafe { &*pac::TIM4::ptr() };
    let is_due = timer.sr().read().uif().bit_is_set();
    if is_due {
        timer.sr().write(|w| w.uif().clear_bit());
    }
    is_due
}
