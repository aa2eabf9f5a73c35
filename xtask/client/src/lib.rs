//! What speaks to machines.
#![allow(
    clippy::missing_errors_doc,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

pub mod port;
