//! Arcs in whole steps: the rule that `$790` chooses, where it can apply.

use super::{Geometry, Router};
use crate::{
    model::{Circle, Target, timing::ARC_STEPS_PER_S},
    path::{Curve, Shape, arc::Arc},
    stepper::StepArc,
    units::{MicroDegrees, Nm, StepsPerMm},
};

/// Most steps of an arc of one axis: the area of each is summed up before the arc begins, in one run of `interpret`.
/// Twice as many of both axes, of 120 cycles each, are 36 ms, and the watchdog waits for 100 ms.
const MOST_STEPS: i64 = 25_000;

impl Geometry {
    /// Returns the same with the steps of an arc, if there are any, no faster than arcs in whole steps can be.
    pub(super) fn with_steps(self, steps: Option<StepArc>) -> Self {
        let Some(steps) = steps else {
            return self;
        };
        let steps_per_mm: f32 = self.steps_per_mm.iter().map(|steps| steps.abs()).sum();
        Self {
            limit_mm_s: (ARC_STEPS_PER_S as f32 / steps_per_mm).min(self.limit_mm_s),
            curve: self.curve.map(|curve| Curve {
                shape: Shape::WholeSteps(steps),
                ..curve
            }),
            ..self
        }
    }
}

impl Router {
    /// Returns the arc in whole steps to a target, under `$790`, and the arc with the length of these steps. There are
    /// no steps where start, end and centre are not on whole steps of two axes of the same resolution with a motor
    /// each; a message reports such an arc.
    pub(super) fn step_arc(
        &mut self,
        mut arc: Arc,
        target: &Target,
        circle: &Circle,
    ) -> (Arc, Option<StepArc>) {
        if self.settings.arc_rule == 0 {
            return (arc, None);
        }
        let steps = self.whole_steps(target, circle);
        self.is_off_steps |= steps.is_none();
        let (axis, _, _) = circle.plane.axes();
        let steps_per_mm = self.settings.steps_per_mm[axis].millionths() as f64 * 1.0e-6;
        arc.stepped_mm = steps.map(|steps| {
            // The areas of the steps, by the radius of the start.
            let area_mm2 = steps.area() / (steps_per_mm * steps_per_mm);
            area_mm2 / arc.radius[0]
        });
        (arc, steps)
    }

    /// Returns whether an arc has been made without the rule since the last call.
    pub fn takes_off_steps(&mut self) -> bool {
        core::mem::take(&mut self.is_off_steps)
    }

    fn whole_steps(&self, target: &Target, circle: &Circle) -> Option<StepArc> {
        let (first, second, _) = circle.plane.axes();
        let axes = [first, second];
        let [resolution, other] = axes.map(|axis| self.settings.steps_per_mm[axis]);
        let has_backlash = axes.iter().any(|axis| self.last_directions.has(*axis));
        if has_backlash
            || resolution != other
            || circle.tilt != MicroDegrees::ZERO
            || self.limits.is_core_xy
        {
            return None;
        }
        let [mut start, mut end] = [[0; 2]; 2];
        for (number, axis) in axes.into_iter().enumerate() {
            let from = self.at.position[axis];
            let centre = whole(resolution, from + circle.centre[number])?;
            let begin = whole(resolution, from)?;
            if begin != i64::from(self.at.steps[axis].0) {
                return None;
            }
            start[number] = begin - centre;
            end[number] = whole(resolution, target.position[axis])? - centre;
        }
        let radius_sqr: i64 = start.iter().map(|part| part.saturating_mul(*part)).sum();
        let radius = radius_sqr.isqrt();
        if radius.saturating_mul(4 * i64::from(circle.turns.max(1))) > MOST_STEPS {
            return None;
        }
        let ends = [start, end].map(|place| place.map(|part| part as i32));
        StepArc::new(axes, ends, circle.rotation, circle.turns)
    }
}

/// Returns the whole steps at a coordinate, `None` between two steps: nm are too coarse for some of them.
fn whole(resolution: StepsPerMm, position: Nm) -> Option<i64> {
    let (steps, _) = resolution.steps_at(position);
    let off = resolution.position_of(steps) - position;
    (off.0.abs() <= 1).then_some(i64::from(steps.0))
}
