//! The step timer: the registers of SysTick, whose counter stands, and the stand-in that counts in its place.

use cortex_m::peripheral::SYST;
use leadscrew::stepper::StepEvent;

use super::{pac, qemu, trace};

#[path = "../step_timer.rs"]
mod chip;

pub(super) use chip::{StepTimer, halt, is_running, set_reload};

/// Sets the time to the first interrupt, before [`start`].
pub(super) fn set_up(event: StepEvent) {
    chip::set_up(event);
    qemu::count(event.ticks());
}

/// Lets the stand-in interrupt at the time that has been set up; the time to the interrupt after it is the time of an
/// event.
#[inline]
#[expect(unsafe_code, reason = "the interrupt owns the timer")]
pub(super) fn start(following: StepEvent) {
    set_reload(following);
    // SAFETY: as in the chip's `start`, but for the counter.
    unsafe { (*SYST::PTR).csr.write(chip::TICKINT) };
}
