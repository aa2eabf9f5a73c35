//! Jerk limits of arcs: greatest speed, acceleration left along the path, junctions of curvature.
//!
//! Along an arc of curvature k at the speed v the acceleration is v²k towards the centre and s'' along
//! the path. Its derivative is s''' - v³k² along the path and 3vk·s'' towards the centre. Double
//! precision, once per arc, in the task without a deadline.
//!
//! Chords that leave an arc of radius r by the junction deviation δ meet at corners that are passed at
//! v² = a·(r - δ), nearly the centripetal limit a·r, and the corners at the arc's ends are slighter. So
//! where corners are passed in motion, an arc is passed as its chords would be: as fast as the acceleration
//! allows. That bounds what is left of the jerk: v³k² ≤ √(a³k) at constant speed, and acceleration
//! changes at once by a at most where an arc meets a line, by 2a where two arcs meet. With a junction
//! deviation of 0, chords would stop at each corner: then the jerk limit holds on arcs, as it does on the
//! arcs of rounded corners.

use super::Limits;
use crate::{
    axis::Axes,
    math,
    model::FeedRate,
    path::{RampTime, programmed_speed::programmed_mm_s},
};

/// Greatest part of the acceleration towards the centre. The part that is left along the path is the
/// other leg of the triangle, √(1 - 0.9²) = 0.44.
const CENTRIPETAL_PART: f64 = 0.9;
/// The same on arcs that the machine comes to in motion, where the programmed speed asks for it: 0.31 is
/// left, and the arc takes 2.6 % longer than at the centripetal limit.
const CRUISING_PART: f64 = 0.95;
/// The same on bends that are passed in about the ramp time, in which hardly an acceleration along the path comes
/// to be: they take 1 % longer.
const SHORT_BEND_PART: f64 = 0.98;
/// Greatest duration of a short bend, ramp times, and its least angle, rad.
const SHORT_BEND_RAMPS: f64 = 1.1;
const MIN_SHORT_BEND_RAD: f64 = 2.5;
/// The same on corner arcs: 0.8 is left.
const CORNER_ARC_PART: f64 = 0.6;
/// An arc of that angle or more is a circle: most begin and end at a standstill or a corner, rad.
const CIRCLE_RAD: f64 = 6.0;
/// Greatest part of the jerk at constant speed, v³k². The other half is left for changes of speed.
const CONSTANT_SPEED_PART: f64 = 0.5;
/// Time in which the jerk limit produces the greatest step of centripetal acceleration at a junction,
/// s.
///
/// A step of b changes the second difference of positions sampled each ms by 3/4·b from one ms to the
/// next at most: `tests/motion/jerk.rs` measures jerk over windows of 1 ms.
const STEP_S: f64 = 1.0e-3 / 0.75;
/// Greatest feed override.
const MAX_FEED_OVERRIDE: f32 = 2.0;

/// Limits and curvature at a point of an arc.
#[derive(Debug, Clone, Copy)]
pub(super) struct ArcJerk {
    /// Greatest acceleration, mm/s², and jerk, mm/s³, in any direction of the plane.
    pub(super) acceleration_mm_s2: f32,
    pub(super) jerk_mm_s3: f32,
    /// Curvature of the path, 1/mm.
    pub(super) curvature_per_mm: f64,
}

impl ArcJerk {
    /// Returns the speed at which a part of the acceleration is towards the centre, mm/s.
    fn centripetal_mm_s(&self, part: f64) -> f64 {
        let acceleration = part * f64::from(self.acceleration_mm_s2);
        libm::sqrt(acceleration / self.curvature_per_mm)
    }

    /// Returns the greatest speed, mm/s.
    fn speed_mm_s(&self) -> f32 {
        let by_acceleration = self.centripetal_mm_s(CENTRIPETAL_PART);
        let jerk = CONSTANT_SPEED_PART * f64::from(self.jerk_mm_s3);
        let by_jerk = libm::cbrt(jerk / (self.curvature_per_mm * self.curvature_per_mm));
        by_acceleration.min(by_jerk) as f32
    }

