//! The time that an arc in the place of a corner saves.
//!
//! Both paths are planned between the two ends of the arc. Outside, both have the same limits: the moves before the
//! corner bring the machine to some speed, known from them, and what comes after lets it leave the move after the corner
//! at some speed, which nothing tells yet: anything from 0. Along the arc the acceleration is that of the look-ahead,
//! √(a² - (v²/radius)²), so that the squared speed is a·radius·sin z with an angle z in proportion to the path. The same
//! holds on a programmed arc beside the corner. Only what the exact path gains from the corner on counts with the whole
//! acceleration.
//!
//! Where the arc begins or ends more slowly than the exact path is at the same place, the machine has to brake earlier, or
//! has to accelerate later. The change between both speeds costs its time, less the time of the same distance at full
//! speed where it goes on to full speed within the move: behind that place, both motions are alike. On a programmed arc
//! the time is the integral of 1/v over its part of the path, of which the trapezoid is no less.
//! An arc is in the place of a corner only if both times together are no longer than the time on the trimmed moves,
//! whatever comes after: [`ArcProfile::is_no_slower`]. So no plan is slower with rounded corners, whatever the other corners
//! are.

use super::pending::{PendingMove, Reach};
use crate::{
    axis::{Axes, LINEAR},
    math,
    path::{
        programmed_speed::programmed_mm_s,
        router::{Limits, to_axes},
    },
};
use core::f32::consts::FRAC_PI_2;

/// The speed at the far end of a move beside a corner is anything from none to no limit where it is not known: so many
/// are tried.
const END_SPEEDS: u32 = 3;
/// Stretches of a trimmed move, and twice as many of an arc, for which a speed each is computed.
const SPEED_SAMPLES: u32 = 4;
/// Part of a speed that counts as all of it.
const WHOLE_SPEED: f32 = 0.999;

/// A move beside a corner.
///
/// Its *measure* of a speed changes in proportion to the path: v² on a line, the angle z on an arc.
pub(super) struct CornerSide {
    /// Direction at the corner.
    pub(super) direction: Axes<f32>,
    pub(super) speed_mm_s: f32,
    pub(super) acceleration_mm_s2: f32,
    /// Squared speed at which the acceleration of an arc is towards its centre, (mm/s)²; `None` for a line.
    limit_sqr: Option<f32>,
    measure_per_mm: f32,
    /// Measure at the corner for the move alone: that from which it leads to its other end, or the other way round.
    corner: f32,
    /// The speed at the other end is known. Otherwise `corner` is the least one.
    is_known: bool,
}

impl CornerSide {
    /// A move with a speed at its other end, if known, and the length between both ends.
    pub(super) fn new(
        limits: &Limits,
        (held_back, direction): (&PendingMove, [f32; LINEAR]),
        end: Reach,
        length_mm: f32,
    ) -> Self {
        let direction = to_axes(&direction);
        let mut side = if let Some(arc) = &held_back.arc {
            let (first, second, _) = arc.plane.axes();
            let shares = limits.plane_shares([first, second]);
            let acceleration_mm_s2 = limits.acceleration_along(&shares);
            let limit_sqr = acceleration_mm_s2 * arc.radius_mm;
            let limit_mm_s = math::min(limits.arc_mm_s(&shares), math::sqrt(limit_sqr));
            let programmed_mm_s = programmed_mm_s(held_back.feed_rate, 0.0, limit_mm_s);
            Self {
                direction,
                speed_mm_s: math::min(programmed_mm_s, limit_mm_s),
                acceleration_mm_s2,
                limit_sqr: Some(limit_sqr),
                measure_per_mm: 2.0 / arc.radius_mm,
                corner: 0.0,
                is_known: end.is_known,
            }
        } else {
            let acceleration_mm_s2 = limits.line_acceleration_mm_s2(&direction);
            Self {
                direction,
                speed_mm_s: limits.line_mm_s(held_back.feed_rate, &direction),
                acceleration_mm_s2,
                limit_sqr: None,
                measure_per_mm: 2.0 * acceleration_mm_s2,
                corner: 0.0,
                is_known: end.is_known,
            }
        };
        side.corner = side.measure(end.sqr) + side.measure_per_mm * length_mm;
        side
    }

    /// Returns the speed at the corner that the move before it leads to.
    pub(super) fn reach(&self) -> Reach {
        Reach {
            sqr: self.sqr(self.corner),
            is_known: self.is_known,
        }
    }

    fn measure(&self, sqr: f32) -> f32 {
        self.limit_sqr
            .map_or(sqr, |limit_sqr| angle_of(sqr, limit_sqr))
    }

    fn sqr(&self, measure: f32) -> f32 {
        self.limit_sqr
            .map_or(measure, |limit_sqr| sqr_of(measure, limit_sqr))
    }

    /// Returns the change of the squared speed over a distance with the whole acceleration, (mm/s)².
    fn change_sqr(&self, mm: f32) -> f32 {
        2.0 * self.acceleration_mm_s2 * mm
    }

