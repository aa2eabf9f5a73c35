//! No arcs in whole steps: the firmware is for motors with drivers. Read with `step_arc.rs`.

use super::Router;
use crate::{
    model::{Circle, Target},
    stepper::StepArc,
};

impl Router {
    /// Returns no arc.
    pub(super) const fn step_arc(&mut self, _: &Target, _: &Circle) -> Option<StepArc> {
        None
    }
}
