//! The arc in the place of a corner.
//!
//! ```text
//!        corner            with the deflection angle θ:
//!   before ╱╲ after      trimmed = radius·tan(θ/2)
//!         ╱⌒⌒╲           deviation = radius·(1/cos(θ/2) - 1)
//!        ╱    ╲
//! ```
//!
//! The arc touches both lines, so that only its radius limits the speed: v² = a·radius. The deviation,
//! from the corner to the middle of the arc, is the greatest distance between the two paths, in either
//! direction. At most half of each line is trimmed, whatever is trimmed at its other end.
//!
//! # When an arc is faster
//!
//! Both paths are planned between the two ends of the arc. Outside, both have the same limits: the lines before the
//! corner bring the machine to some speed, known from them, and what comes after lets it leave the line after the corner
//! at some speed, which nothing tells yet: anything from 0. Along the arc the acceleration is that of the look-ahead,
//! √(a² - (v²/radius)²), so that the squared speed is a·radius·sin z with an angle z in proportion to the path.
//!
//! Where the arc begins or ends more slowly than the exact path is at the same place, the machine has to brake earlier, or
//! has to accelerate later: that takes the difference of the speeds divided by the acceleration at most. An arc is in the
//! place of a corner only if both times together are no longer than the time on the trimmed lines, whatever comes after:
//! [`ArcProfile::is_no_slower`]. So without limits of jerk no plan is slower with rounded corners, whatever the other
//! corners are. A line before which nothing is held back counts as begun from a standstill, also where it is not.

use super::{CornerArc, PendingLine, linear_mm};
use crate::{
    axis::{Axes, LINEAR},
    math,
    model::FeedRate,
    path::router::{Limits, to_axes},
    units::Nm,
};
use core::f32::consts::FRAC_PI_2;

/// Greatest rounding error of a trimmed line, nm: a shorter line is none.
pub(super) const ROUNDING_NM: i64 = 50;
/// Least cos²(θ/2), a deflection of 176°, for an arc: beyond, its radius is below a thirtieth of what is
/// trimmed.
const MIN_COSINE_SQR: f32 = 1.0e-3;
/// Most steps of a radius: the points of a [`SpatialArc`](crate::path::SpatialArc) of 30 binary places have
/// an error of 2⁻⁹ steps then.
const MAX_RADIUS_STEPS: f32 = 2_000_000.0;
/// Shortest time for the rest of a line between two arcs, s: the mean of segments.
const SHORTEST_REST_S: f32 = 0.7e-3;
/// Part of the tolerance that is used: the remainder is for rounding in single precision.
const TOLERANCE_PART: f32 = 0.9999;
/// The next moves may allow any speed at the end of the line after a corner, from none to no limit: so many are tried.
const EXIT_SPEEDS: u32 = 3;
/// Factor on the time for a change of speed with a limit of jerk. The acceleration has to change, too, for which no time
/// is known here: then an arc hardly begins or ends more slowly than the exact path, and counts as passed at one speed.
const JERK_LIMITED_PENALTY: f32 = 1.0e3;
/// Stretches of a trimmed line, and twice as many of an arc, for which a speed each is computed.
const SPEED_SAMPLES: u32 = 4;

/// The corner of two lines.
pub(super) struct Corner<'a> {
    before: &'a PendingLine,
    after: &'a PendingLine,
    sides: [CornerSide; 2],
    /// Limits of the squared speed, (mm/s)²: that of the lines, and that of the exact corner.
    wanted_sqr: f32,
    junction_sqr: f32,
}

/// A rounded corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct RoundedCorner {
    /// End of the line before, start of the arc.
    pub(super) start: Axes<Nm>,
    pub(super) arc: CornerArc,
    /// Greatest distance from the programmed path, mm, that of the lines included.
    pub(super) deviation_mm: f32,
    /// Squared speed that can be reached at the end of the arc, (mm/s)².
    pub(super) reached_sqr: f32,
}

impl<'a> Corner<'a> {
    pub(super) fn new(limits: &Limits, before: &'a PendingLine, after: &'a PendingLine) -> Self {
        let sides = [
            CornerSide::new(limits, before, before.reached_sqr, before.left_mm()),
            CornerSide::new(limits, after, 0.0, after.length_mm),
        ];
        let wanted_mm_s = math::min(sides[0].speed_mm_s, sides[1].speed_mm_s);
        Self {
            before,
            after,
            wanted_sqr: wanted_mm_s * wanted_mm_s,
            junction_sqr: limits.junction_sqr(&sides[0].direction, &sides[1].direction),
            sides,
        }
    }

