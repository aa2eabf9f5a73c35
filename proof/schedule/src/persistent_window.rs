//! Response times with persistent loops, see [`crate::persistence`].
//!
//! In a visit of a persistent loop, and in a stretch of other code, each line of the most frequent
//! preempting tasks is missed once at most. So some of these tasks are *warm*: the reloading of their
//! lines is charged to the code that evicts them. Others are *cold*: they pay for their own misses, and
//! only occupy lines. Any other preempting task may evict everything, and the preempted visit begins
//! anew.
//!
//! So the demand is a sum: a cost for each run and each unit of work, wherever it falls in the window.

use std::collections::BTreeSet;

use crate::persistence::Share;

/// The tasks whose lines stay in the cache together with the lines of loops and stretches.
#[derive(Debug, Clone)]
pub(crate) struct ResidentTasks {
    /// Their rows.
    pub(crate) rows: Vec<usize>,
    /// Their lines.
    pub(crate) lines: BTreeSet<u32>,
    /// The share by which code pays for the lines of the warm tasks.
    pub(crate) share: Share,
}

/// The cost of one run of a row with persistent loops.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct PersistentCost {
    /// Cycles, the loading of its loops' code included.
    pub(crate) alone: u64,
    /// With its share of the misses of warm tasks.
    pub(crate) all: u64,
}
