//! Response times where loops are persistent in the cache, and code outside of them is cut into
//! stretches that leave room for the tasks which preempt it most often: see [`crate::persistence`].
//!
//! In a visit of such a loop, and in a stretch, each line of these tasks is missed once at most. So
//! the runs of some are *warm*, and what loads their lines is charged to the code that evicts them.
//! Others are *cold*: they pay for what they miss, and only take room. Any other preempting task may
//! evict everything: a visit begins anew behind it.
//!
//! So the demand is a sum: so much for each run and each unit of work, wherever it falls.

use std::collections::BTreeSet;

use crate::persistence::Share;

/// The tasks whose lines are resident in the cache beside those of loops and stretches.
#[derive(Debug, Clone)]
pub(crate) struct ResidentTasks {
    /// Their rows.
    pub(crate) rows: Vec<usize>,
    /// Their lines.
    pub(crate) lines: BTreeSet<u32>,
    /// What code costs the warm ones among them.
    pub(crate) share: Share,
}

/// What one run of a row costs with persistent loops.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct PersistentCost {
    /// Cycles, the loading of its loops' code included.
    pub(crate) alone: u64,
    /// With what it costs the warm tasks.
    pub(crate) all: u64,
}
