//! Motion control without hardware: the same code runs in the firmware, the simulator and the tests.
#![no_std]
#![forbid(unsafe_code)]
#![warn(clippy::unwrap_used)]

#[cfg(test)]
extern crate std;

pub mod axis;
pub mod gcode;
pub mod interpreter;
pub mod machine;
pub mod math;
pub mod planner;
pub mod protocol;
pub mod settings;
pub mod sim;
pub mod stepper;
pub mod units;
