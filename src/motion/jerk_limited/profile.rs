//! Segments where acceleration is continuous: along the blocks, at the pace of the reference's mean.

use super::Smooth;
use crate::{
    axis::Axes,
    math::{self, WHOLE_Q31},
    motion::{
        executor::{Executor, Goal, LONGEST_S, SEGMENT_S, SHORTEST_S, SMOOTH_SLIVER_S, START_S},
        lookahead::Plan,
        trapezoid::{Stretch, WITHIN, share},
    },
    stepper::Segment,
    units::FineSteps,
};

/// What may be left of a block when the machine has come to rest at its end, mm.
const NOTHING_MM: f32 = 2.0e-4;

impl Executor {
    /// As [`Executor::next`], when [`Smooth`] needs no cell.
    #[inline(never)]
    pub(crate) fn next_smooth<const N: usize>(
        &mut self,
        plan: &mut Plan<N>,
        smooth: &mut Smooth,
        position: &Axes<FineSteps>,
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        let goes_on = !smooth.is_at_rest() || plan.pacer().is_moving();
        let is_behind = goal == Goal::Run && plan.pacer().has_left_first();
        let Some(block) = plan.current().filter(|_| goes_on || is_behind) else {
            smooth.rest();
            self.speed_mm_s = 0.0;
            self.goes_on = false;
            return false;
        };
        if !self.is_begun {
            self.begin(block.course(), position);
        }
        let left_mm = self.left as f32 * (block.length_mm / WHOLE_Q31 as f32);
        let (length_mm, ends_block) = self.piece_length(block.course(), left_mm, SMOOTH_SLIVER_S);
        let stretch = if goes_on {
            let (stretch, way_mm) = walk(smooth, length_mm, self.speed_mm_s);
            smooth.play(stretch.seconds, way_mm);
            stretch
        } else {
            // At rest at its end, but for what rounding left.
            Stretch {
                length_mm,
                speed_mm_s: 0.0,
                seconds: SEGMENT_S,
                ends_piece: true,
            }
        };
        let ends_block = stretch.ends_piece && ends_block;
        self.segment(block.course(), &stretch, ends_block, segment);
        self.laser = block.laser;
        self.part = 0.5 * (self.speed_mm_s + stretch.speed_mm_s) / block.programmed_mm_s;
        self.speed_mm_s = stretch.speed_mm_s;
        self.is_over &= stretch.speed_mm_s > block.nominal_mm_s * WITHIN;
        self.goes_on = goes_on;
        if ends_block {
            plan.pop();
            self.is_begun = false;
        }
        true
    }
}

/// The next stretch of a piece, at a speed, and how far the mean goes in it.
fn walk(smooth: &Smooth, length_mm: f32, speed_mm_s: f32) -> (Stretch, f32) {
    let outlook = smooth.outlook(speed_mm_s);
    let known_s = outlook.end.seconds;
    let mut seconds = if smooth.begins() {
        START_S
    } else {
        // If it stops just behind what is known, there is to be enough left for a segment.
        math::min(SEGMENT_S, known_s - SHORTEST_S)
    };
    let rest = outlook
        .rest
        .filter(|rest| rest.way_mm + NOTHING_MM >= length_mm);
    if rest.is_some() || length_mm <= outlook.end.way_mm {
        let last = rest.unwrap_or_else(|| smooth.at(&outlook, length_mm));
        if last.seconds <= LONGEST_S {
            let stretch = Stretch {
                length_mm,
                speed_mm_s: last.speed_mm_s,
                seconds: last.seconds,
                ends_piece: true,
            };
            return (stretch, last.way_mm);
        }
        seconds = math::min(seconds, share(last.seconds));
    }
    let place = smooth.after(&outlook, seconds);
    let stretch = Stretch {
        length_mm: math::min(place.way_mm, length_mm),
        speed_mm_s: place.speed_mm_s,
        seconds,
        ends_piece: false,
    };
    (stretch, place.way_mm)
}

#[cfg(test)]
mod tests;
