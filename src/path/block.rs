//! What waits in the look-ahead.

use crate::{
    axis::Axes,
    math,
    model::{Alarm, Coolant, Laser, Overrides, Probing, Spindle},
    settings::Settings,
};

/// One entry of the queue from `interpret` to `prepare`.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Resets and cuts after which it was made, `epoch` plus `cuts` of the snapshot: an older entry
    /// is dropped.
    pub reset_count: u32,
    /// What to do.
    pub work: Work,
}

/// What an entry asks for.
///
/// With a whole word for the variant: what follows is copied by words.
#[derive(Debug, Clone, Copy)]
#[repr(u32)]
pub enum Work {
    /// A move along a line or an arc.
    Move(Block),
    /// Standstill, ms.
    Dwell(u32),
    /// A probing move. Finished when the machine is at rest again.
    Probe(Block, Probing),
    /// A state of the spindle and its speed, rpm.
    Spindle(Spindle, f32),
    /// A state of the coolant.
    Coolant(Coolant),
    /// Wait for cycle start.
    Pause,
    /// Leave the alarm state.
    Unlock,
    /// Home these axes together, bit 0 = X; 0 homes all, Z first. Finished when done or failed.
    Home(u8),
    /// Enter check mode; a reset leaves it.
    Check,
    /// Switch everything off until a reset.
    Sleep,
    /// Slow down, then lock the machine with this alarm: a target is outside the travel.
    Fault(Alarm),
    /// All overrides back to 100 %.
    EndOverrides,
    /// New settings. Sent at rest only; the machine stays at its whole steps.
    Configure(Settings),
}

/// Which limits and overrides a move is under.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum MoveKind {
    /// As fast as the axes can, under the rapid override.
    Rapid,
    /// At the programmed feed, under the feed override.
    #[default]
    Feed,
    /// At the programmed feed, under no override: probing.
    Fixed,
    /// As `Fixed`; ended by a hold: jogging.
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
    /// Speed along the path under the overrides in effect, within every axis limit, mm/s.
    pub nominal_mm_s: f32,
    /// Programmed speed along the path, mm/s; without meaning for a rapid.
    pub programmed_mm_s: f32,
    /// Greatest speed along the path that the axes allow, mm/s.
    pub limit_mm_s: f32,
    /// Which overrides it is under.
    pub kind: MoveKind,
    /// What the laser does.
    pub laser: Laser,
    /// Acceleration along the path within every axis limit, mm/s².
    pub acceleration_mm_s2: f32,
    /// Limit of the squared speed where it joins the block before, (mm/s)².
    pub junction_sqr: f32,
    /// The circle, for an arc.
    pub curve: Option<Curve>,
    /// `N` word of its line, 0 without.
    pub line: u32,
}

/// Slowest speed along the path, mm/s: 1 mm/min, as in Grbl.
pub(crate) const MIN_SPEED_MM_S: f32 = 1.0 / 60.0;

impl Block {
    /// Speed along the path under overrides, within every axis limit, mm/s.
    #[must_use]
    pub fn nominal_under(&self, overrides: Overrides) -> f32 {
        let speed_mm_s = match self.kind {
            MoveKind::Rapid => self.limit_mm_s * (0.01 * f32::from(overrides.rapid)),
            MoveKind::Feed => self.programmed_mm_s * (0.01 * f32::from(overrides.feed)),
            MoveKind::Fixed | MoveKind::Jog => self.programmed_mm_s,
        };
        math::min(math::max(speed_mm_s, MIN_SPEED_MM_S), self.limit_mm_s)
    }
}

/// The curved part of an arc, a helix or a rounded corner.
#[derive(Debug, Clone, Copy)]
pub struct Curve {
    /// Angle of the start seen from the centre, 2³² to the turn.
    pub phase: u32,
    /// Angle travelled, 2³² to the turn, positive counter-clockwise.
    pub sweep: i64,
    /// Squared speed at which the centripetal acceleration is all that the axes allow, (mm/s)².
    pub limit_sqr: f32,
    /// Path length of one 2³²th of a turn, mm.
    pub mm_per_phase: f32,
    /// Where its points are.
    pub shape: Shape,
}

/// The points of a curve by their angle.
#[derive(Debug, Clone, Copy)]
pub enum Shape {
    /// In the plane of two axes; the other axes move evenly.
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
    /// In any plane of the linear axes, from phase 0 on, less than a half turn.
    Spatial(SpatialArc),
}

/// A circle in any plane: from its centre, a point is at `cosine`·cos + `sine`·sin of its angle.
#[derive(Debug, Clone, Copy)]
pub struct SpatialArc {
    /// Radius towards the start, in steps with 32 - `shift` binary places.
    pub cosine: [i32; 3],
    /// Radius a quarter turn from the start.
    pub sine: [i32; 3],
    /// Binary places that these have less than 32: 0 to 30.
    pub shift: u8,
    /// Steps per mm of path of one unit of these.
    pub per_mm: f32,
    /// Where an axis reverses, ascending, as parts of the angle travelled, 2¹⁶ for all of it;
    /// [`Oblique::NEVER`] for nowhere.
    pub reversals: [u16; 3],
}

// What is copied by words and not by a loop in a library: see `Planned::hold`.
const _: () = assert!(size_of::<Option<Curve>>() <= 64);

impl SpatialArc {
    /// No place on the curve.
    pub const NEVER: u16 = u16::MAX;
}

impl Curve {
    /// Pieces between two reversals of an axis, at least.
    #[must_use]
    pub fn inner_sections(&self) -> u32 {
        match &self.shape {
            Shape::Planar { .. } => (self.sweep.unsigned_abs() >> 30) as u32,
            Shape::Spatial(circle) => {
                let [_, second, third] = circle.reversals;
                u32::from(second != SpatialArc::NEVER) + u32::from(third != SpatialArc::NEVER)
            }
        }
    }
}
