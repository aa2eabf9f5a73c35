//! The tasks that preempt a row with persistent loops: which of them are warm, and what a run of each
//! costs.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    persistence::Share,
    persistent_window::{PersistentCost, ResidentTasks},
    row_demand::RowDemand,
    rta::Arrival,
    system::System,
};

/// What a row has to do, and how many lines one of its visits loads at most.
pub(crate) type Streams = (Vec<(Arrival, PersistentCost)>, u64);

/// The preempting tasks.
pub(crate) struct PreemptingTasks<'a> {
    system: &'a System<'a>,
    named: &'a BTreeMap<String, u64>,
    /// Rows of the warm tasks, and of the cold ones.
    warm: Vec<usize>,
    cold: Vec<usize>,
    pub(crate) cached: ResidentTasks,
}

impl<'a> PreemptingTasks<'a> {
    /// Of those that preempt, the first are warm, those next are cold. `None`: the cache does not hold
    /// so much.
    pub(crate) fn new(
        system: &'a System<'a>,
        named: &'a BTreeMap<String, u64>,
        preempting: &[&RowDemand],
        (warm, cold): (usize, usize),
    ) -> Option<Self> {
        let (warm, others) = preempting.split_at_checked(warm)?;
        let cold = others.get(..cold)?;
        let rows = |row_demands: &[&RowDemand]| row_demands.iter().map(|it| it.row).collect();
        let lines = |row_demands: &[&RowDemand]| -> BTreeSet<u32> {
            let lines = row_demands.iter().flat_map(|it| &it.cost.lines);
            lines.copied().collect()
        };
        let all = [warm, cold].concat();
        let sizes = (lines(warm).len(), lines(&all).len());
        Some(Self {
            system,
            named,
            warm: rows(warm),
            cold: rows(cold),
            cached: ResidentTasks {
                rows: rows(&all),
                lines: lines(&all),
                share: Share::new(sizes.0, sizes.1, system.model.miss())?,
            },
        })
    }

    /// What a row costs, and how many lines one of its visits loads at most.
    pub(crate) fn run(&self, row: usize) -> Option<(PersistentCost, u64)> {
        self.system.persistent_cost(row, self.named, &self.cached)
    }

    /// The same by the streams of its work.
    pub(crate) fn streams(&self, row_demand: &RowDemand) -> Option<Streams> {
        row_demand.persistent_streams(self.system, self.named, &self.cached)
    }

    /// What a run of a task that preempts costs, with what it costs those that it preempts and those
    /// that preempt it. `visit`: most lines that one loads; `restart`: what it costs those that it preempts;
    /// `again`: the same of the cache, if it does not stay for them.
    pub(crate) fn cost(
        &self,
        row_demand: &RowDemand,
        visit: u64,
        (restart, again): (u64, u64),
    ) -> Option<u64> {
        if self.warm.contains(&row_demand.row) {
            return Some(row_demand.cost.wcet.warm + restart);
        }
        if self.cold.contains(&row_demand.row) {
            return Some(row_demand.cost.wcet.uncached + restart + again);
        }
        // It may end a visit, and with that a stretch.
        let reload = visit * self.system.model.miss() + self.cached.share.of_visit;
        Some(self.run(row_demand.row)?.0.all + restart + again + reload)
    }
}
