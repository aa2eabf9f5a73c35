//! A row of the table at one step rate and baud rate: what it costs, and when.
//!
//! A row whose runs do a varying number of pieces of work is charged for its runs and for the pieces
//! apart: the pieces come at their own rate, however they are spread over runs.

use std::{collections::BTreeMap, rc::Rc};

use crate::{
    Point, Wcet,
    keeping::{Beside, Kept},
    rta::Arrival,
    subject::{Cost, Subject},
};

/// A row with a deadline at one point.
#[derive(Clone)]
pub(crate) struct Member {
    pub(crate) row: usize,
    pub(crate) priority: u8,
    pub(crate) deadline: f64,
    /// When it runs.
    pub(crate) arrival: Arrival,
    /// A whole run, the longest.
    pub(crate) cost: Rc<Cost>,
    /// What its work consists of: runs, and pieces of work in them if their number varies.
    pub(crate) parts: Vec<Part>,
    pub(crate) units: Option<UnitCount>,
}

/// Work that arrives at its own rate.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub(crate) arrival: Arrival,
    pub(crate) wcet: Wcet,
}

/// How many pieces of work a run may have at most, and how many more than their rate says; and the
/// values of the bounds for a run without any.
#[derive(Clone)]
pub(crate) struct UnitCount {
    pub(crate) most: u64,
    pub(crate) extra: u64,
    pub(crate) without: BTreeMap<String, u64>,
}

impl UnitCount {
    /// The cost of a run and that of a piece, when a run with all pieces costs `all` and one with
    /// none `none`. Cost grows with the number of pieces, and ever faster: so the chord is above it.
    fn split(&self, none: u64, all: u64) -> [u64; 2] {
        let piece = all.saturating_sub(none).div_ceil(self.most.max(1));
        [none + self.extra * piece, piece]
    }
}

impl Member {
    /// A row, if it has a deadline.
    pub(crate) fn new(
        subject: &Subject<'_>,
        row: usize,
        named: &BTreeMap<String, u64>,
        point: Point,
    ) -> Result<Option<Self>, String> {
        let it = &subject.rows[row];
        let Some((arrival, deadline)) = subject.arrival(it, point)? else {
            return Ok(None);
        };
        let unbounded = || format!("`{}` has no bound", it.name);
        let cost = subject.cost(row, named).ok_or_else(unbounded)?;
        let mut parts = vec![Part {
            arrival,
            wcet: cost.wcet,
        }];
        let mut counted = None;
        if let Some((bound, rate, extra)) = subject.units(it, point)? {
            let most = named.get(&bound).copied().unwrap_or(0);
            let config = &subject.config;
            let without = config.numbers_without(&subject.clock, point, &bound)?;
            let none = subject.cost(row, &without).ok_or_else(unbounded)?.wcet;
            let count = UnitCount {
                most,
                extra,
                without,
            };
            let [run, piece] = count.split(none.warm, cost.wcet.warm);
            let [run_uncached, piece_uncached] = count.split(none.uncached, cost.wcet.uncached);
            let wcet = |warm, uncached| Wcet {
                warm,
                cold: 0,
                uncached,
            };
            parts[0].wcet = wcet(run, run_uncached);
            parts.push(Part {
                arrival: rate,
                wcet: wcet(piece, piece_uncached),
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

    /// The same row with so many more runs in any window, as far as they are apart enough.
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

    /// What a run costs without any pieces of work, not even those that it may have beside its share,
    /// and what a piece costs, by the costs of its parts.
    pub(crate) fn run_and_piece(&self, costs: &[u64]) -> (u64, u64) {
        match (costs, &self.units) {
            ([run, piece], Some(units)) => (run.saturating_sub(units.extra * piece), *piece),
            ([run, ..], _) => (*run, 0),
            ([], _) => (0, 0),
        }
    }

    /// The streams of its work where loops keep their code, and how many lines a visit loads at most.
    pub(crate) fn kept(
        &self,
        subject: &Subject<'_>,
        named: &BTreeMap<String, u64>,
        beside: &Beside,
    ) -> Option<(Vec<(Arrival, Kept)>, u64)> {
        let (all, visit) = subject.kept(self.row, named, beside)?;
        let Some(units) = &self.units else {
            return Some((vec![(self.arrival, all)], visit));
        };
        let (none, _) = subject.kept(self.row, &units.without, beside)?;
        let alone = units.split(none.alone, all.alone);
        let cycles = units.split(none.all, all.all);
        let parts = self.parts.iter().enumerate().map(|(index, part)| {
            let kept = Kept {
                alone: alone[index],
                all: cycles[index],
            };
            (part.arrival, kept)
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
        let [run, piece] = units.split(1000, 10_001);
        assert_eq!((run, piece), (1000 + 3 * 301, 301));
        // Costs that grow ever faster stay below the chord.
        let cost = |pieces: u64| 1000 + pieces * pieces * 10;
        let [run, piece] = UnitCount { extra: 0, ..units }.split(cost(0), cost(30));
        assert!((0..=30).all(|pieces| run + pieces * piece >= cost(pieces)));
    }
}
