//! The trapezoidal profile: acceleration changes at once.
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
//! [`plan_part`] plans entry speeds from which each block can be braked in. A segment's length, duration
//! and end speed follow from them: the end speed is the greatest that the limits, the remaining braking
//! distance, and the segments to come allow. It follows from the present speed and the remaining distance
//! alone, so a feed hold, a new block or a changed limit needs nothing but the next segment.
//!
//! Speeds to brake to are compared by their measure, see [`BlockGeometry::measure`].

mod braking;

use self::braking::Braking;
use super::{
    executor::{Executor, Goal, NextSegment, SegmentProfile},
    kinematics::BlockGeometry,
    limits::{
        FIRST_SEGMENT_S, LONGEST_SEGMENT_S, MIN_DIVISOR_MM_S, MIN_SECTION_S, SHORTEST_SEGMENT_S,
        SPEED_TOLERANCE, SegmentTimes, segment_share_s,
    },
    pass::Pass,
    queue::{BLOCKS, BlockQueue},
};
use crate::{
    axis::Axes,
    math::{self, WHOLE_Q31},
    model::Laser,
    path::{Block, Curve},
    stepper::Segment,
    units::FineSteps,
};

/// Blocks of one part of a backward pass.
const BLOCKS_PER_PART: usize = 64;

/// Least acceleration along an arc near its speed limit, where none is left, mm/s². For a block with
/// less than ten thousand times that, [`MIN_ACCELERATION_SHARE`] of the block's own.
const MIN_ACCELERATION_MM_S2: f32 = 1.0e-3;
const MIN_ACCELERATION_SHARE: f32 = 1.0e-4;
/// Duration of a remaining section, at the greatest speed, from which more than two segments follow the next one, as a
/// part of a nominal and the longest segment: 1 % above the bound, for rounding.
const FAR_FROM_END_FACTOR: f32 = 1.01;
/// Factor on the braking distance that surely covers rounding: a far segment equals the segment by
/// [`Executor::braking_profile`] (an assertion of debug builds compares them).
const BRAKING_RESERVE: f32 = 1.001;

/// What is planned of a block.
#[derive(Debug)]
pub(super) struct BrakingPlan {
    /// Planned squared entry speed, (mm/s)².
    entry_sqr: f32,
    /// What braking in the block changes.
    braking: Braking,
}

impl BrakingPlan {
    pub(super) const NONE: Self = Self {
        entry_sqr: 0.0,
        braking: Braking::NONE,
    };

    /// Of a new block: no entry speed is as low, so that the pass changes it.
    pub(super) fn new(block: &Block) -> Self {
        Self {
            entry_sqr: -1.0,
            braking: Braking::new(block),
        }
    }
}

impl BlockQueue {
    /// The squared speed at which the block in execution may be left: 0 when no other follows.
    pub(super) fn exit_sqr(&self) -> f32 {
        if self.len() > 1 {
            self.get(1).trapezoid.entry_sqr
        } else {
            0.0
        }
    }
}

/// Plans a part of the backward pass: entry speeds from the block `from` on backwards, the newest is
/// 1, which may be left at `exit_sqr`. With `is_new` an unchanged entry does not end the pass.
pub(super) fn plan_part(
    queue: &mut BlockQueue,
    pass: &mut Pass,
    from: usize,
    exit_sqr: f32,
    is_new: bool,
) {
    if is_new {
        backward_part::<true>(queue, pass, from, exit_sqr);
    } else {
        backward_part::<false>(queue, pass, from, exit_sqr);
    }
}

#[inline(never)]
fn backward_part<const IS_NEW: bool>(
    queue: &mut BlockQueue,
    pass: &mut Pass,
    from: usize,
    mut exit_sqr: f32,
) {
    *pass = Pass::Done;
    // A part ends where the ring does, so that its blocks are in a row; and before the block in
    // execution, whose entry is history.
    let newest = (queue.first + queue.count).wrapping_sub(from) & (BLOCKS - 1);
    let remaining = queue.count.saturating_sub(from);
    let blocks = remaining.min(BLOCKS_PER_PART).min(newest + 1);
    let row = queue.ring.get_mut(newest + 1 - blocks..=newest);
    let row = row.unwrap_or_default().iter_mut().rev();
    for queued in row.take(BLOCKS_PER_PART) {
        let plan = &mut queued.trapezoid;
        let braked_sqr = match &queued.block.curve {
            None => plan.braking.line_entry_for(exit_sqr),
            Some(curve) => {
                core::hint::cold_path();
                if plan.entry_sqr == queued.limit_sqr && !IS_NEW {
                    // It cannot rise; a root could round it down.
                    return;
                }
                plan.braking.curve_entry_for(exit_sqr, curve)
            }
        };
        exit_sqr = math::min(queued.limit_sqr, braked_sqr);
        if exit_sqr == plan.entry_sqr && !IS_NEW {
            return;
        }
        plan.entry_sqr = exit_sqr;
    }
    if blocks < remaining {
        *pass = Pass::EntrySpeeds {
            back: from + blocks,
            exit_sqr,
            is_new: IS_NEW,
        };
    }
}

