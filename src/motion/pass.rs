//! What remains of a pass over the plan: passes are made in parts.

/// Whether the machine has come to the speeds planned, or is still faster after a change of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::motion) enum PassProgress {
    /// It is within the plan.
    Followed,
    /// It is still braking to the speeds planned.
    Braking,
}

/// The rest of a pass over the plan.
#[derive(Debug, Clone, Copy)]
pub(super) enum Pass {
    Done,
    /// Speeds of blocks under other overrides, from the block `number` on, the oldest is 0; the
    /// speed of the block before it.
    Speeds {
        number: usize,
        before_mm_s: f32,
        progress: PassProgress,
    },
    /// Entry speeds, from the block `back` on backwards, the newest is 1; the squared entry speed of
    /// the block behind it.
    EntrySpeeds {
        back: usize,
        exit_sqr: f32,
        /// A block whose entry does not change does not end the pass.
        is_new: bool,
    },
}

impl Pass {
    /// Entry speeds that a new block changes.
    pub(super) const NEWEST_ENTRY_SPEEDS: Self = Self::EntrySpeeds {
        back: 1,
        exit_sqr: 0.0,
        is_new: false,
    };

    /// Entry speeds of all blocks.
    pub(super) const ALL_ENTRY_SPEEDS: Self = Self::EntrySpeeds {
        back: 1,
        exit_sqr: 0.0,
        is_new: true,
    };
}
