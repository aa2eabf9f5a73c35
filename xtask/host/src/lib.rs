//! The host's side of a machine: programs, settings and senders, and the virtual machine that they
//! talk to.
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
pub mod figures;
pub mod holder;
pub mod holes;
pub mod interrupt;
pub mod job_times;
pub mod lock;
pub mod machine;
pub mod output;
pub mod play;
pub mod program;
pub mod program_reader;
pub mod proven;
pub mod pty;
mod refusal;
mod refusals;
pub mod sender;
pub mod session;
pub mod settings;

pub use refusal::refusal;
pub use refusals::Refusals;

#[cfg(test)]
use cases::cases;
