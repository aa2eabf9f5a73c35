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

mod places;
mod smooth;

use self::places::{Direction, axis_speeds, phase_at, way_at};
use super::{
    Block, Curve, Laser, Oblique, Shape,
    lookahead::{Course, Plan, Progress},
};
use crate::{
    axis::Axes,
    machine::Power,
    math::{self, WHOLE_Q31},
    stepper::{AxisMotion, LONGEST_SEGMENT_TICKS, SEGMENT_TICKS, Segment},
    units::{FineSteps, TICKS_PER_SECOND},
};

/// Timer ticks per second in floating point.
const TICKS_PER_S: f32 = TICKS_PER_SECOND as f32;
/// A segment of a long piece, s.
pub(super) const SEGMENT_S: f32 = SEGMENT_TICKS as f32 / TICKS_PER_S;
/// Longest segment, s.
pub(super) const LONGEST_S: f32 = LONGEST_SEGMENT_TICKS as f32 / TICKS_PER_S;
/// Shortest segment of a piece that has several, s.
pub(super) const SHORTEST_S: f32 = 0.5 * LONGEST_S;
/// The first segment from rest, s: it makes up for the standstill before it, which is a segment too.
/// On an arc it may last a little longer than meant.
const START_S: f32 = 0.97 * LONGEST_S;
/// What is shorter than that before or after a reversal is no piece of its own, s.
pub(super) const SLIVER_S: f32 = 1.0e-4;
/// The same where acceleration is continuous.
pub(super) const SMOOTH_SLIVER_S: f32 = 4.0e-4;
/// Stands for an acceleration of 0, as at the speed limit of an arc, mm/s², where the block's own is
/// not that small.
const LEAST_MM_S2: f32 = 1.0e-3;
/// Least part of the block's acceleration that stands for 0.
const LEAST_PART: f32 = 1.0e-4;
/// Stands for a speed of 0 in a divisor, mm/s: slower than the slowest.
const LEAST_MM_S: f32 = 1.0e-20;
/// A piece that takes so long at the greatest speed that it may have has surely room for more than two
/// segments behind one, s, whatever rounding does.
const FAR_S: f32 = 1.01 * (SEGMENT_S + LONGEST_S);
/// Way to brake beyond what is needed that is surely enough.
const FREE: f32 = 1.001;
/// A measure of speed that is that much above the plan's is within it.
const WITHIN: f32 = 1.0001;
/// Whether motion is to go on or to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Goal {
    /// As fast as the plan allows.
    Run,
    /// To a standstill as soon as the limits allow, on the path.
    Stop,
}

/// A segment's way along the path.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stretch {
    /// Length, mm.
    length_mm: f32,
    /// Speed at its end, mm/s.
    speed_mm_s: f32,
    /// Duration, s.
    seconds: f32,
    /// Whether it ends its piece.
    ends_piece: bool,
}

/// What is left of a piece.
#[derive(Debug, Clone, Copy)]
struct Piece {
    /// Its length, mm.
    length_mm: f32,
    /// The measure of the greatest speed at its end.
    exit: f32,
    /// Whether it ends the block.
    ends_block: bool,
}

/// Where on the path the machine is, and how fast.
#[derive(Debug)]
pub(super) struct Executor {
    /// Part of the block that is still to go, 2³¹ for all of it.
    left: u32,
    /// What rounding the last segment's way to such parts left over.
    carry: f32,
    /// Speed along the path, mm/s.
    speed_mm_s: f32,
    /// Exact position at the start of the block, and the direction from the centre of an arc.
    start: Axes<FineSteps>,
    from_centre: Direction,
    /// Angle seen from the centre where the machine is.
    phase: u32,
    /// Speed of each axis at the end of the last segment, steps per tick.
    axis_speed: Axes<f32>,
    /// A block has been begun.
    is_begun: bool,
    /// A piece has been begun.
    is_within: bool,
    /// The plan has become slower: the speed may be more than it allows.
    is_over: bool,
    /// What has been paced is not played to its end.
    goes_on: bool,
    /// What the laser does in the last segment, and the part of the programmed speed that it has.
    laser: Laser,
    part: f32,
}

impl Executor {
    pub(super) const fn new() -> Self {
        Self {
            left: WHOLE_Q31,
            carry: 0.0,
            speed_mm_s: 0.0,
            start: Axes([FineSteps(0); crate::axis::AXES]),
            from_centre: Direction::NONE,
            phase: 0,
            axis_speed: Axes([0.0; crate::axis::AXES]),
            is_begun: false,
            is_within: false,
            is_over: false,
            goes_on: false,
            laser: Laser::None,
            part: 0.0,
        }
    }

