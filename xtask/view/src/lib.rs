//! The page of a job.
#![allow(
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    reason = "a library of the tools beside it"
)]

#[cfg(test)]
#[path = "../../../tests/support/cases.rs"]
mod cases;
mod pack;
pub mod page;
pub mod picture;
#[cfg(test)]
mod tests;
