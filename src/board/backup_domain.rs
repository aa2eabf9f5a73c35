//! The backup domain: it outlives every reset, and has a say in pins PC13 to PC15. RM0090 5.1.2, 7.3.20.

use super::pac::{PWR, RCC};

/// Resets the domain where another firmware has left the slow crystal or the clock of the day running: PC14 and PC15
/// are the crystal's as long as it is on, and PC13 may be the clock's. The registers of the supply must have their clock.
#[expect(unsafe_code, reason = "a raw word for a register")]
pub(super) fn release_pins(rcc: &RCC, power: &PWR) {
    let domain = rcc.bdcr().read();
    if domain.lseon().bit_is_clear() && domain.rtcen().bit_is_clear() {
        return;
    }
    power.cr().modify(|_, w| w.dbp().set_bit());
    rcc.bdcr().modify(|_, w| w.bdrst().set_bit());
    // SAFETY: zero is the value after a reset.
    rcc.bdcr().write(|w| unsafe { w.bits(0) });
    power.cr().modify(|_, w| w.dbp().clear_bit());
}
