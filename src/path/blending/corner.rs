//! The arc in the place of a corner.
//!
//! ```text
//!        corner            with the deflection angle θ:
//!   before ╱╲ after      trimmed = radius·tan(θ/2)
//!         ╱⌒⌒╲           deviation = radius·(1/cos(θ/2) - 1)
//!        ╱    ╲
//! ```
//!
//! The arc touches both moves, so that only its radius limits the speed: v² = a·radius. The deviation,
//! from the corner to the middle of the arc, is the greatest distance between the two paths, in either
//! direction. At most half of each move is trimmed, whatever is trimmed at its other end. Beside programmed arcs the
//! geometry is that of [`fillet`](super::fillet), in their plane. [`corner_time`](super::corner_time) says when an arc is
//! faster than the corner.

use super::{
    CornerArc,
    corner_jerk::JerkLimitedArc,
    corner_time::{ArcProfile, CornerSide},
    fillet::PlaneCorner,
    pending::{PendingMove, Reach, SHORTEST_REST_S},
};
use crate::{
    axis::{Axes, LINEAR},
    math,
    model::{FeedRate, Plane},
    path::router::{Limits, to_axes},
    units::Nm,
};

/// Greatest rounding error of a trimmed line, nm: a shorter line is none.
pub(super) const ROUNDING_NM: i64 = 50;
/// Least cos²(θ/2), a deflection of 176°, for an arc: beyond, its radius is below a thirtieth of what is
/// trimmed.
const MIN_COSINE_SQR: f32 = 1.0e-3;
/// Most steps of a radius: the points of a [`SpatialArc`](crate::path::SpatialArc) of 30 binary places have
/// an error of 2⁻⁹ steps then.
const MAX_RADIUS_STEPS: f32 = 2_000_000.0;
/// Part of the tolerance that is used: the remainder is for rounding in single precision.
const TOLERANCE_PART: f32 = 0.9999;

/// The corner of two moves.
pub(super) struct Corner<'a> {
    before: &'a PendingMove,
    after: &'a PendingMove,
    sides: [CornerSide; 2],
    /// Limits of the squared speed, (mm/s)²: that of the moves, and that of the exact corner.
    wanted_sqr: f32,
    junction_sqr: f32,
}

/// A rounded corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct RoundedCorner {
    /// End of the move before, start of the arc.
    pub(super) start: Axes<Nm>,
    pub(super) arc: CornerArc,
    /// What the arc trims of the move after it, mm.
    pub(super) trimmed_mm: f32,
    /// What the next corner has to leave of the move after it, mm.
    pub(super) rest_mm: f32,
    /// Greatest distance from the programmed path, mm, that of the moves included.
    pub(super) deviation_mm: f32,
    /// Speed that can be reached at the end of the arc.
    pub(super) reach: Reach,
}

/// An arc that touches both moves.
struct TouchingArc {
    start: Axes<Nm>,
    end: Axes<Nm>,
    radius_mm: f32,
    sweep_rad: f32,
    /// Direction from the centre to the start, and of the path at the start and at the end.
    radial: [f32; LINEAR],
    tangents: [[f32; LINEAR]; 2],
    /// What it trims of each move, mm, and where a change of speed has to end: see [`ArcProfile`].
    trimmed_mm: [f32; 2],
    rests_mm: [f32; 2],
    deviation_mm: f32,
    /// Greatest shares of the motors along the arc.
    shares: Axes<f32>,
    /// The move before it leaves slack.
    has_slack: bool,
}

