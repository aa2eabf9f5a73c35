//! Programs and settings, the virtual machine that they run on, and pictures of what it does.
//!
//! What a browser needs of it needs no operating system: the rest is the feature `os`.
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
#[cfg(feature = "os")]
pub mod chart;
mod columns;
mod curves;
pub mod drilled_holes;
pub mod figures;
pub mod forecast;
#[cfg(feature = "os")]
pub mod holder;
#[cfg(feature = "os")]
pub mod interrupt;
mod job;
pub mod job_times;
pub mod junction;
pub mod line_times;
#[cfg(feature = "os")]
pub mod lock;
pub mod machine;
pub mod machine_answers;
mod merge;
#[cfg(feature = "os")]
pub mod output;
#[cfg(feature = "os")]
pub mod play;
pub mod playing;
pub mod program;
pub mod program_reader;
pub mod progress;
#[cfg(feature = "os")]
pub mod proven;
#[cfg(feature = "os")]
pub mod pty;
mod recording;
#[cfg(feature = "os")]
mod refusal;
mod refusals;
pub mod rehearsal;
mod replay;
pub mod resume;
#[cfg(feature = "os")]
pub mod session;
pub mod settings;
#[cfg(feature = "os")]
pub mod summary;
mod switch_positions;
#[cfg(test)]
mod tests;
mod vertex;
mod waypoints;

/// What numbers mean; character counting and answers, for those who run programs.
pub use grbl_client::{meaning, sender};
pub use job::Job;
pub use recording::Recording;
#[cfg(feature = "os")]
pub use refusal::{alarm_row, refusal};
pub use refusals::{Cause, RefusalRow, Refusals, line_error};
pub use switch_positions::SwitchPositions;
pub use waypoints::Waypoint;

#[cfg(test)]
use cases::cases;
