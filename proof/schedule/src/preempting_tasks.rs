//! The tasks that preempt a row with persistent loops: warm or cold, and the cost of their runs.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    persistence::Share,
    persistent_window::{PersistentCost, ResidentTasks},
    row_demand::RowDemand,
    rta::Arrival,
    system::System,
};

/// The arrivals and costs of a row's work, and the most lines that one of its visits loads.
pub(crate) type Streams = (Vec<(Arrival, PersistentCost)>, u64);

/// The preempting tasks.
pub(crate) struct PreemptingTasks<'a> {
    system: &'a System<'a>,
    named: &'a BTreeMap<String, u64>,
    /// Rows of the warm tasks, and of the cold ones.
    pub(crate) warm: Vec<usize>,
    pub(crate) cold: Vec<usize>,
    pub(crate) cached: ResidentTasks,
}

impl<'a> PreemptingTasks<'a> {
    /// The first of the preempting tasks are warm, the next are cold. `None`: the cache
    /// does not hold their lines.
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

    /// Returns the cost of a row, and the most lines that one of its visits loads.
    pub(crate) fn run(&self, row: usize) -> Option<(PersistentCost, u64)> {
        self.system.persistent_cost(row, self.named, &self.cached)
    }

    /// Returns the streams of a row's work with their costs.
    pub(crate) fn streams(&self, row_demand: &RowDemand) -> Option<Streams> {
        row_demand.persistent_streams(self.system, self.named, &self.cached)
    }

    /// Returns the cost of one run of a preempting task, with the delay of the preempted tasks and
    /// of the tasks that preempt the run. `visit`: most lines that one visit loads; `restart`:
    /// cycles for which a preemption delays the preempted tasks; `reload`: cycles for the lines
    /// that the preempted tasks lose, if the cache does not keep them.
    pub(crate) fn cost(
        &self,
        row_demand: &RowDemand,
        visit: u64,
        (restart, reload): (u64, u64),
    ) -> Option<u64> {
        if self.warm.contains(&row_demand.row) {
            return Some(row_demand.cost.wcet.warm + restart);
        }
        if self.cold.contains(&row_demand.row) {
            return Some(row_demand.cost.wcet.uncached + restart + reload);
        }
        // A run may end a visit, and thereby a stretch.
        let visit_cost = visit * self.system.model.miss() + self.cached.share.of_visit;
        Some(self.run(row_demand.row)?.0.all + restart + reload + visit_cost)
    }
}
