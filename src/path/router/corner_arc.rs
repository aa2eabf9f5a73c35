//! Blocks of corner arcs, in any plane of the linear axes.

use core::f32::consts::PI;

use super::{Geometry, Limits, Router};
use crate::{
    axis::{Axes, LINEAR, X, Y, Z},
    math,
    path::{Block, CornerArc, Curve, Shape, SpatialArc, arc::PHASE_PER_RAD, blending::linear_mm},
};

/// Smallest square of a chord that is divided by, mm²: a nanometre.
const MIN_CHORD_SQR: f32 = 1.0e-12;

impl Router {
    /// The block of a corner arc; `None` for one that makes no step, and is part of the next move.
    pub(super) fn corner_arc_block(&mut self, arc: &CornerArc) -> Option<Block> {
        let end = self.block_end(&arc.target.into());
        if end.steps == self.at.steps {
            self.at.position = arc.target;
            return None;
        }
        let geometry = self.corner_arc_geometry(&self.begun_at_block_end(arc));
        Some(self.block(arc.target, end, &geometry, arc.feed_rate, arc.line))
    }

    fn corner_arc_geometry(&self, arc: &CornerArc) -> Geometry {
        let limits = &self.limits;
        let [radial, tangent] = [&arc.radial, &arc.tangent].map(to_axes);
        let shares = limits.arc_shares(radial, tangent);
        let (sine, cosine) = (libm::sinf(arc.sweep_rad), libm::cosf(arc.sweep_rad));
        let end_tangent = tangent.zip(radial, |tangent, radial| tangent * cosine - radial * sine);
        let end_radial = tangent.zip(radial, |tangent, radial| tangent * sine + radial * cosine);
        let acceleration = limits.acceleration_along(&shares);
        let limit_sqr = acceleration * arc.radius_mm;
        let length_mm = arc.radius_mm * arc.sweep_rad;
        let steps_per_mm = shares.zip(limits.steps_per_mm, |share, steps| share * steps);
        let [radial_of_motors, tangent_of_motors, end_of_motors] =
            [radial, tangent, end_tangent].map(|direction| limits.motors_of(direction));
        let circle = self.spatial_arc(arc, &tangent_of_motors, &radial_of_motors, &end_of_motors);
        let reversals = circle
            .reversals
            .iter()
            .filter(|part| **part != SpatialArc::NEVER);
        let shortest_s = Limits::shortest_corner_arc_s(reversals.count(), true);
        let limit_mm_s = limits.curve_mm_s(
            Limits::along(&limits.speed_mm_s, &shares),
            &steps_per_mm,
            limit_sqr,
            length_mm / shortest_s,
        );
        let (limit_mm_s, acceleration_mm_s2) = limits.of_corner_arc(
            &limits.corner_arc_jerk(&shares, arc.radius_mm, acceleration),
            (limit_mm_s, acceleration),
            arc.feed_rate,
            length_mm,
        );
        let sweep = f64::from(arc.sweep_rad) * PHASE_PER_RAD;
        Geometry {
            length_mm,
            steps_per_mm,
            tangents: [tangent, end_tangent].map(normalised),
            curvatures: if limits.limits_jerk_of_arcs() {
                [radial, end_radial].map(|radial| radial.map(|part| -part / arc.radius_mm))
            } else {
                [Axes::all(0.0); 2]
            },
            limit_mm_s,
            acceleration_mm_s2,
            curve: Some(Curve {
                phase: 0,
                sweep: sweep as i64,
                limit_sqr,
                mm_per_phase: (f64::from(length_mm) / sweep) as f32,
                shape: Shape::Spatial(circle),
            }),
        }
    }

