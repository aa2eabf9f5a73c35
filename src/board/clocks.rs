//! The clocks of the chip: from the crystal, or without it, where the machine only says so.
//!
//! Registers: RM0090 7.3.
//!
//! # Cost
//! `start` is the only place that sets the wait states and the caches of the flash beside `flash`.

use leadscrew::units::TICKS_PER_SECOND;
use stm32f4xx_hal::{
    rcc::{Config, Rcc},
    time::Hertz,
};

use super::{TIMERS_MHZ, chosen::WIRING, emulation, flash_access, pac};

const _: () = assert!(
    WIRING.core_hz == 2 * TICKS_PER_SECOND,
    "the library has the ticks of another clock than that of the board's chip"
);

/// Reads of the crystal's flag before the crystal counts as missing: more than 100 ms at the 16 MHz of the
/// internal oscillator, of which each read takes 8 cycles at least. A crystal needs 2 ms (data sheet, HSE).
const CRYSTAL_READS: u32 = 200_000;

/// The clocks, and whether the crystal makes them.
pub(super) struct Clocks {
    pub(super) rcc: Rcc,
    pub(super) has_crystal: bool,
}

/// Sets the clocks of the board, and reads flash without prefetch. Without the crystal, the internal
/// oscillator takes its place, at a tenth of the frequency: good enough to say so, and for nothing else.
///
/// # Panics
///
/// If the core does not count half ticks with the crystal, or TIM9 and TIM10 do not count its cycles: every time would be wrong.
pub(super) fn start(rcc: Rcc, flash: &pac::FLASH) -> Clocks {
    let is_emulated = emulation::is_emulated();
    let has_crystal = is_emulated || start_crystal(&rcc);
    // The emulator's PLL would never report ready: its clocks stay as they are.
    let is_internal = is_emulated || !has_crystal;
    let rcc = if is_internal {
        rcc
    } else {
        rcc.freeze(from_crystal().sysclk(Hertz::from_raw(WIRING.core_hz)))
    };
    let (core_hz, timers_hz) = (rcc.clocks.hclk().raw(), rcc.clocks.timclk2().raw());
    assert!(
        is_internal
            || core_hz == 2 * TICKS_PER_SECOND && timers_hz == u32::from(TIMERS_MHZ) * 1_000_000,
        "the step timer counts half ticks, and TIM9 and TIM10 count what their dividers are for"
    );
    flash.acr().write(|w| flash_access(w).dcen().set_bit());
    if has_crystal {
        // A crystal that stops later is an NMI, which stops the machine: RM0090 7.2.7.
        rcc.cr().modify(|_, w| w.csson().set_bit());
    }
    Clocks { rcc, has_crystal }
}

fn from_crystal() -> Config {
    let config = Config::hse(Hertz::from_raw(WIRING.crystal_hz));
    if WIRING.is_crystal_bypassed {
        config.bypass_hse_oscillator()
    } else {
        config
    }
}

/// Starts the crystal. Returns false, with the crystal off, if it does not run in time.
fn start_crystal(rcc: &pac::RCC) -> bool {
    rcc.cr()
        .modify(|_, w| w.hsebyp().bit(WIRING.is_crystal_bypassed));
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let runs = (0..CRYSTAL_READS).any(|_| rcc.cr().read().hserdy().bit_is_set());
    if !runs {
        rcc.cr()
            .modify(|_, w| w.hseon().clear_bit().hsebyp().clear_bit());
    }
    runs
}