    /// Returns the squared speed that can be reached at the exact corner, (mm/s)².
    pub(super) fn reached_sqr(&self) -> f32 {
        math::min(
            math::min(self.junction_sqr, self.wanted_sqr),
            self.sides[0].corner_sqr,
        )
    }

    /// Returns the corner with an arc within a tolerance of the programmed path; `None` where that might be slower than
    /// the exact corner.
    pub(super) fn rounded(&self, limits: &Limits, tolerance_mm: f32) -> Option<RoundedCorner> {
        let (before, after) = (self.before, self.after);
        let [from, to] = [&self.sides[0].direction, &self.sides[1].direction];
        if self.wanted_sqr <= self.junction_sqr || limits.reverses_backlash(from, to) {
            return None;
        }
        let angle = Deflection::between(&before.direction, &after.direction)?;
        let shares = limits.arc_shares(to_axes(&angle.radial), to_axes(&angle.tangent));
        let acceleration = limits.acceleration_along(&shares);
        let error_mm = math::max(before.error_mm, after.error_mm);
        let allowed_mm = TOLERANCE_PART * (tolerance_mm - error_mm);
        let half_mm = 0.5 * math::min(before.length_mm, after.length_mm);
        let radius_mm = math::min(
            math::min(allowed_mm / angle.excess(), half_mm / angle.half_tangent()),
            math::min(
                self.wanted_sqr / acceleration,
                limits.radius_mm(MAX_RADIUS_STEPS),
            ),
        );
        let radius_mm = before.fitted_mm(radius_mm, angle.half_tangent(), &self.sides[0])?;
        let length_mm = radius_mm * angle.radians();
        let has_slack =
            before.left_mm() - half_mm >= Limits::FULL_SLACK_LINE_S * self.sides[0].speed_mm_s;
        let reversals = (0..LINEAR).filter(|axis| from[*axis] * to[*axis] < 0.0);
        let shortest_s = Limits::shortest_corner_arc_s(reversals.count(), has_slack);
        let axes_mm_s = math::min(limits.arc_mm_s(&shares), length_mm / shortest_s);
        let (angle_per_mm, penalty) = if limits.is_jerk_limited() {
            (0.0, JERK_LIMITED_PENALTY)
        } else {
            (2.0 / radius_mm, 1.0)
        };
        let arc = ArcProfile {
            length_mm,
            trimmed_mm: radius_mm * angle.half_tangent(),
            limit_sqr: acceleration * radius_mm,
            angle_per_mm,
            penalty,
            top_sqr: math::min(
                math::min(self.wanted_sqr, axes_mm_s * axes_mm_s),
                limits.corner_arc_sqr(&shares, radius_mm, acceleration),
            ),
        };
        if arc.top_sqr <= self.junction_sqr || !arc.is_no_slower(&self.sides, self.junction_sqr) {
            return None;
        }
        let corner = before.target.position;
        Some(RoundedCorner {
            start: moved(corner, &before.direction, -arc.trimmed_mm),
            arc: CornerArc {
                target: moved(corner, &after.direction, arc.trimmed_mm),
                radius_mm,
                sweep_rad: angle.radians(),
                radial: angle.radial_at_start(),
                tangent: before.direction,
                feed_rate: slower(before.feed_rate, after.feed_rate),
                line: after.line,
            },
            deviation_mm: radius_mm * angle.excess() + error_mm,
            reached_sqr: arc.reached_sqr(&self.sides[0]),
        })
    }
}

impl PendingLine {
    /// Returns what the corner at its start has left of the line, mm.
    fn left_mm(&self) -> f32 {
        let left = linear_mm(&self.start, &self.target.position);
        math::sqrt(math::dot(&left, &left))
    }

    /// Returns the radius, or a smaller one of which the rest of the line is no short segment, mm; `None` without a rest.
    fn fitted_mm(&self, radius_mm: f32, half_tangent: f32, side: &CornerSide) -> Option<f32> {
        let left_mm = self.left_mm();
        let least_mm = SHORTEST_REST_S * side.speed_mm_s;
        let rest_mm = left_mm - radius_mm * half_tangent;
        let fitted_mm = if rest_mm >= least_mm || rest_mm <= 1.0e-6 * ROUNDING_NM as f32 {
            radius_mm
        } else {
            (left_mm - least_mm) / half_tangent
        };
        (fitted_mm > 0.0).then_some(fitted_mm)
    }
}

