//! The rotation of work coordinates about Z.

use crate::{
    axis::{X, Y, Z},
    units::{MicroDegrees, Nm},
};

/// A rotation about Z, in the plane of X and Y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct XyRotation {
    angle: MicroDegrees,
    sin: f64,
    cos: f64,
}

impl XyRotation {
    /// No rotation.
    pub const NONE: Self = Self {
        angle: MicroDegrees::ZERO,
        sin: 0.0,
        cos: 1.0,
    };

    /// Returns the rotation by an angle.
    #[must_use]
    pub fn by(angle: MicroDegrees) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { angle, sin, cos }
    }

    /// Returns whether nothing is rotated.
    #[must_use]
    #[inline]
    pub const fn is_none(&self) -> bool {
        self.angle.millionths() == 0
    }

    /// Returns the angle.
    #[must_use]
    pub const fn angle(&self) -> MicroDegrees {
        self.angle
    }

    /// Returns the part of a unit vector along an axis, before the rotation, that is along another axis
    /// after it.
    #[must_use]
    pub const fn part(&self, after: usize, before: usize) -> f64 {
        match (after, before) {
            (X, X) | (Y, Y) => self.cos,
            (X, Y) => -self.sin,
            (Y, X) => self.sin,
            (Z, Z) => 1.0,
            _ => 0.0,
        }
    }

    /// Returns a vector after the rotation, rounded once.
    #[must_use]
    pub fn rotate(&self, [x, y]: [Nm; 2]) -> [Nm; 2] {
        turned([x, y], self.sin, self.cos)
    }

    /// Returns a vector before the rotation, rounded once.
    #[must_use]
    pub fn unrotate(&self, [x, y]: [Nm; 2]) -> [Nm; 2] {
        turned([x, y], -self.sin, self.cos)
    }
}

fn turned([x, y]: [Nm; 2], sin: f64, cos: f64) -> [Nm; 2] {
    let (x, y) = (x.0 as f64, y.0 as f64);
    [x * cos - y * sin, x * sin + y * cos].map(|nm| Nm(libm::round(nm) as i64))
}
