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
//! A segment lies within one block and one phase and lasts at most 1 ms; on an arc it also ends
//! where an axis reverses. Its phase is decided from the present speed and the way left, so a feed
//! hold, a new block or a changed limit needs nothing but the next segment.

use super::{Block, Curve, Laser, lookahead::Plan};
use crate::{
    axis::Axes,
    machine::Power,
    math::{self, WHOLE_Q31},
    stepper::{AxisMotion, SEGMENT_TICKS, Segment},
    units::{FineSteps, TICKS_PER_SECOND},
};

/// Timer ticks per second in floating point.
const TICKS_PER_S: f32 = TICKS_PER_SECOND as f32;
/// Longest segment, s.
const SEGMENT_S: f32 = SEGMENT_TICKS as f32 / TICKS_PER_S;
/// Phases shorter than this are left out, s.
const SHORTEST_PHASE_S: f32 = 20.0e-6;
/// Stands for an acceleration of 0, as at the speed limit of an arc, mm/s², where the block's own is
/// not that small.
const LEAST_MM_S2: f32 = 1.0e-3;
/// Least part of the block's acceleration that stands for 0.
const LEAST_PART: f32 = 1.0e-4;
/// Stands for a speed of 0 in a divisor, mm/s: slower than the slowest.
const LEAST_MM_S: f32 = 1.0e-20;
/// A measure of speed that is that much above the plan's is within it.
const WITHIN: f32 = 1.0001;
/// A segment that leaves less than this of its own length of the block takes it along.
const REMNANT: f32 = 0.02;

/// Whether motion is to go on or to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Goal {
    /// As fast as the plan allows.
    Run,
    /// To a standstill as soon as the limits allow, on the path.
    Stop,
}

