//! The firmware itself, over its serial line, on the emulated board.
//!
//! `cargo xtask test` builds the image and names it in `FIRMWARE_ELF`, and the image for the chip in
//! `CHIP_FIRMWARE_ELF`; without them there is nothing to run.
#![cfg(not(target_os = "none"))]

#[path = "../support/cases.rs"]
mod cases;
mod cycles;
mod faults;
mod image;
mod inputs;
mod lines;
mod machine;
mod memory;
mod preemption;
mod priorities;
mod proven;
mod sender;