/// The remainder of a section.
#[derive(Debug, Clone, Copy)]
struct MonotonicSection {
    /// Length, mm.
    length_mm: f32,
    /// Measure of the greatest speed at its end.
    exit_measure: f32,
    /// Whether it ends the block.
    ends_block: bool,
}

impl Executor {
    /// Makes the next segment, from `position`. After the last segment of a block the caller removes
    /// it from the queue.
    #[inline]
    pub(super) fn next_trapezoid(
        &mut self,
        queue: &BlockQueue,
        position: &Axes<FineSteps>,
        goal: Goal,
        segment: &mut Segment,
    ) -> NextSegment {
        if goal == Goal::Stop && self.speed_mm_s <= 0.0 {
            return NextSegment::Standstill;
        }
        let exit_sqr = queue.exit_sqr();
        let Some(block) = queue.current() else {
            self.speed_mm_s = 0.0;
            return NextSegment::Standstill;
        };
        let limits = (position, exit_sqr);
        let ends_block = match &block.curve {
            Some(curve) => self.follow_arc(block, curve, limits, goal, segment),
            None => self.follow_line(block, limits, goal, segment),
        };
        if ends_block {
            self.is_begun = false;
            NextSegment::EndsBlock
        } else {
            NextSegment::WithinBlock
        }
    }

    /// Makes the next segment of a line at whose end the machine is at standstill, from `position`.
    pub(super) fn next_single_line(
        &mut self,
        line: &Block,
        position: &Axes<FineSteps>,
        goal: Goal,
        segment: &mut Segment,
    ) -> NextSegment {
        if goal == Goal::Stop && self.speed_mm_s <= 0.0 {
            NextSegment::Standstill
        } else if self.follow_line(line, (position, 0.0), goal, segment) {
            self.is_begun = false;
            NextSegment::EndsBlock
        } else {
            NextSegment::WithinBlock
        }
    }

    /// Makes a segment of an arc; returns whether it ends the block.
    #[inline(never)]
    fn follow_arc(
        &mut self,
        block: &Block,
        curve: &Curve,
        limits: (&Axes<FineSteps>, f32),
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        let curve = Some(curve);
        self.follow(BlockGeometry { block, curve }, limits, goal, segment)
    }

