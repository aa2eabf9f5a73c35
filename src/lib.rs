//! Motion control without hardware: the same code runs in the firmware, the simulator and the tests.
//!
//! Modules are listed from the bottom up: each uses those above it in this list, and none below
//! (`tests/sources/layers.rs`).
#![no_std]
#![forbid(unsafe_code)]
#![warn(clippy::unwrap_used)]

#[cfg(test)]
extern crate std;

#[cfg(test)]
#[path = "../tests/support/cases.rs"]
mod cases;
#[cfg(test)]
use cases::cases;

pub mod axis;
pub mod decimal;
pub mod math;
pub mod units;

pub mod model;

pub mod settings;

pub mod gcode;
pub mod stepper;

pub mod path;

pub mod machine;

pub mod motion;

pub mod protocol;

pub mod tasks;

pub mod sim;
