//! The speed profile: cuts the planned path into segments, one after another.
//!
//! ```text
//!  speed      cruise at the programmed speed
//!    |      ______________
//!    |     /              \      brake just in time for the planned exit speed
//!    |    / accelerate     \
//!    |___/__________________\____ path
//!    entry                  exit
//! ```
//!
//! A *piece* is a block, or the part of an arc between two reversals of an axis. A segment lies
//! within one piece and has one acceleration. Its end speed is the greatest that the limits, the way
//! to brake that is left, and the segments to come allow; it follows from the present speed and the
//! way left, so a feed hold, a new block or a changed limit needs nothing but the next segment.
//!
//! Segments cost time to make. A piece that takes 1.5 ms is one segment; of a longer one each takes
//! 0.75 ms at least, and all but the last two 1 ms. None takes more than 1.5 ms.

use super::{
    kinematics::{Direction, axis_speeds, displacement_at, phase_at},
    lookahead::Plan,
    pass::PassProgress,
    trapezoid::{BlockGeometry, SegmentProfile},
};
use crate::{
    axis::Axes,
    math::{self, WHOLE_Q31},
    model::{
        Laser, Power,
        timing::{MAX_SEGMENT_TICKS, SEGMENT_TICKS},
    },
    path::{Block, Curve, Shape, SpatialArc},
    stepper::{AxisMotion, Segment},
    units::{FineSteps, TICKS_PER_SECOND},
};

/// Timer ticks per second in floating point.
pub(super) const TICKS_PER_S: f32 = TICKS_PER_SECOND as f32;
/// A segment of a long piece, s.
pub(super) const NOMINAL_SEGMENT_S: f32 = SEGMENT_TICKS as f32 / TICKS_PER_S;
/// Longest segment, s.
pub(super) const LONGEST_SEGMENT_S: f32 = MAX_SEGMENT_TICKS as f32 / TICKS_PER_S;
/// Shortest segment of a piece that has several, s.
pub(super) const SHORTEST_SEGMENT_S: f32 = 0.5 * LONGEST_SEGMENT_S;
/// The first segment from rest, s: it makes up for the standstill before it, which is a segment too.
/// On an arc it may last a little longer than meant.
pub(super) const FIRST_SEGMENT_S: f32 = 0.97 * LONGEST_SEGMENT_S;
/// What is shorter than that before or after a reversal is no piece of its own, s.
pub(super) const MIN_SECTION_S: f32 = 1.0e-4;
/// The same where acceleration is continuous.
pub(super) const JERK_LIMITED_MIN_SECTION_S: f32 = 4.0e-4;

/// Whether motion is to go on or to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Goal {
    /// As fast as the plan allows.
    Run,
    /// To a standstill as soon as the limits allow, on the path.
    Stop,
}

/// What is left of a piece.
#[derive(Debug, Clone, Copy)]
pub(super) struct MonotonicSection {
    /// Its length, mm.
    pub(super) length_mm: f32,
    /// The measure of the greatest speed at its end.
    pub(super) exit_measure: f32,
    /// Whether it ends the block.
    pub(super) ends_block: bool,
}

/// Where on the path the machine is, and how fast.
#[derive(Debug)]
pub(super) struct Executor {
    /// Part of the block that is still to go, 2³¹ for all of it.
    pub(super) remaining: u32,
    /// What rounding the last segment's way to such parts left over.
    pub(super) carry: f32,
    /// Speed along the path, mm/s.
    pub(super) speed_mm_s: f32,
    /// Exact position at the start of the block, and the direction from the centre of an arc.
    pub(super) start: Axes<FineSteps>,
    pub(super) from_centre: Direction,
    /// Angle seen from the centre where the machine is.
    pub(super) phase: u32,
    /// Speed of each axis at the end of the last segment, steps per tick.
    pub(super) axis_speed: Axes<f32>,
    /// A block has been begun.
    pub(super) is_begun: bool,
    /// A piece has been begun.
    pub(super) is_within_section: bool,
    /// The plan has become slower: the speed may be more than it allows.
    pub(super) may_exceed_plan: bool,
    /// What has been paced is not played to its end.
    pub(super) average_moves: bool,
    /// What the laser does in the last segment, and the part of the programmed speed that it has.
    pub(super) laser: Laser,
    pub(super) speed_share: f32,
}

