//! The clock of the motion: TIM5, which counts ticks, as the step timer does. It wraps after 51 s at 168 MHz.

use leadscrew::units::{TICKS_PER_MS, TICKS_PER_SECOND};

use super::{chosen::SLOW_TIMERS_HZ, pac};

/// Divider of the timer's clock, less one.
const PRESCALER: u16 = (SLOW_TIMERS_HZ / TICKS_PER_SECOND - 1) as u16;
const _: () = assert!(
    SLOW_TIMERS_HZ.is_multiple_of(TICKS_PER_SECOND),
    "the timer cannot count ticks"
);

/// Starts the clock. The clock of the timer must run.
pub(super) fn start(timer: &pac::TIM5) {
    timer.psc().write(|w| w.psc().set(PRESCALER));
    timer.egr().write(|w| w.ug().set_bit());
    timer.cr1().write(|w| w.cen().set_bit());
}

/// Returns the time, ticks, wrapping.
#[inline]
#[expect(unsafe_code, reason = "every task reads the counter")]
pub(super) fn now_ticks() -> u32 {
    // SAFETY: reads a register without side effects.
    unsafe { (*pac::TIM5::ptr()).cnt().read().bits() }
}

/// Returns whether a millisecond has passed since a time, which then becomes now. Of several, one counts: a break is
/// noticed later, then.
pub(super) fn take_millisecond(since_ticks: &mut u32) -> bool {
    let now = now_ticks();
    let has_passed = now.wrapping_sub(*since_ticks) >= TICKS_PER_MS;
    if has_passed {
        *since_ticks = now;
    }
    has_passed
}