    /// Returns the acceleration that is left along the path up to a speed, mm/s².
    fn left_mm_s2(&self, speed_mm_s: f32) -> f64 {
        let speed = f64::from(speed_mm_s);
        let acceleration = f64::from(self.acceleration_mm_s2);
        let centripetal = speed * speed * self.curvature_per_mm;
        libm::sqrt((acceleration * acceleration - centripetal * centripetal).max(0.0))
    }

    /// Returns the same within the jerk limit, mm/s².
    fn along_mm_s2(&self, speed_mm_s: f32, ramp_time: RampTime) -> f32 {
        let speed = f64::from(speed_mm_s);
        let jerk = f64::from(self.jerk_mm_s3);
        let centripetal = speed * speed * self.curvature_per_mm;
        // The root of (a/T + p)² + (q·a)² = j² for a, with the ramp time T.
        let per_s = 1.0 / f64::from(ramp_time.seconds());
        let p = speed * centripetal * self.curvature_per_mm;
        let q = 3.0 * speed * self.curvature_per_mm;
        let square = per_s * per_s + q * q;
        let half = p * per_s;
        let remainder = (jerk * jerk - p * p).max(0.0);
        let by_jerk = (libm::sqrt(half * half + square * remainder) - half) / square;
        self.left_mm_s2(speed_mm_s).min(by_jerk) as f32
    }
}

/// Returns the greatest squared speed at a change of curvature, (mm/s)².
fn curvature_change_sqr(change_per_mm: f32, jerk_mm_s3: f32) -> f32 {
    let step_mm_s2 = f64::from(jerk_mm_s3) * STEP_S;
    (step_mm_s2 / f64::from(change_per_mm).max(1.0e-12)) as f32
}

impl Limits {
    /// Returns the limit of the squared speed at a change of curvature, (mm/s)².
    pub(super) fn curvature_sqr(&self, change_per_mm: &Axes<f32>) -> f32 {
        let square = math::dot(&change_per_mm.0, &change_per_mm.0);
        if !self.ramp_time.is_jerk_limited() || square <= 0.0 {
            return f32::MAX;
        }
        let per_mm = math::sqrt(square);
        let jerk_mm_s3 = per_mm * Self::along(&self.jerk_mm_s3, &self.motors_of(*change_per_mm));
        curvature_change_sqr(per_mm, jerk_mm_s3)
    }

    /// Returns whether an arc has to keep the jerk limit.
    pub(super) fn limits_jerk_of_arcs(&self) -> bool {
        self.ramp_time.is_jerk_limited() && self.junction_deviation_mm <= 0.0
    }

    /// Returns the greatest speed and the tangential acceleration on an arc of an angle, from their values without a
    /// jerk limit and from the ends of the arc, at a feed rate that may be overridden.
    pub(super) fn of_arc(
        &self,
        ends: &[ArcJerk; 2],
        (mut speed_mm_s, mut acceleration_mm_s2): (f32, f32),
        feed_rate: FeedRate,
        (length_mm, sweep_rad): (f32, f64),
    ) -> (f32, f32) {
        if !self.ramp_time.is_jerk_limited() || self.limits_jerk_of_arcs() {
            let limits = (speed_mm_s, acceleration_mm_s2);
            return self.jerk_limited(ends, limits, feed_rate, length_mm);
        }
        let programmed = programmed_mm_s(feed_rate, length_mm, speed_mm_s);
        let angle = libm::fabs(sweep_rad);
        let short_s = SHORT_BEND_RAMPS * f64::from(self.ramp_time.seconds());
        for end in ends {
            let is_short = f64::from(length_mm) <= short_s * end.centripetal_mm_s(1.0);
            let most = if angle >= CIRCLE_RAD {
                CENTRIPETAL_PART
            } else if is_short && angle >= MIN_SHORT_BEND_RAD {
                SHORT_BEND_PART
            } else {
                CRUISING_PART
            };
            let [least, most] =
                [CENTRIPETAL_PART, most].map(|part| end.centripetal_mm_s(part) as f32);
            speed_mm_s = speed_mm_s.min(programmed.max(least).min(most));
        }
        let fastest = speed_mm_s.min(MAX_FEED_OVERRIDE * programmed);
        for end in ends {
            acceleration_mm_s2 = acceleration_mm_s2.min(end.left_mm_s2(fastest) as f32);
        }
        (speed_mm_s, acceleration_mm_s2)
    }

