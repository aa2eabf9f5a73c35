//! The backup domain: it outlives every reset, and has a say in pins PC13 to PC15. RM0090 5.1.2, 7.3.20.

use super::{
    pac::{PWR, RCC},
    watchdog,
};

/// Reads of a bit before it counts as stuck: many more than a write takes.
const MAX_READS: u32 = 1000;

/// Resets the domain where another firmware has left the slow crystal or the real-time clock running: PC14 and PC15
/// are the crystal's as long as it is on, and PC13 may be the real-time clock's. The registers of the supply must have their clock.
#[expect(unsafe_code, reason = "a raw word for a register")]
pub(super) fn release_pins(rcc: &RCC, power: &PWR) {
    let domain = rcc.bdcr().read();
    if domain.lseon().bit_is_clear() && domain.rtcen().bit_is_clear() {
        return;
    }
    power.cr().modify(|_, w| w.dbp().set_bit());
    // The buses of both registers are of different speed.
    let _ = watchdog::await_flag(MAX_READS, || power.cr().read().dbp().bit_is_set());
    rcc.bdcr().modify(|_, w| w.bdrst().set_bit());
    // SAFETY: zero is the value after a reset.
    rcc.bdcr().write(|w| unsafe { w.bits(0) });
    power.cr().modify(|_, w| w.dbp().clear_bit());
}
