//! The state that a bootloader leaves, undone before the firmware sets up its own.

use cortex_m::peripheral::{NVIC, SYST};

use super::pac::RCC;

/// Takes back what a bootloader may have switched on: SysTick, interrupts, peripherals and its clocks. What
/// follows finds the chip as after a reset: RM0090 7.3.
#[expect(unsafe_code, reason = "raw words for registers")]
pub(super) fn undo(rcc: &RCC, systick: &mut SYST, nvic: &mut NVIC) {
    // SAFETY: every register of the two kinds takes any word; a one switches off or takes back an interrupt.
    unsafe {
        systick.csr.write(0);
        for (enabled, pending) in nvic.icer.iter().zip(&nvic.icpr) {
            enabled.write(u32::MAX);
            pending.write(u32::MAX);
        }
    }
    rcc.cr().modify(|_, w| w.hsion().set_bit());
    while rcc.cr().read().hsirdy().bit_is_clear() {}
    rcc.cfgr().reset();
    while !rcc.cfgr().read().sws().is_hsi() {}
    rcc.cr()
        .modify(|_, w| w.pllon().clear_bit().hseon().clear_bit());
    rcc.cr()
        .modify(|_, w| w.csson().clear_bit().hsebyp().clear_bit());
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
}
