//! The watchdog, which QEMU has not: beside its registers, a count of TIM3's runs, which interrupts everything.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use cortex_m::peripheral::SCB;
use leadscrew::model::ResetCause;

use super::{fault, pac, qemu};

#[path = "../watchdog.rs"]
mod chip;

pub(super) use chip::{RELOAD, await_flag, pause};

/// The vector that stands in for the watchdog, and its priority, above all others.
const VECTOR: pac::Interrupt = pac::Interrupt::TIM3;
const PRIORITY: u8 = 0x10;
/// Its period, ns: 50 ms. The emulator's counters all have 32 bits.
const PERIOD_NS: u32 = 50_000_000;
/// Its runs left before it resets the machine; 0 before it is fed for the first time.
static RUNS: AtomicU32 = AtomicU32::new(0);
/// All of them: 8 s, unless the host is busy.
const FULL: u32 = 160;

/// Starts both.
#[expect(unsafe_code, reason = "a timer that nobody owns")]
pub(super) fn start(watchdog: &pac::IWDG, debug: &pac::DBGMCU) {
    chip::start(watchdog, debug);
    // SAFETY: the handler, which does not run yet, alone uses the timer.
    let timer = unsafe { &*pac::TIM3::ptr() };
    timer.dier().write(|w| w.uie().set_bit());
    timer.cr1().write(|w| w.cen().set_bit());
    // SAFETY: any period is legal.
    unsafe { timer.arr().write(|w| w.bits(PERIOD_NS)) };
    qemu::unmask(VECTOR, PRIORITY);
}

/// Sets the period of the registers.
pub(super) fn set_period(watchdog: &pac::IWDG) {
    chip::set_period(watchdog);
}

/// Feeds both.
pub(crate) fn feed() {
    chip::feed();
    RUNS.store(FULL, Relaxed);
}

/// Counts a run, and resets the machine at the last, as the chip's watchdog does.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a vector that RTIC does not manage")]
extern "C" fn TIM3() {
    // SAFETY: the handler alone uses the timer.
    let timer = unsafe { &*pac::TIM3::ptr() };
    timer.sr().write(|w| w.uif().clear_bit());
    let left = RUNS.load(Relaxed);
    if left == 1 {
        fault::stop_machine(ResetCause::Watchdog);
        SCB::sys_reset();
    }
    RUNS.store(left.saturating_sub(1), Relaxed);
}
