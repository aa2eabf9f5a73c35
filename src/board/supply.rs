//! Supervision of the supply: where it falls, the machine stops, and nothing is written to the flash.
//!
//! The core runs at its full speed, and the flash takes whole words, from 2.7 V on (data sheet, general
//! operating conditions). Below that it may do anything, with outputs on. The voltage detector of the chip
//! warns at 2.9 V, a tenth of a volt below what a board at its lowest should have. RM0090 5.2.3, 5.4.

use leadscrew::model::ResetCause;
use stm32f4xx_hal::rcc::{Enable, Rcc};

use super::{
    fault,
    pac::{self, Interrupt, NVIC},
    vectors,
};

/// The line of EXTI that rises when the supply falls; [`super::InputInterrupts`] unmasks it.
pub(super) const LINE: u32 = 1 << 16;
/// The highest threshold of the detector.
const THRESHOLD: u8 = 0b111;
/// Above every task: RTIC has priorities up to 5, and no lock masks this.
const PRIORITY: u8 = 16;
/// Reads of the flag before the supply counts as too low at power-up: some ms.
const READS: u32 = 50_000;

/// Starts the detector. Returns false if the supply is too low.
pub(super) fn watch(pwr: &pac::PWR, rcc: &mut Rcc, nvic: &mut NVIC) -> bool {
    pac::PWR::enable(rcc);
    pwr.cr()
        .modify(|_, w| w.pls().set(THRESHOLD).pvde().set_bit());
    vectors::unmask(nvic, &[Interrupt::PVD], PRIORITY);
    (0..READS).any(|_| !is_low())
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
