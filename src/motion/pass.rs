//! Passes over the plan, in parts: entry speeds behind a new block, and all speeds under other
//! overrides.
//!
//! Between two parts the plan can be followed. Behind a new block speeds only rise. After a change of
//! overrides they may fall, from the newest block back: a machine that comes to a place where the
//! braking before it is not yet planned brakes as hard as it can, which keeps it within the plan
//! before.

use core::sync::atomic::{Ordering::SeqCst, compiler_fence};

use super::{
    lookahead::Plan,
    segment_rate::{limit_block_rate, limit_segment_rate},
};
use crate::{math, model::Overrides};

/// Blocks that a part of a pass goes through, and one of a backward pass.
const SPEEDS_PER_PART: usize = 32;
const BRAKING_PER_PART: usize = 64;

/// Whether the machine has come to the speeds planned, or is still faster after a change of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::motion) enum PassProgress {
    /// It is within the plan.
    Followed,
    /// It is still braking to the speeds planned.
    Behind,
}

/// What is left to be planned anew.
#[derive(Debug, Clone, Copy)]
pub(super) enum Pass {
    Done,
    /// The speeds of blocks, from this number on, the oldest is 0; that of the block before.
    Speeds {
        number: usize,
        before_mm_s: f32,
        progress: PassProgress,
    },
    /// How blocks are begun where acceleration is continuous, from this number on, and how far ahead
    /// of the reference that is.
    BlockLimits {
        number: usize,
        ahead_mm: f32,
    },
    /// Entry speeds, from this number back, the newest is 1; that of the block behind, squared.
    Brake {
        back: usize,
        exit_sqr: f32,
        /// All have to be found, whether they change or not.
        is_new: bool,
    },
}

impl Pass {
    /// Entry speeds that a new block changes.
    pub(super) const NEWEST_ENTRIES: Self = Self::Brake {
        back: 1,
        exit_sqr: 0.0,
        is_new: false,
    };

    /// Entry speeds of all blocks.
    pub(super) const ALL_ENTRIES: Self = Self::Brake {
        back: 1,
        exit_sqr: 0.0,
        is_new: true,
    };
}

impl<const N: usize> Plan<N> {
    /// Whether there is more to be planned, by [`Plan::go_on`].
    #[must_use]
    pub const fn is_unfinished(&self) -> bool {
        !matches!(self.pass, Pass::Done)
    }

    /// Whether that is because of other overrides: the machine may become faster than is planned.
    #[must_use]
    pub const fn changes_speeds(&self) -> bool {
        match self.pass {
            Pass::Done => false,
            Pass::Speeds { .. } | Pass::BlockLimits { .. } => true,
            Pass::Brake { is_new, .. } => is_new,
        }
    }

    /// Puts all blocks, and those to come, under other overrides, and begins to plan anew.
    ///
    /// A block in execution saves nothing, as nobody knows how much of it is left; the others save
    /// no more than at the speed before. Nor do they as long as the machine is faster than it.
    pub(in crate::motion) fn replan(&mut self, overrides: Overrides, progress: PassProgress) {
        self.overrides = overrides;
        self.pass = Pass::Speeds {
            number: 0,
            before_mm_s: 0.0,
            progress: if self.changes_speeds() {
                PassProgress::Behind
            } else {
                progress
            },
        };
    }

    /// A part of the pass.
    #[inline(never)]
    pub fn continue_pass(&mut self) {
        match self.pass {
            Pass::Done => {}
            Pass::Speeds {
                number,
                before_mm_s,
                progress,
            } => self.plan_speeds_part(number, before_mm_s, progress),
            Pass::BlockLimits { number, ahead_mm } => self.plan_blocks_part(number, ahead_mm),
            Pass::Brake {
                back,
                exit_sqr,
                is_new,
            } => {
                if self.is_jerk_limited() {
                    self.plan_junctions_part(back, is_new);
                } else {
                    self.plan_braking_part(back, exit_sqr, is_new);
                }
            }
        }
        // So that none of these calls becomes a jump under a condition, which the proof would charge
        // to both of its ways.
        compiler_fence(SeqCst);
    }

    /// Speeds of blocks under the overrides, and the limits of entry speeds that follow. Apart, as the
    /// passes of gates are: registers are saved only where they are needed.
    #[inline(never)]
    fn plan_speeds_part(&mut self, from: usize, mut before_mm_s: f32, progress: PassProgress) {
        let end = self.count.min(from + SPEEDS_PER_PART);
        let mut spare_s = if from == 0 { 0.0 } else { self.slack_s };
        // wcet-bound: 32
        for number in from..end {
            let planned = &mut self.ring[(self.first + number) & (N - 1)];
            let block = &mut planned.block;
            let (mut speed_mm_s, left_s) = limit_segment_rate(
                block,
                block.nominal_under(self.overrides),
                planned.min_duration_s,
                spare_s,
            );
            if self.window != 0 {
                speed_mm_s = limit_block_rate(block, speed_mm_s);
            }
            let saves = number != 0 && progress == PassProgress::Followed;
            spare_s = if saves { left_s } else { 0.0 };
            block.nominal_mm_s = speed_mm_s;
            let slower = math::min(speed_mm_s, before_mm_s);
            planned.limit_sqr = math::min(block.junction_sqr, slower * slower);
            before_mm_s = speed_mm_s;
        }
        self.slack_s = spare_s;
        self.pass = if end == self.count {
            if self.is_jerk_limited() {
                Pass::BlockLimits {
                    number: 0,
                    ahead_mm: 0.0,
                }
            } else {
                Pass::ALL_ENTRIES
            }
        } else {
            Pass::Speeds {
                number: end,
                before_mm_s,
                progress,
            }
        };
    }

    /// A part of the backward pass.
    pub(super) fn plan_braking_part(&mut self, from: usize, exit_sqr: f32, is_new: bool) {
        if is_new {
            self.brake_part::<true>(from, exit_sqr);
        } else {
            self.brake_part::<false>(from, exit_sqr);
        }
    }

    /// The same for each of the two passes, as it is asked for each block which of them it is.
    #[inline(never)]
    fn brake_part<const IS_NEW: bool>(&mut self, from: usize, mut exit_sqr: f32) {
        self.pass = Pass::Done;
        // A part ends where the ring does, so that its blocks are in a row; and before the block in
        // execution, whose entry is history.
        let newest = (self.first + self.count).wrapping_sub(from) & (N - 1);
        let left = self.count.saturating_sub(from);
        let blocks = left.min(BRAKING_PER_PART).min(newest + 1);
        let row = self.ring.get_mut(newest + 1 - blocks..=newest);
        // wcet-bound: 64
        for planned in row.unwrap_or_default().iter_mut().rev() {
            let braked_sqr = match &planned.block.curve {
                None => planned.braking.line_entry_for(exit_sqr),
                Some(curve) => {
                    core::hint::cold_path();
                    if planned.entry_sqr == planned.limit_sqr && !IS_NEW {
                        // It cannot rise; a root could round it down.
                        return;
                    }
                    planned.braking.curve_entry_for(exit_sqr, curve)
                }
            };
            exit_sqr = math::min(planned.limit_sqr, braked_sqr);
            if exit_sqr == planned.entry_sqr && !IS_NEW {
                return;
            }
            planned.entry_sqr = exit_sqr;
        }
        if blocks < left {
            self.pass = Pass::Brake {
                back: from + blocks,
                exit_sqr,
                is_new: IS_NEW,
            };
        }
    }
}
