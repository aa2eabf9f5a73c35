//! Segments where acceleration is continuous: along the blocks, at the pace of the reference's mean.

use super::MovingAverage;
use crate::{
    axis::Axes,
    math::{self, WHOLE_Q31},
    motion::{
        executor::{
            Executor, FIRST_SEGMENT_S, Goal, JERK_LIMITED_MIN_SECTION_S, LONGEST_SEGMENT_S,
            NOMINAL_SEGMENT_S, SHORTEST_SEGMENT_S,
        },
        lookahead::Plan,
        trapezoid::{SPEED_TOLERANCE, SegmentProfile, segment_share_s},
    },
    stepper::Segment,
    units::FineSteps,
};

/// What may be left of a block when the machine has come to rest at its end, mm.
const STANDSTILL_TOLERANCE_MM: f32 = 2.0e-4;

impl Executor {
    /// As [`Executor::next`], when [`Smooth`] needs no cell.
    #[inline(never)]
    pub(crate) fn next_jerk_limited<const N: usize>(
        &mut self,
        plan: &mut Plan<N>,
        smooth: &mut MovingAverage,
        position: &Axes<FineSteps>,
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        let goes_on = !smooth.is_at_standstill() || plan.reference().is_moving();
        let is_behind = goal == Goal::Run && plan.reference().has_left_oldest();
        let Some(block) = plan.current().filter(|_| goes_on || is_behind) else {
            smooth.reset();
            self.speed_mm_s = 0.0;
            self.average_moves = false;
            return false;
        };
        if !self.is_begun {
            self.begin(block.geometry(), position);
        }
        let left_mm = self.remaining as f32 * (block.length_mm / WHOLE_Q31 as f32);
        let (length_mm, ends_block) =
            self.section_length(block.geometry(), left_mm, JERK_LIMITED_MIN_SECTION_S);
        let stretch = if goes_on {
            let (stretch, way_mm) = averaged_profile(smooth, length_mm, self.speed_mm_s);
            smooth.advance(stretch.seconds, way_mm);
            stretch
        } else {
            // At rest at its end, but for what rounding left.
            SegmentProfile {
                length_mm,
                speed_mm_s: 0.0,
                seconds: NOMINAL_SEGMENT_S,
                ends_section: true,
            }
        };
        let ends_block = stretch.ends_section && ends_block;
        self.segment(block.geometry(), &stretch, ends_block, segment);
        self.laser = block.laser;
        self.speed_share = 0.5 * (self.speed_mm_s + stretch.speed_mm_s) / block.programmed_mm_s;
        self.speed_mm_s = stretch.speed_mm_s;
        self.may_exceed_plan &= stretch.speed_mm_s > block.nominal_mm_s * SPEED_TOLERANCE;
        self.average_moves = goes_on;
        if ends_block {
            plan.pop();
            self.is_begun = false;
        }
        true
    }
}

/// The next stretch of a piece, at a speed, and how far the mean goes in it.
fn averaged_profile(
    smooth: &MovingAverage,
    length_mm: f32,
    speed_mm_s: f32,
) -> (SegmentProfile, f32) {
    let outlook = smooth.forecast(speed_mm_s);
    let known_s = outlook.end.seconds;
    let mut seconds = if smooth.is_first_segment() {
        FIRST_SEGMENT_S
    } else {
        // If it stops just behind what is known, there is to be enough left for a segment.
        math::min(NOMINAL_SEGMENT_S, known_s - SHORTEST_SEGMENT_S)
    };
    let rest = outlook
        .standstill
        .filter(|rest| rest.way_mm + STANDSTILL_TOLERANCE_MM >= length_mm);
    if rest.is_some() || length_mm <= outlook.end.way_mm {
        let last = rest.unwrap_or_else(|| smooth.point_at(&outlook, length_mm));
        if last.seconds <= LONGEST_SEGMENT_S {
            let stretch = SegmentProfile {
                length_mm,
                speed_mm_s: last.speed_mm_s,
                seconds: last.seconds,
                ends_section: true,
            };
            return (stretch, last.way_mm);
        }
        seconds = math::min(seconds, segment_share_s(last.seconds));
    }
    let place = smooth.point_after(&outlook, seconds);
    let stretch = SegmentProfile {
        length_mm: math::min(place.way_mm, length_mm),
        speed_mm_s: place.speed_mm_s,
        seconds,
        ends_section: false,
    };
    (stretch, place.way_mm)
}

#[cfg(test)]
mod tests;
