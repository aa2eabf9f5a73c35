//! A job on the virtual machine: program and settings, their run, and what a page shows of it.
//!
//! It needs no operating system: a browser runs it too.
#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

#[cfg(test)]
#[path = "../../../tests/support/cases.rs"]
mod cases;
mod columns;
mod curves;
pub mod figures;
pub mod holes;
mod job;
pub mod job_times;
mod merge;
pub mod play;
pub mod program;
pub mod program_reader;
mod recording;
mod refusals;
pub mod sender;
pub mod settings;
mod switch_positions;
#[cfg(test)]
mod tests;
mod vertex;
mod waypoints;

pub use job::Job;
pub use recording::Recording;
pub use refusals::{Cause, Refusals, line_error};
pub use switch_positions::SwitchPositions;
pub use waypoints::Waypoint;

#[cfg(test)]
use cases::cases;
