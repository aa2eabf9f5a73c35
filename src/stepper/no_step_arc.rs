//! No arcs in whole steps: the firmware is for motors with drivers. Read with `step_arc.rs`.
//!
//! # Cost
//! The type has no value, so the compiler leaves out what would be done with one.

/// No arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepArc {}
