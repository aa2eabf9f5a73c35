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

use super::{CornerArc, PendingLine};
use crate::{
    axis::{Axes, LINEAR},
    math,
    model::FeedRate,
    path::router::{Limits, to_axes},
    units::Nm,
};

/// Greatest rounding error of a trimmed line, nm: a shorter line is none.
pub(super) const ROUNDING_NM: i64 = 50;
/// Least cos²(θ/2), a deflection of 176°, for an arc: beyond, its radius is below a thirtieth of what is
/// trimmed.
const MIN_COSINE_SQR: f32 = 1.0e-3;
/// Least ratio of the squared speeds on the arc and at the exact corner, 1.2 in speed v. Below this ratio an arc gains
/// little: less braking saves 2 (v − v/1.2)/a = v/3a at most, and an arc of the deflection θ takes θ v/a itself: beyond
/// 19° the arc gains nothing.
const MIN_GAIN: f32 = 1.44;
/// Most steps of a radius: the points of a [`SpatialArc`](crate::path::SpatialArc) of 30 binary places have
/// an error of 2⁻⁹ steps then.
const MAX_RADIUS_STEPS: f32 = 2_000_000.0;
/// Part of the tolerance that is used: the remainder is for rounding in single precision.
const TOLERANCE_PART: f32 = 0.9999;

/// A blended corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    /// End of the line before, start of the arc.
    pub(super) start: Axes<Nm>,
    pub(super) arc: CornerArc,
    /// Greatest distance from the programmed path, mm, that of the lines included.
    pub(super) deviation_mm: f32,
}

impl Corner {
    /// Returns the corner with an arc within a tolerance of the programmed path; `None` where that is not
    /// faster than the exact corner.
    pub(super) fn between(
        limits: &Limits,
        before: &PendingLine,
        after: &PendingLine,
        tolerance_mm: f32,
    ) -> Option<Self> {
        let [from, to] = [before, after].map(|line| to_axes(&line.direction));
        let speed_mm_s = math::min(
            limits.line_mm_s(before.feed_rate, &from),
            limits.line_mm_s(after.feed_rate, &to),
        );
        let wanted_sqr = speed_mm_s * speed_mm_s;
        let exact_sqr = limits.junction_sqr(&from, &to);
        if wanted_sqr < MIN_GAIN * exact_sqr || limits.reverses_backlash(&from, &to) {
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
                wanted_sqr / acceleration,
                limits.radius_mm(MAX_RADIUS_STEPS),
            ),
        );
        let length_mm = radius_mm * angle.radians();
        let shortest_time_mm_s = length_mm / Limits::MIN_CORNER_ARC_S;
        let speeds = CornerSpeeds {
            // Reached between the corner and the middle of the shorter line.
            top_sqr: math::min(wanted_sqr, exact_sqr + 2.0 * acceleration * half_mm),
            exact_sqr,
            arc_sqr: math::min(
                limits.corner_arc_sqr(&shares, radius_mm, acceleration),
                shortest_time_mm_s * shortest_time_mm_s,
            ),
            acceleration,
        };
        let trimmed_mm = radius_mm * angle.half_tangent();
        if radius_mm <= 0.0 || !speeds.is_arc_faster(length_mm, trimmed_mm) {
            return None;
        }
        let corner = before.target.position;
        Some(Self {
            start: moved(corner, &before.direction, -trimmed_mm),
            arc: CornerArc {
                target: moved(corner, &after.direction, trimmed_mm),
                radius_mm,
                sweep_rad: angle.radians(),
                radial: angle.radial_at_start(),
                tangent: before.direction,
                feed_rate: slower(before.feed_rate, after.feed_rate),
                line: after.line,
            },
            deviation_mm: radius_mm * angle.excess() + error_mm,
        })
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

/// Squared speeds at a corner, (mm/s)², and the acceleration, mm/s².
struct CornerSpeeds {
    /// Far from the corner.
    top_sqr: f32,
    /// At the exact corner.
    exact_sqr: f32,
    /// On the arc.
    arc_sqr: f32,
    acceleration: f32,
}

impl CornerSpeeds {
    /// Returns true if the arc takes less time than the exact corner.
    ///
    /// Braking from V to v and accelerating again costs (V - v)²/(aV) against a constant V; the arc takes
    /// its length at v, and saves the trimmed ends of both lines at V. All times are multiplied by aV.
    fn is_arc_faster(&self, length_mm: f32, trimmed_mm: f32) -> bool {
        if self.arc_sqr < MIN_GAIN * self.exact_sqr {
            return false;
        }
        let [exact, arc] = [self.exact_sqr, self.arc_sqr].map(math::sqrt);
        let top = math::max(math::sqrt(self.top_sqr), arc);
        let braking = |speed: f32| (top - speed) * (top - speed);
        let length = self.acceleration * (top * length_mm / arc - 2.0 * trimmed_mm);
        braking(arc) + length < braking(exact)
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
