//! What every tool of Leadscrew shares: what users see, Cargo, other tools, and checks.
#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

pub mod cargo;
pub mod check;
pub mod probe;
pub mod text;
pub mod tools;
pub mod ui;

use std::process::ExitCode;

use anyhow::Result;

/// Baud rate of the serial line.
pub const BAUD: u32 = 115_200;

/// Runs a tool, and shows what went wrong.
pub fn main(run: impl FnOnce() -> Result<ExitCode>) -> ExitCode {
    run().unwrap_or_else(|error| {
        ui::error(&error);
        check::fail(&error);
        ExitCode::FAILURE
    })
}

/// The step rate that is promised of a proven one, Hz: whole thousands, so that it stays while code
/// changes a little.
pub const fn whole_thousands(hz: u32) -> u32 {
    hz / 1000 * 1000
}
