//! Kinematics of a block: displacement and speed of each axis at a point of it.
//!
//! # Cost
//!
//! Circles in any plane are out of line, so that flat arcs cost what they would without them.

use super::limits::TICKS_PER_S;
use crate::{
    axis::Axes,
    math::{self, WHOLE_Q31},
    path::{Block, Curve, Shape, SpatialArc},
};

/// A block and its curve: code compiled for lines, without a curve, does not test for one.
#[derive(Clone, Copy)]
pub(super) struct BlockGeometry<'a> {
    pub(super) block: &'a Block,
    pub(super) curve: Option<&'a Curve>,
}

impl Block {
    /// The block, with its curve if it has one.
    #[inline]
    pub(super) const fn geometry(&self) -> BlockGeometry<'_> {
        BlockGeometry {
            block: self,
            curve: self.curve.as_ref(),
        }
    }
}

/// The direction from the centre of an arc to a point of it, times 2³⁰.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction {
    cosine: i32,
    sine: i32,
}

impl Direction {
    /// Of a line.
    pub(super) const NONE: Self = Self { cosine: 0, sine: 0 };

    pub(super) fn at(phase: u32) -> Self {
        let (cosine, sine) = math::cos_sin(phase);
        Self { cosine, sine }
    }
}

/// Angle seen from the centre where a part of the arc is done.
pub(super) fn phase_at(curve: &Curve, done: u32) -> u32 {
    curve
        .phase
        .wrapping_add(math::scale_q31(curve.sweep, done) as u32)
}

/// The displacement of each axis from the block's start to where the part `done` of it is done, steps
/// with 32 binary places.
#[inline]
pub(super) fn displacement_at(
    geometry: BlockGeometry<'_>,
    done: u32,
    begin: Direction,
    here: Direction,
) -> Axes<i64> {
    if let Some(curve) = geometry.curve
        && let Shape::Spatial(circle) = &curve.shape
        && done != WHOLE_Q31
    {
        return circle_displacement(circle, here);
    }
    let delta = &geometry.block.delta;
    let mut displacement = delta.map(|delta| math::scale_q31(delta, done));
    if let Some(curve) = geometry.curve
        && let Shape::Planar {
            first,
            second,
            radius: [first_radius, second_radius],
            radius_delta: [first_change, second_change],
        } = &curve.shape
        && done != WHOLE_Q31
    {
        let along = |radius: i64, change: i64, begin: i32, here: i32| {
            let reached = radius.wrapping_add(math::scale_q31(change, done));
            math::scale_q30(reached, here).wrapping_sub(math::scale_q30(radius, begin))
        };
        let (begin_1, here_1) = (begin.cosine, here.cosine);
        set_axis(
            &mut displacement,
            *first,
            along(*first_radius, *first_change, begin_1, here_1),
        );
        let (begin_2, here_2) = (begin.sine, here.sine);
        set_axis(
            &mut displacement,
            *second,
            along(*second_radius, *second_change, begin_2, here_2),
        );
    }
    displacement
}

/// The displacement of each axis from the start of a circle in any plane.
#[inline(never)]
fn circle_displacement(circle: &SpatialArc, here: Direction) -> Axes<i64> {
    // From -2³¹ to 0.
    let done = here.cosine.wrapping_sub(math::ONE_Q30);
    let unit = 1_i32.wrapping_shl(u32::from(circle.shift));
    let product = |a: i32, b: i32| i64::from(a) * i64::from(b);
    Axes::from_fn(
        |axis| match (circle.cosine.get(axis), circle.sine.get(axis)) {
            (Some(outwards), Some(along)) => {
                let units = product(*outwards, done).wrapping_add(product(*along, here.sine));
                product((units >> 30) as i32, unit)
            }
            _ => 0,
        },
    )
}

/// Speed of each axis at a point of the block, steps per tick.
#[inline]
pub(super) fn axis_speeds(
    geometry: BlockGeometry<'_>,
    here: Direction,
    speed_mm_s: f32,
) -> Axes<f32> {
    let speed = speed_mm_s * (1.0 / TICKS_PER_S);
    let mut speeds = geometry.block.steps_per_mm.map(|steps| steps * speed);
    if let Some(curve) = geometry.curve {
        match &curve.shape {
            Shape::Planar { first, second, .. } => {
                let sign = if curve.sweep > 0 { 1.0 } else { -1.0 };
                let scale = sign / math::ONE_Q30 as f32;
                scale_axis(&mut speeds, *first, -here.sine as f32 * scale);
                scale_axis(&mut speeds, *second, here.cosine as f32 * scale);
            }
            Shape::Spatial(circle) => return circle_speeds(circle, here, speed),
            Shape::WholeSteps(_) => {}
        }
    }
    speeds
}

/// Speed of each axis at a point of a circle in any plane; `speed` in mm per tick.
#[inline(never)]
fn circle_speeds(circle: &SpatialArc, here: Direction, speed: f32) -> Axes<f32> {
    let speed = speed * circle.per_mm * (1.0 / math::ONE_Q30 as f32);
    let (cosine, sine) = (here.cosine as f32 * speed, here.sine as f32 * speed);
    Axes::from_fn(
        |axis| match (circle.cosine.get(axis), circle.sine.get(axis)) {
            (Some(outwards), Some(along)) => *along as f32 * cosine - *outwards as f32 * sine,
            _ => 0.0,
        },
    )
}

fn set_axis(axes: &mut Axes<i64>, axis: u8, value: i64) {
    if let Some(entry) = axes.0.get_mut(usize::from(axis)) {
        *entry = value;
    }
}

fn scale_axis(axes: &mut Axes<f32>, axis: u8, factor: f32) {
    if let Some(entry) = axes.0.get_mut(usize::from(axis)) {
        *entry *= factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::AXES;

    #[test]
    fn on_a_circle_in_space_speeds_have_the_direction_of_the_displacement() {
        const STEP: u32 = 1 << 20;
        let circle = SpatialArc {
            cosine: [1 << 28, -(1 << 27), 1 << 26],
            sine: [1 << 26, 1 << 28, 1 << 27],
            shift: 8,
            per_mm: 1.0,
            reversals: [SpatialArc::NEVER; 3],
        };
        for phase in (0..24).map(|part| part * (u32::MAX / 24)) {
            let [before, after] = [phase.wrapping_sub(STEP), phase.wrapping_add(STEP)]
                .map(|phase| circle_displacement(&circle, Direction::at(phase)));
            let moved: [f64; AXES] =
                core::array::from_fn(|axis| (after[axis] - before[axis]) as f64);
            let speeds = circle_speeds(&circle, Direction::at(phase), 1.0);
            let speeds: [f64; AXES] = speeds.0.map(f64::from);
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let cosine = product(&moved, &speeds)
                / (product(&moved, &moved) * product(&speeds, &speeds)).sqrt();
            assert!(cosine > 0.9999, "{phase:#x}: {moved:?}, {speeds:?}");
        }
    }
}
