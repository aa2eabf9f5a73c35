//! How fast a piece is gone through: the next stretch of it, a segment's way and the speed at its end.

use super::BlockGeometry;
use crate::{
    math,
    motion::executor::{
        Executor, FIRST_SEGMENT_S, LONGEST_SEGMENT_S, MonotonicSection, NOMINAL_SEGMENT_S,
        SHORTEST_SEGMENT_S,
    },
};

/// Stands for an acceleration of 0, as at the speed limit of an arc, mm/s², where the block's own is
/// not that small.
const MIN_ACCELERATION_MM_S2: f32 = 1.0e-3;
/// Least part of the block's acceleration that stands for 0.
const MIN_ACCELERATION_SHARE: f32 = 1.0e-4;
/// Stands for a speed of 0 in a divisor, mm/s: slower than the slowest.
const LEAST_MM_S: f32 = 1.0e-20;
/// A piece that takes so long at the greatest speed that it may have has surely room for more than two
/// segments behind one, s, whatever rounding does.
const FAR_FROM_END_S: f32 = 1.01 * (NOMINAL_SEGMENT_S + LONGEST_SEGMENT_S);
/// Way to brake beyond what is needed that is surely enough.
const BRAKING_RESERVE: f32 = 1.001;
/// A measure of speed that is that much above the plan's is within it.
pub(in crate::motion) const SPEED_TOLERANCE: f32 = 1.0001;

/// A segment's way along the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::motion) struct SegmentProfile {
    /// Length, mm.
    pub(in crate::motion) length_mm: f32,
    /// Speed at its end, mm/s.
    pub(in crate::motion) speed_mm_s: f32,
    /// Duration, s.
    pub(in crate::motion) seconds: f32,
    /// Whether it ends its piece.
    pub(in crate::motion) ends_section: bool,
}