    /// Makes a segment of a line; returns whether it ends the block.
    #[inline(never)]
    fn follow_line(
        &mut self,
        block: &Block,
        limits: (&Axes<FineSteps>, f32),
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        let curve = None;
        self.follow(BlockGeometry { block, curve }, limits, goal, segment)
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for lines and for arcs")]
    fn follow(
        &mut self,
        geometry: BlockGeometry<'_>,
        (position, exit_sqr): (&Axes<FineSteps>, f32),
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        if !self.is_begun {
            self.begin(geometry, position);
        }
        let section = self.section(geometry, exit_sqr);
        let profile = match goal {
            Goal::Run => self.run_profile(geometry, &section),
            Goal::Stop => self.stop_profile(geometry, &section),
        };
        let ends_block = profile.ends_section && section.ends_block;
        self.segment(geometry, &profile, ends_block, segment);
        self.laser = geometry.block.laser;
        if matches!(self.laser, Laser::Proportional(_)) {
            let mean_mm_s = 0.5 * (self.speed_mm_s + profile.speed_mm_s);
            self.speed_share = mean_mm_s / geometry.block.programmed_mm_s;
        }
        self.speed_mm_s = profile.speed_mm_s;
        self.is_within_section = !profile.ends_section && self.speed_mm_s > 0.0;
        ends_block
    }

    /// The remainder of the section that the machine is in; the block may be left at `exit_sqr`.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for lines and for arcs")]
    fn section(&self, geometry: BlockGeometry<'_>, exit_sqr: f32) -> MonotonicSection {
        let block = geometry.block;
        let remaining_mm = self.remaining as f32 * (block.length_mm / WHOLE_Q31 as f32);
        let top_sqr = block.nominal_mm_s * block.nominal_mm_s;
        let mut section = MonotonicSection {
            length_mm: remaining_mm,
            exit_measure: geometry.measure(math::min(exit_sqr, top_sqr)),
            ends_block: true,
        };
        let (length_mm, ends_block) = self.section_length(geometry, remaining_mm, MIN_SECTION_S);
        if !ends_block {
            let change_after = geometry.measure_per_mm() * (remaining_mm - length_mm);
            section = MonotonicSection {
                length_mm,
                exit_measure: section.exit_measure + change_after,
                ends_block,
            };
        }
        section
    }

    /// A segment towards the greatest speed at the section's end.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for lines and for arcs")]
    fn run_profile(
        &mut self,
        geometry: BlockGeometry<'_>,
        section: &MonotonicSection,
    ) -> SegmentProfile {
        let speed = self.speed_mm_s;
        let measure = geometry.measure(speed * speed);
        let change = geometry.measure_per_mm() * section.length_mm;
        let times = self.segment_times(geometry.block);
        if geometry.curve.is_none()
            && let Some(profile) = self.far_profile(geometry, section, change, times)
        {
            debug_assert_eq!(
                profile,
                self.braking_profile(geometry, section, (measure, change), times),
                "a short cut that leads elsewhere"
            );
            return profile;
        }
        self.braking_profile(geometry, section, (measure, change), times)
    }

    /// The same wherever the section ends.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for lines and for arcs")]
    fn braking_profile(
        &mut self,
        geometry: BlockGeometry<'_>,
        section: &MonotonicSection,
        (measure, change): (f32, f32),
        times: SegmentTimes,
    ) -> SegmentProfile {
        let block = geometry.block;
        let speed = self.speed_mm_s;
        let mut end = math::min(section.exit_measure, measure + change);
        if self.may_exceed_plan {
            // Braking as hard as the limits allow is always within the plan before, and so within
            // every limit but the new speed.
            end = math::max(end, measure - change);
            let is_too_near = measure > (section.exit_measure + change) * SPEED_TOLERANCE;
            self.may_exceed_plan = speed > block.nominal_mm_s * SPEED_TOLERANCE || is_too_near;
        }
        let end_speed = math::sqrt(geometry.speed_sqr(end));
        let end_speed = math::min(end_speed, math::max(block.nominal_mm_s, speed));
        let double_mm = 2.0 * section.length_mm;
        if double_mm <= times.longest_s * (speed + end_speed) {
            return self.last_profile(section, end_speed, times);
        }
        let seconds = if speed <= 0.0 {
            FIRST_SEGMENT_S
        } else {
            times.share_s(double_mm / (speed + end_speed))
        };
        let gain = tangential_acceleration(geometry, speed) * seconds;
        // The speed at which braking begins: v² = e² - 2·(v0 + v)/2·gain, with e² as it could be here.
        let room = geometry.speed_sqr(section.exit_measure + change) - gain * speed;
        let room = math::max(room, 0.0);
        let half = 0.5 * gain;
        let braking = room / (half + math::sqrt(half * half + room));
        // The speed at which the shortest segment is left.
        let shortest_last = (double_mm - speed * seconds - SHORTEST_SEGMENT_S * end_speed)
            / (seconds + SHORTEST_SEGMENT_S);
        let top = math::min(speed + gain, block.nominal_mm_s);
        let reached = math::min(top, math::min(braking, shortest_last));
        let reached = math::max(reached, math::max(speed - gain, 0.0));
        let length_mm = 0.5 * (speed + reached) * seconds;
        if length_mm >= section.length_mm {
            return self.last_profile(section, end_speed, times);
        }
        if geometry.curve.is_some() {
            return self.arc_profile(geometry, section, measure, length_mm, reached);
        }
        SegmentProfile {
            length_mm,
            speed_mm_s: reached,
            seconds,
            ends_section: false,
        }
    }

    /// The same of a line whose end is so far away that only the limits of the block count.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for lines and for arcs")]
    fn far_profile(
        &self,
        geometry: BlockGeometry<'_>,
        section: &MonotonicSection,
        change: f32,
        times: SegmentTimes,
    ) -> Option<SegmentProfile> {
        let (speed, block) = (self.speed_mm_s, geometry.block);
        let most = math::max(block.nominal_mm_s, speed);
        let is_far = 2.0 * section.length_mm
            >= FAR_FROM_END_FACTOR * (times.nominal_s + times.longest_s) * (speed + most);
        let seconds = times.nominal_s;
        if self.may_exceed_plan || speed <= 0.0 || !is_far {
            return None;
        }
        let gain = block.acceleration_mm_s2 * seconds;
        let top = math::min(speed + gain, block.nominal_mm_s);
        let room = section.exit_measure + change - gain * speed;
        if room < top * (top + gain) * BRAKING_RESERVE {
            return None;
        }
        let reached = math::max(top, math::max(speed - gain, 0.0));
        Some(SegmentProfile {
            length_mm: 0.5 * (speed + reached) * seconds,
            speed_mm_s: reached,
            seconds,
            ends_section: false,
        })
    }

    /// The last segment of a section, with `speed_mm_s` at its end at most. From a standstill, and
    /// behind other segments of the section, it is no shorter than such segments have to be.
    #[inline]
    fn last_profile(
        &self,
        section: &MonotonicSection,
        speed_mm_s: f32,
        times: SegmentTimes,
    ) -> SegmentProfile {
        let speed = self.speed_mm_s;
        let double_mm = 2.0 * section.length_mm;
        let mut end_speed = speed_mm_s;
        if speed <= 0.0 {
            end_speed = math::min(end_speed, double_mm * (1.0 / LONGEST_SEGMENT_S));
        } else if self.is_within_section && !self.may_exceed_plan {
            let shortest_last = double_mm * (1.0 / SHORTEST_SEGMENT_S) - speed;
            end_speed = math::min(end_speed, math::max(shortest_last, 0.0));
        }
        SegmentProfile {
            length_mm: section.length_mm,
            speed_mm_s: end_speed,
            seconds: duration_s(double_mm, speed + end_speed, times.longest_s),
            ends_section: true,
        }
    }

    /// A segment of an arc, with a speed of `about_mm_s` at its end as far as its length allows.
    fn arc_profile(
        &self,
        geometry: BlockGeometry<'_>,
        section: &MonotonicSection,
        measure: f32,
        length_mm: f32,
        about_mm_s: f32,
    ) -> SegmentProfile {
        let change = geometry.measure_per_mm() * length_mm;
        let change_after = geometry.measure_per_mm() * (section.length_mm - length_mm);
        let mut most = math::min(measure + change, section.exit_measure + change_after);
        if self.may_exceed_plan {
            most = math::max(most, measure - change);
        }
        let speed_mm_s = math::min(about_mm_s, math::sqrt(geometry.speed_sqr(most)));
        SegmentProfile {
            length_mm,
            speed_mm_s,
            seconds: duration_s(
                2.0 * length_mm,
                self.speed_mm_s + speed_mm_s,
                LONGEST_SEGMENT_S,
            ),
            ends_section: false,
        }
    }

    /// A segment towards a standstill.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for lines and for arcs")]
    fn stop_profile(
        &self,
        geometry: BlockGeometry<'_>,
        section: &MonotonicSection,
    ) -> SegmentProfile {
        let speed = self.speed_mm_s;
        let measure = geometry.measure(speed * speed);
        let per_mm = geometry.measure_per_mm();
        let change = per_mm * section.length_mm;
        let mut end = math::max(measure - change, 0.0);
        if !self.may_exceed_plan || measure <= (section.exit_measure + change) * SPEED_TOLERANCE {
            // The plan brakes to the exit speed: the remainder is rounding.
            end = math::min(end, section.exit_measure);
        }
        let end_speed = math::sqrt(geometry.speed_sqr(end));
        let distance_mm = math::min(measure / per_mm, section.length_mm);
        // Not in less time than a segment has to take, if the section is long enough.
        let shortest_mm = math::min(0.5 * SHORTEST_SEGMENT_S * speed, section.length_mm);
        let distance_mm = math::max(distance_mm, shortest_mm);
        let whole_s = 2.0 * distance_mm / math::max(speed + end_speed, MIN_DIVISOR_MM_S);
        if whole_s <= LONGEST_SEGMENT_S {
            return SegmentProfile {
                length_mm: distance_mm,
                speed_mm_s: end_speed,
                seconds: whole_s,
                ends_section: distance_mm >= section.length_mm,
            };
        }
        let gain = tangential_acceleration(geometry, speed) * segment_share_s(whole_s);
        let length_mm = (speed - 0.5 * gain) * segment_share_s(whole_s);
        let reached = math::max(measure - per_mm * length_mm, end);
        let speed_mm_s = math::sqrt(geometry.speed_sqr(reached));
        SegmentProfile {
            length_mm,
            speed_mm_s,
            seconds: duration_s(2.0 * length_mm, speed + speed_mm_s, LONGEST_SEGMENT_S),
            ends_section: false,
        }
    }
}

/// The duration of a segment of half of `double_mm` between two speeds with the sum `sum_mm_s`; no
/// more than that of the longest segment.
fn duration_s(double_mm: f32, sum_mm_s: f32, longest_s: f32) -> f32 {
    math::min(double_mm / math::max(sum_mm_s, MIN_DIVISOR_MM_S), longest_s)
}

/// Acceleration along the path that the block's limits leave at a speed, mm/s²: never 0.
#[inline]
fn tangential_acceleration(geometry: BlockGeometry<'_>, speed_mm_s: f32) -> f32 {
    let most = geometry.block.acceleration_mm_s2;
    match geometry.curve {
        None => most,
        Some(curve) => {
            let used = math::min(speed_mm_s * speed_mm_s / curve.limit_sqr, 1.0);
            let left = most * math::sqrt(1.0 - used * used);
            math::max(
                left,
                math::min(MIN_ACCELERATION_MM_S2, MIN_ACCELERATION_SHARE * most),
            )
        }
    }
}
