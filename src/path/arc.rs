//! The geometry of an arc in its plane: radii, angles, length, tangents, extremes.
//!
//! The radius changes in proportion to the angle, from that of the start to that of the end: a circle
//! whose centre is rounded, or an Archimedean spiral, r = a + cφ. Double precision, once per arc, in
//! the task without a deadline.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::{
    model::{Circle, Rotation},
    units::Nm,
};

/// Phase units per radian: 2³² to the turn.
pub(super) const PHASE_PER_RAD: f64 = 4_294_967_296.0 / TAU;

/// Greatest distance between the start of an arc and the end of the block before, as a part of its
/// radius, that becomes part of a spiral. Behind an arc of a smaller radius the end point is moved.
/// Bounds the acceleration in `tests/motion/arcs.rs`, `arcs_after_a_move_without_a_step_keep_the_limits`.
const SMALL_OFFSET: f64 = 0.05;
/// The same for an offset of [`FEW_STEPS`] steps of either axis at most.
const LARGE_OFFSET: f64 = 2.0;
const FEW_STEPS: f64 = 1.5;
/// Least travel of an axis to where it reverses, mm: coordinates are whole nm.
const LEAST_TRAVEL_MM: f64 = 2.0e-6;
/// Greatest ratio of the radius, growth included, to its mean up to which an arc counts as a circle: its
/// limits are exceeded by 1 % at most then.
const MAX_CIRCLE_RADIUS_RATIO: f64 = 1.01;

/// An arc in its plane.
pub(super) struct Arc {
    /// Radius at the start and at the end, mm.
    pub(super) radius: [f64; 2],
    /// Angle of the start seen from the centre, rad.
    pub(super) start: f64,
    /// Angle travelled, rad, positive counter-clockwise.
    pub(super) sweep: f64,
    /// Length of an arc in whole steps, mm.
    #[cfg(arc_machine)]
    pub(super) stepped_mm: Option<f64>,
}

impl Arc {
    /// The arc along a circle with a displacement of the end from the start in the plane.
    pub(super) fn new(circle: &Circle, displacement: [Nm; 2]) -> Self {
        let [x0, y0] = circle.centre.map(|centre| -centre.to_mm_f64());
        let x1 = (displacement[0] - circle.centre[0]).to_mm_f64();
        let y1 = (displacement[1] - circle.centre[1]).to_mm_f64();
        let angle = if displacement == [Nm(0); 2] {
            0.0
        } else {
            libm::atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
        };
        let full_turns = TAU * f64::from(circle.turns.saturating_sub(1));
        let sweep = match circle.rotation {
            Rotation::CounterClockwise if angle > 0.0 => angle + full_turns,
            Rotation::CounterClockwise => angle + TAU + full_turns,
            Rotation::Clockwise if angle < 0.0 => angle - full_turns,
            Rotation::Clockwise => angle - TAU - full_turns,
        };
        Self {
            radius: [libm::hypot(x0, y0), libm::hypot(x1, y1)],
            start: libm::atan2(y0, x0),
            sweep,
            #[cfg(arc_machine)]
            stepped_mm: None,
        }
    }

    /// Returns the spiral to the same end from the end of the block before, `offset` short of the arc's
    /// start, for axes of `steps_per_mm` at most.
    ///
    /// An arc that is smaller than the offset, or whose finer axis would make many steps for it, is
    /// returned unchanged: the whole arc is shifted then.
    pub(super) fn begun_before(self, circle: &Circle, offset: [Nm; 2], steps_per_mm: f64) -> Self {
        if offset == [Nm(0); 2] {
            return self;
        }
        let offset = offset.map(Nm::to_mm_f64);
        let offset_mm = libm::hypot(offset[0], offset[1]);
        let is_spiral = offset_mm <= SMALL_OFFSET * self.radius[0]
            || offset_mm <= LARGE_OFFSET * self.radius[0] && offset_mm * steps_per_mm <= FEW_STEPS;
        if !is_spiral {
            return self;
        }
        let [x0, y0] = circle.centre.map(|centre| -centre.to_mm_f64());
        let (x, y) = (x0 - offset[0], y0 - offset[1]);
        Self {
            radius: [libm::hypot(x, y), self.radius[1]],
            start: libm::atan2(y, x),
            sweep: self.sweep + libm::atan2(x * y0 - y * x0, x * x0 + y * y0),
            #[cfg(arc_machine)]
            stepped_mm: None,
        }
    }

