//! Runs that may come instead of units of work: `[substitution]` of `schedule.toml`.
//!
//! Runs of a row come at their rate, and units of work in them at theirs. Where fewer units come
//! than that rate allows, more runs may: in any window, one for so many units. Let one such run
//! cost no more than these units, and the runs that come with it no more than the runs that come
//! with these units. Then no window demands more than a window in which runs and units come at
//! their rates, and every proof for the latter holds.
//!
//! Each of the two comparisons holds by itself: the row is ahead of the runs that come with its
//! runs, so a window may have the runs of one stretch of time and the accompanying runs of another.
//!
//! The argument needs a demand that is a sum: a cost for each run and each unit, wherever in the window it falls.

use std::collections::BTreeMap;

use crate::{Point, row_demand::RowDemand, system::System};

/// A substitution at one step rate and baud rate.
#[derive(Debug, Clone)]
pub(crate) struct Substitution {
    /// The row, and the row of its runs that replace units.
    row: usize,
    kind: usize,
    /// Units for one run.
    units: u64,
    /// Units that a window may have beyond the units of its whole runs.
    rounding: u64,
    /// Runs of other rows that come with a run, and with a unit.
    with_run: BTreeMap<usize, u64>,
    with_unit: BTreeMap<usize, u64>,
}

/// The cost of a substituted run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SubstitutionCost {
    /// The equivalent number of units.
    pub(crate) units: f64,
    /// The cost of the units that rounding adds to a window, cycles.
    pub(crate) once: u64,
}

impl Substitution {
    /// The substitution of `schedule.toml`; empty without one, or where its rows are not known.
    ///
    /// Two substitutions are returned, since rounding can be counted in two ways, each of which is
    /// safe: a window has more units; or, as rounding matters only where there is a run more, the
    /// first such run replaces fewer units.
    ///
    /// # Errors
    ///
    /// Tells which formula is wrong.
    pub(crate) fn all(system: &System<'_>, point: Point) -> Result<Vec<Self>, String> {
        let Some(substitution) = &system.config.substitution else {
            return Ok(Vec::new());
        };
        let kinds = system.rows.iter().enumerate();
        let mut kinds = kinds.filter_map(|(kind, row)| Some((kind, row.kind_of?)));
        let Some((kind, row)) = kinds.next() else {
            return Ok(Vec::new());
        };
        let names = system.config.names(&system.clock, point);
        let rows = |given: &BTreeMap<String, u64>| {
            let rows = system.rows.iter().enumerate();
            rows.filter_map(|(index, row)| Some((index, *given.get(&row.name)?)))
                .collect()
        };
        let more = Self {
            row,
            kind,
            units: substitution.units.value(&names)?.max(0.0) as u64,
            rounding: substitution.rounding.value(&names)?.max(0.0).ceil() as u64,
            with_run: rows(&substitution.with_run),
            with_unit: rows(&substitution.with_unit),
        };
        let fewer = Self {
            units: more.units.saturating_sub(more.rounding),
            rounding: 0,
            ..more.clone()
        };
        Ok(vec![fewer, more])
    }

    /// The row of the runs that come instead of units, and for how many.
    pub(crate) const fn kind(&self) -> usize {
        self.kind
    }

    pub(crate) const fn units(&self) -> u64 {
        self.units
    }

    pub(crate) const fn units_and_rounding(&self) -> (u64, u64) {
        (self.units, self.rounding)
    }

    /// The runs of other rows that come with a run, and with a unit.
    pub(crate) const fn with(&self) -> [&BTreeMap<usize, u64>; 2] {
        [&self.with_run, &self.with_unit]
    }

    /// Whether runs are substituted in a regime.
    pub(crate) fn is_in(&self, system: &System<'_>, regime: Option<&str>) -> bool {
        let own = system.regime(self.row);
        own.is_none() || own == regime
    }

    /// The rows with the runs that rounding adds.
    pub(crate) fn rounded(&self, row_demands: &[RowDemand]) -> Vec<RowDemand> {
        let rounded = row_demands.iter().map(|it| {
            let runs = self.rounding * self.with_unit.get(&it.row).unwrap_or(&0);
            it.with_more(runs as f64)
        });
        rounded.collect()
    }

