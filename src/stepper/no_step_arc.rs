//! No arcs in whole steps: the firmware is for motors with drivers. Read with `step_arc.rs`.
//!
//! # Cost
//! Neither type has a value, so the compiler leaves out what would be done with one.

/// No arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepArc {}

/// No steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArcSteps {}

/// A step of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArcStep {
    /// The axis.
    pub axis: usize,
    /// The direction.
    pub is_negative: bool,
    /// Ticks from the segment's start.
    pub ticks: u32,
}

impl ArcSteps {
    /// Takes the next step, if there is one.
    pub const fn take_step(&mut self) -> Option<ArcStep> {
        match *self {}
    }
}
