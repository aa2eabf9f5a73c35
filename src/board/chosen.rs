//! The board that the firmware is built for, as `build.rs` makes it of the board's file.

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