    /// Returns the cost of a run in a window of these rows, from the costs of the parts of each
    /// row. `None`: the run costs more than the units that it replaces, or the runs that come with
    /// it cost more than the runs that come with the units.
    pub(crate) fn cost(
        &self,
        rows: &[&RowDemand],
        all: &[RowDemand],
        cost: impl Fn(&RowDemand) -> Option<Vec<u64>>,
    ) -> Option<SubstitutionCost> {
        let (mut own, mut with) = ((0, 0), (0, 0));
        for row_demand in rows {
            let (run, unit) = row_demand.run_and_unit(&cost(row_demand)?);
            with.0 += run * self.with_run.get(&row_demand.row).unwrap_or(&0);
            with.1 += run * self.with_unit.get(&row_demand.row).unwrap_or(&0);
            if row_demand.row == self.row {
                let kind = all.iter().find(|it| it.row == self.kind)?;
                own = (kind.run_and_unit(&cost(kind)?).0, unit);
            }
        }
        let is_paid = |(run, unit)| run <= self.units * unit;
        let units = |(run, unit): (u64, u64)| run as f64 / unit.max(1) as f64;
        (is_paid(own) && is_paid(with)).then(|| SubstitutionCost {
            units: units(own).max(units(with)),
            once: self.rounding * own.1,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{row_demand::Part, rta::Arrival};
    use proptest::prelude::*;
    use std::rc::Rc;

    /// Runs come each 700 cycles, and some sooner; units come each 10 cycles. A run is worth
    /// `PRICE` units, and the runs of a segment may have one unit more than their share.
    const MEAN: f64 = 700.0;
    const SAVED: f64 = 3.0;
    const EACH: f64 = 10.0;
    const PRICE: f64 = 25.0;

    fn row_demand(row: usize, parts: usize) -> RowDemand {
        let arrival = Arrival {
            period: 10.0,
            group: 1,
            sustained: Some((0.1, 2.0)),
            jitter: 0.0,
        };
        let part = Part {
            arrival,
            wcet: crate::Wcet::default(),
        };
        RowDemand {
            row,
            priority: 1,
            deadline: 100.0,
            arrival,
            cost: Rc::default(),
            parts: vec![part; parts],
            units: (parts > 1).then(|| crate::row_demand::UnitCount {
                most: 30,
                extra: 2,
                without: BTreeMap::new(),
            }),
        }
    }

    fn substitution(units: u64) -> Substitution {
        Substitution {
            row: 0,
            kind: 1,
            units,
            rounding: 3,
            with_run: BTreeMap::from([(2, 1), (3, 2)]),
            with_unit: BTreeMap::from([(3, 2)]),
        }
    }

    #[test]
    fn a_run_costs_what_comes_with_it_too() {
        let all = [
            row_demand(0, 2),
            row_demand(1, 2),
            row_demand(2, 1),
            row_demand(3, 1),
        ];
        // With each run two units more; one of the kind that is substituted costs less.
        let costs = [vec![1020, 10], vec![820, 10], vec![100], vec![20]];
        let substitution_cost = |units, rows: &[usize]| {
            let rows: Vec<&RowDemand> = rows.iter().map(|row| &all[*row]).collect();
            substitution(units).cost(&rows, &all, |it| Some(costs[it.row].clone()))
        };
        // 800 for units of 10, and 100 + 2 * 20 for units of 2 * 20.
        let found = substitution_cost(80, &[0, 2, 3]).unwrap();
        assert_eq!((found.units, found.once), (80.0, 30));
        assert_eq!(substitution_cost(79, &[0, 2, 3]), None);
        let found = substitution_cost(80, &[2, 3]).unwrap();
        assert_eq!((found.units, found.once), (140.0 / 40.0, 0));
        assert_eq!(substitution_cost(3, &[2, 3]), None);
        // Where neither the runs nor their units matter.
        let found = substitution_cost(25, &[3]).unwrap();
        assert_eq!((found.units, found.once), (1.0, 0));
    }

    #[test]
    fn rounding_adds_what_comes_with_units() {
        let rounded = substitution(25).rounded(&[row_demand(0, 2), row_demand(3, 1)]);
        let bursts = rounded.iter().map(|it| it.arrival.sustained.unwrap().1);
        assert_eq!(bursts.collect::<Vec<_>>(), [2.0, 8.0]);
    }

    /// Runs, each with how long it lasts and its units: none before what the law allows.
    fn runs(tries: &[(f64, f64)]) -> Vec<(f64, u32)> {
        let mut level = 0.0_f64;
        let runs = tries.iter().map(|(part, longer)| {
            // So many of the units that there is time for, at the shortest time that is allowed.
            let per_time = 1.0 / MEAN + (1.0 - part) / (EACH * PRICE);
            let least = (level + 1.0 - (SAVED - 1.0)).max(0.0) / per_time;
            let time = (least + longer).max(10.0);
            let units = (part * time / EACH) as u32;
            let left_out = time / EACH - f64::from(units);
            level = (level + 1.0 - time / MEAN - left_out / PRICE).max(0.0);
            (time, units)
        });
        runs.collect()
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn no_window_of_substituted_runs_demands_more(
            tries in prop::collection::vec(
                (
                    prop_oneof![Just(0.0_f64), Just(1.0), 0.0..1.0_f64],
                    prop_oneof![3 => Just(0.0_f64), 1 => 0.0..1500.0_f64],
                ),
                1..60,
            ),
            windows in prop::collection::vec((0.0..1.0_f64, 0.0..20_000.0_f64), 50),
        ) {
            let runs = runs(&tries);
            let (mut starts, mut units, mut now) = (Vec::new(), Vec::new(), 0.0);
            for (time, count) in runs {
                starts.push(now);
                units.extend((0..count).map(|n| now + time * f64::from(n) / f64::from(count)));
                now += time;
            }
            for (part, length) in windows {
                let begin = starts[(part * starts.len() as f64) as usize];
                let within = |times: &[f64]| {
                    times.iter().filter(|at| (begin..begin + length).contains(at)).count() as f64
                };
                let demand = within(&starts) * PRICE + within(&units);
                let most = (SAVED + length / MEAN).ceil() * PRICE + (length / EACH).ceil();
                prop_assert!(demand <= most + 2.0 + 1e-6, "{demand} of {most} in {length}");
            }
        }
    }
}
