//! The jerk-limited profile: segments along the blocks, at the speed of the reference's mean.

use super::{MovingAverage, ReferenceMotion};
use crate::{
    axis::Axes,
    math::{self, WHOLE_Q31},
    motion::{
        executor::{Executor, Goal, NextSegment, SegmentProfile},
        limits::{
            FIRST_SEGMENT_S, JERK_LIMITED_MIN_SECTION_S, LONGEST_SEGMENT_S, NOMINAL_SEGMENT_S,
            SHORTEST_SEGMENT_S, SPEED_TOLERANCE, segment_share_s,
        },
        queue::BlockQueue,
    },
    stepper::Segment,
    units::FineSteps,
};

/// Most of a block that rounding leaves when the machine comes to a standstill at its end, mm.
const STANDSTILL_TOLERANCE_MM: f32 = 2.0e-4;

impl Executor {
    /// As [`Executor::next_trapezoid`]; the moving average must need no sample.
    #[inline(never)]
    pub(in crate::motion) fn next_jerk_limited(
        &mut self,
        queue: &BlockQueue,
        reference: &ReferenceMotion,
        average: &mut MovingAverage,
        position: &Axes<FineSteps>,
        goal: Goal,
        segment: &mut Segment,
    ) -> NextSegment {
        let moves = !average.is_at_standstill() || reference.is_moving();
        let is_lagging = goal == Goal::Run && reference.has_left_oldest();
        let Some(block) = queue.current().filter(|_| moves || is_lagging) else {
            average.reset();
            self.speed_mm_s = 0.0;
            self.average_moves = false;
            return NextSegment::Standstill;
        };
        if !self.is_begun {
            self.begin(block.geometry(), position);
        }
        let remaining_mm = self.remaining as f32 * (block.length_mm / WHOLE_Q31 as f32);
        let (length_mm, ends_block) =
            self.section_length(block.geometry(), remaining_mm, JERK_LIMITED_MIN_SECTION_S);
        let profile = if moves {
            let (profile, distance_mm) = averaged_profile(average, length_mm, self.speed_mm_s);
            average.advance(profile.seconds, distance_mm);
            profile
        } else {
            // At a standstill at its end: the remainder is rounding.
            SegmentProfile {
                length_mm,
                speed_mm_s: 0.0,
                seconds: NOMINAL_SEGMENT_S,
                ends_section: true,
            }
        };
        let ends_block = profile.ends_section && ends_block;
        self.segment(block.geometry(), &profile, ends_block, segment);
        self.laser = block.laser;
        self.speed_share = 0.5 * (self.speed_mm_s + profile.speed_mm_s) / block.programmed_mm_s;
        self.speed_mm_s = profile.speed_mm_s;
        self.may_exceed_plan &= profile.speed_mm_s > block.nominal_mm_s * SPEED_TOLERANCE;
        self.average_moves = moves;
        if ends_block {
            self.is_begun = false;
            NextSegment::EndsBlock
        } else {
            NextSegment::WithinBlock
        }
    }
}

/// Returns the next segment of a section of which `length_mm` are left, and how far the mean goes in it.
fn averaged_profile(
    average: &MovingAverage,
    length_mm: f32,
    speed_mm_s: f32,
) -> (SegmentProfile, f32) {
    let forecast = average.forecast(speed_mm_s);
    let known_s = forecast.end.seconds;
    let mut seconds = if average.is_first_segment() {
        FIRST_SEGMENT_S
    } else {
        // If the mean stops just behind the forecast, enough is left for a segment.
        math::min(NOMINAL_SEGMENT_S, known_s - SHORTEST_SEGMENT_S)
    };
    let standstill = forecast
        .standstill
        .filter(|standstill| standstill.distance_mm + STANDSTILL_TOLERANCE_MM >= length_mm);
    if standstill.is_some() || length_mm <= forecast.end.distance_mm {
        let last = standstill.unwrap_or_else(|| average.point_at(&forecast, length_mm));
        if last.seconds <= LONGEST_SEGMENT_S {
            let profile = SegmentProfile {
                length_mm,
                speed_mm_s: last.speed_mm_s,
                seconds: last.seconds,
                ends_section: true,
            };
            return (profile, last.distance_mm);
        }
        seconds = math::min(seconds, segment_share_s(last.seconds));
    }
    let point = average.point_after(&forecast, seconds);
    let profile = SegmentProfile {
        length_mm: math::min(point.distance_mm, length_mm),
        speed_mm_s: point.speed_mm_s,
        seconds,
        ends_section: false,
    };
    (profile, point.distance_mm)
}

#[cfg(test)]
mod tests;