/// A segment's way along the path.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    /// Length, mm.
    length_mm: f32,
    /// Speed at its end, mm/s.
    speed_mm_s: f32,
    /// Duration, s.
    seconds: f32,
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
    /// Exact position at the start of the block.
    start: Axes<FineSteps>,
    /// Speed of each axis at the end of the last segment, steps per tick.
    axis_speed: Axes<f32>,
    /// A block has been begun.
    is_begun: bool,
    /// The plan has become slower: the speed may be more than it allows.
    is_over: bool,
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
            axis_speed: Axes([0.0; crate::axis::AXES]),
            is_begun: false,
            is_over: false,
            laser: Laser::None,
            part: 0.0,
        }
    }

    /// The plan has been made anew, for other speeds.
    pub(super) fn replanned(&mut self) {
        self.is_over = self.speed_mm_s > 0.0;
    }

    /// What the laser does in the last segment, and its mean speed as a part of the programmed one.
    pub(super) const fn beam(&self) -> (Laser, f32) {
        (self.laser, self.part)
    }

    /// Forgets the block in execution: what was left of it is not executed. At rest, or a fault.
    pub(super) fn abandon(&mut self) {
        self.speed_mm_s = 0.0;
        self.is_begun = false;
        self.is_over = false;
    }

    /// The next segment, from `position`, is put into `segment`; false at the end of the plan or,
    /// when stopping, at rest.
    ///
    /// Removes a block from the plan with its last segment.
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
        if !self.is_begun {
            self.begin(block, position);
        }
        let left_mm = self.left as f32 * (block.length_mm / WHOLE_Q31 as f32);
        let mut stretch = match goal {
            Goal::Run => self.run(block, left_mm, exit_sqr),
            Goal::Stop => self.stop(block, left_mm),
        };
        if let Some(curve) = &block.curve {
            stretch = self.cut_at_reversal(curve, stretch);
        }
        self.segment(block, &stretch, segment);
        self.laser = block.laser;
        self.part = 0.5 * (self.speed_mm_s + stretch.speed_mm_s) / block.programmed_mm_s;
        self.speed_mm_s = stretch.speed_mm_s;
        if stretch.ends_block {
            plan.pop();
            self.is_begun = false;
        }
        true
    }

    fn begin(&mut self, block: &Block, position: &Axes<FineSteps>) {
        self.is_begun = true;
        self.left = WHOLE_Q31;
        self.carry = 0.0;
        self.start = *position;
        self.axis_speed = axis_speeds(block, 0, self.speed_mm_s);
    }

    /// A stretch towards the planned exit speed.
    fn run(&mut self, block: &Block, left_mm: f32, exit_sqr: f32) -> Stretch {
        let speed = self.speed_mm_s;
        let measure = block.measure(speed * speed);
        let mut exit = block.measure(exit_sqr);
        let per_mm = block.measure_per_mm();
        // Greatest speed from which the exit speed can still be reached.
        let top = block.measure(block.speed_mm_s * block.speed_mm_s);
        let mut peak = math::min(top, 0.5 * (measure + exit + per_mm * left_mm));
        let mut exit_speed_sqr = exit_sqr;
        if self.is_over {
            // Braking as hard as the limits allow is always within the plan before, and so within
            // every limit but the new speed.
            let least = measure - per_mm * left_mm;
            self.is_over = measure > top * WITHIN || least > exit * WITHIN;
            if least > exit {
                exit = least;
                exit_speed_sqr = block.speed_sqr(exit);
                peak = math::max(math::min(top, measure), exit);
            }
        }
        let exit_speed = || math::sqrt(exit_speed_sqr);
        let peak_speed = math::sqrt(block.speed_sqr(peak));
        let acceleration = acceleration_left(block, speed);
        let near = SHORTEST_PHASE_S * acceleration;
        if speed <= 0.0 || peak_speed - speed > near {
            let seconds = share((peak_speed - speed) / acceleration);
            let way = (speed + 0.5 * acceleration * seconds) * seconds;
            let reached = block.speed_sqr(math::min(measure + per_mm * way, peak));
            return finish(speed, way, math::sqrt(reached), left_mm, || {
                math::min(
                    math::sqrt(block.speed_sqr(measure + per_mm * left_mm)),
                    exit_speed(),
                )
            });
        }
        let cruise_mm = left_mm - (peak - exit) / per_mm;
        let cruises = cruise_mm > peak_speed * SHORTEST_PHASE_S;
        if cruises && speed - peak_speed <= near {
            // What little is missing comes on the way; what little is too much goes at once.
            let from = math::min(speed, peak_speed);
            let mean = 0.5 * (from + peak_speed);
            let seconds = share(cruise_mm / mean);
            return finish(from, mean * seconds, peak_speed, left_mm, || {
                math::min(peak_speed, exit_speed())
            });
        }
        let slowest = if cruises {
            peak_speed
        } else {
            math::min(exit_speed(), speed)
        };
        let seconds = share((speed - slowest) / acceleration);
        let way = (speed - 0.5 * acceleration * seconds) * seconds;
        if cruises {
            let reached = block.speed_sqr(math::max(measure - per_mm * way, peak));
            return finish(speed, way, math::sqrt(reached), left_mm, || slowest);
        }
        if seconds < SHORTEST_PHASE_S || way >= left_mm * (1.0 - REMNANT) {
            return finish(speed, left_mm, slowest, left_mm, || slowest);
        }
        let reached = math::sqrt(block.speed_sqr(exit + per_mm * (left_mm - way)));
        finish(speed, way, math::min(reached, speed), left_mm, || slowest)
    }

    /// A stretch towards a standstill.
    fn stop(&self, block: &Block, left_mm: f32) -> Stretch {
        let speed = self.speed_mm_s;
        let measure = block.measure(speed * speed);
        let per_mm = block.measure_per_mm();
        let way_mm = measure / per_mm;
        let acceleration = acceleration_left(block, speed);
        let all_seconds = speed / acceleration;
        let seconds = share(all_seconds);
        let way = (speed - 0.5 * acceleration * seconds) * seconds;
        let slower = |way: f32| math::sqrt(block.speed_sqr(math::max(measure - per_mm * way, 0.0)));
        if all_seconds <= SEGMENT_S || way >= way_mm * (1.0 - REMNANT) {
            return finish(speed, way_mm, 0.0, left_mm, || slower(left_mm));
        }
        finish(speed, way, slower(way), left_mm, || slower(left_mm))
    }

    /// Ends a stretch where an axis of the plane reverses.
    fn cut_at_reversal(&self, curve: &Curve, stretch: Stretch) -> Stretch {
        const QUARTER: u32 = 1 << 30;
        // Parts of the block are coarser than phases where the arc has many turns.
        let grain = (curve.sweep.unsigned_abs() >> 30) as u32 + 16;
        let phase = phase_at(curve, WHOLE_Q31 - self.left) & (QUARTER - 1);
        let mut to_go = if curve.sweep > 0 {
            QUARTER - phase
        } else {
            phase
        };
        if to_go < grain {
            to_go += QUARTER;
        }
        let length_mm = to_go as f32 * curve.mm_per_phase;
        if length_mm >= stretch.length_mm * (1.0 - REMNANT * 0.5) {
            return stretch;
        }
        let begin = self.speed_mm_s * self.speed_mm_s;
        let change = stretch.speed_mm_s * stretch.speed_mm_s - begin;
        let end = begin + change * (length_mm / stretch.length_mm);
        let speed_mm_s = math::sqrt(end);
        Stretch {
            length_mm,
            speed_mm_s,
            seconds: math::min(
                2.0 * length_mm / math::max(self.speed_mm_s + speed_mm_s, LEAST_MM_S),
                stretch.seconds,
            ),
            ends_block: false,
        }
    }

    /// The motion of the axes over a stretch.
    fn segment(&mut self, block: &Block, stretch: &Stretch, segment: &mut Segment) {
        let ticks = ((stretch.seconds * TICKS_PER_S + 0.5) as u32).max(1);
        if stretch.ends_block {
            self.left = 0;
        } else {
            let parts = stretch.length_mm * (WHOLE_Q31 as f32 / block.length_mm) + self.carry;
            let whole = parts as u32;
            self.carry = parts - whole as f32;
            self.left -= whole.min(self.left);
        }
        let done = WHOLE_Q31 - self.left;
        let way = way_at(block, done);
        let speeds = axis_speeds(block, done, stretch.speed_mm_s);
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

/// The part of a phase of `seconds` that fits a segment: never leaves a sliver for the next.
fn share(seconds: f32) -> f32 {
    if seconds <= SEGMENT_S {
        seconds
    } else if seconds < 2.0 * SEGMENT_S {
        0.5 * seconds
    } else {
        SEGMENT_S
    }
}

/// A stretch of `length_mm` to `speed_mm_s`, or to the block's end if that comes first or is near.
fn finish(
    from_mm_s: f32,
    length_mm: f32,
    speed_mm_s: f32,
    left_mm: f32,
    speed_at_end: impl Fn() -> f32,
) -> Stretch {
    let ends_block = length_mm >= left_mm || left_mm - length_mm < REMNANT * length_mm;
    let (length_mm, speed_mm_s) = if ends_block {
        (left_mm, speed_at_end())
    } else {
        (length_mm, speed_mm_s)
    };
    Stretch {
        length_mm,
        speed_mm_s,
        seconds: math::min(
            2.0 * length_mm / math::max(from_mm_s + speed_mm_s, LEAST_MM_S),
            2.0 * SEGMENT_S,
        ),
        ends_block,
    }
}

/// Acceleration along the path that the block's limits leave at a speed, mm/s²: never 0.
fn acceleration_left(block: &Block, speed_mm_s: f32) -> f32 {
    let most = block.acceleration_mm_s2;
    match &block.curve {
        None => most,
        Some(curve) => {
            let used = math::min(speed_mm_s * speed_mm_s / curve.limit_sqr, 1.0);
            let left = most * math::sqrt(1.0 - used * used);
            math::max(left, math::min(LEAST_MM_S2, LEAST_PART * most))
        }
    }
}

/// Angle seen from the centre where a part of the arc is done.
fn phase_at(curve: &Curve, done: u32) -> u32 {
    curve
        .phase
        .wrapping_add(math::scale_q31(curve.sweep, done) as u32)
}

/// The way of each axis from the block's start where a part of it is done.
fn way_at(block: &Block, done: u32) -> Axes<i64> {
    let mut way = block.delta.map(|delta| math::scale_q31(delta, done));
    if let Some(curve) = &block.curve {
        if done == WHOLE_Q31 {
            return way;
        }
        let begin = math::cos_sin(curve.phase);
        let here = math::cos_sin(phase_at(curve, done));
        let [first, second] = curve.radius;
        let [first_change, second_change] = curve.radius_delta;
        let along = |radius: i64, change: i64, begin: i32, here: i32| {
            let reached = radius.wrapping_add(math::scale_q31(change, done));
            math::scale_q30(reached, here).wrapping_sub(math::scale_q30(radius, begin))
        };
        put(
            &mut way,
            curve.first,
            along(first, first_change, begin.0, here.0),
        );
        put(
            &mut way,
            curve.second,
            along(second, second_change, begin.1, here.1),
        );
    }
    way
}

/// Speed of each axis where a part of the block is done, steps per tick.
fn axis_speeds(block: &Block, done: u32, speed_mm_s: f32) -> Axes<f32> {
    let speed = speed_mm_s * (1.0 / TICKS_PER_S);
    let mut speeds = block.steps_per_mm.map(|steps| steps * speed);
    if let Some(curve) = &block.curve {
        let (cosine, sine) = math::cos_sin(phase_at(curve, done));
        let sign = if curve.sweep > 0 { 1.0 } else { -1.0 };
        let scale = sign / math::ONE_Q30 as f32;
        scale_by(&mut speeds, curve.first, -sine as f32 * scale);
        scale_by(&mut speeds, curve.second, cosine as f32 * scale);
    }
    speeds
}

fn put(axes: &mut Axes<i64>, axis: u8, value: i64) {
    if let Some(place) = axes.0.get_mut(usize::from(axis)) {
        *place = value;
    }
}

fn scale_by(axes: &mut Axes<f32>, axis: u8, factor: f32) {
    if let Some(place) = axes.0.get_mut(usize::from(axis)) {
        *place *= factor;
    }
}
