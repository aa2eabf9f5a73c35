//! Blocks of arcs and helices in the plane of two axes.

use core::f64::consts::SQRT_2;

use super::{Geometry, Limits, Router, arc_jerk::ArcJerk, linear_length};
use crate::{
    axis::Axes,
    math,
    model::{Circle, FeedRate, Plane, Target},
    path::{
        Block, Curve, Shape,
        arc::{Arc, PHASE_PER_RAD},
    },
    units::{FineSteps, Nm},
};

/// Shortest time for an arc, s, and for each of its quarter turns: an arc has a segment more for every
/// axis that reverses. The limits of segments per second that hold for lines, too, are in the
/// look-ahead; `tests/motion/segments.rs` measures both.
pub(super) const MIN_ARC_S: f32 = 3.0e-3;
const MIN_QUADRANT_S: f32 = 1.5e-3;
/// An eighth of a turn as a phase.
const EIGHTH_TURN: u32 = 1 << 29;

impl Router {
    /// The block of an arc; `None` for an arc that makes no step and is shorter than half a step in its
    /// plane.
    #[inline(never)]
    pub(super) fn arc_block(
        &mut self,
        target: &Target,
        circle: &Circle,
        feed_rate: FeedRate,
        line: u32,
    ) -> Option<Block> {
        if self.limits.is_core_xy && circle.plane != Plane::Xy {
            // The session has made chords of it.
            return self.rare_line_block(target, feed_rate, line);
        }
        let (first, second, _) = circle.plane.axes();
        let to_target = target.position.zip(self.at.position, |to, from| to - from);
        let offset = self
            .at
            .position
            .zip(self.at.block_end, |to, from| to - from);
        let finest = self.limits.steps_per_mm[first].max(self.limits.steps_per_mm[second])
            * self.limits.motors_per_axis();
        let arc = Arc::new(circle, [to_target[first], to_target[second]]).begun_before(
            circle,
            [offset[first], offset[second]],
            f64::from(finest),
        );
        if arc.length_mm() as f32 * finest < 0.5 {
            // The displacement of the other axes is a line.
            return self.rare_line_block(target, feed_rate, line);
        }
        let end = self.block_end(target);
        #[cfg(arc_machine)]
        let (arc, steps) = self.step_arc(arc, target, circle);
        let geometry = self.arc_geometry(&arc, [first, second], &target.position, feed_rate);
        #[cfg(arc_machine)]
        let geometry = geometry.with_steps(steps);
        Some(self.block(target.position, end, &geometry, feed_rate, line))
    }

