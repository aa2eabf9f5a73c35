//! The look-ahead: how fast each block may be entered so that the path known can be ended at rest.
//!
//! Only braking is planned here, from the newest block backwards; the executor accelerates as far as
//! the limits let it. A pass ends at the first block whose entry speed does not change, because the
//! blocks before it cannot change either: a new block costs as many steps as it has influence.
//!
//! Braking is planned in a measure of speed that is linear in the path, see [`Block::measure`].

use core::f32::consts::FRAC_PI_2;

use super::Block;
use crate::math;

/// Places for blocks, a power of two.
pub const BLOCKS: usize = 128;
const MASK: usize = BLOCKS - 1;

impl Block {
    /// The measure of a squared speed that braking changes in proportion to the path.
    ///
    /// On a line that is v² itself. On an arc the acceleration left along the path is
    /// √(a² − (v²/R)²), so that d(v²)/ds = 2√(a² − (v²/R)²): with v² = aR·sin z it is dz/ds = 2/R.
    #[must_use]
    pub fn measure(&self, speed_sqr: f32) -> f32 {
        match &self.curve {
            None => speed_sqr,
            Some(curve) => math::asin(math::min(speed_sqr / curve.limit_sqr, 1.0)),
        }
    }

    /// The squared speed of a measure.
    #[must_use]
    pub fn speed_sqr(&self, measure: f32) -> f32 {
        match &self.curve {
            None => measure,
            Some(curve) => curve.limit_sqr * math::sin(math::min(measure, FRAC_PI_2)),
        }
    }

    /// Change of the measure per mm of path.
    #[must_use]
    pub fn measure_per_mm(&self) -> f32 {
        let double = 2.0 * self.acceleration_mm_s2;
        match &self.curve {
            None => double,
            Some(curve) => double / curve.limit_sqr,
        }
    }

    /// Greatest squared entry speed from which the block can be left at `exit_sqr`.
    fn entry_for(&self, exit_sqr: f32) -> f32 {
        match &self.curve {
            None => exit_sqr + 2.0 * self.acceleration_mm_s2 * self.length_mm,
            Some(_) => {
                self.speed_sqr(self.measure(exit_sqr) + self.measure_per_mm() * self.length_mm)
            }
        }
    }
}

/// A block with its place in the plan.
#[derive(Debug, Clone, Copy)]
struct Planned {
    block: Block,
    /// Limit of the squared entry speed from the junction and both programmed speeds.
    limit_sqr: f32,
    /// Planned squared entry speed.
    entry_sqr: f32,
}

/// The blocks to be executed, oldest first.
#[derive(Debug)]
pub struct LookAhead {
    ring: [Option<Planned>; BLOCKS],
    first: usize,
    count: usize,
}

impl LookAhead {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            ring: [None; BLOCKS],
            first: 0,
            count: 0,
        }
    }

    /// Blocks in it, the one in execution included.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// Whether nothing is to be executed.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Free places.
    #[must_use]
    pub const fn free(&self) -> usize {
        BLOCKS - self.count
    }

    /// The block in execution.
    #[must_use]
    pub fn current(&self) -> Option<&Block> {
        let planned = self.ring[self.first & MASK].as_ref();
        planned.map(|planned| &planned.block)
    }

    /// Squared speed at which the block in execution may be left: 0 when no other follows.
    #[must_use]
    pub fn exit_sqr(&self) -> f32 {
        let next = self.ring[(self.first + 1) & MASK].as_ref();
        next.map_or(0.0, |planned| planned.entry_sqr)
    }

    /// Adds a block, if there is a place, and plans anew what that changes.
    pub fn push(&mut self, block: &Block) {
        if self.count == BLOCKS {
            return;
        }
        let newest = self.first + self.count;
        let before = self.ring[newest.wrapping_sub(1) & MASK].as_ref();
        let speed = block.speed_mm_s;
        let limit_sqr = before.map_or(0.0, |before| {
            let slower = math::min(speed, before.block.speed_mm_s);
            math::min(block.junction_sqr, slower * slower)
        });
        self.ring[newest & MASK] = Some(Planned {
            block: *block,
            limit_sqr,
            entry_sqr: -1.0,
        });
        self.count += 1;
        self.brake();
    }

    /// Removes the block in execution.
    pub fn pop(&mut self) {
        if self.count != 0 {
            self.ring[self.first & MASK] = None;
            self.first = (self.first + 1) & MASK;
            self.count -= 1;
        }
    }

    /// Removes all blocks.
    pub fn clear(&mut self) {
        // wcet-bound: 128
        while self.count != 0 {
            self.pop();
        }
    }

    /// The backward pass.
    fn brake(&mut self) {
        let mut exit_sqr = 0.0;
        // The entry of the block in execution is history.
        // wcet-bound: 127
        for back in 1..self.count {
            let place = (self.first + self.count - back) & MASK;
            let Some(planned) = self.ring[place].as_mut() else {
                return;
            };
            let entry_sqr = if planned.entry_sqr == planned.limit_sqr {
                planned.limit_sqr
            } else {
                math::min(planned.limit_sqr, planned.block.entry_for(exit_sqr))
            };
            if entry_sqr == planned.entry_sqr {
                return;
            }
            planned.entry_sqr = entry_sqr;
            exit_sqr = entry_sqr;
        }
    }
}

impl Default for LookAhead {
    fn default() -> Self {
        Self::new()
    }
}
