//! The page that runs jobs in the browser, and the same code under node.
#![allow(
    clippy::missing_errors_doc,
    clippy::must_use_candidate,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

pub mod measure;
pub mod page;
