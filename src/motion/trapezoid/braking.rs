//! Braking along a block: the entry speed from which an exit speed can be reached.

use core::f32::consts::FRAC_PI_2;

use crate::{
    math,
    motion::kinematics::BlockGeometry,
    path::{Block, Curve},
};

impl BlockGeometry<'_> {
    /// The measure of a squared speed that braking changes in proportion to the path.
    ///
    /// On a line that is v² itself. On an arc the acceleration left along the path is
    /// √(a² − (v²/R)²), so that d(v²)/ds = 2√(a² − (v²/R)²): with v² = aR·sin z it is dz/ds = 2/R.
    #[inline]
    pub(in crate::motion) fn measure(self, speed_sqr: f32) -> f32 {
        match self.curve {
            None => speed_sqr,
            Some(curve) => math::asin(math::min(speed_sqr / curve.limit_sqr, 1.0)),
        }
    }

    /// The squared speed of a measure.
    #[inline]
    pub(in crate::motion) fn speed_sqr(self, measure: f32) -> f32 {
        match self.curve {
            None => measure,
            Some(curve) => curve.limit_sqr * math::sin(math::min(measure, FRAC_PI_2)),
        }
    }

    /// Change of the measure per mm of path.
    #[inline]
    pub(in crate::motion) fn measure_per_mm(self) -> f32 {
        let double = 2.0 * self.block.acceleration_mm_s2;
        match self.curve {
            None => double,
            Some(curve) => double / curve.limit_sqr,
        }
    }
}

/// The part of a block's geometry for its entry speed: with it, a backward pass needs one square root for a block at
/// most.
///
/// On an arc with v² = aR·sin z, a length of z = d turns the exit's z into z + d:
/// sin(z + d) = sin z·cos d + cos z·sin d.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct Braking {
    /// On a line the change of the squared speed, on an arc aR·sin d.
    gain: f32,
    /// On an arc cos d; 0 on a line.
    cosine: f32,
    /// On an arc the inverse of aR, 1/(mm/s)²; 0 on a line.
    inverse_limit: f32,
}

impl Braking {
    pub(in crate::motion) const NONE: Self = Self {
        gain: 0.0,
        cosine: 0.0,
        inverse_limit: 0.0,
    };

    pub(in crate::motion) fn new(block: &Block) -> Self {
        let change = block.geometry().measure_per_mm() * block.length_mm;
        match &block.curve {
            None => Self {
                gain: change,
                ..Self::NONE
            },
            Some(curve) => {
                let change = math::min(change, FRAC_PI_2);
                Self {
                    gain: curve.limit_sqr * math::sin(change),
                    cosine: math::sin(FRAC_PI_2 - change),
                    inverse_limit: 1.0 / curve.limit_sqr,
                }
            }
        }
    }

    /// Greatest squared entry speed from which a line can be left at `exit_sqr`.
    #[inline]
    pub(in crate::motion) fn line_entry_for(&self, exit_sqr: f32) -> f32 {
        exit_sqr + self.gain
    }

    /// The same for a curve.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "a call in a loop is charged for each round"
    )]
    pub(in crate::motion) fn curve_entry_for(&self, exit_sqr: f32, curve: &Curve) -> f32 {
        let part = exit_sqr * self.inverse_limit;
        if part >= self.cosine {
            // The speed limit of the arc.
            return curve.limit_sqr;
        }
        exit_sqr * self.cosine + self.gain * math::sqrt_inlined(1.0 - part * part)
    }
}
