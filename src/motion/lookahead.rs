//! The look-ahead: how fast each block may be entered so that the path known can be ended at rest.
//!
//! Only braking is planned here, from the newest block backwards; the executor accelerates as far as
//! the limits let it. A pass ends at the first block whose entry speed does not change, because the
//! blocks before it cannot change either: a new block costs as many steps as it has influence.
//!
//! Braking is planned in a measure of speed that is linear in the path, see [`Course::measure`].

use super::{
    jerk_limited::{JunctionPlan, ReferenceMotion, RunningMin},
    pass::Pass,
    segment_rate::{duration_per_step_s, limit_block_rate, limit_segment_rate, min_duration_s},
    trapezoid::Braking,
};
use crate::{
    axis::{AXES, Axes},
    math,
    model::{Laser, Overrides},
    path::{Block, MoveKind},
};

/// Places for blocks, a power of two.
pub const BLOCKS: usize = 128;
/// A block with its place in the plan.
#[derive(Debug)]
pub(super) struct QueuedBlock {
    pub(super) block: Block,
    /// Limit of the squared entry speed from the junction and both programmed speeds.
    pub(super) limit_sqr: f32,
    /// Planned squared entry speed.
    pub(super) entry_sqr: f32,
    /// What it may take where other blocks have to take longer, s.
    pub(super) min_duration_s: f32,
    pub(super) braking: Braking,
    pub(super) limits: JunctionPlan,
}

impl QueuedBlock {
    /// An empty place.
    const NONE: Self = Self {
        block: Block {
            delta: Axes([0; AXES]),
            steps_per_mm: Axes([0.0; AXES]),
            length_mm: 0.0,
            nominal_mm_s: 0.0,
            programmed_mm_s: 0.0,
            limit_mm_s: 0.0,
            kind: MoveKind::Feed,
            laser: Laser::None,
            acceleration_mm_s2: 0.0,
            junction_sqr: 0.0,
            curve: None,
            line: 0,
        },
        limit_sqr: 0.0,
        entry_sqr: 0.0,
        min_duration_s: f32::MAX,
        braking: Braking::NONE,
        limits: JunctionPlan::NONE,
    };

    /// Takes a block over, field by field: as a whole it would be copied by a loop in a library.
    fn copy_from(&mut self, block: &Block) {
        let here = &mut self.block;
        here.delta = block.delta;
        here.steps_per_mm = block.steps_per_mm;
        here.length_mm = block.length_mm;
        here.nominal_mm_s = block.nominal_mm_s;
        here.programmed_mm_s = block.programmed_mm_s;
        here.limit_mm_s = block.limit_mm_s;
        here.kind = block.kind;
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
    pub(super) first: usize,
    pub(super) count: usize,
    pub(super) overrides: Overrides,
    /// What the blocks up to the newest take longer than they have to, s, [`SPARE_S`] at most.
    pub(super) slack_s: f32,
    pub(super) pass: Pass,
    /// The window over which acceleration changes, cells and s; 0 where it changes at once.
    pub(super) window: usize,
    pub(super) window_s: f32,
    /// The length of the blocks behind the one that the reference is in, mm.
    pub(super) beyond_mm: f32,
    /// The reference, and the accelerations of the newest blocks.
    pub(super) reference: ReferenceMotion,
    pub(super) running_min: RunningMin,
    /// What a step adds to the shortest time of a line, s.
    duration_per_step_s: f32,
    pub(super) ring: [QueuedBlock; N],
}

impl<const N: usize> Plan<N> {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            ring: [const { QueuedBlock::NONE }; N],
            first: 0,
            count: 0,
            overrides: Overrides::NONE,
            slack_s: 0.0,
            duration_per_step_s: duration_per_step_s(0),
            pass: Pass::Done,
            window: 0,
            window_s: 0.0,
            beyond_mm: 0.0,
            reference: ReferenceMotion::START,
            running_min: RunningMin::NONE,
        }
    }

    /// At rest: the greatest step rate of all axes together is that from now on, Hz.
    pub(crate) const fn set_step_rate(&mut self, hz: u32) {
        self.duration_per_step_s = duration_per_step_s(hz);
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

    /// Adds a block, if there is a place, and begins to plan what that changes. The pass before must
    /// be finished.
    pub fn push(&mut self, block: &Block) {
        if self.count == N {
            return;
        }
        let newest = self.first + self.count;
        let planned = &mut self.ring[newest & (N - 1)];
        planned.copy_from(block);
        planned.braking = Braking::new(block);
        if self.overrides != Overrides::NONE {
            planned.block.nominal_mm_s = block.nominal_under(self.overrides);
        }
        planned.min_duration_s = min_duration_s(block, self.duration_per_step_s);
        let (mut speed_mm_s, spare_s) = limit_segment_rate(
            &planned.block,
            planned.block.nominal_mm_s,
            planned.min_duration_s,
            self.slack_s,
        );
        if self.window != 0 {
            speed_mm_s = limit_block_rate(&planned.block, speed_mm_s);
        }
        planned.block.nominal_mm_s = speed_mm_s;
        self.slack_s = spare_s;
        let limit_sqr = if self.count == 0 {
            0.0
        } else {
            let before = &self.ring[newest.wrapping_sub(1) & (N - 1)].block;
            let slower = math::min(speed_mm_s, before.nominal_mm_s);
            math::min(block.junction_sqr, slower * slower)
        };
        let planned = &mut self.ring[newest & (N - 1)];
        planned.limit_sqr = limit_sqr;
        // Lower than any: it changes.
        planned.entry_sqr = -1.0;
        self.count += 1;
        if self.is_jerk_limited() {
            if self.count > 1 {
                self.beyond_mm += block.length_mm;
            }
            self.plan_block(self.count - 1, None);
            self.pass = Pass::NEWEST_ENTRIES;
        } else {
            self.plan_braking_part(1, 0.0, false);
        }
    }

    /// Adds the only block, to be entered and left at rest.
    pub fn push_alone(&mut self, block: &Block) {
        self.clear();
        let planned = &mut self.ring[0];
        planned.copy_from(block);
        planned.limit_sqr = 0.0;
        planned.entry_sqr = 0.0;
        planned.min_duration_s = f32::MAX;
        self.count = 1;
    }

    /// Removes the block in execution.
    pub fn pop(&mut self) {
        if self.count != 0 {
            self.first = (self.first + 1) & (N - 1);
            self.count -= 1;
            if self.is_jerk_limited() && self.reference.number() == 0 && self.count != 0 {
                self.enter_block(0);
            }
            self.reference.block_removed();
            if let Pass::Speeds { number, .. } | Pass::BlockLimits { number, .. } = &mut self.pass {
                *number = number.saturating_sub(1);
            }
        }
    }

    /// Removes all blocks.
    pub fn clear(&mut self) {
        self.first = 0;
        self.count = 0;
        self.slack_s = 0.0;
        self.pass = Pass::Done;
        self.reference = ReferenceMotion::START;
        self.beyond_mm = 0.0;
    }
}

impl<const N: usize> Default for Plan<N> {
    fn default() -> Self {
        Self::new()
    }
}
