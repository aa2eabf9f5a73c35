//! The page of a job.
#![allow(
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    reason = "a library of the tools beside it"
)]

#[cfg(all(test, feature = "command"))]
#[path = "../../../tests/support/cases.rs"]
mod cases;
pub mod pack;
pub mod page;
#[cfg(feature = "command")]
pub mod picture;
#[cfg(all(test, feature = "command"))]
mod tests;