    /// Returns the squared speed at a distance from the corner for the move alone, with a measure at the corner, (mm/s)².
    fn sqr_at(&self, mm: f32, corner: f32) -> f32 {
        self.sqr(corner - self.measure_per_mm * mm)
    }

    /// Returns the speed on the exact path at a distance from the corner, mm/s, with its squared speed at the corner, and
    /// with the measure there for the move alone.
    fn exact_mm_s(&self, mm: f32, exact_sqr: f32, corner: f32) -> f32 {
        let sqr = math::min(exact_sqr + self.change_sqr(mm), self.sqr_at(mm, corner));
        math::min(
            self.speed_mm_s,
            math::sqrt(math::max(sqr, f32::MIN_POSITIVE)),
        )
    }

    /// Returns the time that a change between two speeds costs at most, s, as against the faster speed all along;
    /// `f32::MAX` on an arc that may be too short.
    ///
    /// If the change goes on to the full speed V within the rest of the move, both motions are alike behind it. Then the
    /// change to the faster speed, over a distance d in a time t, costs t - d/V; otherwise t.
    fn ramp_s(&self, slower_mm_s: f32, faster_mm_s: f32, rest_mm: f32) -> f32 {
        if faster_mm_s <= slower_mm_s {
            return 0.0;
        }
        let from = self.measure(slower_mm_s * slower_mm_s);
        let to = self.measure(faster_mm_s * faster_mm_s);
        let distance_mm = math::max(to - from, 0.0) / self.measure_per_mm;
        let whole_mm_s = WHOLE_SPEED * self.speed_mm_s;
        let is_whole = self.sqr(from + self.measure_per_mm * rest_mm) >= whole_mm_s * whole_mm_s;
        let per_speed = if self.limit_sqr.is_none() {
            2.0 / (slower_mm_s + faster_mm_s)
        } else if is_whole {
            0.5 * (1.0 / slower_mm_s + 1.0 / faster_mm_s)
        } else {
            return f32::MAX;
        };
        let saved_per_speed = if is_whole { 1.0 / self.speed_mm_s } else { 0.0 };
        distance_mm * (per_speed - saved_per_speed)
    }
}

/// An arc of a corner, and what it has to keep to.
pub(super) struct ArcProfile {
    pub(super) length_mm: f32,
    /// What the arc trims of each move, mm.
    pub(super) trimmed_mm: [f32; 2],
    /// Rest of each move, mm: see [`CornerSide::ramp_s`].
    pub(super) rests_mm: [f32; 2],
    /// Squared speed at which the acceleration towards the centre is the greatest, (mm/s)².
    pub(super) limit_sqr: f32,
    /// Change of z per mm.
    pub(super) angle_per_mm: f32,
    /// Limit of the squared speed, (mm/s)².
    pub(super) top_sqr: f32,
}

impl ArcProfile {
    /// Returns true if the arc takes no longer than the exact corner, whatever the speeds at the far ends of the moves are
    /// as far as they are not known.
    pub(super) fn is_no_slower(&self, sides: &[CornerSide; 2], junction_sqr: f32) -> bool {
        for entry in 0..END_SPEEDS {
            let before = self.measure_at_corner(sides, 0, junction_sqr, entry);
            if entry > 0 && (sides[0].is_known || before <= sides[0].corner) {
                break;
            }
            for exit in 0..END_SPEEDS {
                let after = self.measure_at_corner(sides, 1, junction_sqr, exit);
                if exit > 0 && after <= sides[1].corner {
                    break;
                }
                let saved_s = self.saved_s(sides, junction_sqr, [before, after]);
                if saved_s < 0.0 {
                    return false;
                }
            }
        }
        true
    }

    /// Returns a measure that is possible at the corner for a move alone: of several, from the least to no limit.
    fn measure_at_corner(
        &self,
        sides: &[CornerSide; 2],
        number: usize,
        junction_sqr: f32,
        speed: u32,
    ) -> f32 {
        let (side, trimmed_mm) = (&sides[number], self.trimmed_mm[number]);
        let change_sqr = side.change_sqr(trimmed_mm);
        let most_sqr = math::max(junction_sqr + change_sqr, self.top_sqr);
        let most = side.measure_per_mm * trimmed_mm + side.measure(most_sqr);
        let part = speed as f32 * (1.0 / (END_SPEEDS - 1) as f32);
        side.corner + part * math::max(most - side.corner, 0.0)
    }