    /// Returns the greatest distance from the centre in a direction, mm; `None` where an end of the arc
    /// is the farthest point.
    ///
    /// On a spiral the extreme lies beside the direction, at the angle where the growth of the radius
    /// balances the rotation: tan δ = c/r.
    pub(super) fn extreme_mm(&self, direction: f64) -> Option<f64> {
        let turn = if self.sweep > 0.0 { TAU } else { -TAU };
        let ahead = libm::fmod(direction - self.start, TAU);
        let first = if ahead * turn < 0.0 {
            ahead + turn
        } else {
            ahead
        };
        let turns = libm::floor((self.sweep - first) / turn);
        let (start_radius, growth) = (self.radius[0], self.growth());
        let extreme = |angle: f64| {
            let shift = libm::atan2(growth, start_radius + growth * angle);
            let angle = angle + shift;
            let is_on_arc = angle * turn >= 0.0 && (self.sweep - angle) * turn >= 0.0;
            is_on_arc.then(|| (start_radius + growth * angle) * libm::cos(shift))
        };
        // The radius is monotonic: the extreme is that of the first turn or of the last one.
        match (extreme(first), extreme(first + turns * turn)) {
            (Some(first), Some(last)) => Some(first.max(last)),
            (one, None) | (None, one) => one,
        }
    }

    /// Returns the angle, counted as `sweep`, at which one of these axes of the plane reverses first. A reversal within
    /// a rounding of the start or of the end is none.
    pub(super) fn first_reversal(&self, axes: [bool; 2]) -> Option<f64> {
        let sense = if self.sweep > 0.0 { 1.0 } else { -1.0 };
        let mut first = None;
        for quarter in 0..4_u8 {
            if !axes[usize::from(quarter % 2)] {
                continue;
            }
            let mut ahead = libm::fmod((FRAC_PI_2 * f64::from(quarter) - self.start) * sense, TAU);
            if ahead < 0.0 {
                ahead += TAU;
            }
            // On a spiral it lies beside the direction, see `extreme_mm`.
            let extreme = |ahead: f64| {
                let radius = self.radius[0] + self.growth() * ahead * sense;
                ahead + sense * libm::atan2(self.growth(), radius)
            };
            let is_far = |angle: f64| {
                angle >= PI || self.tightest_mm() * (1.0 - libm::cos(angle)) >= LEAST_TRAVEL_MM
            };
            if ahead < PI && !is_far(extreme(ahead).max(0.0)) {
                ahead += TAU;
            }
            let angle = extreme(ahead);
            let left = libm::fabs(self.sweep) - angle;
            let is_nearer = first.is_none_or(|first| angle < first);
            if left > 0.0 && is_far(left) && is_nearer {
                first = Some(angle);
            }
        }
        first.map(|angle| angle * sense)
    }

    /// Returns the growth of the radius, mm/rad of signed angle.
    pub(super) fn growth(&self) -> f64 {
        (self.radius[1] - self.radius[0]) / self.sweep
    }

    /// Returns the mean radius, mm.
    fn mean_mm(&self) -> f64 {
        0.5 * (self.radius[0] + self.radius[1])
    }

    /// Returns the ratio of the limits of speed and acceleration to those of a circle of the mean radius.
    ///
    /// The angular speed w is constant at constant speed. With the radius r and its growth c the speed is
    /// w·√(r² + c²) and the acceleration w²·√(r² + 4c²): both exceed the mean where r or c is great.
    pub(super) fn limit_ratio(&self) -> f64 {
        let greatest = self.radius[0].max(self.radius[1]);
        let most = libm::hypot(greatest, 2.0 * self.growth());
        let mean = self.mean_mm();
        if most < MAX_CIRCLE_RADIUS_RATIO * mean {
            1.0
        } else {
            mean / most
        }
    }

    fn is_spiral(&self) -> bool {
        self.limit_ratio() < 1.0
    }

    /// Returns the radius of the circle with the greatest acceleration of the arc at the same speed, mm.
    pub(super) fn tightest_mm(&self) -> f64 {
        if self.is_spiral() {
            self.mean_mm() * self.limit_ratio()
        } else {
            self.radius[0].min(self.radius[1])
        }
    }

    /// Returns the curvature at the start (0) or the end (1), 1/mm: (r² + 2c²) / (r² + c²)^(3/2).
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

    /// Returns the length, mm, with an error of the second order in the growth of the radius.
    pub(super) fn length_mm(&self) -> f64 {
        #[cfg(arc_machine)]
        if let Some(stepped_mm) = self.stepped_mm {
            return stepped_mm;
        }
        libm::fabs(self.sweep) * self.mean_mm()
    }

    /// Returns the unit tangent at the start (0) or the end (1).
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

    /// Returns the unit vector towards the centre at the start (0) or the end (1).
    pub(super) fn inwards(&self, end: u8) -> [f64; 2] {
        let angle = self.start + self.sweep * f64::from(end);
        [-libm::cos(angle), -libm::sin(angle)]
    }
}
