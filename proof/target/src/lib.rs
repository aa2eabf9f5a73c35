//! The firmware in QEMU, for the tools that start it.
#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

pub mod emulator;
