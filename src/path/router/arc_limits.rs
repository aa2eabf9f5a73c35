//! What limits of jerk make of arcs: see [`Bend`].

use super::Limits;
use crate::{
    axis::Axes,
    math,
    path::{
        arc::Arc,
        arc_jerk::{Bend, jump_sqr},
    },
};

/// Greatest feed override.
const FASTEST_FEED: f32 = 2.0;

/// Where an arc lies.
pub(super) struct ArcPlane {
    /// The axes of its plane.
    pub(super) axes: [usize; 2],
    /// The part of its length that is in the plane.
    pub(super) flat: f32,
}

impl ArcPlane {
    pub(super) fn new(axes: [usize; 2], flat: f32) -> Self {
        Self { axes, flat }
    }

    /// The tangent of an arc that leads along a direction besides, from its unit tangent in the plane.
    pub(super) fn tangent(&self, mut direction: Axes<f32>, [x, y]: [f64; 2]) -> Axes<f32> {
        let [first, second] = self.axes;
        direction[first] = x as f32 * self.flat;
        direction[second] = y as f32 * self.flat;
        direction
    }
}

impl Limits {
    /// Limit of the squared speed where the curvature changes by so much, (mm/s)².
    pub(super) fn bend_sqr(&self, change_per_mm: &Axes<f32>) -> f32 {
        let square: f32 = change_per_mm.iter().map(|change| change * change).sum();
        if self.window.samples == 0 || square <= 0.0 {
            return f32::MAX;
        }
        let per_mm = math::sqrt(square);
        jump_sqr(
            per_mm,
            per_mm * Self::along(&self.jerk_mm_s3, change_per_mm),
        )
    }

    /// The curvature at both ends of an arc, 1/mm, the greatest speed on it, and the acceleration along
    /// it, from those without a limit of jerk. What the feed rate asks for is told for a greatest speed.
    pub(super) fn bent(
        &self,
        arc: &Arc,
        plane: &ArcPlane,
        mut rate: f32,
        mut acceleration: f32,
        pace_mm_s: impl Fn(f32) -> f32,
    ) -> ([Axes<f32>; 2], f32, f32) {
        let mut curvatures = [Axes::all(0.0); 2];
        if self.window.samples == 0 {
            return (curvatures, rate, acceleration);
        }
        let bends = [0, 1].map(|end| self.bend(arc, plane, end, acceleration));
        for (end, bend) in (0..).zip(&bends) {
            let inwards = arc.inwards(end);
            for (axis, part) in plane.axes.into_iter().zip(inwards) {
                curvatures[usize::from(end)][axis] = (part * bend.per_mm) as f32;
            }
            rate = rate.min(bend.speed_mm_s());
        }
        // As fast as it may become under overrides.
        let fastest = rate.min(FASTEST_FEED * pace_mm_s(rate));
        for bend in &bends {
            acceleration = acceleration.min(bend.along_mm_s2(fastest, self.window));
        }
        (curvatures, rate, acceleration)
    }

    /// The same of an arc that has these shares of the axes at most, of one radius.
    pub(super) fn bent_round(
        &self,
        shares: &Axes<f32>,
        radius_mm: f32,
        mut rate: f32,
        mut acceleration: f32,
        pace_mm_s: impl Fn(f32) -> f32,
    ) -> (f32, f32) {
        if self.window.samples != 0 {
            let bend = self.round_bend(shares, radius_mm, acceleration);
            rate = rate.min(bend.speed_mm_s());
            let fastest = rate.min(FASTEST_FEED * pace_mm_s(rate));
            acceleration = acceleration.min(bend.along_mm_s2(fastest, self.window));
        }
        (rate, acceleration)
    }

    /// The greatest squared speed into and round such an arc, (mm/s)².
    pub(crate) fn round_sqr(&self, shares: &Axes<f32>, radius_mm: f32, acceleration: f32) -> f32 {
        if self.window.samples == 0 {
            return acceleration * radius_mm;
        }
        let bend = self.round_bend(shares, radius_mm, acceleration);
        let steady_mm_s = bend.speed_mm_s();
        math::min(
            steady_mm_s * steady_mm_s,
            jump_sqr(bend.per_mm as f32, bend.jerk_mm_s3),
        )
    }

    fn round_bend(&self, shares: &Axes<f32>, radius_mm: f32, acceleration_mm_s2: f32) -> Bend {
        Bend {
            acceleration_mm_s2,
            jerk_mm_s3: Self::along(&self.jerk_mm_s3, shares),
            per_mm: 1.0 / f64::from(radius_mm),
        }
    }

    /// An end (0 or 1) of an arc.
    fn bend(&self, arc: &Arc, plane: &ArcPlane, end: u8, acceleration_mm_s2: f32) -> Bend {
        let [first, second] = plane.axes;
        let flat = f64::from(plane.flat);
        Bend {
            acceleration_mm_s2,
            jerk_mm_s3: math::min(self.jerk_mm_s3[first], self.jerk_mm_s3[second]),
            per_mm: flat * flat * arc.curvature(end),
        }
    }
}
