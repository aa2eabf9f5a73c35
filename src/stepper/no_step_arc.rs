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

impl StepArc {
    /// Returns the area of the whole arc, steps².
    #[must_use]
    pub const fn area(&self) -> f64 {
        match *self {}
    }

    /// Returns the steps of each axis of the plane so far.
    pub fn displacement(&self) -> impl Iterator<Item = (usize, i32)> {
        let none: [(usize, i32); 0] = match *self {};
        none.into_iter()
    }

    /// Goes on.
    pub const fn follow(&mut self, _: [u32; 2], _: u32, _: f32) -> ArcSteps {
        match *self {}
    }
}

impl ArcSteps {
    /// Takes the next step, if there is one.
    pub const fn take_step(&mut self) -> Option<ArcStep> {
        match *self {}
    }
}
