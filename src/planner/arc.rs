//! The geometry of an arc in its plane: radii, angles, length, tangents.
//!
//! In double precision, once per arc, in the task that has no deadline.

use super::{Circle, Rotation};
use crate::units::Nm;

/// 2³² phases to the turn.
pub(super) const PHASE_PER_RAD: f64 = 4_294_967_296.0 / core::f64::consts::TAU;

/// Largest part of the radius by which an arc is bent to begin where the move before it ended.
const LARGEST_PART: f64 = 0.05;

/// An arc in its plane, in double precision.
pub(super) struct Arc {
    /// Radius at the start and at the end, mm.
    pub(super) radius: [f64; 2],
    /// Angle of the start seen from the centre, rad.
    pub(super) start: f64,
    /// Angle travelled, rad, positive counter-clockwise.
    pub(super) sweep: f64,
}

impl Arc {
    pub(super) fn new(circle: &Circle, way_first: Nm, way_second: Nm) -> Self {
        let [x0, y0] = circle.centre.map(|centre| -centre.to_mm_f64());
        let x1 = (way_first - circle.centre[0]).to_mm_f64();
        let y1 = (way_second - circle.centre[1]).to_mm_f64();
        let is_closed = way_first == Nm(0) && way_second == Nm(0);
        let travel = if is_closed {
            0.0
        } else {
            libm::atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
        };
        let turns = core::f64::consts::TAU * f64::from(circle.turns.saturating_sub(1));
        let sweep = match circle.rotation {
            Rotation::CounterClockwise if travel > 0.0 => travel + turns,
            Rotation::CounterClockwise => travel + core::f64::consts::TAU + turns,
            Rotation::Clockwise if travel < 0.0 => travel - turns,
            Rotation::Clockwise => travel - core::f64::consts::TAU - turns,
        };
        Self {
            radius: [libm::hypot(x0, y0), libm::hypot(x1, y1)],
            start: libm::atan2(y0, x0),
            sweep,
        }
    }

    /// The same arc from a start that lies behind its own by a way shorter than a step.
    ///
    /// Where that way is no small part of the radius, the arc stays as it is, moved by that way: as a
    /// spiral it would be begun faster than the axes allow, because its angle grows evenly.
    pub(super) fn begun_at(self, circle: &Circle, behind_first: Nm, behind_second: Nm) -> Self {
        if behind_first == Nm(0) && behind_second == Nm(0) {
            return self;
        }
        let [x0, y0] = circle.centre.map(|centre| -centre.to_mm_f64());
        let behind = [behind_first, behind_second].map(Nm::to_mm_f64);
        if libm::hypot(behind[0], behind[1]) > LARGEST_PART * self.radius[0] {
            return self;
        }
        let (x, y) = (x0 - behind[0], y0 - behind[1]);
        Self {
            radius: [libm::hypot(x, y), self.radius[1]],
            start: libm::atan2(y, x),
            sweep: self.sweep + libm::atan2(x * y0 - y * x0, x * x0 + y * y0),
        }
    }

    /// Length of the path, mm: to the square of the difference of the radii, which is tiny.
    pub(super) fn length_mm(&self) -> f64 {
        libm::fabs(self.sweep) * 0.5 * (self.radius[0] + self.radius[1])
    }

    /// Unit tangent at the start (0) or the end (1).
    pub(super) fn tangent(&self, end: u8) -> [f64; 2] {
        let angle = self.start + self.sweep * f64::from(end);
        let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
        if self.sweep > 0.0 {
            [-sine, cosine]
        } else {
            [sine, -cosine]
        }
    }

    /// Unit vector towards the centre at the start (0) or the end (1).
    pub(super) fn inwards(&self, end: u8) -> [f64; 2] {
        let angle = self.start + self.sweep * f64::from(end);
        [-libm::cos(angle), -libm::sin(angle)]
    }
}
