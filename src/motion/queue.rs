//! The blocks to be executed, oldest first, with what each profile plans of them.
//!
//! # Cost
//!
//! An entry has room for both profiles' plans, 16 and 60 bytes: a backward pass then needs one pointer.
//! An enum would save 2 KiB of RAM, but a test in each step of a pass, and a change of the profile would
//! rewrite all entries.

use super::{jerk_limited, trapezoid};
use crate::{
    axis::{AXES, Axes},
    model::Laser,
    path::{Block, MoveKind},
};

/// Capacity of the look-ahead, blocks: a power of two.
pub const BLOCKS: usize = 128;

/// A block and what is planned of it.
#[derive(Debug)]
pub struct QueuedBlock {
    pub(super) block: Block,
    /// Limit of the squared entry speed from the junction and both programmed speeds, (mm/s)².
    pub(super) limit_sqr: f32,
    /// Shortest duration of a block that is one segment, s; `f32::MAX` for others.
    pub(super) min_duration_s: f32,
    pub(super) trapezoid: trapezoid::BrakingPlan,
    pub(super) jerk_limited: jerk_limited::BlockPlan,
}

impl QueuedBlock {
    /// A free entry: nothing reads it, here or in [`Motion::without_blocks`](super::Motion::without_blocks).
    pub(super) const NONE: Self = Self {
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
        min_duration_s: f32::MAX,
        trapezoid: trapezoid::BrakingPlan::NONE,
        jerk_limited: jerk_limited::BlockPlan::NONE,
    };
}

/// A ring of blocks, with room for so many.
#[derive(Debug)]
#[repr(C)]
pub(super) struct BlockQueue<const ROOM: usize = BLOCKS> {
    /// Index of the oldest.
    pub(super) first: usize,
    /// Number of blocks.
    pub(super) count: usize,
    /// The blocks, in a ring.
    pub(super) ring: [QueuedBlock; ROOM],
}

impl<const ROOM: usize> BlockQueue<ROOM> {
    /// Empty.
    pub(super) const fn new() -> Self {
        Self {
            first: 0,
            count: 0,
            ring: [const { QueuedBlock::NONE }; ROOM],
        }
    }
}

impl BlockQueue {
    /// The number of blocks, the one in execution included.
    pub(super) const fn len(&self) -> usize {
        self.count
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The number of free entries.
    pub(super) const fn free(&self) -> usize {
        BLOCKS - self.count
    }

    /// The index of a block by its number, the oldest is 0.
    pub(super) const fn index(&self, number: usize) -> usize {
        self.first.wrapping_add(number) & (BLOCKS - 1)
    }

    /// A block by its number, the oldest is 0.
    #[inline]
    pub(super) fn get(&self, number: usize) -> &QueuedBlock {
        &self.ring[self.index(number)]
    }

    #[inline]
    pub(super) fn get_mut(&mut self, number: usize) -> &mut QueuedBlock {
        let index = self.index(number);
        &mut self.ring[index]
    }

    /// The newest block.
    #[inline]
    pub(super) fn newest(&self) -> Option<&QueuedBlock> {
        (self.count != 0).then(|| self.get(self.count - 1))
    }

    /// The block in execution.
    pub(super) fn current(&self) -> Option<&Block> {
        (self.count != 0).then(|| &self.ring[self.first & (BLOCKS - 1)].block)
    }

    /// Adds a block; there must be a free entry. Returns the entry.
    #[inline]
    pub(super) fn enqueue(&mut self, block: &Block) -> &mut QueuedBlock {
        let index = self.index(self.count);
        self.count += 1;
        let queued = &mut self.ring[index];
        queued.block = Block {
            curve: None,
            ..*block
        };
        if let Some(curve) = &block.curve {
            queued.block.curve = Some(*curve);
        }
        queued
    }

    /// Removes the block in execution.
    pub(super) const fn dequeue(&mut self) {
        if self.count != 0 {
            self.first = (self.first + 1) & (BLOCKS - 1);
            self.count -= 1;
        }
    }

    /// Removes all blocks.
    pub(super) const fn clear(&mut self) {
        self.first = 0;
        self.count = 0;
    }
}
