//! The state of clocks and peripherals after a reset, made again behind a bootloader.
//!
//! The ROM's own bootloader leaves the PLL as the clock, at 60 MHz, and PLLCFGR takes nothing while the PLL runs;
//! others leave timers, ports and lines of EXTI. [`undo`] runs at the beginning of `init`. RTIC has enabled the
//! interrupts of its tasks by then, so the processor's own state is `pre_init`'s matter. RM0090 7.3, 12.3.

use cortex_m::peripheral::NVIC;

use super::pac::{EXTI, RCC};

/// Bits of `RCC_CR`: RM0090 7.3.1.
const HSI_ON: u32 = 1;
const HSI_TRIM_CENTRE: u32 = 16 << 3;
const PLLS_READY: u32 = 1 << 25 | 1 << 27 | 1 << 29;
/// Bits of `RCC_CIR` that clear pending flags: RM0090 7.3.4.
const CLEAR_PENDING: u32 = 0xff << 16;
/// `RCC_DCKCFGR`, whose TIMPRE doubles the clock of timers: RM0090 6.3.25. The PAC of the F407 does not have it, and its
/// image also runs on the F429.
const DCKCFGR: *mut u32 = 0x4002_388c as *mut u32;
/// `RCC_DCKCFGR2`, whose CK48MSEL takes the clock of USB from another PLL: RM0390 6.3.28.
#[cfg(feature = "chip-f446")]
const DCKCFGR2: *mut u32 = 0x4002_3894 as *mut u32;

/// Puts clocks and peripherals into their state after a reset; the watchdog ends a wait that does not end.
#[expect(unsafe_code, reason = "raw words for registers")]
pub(super) fn undo(rcc: &RCC, exti: &EXTI, nvic: &NVIC) {
    rcc.cr().modify(|_, w| w.hsion().set_bit());
    while rcc.cr().read().hsirdy().bit_is_clear() {}
    rcc.cfgr().reset();
    while !rcc.cfgr().read().sws().is_hsi() {}
    // The guard of the crystal goes off first: it must not take its end for a fault.
    rcc.cr().modify(|_, w| w.csson().clear_bit());
    // SAFETY: the internal oscillator alone runs, with the trim of a reset.
    rcc.cr()
        .write(|w| unsafe { w.bits(HSI_ON | HSI_TRIM_CENTRE) });
    // PLLCFGR takes nothing before.
    while rcc.cr().read().bits() & PLLS_READY != 0 {}
    rcc.pllcfgr().reset();
    // SAFETY: no interrupt is enabled, and none stays pending.
    rcc.cir().write(|w| unsafe { w.bits(CLEAR_PENDING) });
    // SAFETY: a one resets a peripheral, a zero lets it run; reserved bits have no effect.
    unsafe {
        for word in [u32::MAX, 0] {
            rcc.ahb1rstr().write(|w| w.bits(word));
            rcc.ahb2rstr().write(|w| w.bits(word));
            rcc.apb1rstr().write(|w| w.bits(word));
            rcc.apb2rstr().write(|w| w.bits(word));
        }
    }
    rcc.ahb1enr().reset();
    rcc.ahb2enr().reset();
    rcc.apb1enr().reset();
    rcc.apb2enr().reset();
    rcc.ahb1lpenr().reset();
    rcc.ahb2lpenr().reset();
    rcc.apb1lpenr().reset();
    rcc.apb2lpenr().reset();
    rcc.sscgr().reset();
    // SAFETY: zero is the value after a reset; the F405 and F407 have no such register, and take no write.
    unsafe { DCKCFGR.write_volatile(0) };
    #[cfg(feature = "chip-f446")]
    // SAFETY: zero is the value after a reset.
    unsafe {
        DCKCFGR2.write_volatile(0);
    }
    // No bit of RCC resets it.
    exti.imr().reset();
    exti.emr().reset();
    exti.rtsr().reset();
    exti.ftsr().reset();
    // SAFETY: a one takes back a pending line.
    exti.pr().write(|w| unsafe { w.bits(u32::MAX) });
    // What peripherals have asked for since the beginning: the detector of a low supply would stop the machine.
    cortex_m::asm::dsb();
    for pending in &nvic.icpr {
        // SAFETY: a one takes back an interrupt.
        unsafe { pending.write(u32::MAX) };
    }
}
