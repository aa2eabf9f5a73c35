//! The interpreter against what Grbl 1.1h answered, line by line.
//!
//! Reads the recordings in `../shared/conformance` and says that it skipped where they are absent.
//! Every difference must be one of the named deviations; they are counted and printed.

#![cfg(not(target_os = "none"))]

mod cases;
mod compare;
mod machine;
mod programs;
