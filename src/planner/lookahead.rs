//! The look-ahead: how fast each block may be entered so that the path known can be ended at rest.
//!
//! Only braking is planned here, from the newest block backwards; the executor accelerates as far as
//! the limits let it. A pass ends at the first block whose entry speed does not change, because the
//! blocks before it cannot change either: a new block costs as many steps as it has influence.
//!
//! Braking is planned in a measure of speed that is linear in the path, see [`Block::measure`].

use core::f32::consts::FRAC_PI_2;

use super::{Block, Laser, Pacing};
use crate::{
    axis::{AXES, Axes},
    machine::Overrides,
    math,
};

/// Places for blocks, a power of two.
pub const BLOCKS: usize = 128;

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
#[derive(Debug)]
struct Planned {
    block: Block,
    /// Limit of the squared entry speed from the junction and both programmed speeds.
    limit_sqr: f32,
    /// Planned squared entry speed.
    entry_sqr: f32,
}

impl Planned {
    /// An empty place.
    const NONE: Self = Self {
        block: Block {
            delta: Axes([0; AXES]),
            steps_per_mm: Axes([0.0; AXES]),
            length_mm: 0.0,
            speed_mm_s: 0.0,
            programmed_mm_s: 0.0,
            limit_mm_s: 0.0,
            pacing: Pacing::Feed,
            laser: Laser::None,
            acceleration_mm_s2: 0.0,
            junction_sqr: 0.0,
            curve: None,
            line: 0,
        },
        limit_sqr: 0.0,
        entry_sqr: 0.0,
    };

    /// Takes a block over, field by field: as a whole it would be copied by a loop in a library.
    fn hold(&mut self, block: &Block) {
        let here = &mut self.block;
        here.delta = block.delta;
        here.steps_per_mm = block.steps_per_mm;
        here.length_mm = block.length_mm;
        here.speed_mm_s = block.speed_mm_s;
        here.programmed_mm_s = block.programmed_mm_s;
        here.limit_mm_s = block.limit_mm_s;
        here.pacing = block.pacing;
        here.laser = block.laser;
        here.acceleration_mm_s2 = block.acceleration_mm_s2;
        here.junction_sqr = block.junction_sqr;
        // Lines have none: nothing to copy.
        match &block.curve {
            Some(curve) => here.curve = Some(*curve),
            None => here.curve = None,
        }
        here.line = block.line;
    }
}

/// The blocks of a program.
pub type LookAhead = Plan<BLOCKS>;

/// The blocks to be executed, oldest first. `N` is a power of two.
///
/// In this order in memory, so that the small fields are near.
#[derive(Debug)]
#[repr(C)]
pub struct Plan<const N: usize> {
    /// Place of the oldest.
    first: usize,
    count: usize,
    overrides: Overrides,
    ring: [Planned; N],
}

impl<const N: usize> Plan<N> {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            ring: [const { Planned::NONE }; N],
            first: 0,
            count: 0,
            overrides: Overrides::NONE,
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
        N - self.count
    }

    /// The block in execution.
    #[must_use]
    pub fn current(&self) -> Option<&Block> {
        (self.count != 0).then(|| &self.ring[self.first & (N - 1)].block)
    }

    /// Squared speed at which the block in execution may be left: 0 when no other follows.
    #[must_use]
    pub fn exit_sqr(&self) -> f32 {
        if self.count > 1 {
            self.ring[(self.first + 1) & (N - 1)].entry_sqr
        } else {
            0.0
        }
    }

    /// Adds a block, if there is a place, and plans anew what that changes.
    pub fn push(&mut self, block: &Block) {
        if self.count == N {
            return;
        }
        let newest = self.first + self.count;
        let planned = &mut self.ring[newest & (N - 1)];
        planned.hold(block);
        if self.overrides != Overrides::NONE {
            planned.block.speed_mm_s = block.speed_under(self.overrides);
        }
        let speed_mm_s = planned.block.speed_mm_s;
        let limit_sqr = if self.count == 0 {
            0.0
        } else {
            let before = &self.ring[newest.wrapping_sub(1) & (N - 1)].block;
            let slower = math::min(speed_mm_s, before.speed_mm_s);
            math::min(block.junction_sqr, slower * slower)
        };
        let planned = &mut self.ring[newest & (N - 1)];
        planned.limit_sqr = limit_sqr;
        planned.entry_sqr = -1.0;
        self.count += 1;
        self.brake();
    }

    /// Puts all blocks, and those to come, under other overrides, and plans anew.
    pub fn pace(&mut self, overrides: Overrides) {
        self.overrides = overrides;
        let mut before_mm_s = 0.0;
        // wcet-bound: 128
        for number in 0..self.count {
            let planned = &mut self.ring[(self.first + number) & (N - 1)];
            let speed_mm_s = planned.block.speed_under(overrides);
            planned.block.speed_mm_s = speed_mm_s;
            let slower = math::min(speed_mm_s, before_mm_s);
            planned.limit_sqr = math::min(planned.block.junction_sqr, slower * slower);
            planned.entry_sqr = -1.0;
            before_mm_s = speed_mm_s;
        }
        self.brake();
    }

    /// Removes the block in execution.
    pub fn pop(&mut self) {
        if self.count != 0 {
            self.first = (self.first + 1) & (N - 1);
            self.count -= 1;
        }
    }

    /// Removes all blocks.
    pub fn clear(&mut self) {
        self.first = 0;
        self.count = 0;
    }

    /// The backward pass.
    fn brake(&mut self) {
        let mut exit_sqr = 0.0;
        // The entry of the block in execution is history.
        // wcet-bound: 127
        for back in 1..self.count {
            let place = (self.first + self.count - back) & (N - 1);
            let planned = &mut self.ring[place];
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

impl<const N: usize> Default for Plan<N> {
    fn default() -> Self {
        Self::new()
    }
}