/// A line beside a corner.
struct CornerSide {
    direction: Axes<f32>,
    speed_mm_s: f32,
    acceleration_mm_s2: f32,
    /// Squared speed at the corner for the line alone, (mm/s)²: that from which it leads to its other end, or the other
    /// way round.
    corner_sqr: f32,
}

impl CornerSide {
    fn new(limits: &Limits, line: &PendingLine, end_sqr: f32, length_mm: f32) -> Self {
        let direction = to_axes(&line.direction);
        let acceleration_mm_s2 = limits.line_acceleration_mm_s2(&direction);
        Self {
            direction,
            speed_mm_s: limits.line_mm_s(line.feed_rate, &direction),
            acceleration_mm_s2,
            corner_sqr: end_sqr + 2.0 * acceleration_mm_s2 * length_mm,
        }
    }

    /// Returns the change of the squared speed over a distance, (mm/s)².
    fn change_sqr(&self, mm: f32) -> f32 {
        2.0 * self.acceleration_mm_s2 * mm
    }

    /// Returns the speed on the exact path at a distance from the corner, mm/s, with squared speeds at the corner: of
    /// the exact path, and for the line alone.
    fn exact_mm_s(&self, mm: f32, exact_sqr: f32, corner_sqr: f32) -> f32 {
        let change = self.change_sqr(mm);
        let sqr = math::min(exact_sqr + change, corner_sqr - change);
        math::min(
            self.speed_mm_s,
            math::sqrt(math::max(sqr, f32::MIN_POSITIVE)),
        )
    }
}

/// An arc of a corner, and what it has to keep to.
struct ArcProfile {
    length_mm: f32,
    /// What the arc trims of each line, mm.
    trimmed_mm: f32,
    /// Squared speed at which the acceleration towards the centre is the greatest, (mm/s)².
    limit_sqr: f32,
    /// Change of z per mm.
    angle_per_mm: f32,
    /// Limit of the squared speed, (mm/s)².
    top_sqr: f32,
    /// Factor on the time for a change of speed outside the arc.
    penalty: f32,
}

impl ArcProfile {
    /// Returns true if the arc takes no longer than the exact corner, whatever the speed is at which the line after it may
    /// be left.
    fn is_no_slower(&self, sides: &[CornerSide; 2], junction_sqr: f32) -> bool {
        let [before, after] = [&sides[0], &sides[1]];
        let change_sqr = after.change_sqr(self.trimmed_mm);
        let least_sqr = after.corner_sqr;
        let most_sqr = change_sqr + math::max(junction_sqr + change_sqr, self.top_sqr);
        for number in 0..EXIT_SPEEDS {
            let part = number as f32 * (1.0 / (EXIT_SPEEDS - 1) as f32);
            let corner_sqr = least_sqr + part * math::max(most_sqr - least_sqr, 0.0);
            let saved_s = self.saved_s(sides, junction_sqr, [before.corner_sqr, corner_sqr]);
            if saved_s < 0.0 {
                return false;
            }
            if least_sqr >= most_sqr {
                break;
            }
        }
        true
    }

    /// Returns the time that the arc saves at least, s, with the squared speeds at the corner for each line alone.
    ///
    /// The inverse of a speed is a convex function of the place: the trapezoidal rule makes the time of the arc longer,
    /// and the rule of midpoints that of the exact path shorter.
    fn saved_s(&self, sides: &[CornerSide; 2], junction_sqr: f32, corner_sqr: [f32; 2]) -> f32 {
        let angle_at =
            |end: usize| self.angle_of(corner_sqr[end] - sides[end].change_sqr(self.trimmed_mm));
        let angles = [angle_at(0), angle_at(1)];
        let speed = |part: f32| {
            let [passed_mm, left_mm] = [part, 1.0 - part].map(|part| part * self.length_mm);
            let forward = angles[0] + self.angle_per_mm * passed_mm;
            let backward = angles[1] + self.angle_per_mm * left_mm;
            math::sqrt(math::min(
                self.top_sqr,
                self.sqr_at(math::min(forward, backward)),
            ))
        };
        let ends = [speed(0.0), speed(1.0)];
        let mut per_speed = 0.5 * (1.0 / ends[0] + 1.0 / ends[1]);
        for number in 1..2 * SPEED_SAMPLES {
            per_speed += 1.0 / speed(number as f32 * (0.5 / SPEED_SAMPLES as f32));
        }
        let mut saved_s = -per_speed * self.length_mm * (0.5 / SPEED_SAMPLES as f32);
        let exact_sqr = math::min(junction_sqr, math::min(corner_sqr[0], corner_sqr[1]));
        let stretch_mm = self.trimmed_mm * (1.0 / SPEED_SAMPLES as f32);
        for ((side, corner_sqr), end_mm_s) in sides.iter().zip(corner_sqr).zip(ends) {
            let exact = |mm: f32| side.exact_mm_s(mm, exact_sqr, corner_sqr);
            for number in 0..SPEED_SAMPLES {
                saved_s += stretch_mm / exact((number as f32 + 0.5) * stretch_mm);
            }
            let slower_mm_s = math::max(exact(self.trimmed_mm) - end_mm_s, 0.0);
            saved_s -= self.penalty * slower_mm_s / side.acceleration_mm_s2;
        }
        saved_s
    }

