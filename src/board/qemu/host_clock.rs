//! The clock of `interpret` in firmware with the RepRap dialect: QEMU's TIM4, which counts ns in 32 bits.

use leadscrew::model::{HAS_REPRAP, timing::TICK_MS};

use super::{chosen, pac};

#[path = "../host_clock.rs"]
mod chip;

pub(crate) use chip::take_tick;

/// Sets the timer up.
#[expect(unsafe_code, reason = "a register of 32 bits")]
pub(super) fn init(timer: &pac::TIM4) {
    if HAS_REPRAP {
        // SAFETY: any period is legal.
        unsafe { timer.arr().write(|w| w.bits(TICK_MS * 1_000_000)) };
        timer.dier().write(|w| w.uie().set_bit());
        timer.cr1().write(|w| w.urs().set_bit().cen().set_bit());
    }
}
