//! The demand of a row of the table at one step rate and baud rate: costs and arrivals.
//!
//! A row whose runs do a varying number of units of work is charged for its runs and for the units
//! separately: the units come at their own rate, however they are spread over runs.

use std::{collections::BTreeMap, rc::Rc};

use crate::{
    Point, Wcet,
    persistent_window::{PersistentCost, ResidentTasks},
    rta::Arrival,
    system::{Cost, System},
};

/// A row with a deadline at one point.
#[derive(Clone)]
pub(crate) struct RowDemand {
    pub(crate) row: usize,
    pub(crate) priority: u8,
    pub(crate) deadline: f64,
    /// When it runs.
    pub(crate) arrival: Arrival,
    /// A whole run, the longest.
    pub(crate) cost: Rc<Cost>,
    /// The parts of its work: runs, and units of work in them if their number varies.
    pub(crate) parts: Vec<Part>,
    pub(crate) units: Option<UnitCount>,
}

/// Work that arrives at its own rate.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub(crate) arrival: Arrival,
    pub(crate) wcet: Wcet,
}

/// How many units of work a run may have at most, and how many more than their rate says; and the
/// values of the bounds for a run without any.
#[derive(Clone)]
pub(crate) struct UnitCount {
    pub(crate) most: u64,
    pub(crate) extra: u64,
    pub(crate) without: BTreeMap<String, u64>,
}

impl UnitCount {
    /// The cost of a run and that of a unit, when a run with all units costs `all` and one with
    /// none `none`. Cost grows with the number of units, and ever faster: so the chord is above it.
    fn split(&self, none: u64, all: u64) -> [u64; 2] {
        let unit = all.saturating_sub(none).div_ceil(self.most.max(1));
        [none + self.extra * unit, unit]
    }
}

impl RowDemand {
    /// A row, if it has a deadline.
    pub(crate) fn new(
        system: &System<'_>,
        row: usize,
        named: &BTreeMap<String, u64>,
        point: Point,
    ) -> Result<Option<Self>, String> {
        let it = &system.rows[row];
        let Some((arrival, deadline)) = system.arrival(it, point)? else {
            return Ok(None);
        };
        let unbounded = || format!("`{}` has no bound", it.name);
        let cost = system.cost(row, named).ok_or_else(unbounded)?;
        let mut parts = vec![Part {
            arrival,
            wcet: cost.wcet,
        }];
        let mut counted = None;
        if let Some((bound, rate, extra)) = system.units(it, point)? {
            let most = named.get(&bound).copied().unwrap_or(0);
            let config = &system.config;
            let without = config.numbers_without(&system.clock, point, &bound)?;
            let none = system.cost(row, &without).ok_or_else(unbounded)?.wcet;
            let count = UnitCount {
                most,
                extra,
                without,
            };
            let [run, unit] = count.split(none.warm, cost.wcet.warm);
            let [run_uncached, unit_uncached] = count.split(none.uncached, cost.wcet.uncached);
            let wcet = |warm, uncached| Wcet {
                warm,
                cold: 0,
                uncached,
            };
            parts[0].wcet = wcet(run, run_uncached);
            parts.push(Part {
                arrival: rate,
                wcet: wcet(unit, unit_uncached),
            });
            counted = Some(count);
        }
        Ok(Some(Self {
            row,
            priority: it.task.priority,
            deadline,
            arrival,
            cost,
            parts,
            units: counted,
        }))
    }

    /// The same row with so many more runs in any window, as far as their spacing allows.
    pub(crate) fn with_more(&self, count: f64) -> Self {
        let more = |arrival: &mut Arrival| {
            arrival.sustained = arrival.sustained.map(|(rate, burst)| (rate, burst + count));
        };
        let mut new = self.clone();
        more(&mut new.arrival);
        if let Some(runs) = new.parts.first_mut() {
            more(&mut runs.arrival);
        }
        new
    }

    /// Returns the cost of a run without any units of work, not even those beyond its share, and
    /// the cost of a unit, given the costs of its parts.
    pub(crate) fn run_and_unit(&self, costs: &[u64]) -> (u64, u64) {
        match (costs, &self.units) {
            ([run, unit], Some(units)) => (run.saturating_sub(units.extra * unit), *unit),
            ([run, ..], _) => (*run, 0),
            ([], _) => (0, 0),
        }
    }

    /// The streams of its work with persistent loops, and how many lines a visit loads at most.
    pub(crate) fn persistent_streams(
        &self,
        system: &System<'_>,
        named: &BTreeMap<String, u64>,
        resident: &ResidentTasks,
    ) -> Option<(Vec<(Arrival, PersistentCost)>, u64)> {
        let (all, visit) = system.persistent_cost(self.row, named, resident)?;
        let Some(units) = &self.units else {
            return Some((vec![(self.arrival, all)], visit));
        };
        let (none, _) = system.persistent_cost(self.row, &units.without, resident)?;
        let alone = units.split(none.alone, all.alone);
        let cycles = units.split(none.all, all.all);
        let parts = self.parts.iter().enumerate().map(|(index, part)| {
            let persistent = PersistentCost {
                alone: alone[index],
                all: cycles[index],
            };
            (part.arrival, persistent)
        });
        Some((parts.collect(), visit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_and_its_pieces_cost_no_less_than_the_whole() {
        let units = UnitCount {
            most: 30,
            extra: 3,
            without: BTreeMap::new(),
        };
        let [run, unit] = units.split(1000, 10_001);
        assert_eq!((run, unit), (1000 + 3 * 301, 301));
        // Costs that grow ever faster stay below the chord.
        let cost = |units: u64| 1000 + units * units * 10;
        let [run, unit] = UnitCount { extra: 0, ..units }.split(cost(0), cost(30));
        assert!((0..=30).all(|units| run + units * unit >= cost(units)));
    }
}
