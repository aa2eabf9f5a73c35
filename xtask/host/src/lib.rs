//! The host's side of a machine: programs, settings and senders, and the virtual machine that they
//! talk to.
#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

pub mod holder;
pub mod interrupt;
pub mod lock;
pub mod machine;
pub mod machine_answers;
pub mod output;
pub mod play;
pub mod proven;
pub mod pty;
mod refusal;
pub mod session;
pub mod settings;
pub mod summary;

pub use job::{Refusals, figures, holes, job_times, program, program_reader, sender};
pub use refusal::refusal;
