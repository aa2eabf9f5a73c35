//! Arcs in whole steps: which steps a segment makes, and when.
//!
//! The order of the steps is that of an [`IntegerArc`]. How far along the arc a step is follows from the areas
//! of the steps before it: step k is due where half of its own area has been passed behind all of theirs. So the
//! speed along the arc is the block's, whichever way a step leads. The last steps, straight to the end, count
//! with the radius: one takes as long as a step along an axis.
//!
//! Two consecutive steps of an axis come closer than steps along this axis would, by up to a third: the second waits
//! until the distance is full, and the steps delayed by it follow. The path is as much longer at the end of it as a
//! last step has waited.
//!
//! A block has the ends of the arc, [`StepArc`]. Where the machine is on it, [`ArcProgress`], is in one place: the
//! generator goes on from there, by the [`ArcSteps`] of each segment.
//!
//! In firmware whose motors have drivers, `no_step_arc.rs` is in the place of this file.
//!
//! # Cost
//! What a block has of an arc is no longer than other curves, which are copied by words, not by a library loop.

use super::integer_arc::{IntegerArc, StepRule};
use crate::{
    axis::AXES,
    math,
    model::{Rotation, timing::SLOT_TICKS},
};

/// Parts of an area of 1, so that half of it, and the radius, are whole.
const PARTS: i64 = 1 << PARTS_BITS;
const PARTS_BITS: u32 = 11;

/// An arc in whole steps, as a block has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(Rust, packed(4))]
pub struct StepArc {
    /// Start and end, relative to the centre.
    start: [i32; 2],
    end: [i32; 2],
    /// Radius of the start: the area of a step along an axis, [`PARTS`].
    radius: i32,
    /// Area that all steps pass, [`PARTS`].
    area: i64,
    /// As in [`Circle`](crate::model::Circle).
    turns: u16,
    rotation: Rotation,
    /// First and second axis of the plane.
    axes: [u8; 2],
}

/// Where the machine is on an arc in whole steps: at the step that comes next.
#[derive(Debug)]
pub struct ArcProgress {
    /// The steps behind the next one.
    steps: Option<IntegerArc>,
    /// First and second axis of the plane.
    axes: [u8; 2],
    /// As that of [`StepArc`].
    radius: i64,
    /// Area that the steps up to the next one pass, [`PARTS`].
    passed: i64,
    /// Where the last step of each axis is due.
    last: [i64; 2],
    /// The next step: its axis, its direction, and where it is due, [`ArcProgress::NEVER`] if there is none.
    axis: u8,
    is_negative: bool,
    due: i64,
}

/// The steps of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArcSteps {
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
    /// The axis, below the number of axes.
    pub axis: usize,
    /// The direction.
    pub is_negative: bool,
    /// Ticks from the segment's start.
    pub ticks: u32,
}

impl ArcStep {
    /// No step.
    pub const NONE: Self = Self {
        axis: 0,
        is_negative: false,
        ticks: 0,
    };
}

impl StepArc {
    /// Returns the arc from a place to another one, relative to the centre, by [`StepRule::Sign`], in the plane of
    /// two axes; `None` where the rule makes none, and from a radius of 2²⁰ steps on.
    #[must_use]
    pub fn new(
        axes: [usize; 2],
        [start, end]: [[i32; 2]; 2],
        rotation: Rotation,
        turns: u16,
    ) -> Option<Self> {
        let square = |part: i32| i64::from(part) * i64::from(part);
        let radius_sqr = square(start[0]) + square(start[1]);
        let mut arc = Self {
            start,
            end,
            radius: i32::try_from(radius_sqr.saturating_mul(PARTS * PARTS).isqrt()).ok()?,
            area: 0,
            turns,
            rotation,
            axes: axes.map(|axis| axis as u8),
        };
        let mut progress = ArcProgress::NONE;
        progress.enter(&arc);
        if progress.due == ArcProgress::NEVER {
            return None;
        }
        while progress.due != ArcProgress::NEVER {
            arc.area = progress.due;
            progress.find_next();
        }
        arc.area = progress.passed.max(arc.area);
        Some(arc)
    }

    /// Returns the area of the whole arc, steps².
    #[must_use]
    pub fn area(&self) -> f64 {
        self.area as f64 / PARTS as f64
    }

    /// Returns the steps of a segment from where one part of the arc is done to where another one is, in 2³¹
    /// parts, in `ticks` and with an acceleration in arcs per tick².
    #[must_use]
    pub fn steps(&self, parts: [u32; 2], ticks: u32, acceleration: f32) -> ArcSteps {
        let [begin, end] = parts.map(|part| math::scale_q31(self.area, part));
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
            begin,
            end,
            half_speed: 0.5 * speed,
            half_speed_sqr: 0.5 * speed * speed,
            acceleration,
            latest_ticks: ticks.saturating_sub(SLOT_TICKS),
        }
    }
}

impl ArcProgress {
    const NEVER: i64 = i64::MAX;

    /// No arc.
    pub const NONE: Self = Self {
        steps: None,
        axes: [0; 2],
        radius: 0,
        passed: 0,
        last: [0; 2],
        axis: 0,
        is_negative: false,
        due: Self::NEVER,
    };

    /// Goes on to the start of an arc.
    pub fn enter(&mut self, arc: &StepArc) {
        let StepArc { start, end, .. } = *arc;
        self.steps = IntegerArc::new(start, end, arc.rotation, arc.turns, StepRule::Sign);
        self.axes = arc.axes;
        self.radius = i64::from(arc.radius);
        self.passed = 0;
        self.last = [-self.radius; 2];
        self.due = -self.radius;
        self.find_next();
    }

    /// Returns the axes of the arc, bit 0 = X.
    #[must_use]
    pub const fn axes(&self) -> u8 {
        let [first, second] = self.axes;
        1 << (first & 7) | 1 << (second & 7)
    }

    /// Returns whether a segment has another step.
    #[must_use]
    pub const fn is_due(&self, segment: &ArcSteps) -> bool {
        self.due <= segment.end
    }

    /// Takes the next step of a segment, if there is one.
    pub fn take_step(&mut self, segment: &ArcSteps) -> Option<ArcStep> {
        if !self.is_due(segment) {
            return None;
        }
        let distance = self.due.wrapping_sub(segment.begin).max(0) as f32;
        let half_reached =
            math::half_root_of_twice(segment.half_speed_sqr + segment.acceleration * distance);
        let ticks = distance / math::max(segment.half_speed + half_reached, f32::MIN_POSITIVE);
        let step = ArcStep {
            axis: usize::from(self.axis).min(AXES - 1),
            is_negative: self.is_negative,
            ticks: (ticks as u32).min(segment.latest_ticks),
        };
        self.find_next();
        Some(step)
    }

    /// Finds the step behind the next one, and where it is due.
    fn find_next(&mut self) {
        let Some(step) = self.steps.as_mut().and_then(IntegerArc::take_step) else {
            self.due = Self::NEVER;
            return;
        };
        let area = if step.is_straight {
            self.radius
        } else {
            step.area << PARTS_BITS
        };
        let ([first, second], [along_first, along_second]) = (self.axes, step.signs);
        let [last_first, last_second] = &mut self.last;
        let (axis, sign, last) = if along_first == 0 {
            (second, along_second, last_second)
        } else {
            (first, along_first, last_first)
        };
        let after = last.wrapping_add(self.radius).max(self.due);
        self.due = self.passed.wrapping_add(area / 2).max(after);
        *last = self.due;
        self.passed = self.passed.wrapping_add(area);
        (self.axis, self.is_negative) = (axis, sign < 0);
    }
}
