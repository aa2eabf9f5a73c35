//! The plan of the trapezoidal profile: entry speeds from which each block can be braked in.

use super::braking::Braking;
use crate::{
    math,
    motion::{
        pass::Pass,
        queue::{BLOCKS, BlockQueue},
    },
    path::Block,
};

/// Blocks of one part of a backward pass.
const BLOCKS_PER_PART: usize = 64;

/// What is planned of a block.
#[derive(Debug)]
pub(in crate::motion) struct BrakingPlan {
    /// Planned squared entry speed, (mm/s)².
    entry_sqr: f32,
    /// What braking in the block changes.
    braking: Braking,
}

impl BrakingPlan {
    pub(in crate::motion) const NONE: Self = Self {
        entry_sqr: 0.0,
        braking: Braking::NONE,
    };

    /// Of a new block: no entry speed is as low, so that the pass changes it.
    pub(in crate::motion) fn new(block: &Block) -> Self {
        Self {
            entry_sqr: -1.0,
            braking: Braking::new(block),
        }
    }
}

impl BlockQueue {
    /// The squared speed at which the block in execution may be left: 0 when no other follows.
    pub(in crate::motion) fn exit_sqr(&self) -> f32 {
        if self.len() > 1 {
            self.get(1).trapezoid.entry_sqr
        } else {
            0.0
        }
    }
}

/// Plans a part of the backward pass: entry speeds from the block `from` on backwards, the newest is
/// 1, which may be left at `exit_sqr`. With `is_new` an unchanged entry does not end the pass.
pub(in crate::motion) fn plan_part(
    queue: &mut BlockQueue,
    pass: &mut Pass,
    from: usize,
    exit_sqr: f32,
    is_new: bool,
) {
    if is_new {
        backward_part::<true>(queue, pass, from, exit_sqr);
    } else {
        backward_part::<false>(queue, pass, from, exit_sqr);
    }
}

#[inline(never)]
fn backward_part<const IS_NEW: bool>(
    queue: &mut BlockQueue,
    pass: &mut Pass,
    from: usize,
    mut exit_sqr: f32,
) {
    *pass = Pass::Done;
    // A part ends where the ring does, so that its blocks are in a row; and before the block in
    // execution, whose entry is history.
    let newest = (queue.first + queue.count).wrapping_sub(from) & (BLOCKS - 1);
    let remaining = queue.count.saturating_sub(from);
    let blocks = remaining.min(BLOCKS_PER_PART).min(newest + 1);
    let row = queue.ring.get_mut(newest + 1 - blocks..=newest);
    // wcet-bound: 64
    for queued in row.unwrap_or_default().iter_mut().rev() {
        let plan = &mut queued.trapezoid;
        let braked_sqr = match &queued.block.curve {
            None => plan.braking.line_entry_for(exit_sqr),
            Some(curve) => {
                core::hint::cold_path();
                if plan.entry_sqr == queued.limit_sqr && !IS_NEW {
                    // It cannot rise; a root could round it down.
                    return;
                }
                plan.braking.curve_entry_for(exit_sqr, curve)
            }
        };
        exit_sqr = math::min(queued.limit_sqr, braked_sqr);
        if exit_sqr == plan.entry_sqr && !IS_NEW {
            return;
        }
        plan.entry_sqr = exit_sqr;
    }
    if blocks < remaining {
        *pass = Pass::EntrySpeeds {
            back: from + blocks,
            exit_sqr,
            is_new: IS_NEW,
        };
    }
}
