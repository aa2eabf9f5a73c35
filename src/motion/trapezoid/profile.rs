//! How fast a piece is gone through: the next stretch of it, a segment's way and the speed at its end.

use super::Course;
use crate::{
    math,
    motion::executor::{Executor, LONGEST_S, Piece, SEGMENT_S, SHORTEST_S, START_S},
};

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
pub(in crate::motion) const WITHIN: f32 = 1.0001;

/// A segment's way along the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::motion) struct Stretch {
    /// Length, mm.
    pub(in crate::motion) length_mm: f32,
    /// Speed at its end, mm/s.
    pub(in crate::motion) speed_mm_s: f32,
    /// Duration, s.
    pub(in crate::motion) seconds: f32,
    /// Whether it ends its piece.
    pub(in crate::motion) ends_piece: bool,
}

impl Executor {
    /// A stretch towards the greatest speed at the piece's end.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `follow`")]
    pub(in crate::motion) fn run(&mut self, course: Course<'_>, piece: &Piece) -> Stretch {
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
            self.is_over = speed > block.nominal_mm_s * WITHIN || is_too_near;
        }
        let end_speed = math::sqrt(course.speed_sqr(end));
        let end_speed = math::min(end_speed, math::max(block.nominal_mm_s, speed));
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
        let top = math::min(speed + gain, block.nominal_mm_s);
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
        let most = math::max(block.nominal_mm_s, speed);
        let is_far = 2.0 * piece.length_mm >= FAR_S * (speed + most);
        if self.is_over || speed <= 0.0 || !is_far {
            return None;
        }
        let gain = block.acceleration_mm_s2 * SEGMENT_S;
        let top = math::min(speed + gain, block.nominal_mm_s);
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
    pub(in crate::motion) fn stop(&self, course: Course<'_>, piece: &Piece) -> Stretch {
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
}

/// The part of a time that fits a segment: never leaves a sliver for the next.
pub(in crate::motion) fn share(seconds: f32) -> f32 {
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