    /// Returns the squared speed to which the line before the arc leads at its end, (mm/s)².
    fn reached_sqr(&self, before: &CornerSide) -> f32 {
        let start = self.angle_of(before.corner_sqr - before.change_sqr(self.trimmed_mm));
        math::min(
            self.top_sqr,
            self.sqr_at(start + self.angle_per_mm * self.length_mm),
        )
    }

    /// Returns the angle z of a squared speed, rad.
    fn angle_of(&self, sqr: f32) -> f32 {
        math::asin(math::min(
            math::max(sqr, f32::MIN_POSITIVE) / self.limit_sqr,
            1.0,
        ))
    }

    /// Returns the squared speed of an angle z, (mm/s)².
    fn sqr_at(&self, angle: f32) -> f32 {
        let sqr = self.limit_sqr * math::sin(math::min(angle, FRAC_PI_2));
        math::max(sqr, f32::MIN_POSITIVE)
    }
}

/// Returns a position moved along a direction.
fn moved(mut position: Axes<Nm>, direction: &[f32; LINEAR], mm: f32) -> Axes<Nm> {
    for (coordinate, share) in position.iter_mut().zip(direction) {
        *coordinate = *coordinate + Nm::from_mm(share * mm);
    }
    position
}

/// The deflection angle θ between two directions.
struct Deflection {
    /// Sine of θ/2.
    half_sine: f32,
    /// Cosine of θ/2.
    half_cosine: f32,
    /// Direction from the centre of the arc to its middle.
    radial: [f32; LINEAR],
    /// Direction of the path in its middle.
    tangent: [f32; LINEAR],
}

impl Deflection {
    /// The angle between two directions; `None` for a reversal.
    fn between(from: &[f32; LINEAR], to: &[f32; LINEAR]) -> Option<Self> {
        let change: [f32; LINEAR] = core::array::from_fn(|axis| to[axis] - from[axis]);
        let sum: [f32; LINEAR] = core::array::from_fn(|axis| to[axis] + from[axis]);
        let cosine_sqr = 0.25 * math::dot(&sum, &sum);
        if cosine_sqr < MIN_COSINE_SQR {
            return None;
        }
        let half_sine = math::sqrt(0.25 * math::dot(&change, &change));
        let half_cosine = math::sqrt(cosine_sqr);
        Some(Self {
            half_sine,
            half_cosine,
            radial: change.map(|change| -0.5 * change / half_sine),
            tangent: sum.map(|sum| 0.5 * sum / half_cosine),
        })
    }

    /// Returns θ, rad.
    fn radians(&self) -> f32 {
        2.0 * math::asin(math::min(self.half_sine, 1.0))
    }

    /// Returns tan(θ/2).
    fn half_tangent(&self) -> f32 {
        self.half_sine / self.half_cosine
    }

    /// Returns 1/cos(θ/2) - 1, without the difference that cancels.
    fn excess(&self) -> f32 {
        self.half_sine * self.half_sine / (self.half_cosine * (1.0 + self.half_cosine))
    }

    /// Returns the direction from the centre to the start of the arc: the middle rotated back by θ/2.
    fn radial_at_start(&self) -> [f32; LINEAR] {
        core::array::from_fn(|axis| {
            self.half_cosine * self.radial[axis] - self.half_sine * self.tangent[axis]
        })
    }
}

/// Returns the feed rate under the stricter limit.
fn slower(before: FeedRate, after: FeedRate) -> FeedRate {
    match (before, after) {
        (FeedRate::Rapid, after) => after,
        (FeedRate::Feed(a), FeedRate::Feed(b)) => FeedRate::Feed(math::min(a, b)),
        (FeedRate::Feed(_) | FeedRate::InverseTime(_) | FeedRate::Jog(_), _) => before,
    }
}
