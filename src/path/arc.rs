//! The geometry of an arc in its plane: radii, angles, length, tangents.
//!
//! In double precision, once per arc, in the task that has no deadline.

use crate::{
    model::{Circle, Rotation},
    units::Nm,
};

/// 2³² phases to the turn.
pub(super) const PHASE_PER_RAD: f64 = 4_294_967_296.0 / core::f64::consts::TAU;

/// Parts of the radius behind which an arc can begin that becomes a spiral: a small one; or a great one,
/// if it is no more than these steps of either axis.
const LITTLE_BEHIND: f64 = 0.05;
const FARTHEST_BEHIND: f64 = 2.0;
const FARTHEST_STEPS: f64 = 1.5;
/// How much more than the mean a spiral's radius may be, and its growth count for, until that matters.
const UNEVEN: f64 = 1.01;

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

    /// The same arc, as a spiral, from a start that lies behind its own by a way shorter than a step,
    /// in nm and of axes with so many steps/mm at most.
    ///
    /// One that is smaller than that way, or bends one axis by the coarser steps of the other, stays as
    /// it is, moved by that way.
    pub(super) fn begun_at(self, circle: &Circle, behind: [Nm; 2], steps_per_mm: f64) -> Self {
        if behind == [Nm(0); 2] {
            return self;
        }
        let behind = behind.map(Nm::to_mm_f64);
        let behind_mm = libm::hypot(behind[0], behind[1]);
        let is_bent = behind_mm <= LITTLE_BEHIND * self.radius[0]
            || behind_mm <= FARTHEST_BEHIND * self.radius[0]
                && behind_mm * steps_per_mm <= FARTHEST_STEPS;
        if !is_bent {
            return self;
        }
        let [x0, y0] = circle.centre.map(|centre| -centre.to_mm_f64());
        let (x, y) = (x0 - behind[0], y0 - behind[1]);
        Self {
            radius: [libm::hypot(x, y), self.radius[1]],
            start: libm::atan2(y, x),
            sweep: self.sweep + libm::atan2(x * y0 - y * x0, x * x0 + y * y0),
        }
    }

    /// Growth of the radius, mm/rad.
    fn growth(&self) -> f64 {
        (self.radius[1] - self.radius[0]) / self.sweep
    }

    fn mean_mm(&self) -> f64 {
        0.5 * (self.radius[0] + self.radius[1])
    }

    /// The part that a limit on a circle of the mean radius leaves for the spiral: its angle grows
    /// evenly, so that the axes are faster than the mean where the radius is great or grows.
    ///
    /// With the angle's speed w, the radius r and its growth c, the speed is w·√(r² + c²) and the
    /// acceleration w²·√(r² + 4c²).
    pub(super) fn evenness(&self) -> f64 {
        let greatest = self.radius[0].max(self.radius[1]);
        let most = libm::hypot(greatest, 2.0 * self.growth());
        let mean = self.mean_mm();
        if most < UNEVEN * mean {
            1.0
        } else {
            mean / most
        }
    }

    fn is_spiral(&self) -> bool {
        self.evenness() < 1.0
    }

    /// The radius of a circle on which the same speed of the mean asks for as much acceleration, mm.
    pub(super) fn tightest_mm(&self) -> f64 {
        if self.is_spiral() {
            self.mean_mm() * self.evenness()
        } else {
            self.radius[0].min(self.radius[1])
        }
    }

    /// The curvature at the start (0) or the end (1), 1/mm.
    pub(super) fn curvature(&self, end: u8) -> f64 {
        let radius = self.radius[usize::from(end)];
        if !self.is_spiral() {
            return 1.0 / radius;
        }
        let growth = self.growth();
        let (radius_sqr, growth_sqr) = (radius * radius, growth * growth);
        let speed_sqr = radius_sqr + growth_sqr;
        (radius_sqr + 2.0 * growth_sqr) / (speed_sqr * libm::sqrt(speed_sqr))
    }

    /// Length of the path, mm: to the square of the growth of its radius.
    pub(super) fn length_mm(&self) -> f64 {
        libm::fabs(self.sweep) * self.mean_mm()
    }

    /// Unit tangent at the start (0) or the end (1).
    pub(super) fn tangent(&self, end: u8) -> [f64; 2] {
        let angle = self.start + self.sweep * f64::from(end);
        let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
        let mut tangent = [-sine, cosine];
        if self.is_spiral() {
            let (radius, growth) = (self.radius[usize::from(end)], self.growth());
            let speed = libm::hypot(radius, growth);
            tangent = [
                (growth * cosine - radius * sine) / speed,
                (growth * sine + radius * cosine) / speed,
            ];
        }
        tangent.map(|part| if self.sweep > 0.0 { part } else { -part })
    }

    /// Unit vector towards the centre at the start (0) or the end (1).
    pub(super) fn inwards(&self, end: u8) -> [f64; 2] {
        let angle = self.start + self.sweep * f64::from(end);
        [-libm::cos(angle), -libm::sin(angle)]
    }
}
