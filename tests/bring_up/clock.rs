//! The time: the processor's cycle counter, or TIM5 of the emulator, which counts its nanoseconds.

use cortex_m::{
    Peripherals as Core,
    peripheral::{DCB, DWT},
};

use super::{chosen::WIRING, emulation, pac};

/// Starts the cycle counter, also for the time in which the processor sleeps.
pub(super) fn start(core: &mut Core, debug: &pac::DBGMCU) {
    if !emulation::is_emulated() {
        debug.cr().modify(|_, w| w.dbg_sleep().set_bit());
        let (control, watch): (&mut DCB, &mut DWT) = (&mut core.DCB, &mut core.DWT);
        control.enable_trace();
        watch.enable_cycle_counter();
    }
}

/// Returns the count of what counts here, wrapping.
#[inline(always)]
#[expect(clippy::inline_always, reason = "it is a read of a register")]
#[expect(unsafe_code, reason = "a timer that nobody owns")]
pub(super) fn now() -> u32 {
    if emulation::is_emulated() {
        // SAFETY: reads a register without side effects.
        unsafe { (*pac::TIM5::ptr()).cnt().read().cnt().bits() }
    } else {
        DWT::cycle_count()
    }
}

/// Returns the cycles of the processor in a difference of counts.
pub(super) fn cycles(counts: u32) -> i64 {
    let counts = i64::from(counts);
    if emulation::is_emulated() {
        counts * i64::from(WIRING.core_hz / 1_000_000) / 1000
    } else {
        counts
    }
}

/// Waits for so many cycles at least, with the processor running.
pub(super) fn wait(at_least: i64) {
    let start = now();
    while cycles(now().wrapping_sub(start)) < at_least {}
}
