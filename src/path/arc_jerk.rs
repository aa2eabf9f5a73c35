//! Arcs where the jerk is limited: how fast, and how much of the acceleration is left along the path.
//!
//! Along an arc of curvature k at the speed v the acceleration is v²k towards the centre and s'' along
//! the path. Its change is s''' - v³k² along the path and 3vk·s'' towards the centre.
//!
//! In double precision, once per arc, in the task that has no deadline.

use super::AveragingWindow;

/// The part of the acceleration that may point towards the centre: what is left along the path is
/// the other leg of the triangle.
const CENTRIPETAL: f64 = 0.9;
/// The part of the jerk that a constant speed on an arc may have.
const STEADY: f64 = 0.5;
/// The time in which the jerk limit has to make up the acceleration towards the centre, which is there
/// at once where a curvature begins, s.
///
/// A jump of acceleration by b changes the second difference of positions taken 1 ms apart by 3/4·b
/// from one ms to the next at most: that much a measurement with windows of 1 ms shows of it.
const JUMP_S: f64 = 1.0e-3 / 0.75;

/// An arc's limits, and where it is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bend {
    /// Greatest acceleration, mm/s², and jerk, mm/s³, in any direction of the plane.
    pub(crate) acceleration_mm_s2: f32,
    pub(crate) jerk_mm_s3: f32,
    /// Curvature of the path, 1/mm.
    pub(crate) per_mm: f64,
}

impl Bend {
    /// The greatest speed, mm/s.
    pub(crate) fn speed_mm_s(&self) -> f32 {
        let most = libm::sqrt(CENTRIPETAL * f64::from(self.acceleration_mm_s2) / self.per_mm);
        let jerk = STEADY * f64::from(self.jerk_mm_s3);
        most.min(libm::cbrt(jerk / (self.per_mm * self.per_mm))) as f32
    }

    /// The acceleration along the path up to a speed, mm/s².
    pub(crate) fn along_mm_s2(&self, speed_mm_s: f32, window: AveragingWindow) -> f32 {
        let speed = f64::from(speed_mm_s);
        let most = f64::from(self.acceleration_mm_s2);
        let jerk = f64::from(self.jerk_mm_s3);
        let centripetal = speed * speed * self.per_mm;
        let left = libm::sqrt((most * most - centripetal * centripetal).max(0.0));
        // (a/T + p)² + (q·a)² = j² with the window T.
        let per_s = 1.0 / f64::from(window.seconds());
        let p = speed * centripetal * self.per_mm;
        let q = 3.0 * speed * self.per_mm;
        let square = per_s * per_s + q * q;
        let half = p * per_s;
        let rest = (jerk * jerk - p * p).max(0.0);
        let along = (libm::sqrt(half * half + square * rest) - half) / square;
        left.min(along) as f32
    }
}

/// The greatest squared speed where the curvature, 1/mm, changes by so much, (mm/s)².
pub(crate) fn jump_sqr(change_per_mm: f32, jerk_mm_s3: f32) -> f32 {
    let most = f64::from(jerk_mm_s3) * JUMP_S;
    (most / f64::from(change_per_mm).max(1.0e-12)) as f32
}