    /// Returns the time that the arc saves at least, s, with the measures at the corner for each move alone.
    ///
    /// The inverse of a speed is a convex function of the place: the trapezoidal rule makes the time of the arc longer,
    /// and the rule of midpoints that of the exact path shorter.
    fn saved_s(&self, sides: &[CornerSide; 2], junction_sqr: f32, corner: [f32; 2]) -> f32 {
        let angle_at = |end: usize| {
            angle_of(
                sides[end].sqr_at(self.trimmed_mm[end], corner[end]),
                self.limit_sqr,
            )
        };
        let angles = [angle_at(0), angle_at(1)];
        let speed = |part: f32| {
            let [passed_mm, left_mm] = [part, 1.0 - part].map(|part| part * self.length_mm);
            let forward = angles[0] + self.angle_per_mm * passed_mm;
            let backward = angles[1] + self.angle_per_mm * left_mm;
            let sqr = sqr_of(math::min(forward, backward), self.limit_sqr);
            math::sqrt(math::min(self.top_sqr, sqr))
        };
        let ends = [speed(0.0), speed(1.0)];
        let mut per_speed = 0.5 * (1.0 / ends[0] + 1.0 / ends[1]);
        for number in 1..2 * SPEED_SAMPLES {
            per_speed += 1.0 / speed(number as f32 * (0.5 / SPEED_SAMPLES as f32));
        }
        let mut saved_s = -per_speed * self.length_mm * (0.5 / SPEED_SAMPLES as f32);
        let reached_sqr = math::min(sides[0].sqr(corner[0]), sides[1].sqr(corner[1]));
        let exact_sqr = math::min(junction_sqr, reached_sqr);
        for (number, side) in sides.iter().enumerate() {
            let trimmed_mm = self.trimmed_mm[number];
            let stretch_mm = trimmed_mm * (1.0 / SPEED_SAMPLES as f32);
            let exact = |mm: f32| side.exact_mm_s(mm, exact_sqr, corner[number]);
            for stretch in 0..SPEED_SAMPLES {
                saved_s += stretch_mm / exact((stretch as f32 + 0.5) * stretch_mm);
            }
            saved_s -= side.ramp_s(ends[number], exact(trimmed_mm), self.rests_mm[number]);
        }
        saved_s
    }

    /// Returns the speed to which the move before the arc leads at its end.
    pub(super) fn reach(&self, before: &CornerSide) -> Reach {
        let sqr = before.sqr_at(self.trimmed_mm[0], before.corner);
        let start = angle_of(sqr, self.limit_sqr);
        let end = Reach {
            sqr: sqr_of(start + self.angle_per_mm * self.length_mm, self.limit_sqr),
            is_known: before.is_known,
        };
        end.up_to(self.top_sqr)
    }
}

/// Returns the angle z of a squared speed, rad.
fn angle_of(sqr: f32, limit_sqr: f32) -> f32 {
    math::asin(math::min(
        math::max(sqr, f32::MIN_POSITIVE) / limit_sqr,
        1.0,
    ))
}

/// Returns the squared speed of an angle z, (mm/s)².
fn sqr_of(angle: f32, limit_sqr: f32) -> f32 {
    let sqr = limit_sqr * math::sin(math::min(angle, FRAC_PI_2));
    math::max(sqr, f32::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_of_speed_on_a_line_costs_less_only_if_it_goes_on_to_full_speed() {
        let line = CornerSide {
            direction: Axes::all(0.0),
            speed_mm_s: 60.0,
            acceleration_mm_s2: 500.0,
            limit_sqr: None,
            measure_per_mm: 1000.0,
            corner: 0.0,
            is_known: false,
        };
        // From 10 mm/s: 30 mm/s after 0.8 mm and 40 ms, 60 mm/s after 3.5 mm.
        for (rest_mm, seconds) in [(3.4, 0.04), (3.6, 0.04 - 0.8 / 60.0)] {
            let counted = line.ramp_s(10.0, 30.0, rest_mm);
            assert!((counted - seconds).abs() < 1.0e-5, "{counted} {seconds}");
        }
    }

    #[test]
    fn a_change_of_speed_on_an_arc_costs_the_time_that_it_takes_at_least() {
        let (radius_mm, acceleration_mm_s2) = (10.0_f32, 500.0);
        let limit_sqr = acceleration_mm_s2 * radius_mm;
        let arc = CornerSide {
            direction: Axes::all(0.0),
            speed_mm_s: 60.0,
            acceleration_mm_s2,
            limit_sqr: Some(limit_sqr),
            measure_per_mm: 2.0 / radius_mm,
            corner: 0.0,
            is_known: false,
        };
        for (slower, faster) in [(10.0_f32, 60.0_f32), (30.0, 50.0), (50.0, 60.0)] {
            let (mut seconds, mut distance_mm) = (0.0, 0.0);
            let change = 0.001 * (faster - slower);
            for part in 0..1000_u16 {
                let speed = slower + (f32::from(part) + 0.5) * change;
                let centripetal = speed * speed / radius_mm;
                let along = acceleration_mm_s2.powi(2) - centripetal.powi(2);
                seconds += change / along.sqrt();
                distance_mm += speed * change / along.sqrt();
            }
            let counted = arc.ramp_s(slower, faster, 100.0);
            let at_full_speed = distance_mm / arc.speed_mm_s;
            let most = seconds * 0.5 * (1.0 + faster / slower) - at_full_speed;
            assert!(
                counted >= 0.999 * (seconds - at_full_speed) && counted <= most,
                "{counted} {seconds}"
            );
        }
        assert!(arc.ramp_s(10.0, 60.0, 1.0) > 1.0e6);
    }
}
