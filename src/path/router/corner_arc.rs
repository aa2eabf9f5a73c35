//! Rounded corners: from an arc in any plane of the linear axes to a block.

use super::{Limits, Router, pace_mm_s, pacing};
use core::f32::consts::PI;

use crate::{
    axis::{Axes, X, Y, Z},
    math,
    path::{Block, CornerArc, Curve, Shape, SpatialArc, Work, arc::PHASE_PER_RAD},
    units::Nm,
};

/// Linear axes.
const LINEAR: usize = super::LINEAR;
/// Square of the shortest way round a corner, mm²: a nanometre.
const LEAST_SQR: f32 = 1.0e-12;

impl Router {
    /// The work that a rounded corner makes; false where it makes no step, and is part of the next
    /// move.
    pub fn corner_arc_into(&mut self, round: &CornerArc, work: &mut Work) -> bool {
        let end = self.place(&round.target.into());
        if end.steps == self.steps {
            self.position = round.target;
            return false;
        }
        let round = &self.begun_here(round);
        let share = |directions: &[f32; LINEAR], axis| directions.get(axis).copied().unwrap_or(0.0);
        let outwards = Axes::from_fn(|axis| share(&round.radial, axis));
        let along = Axes::from_fn(|axis| share(&round.tangent, axis));
        let shares = outwards.zip(along, |a, b| math::sqrt(a * a + b * b));
        let (sine, cosine) = (libm::sinf(round.sweep_rad), libm::cosf(round.sweep_rad));
        let end_tangent = along.zip(outwards, |along, outwards| along * cosine - outwards * sine);
        let acceleration = self.limits.acceleration_along(&shares);
        let limit_sqr = acceleration * round.radius_mm;
        let length_mm = round.radius_mm * round.sweep_rad;
        let steps_per_mm = shares.zip(self.limits.steps_per_mm, |share, steps| share * steps);
        let inwards = |outwards: &Axes<f32>| (*outwards).map(|part| -part / round.radius_mm);
        let circle = self.oblique(round, &along, &outwards, &end_tangent);
        let pieces = circle
            .reversals
            .iter()
            .filter(|part| **part != SpatialArc::NEVER);
        let shortest_s = Limits::SHORTEST_ROUND_S
            .max(0.5 * Limits::SHORTEST_ROUND_S * (1 + pieces.count()) as f32);
        let rate = Limits::along(&self.limits.speed_mm_s, &shares)
            .min(self.limits.together(&steps_per_mm))
            .min(math::sqrt(limit_sqr))
            .min(length_mm / shortest_s);
        let paced = |rate| pace_mm_s(round.feed_rate, length_mm, rate);
        let (rate, acceleration) =
            self.limits
                .bent_round(&shares, round.radius_mm, rate, acceleration, paced);
        let programmed_mm_s = paced(rate);
        let sweep = f64::from(round.sweep_rad) * PHASE_PER_RAD;
        *work = Work::Move(Block {
            delta: end.fine.zip(self.fine, |to, from| to.0 - from.0),
            steps_per_mm,
            length_mm,
            nominal_mm_s: math::min(programmed_mm_s, rate),
            programmed_mm_s,
            limit_mm_s: rate,
            kind: pacing(round.feed_rate),
            laser: self.laser,
            acceleration_mm_s2: acceleration,
            junction_sqr: self.junction_sqr(&of_length_one(along), &inwards(&outwards)),
            curve: Some(Curve {
                phase: 0,
                sweep: sweep as i64,
                limit_sqr,
                mm_per_phase: (f64::from(length_mm) / sweep) as f32,
                shape: Shape::Spatial(circle),
            }),
            line: round.line,
        });
        let end_outwards = along.zip(outwards, |along, outwards| along * sine + outwards * cosine);
        let end_tangent = of_length_one(end_tangent);
        self.finish(round.target, end, end_tangent, inwards(&end_outwards));
        true
    }

