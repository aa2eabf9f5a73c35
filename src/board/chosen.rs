//! The board that the firmware is built for, as `build.rs` makes it from the board's file, with derived constants.
//!
//! # Cost
//!
//! Flash is read without prefetch: lines that the prefetch buffer serves never enter the instruction
//! cache. Without it, interrupts that run again and again are faster, and their worst case is lower. What
//! is written to the flash's access control must be a constant: the analysis compares it.

use leadscrew::model::Levels;
use stm32f4xx_hal::rcc::{Enable, Rcc};

#[cfg(feature = "eeprom")]
use super::wiring::EepromPins;
#[cfg(not(feature = "eeprom"))]
use super::wiring::JournalPage;
use super::{
    pac,
    wiring::{AccessoryPins, Input, MotorPins, Output, Pin, Pull, Pwm, Wiring},
};

include!(concat!(env!("OUT_DIR"), "/board.rs"));

/// The clock of TIM9 and TIM10, MHz: that of the core on every chip.
pub(super) const TIMERS_MHZ: u16 = (WIRING.core_hz / 1_000_000) as u16;

/// Sets what every write of the register has in common, as the board's chip says: wait states, and no prefetch.
pub(super) fn flash_access(w: &mut pac::flash::acr::W) -> &mut pac::flash::acr::W {
    w.latency().set(WIRING.flash_wait_states).icen().set_bit()
}
