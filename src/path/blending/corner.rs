//! The arc that takes the place of a corner.
//!
//! ```text
//!        corner
//!   before ╱╲ after      trimmed = radius·tan(turn/2)
//!         ╱⌒⌒╲           deviation = radius·(1/cos(turn/2) - 1)
//!        ╱    ╲
//! ```
//!
//! It touches both lines, so that only its radius can make the machine slower: v² = a·radius. The
//! deviation, from the corner to the middle of the arc, is the greatest distance between the two
//! ways, in either direction. Of each line at most half is trimmed, whatever is trimmed at its other
//! end.

use super::{CornerArc, LINEAR, Straight, chain::nm, dot};
use crate::{axis::Axes, math, model::FeedRate, path::router::Limits, units::Nm};

/// A way that is nothing but rounding, nm.
pub(super) const NOTHING_NM: i64 = 50;
/// Square of the cosine of half a turn below which there is no arc: the way goes back.
const BACK: f32 = 1.0e-3;
/// What the squared speed gains at least where a corner is rounded: the way round the arc takes time
/// that passing the corner does not.
const GAIN: f32 = 1.44;
/// Most steps of a radius: its points are right to 2⁻⁹ steps then.
const MOST_STEPS: f32 = 2_000_000.0;
/// Part of the tolerance that is left to rounding in single precision.
const EXACT: f32 = 0.9999;

/// A corner that is rounded.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    /// Where the line before ends.
    pub(super) start: Axes<Nm>,
    pub(super) round: CornerArc,
    /// The greatest distance from the programmed path, mm, the lines' own included.
    pub(super) deviation_mm: f32,
}

impl Corner {
    /// The arc between two lines, no farther from the programmed path than a tolerance; `None` where
    /// it would not be faster than passing the corner itself.
    pub(super) fn between(
        limits: &Limits,
        before: &Straight,
        after: &Straight,
        tolerance_mm: f32,
    ) -> Option<Self> {
        let [from, to] = [before, after].map(|line| spread(&line.direction));
        let speed_mm_s = math::min(
            limits.paced_mm_s(before.feed_rate, &from),
            limits.paced_mm_s(after.feed_rate, &to),
        );
        let wanted_sqr = speed_mm_s * speed_mm_s;
        let exact_sqr = limits.junction_sqr(&from, &to);
        if wanted_sqr < GAIN * exact_sqr {
            return None;
        }
        let turn = Turn::between(&before.direction, &after.direction)?;
        let shares = turn.shares();
        let acceleration = limits.acceleration_along(&shares);
        let error_mm = math::max(before.error_mm, after.error_mm);
        let allowed_mm = EXACT * (tolerance_mm - error_mm);
        let half_mm = 0.5 * math::min(before.length_mm, after.length_mm);
        let radius_mm = math::min(
            math::min(allowed_mm / turn.excess(), half_mm / turn.tangent()),
            math::min(wanted_sqr / acceleration, limits.radius_mm(MOST_STEPS)),
        );
        let length_mm = radius_mm * turn.radians();
        let in_time_mm_s = length_mm / Limits::SHORTEST_ROUND_S;
        let passing = Passing {
            // What can be reached between this corner and the middle of the shorter line.
            top_sqr: math::min(wanted_sqr, exact_sqr + 2.0 * acceleration * half_mm),
            exact_sqr,
            round_sqr: math::min(
                limits.round_sqr(&shares, radius_mm, acceleration),
                in_time_mm_s * in_time_mm_s,
            ),
            acceleration,
        };
        let trimmed_mm = radius_mm * turn.tangent();
        if radius_mm <= 0.0 || !passing.is_faster_round(length_mm, trimmed_mm) {
            return None;
        }
        let corner = before.target.position;
        Some(Self {
            start: beside(corner, &before.direction, -trimmed_mm),
            round: CornerArc {
                target: beside(corner, &after.direction, trimmed_mm),
                radius_mm,
                sweep_rad: turn.radians(),
                radial: turn.outwards_at_start(),
                tangent: before.direction,
                feed_rate: slower(before.feed_rate, after.feed_rate),
                line: after.line,
            },
            deviation_mm: radius_mm * turn.excess() + error_mm,
        })
    }
}

