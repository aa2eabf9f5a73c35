//! The jerk that arcs are passed with beside the limit of jerk.
//!
//! An acceleration that turns with the path, at the angular speed w = v·k, has a jerk of w·v²k along the path,
//! and of 3w·s'' towards the centre while the speed changes by s''. Both together are at most
//! w·√(9a² - 8(v²k)²) within the acceleration a. Where the curvature changes, the acceleration jumps by v²
//! times the change.

use serde::Serialize;

use super::geometry::{Point, norm};

/// The greatest jerk of arcs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct ArcFigures {
    /// At constant speed, mm/s³.
    pub(crate) jerk_mm_s3: f64,
    /// Jump of the acceleration where the curvature changes, mm/s².
    pub(crate) jump_mm_s2: f64,
}

/// The arcs of a machine that passes them with a jump of the acceleration.
#[derive(Debug, Default)]
pub(super) struct JerkOfArcs {
    /// A limit of jerk is set, and corners are passed in motion.
    pub(super) is_allowed: bool,
    /// Jerk that the present place allows beside the limit, in any direction and along the path, mm/s³.
    pub(super) allowed_mm_s3: f64,
    pub(super) along_mm_s3: f64,
    pub(super) greatest: ArcFigures,
}

impl JerkOfArcs {
    /// Follows the path to a place of a curvature, at a speed, within an acceleration in its plane.
    pub(super) fn follow(&mut self, curvature: &Point, speed_mm_s: f64, acceleration_mm_s2: f64) {
        let curvature_per_mm = norm(curvature);
        (self.allowed_mm_s3, self.along_mm_s3) = (0.0, 0.0);
        if !self.is_allowed || curvature_per_mm <= 0.0 {
            return;
        }
        let rad_s = speed_mm_s * curvature_per_mm;
        let centripetal = (speed_mm_s * rad_s).min(acceleration_mm_s2);
        let most = 9.0 * acceleration_mm_s2.powi(2) - 8.0 * centripetal.powi(2);
        self.allowed_mm_s3 = rad_s * most.sqrt();
        self.along_mm_s3 = rad_s * centripetal;
        self.greatest.jerk_mm_s3 = self.greatest.jerk_mm_s3.max(self.along_mm_s3);
    }

    /// The jumps of the acceleration of all axes where the curvature changes, at a speed, mm/s².
    pub(super) fn jumps_mm_s2(&mut self, change: &Point, speed_mm_s: f64) -> Point {
        if !self.is_allowed {
            return Point::default();
        }
        let jumps = change.map(|change| speed_mm_s * speed_mm_s * change);
        let jump_mm_s2 = &mut self.greatest.jump_mm_s2;
        *jump_mm_s2 = jump_mm_s2.max(norm(&jumps));
        jumps
    }
}
