//! The executor: makes the planned path into segments, one after another.
//!
//! A *section* is a block, or the part of an arc between two reversals of an axis: each axis moves in
//! one direction. A segment lies within one section and has one acceleration. How long a segment is,
//! and how fast its end, follows from the profile: [`trapezoid`](super::trapezoid) or
//! [`jerk_limited`](super::jerk_limited).
//!
//! Segments cost time to make. A section of 1.5 ms is one segment; each segment of a longer section takes 0.75 ms at
//! least, and all but the last two 1 ms. None takes more than 1.5 ms. On lines on which few steps fall they take longer, as
//! what they cost does not depend on their length: see [`Executor::set_step_rate`].
//!
//! # Cost
//!
//! Most moves are lines: the functions marked `inline(always)` are compiled once for lines and once
//! for arcs, so that no line asks for a curve.

use super::{
    kinematics::{BlockGeometry, Direction, axis_speeds, displacement_at, phase_at},
    limits::{LEAST_SPARSE_RAMP_S, SPARSE_SHARE, SegmentTimes, TICKS_PER_S},
    pass::PassProgress,
};
#[cfg(arc_machine)]
use crate::stepper::{ArcSteps, StepArc};
use crate::{
    axis::{AXES, Axes},
    math::{self, WHOLE_Q31},
    model::{Laser, Power},
    path::{Block, Curve, MoveKind, Shape, SpatialArc},
    stepper::{AxisMotion, Segment},
    units::FineSteps,
};

/// Whether motion is to go on or to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Goal {
    /// As fast as the plan allows.
    Run,
    /// To a standstill as soon as the limits allow, on the path.
    Stop,
}

/// What came of making a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NextSegment {
    /// No segment: the machine is at a standstill, at the end of the plan or as it should.
    Standstill,
    /// A segment within a block.
    WithinBlock,
    /// The last segment of a block.
    EndsBlock,
}

/// A segment along the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SegmentProfile {
    /// Length, mm.
    pub(super) length_mm: f32,
    /// Speed at its end, mm/s.
    pub(super) speed_mm_s: f32,
    /// Duration, s.
    pub(super) seconds: f32,
    /// Whether it ends its section.
    pub(super) ends_section: bool,
}

/// What a segment has of an arc in whole steps, of which the generator makes the steps.
#[cfg(arc_machine)]
#[derive(Debug)]
pub(super) struct SegmentOfArc {
    /// The arc, if the segment is the first on it.
    pub(super) entered: Option<StepArc>,
    /// The steps of the segment.
    pub(super) steps: Option<ArcSteps>,
}

#[cfg(arc_machine)]
impl SegmentOfArc {
    /// Nothing.
    const NONE: Self = Self {
        entered: None,
        steps: None,
    };
}

/// Where on the path the machine is, and how fast.
#[derive(Debug)]
pub(super) struct Executor {
    /// Remaining part of the block, 2³¹ for all of it.
    pub(super) remaining: u32,
    /// Remainder of rounding the last segment's length to such parts.
    pub(super) carry: f32,
    /// Speed along the path, mm/s.
    pub(super) speed_mm_s: f32,
    /// Exact position at the start of the block.
    pub(super) start: Axes<FineSteps>,
    /// Direction from the centre of an arc to that position.
    pub(super) from_centre: Direction,
    /// Angle seen from the centre where the machine is.
    pub(super) phase: u32,
    /// What the last segment has of an arc in whole steps.
    #[cfg(arc_machine)]
    pub(super) step_arc: SegmentOfArc,
    /// Speed of each axis at the end of the last segment, steps per tick.
    pub(super) axis_speed: Axes<f32>,
    /// A block has been begun.
    pub(super) is_begun: bool,
    /// The last segment ended in motion within a section.
    pub(super) is_within_section: bool,
    /// The plan has become slower: the speed may be more than it allows.
    pub(super) may_exceed_plan: bool,
    /// The reference motion or its mean has not ended, with the jerk-limited profile.
    pub(super) average_moves: bool,
    /// Greatest rate at which few steps fall, steps of all axes together per second.
    sparse_steps_per_s: f32,
    /// The speed of the block up to which few steps fall, mm/s: 0 where segments must not be longer.
    sparse_mm_s: f32,
    /// What the laser does in the last segment.
    pub(super) laser: Laser,
    /// Mean speed of the last segment as a part of the programmed one.
    pub(super) speed_share: f32,
}