    /// Returns the corner arc from the end of the last block, which a line without a step may have left
    /// short of the arc's start, to the same end. Its directions are no unit vectors then.
    ///
    /// The points are C·(cos φ - 1) + S·sin φ from the start. With b/2 less in C and b·cot(θ/2)/2 more in
    /// S, a part of the offset b is added that grows evenly, from none to b at the whole angle θ.
    fn begun_at_block_end(&self, arc: &CornerArc) -> CornerArc {
        let offset = linear_mm(&self.at.block_end, &self.at.position);
        if offset == [0.0; LINEAR] {
            return *arc;
        }
        let half_rad = 0.5 * arc.sweep_rad;
        let cotangent = libm::cosf(half_rad) / libm::sinf(half_rad);
        let [chord_sqr, extended_sqr] = [&self.at.position, &self.at.block_end].map(|from| {
            let chord = linear_mm(from, &arc.target);
            math::dot(&chord, &chord)
        });
        // The radius grows with the chord, so that the feed rate is kept.
        let ratio = math::sqrt(math::max(
            extended_sqr / math::max(chord_sqr, MIN_CHORD_SQR),
            1.0,
        ));
        let radius_mm = arc.radius_mm * ratio;
        let shifted = |direction: &[f32; LINEAR], part: f32| {
            core::array::from_fn(|axis| {
                (direction[axis] * arc.radius_mm + part * offset[axis]) / radius_mm
            })
        };
        CornerArc {
            radius_mm,
            radial: shifted(&arc.radial, -0.5),
            tangent: shifted(&arc.tangent, 0.5 * cotangent),
            ..*arc
        }
    }

    /// Returns the circle of a corner arc in steps, from one tangent to another.
    fn spatial_arc(
        &self,
        arc: &CornerArc,
        tangent: &Axes<f32>,
        radial: &Axes<f32>,
        end_tangent: &Axes<f32>,
    ) -> SpatialArc {
        let resolution = &self.limits.steps_per_mm;
        let finest = resolution
            .iter()
            .take(LINEAR)
            .fold(0.0, |a, b| math::max(a, *b));
        let greatest = tangent
            .zip(*radial, |a, b| math::sqrt(a * a + b * b))
            .iter()
            .fold(1.0, |a, b| math::max(a, *b));
        // Every coordinate is below two to the power of `exponent` steps, and in units of 2⁻³⁰ of that.
        let steps = math::max(arc.radius_mm * greatest * finest, 0.25);
        let exponent = (steps.to_bits() >> 23).cast_signed() - 126;
        let unit_steps = power_of_two(exponent - 30);
        let scale = arc.radius_mm / unit_steps;
        let scaled = |direction: &Axes<f32>| {
            core::array::from_fn(|axis| {
                let units = direction[axis] * resolution[axis] * scale;
                libm::roundf(units) as i32
            })
        };
        let reversal = |axis: usize| {
            // Within half a turn, an axis reverses once or not at all.
            if tangent[axis] * end_tangent[axis] >= 0.0 {
                return SpatialArc::NEVER;
            }
            let angle = libm::atanf(tangent[axis] / radial[axis]);
            let angle = if angle < 0.0 { angle + PI } else { angle };
            let part = math::min(angle / arc.sweep_rad, 1.0) * f32::from(SpatialArc::NEVER);
            part as u16
        };
        let [first, second, third] = [X, Y, Z].map(reversal);
        let (first, second) = (first.min(second), first.max(second));
        let (second, third) = (second.min(third), second.max(third));
        let (first, second) = (first.min(second), first.max(second));
        SpatialArc {
            cosine: scaled(radial),
            sine: scaled(tangent),
            shift: (exponent + 2).clamp(0, 30) as u8,
            per_mm: unit_steps / arc.radius_mm,
            reversals: [first, second, third],
        }
    }
}

/// Returns a direction of the linear axes as one of all axes.
pub(in crate::path) fn to_axes(direction: &[f32; LINEAR]) -> Axes<f32> {
    Axes::from_fn(|axis| direction.get(axis).copied().unwrap_or(0.0))
}

/// Returns the unit vector of a direction; a direction whose length is nearly 1 stays unchanged.
fn normalised(direction: Axes<f32>) -> Axes<f32> {
    let square = math::dot(&direction.0, &direction.0);
    if (square - 1.0).abs() < 1.0e-5 {
        return direction;
    }
    let length = math::sqrt(square);
    direction.map(|part| part / length)
}

/// Returns 2 to a power from -126 to 127.
fn power_of_two(power: i32) -> f32 {
    f32::from_bits(((power + 127).clamp(1, 254).unsigned_abs()) << 23)
}