/// A place beside a corner.
fn beside(corner: Axes<Nm>, direction: &[f32; LINEAR], mm: f32) -> Axes<Nm> {
    let mut place = corner;
    for (place, share) in place.iter_mut().zip(direction) {
        *place = *place + nm(share * mm);
    }
    place
}

/// Half the angle between two directions, and what lies in the middle of it.
struct Turn {
    sine: f32,
    cosine: f32,
    /// From the centre of a circle that touches both.
    outwards: [f32; LINEAR],
    /// Along it.
    middle: [f32; LINEAR],
}

impl Turn {
    /// `None` for a way back.
    fn between(from: &[f32; LINEAR], to: &[f32; LINEAR]) -> Option<Self> {
        let change: [f32; LINEAR] = core::array::from_fn(|axis| to[axis] - from[axis]);
        let sum: [f32; LINEAR] = core::array::from_fn(|axis| to[axis] + from[axis]);
        let cosine_sqr = 0.25 * dot(&sum, &sum);
        if cosine_sqr < BACK {
            return None;
        }
        let sine = math::sqrt(0.25 * dot(&change, &change));
        let cosine = math::sqrt(cosine_sqr);
        Some(Self {
            sine,
            cosine,
            outwards: change.map(|change| -0.5 * change / sine),
            middle: sum.map(|sum| 0.5 * sum / cosine),
        })
    }

    /// The whole angle.
    fn radians(&self) -> f32 {
        2.0 * math::asin(math::min(self.sine, 1.0))
    }

    fn tangent(&self) -> f32 {
        self.sine / self.cosine
    }

    /// 1/cos - 1, without the difference that cancels.
    fn excess(&self) -> f32 {
        self.sine * self.sine / (self.cosine * (1.0 + self.cosine))
    }

    /// The greatest share of each axis in any direction of the plane.
    fn shares(&self) -> Axes<f32> {
        spread(&core::array::from_fn(|axis| {
            let (a, b) = (self.outwards[axis], self.middle[axis]);
            math::sqrt(a * a + b * b)
        }))
    }

    /// From the centre to where the circle touches the first direction: turned back by half the
    /// angle.
    fn outwards_at_start(&self) -> [f32; LINEAR] {
        core::array::from_fn(|axis| {
            self.cosine * self.outwards[axis] - self.sine * self.middle[axis]
        })
    }
}

/// The speeds at which a corner can be passed, squared, (mm/s)², and the acceleration, mm/s².
struct Passing {
    /// Far from the corner.
    top_sqr: f32,
    /// In the corner itself.
    exact_sqr: f32,
    /// Round it.
    round_sqr: f32,
    acceleration: f32,
}

impl Passing {
    /// Whether the way round takes less time: braking from V to v and speeding up again costs
    /// (V - v)²/(aV) against passing at V; the way round takes its length at v, and saves the ends
    /// of both lines at V. All times aV.
    fn is_faster_round(&self, length_mm: f32, trimmed_mm: f32) -> bool {
        if self.round_sqr < GAIN * self.exact_sqr {
            return false;
        }
        let [exact, round] = [self.exact_sqr, self.round_sqr].map(math::sqrt);
        let top = math::max(math::sqrt(self.top_sqr), round);
        let braking = |speed: f32| (top - speed) * (top - speed);
        let way = self.acceleration * (top * length_mm / round - 2.0 * trimmed_mm);
        braking(round) + way < braking(exact)
    }
}

/// The same direction over all axes.
pub(super) fn spread(direction: &[f32; LINEAR]) -> Axes<f32> {
    Axes::from_fn(|axis| direction.get(axis).copied().unwrap_or(0.0))
}

/// The feed rate of two that is under the stricter limit.
fn slower(before: FeedRate, after: FeedRate) -> FeedRate {
    match (before, after) {
        (FeedRate::Rapid, after) => after,
        (FeedRate::Feed(a), FeedRate::Feed(b)) => FeedRate::Feed(math::min(a, b)),
        (before, _) => before,
    }
}