impl Executor {
    pub(super) const fn new() -> Self {
        Self {
            remaining: WHOLE_Q31,
            carry: 0.0,
            speed_mm_s: 0.0,
            start: Axes([FineSteps(0); AXES]),
            from_centre: Direction::NONE,
            phase: 0,
            #[cfg(arc_machine)]
            step_arc: SegmentOfArc::NONE,
            axis_speed: Axes([0.0; AXES]),
            is_begun: false,
            is_within_section: false,
            may_exceed_plan: false,
            average_moves: false,
            sparse_steps_per_s: 0.0,
            sparse_mm_s: 0.0,
            laser: Laser::None,
            speed_share: 0.0,
        }
    }

    /// Follows a change of the planned speeds. Returns whether the machine has come to those planned before.
    pub(super) fn replanned(&mut self) -> PassProgress {
        let was_over = self.may_exceed_plan;
        self.may_exceed_plan = self.speed_mm_s > 0.0;
        if was_over {
            PassProgress::Braking
        } else {
            PassProgress::Followed
        }
    }

    /// Returns what the laser does in the last segment, and the mean speed as a part of the programmed
    /// one: valid with power in proportion to the speed.
    pub(super) const fn laser(&self) -> (Laser, f32) {
        (self.laser, self.speed_share)
    }

    /// Whether the last segment ends in motion.
    #[inline]
    pub(super) fn is_moving(&self) -> bool {
        self.speed_mm_s > 0.0 || self.average_moves
    }

    /// Returns the steps that are left of the block in execution, of the axis that makes most; of an arc about.
    pub(super) fn steps_left(&self, block: &Block) -> f32 {
        let whole = if self.is_begun {
            self.remaining
        } else {
            WHOLE_Q31
        };
        let left_mm = block.length_mm * (whole as f32 / WHOLE_Q31 as f32);
        let mut per_mm = 0.0;
        for axis in &block.steps_per_mm {
            per_mm = math::max(per_mm, axis.abs());
        }
        left_mm * per_mm
    }

    /// Drops the remainder of the block in execution. At standstill, or in a fault.
    pub(super) fn abandon(&mut self) {
        self.speed_mm_s = 0.0;
        self.is_begun = false;
        self.is_within_section = false;
        self.may_exceed_plan = false;
        self.average_moves = false;
    }

    /// Sets the greatest step rate of all axes together, Hz. Without it no segment is longer than 1.5 ms.
    pub(super) const fn set_step_rate(&mut self, hz: u32) {
        self.sparse_steps_per_s = hz as f32 * SPARSE_SHARE;
    }

    /// Returns how long segments of the block are: longer, as few steps fall; not where its speed is reached in a few
    /// segments, as a ramp begins and ends with one.
    #[inline]
    pub(super) fn segment_times(&self, block: &Block) -> SegmentTimes {
        let is_sparse = math::max(block.nominal_mm_s, self.speed_mm_s) < self.sparse_mm_s;
        let ramps_slowly = block.acceleration_mm_s2 * LEAST_SPARSE_RAMP_S < block.nominal_mm_s;
        if is_sparse && ramps_slowly && !self.may_exceed_plan {
            SegmentTimes::SPARSE
        } else {
            SegmentTimes::REGULAR
        }
    }

    /// Returns the speed of a block up to which few steps fall, mm/s: 0 on arcs, and where something waits for a
    /// segment to end, as the power of a laser, a probing move or a jog.
    #[inline]
    fn sparse_mm_s(&self, geometry: BlockGeometry<'_>) -> f32 {
        let block = geometry.block;
        let is_urgent = matches!(block.kind, MoveKind::Fixed | MoveKind::Jog);
        if geometry.curve.is_some() || is_urgent || block.laser != Laser::None {
            return 0.0;
        }
        let per_mm: f32 = block.steps_per_mm.iter().map(|steps| steps.abs()).sum();
        self.sparse_steps_per_s / per_mm
    }

    /// Begins a block.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for lines and for arcs")]
    pub(super) fn begin(&mut self, geometry: BlockGeometry<'_>, position: &Axes<FineSteps>) {
        self.is_begun = true;
        self.is_within_section = false;
        self.remaining = WHOLE_Q31;
        self.carry = 0.0;
        self.start = *position;
        self.sparse_mm_s = self.sparse_mm_s(geometry);
        if let Some(curve) = geometry.curve {
            self.phase = curve.phase;
            self.from_centre = Direction::at(curve.phase);
            #[cfg(arc_machine)]
            if let Shape::WholeSteps(arc) = &curve.shape {
                self.step_arc.entered = Some(*arc);
            }
        }
        self.axis_speed = axis_speeds(geometry, self.from_centre, self.speed_mm_s);
    }