    /// Returns the greatest speed and the tangential acceleration on an arc, from their values without a jerk limit and
    /// from points of the arc, at a feed rate that may be overridden.
    pub(super) fn jerk_limited(
        &self,
        points: &[ArcJerk],
        (mut speed_mm_s, mut acceleration_mm_s2): (f32, f32),
        feed_rate: FeedRate,
        length_mm: f32,
    ) -> (f32, f32) {
        if self.ramp_time.is_jerk_limited() {
            for point in points {
                speed_mm_s = speed_mm_s.min(point.speed_mm_s());
            }
            let programmed = programmed_mm_s(feed_rate, length_mm, speed_mm_s);
            let fastest = speed_mm_s.min(MAX_FEED_OVERRIDE * programmed);
            for point in points {
                acceleration_mm_s2 =
                    acceleration_mm_s2.min(point.along_mm_s2(fastest, self.ramp_time));
            }
        }
        (speed_mm_s, acceleration_mm_s2)
    }

    /// Returns the greatest squared speed into and along a corner arc, (mm/s)².
    ///
    /// `shares` are the greatest parts of a movement along the arc that each axis makes.
    pub(crate) fn corner_arc_sqr(
        &self,
        shares: &Axes<f32>,
        radius_mm: f32,
        acceleration: f32,
    ) -> f32 {
        if !self.ramp_time.is_jerk_limited() {
            return acceleration * radius_mm;
        }
        if !self.limits_jerk_of_arcs() {
            return CORNER_ARC_PART as f32 * acceleration * radius_mm;
        }
        let arc = self.corner_arc_jerk(shares, radius_mm, acceleration);
        let speed_mm_s = arc.speed_mm_s();
        math::min(
            speed_mm_s * speed_mm_s,
            curvature_change_sqr(arc.curvature_per_mm as f32, arc.jerk_mm_s3),
        )
    }

    /// Returns the acceleration along a corner arc up to a speed, within limits of jerk, mm/s².
    pub(crate) fn corner_arc_mm_s2(
        &self,
        shares: &Axes<f32>,
        radius_mm: f32,
        speed_mm_s: f32,
    ) -> f32 {
        let arc = self.corner_arc_jerk(shares, radius_mm, self.acceleration_along(shares));
        if self.limits_jerk_of_arcs() {
            arc.along_mm_s2(speed_mm_s, self.ramp_time)
        } else {
            arc.left_mm_s2(arc.centripetal_mm_s(CORNER_ARC_PART) as f32) as f32
        }
    }

    /// Returns the greatest speed and the tangential acceleration on a corner arc: see [`Self::of_arc`].
    pub(super) fn of_corner_arc(
        &self,
        arc: &ArcJerk,
        (speed_mm_s, acceleration_mm_s2): (f32, f32),
        feed_rate: FeedRate,
        length_mm: f32,
    ) -> (f32, f32) {
        if !self.ramp_time.is_jerk_limited() || self.limits_jerk_of_arcs() {
            let limits = (speed_mm_s, acceleration_mm_s2);
            return self.jerk_limited(&[*arc], limits, feed_rate, length_mm);
        }
        let speed_mm_s = speed_mm_s.min(arc.centripetal_mm_s(CORNER_ARC_PART) as f32);
        let programmed = programmed_mm_s(feed_rate, length_mm, speed_mm_s);
        let fastest = speed_mm_s.min(MAX_FEED_OVERRIDE * programmed);
        (speed_mm_s, arc.left_mm_s2(fastest) as f32)
    }

    pub(super) fn corner_arc_jerk(
        &self,
        shares: &Axes<f32>,
        radius_mm: f32,
        acceleration_mm_s2: f32,
    ) -> ArcJerk {
        ArcJerk {
            acceleration_mm_s2,
            jerk_mm_s3: Self::along(&self.jerk_mm_s3, shares),
            curvature_per_mm: 1.0 / f64::from(radius_mm),
        }
    }
}
