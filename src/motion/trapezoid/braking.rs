//! How fast a block can be gone through so that a speed is reached at its end.

use core::f32::consts::FRAC_PI_2;

use crate::{
    math,
    path::{Block, Curve},
};

/// A block with its curve apart: code that is made for a block without one does not ask for it.
#[derive(Clone, Copy)]
pub(in crate::motion) struct BlockGeometry<'a> {
    pub(in crate::motion) block: &'a Block,
    pub(in crate::motion) curve: Option<&'a Curve>,
}

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

impl Block {
    /// The block, with its curve if it has one.
    #[inline]
    pub(in crate::motion) const fn geometry(&self) -> BlockGeometry<'_> {
        BlockGeometry {
            block: self,
            curve: self.curve.as_ref(),
        }
    }
}

/// How fast a block can be entered to be left at a speed: what that takes of its geometry, so that
/// a pass over all blocks needs a square root for each at most.
///
/// On an arc with v² = aR·sin z, a length of z = d turns the exit's z into z + d:
/// sin(z + d) = sin z·cos d + cos z·sin d.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct Braking {
    /// On a line, what the squared speed changes; on an arc aR·sin d.
    gain: f32,
    /// On an arc cos d, and the inverse of aR; 0 on a line.
    cosine: f32,
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
            // As fast as the arc can be gone through.
            return curve.limit_sqr;
        }
        exit_sqr * self.cosine + self.gain * math::sqrt_here(1.0 - part * part)
    }
}
