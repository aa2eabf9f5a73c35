//! The board that the firmware is built for, as `build.rs` makes it of the board's file.

use leadscrew::model::Levels;
use stm32f4xx_hal::rcc::{Enable, Rcc};

use super::{
    pac,
    wiring::{AccessoryPins, Input, JournalPage, MotorPins, Output, Pin, Pull, Pwm, Wiring},
};

include!(concat!(env!("OUT_DIR"), "/board.rs"));
