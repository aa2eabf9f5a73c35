//! Pages for browsers: a job to look at, and the simulator itself.
#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

#[cfg(all(test, feature = "commands"))]
#[path = "../../../tests/support/cases.rs"]
mod cases;
#[cfg(feature = "commands")]
pub mod control;
pub mod pack;
pub mod page;
#[cfg(feature = "commands")]
pub mod picture;
#[cfg(all(test, feature = "commands"))]
mod tests;
#[cfg(any(test, target_family = "wasm"))]
mod wasm;
#[cfg(feature = "commands")]
pub mod web;