    /// Returns the length of the remainder of a section, and whether it ends the block, of which
    /// `remaining_mm` are left. A section takes `min_section_s` at least at the block's speed.
    #[inline]
    pub(super) fn section_length(
        &self,
        geometry: BlockGeometry<'_>,
        remaining_mm: f32,
        min_section_s: f32,
    ) -> (f32, bool) {
        if let Some(curve) = geometry.curve {
            let min_section_mm = min_section_s * geometry.block.nominal_mm_s;
            let length_mm = match &curve.shape {
                Shape::Planar { .. } => self.distance_to_quarter(curve, min_section_mm),
                Shape::Spatial(circle) => {
                    self.distance_to_reversal(geometry.block, circle, min_section_mm)
                }
                // Its axes reverse within segments.
                Shape::WholeSteps(_) => f32::MAX,
            };
            if length_mm < remaining_mm - min_section_mm {
                return (length_mm, false);
            }
        }
        (remaining_mm, true)
    }

    /// The distance to the next reversal of an axis of the plane, mm, without one that is nearer than
    /// the shortest section.
    fn distance_to_quarter(&self, curve: &Curve, min_section_mm: f32) -> f32 {
        const QUARTER: u32 = 1 << 30;
        // Parts of the block are coarser than phases on an arc of many turns.
        let grain = (curve.sweep.unsigned_abs() >> 30) as u32 + 16;
        let phase = self.phase & (QUARTER - 1);
        let phase_to_go = if curve.sweep > 0 {
            QUARTER - phase
        } else {
            phase
        };
        let length_mm = phase_to_go as f32 * curve.mm_per_phase;
        if phase_to_go < grain || length_mm < min_section_mm {
            length_mm + QUARTER as f32 * curve.mm_per_phase
        } else {
            length_mm
        }
    }

    /// The distance to the next reversal of an axis, mm, without one that is nearer than the shortest
    /// section; `f32::MAX` where none follows.
    #[inline(never)]
    fn distance_to_reversal(&self, block: &Block, circle: &SpatialArc, min_section_mm: f32) -> f32 {
        let done = WHOLE_Q31 - self.remaining;
        let scale = block.length_mm / WHOLE_Q31 as f32;
        let distance_mm = |part: u16| (u32::from(part) << 15).saturating_sub(done) as f32 * scale;
        let [first, second, third] = circle.reversals.map(distance_mm);
        if first > min_section_mm {
            first
        } else if second > min_section_mm {
            second
        } else if third > min_section_mm {
            third
        } else {
            f32::MAX
        }
    }

    /// Makes the segment of a profile: the motion of each axis.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for lines and for arcs")]
    pub(super) fn segment(
        &mut self,
        geometry: BlockGeometry<'_>,
        profile: &SegmentProfile,
        ends_block: bool,
        segment: &mut Segment,
    ) {
        let block = geometry.block;
        #[cfg(arc_machine)]
        let from = WHOLE_Q31 - self.remaining;
        let ticks = ((profile.seconds * TICKS_PER_S + 0.5) as u32).max(1);
        if ends_block {
            self.remaining = 0;
        } else {
            let parts = profile.length_mm * (WHOLE_Q31 as f32 / block.length_mm) + self.carry;
            let whole = parts as u32;
            self.carry = parts - whole as f32;
            self.remaining -= whole.min(self.remaining);
        }
        let done = WHOLE_Q31 - self.remaining;
        let mut here = Direction::NONE;
        if let Some(curve) = geometry.curve {
            self.phase = phase_at(curve, done);
            here = Direction::at(self.phase);
        }
        let displacement = displacement_at(geometry, done, self.from_centre, here);
        let speeds = axis_speeds(geometry, here, profile.speed_mm_s);
        let rate = 1.0 / ticks as f32;
        let axes = Axes::from_fn(|axis| AxisMotion {
            to: FineSteps(self.start[axis].0.wrapping_add(displacement[axis])),
            acceleration: (speeds[axis] - self.axis_speed[axis]) * rate,
        });
        self.axis_speed = speeds;
        *segment = Segment {
            ticks,
            axes,
            feed_mm_min: profile.speed_mm_s * 60.0,
            line: block.line,
            power: Power::OFF,
        };
        #[cfg(arc_machine)]
        if let Some(curve) = geometry.curve
            && let Shape::WholeSteps(arc) = &curve.shape
        {
            let change = (profile.speed_mm_s - self.speed_mm_s) / block.length_mm;
            let acceleration = change * rate * (1.0 / TICKS_PER_S);
            self.step_arc.steps = Some(arc.steps([from, done], ticks, acceleration));
        }
    }
}
