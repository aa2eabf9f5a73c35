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

use crate::{
    persistence::Share,
    rta::{self, Arrival, Load},
};

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

/// The window of a row with persistent loops.
pub(crate) struct PersistentWindow {
    /// What the row itself has to do: the last stream is the one whose ends count.
    pub(crate) own: Vec<(Arrival, PersistentCost)>,
    /// Rows of the same priority.
    pub(crate) equals: Vec<(Arrival, PersistentCost)>,
    /// What preempts, with what it costs those that it preempts, and those that preempt it.
    pub(crate) preempting: Vec<Load>,
    /// What the window pays once.
    pub(crate) once: u64,
}

impl PersistentWindow {
    /// The response time.
    pub(crate) fn response(&self, limit: u64) -> Option<u64> {
        let (arrival, _) = self.own.last()?;
        rta::worst(arrival, self.once, limit, |window, jobs| {
            self.demand(window, jobs)
        })
    }

    fn demand(&self, window: u64, jobs: u64) -> u64 {
        let counts = rta::arrived(self.own.iter().map(|(arrival, _)| *arrival), jobs);
        let own = counts.iter().zip(&self.own);
        let own = own.map(|(count, (_, cost))| count * cost.all);
        let count = |arrival: &Arrival| arrival.count(window).max(1);
        let equals = self.equals.iter();
        let equals = equals.map(|(arrival, cost)| count(arrival) * cost.all);
        let preempting = self.preempting.iter();
        let preempting = preempting.map(|it| count(&it.arrival) * it.cost);
        self.once + own.chain(equals).chain(preempting).sum::<u64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn every(period: f64) -> Arrival {
        Arrival {
            period,
            group: 1,
            sustained: None,
            jitter: 0.0,
        }
    }

    #[test]
    fn all_that_preempts_comes_on_top() {
        let cost = PersistentCost {
            alone: 19_000,
            all: 20_000,
        };
        let preempting = |period, cost| Load {
            arrival: every(period),
            cost,
        };
        let window = PersistentWindow {
            own: vec![(every(1e6), cost)],
            equals: vec![(every(1e6), cost)],
            preempting: vec![preempting(1000.0, 137), preempting(1e9, 500)],
            once: 100,
        };
        // 137 of each 1000 cycles are the warm task's: 48 runs in 47 176.
        assert_eq!(
            window.response(1_000_000),
            Some(100 + 40_000 + 500 + 48 * 137)
        );
    }
}
