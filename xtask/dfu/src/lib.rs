//! `cargo xtask flash --dfu`: the firmware to the bootloader in the chip's ROM, over USB.
//!
//! The commands and their states are of ST AN3156 and USB DFU 1.1. What goes over USB is by the trait of `dfu-core`: a
//! device of the system ([`usb`]), or the model of the chips' ROM in the tests.
#![allow(
    clippy::missing_errors_doc,
    clippy::must_use_candidate,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

mod fault;
mod loader;
pub mod usb;

pub use crate::{
    fault::Fault,
    loader::{RomBootloader, Step},
};
