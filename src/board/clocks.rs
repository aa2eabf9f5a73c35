//! The clocks of the chip: from the crystal, or without it, where the machine only says so.
//!
//! The full speed is for a good supply only: with one that is too low, the machine only says so, too.
//!
//! Registers: RM0090 5.4, 7.3; RM0383 5.4.
//!
//! # Cost
//! `start` is the only place that sets the wait states and the caches of the flash beside `flash`.

use leadscrew::{model::SelfTestFault, units::TICKS_PER_SECOND};
use stm32f4xx_hal::{
    rcc::{Config, Rcc},
    time::Hertz,
};

use super::{
    chosen::{BUSES_HZ, TIMERS_MHZ, WIRING, flash_access},
    crystal, pac,
};

const _: () = assert!(
    WIRING.core_hz == 2 * TICKS_PER_SECOND,
    "the library has the ticks of another clock than that of the board's chip"
);

/// Whether the regulator's voltage after a reset, its scale 2, is for less than the clock of the core. That is so on
/// the chips of 100 MHz, where it is for 84 MHz; the faster ones begin with their highest: RM0383 5.4.1, RM0090 5.4.1.
const NEEDS_SCALE_1: bool = WIRING.core_hz > 84_000_000 && WIRING.core_hz <= 100_000_000;
/// Scale 1 of the regulator, in `PWR_CR`.
const SCALE_1: u32 = 0b11 << 14;

/// The clocks, and why the crystal does not make them.
pub(super) struct Clocks {
    pub(super) rcc: Rcc,
    pub(super) fault: Option<SelfTestFault>,
}

/// Sets the clocks of the board, and reads flash without prefetch. Without the crystal, or where the voltage detector
/// runs and finds the supply too low, or with a crystal of another frequency, the internal oscillator takes its place,
/// at 16 MHz: good enough for alarm 16, and for nothing else. After `supply::watch`, which gives the registers of the supply their clock.
///
/// # Panics
///
/// If the clock of the core, of a bus, or of TIM9 and TIM10 is not the one of the board's chip: every time would be wrong.
#[expect(unsafe_code, reason = "a register that nobody owns")]
pub(super) fn start(mut rcc: Rcc, flash: &pac::FLASH) -> Clocks {
    // SAFETY: the flag is only read, and the field of the voltage is written here alone, before tasks run.
    let power = unsafe { &*pac::PWR::ptr() };
    let fault = if power.csr().read().pvdo().bit_is_set() {
        Some(SelfTestFault::LowSupply)
    } else {
        crystal::start(&mut rcc).err()
    };
    if fault.is_none() {
        raise_voltage(power);
        rcc = rcc.freeze(from_crystal().sysclk(Hertz::from_raw(WIRING.core_hz)));
        await_pll(&rcc);
        let set = &rcc.clocks;
        let (core_hz, timers_hz) = (set.hclk().raw(), set.timclk2().raw());
        let buses_hz = [set.pclk1().raw(), set.pclk2().raw()];
        assert!(
            core_hz == 2 * TICKS_PER_SECOND
                && timers_hz == u32::from(TIMERS_MHZ) * 1_000_000
                && buses_hz == BUSES_HZ,
            "the step timer counts half ticks, TIM9 and TIM10 count what their dividers are for, and an access to a bus \
             takes as long as the proof counts"
        );
        assert!(
            !cfg!(feature = "usb") || set.pll48clk() == Some(Hertz::MHz(48)),
            "USB has its clock"
        );
        assert!(
            is_core_clock(&rcc),
            "the registers of the clocks have what was written to them"
        );
    }
    flash.acr().write(|w| flash_access(w).dcen().set_bit());
    Clocks { rcc, fault }
}

/// Waits until the PLL is the clock, which the HAL does not; a wait that does not end is the watchdog's.
fn await_pll(rcc: &pac::RCC) {
    while !rcc.cfgr().read().sws().is_pll() {}
}

/// Returns whether the registers say that the core has its clock: PLLCFGR takes nothing while the PLL runs, and
/// nobody else looks. RM0090 7.3.2.
fn is_core_clock(rcc: &pac::RCC) -> bool {
    let pll = rcc.pllcfgr().read();
    let [m, n] = [pll.pllm().bits().into(), u32::from(pll.plln().bits())];
    let p = 2 * (u32::from(pll.pllp().bits()) + 1);
    let is_exact =
        u64::from(WIRING.crystal_hz) * u64::from(n) == u64::from(WIRING.core_hz) * u64::from(m * p);
    is_exact && pll.pllsrc().is_hse()
}

/// Sets the voltage that the clock needs. The voltage takes effect when the PLL is switched on, which must not run yet.
/// The code assumes the full voltage by the time that the PLL is ready, as the HAL leaves no place to read `VOSRDY`.
#[expect(unsafe_code, reason = "a raw word for a register")]
fn raise_voltage(power: &pac::pwr::RegisterBlock) {
    if NEEDS_SCALE_1 {
        // SAFETY: the field takes any number but 0.
        power
            .cr()
            .modify(|cr, w| unsafe { w.bits(cr.bits() | SCALE_1) });
    }
}

fn from_crystal() -> Config {
    let mut config = Config::hse(Hertz::from_raw(WIRING.crystal_hz));
    if cfg!(feature = "usb") {
        config = config.require_pll48clk();
    }
    if WIRING.is_crystal_bypassed {
        config.bypass_hse_oscillator()
    } else {
        config
    }
}
