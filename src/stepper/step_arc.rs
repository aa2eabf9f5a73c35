//! Arcs in whole steps: which steps a segment makes, and when.
//!
//! The order of the steps is that of an [`IntegerArc`]. How far along the arc a step is follows from the areas
//! of the steps before it: step k is due where half of its own area has been passed behind all of theirs. So the
//! speed along the arc is the block's, whichever way a step leads. The last steps, straight to the end, count
//! with the radius: one takes as long as a step along an axis.
//!
//! Two steps of one axis behind each other come closer than steps along that axis would, by up to a third: the
//! second waits until it is as far as that, and what it delays comes behind it. The path is as much longer at
//! the end of it as a last step has waited.
//!
//! In firmware whose motors have drivers,
//! `no_step_arc.rs` is in the place of this file.

use super::integer_arc::{IntegerArc, UnitStep};
use crate::{axis::AXES, math, model::timing::SLOT_TICKS};

/// Parts of an area of 1, so that half of it, and the radius, are whole.
const PARTS: i64 = 1 << PARTS_BITS;
const PARTS_BITS: u32 = 11;

/// An arc in whole steps, from where the machine is on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepArc {
    /// First and second axis of the plane.
    axes: [u8; 2],
    steps: IntegerArc,
    /// Radius of the start: the area of a step along an axis, [`PARTS`].
    radius: i64,
    /// Area that the steps so far have passed, [`PARTS`].
    passed: i64,
    /// The same of the whole arc.
    area: i64,
    /// Where the last step of each axis was due.
    last: [i64; 2],
    /// Steps of both axes so far.
    displacement: [i32; 2],
}

/// The steps of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArcSteps {
    arc: StepArc,
    /// Area passed at the beginning and at the end, [`PARTS`].
    begin: i64,
    end: i64,
    /// Half of the speed at the beginning, [`PARTS`] per tick, and half of its square.
    half_speed: f32,
    half_speed_sqr: f32,
    /// [`PARTS`] per tick².
    acceleration: f32,
    /// Time of a step at most, ticks from the segment's start.
    latest_ticks: u32,
}

/// A step of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArcStep {
    /// The axis, one of those that there are.
    pub axis: usize,
    /// The direction.
    pub is_negative: bool,
    /// Ticks from the segment's start.
    pub ticks: u32,
}

impl StepArc {
    /// Returns the arc of these steps, none of which is of both axes, in the plane of two axes. `radius_sqr` is
    /// the square of the radius of its start, below 2⁴⁰ steps².
    #[must_use]
    pub fn new(axes: [usize; 2], steps: IntegerArc, radius_sqr: i64) -> Self {
        let radius = radius_sqr.saturating_mul(PARTS * PARTS).max(0).isqrt();
        let mut arc = Self {
            axes: axes.map(|axis| axis as u8),
            steps,
            radius,
            passed: 0,
            area: 0,
            last: [-radius; 2],
            displacement: [0; 2],
        };
        let mut all = arc;
        while let Some((_, due)) = all.step_before(i64::MAX) {
            arc.area = due;
        }
        arc.area = arc.area.max(all.passed);
        arc
    }

    /// Returns the area of the whole arc, steps².
    #[must_use]
    pub fn area(&self) -> f64 {
        self.area as f64 / PARTS as f64
    }

    /// Returns the steps of each axis of the plane so far.
    #[must_use]
    pub fn displacement(&self) -> [(usize, i32); 2] {
        let ([first, second], [x, y]) = (self.axes, self.displacement);
        [(usize::from(first), x), (usize::from(second), y)]
    }

    /// Takes the next step if it is due before `end`; returns it, with where it is due.
    fn step_before(&mut self, end: i64) -> Option<(UnitStep, i64)> {
        let mut steps = self.steps;
        let step = steps.take_step()?;
        let area = if step.is_straight {
            self.radius
        } else {
            step.area << PARTS_BITS
        };
        let [first, second] = self.last;
        let own = if step.signs[0] == 0 { second } else { first };
        let after = own.wrapping_add(self.radius).max(first).max(second);
        let due = self.passed.wrapping_add(area / 2).max(after);
        if due > end {
            return None;
        }
        self.steps = steps;
        self.passed = self.passed.wrapping_add(area);
        self.last = match step.signs {
            [0, _] => [first, due],
            [_, _] => [due, second],
        };
        for (sum, sign) in self.displacement.iter_mut().zip(step.signs) {
            *sum = sum.wrapping_add(sign);
        }
        Some((step, due))
    }

    /// Goes on to where the part `done` of the arc is done, in 2³¹ parts, from `from`, in `ticks` and with an
    /// acceleration in arcs per tick². Returns the steps on the way.
    #[inline(never)]
    pub fn follow(&mut self, [from, done]: [u32; 2], ticks: u32, acceleration: f32) -> ArcSteps {
        let arc = *self;
        let [begin, end] = [from, done].map(|part| math::scale_q31(self.area, part));
        // wcet-bound: segment_steps
        while self.step_before(end).is_some() {}
        let (distance, duration) = (end.wrapping_sub(begin) as f32, ticks as f32);
        let mean = distance / duration;
        let mut acceleration = acceleration * self.area as f32;
        let mut speed = mean - 0.5 * acceleration * duration;
        if speed < 0.0 {
            speed = 0.0;
            acceleration = 2.0 * mean / duration;
        } else if speed + acceleration * duration < 0.0 {
            speed = 2.0 * mean;
            acceleration = -speed / duration;
        }
        ArcSteps {
            arc,
            begin,
            end,
            half_speed: 0.5 * speed,
            half_speed_sqr: 0.5 * speed * speed,
            acceleration,
            latest_ticks: ticks.saturating_sub(SLOT_TICKS),
        }
    }
}

impl ArcSteps {
    /// Takes the next step, if there is one.
    pub fn take_step(&mut self) -> Option<ArcStep> {
        let (step, due) = self.arc.step_before(self.end)?;
        let [first, second] = self.arc.axes.map(usize::from);
        let (axis, sign) = match step.signs {
            [0, sign] => (second, sign),
            [sign, _] => (first, sign),
        };
        let distance = due.wrapping_sub(self.begin).max(0) as f32;
        let half_reached =
            math::half_root_of_twice(self.half_speed_sqr + self.acceleration * distance);
        let ticks = distance / math::max(self.half_speed + half_reached, f32::MIN_POSITIVE);
        Some(ArcStep {
            axis: axis.min(AXES - 1),
            is_negative: sign < 0,
            ticks: (ticks as u32).min(self.latest_ticks),
        })
    }
}
