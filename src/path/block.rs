//! Blocks: the moves of the look-ahead queue, in steps and mm.

use super::programmed_speed::nominal_mm_s;
use crate::{
    axis::Axes,
    model::{Laser, Overrides},
    stepper::StepArc,
};

/// The kind of a move: its speed, its overrides, its end at a feed hold.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum MoveKind {
    /// As fast as the axes can, under the rapid override.
    Rapid,
    /// At the programmed feed rate, under the feed override.
    #[default]
    Feed,
    /// At the programmed feed rate, under no override: probing.
    Fixed,
    /// As `Fixed`; a feed hold ends it: jogging.
    Jog,
}

/// A move: its geometry in steps and mm, its limits along the path.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    /// End minus start of each axis, in steps with 32 binary places.
    pub delta: Axes<i64>,
    /// Steps of each axis per mm of path; for the axes of an arc's plane, at a right angle to the
    /// radius.
    pub steps_per_mm: Axes<f32>,
    /// Length of the path, mm; degrees where only rotary axes move.
    pub length_mm: f32,
    /// Nominal speed: along the path under the overrides in effect, within every axis limit, mm/s.
    pub nominal_mm_s: f32,
    /// Programmed speed along the path, mm/s; [`Self::limit_mm_s`] for a rapid.
    pub programmed_mm_s: f32,
    /// Greatest speed along the path that the axes allow, mm/s.
    pub limit_mm_s: f32,
    /// The kind of the move.
    pub kind: MoveKind,
    /// State of the laser.
    pub laser: Laser,
    /// Acceleration along the path within every axis limit, mm/s².
    pub acceleration_mm_s2: f32,
    /// Limit of the squared speed at the junction with the block before, (mm/s)².
    pub junction_sqr: f32,
    /// The circle, for an arc.
    pub curve: Option<Curve>,
    /// `N` word of the line, 0 without one.
    pub line: u32,
}

impl Block {
    /// Returns the nominal speed under overrides, mm/s.
    #[inline]
    #[must_use]
    pub fn nominal_under(&self, overrides: Overrides) -> f32 {
        let speed_mm_s = match self.kind {
            MoveKind::Rapid => self.limit_mm_s * (0.01 * f32::from(overrides.rapid)),
            MoveKind::Feed => self.programmed_mm_s * (0.01 * f32::from(overrides.feed)),
            MoveKind::Fixed | MoveKind::Jog => self.programmed_mm_s,
        };
        nominal_mm_s(speed_mm_s, self.programmed_mm_s, self.limit_mm_s)
    }
}

/// The curved part of an arc, a helix or a rounded corner.
#[derive(Debug, Clone, Copy)]
pub struct Curve {
    /// Angle of the start seen from the centre, 2³² to the turn.
    pub phase: u32,
    /// Angle travelled, 2³² to the turn, positive counter-clockwise.
    pub sweep: i64,
    /// Squared speed at which the centripetal acceleration reaches the axes' limit, (mm/s)².
    pub limit_sqr: f32,
    /// Path length of a phase unit, 2⁻³² of a turn, mm.
    pub mm_per_phase: f32,
    /// Points of the curve by their angle.
    pub shape: Shape,
}

/// The points of a curve by their angle.
#[derive(Debug, Clone, Copy)]
pub enum Shape {
    /// An arc in the plane of two axes; the displacement of the others is proportional to the angle.
    Planar {
        /// First axis of the plane.
        first: u8,
        /// Second axis of the plane.
        second: u8,
        /// Radius at the start along both axes, in steps with 32 binary places.
        radius: [i64; 2],
        /// Radius at the end minus radius at the start.
        radius_delta: [i64; 2],
    },
    /// A corner arc in any plane of the linear axes, from phase 0, shorter than half a turn.
    Spatial(SpatialArc),
    /// An arc of whole steps in the plane of two axes, under `$790`; the displacement of the others is
    /// proportional to the angle.
    WholeSteps(StepArc),
}

/// A circle in any plane: a point at an angle φ is at `cosine`·cos φ + `sine`·sin φ from the centre.
#[derive(Debug, Clone, Copy)]
pub struct SpatialArc {
    /// Radius towards the start, in steps with 32 - `shift` binary places.
    pub cosine: [i32; 3],
    /// Radius a quarter turn from the start.
    pub sine: [i32; 3],
    /// 32 minus the binary places of `cosine` and `sine`: 0 to 30.
    pub shift: u8,
    /// Steps per mm of path of one unit of `cosine` and `sine`.
    pub per_mm: f32,
    /// Angles at which an axis reverses, ascending, in 2⁻¹⁶ of the angle travelled;
    /// [`Self::NEVER`] for none.
    pub reversals: [u16; 3],
}

// Copied by words, not by a library loop, up to this size.
const _: () = assert!(size_of::<Option<Curve>>() <= 64);

impl SpatialArc {
    /// No angle of the curve.
    pub const NEVER: u16 = u16::MAX;
}

impl Curve {
    /// Returns how many monotonic sections, from one reversal of an axis to the next, the curve contains
    /// at least.
    #[must_use]
    pub fn inner_sections(&self) -> u32 {
        match &self.shape {
            Shape::Planar { .. } | Shape::WholeSteps(_) => (self.sweep.unsigned_abs() >> 30) as u32,
            Shape::Spatial(arc) => {
                let [_, second, third] = arc.reversals;
                u32::from(second != SpatialArc::NEVER) + u32::from(third != SpatialArc::NEVER)
            }
        }
    }
}