    /// The plan is made anew, for other speeds: how far the machine is with the one before.
    pub(super) fn replanned(&mut self) -> Progress {
        let was_over = self.is_over;
        self.is_over = self.speed_mm_s > 0.0;
        if was_over {
            Progress::Behind
        } else {
            Progress::Followed
        }
    }

    /// What the laser does in the last segment; with power in proportion to the speed also its mean
    /// speed as a part of the programmed one.
    pub(super) const fn beam(&self) -> (Laser, f32) {
        (self.laser, self.part)
    }

    /// Whether the last segment ends in motion.
    #[inline]
    pub(super) fn is_moving(&self) -> bool {
        self.speed_mm_s > 0.0 || self.goes_on
    }

    /// Forgets the block in execution: what was left of it is not executed. At rest, or a fault.
    pub(super) fn abandon(&mut self) {
        self.speed_mm_s = 0.0;
        self.is_begun = false;
        self.is_within = false;
        self.is_over = false;
        self.goes_on = false;
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
        self.follow(Course { block, curve }, way, goal, segment)
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
        self.follow(Course { block, curve }, way, goal, segment)
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "two functions come of this")]
    fn follow(
        &mut self,
        course: Course<'_>,
        (position, exit_sqr): (&Axes<FineSteps>, f32),
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        if !self.is_begun {
            self.begin(course, position);
        }
        let piece = self.piece(course, exit_sqr);
        let stretch = match goal {
            Goal::Run => self.run(course, &piece),
            Goal::Stop => self.stop(course, &piece),
        };
        let ends_block = stretch.ends_piece && piece.ends_block;
        self.segment(course, &stretch, ends_block, segment);
        self.laser = course.block.laser;
        // Nothing else asks for it, and it takes a division.
        if matches!(self.laser, Laser::Proportional(_)) {
            let mean_mm_s = 0.5 * (self.speed_mm_s + stretch.speed_mm_s);
            self.part = mean_mm_s / course.block.programmed_mm_s;
        }
        self.speed_mm_s = stretch.speed_mm_s;
        self.is_within = !stretch.ends_piece && self.speed_mm_s > 0.0;
        ends_block
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn begin(&mut self, course: Course<'_>, position: &Axes<FineSteps>) {
        self.is_begun = true;
        self.is_within = false;
        self.left = WHOLE_Q31;
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
    fn piece(&self, course: Course<'_>, exit_sqr: f32) -> Piece {
        let block = course.block;
        let left_mm = self.left as f32 * (block.length_mm / WHOLE_Q31 as f32);
        let top_sqr = block.speed_mm_s * block.speed_mm_s;
        let mut piece = Piece {
            length_mm: left_mm,
            exit: course.measure(math::min(exit_sqr, top_sqr)),
            ends_block: true,
        };
        let (length_mm, ends_block) = self.piece_length(course, left_mm, SLIVER_S);
        if !ends_block {
            let rest = course.measure_per_mm() * (left_mm - length_mm);
            piece = Piece {
                length_mm,
                exit: piece.exit + rest,
                ends_block,
            };
        }
        piece
    }

    /// The length of what is left of a piece, and whether it ends the block, of which so much is left;
    /// what is shorter than a sliver at the block's speed is no piece of its own.
    fn piece_length(&self, course: Course<'_>, left_mm: f32, sliver_s: f32) -> (f32, bool) {
        if let Some(curve) = course.curve {
            let sliver_mm = sliver_s * course.block.speed_mm_s;
            let length_mm = match &curve.shape {
                Shape::Flat { .. } => self.way_to_quarter(curve, sliver_mm),
                Shape::Oblique(circle) => self.way_on(course.block, circle, sliver_mm),
            };
            if length_mm < left_mm - sliver_mm {
                return (length_mm, false);
            }
        }
        (left_mm, true)
    }

    /// The way to where an axis of the plane reverses next, but for one that is very near, mm.
    fn way_to_quarter(&self, curve: &Curve, sliver_mm: f32) -> f32 {
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
    fn way_on(&self, block: &Block, circle: &Oblique, sliver_mm: f32) -> f32 {
        let done = WHOLE_Q31 - self.left;
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

    /// A stretch towards the greatest speed at the piece's end.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn run(&mut self, course: Course<'_>, piece: &Piece) -> Stretch {
        let speed = self.speed_mm_s;
        let measure = course.measure(speed * speed);
        let change = course.measure_per_mm() * piece.length_mm;
        if course.curve.is_none()
            && let Some(stretch) = self.run_freely(course, piece, change)
        {
            debug_assert_eq!(
                stretch,
                self.run_to_end(course, piece, measure, change),
                "a short cut that leads elsewhere"
            );
            return stretch;
        }
        self.run_to_end(course, piece, measure, change)
    }

    /// The same, however near the end is.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn run_to_end(
        &mut self,
        course: Course<'_>,
        piece: &Piece,
        measure: f32,
        change: f32,
    ) -> Stretch {
        let block = course.block;
        let speed = self.speed_mm_s;
        let mut end = math::min(piece.exit, measure + change);
        if self.is_over {
            // Braking as hard as the limits allow is always within the plan before, and so within
            // every limit but the new speed.
            end = math::max(end, measure - change);
            let is_too_near = measure > (piece.exit + change) * WITHIN;
            self.is_over = speed > block.speed_mm_s * WITHIN || is_too_near;
        }
        let end_speed = math::sqrt(course.speed_sqr(end));
        let end_speed = math::min(end_speed, math::max(block.speed_mm_s, speed));
        let double_mm = 2.0 * piece.length_mm;
        if double_mm <= LONGEST_S * (speed + end_speed) {
            return self.last(piece, end_speed);
        }
        let seconds = if speed <= 0.0 {
            START_S
        } else {
            share(double_mm / (speed + end_speed))
        };
        let gain = acceleration_left(course, speed) * seconds;
        // The speed at which braking begins: v² = e² - 2·(v0 + v)/2·gain, with e² as it could be here.
        let room = course.speed_sqr(piece.exit + change) - gain * speed;
        let room = math::max(room, 0.0);
        let half = 0.5 * gain;
        let braking = room / (half + math::sqrt(half * half + room));
        // The speed at which the shortest segment is left.
        let lasting =
            (double_mm - speed * seconds - SHORTEST_S * end_speed) / (seconds + SHORTEST_S);
        let top = math::min(speed + gain, block.speed_mm_s);
        let reached = math::min(top, math::min(braking, lasting));
        let reached = math::max(reached, math::max(speed - gain, 0.0));
        let length_mm = 0.5 * (speed + reached) * seconds;
        if length_mm >= piece.length_mm {
            return self.last(piece, end_speed);
        }
        if course.curve.is_some() {
            return self.on_arc(course, piece, measure, length_mm, reached);
        }
        Stretch {
            length_mm,
            speed_mm_s: reached,
            seconds,
            ends_piece: false,
        }
    }

    /// The same where the end of a line is so far away that nothing but the limits decides: two roots
    /// and three divisions less.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn run_freely(&self, course: Course<'_>, piece: &Piece, change: f32) -> Option<Stretch> {
        let (speed, block) = (self.speed_mm_s, course.block);
        let most = math::max(block.speed_mm_s, speed);
        let is_far = 2.0 * piece.length_mm >= FAR_S * (speed + most);
        if self.is_over || speed <= 0.0 || !is_far {
            return None;
        }
        let gain = block.acceleration_mm_s2 * SEGMENT_S;
        let top = math::min(speed + gain, block.speed_mm_s);
        let room = piece.exit + change - gain * speed;
        if room < top * (top + gain) * FREE {
            return None;
        }
        let reached = math::max(top, math::max(speed - gain, 0.0));
        Some(Stretch {
            length_mm: 0.5 * (speed + reached) * SEGMENT_S,
            speed_mm_s: reached,
            seconds: SEGMENT_S,
            ends_piece: false,
        })
    }

    /// The last stretch of a piece, to a speed at most: it takes its time after others, or from rest.
    fn last(&self, piece: &Piece, speed_mm_s: f32) -> Stretch {
        let speed = self.speed_mm_s;
        let double_mm = 2.0 * piece.length_mm;
        let mut end_speed = speed_mm_s;
        if speed <= 0.0 {
            end_speed = math::min(end_speed, double_mm * (1.0 / LONGEST_S));
        } else if self.is_within && !self.is_over {
            let lasting = double_mm * (1.0 / SHORTEST_S) - speed;
            end_speed = math::min(end_speed, math::max(lasting, 0.0));
        }
        Stretch {
            length_mm: piece.length_mm,
            speed_mm_s: end_speed,
            seconds: lasting_s(double_mm, speed + end_speed),
            ends_piece: true,
        }
    }

    /// A stretch of an arc about to a speed: what that is exactly follows from the way.
    fn on_arc(
        &self,
        course: Course<'_>,
        piece: &Piece,
        measure: f32,
        length_mm: f32,
        about_mm_s: f32,
    ) -> Stretch {
        let change = course.measure_per_mm() * length_mm;
        let rest = course.measure_per_mm() * (piece.length_mm - length_mm);
        let mut most = math::min(measure + change, piece.exit + rest);
        if self.is_over {
            most = math::max(most, measure - change);
        }
        let speed_mm_s = math::min(about_mm_s, math::sqrt(course.speed_sqr(most)));
        Stretch {
            length_mm,
            speed_mm_s,
            seconds: lasting_s(2.0 * length_mm, self.speed_mm_s + speed_mm_s),
            ends_piece: false,
        }
    }

    /// A stretch towards a standstill.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn stop(&self, course: Course<'_>, piece: &Piece) -> Stretch {
        let speed = self.speed_mm_s;
        let measure = course.measure(speed * speed);
        let per_mm = course.measure_per_mm();
        let change = per_mm * piece.length_mm;
        let mut end = math::max(measure - change, 0.0);
        if !self.is_over || measure <= (piece.exit + change) * WITHIN {
            // The plan has a way to brake to that: more is what was rounded.
            end = math::min(end, piece.exit);
        }
        let end_speed = math::sqrt(course.speed_sqr(end));
        let way_mm = math::min(measure / per_mm, piece.length_mm);
        // Not in less time than a segment has to take, if there is the way.
        let shortest_mm = math::min(0.5 * SHORTEST_S * speed, piece.length_mm);
        let way_mm = math::max(way_mm, shortest_mm);
        let whole_s = 2.0 * way_mm / math::max(speed + end_speed, LEAST_MM_S);
        if whole_s <= LONGEST_S {
            return Stretch {
                length_mm: way_mm,
                speed_mm_s: end_speed,
                seconds: whole_s,
                ends_piece: way_mm >= piece.length_mm,
            };
        }
        let gain = acceleration_left(course, speed) * share(whole_s);
        let length_mm = (speed - 0.5 * gain) * share(whole_s);
        let reached = math::max(measure - per_mm * length_mm, end);
        let speed_mm_s = math::sqrt(course.speed_sqr(reached));
        Stretch {
            length_mm,
            speed_mm_s,
            seconds: lasting_s(2.0 * length_mm, speed + speed_mm_s),
            ends_piece: false,
        }
    }

    /// The motion of the axes over a stretch.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn segment(
        &mut self,
        course: Course<'_>,
        stretch: &Stretch,
        ends_block: bool,
        segment: &mut Segment,
    ) {
        let block = course.block;
        let ticks = ((stretch.seconds * TICKS_PER_S + 0.5) as u32).max(1);
        if ends_block {
            self.left = 0;
        } else {
            let parts = stretch.length_mm * (WHOLE_Q31 as f32 / block.length_mm) + self.carry;
            let whole = parts as u32;
            self.carry = parts - whole as f32;
            self.left -= whole.min(self.left);
        }
        let done = WHOLE_Q31 - self.left;
        let mut here = Direction::NONE;
        if let Some(curve) = course.curve {
            self.phase = phase_at(curve, done);
            here = Direction::at(self.phase);
        }
        let way = way_at(course, done, self.from_centre, here);
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

/// The part of a time that fits a segment: never leaves a sliver for the next.
fn share(seconds: f32) -> f32 {
    if seconds < SEGMENT_S + LONGEST_S {
        0.5 * seconds
    } else {
        SEGMENT_S
    }
}

/// The time for half of a way at both speeds' sum; never longer than the longest segment.
fn lasting_s(double_mm: f32, sum_mm_s: f32) -> f32 {
    math::min(double_mm / math::max(sum_mm_s, LEAST_MM_S), LONGEST_S)
}

/// Acceleration along the path that the block's limits leave at a speed, mm/s²: never 0.
fn acceleration_left(course: Course<'_>, speed_mm_s: f32) -> f32 {
    let most = course.block.acceleration_mm_s2;
    match course.curve {
        None => most,
        Some(curve) => {
            let used = math::min(speed_mm_s * speed_mm_s / curve.limit_sqr, 1.0);
            let left = most * math::sqrt(1.0 - used * used);
            math::max(left, math::min(LEAST_MM_S2, LEAST_PART * most))
        }
    }
}