impl Executor {
    /// A stretch towards the greatest speed at the piece's end.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    pub(in crate::motion) fn run_profile(
        &mut self,
        course: BlockGeometry<'_>,
        piece: &MonotonicSection,
    ) -> SegmentProfile {
        let speed = self.speed_mm_s;
        let measure = course.measure(speed * speed);
        let change = course.measure_per_mm() * piece.length_mm;
        if course.curve.is_none()
            && let Some(stretch) = self.far_profile(course, piece, change)
        {
            debug_assert_eq!(
                stretch,
                self.braking_profile(course, piece, measure, change),
                "a short cut that leads elsewhere"
            );
            return stretch;
        }
        self.braking_profile(course, piece, measure, change)
    }

    /// The same, however near the end is.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn braking_profile(
        &mut self,
        course: BlockGeometry<'_>,
        piece: &MonotonicSection,
        measure: f32,
        change: f32,
    ) -> SegmentProfile {
        let block = course.block;
        let speed = self.speed_mm_s;
        let mut end = math::min(piece.exit_measure, measure + change);
        if self.may_exceed_plan {
            // Braking as hard as the limits allow is always within the plan before, and so within
            // every limit but the new speed.
            end = math::max(end, measure - change);
            let is_too_near = measure > (piece.exit_measure + change) * SPEED_TOLERANCE;
            self.may_exceed_plan = speed > block.nominal_mm_s * SPEED_TOLERANCE || is_too_near;
        }
        let end_speed = math::sqrt(course.speed_sqr(end));
        let end_speed = math::min(end_speed, math::max(block.nominal_mm_s, speed));
        let double_mm = 2.0 * piece.length_mm;
        if double_mm <= LONGEST_SEGMENT_S * (speed + end_speed) {
            return self.last_profile(piece, end_speed);
        }
        let seconds = if speed <= 0.0 {
            FIRST_SEGMENT_S
        } else {
            segment_share_s(double_mm / (speed + end_speed))
        };
        let gain = tangential_acceleration(course, speed) * seconds;
        // The speed at which braking begins: v² = e² - 2·(v0 + v)/2·gain, with e² as it could be here.
        let room = course.speed_sqr(piece.exit_measure + change) - gain * speed;
        let room = math::max(room, 0.0);
        let half = 0.5 * gain;
        let braking = room / (half + math::sqrt(half * half + room));
        // The speed at which the shortest segment is left.
        let lasting = (double_mm - speed * seconds - SHORTEST_SEGMENT_S * end_speed)
            / (seconds + SHORTEST_SEGMENT_S);
        let top = math::min(speed + gain, block.nominal_mm_s);
        let reached = math::min(top, math::min(braking, lasting));
        let reached = math::max(reached, math::max(speed - gain, 0.0));
        let length_mm = 0.5 * (speed + reached) * seconds;
        if length_mm >= piece.length_mm {
            return self.last_profile(piece, end_speed);
        }
        if course.curve.is_some() {
            return self.arc_profile(course, piece, measure, length_mm, reached);
        }
        SegmentProfile {
            length_mm,
            speed_mm_s: reached,
            seconds,
            ends_section: false,
        }
    }

    /// The same where the end of a line is so far away that nothing but the limits decides: two roots
    /// and three divisions less.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    fn far_profile(
        &self,
        course: BlockGeometry<'_>,
        piece: &MonotonicSection,
        change: f32,
    ) -> Option<SegmentProfile> {
        let (speed, block) = (self.speed_mm_s, course.block);
        let most = math::max(block.nominal_mm_s, speed);
        let is_far = 2.0 * piece.length_mm >= FAR_FROM_END_S * (speed + most);
        if self.may_exceed_plan || speed <= 0.0 || !is_far {
            return None;
        }
        let gain = block.acceleration_mm_s2 * NOMINAL_SEGMENT_S;
        let top = math::min(speed + gain, block.nominal_mm_s);
        let room = piece.exit_measure + change - gain * speed;
        if room < top * (top + gain) * BRAKING_RESERVE {
            return None;
        }
        let reached = math::max(top, math::max(speed - gain, 0.0));
        Some(SegmentProfile {
            length_mm: 0.5 * (speed + reached) * NOMINAL_SEGMENT_S,
            speed_mm_s: reached,
            seconds: NOMINAL_SEGMENT_S,
            ends_section: false,
        })
    }

    /// The last stretch of a piece, to a speed at most: it takes its time after others, or from rest.
    fn last_profile(&self, piece: &MonotonicSection, speed_mm_s: f32) -> SegmentProfile {
        let speed = self.speed_mm_s;
        let double_mm = 2.0 * piece.length_mm;
        let mut end_speed = speed_mm_s;
        if speed <= 0.0 {
            end_speed = math::min(end_speed, double_mm * (1.0 / LONGEST_SEGMENT_S));
        } else if self.is_within_section && !self.may_exceed_plan {
            let lasting = double_mm * (1.0 / SHORTEST_SEGMENT_S) - speed;
            end_speed = math::min(end_speed, math::max(lasting, 0.0));
        }
        SegmentProfile {
            length_mm: piece.length_mm,
            speed_mm_s: end_speed,
            seconds: duration_s(double_mm, speed + end_speed),
            ends_section: true,
        }
    }

    /// A stretch of an arc about to a speed: what that is exactly follows from the way.
    fn arc_profile(
        &self,
        course: BlockGeometry<'_>,
        piece: &MonotonicSection,
        measure: f32,
        length_mm: f32,
        about_mm_s: f32,
    ) -> SegmentProfile {
        let change = course.measure_per_mm() * length_mm;
        let rest = course.measure_per_mm() * (piece.length_mm - length_mm);
        let mut most = math::min(measure + change, piece.exit_measure + rest);
        if self.may_exceed_plan {
            most = math::max(most, measure - change);
        }
        let speed_mm_s = math::min(about_mm_s, math::sqrt(course.speed_sqr(most)));
        SegmentProfile {
            length_mm,
            speed_mm_s,
            seconds: duration_s(2.0 * length_mm, self.speed_mm_s + speed_mm_s),
            ends_section: false,
        }
    }

    /// A stretch towards a standstill.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    pub(in crate::motion) fn stop_profile(
        &self,
        course: BlockGeometry<'_>,
        piece: &MonotonicSection,
    ) -> SegmentProfile {
        let speed = self.speed_mm_s;
        let measure = course.measure(speed * speed);
        let per_mm = course.measure_per_mm();
        let change = per_mm * piece.length_mm;
        let mut end = math::max(measure - change, 0.0);
        if !self.may_exceed_plan || measure <= (piece.exit_measure + change) * SPEED_TOLERANCE {
            // The plan has a way to brake to that: more is what was rounded.
            end = math::min(end, piece.exit_measure);
        }
        let end_speed = math::sqrt(course.speed_sqr(end));
        let way_mm = math::min(measure / per_mm, piece.length_mm);
        // Not in less time than a segment has to take, if there is the way.
        let shortest_mm = math::min(0.5 * SHORTEST_SEGMENT_S * speed, piece.length_mm);
        let way_mm = math::max(way_mm, shortest_mm);
        let whole_s = 2.0 * way_mm / math::max(speed + end_speed, LEAST_MM_S);
        if whole_s <= LONGEST_SEGMENT_S {
            return SegmentProfile {
                length_mm: way_mm,
                speed_mm_s: end_speed,
                seconds: whole_s,
                ends_section: way_mm >= piece.length_mm,
            };
        }
        let gain = tangential_acceleration(course, speed) * segment_share_s(whole_s);
        let length_mm = (speed - 0.5 * gain) * segment_share_s(whole_s);
        let reached = math::max(measure - per_mm * length_mm, end);
        let speed_mm_s = math::sqrt(course.speed_sqr(reached));
        SegmentProfile {
            length_mm,
            speed_mm_s,
            seconds: duration_s(2.0 * length_mm, speed + speed_mm_s),
            ends_section: false,
        }
    }
}

/// The part of a time that fits a segment: never leaves a sliver for the next.
pub(in crate::motion) fn segment_share_s(seconds: f32) -> f32 {
    if seconds < NOMINAL_SEGMENT_S + LONGEST_SEGMENT_S {
        0.5 * seconds
    } else {
        NOMINAL_SEGMENT_S
    }
}

/// The time for half of a way at both speeds' sum; never longer than the longest segment.
fn duration_s(double_mm: f32, sum_mm_s: f32) -> f32 {
    math::min(
        double_mm / math::max(sum_mm_s, LEAST_MM_S),
        LONGEST_SEGMENT_S,
    )
}

/// Acceleration along the path that the block's limits leave at a speed, mm/s²: never 0.
fn tangential_acceleration(course: BlockGeometry<'_>, speed_mm_s: f32) -> f32 {
    let most = course.block.acceleration_mm_s2;
    match course.curve {
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