impl Executor {
    pub(super) const fn new() -> Self {
        Self {
            remaining: WHOLE_Q31,
            carry: 0.0,
            speed_mm_s: 0.0,
            start: Axes([FineSteps(0); crate::axis::AXES]),
            from_centre: Direction::NONE,
            phase: 0,
            axis_speed: Axes([0.0; crate::axis::AXES]),
            is_begun: false,
            is_within_section: false,
            may_exceed_plan: false,
            average_moves: false,
            laser: Laser::None,
            speed_share: 0.0,
        }
    }

    /// The plan is made anew, for other speeds: how far the machine is with the one before.
    pub(super) fn replanned(&mut self) -> PassProgress {
        let was_over = self.may_exceed_plan;
        self.may_exceed_plan = self.speed_mm_s > 0.0;
        if was_over {
            PassProgress::Behind
        } else {
            PassProgress::Followed
        }
    }

    /// What the laser does in the last segment; with power in proportion to the speed also its mean
    /// speed as a part of the programmed one.
    pub(super) const fn laser(&self) -> (Laser, f32) {
        (self.laser, self.speed_share)
    }

    /// Whether the last segment ends in motion.
    #[inline]
    pub(super) fn is_moving(&self) -> bool {
        self.speed_mm_s > 0.0 || self.average_moves
    }

    /// Forgets the block in execution: what was left of it is not executed. At rest, or a fault.
    pub(super) fn abandon(&mut self) {
        self.speed_mm_s = 0.0;
        self.is_begun = false;
        self.is_within_section = false;
        self.may_exceed_plan = false;
        self.average_moves = false;
    }

    /// The next segment, from `position`, is put into `segment`; false at the end of the plan or,
    /// when stopping, at rest.
    ///
    /// Removes a block from the plan with its last segment.
    #[inline]
    pub(super) fn next<const N: usize>(
        &mut self,
        plan: &mut Plan<N>,
        position: &Axes<FineSteps>,
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        if goal == Goal::Stop && self.speed_mm_s <= 0.0 {
            return false;
        }
        let exit_sqr = plan.exit_sqr();
        let Some(block) = plan.current() else {
            self.speed_mm_s = 0.0;
            return false;
        };
        let way = (position, exit_sqr);
        let ends_block = match &block.curve {
            Some(curve) => self.follow_arc(block, curve, way, goal, segment),
            None => self.follow_line(block, way, goal, segment),
        };
        if ends_block {
            plan.pop();
            self.is_begun = false;
        }
        true
    }

    /// A segment of an arc; whether it ends the block.
    #[inline(never)]
    fn follow_arc(
        &mut self,
        block: &Block,
        curve: &Curve,
        way: (&Axes<FineSteps>, f32),
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        let curve = Some(curve);
        self.follow(BlockGeometry { block, curve }, way, goal, segment)
    }

