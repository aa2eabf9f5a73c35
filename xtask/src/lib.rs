//! What every tool of Leadscrew shares: what users see, Cargo, other tools, and checks.
#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

#[cfg(feature = "terminal")]
pub mod cargo;
#[cfg(feature = "terminal")]
pub mod check;
#[cfg(feature = "terminal")]
pub mod document;
#[cfg(feature = "terminal")]
pub mod install;
#[cfg(feature = "terminal")]
pub mod options;
#[cfg(feature = "terminal")]
pub mod probe;
pub mod text;
#[cfg(feature = "terminal")]
pub mod tools;
#[cfg(feature = "terminal")]
pub mod ui;

#[cfg(feature = "terminal")]
use std::process::ExitCode;

#[cfg(feature = "terminal")]
use anyhow::Result;

/// Baud rate of the serial line.
pub const BAUD: u32 = 115_200;

/// Runs a tool, and shows what went wrong.
#[cfg(feature = "terminal")]
pub fn main(run: impl FnOnce() -> Result<ExitCode>) -> ExitCode {
    run().unwrap_or_else(|error| {
        ui::error(&error);
        check::fail(&error);
        ExitCode::FAILURE
    })
}

/// The promised step rate for a proven step rate, Hz: whole thousands, so that small changes of the code keep the
/// promise.
pub const fn whole_thousands(hz: u32) -> u32 {
    hz / 1000 * 1000
}
