//! Supervision of the supply: where it falls, the machine stops, and nothing is written to the flash.
//!
//! The core runs at its full speed, and the flash takes whole words, from 2.7 V on (data sheet, general
//! operating conditions). Below that it may do anything, with outputs on. So the chip goes to its full speed only
//! once the voltage detector has found the supply good, and stops at 2.9 V: RM0090 5.2.3, 5.4.

use leadscrew::model::ResetCause;
use stm32f4xx_hal::rcc::{Enable, Rcc};

use super::{
    fault,
    pac::{self, Interrupt, NVIC},
    vectors, watchdog,
};

/// The line of EXTI that rises when the supply falls; `inputs` unmasks it.
pub(super) const LINE: u32 = 1 << 16;
/// The threshold of the detector: 2.85 to 2.99 V where the supply falls, 2.96 to 3.10 V where it rises (data sheet,
/// power control block). The one above, up to 3.21 V, would never find a supply of 3.3 V good that is low by 3 %.
const PVD_THRESHOLD: u8 = 0b110;
/// Above every task: RTIC has priorities up to 5, and no lock masks this.
const PRIORITY: u8 = 16;
/// Cycles for the detector to begin, 0.1 ms, before its flag counts.
const PVD_SETTLING_CYCLES: u32 = 1600;
/// Reads of the flag before the supply counts as too low at power-up: more than 100 ms at the 16 MHz of the internal
/// oscillator, of which each read takes 8 cycles at least.
const MAX_PVD_READS: u32 = 200_000;

/// Starts the detector, and waits while a supply still rises; `clocks` looks whether it has.
pub(super) fn watch(pwr: &pac::PWR, rcc: &mut Rcc, nvic: &mut NVIC) {
    pac::PWR::enable(rcc);
    pwr.cr()
        .modify(|_, w| w.pls().set(PVD_THRESHOLD).pvde().set_bit());
    watchdog::pause(PVD_SETTLING_CYCLES);
    vectors::unmask(nvic, &[Interrupt::PVD], PRIORITY);
    let _ = watchdog::await_flag(MAX_PVD_READS, || !is_low());
}

/// Has the machine stop, as soon as interrupts are on, if the supply has fallen before the line was unmasked: the
/// detector tells a fall only once.
pub(super) fn check() {
    if is_low() {
        NVIC::pend(Interrupt::PVD);
    }
}

/// Returns whether the supply is too low.
#[expect(unsafe_code, reason = "nobody else reads the register")]
pub(super) fn is_low() -> bool {
    // SAFETY: reads a register without side effects.
    let pwr = unsafe { &*pac::PWR::ptr() };
    pwr.csr().read().pvdo().bit_is_set()
}

/// Stops the machine.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a vector that RTIC does not manage")]
extern "C" fn PVD() {
    fault::stop(ResetCause::Supply)
}