    /// The same of a line: whether there is a curve is known when either is compiled.
    #[inline(never)]
    fn follow_line(
        &mut self,
        block: &Block,
        way: (&Axes<FineSteps>, f32),
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        let curve = None;
        self.follow(BlockGeometry { block, curve }, way, goal, segment)
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "two functions come of this")]
    fn follow(
        &mut self,
        course: BlockGeometry<'_>,
        (position, exit_sqr): (&Axes<FineSteps>, f32),
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        if !self.is_begun {
            self.begin(course, position);
        }
        let piece = self.section(course, exit_sqr);
        let stretch = match goal {
            Goal::Run => self.run_profile(course, &piece),
            Goal::Stop => self.stop_profile(course, &piece),
        };
        let ends_block = stretch.ends_section && piece.ends_block;
        self.segment(course, &stretch, ends_block, segment);
        self.laser = course.block.laser;
        // Nothing else asks for it, and it takes a division.
        if matches!(self.laser, Laser::Proportional(_)) {
            let mean_mm_s = 0.5 * (self.speed_mm_s + stretch.speed_mm_s);
            self.speed_share = mean_mm_s / course.block.programmed_mm_s;
        }
        self.speed_mm_s = stretch.speed_mm_s;
        self.is_within_section = !stretch.ends_section && self.speed_mm_s > 0.0;
        ends_block
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    pub(super) fn begin(&mut self, course: BlockGeometry<'_>, position: &Axes<FineSteps>) {
        self.is_begun = true;
        self.is_within_section = false;
        self.remaining = WHOLE_Q31;
        self.carry = 0.0;
        self.start = *position;
        if let Some(curve) = course.curve {
            self.phase = curve.phase;
            self.from_centre = Direction::at(curve.phase);
        }
        self.axis_speed = axis_speeds(course, self.from_centre, self.speed_mm_s);
    }

    /// What is left of the piece that the machine is in, of a block to be left at a speed.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn section(&self, course: BlockGeometry<'_>, exit_sqr: f32) -> MonotonicSection {
        let block = course.block;
        let left_mm = self.remaining as f32 * (block.length_mm / WHOLE_Q31 as f32);
        let top_sqr = block.nominal_mm_s * block.nominal_mm_s;
        let mut piece = MonotonicSection {
            length_mm: left_mm,
            exit_measure: course.measure(math::min(exit_sqr, top_sqr)),
            ends_block: true,
        };
        let (length_mm, ends_block) = self.section_length(course, left_mm, MIN_SECTION_S);
        if !ends_block {
            let rest = course.measure_per_mm() * (left_mm - length_mm);
            piece = MonotonicSection {
                length_mm,
                exit_measure: piece.exit_measure + rest,
                ends_block,
            };
        }
        piece
    }

    /// The length of what is left of a piece, and whether it ends the block, of which so much is left;
    /// what is shorter than a sliver at the block's speed is no piece of its own.
    pub(super) fn section_length(
        &self,
        course: BlockGeometry<'_>,
        left_mm: f32,
        sliver_s: f32,
    ) -> (f32, bool) {
        if let Some(curve) = course.curve {
            let sliver_mm = sliver_s * course.block.nominal_mm_s;
            let length_mm = match &curve.shape {
                Shape::Planar { .. } => self.distance_to_quarter(curve, sliver_mm),
                Shape::Spatial(circle) => {
                    self.distance_to_reversal(course.block, circle, sliver_mm)
                }
            };
            if length_mm < left_mm - sliver_mm {
                return (length_mm, false);
            }
        }
        (left_mm, true)
    }

    /// The way to where an axis of the plane reverses next, but for one that is very near, mm.
    fn distance_to_quarter(&self, curve: &Curve, sliver_mm: f32) -> f32 {
        const QUARTER: u32 = 1 << 30;
        // Parts of the block are coarser than phases where the arc has many turns.
        let grain = (curve.sweep.unsigned_abs() >> 30) as u32 + 16;
        let phase = self.phase & (QUARTER - 1);
        let to_go = if curve.sweep > 0 {
            QUARTER - phase
        } else {
            phase
        };
        let length_mm = to_go as f32 * curve.mm_per_phase;
        if to_go < grain || length_mm < sliver_mm {
            length_mm + QUARTER as f32 * curve.mm_per_phase
        } else {
            length_mm
        }
    }

    /// The way to where an axis reverses next, but for one that is very near, mm; no less than to the
    /// end of the curve where none does.
    #[inline(never)]
    fn distance_to_reversal(&self, block: &Block, circle: &SpatialArc, sliver_mm: f32) -> f32 {
        let done = WHOLE_Q31 - self.remaining;
        let scale = block.length_mm / WHOLE_Q31 as f32;
        let way_mm = |part: u16| (u32::from(part) << 15).saturating_sub(done) as f32 * scale;
        let [first, second, third] = circle.reversals.map(way_mm);
        if first > sliver_mm {
            first
        } else if second > sliver_mm {
            second
        } else if third > sliver_mm {
            third
        } else {
            f32::MAX
        }
    }

    /// The motion of the axes over a stretch.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    pub(super) fn segment(
        &mut self,
        course: BlockGeometry<'_>,
        stretch: &SegmentProfile,
        ends_block: bool,
        segment: &mut Segment,
    ) {
        let block = course.block;
        let ticks = ((stretch.seconds * TICKS_PER_S + 0.5) as u32).max(1);
        if ends_block {
            self.remaining = 0;
        } else {
            let parts = stretch.length_mm * (WHOLE_Q31 as f32 / block.length_mm) + self.carry;
            let whole = parts as u32;
            self.carry = parts - whole as f32;
            self.remaining -= whole.min(self.remaining);
        }
        let done = WHOLE_Q31 - self.remaining;
        let mut here = Direction::NONE;
        if let Some(curve) = course.curve {
            self.phase = phase_at(curve, done);
            here = Direction::at(self.phase);
        }
        let way = displacement_at(course, done, self.from_centre, here);
        let speeds = axis_speeds(course, here, stretch.speed_mm_s);
        let rate = 1.0 / ticks as f32;
        let axes = Axes::from_fn(|axis| AxisMotion {
            to: FineSteps(self.start[axis].0.wrapping_add(way[axis])),
            acceleration: (speeds[axis] - self.axis_speed[axis]) * rate,
        });
        self.axis_speed = speeds;
        *segment = Segment {
            ticks,
            axes,
            feed_mm_min: stretch.speed_mm_s * 60.0,
            line: block.line,
            power: Power::OFF,
        };
    }
}