    /// A corner behind a way that made no step: it begins where the machine is, and ends where it did.
    /// Each axis is drawn out by what it is behind; then its directions are no unit vectors.
    ///
    /// Its points are C·(cos φ - 1) + S·sin φ from its start. With b/2 less in C and b·cot(θ/2)/2 more in S
    /// a part of b is added that grows steadily, from none to b at the whole angle θ.
    fn begun_here(&self, round: &CornerArc) -> CornerArc {
        let mm = |from: &Axes<Nm>, to: &Axes<Nm>| -> [f32; LINEAR] {
            core::array::from_fn(|axis| (to[axis] - from[axis]).to_mm())
        };
        let behind = mm(&self.sent, &self.position);
        if behind == [0.0; LINEAR] {
            return *round;
        }
        let half_rad = 0.5 * round.sweep_rad;
        let cotangent = libm::cosf(half_rad) / libm::sinf(half_rad);
        let [way, whole] = [&self.position, &self.sent].map(|from| mm(from, &round.target));
        let [way_sqr, whole_sqr] = [way, whole].map(|way| way.iter().map(|way| way * way).sum());
        // No longer than it is, so that the feed is kept.
        let stretch = math::sqrt(math::max(whole_sqr / math::max(way_sqr, LEAST_SQR), 1.0));
        let radius_mm = round.radius_mm * stretch;
        let drawn = |axis: usize, direction: f32, part: f32| {
            (direction * round.radius_mm + part * behind[axis]) / radius_mm
        };
        CornerArc {
            radius_mm,
            radial: core::array::from_fn(|axis| drawn(axis, round.radial[axis], -0.5)),
            tangent: core::array::from_fn(|axis| drawn(axis, round.tangent[axis], 0.5 * cotangent)),
            ..*round
        }
    }

    /// The circle of an arc that goes from a direction to another.
    fn oblique(
        &self,
        round: &CornerArc,
        along: &Axes<f32>,
        outwards: &Axes<f32>,
        end: &Axes<f32>,
    ) -> SpatialArc {
        let resolution = &self.limits.steps_per_mm;
        let finest = resolution
            .iter()
            .take(LINEAR)
            .fold(0.0, |a, b| math::max(a, *b));
        let greatest = along
            .zip(*outwards, |a, b| math::sqrt(a * a + b * b))
            .iter()
            .fold(1.0, |a, b| math::max(a, *b));
        // Two to this power is more than any coordinate, in steps.
        let steps = math::max(round.radius_mm * greatest * finest, 0.25);
        let places = (steps.to_bits() >> 23).cast_signed() - 126;
        // In 2³⁰ parts of that.
        let unit_steps = power_of_two(places - 30);
        let scale = round.radius_mm / unit_steps;
        let scaled = |direction: &Axes<f32>| {
            core::array::from_fn(|axis| {
                let units = direction[axis] * resolution[axis] * scale;
                libm::roundf(units) as i32
            })
        };
        let reversal = |axis: usize| {
            // Less than a half turn: an axis reverses once, or not at all.
            if along[axis] * end[axis] >= 0.0 {
                return SpatialArc::NEVER;
            }
            let angle = libm::atanf(along[axis] / outwards[axis]);
            let angle = if angle < 0.0 { angle + PI } else { angle };
            let part = math::min(angle / round.sweep_rad, 1.0) * f32::from(SpatialArc::NEVER);
            part as u16
        };
        let [first, second, third] = [X, Y, Z].map(reversal);
        let (first, second) = (first.min(second), first.max(second));
        let (second, third) = (second.min(third), second.max(third));
        let (first, second) = (first.min(second), first.max(second));
        SpatialArc {
            cosine: scaled(outwards),
            sine: scaled(along),
            shift: (places + 2).clamp(0, 30) as u8,
            per_mm: unit_steps / round.radius_mm,
            reversals: [first, second, third],
        }
    }
}

/// A direction as a unit vector; one that is near to it stays as it is.
fn of_length_one(direction: Axes<f32>) -> Axes<f32> {
    let square: f32 = direction.iter().map(|part| part * part).sum();
    if (square - 1.0).abs() < 1.0e-5 {
        return direction;
    }
    let length = math::sqrt(square);
    direction.map(|part| part / length)
}

/// 2 to a power from -126 to 127.
fn power_of_two(power: i32) -> f32 {
    f32::from_bits(((power + 127).clamp(1, 254).unsigned_abs()) << 23)
}

impl Limits {
    /// Shortest time for a rounded corner, s.
    pub(crate) const SHORTEST_ROUND_S: f32 = super::SHORTEST_ARC_S;

    /// Acceleration along a direction that the axes allow, or that has these shares at most, mm/s².
    pub(crate) fn acceleration_along(&self, shares: &Axes<f32>) -> f32 {
        Self::along(&self.acceleration_mm_s2, shares)
    }

    /// A radius that makes so many steps of the finest linear axis, mm.
    pub(crate) fn radius_mm(&self, steps: f32) -> f32 {
        let finest = self.steps_per_mm.iter().take(LINEAR);
        steps / finest.fold(f32::MIN_POSITIVE, |a, b| math::max(a, *b))
    }

    /// Speed of a line at a feed rate, mm/s.
    pub(crate) fn paced_mm_s(&self, feed_rate: super::FeedRate, direction: &Axes<f32>) -> f32 {
        let rate = Self::along(&self.speed_mm_s, direction);
        // Neither depends on a length.
        math::min(pace_mm_s(feed_rate, 0.0, rate), rate)
    }
}