    fn arc_geometry(
        &self,
        arc: &Arc,
        axes: [usize; 2],
        target: &Axes<Nm>,
        feed_rate: FeedRate,
    ) -> Geometry {
        let [first, second] = axes;
        let limits = &self.limits;
        let displacement = target.zip(self.at.block_end, |to, from| (to - from).to_mm());
        let displacement = with_plane(displacement, axes, [0.0; 2]);
        let plane_mm = arc.length_mm() as f32;
        let linear_mm = linear_length(&displacement);
        let length_mm = math::sqrt(plane_mm * plane_mm + linear_mm * linear_mm);
        let plane_share = plane_mm / length_mm;
        let direction = displacement.map(|distance| distance / length_mm);
        // Any direction in the plane occurs: the axes share the smaller of their limits.
        let motors_per_axis = limits.motors_per_axis();
        let in_plane =
            |of_motors: &Axes<f32>| of_motors[first].min(of_motors[second]) / motors_per_axis;
        let acceleration =
            in_plane(&limits.acceleration_mm_s2).min(limits.acceleration_along(&direction));
        let limit_sqr = acceleration * arc.tightest_mm() as f32 / (plane_share * plane_share);
        let axes_mm_s = (in_plane(&limits.speed_mm_s) / plane_share)
            .min(Limits::along(&limits.speed_mm_s, &direction));
        let steps_per_mm = with_plane(direction, axes, [plane_share * motors_per_axis; 2])
            .zip(limits.steps_per_mm, |share, steps| share * steps);
        let shortest_time_mm_s = length_mm / shortest_s(arc);
        let limit_mm_s = limits.curve_mm_s(axes_mm_s, &steps_per_mm, limit_sqr, shortest_time_mm_s);
        let plane_share = f64::from(plane_share);
        let ends = [0, 1].map(|end| ArcJerk {
            acceleration_mm_s2: acceleration,
            jerk_mm_s3: in_plane(&limits.jerk_mm_s3),
            curvature_per_mm: plane_share * plane_share * arc.curvature(end),
        });
        let (limit_mm_s, acceleration) = limits.of_arc(
            &ends,
            (limit_mm_s, acceleration),
            feed_rate,
            (length_mm, arc.sweep),
        );
        let ratio = arc.limit_ratio() as f32;
        Geometry {
            length_mm,
            steps_per_mm,
            tangents: [0, 1].map(|end| {
                let tangent = arc
                    .tangent(end)
                    .map(|part| part as f32 * plane_share as f32);
                with_plane(direction, axes, tangent)
            }),
            curvatures: if limits.limits_jerk_of_arcs() {
                [0, 1].map(|end| {
                    let curvature_per_mm = ends[usize::from(end)].curvature_per_mm;
                    let inwards = arc
                        .inwards(end)
                        .map(|part| (part * curvature_per_mm) as f32);
                    with_plane(Axes::all(0.0), axes, inwards)
                })
            } else {
                [Axes::all(0.0); 2]
            },
            limit_mm_s: limit_mm_s * ratio,
            acceleration_mm_s2: acceleration * ratio,
            curve: Some(self.curve(arc, axes, limit_sqr, length_mm)),
        }
    }

    fn curve(&self, arc: &Arc, axes: [usize; 2], limit_sqr: f32, length_mm: f32) -> Curve {
        let mut phase = libm::round(arc.start * PHASE_PER_RAD) as i64 as u32;
        let mut sweep = libm::round(arc.sweep * PHASE_PER_RAD) as i64;
        let [mut start, mut end] = arc.radius;
        if self.limits.is_core_xy {
            // r (cos φ + sin φ, cos φ - sin φ) = √2 r (cos ψ, sin ψ) with ψ = 45° - φ.
            phase = EIGHTH_TURN.wrapping_sub(phase);
            sweep = -sweep;
            [start, end] = arc.radius.map(|radius| SQRT_2 * radius);
        }
        let fine = |axis: usize, mm: f64| {
            let steps_per_mm = self.settings.steps_per_mm[axis].millionths() as f64 * 1.0e-6;
            libm::round(mm * steps_per_mm * FineSteps::ONE as f64) as i64
        };
        Curve {
            phase,
            sweep,
            limit_sqr,
            mm_per_phase: (f64::from(length_mm) / (libm::fabs(arc.sweep) * PHASE_PER_RAD)) as f32,
            shape: Shape::Planar {
                first: axes[0] as u8,
                second: axes[1] as u8,
                radius: axes.map(|axis| fine(axis, start)),
                radius_delta: axes.map(|axis| fine(axis, end - start)),
            },
        }
    }
}

/// Returns the shortest time for an arc, s.
fn shortest_s(arc: &Arc) -> f32 {
    let turns = (libm::fabs(arc.sweep) / core::f64::consts::TAU) as f32;
    MIN_ARC_S.max(4.0 * turns * MIN_QUADRANT_S)
}

/// Returns a vector with the components of two axes replaced.
fn with_plane(mut vector: Axes<f32>, axes: [usize; 2], components: [f32; 2]) -> Axes<f32> {
    for (axis, component) in axes.into_iter().zip(components) {
        vector[axis] = component;
    }
    vector
}