impl<'a> Corner<'a> {
    pub(super) fn new(limits: &Limits, before: &'a PendingMove, after: &'a PendingMove) -> Self {
        let (end, start) = (before.directions[1], after.directions[0]);
        let sides = [
            CornerSide::new(limits, (before, end), before.reach, before.left_mm()),
            CornerSide::new(limits, (after, start), Reach::UNKNOWN, after.length_mm),
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

    /// Returns the speed that can be reached at the exact corner.
    pub(super) fn reach(&self) -> Reach {
        let limit_sqr = math::min(self.junction_sqr, self.wanted_sqr);
        self.sides[0].reach().up_to(limit_sqr)
    }

    /// Returns the corner with an arc within a tolerance of the programmed path; `None` where that might be slower than
    /// the exact corner.
    pub(super) fn rounded(&self, limits: &Limits, tolerance_mm: f32) -> Option<RoundedCorner> {
        let (before, after) = (self.before, self.after);
        let [from, to] = [&self.sides[0].direction, &self.sides[1].direction];
        if self.wanted_sqr <= self.junction_sqr || limits.reverses_backlash(from, to) {
            return None;
        }
        let error_mm = math::max(before.error_mm, after.error_mm);
        let allowed_mm = TOLERANCE_PART * (tolerance_mm - error_mm);
        let arc = match [&before.arc, &after.arc].map(|arc| arc.map(|arc| arc.plane)) {
            [None, None] => self.between_lines(limits, allowed_mm),
            [Some(one), Some(other)] if one != other => None,
            [Some(plane), _] | [_, Some(plane)] => self.in_plane(limits, plane, allowed_mm),
        }?;
        let profile = self.profile(limits, &arc);
        if profile.top_sqr <= self.junction_sqr {
            return None;
        }
        let rest_mm = if limits.is_jerk_limited() {
            self.needed_rest_mm(limits, &arc, &profile)?
        } else if profile.is_no_slower(&self.sides, self.junction_sqr) {
            0.0
        } else {
            return None;
        };
        Some(RoundedCorner {
            start: arc.start,
            arc: CornerArc {
                target: arc.end,
                radius_mm: arc.radius_mm,
                sweep_rad: arc.sweep_rad,
                radial: arc.radial,
                tangent: arc.tangents[0],
                feed_rate: slower(before.feed_rate, after.feed_rate),
                line: after.line,
            },
            trimmed_mm: arc.trimmed_mm[1],
            rest_mm,
            deviation_mm: arc.deviation_mm + error_mm,
            reach: profile.reach(&self.sides[0]),
        })
    }

    /// Returns the greatest radius that is of use, mm.
    fn most_radius_mm(&self, limits: &Limits, shares: &Axes<f32>) -> f32 {
        let sqr_per_mm = limits.corner_arc_sqr(shares, 1.0, limits.acceleration_along(shares));
        math::min(
            self.wanted_sqr / sqr_per_mm,
            limits.radius_mm(MAX_RADIUS_STEPS),
        )
    }

    /// Returns the arc between two lines.
    fn between_lines(&self, limits: &Limits, allowed_mm: f32) -> Option<TouchingArc> {
        let (before, after) = (self.before, self.after);
        let [from, to] = [before.directions[1], after.directions[0]];
        let angle = Deflection::between(&from, &to)?;
        let shares = limits.arc_shares(to_axes(&angle.radial), to_axes(&angle.tangent));
        let half_mm = 0.5 * math::min(before.length_mm, after.length_mm);
        let radius_mm = math::min(
            math::min(allowed_mm / angle.excess(), half_mm / angle.half_tangent()),
            self.most_radius_mm(limits, &shares),
        );
        let left_mm = before.left_mm();
        let before_mm_s = self.sides[0].speed_mm_s;
        let radius_mm = fitted_mm(radius_mm, angle.half_tangent(), left_mm, before_mm_s)?;
        let trimmed_mm = radius_mm * angle.half_tangent();
        let corner = before.target.position;
        Some(TouchingArc {
            start: moved(corner, &from, -trimmed_mm),
            end: moved(corner, &to, trimmed_mm),
            radius_mm,
            sweep_rad: angle.radians(),
            radial: angle.radial_at_start(),
            tangents: [from, to],
            trimmed_mm: [trimmed_mm; 2],
            rests_mm: self.rests_mm([trimmed_mm; 2]),
            deviation_mm: radius_mm * angle.excess(),
            shares,
            has_slack: left_mm - half_mm >= Limits::FULL_SLACK_LINE_S * before_mm_s,
        })
    }

    /// Returns the arc beside one or two arcs in a plane.
    fn in_plane(&self, limits: &Limits, plane: Plane, allowed_mm: f32) -> Option<TouchingArc> {
        let (first, second, third) = plane.axes();
        let axes = [first, second];
        let moves = [self.before, self.after];
        let [end, start] = [self.before.directions[1], self.after.directions[0]];
        // A line of the plane is exactly in it.
        if end[third] != 0.0 || start[third] != 0.0 {
            return None;
        }
        let most_mm = [0, 1].map(|n| moves[n].most_trimmed_mm(self.sides[n].speed_mm_s));
        if most_mm[0] <= 0.0 || most_mm[1] <= 0.0 {
            return None;
        }
        let shares = limits.plane_shares(axes);
        let corner = PlaneCorner::new([0, 1].map(|n| moves[n].curve(axes, 1 - n, most_mm[n])))?;
        let most_radius_mm = self.most_radius_mm(limits, &shares);
        let fillet = corner.widest(f64::from(allowed_mm), f64::from(most_radius_mm))?;
        let trimmed_mm = corner.trimmed_mm(&fillet).map(|mm| mm as f32);
        let direction = |[x, y]: [f64; 2]| {
            let mut direction = [0.0; LINEAR];
            (direction[first], direction[second]) = (x as f32, y as f32);
            direction
        };
        let place = |[x, y]: [f64; 2]| {
            let mut place = self.before.target.position;
            place[first] = place[first] + Nm::from_mm_f64(x);
            place[second] = place[second] + Nm::from_mm_f64(y);
            place
        };
        let tangents = [0, 1].map(|end| direction(fillet.tangent(end)));
        let [from, to] = [to_axes(&tangents[0]), to_axes(&tangents[1])];
        let left_mm = moves.map(PendingMove::left_mm);
        let is_resting =
            left_mm[0] - most_mm[0] >= Limits::FULL_SLACK_LINE_S * self.sides[0].speed_mm_s;
        (!limits.reverses_backlash(&from, &to)).then(|| TouchingArc {
            start: place(fillet.ends[0]),
            end: place(fillet.ends[1]),
            radius_mm: fillet.radius_mm as f32,
            sweep_rad: fillet.sweep_rad() as f32,
            radial: direction(fillet.radial(0)),
            tangents,
            trimmed_mm,
            rests_mm: self.rests_mm(trimmed_mm),
            deviation_mm: fillet.deviation_mm as f32,
            shares,
            has_slack: self.before.arc.is_none() && is_resting,
        })
    }

    /// Returns what is left of each move, mm: of the move after the corner, the next corner may take half.
    fn rests_mm(&self, trimmed_mm: [f32; 2]) -> [f32; 2] {
        let [before_mm, after_mm] = trimmed_mm;
        [
            self.before.left_mm() - before_mm,
            0.5 * self.after.length_mm - after_mm,
        ]
    }

    /// Returns what an arc has to keep to.
    fn profile(&self, limits: &Limits, arc: &TouchingArc) -> ArcProfile {
        let [from, to] = &arc.tangents;
        let length_mm = arc.radius_mm * arc.sweep_rad;
        let reversals = (0..LINEAR).filter(|axis| from[*axis] * to[*axis] < 0.0);
        let shortest_s = Limits::shortest_corner_arc_s(reversals.count(), arc.has_slack);
        let axes_mm_s = math::min(limits.arc_mm_s(&arc.shares), length_mm / shortest_s);
        let acceleration = limits.acceleration_along(&arc.shares);
        ArcProfile {
            length_mm,
            trimmed_mm: arc.trimmed_mm,
            rests_mm: arc.rests_mm,
            limit_sqr: acceleration * arc.radius_mm,
            angle_per_mm: 2.0 / arc.radius_mm,
            top_sqr: math::min(
                math::min(self.wanted_sqr, axes_mm_s * axes_mm_s),
                limits.corner_arc_sqr(&arc.shares, arc.radius_mm, acceleration),
            ),
        }
    }

    /// Returns what the next corner has to leave of the move after an arc within limits of jerk, mm; `None` for an arc that
    /// may be slower.
    fn needed_rest_mm(
        &self,
        limits: &Limits,
        arc: &TouchingArc,
        profile: &ArcProfile,
    ) -> Option<f32> {
        let [before_mm, after_mm] = arc.trimmed_mm;
        let speed_mm_s = math::sqrt(profile.top_sqr);
        let arc = JerkLimitedArc {
            speed_mm_s,
            acceleration_mm_s2: limits.corner_arc_mm_s2(&arc.shares, arc.radius_mm, speed_mm_s),
            trimmed_mm: arc.trimmed_mm,
            ramp_s: limits.ramp_s(),
        };
        let needed_mm = arc.stopping_mm();
        let has_rests = self.before.left_mm() - before_mm
            >= math::max(needed_mm, self.before.rest_mm)
            && self.after.length_mm - after_mm >= needed_mm;
        let is_ahead = arc.is_ahead(&self.sides, math::sqrt(self.junction_sqr));
        (has_rests && is_ahead).then_some(needed_mm)
    }
}

/// Returns a radius, or a smaller one of which the rest of the line before it is no short segment, mm; `None` without a
/// rest.
fn fitted_mm(radius_mm: f32, half_tangent: f32, left_mm: f32, speed_mm_s: f32) -> Option<f32> {
    let least_mm = SHORTEST_REST_S * speed_mm_s;
    let rest_mm = left_mm - radius_mm * half_tangent;
    let fitted_mm = if rest_mm >= least_mm || rest_mm <= 1.0e-6 * ROUNDING_NM as f32 {
        radius_mm
    } else {
        (left_mm - least_mm) / half_tangent
    };
    (fitted_mm > 0.0).then_some(fitted_mm)
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
