//! Runs that may come instead of pieces of work: `[trade]` of `schedule.toml`.
//!
//! Runs of a row come at their rate, and pieces of work in them at theirs. Where fewer pieces come
//! than that rate allows, more runs may: in any window, one for so many pieces. If one such run
//! costs no more than these pieces, and what comes with it no more than what comes with them, no window
//! demands more than one in which both come at their rates, and whatever is proven of that one holds.
//!
//! Each of the two by itself: the row is ahead of what comes with its runs, so a window may have the
//! runs of one stretch of time and what came with those of another.
//!
//! That is said of a sum: so much for each run and each piece, wherever in the window it falls.

use std::collections::BTreeMap;

use crate::{Point, member::Member, subject::Subject};

/// What is traded at one step rate and baud rate.
#[derive(Debug, Clone)]
pub(crate) struct Trade {
    /// The row, and that of its runs which come instead of pieces.
    row: usize,
    kind: usize,
    /// Pieces for one run.
    pieces: u64,
    /// Pieces that a window may have beside those of whole runs.
    rounding: u64,
    /// Runs of other rows that come with a run, and with a piece.
    with_run: BTreeMap<usize, u64>,
    with_piece: BTreeMap<usize, u64>,
}

/// What a run that is traded costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Price {
    /// How many pieces that is.
    pub(crate) pieces: f64,
    /// What the window pays for pieces that rounding adds, cycles.
    pub(crate) once: u64,
}

impl Trade {
    /// What `schedule.toml` says; nothing without a trade, or where its rows are not known.
    ///
    /// Twice, as rounding can be counted in two ways, either of which is safe: a window has so many
    /// pieces more; or, as that matters only where there is a run more, the first of these comes for so
    /// many pieces fewer.
    ///
    /// # Errors
    ///
    /// Tells which formula is wrong.
    pub(crate) fn all(subject: &Subject<'_>, point: Point) -> Result<Vec<Self>, String> {
        let Some(trade) = &subject.config.trade else {
            return Ok(Vec::new());
        };
        let kinds = subject.rows.iter().enumerate();
        let mut kinds = kinds.filter_map(|(kind, row)| Some((kind, row.kind_of?)));
        let Some((kind, row)) = kinds.next() else {
            return Ok(Vec::new());
        };
        let names = subject.config.names(&subject.clock, point);
        let rows = |given: &BTreeMap<String, u64>| {
            let rows = subject.rows.iter().enumerate();
            rows.filter_map(|(index, row)| Some((index, *given.get(&row.name)?)))
                .collect()
        };
        let more = Self {
            row,
            kind,
            pieces: trade.pieces.value(&names)?.max(0.0) as u64,
            rounding: trade.rounding.value(&names)?.max(0.0).ceil() as u64,
            with_run: rows(&trade.with_run),
            with_piece: rows(&trade.with_piece),
        };
        let fewer = Self {
            pieces: more.pieces.saturating_sub(more.rounding),
            rounding: 0,
            ..more.clone()
        };
        Ok(vec![fewer, more])
    }

    /// The row of the runs that come instead of pieces, and for how many.
    pub(crate) const fn kind(&self) -> usize {
        self.kind
    }

    pub(crate) const fn pieces(&self) -> u64 {
        self.pieces
    }

    /// Whether runs are traded in a regime.
    pub(crate) fn is_in(&self, subject: &Subject<'_>, regime: Option<&str>) -> bool {
        let own = subject.regime(self.row);
        own.is_none() || own == regime
    }

    /// The rows with what rounding adds to those of which runs come with pieces.
    pub(crate) fn rounded(&self, members: &[Member]) -> Vec<Member> {
        let rounded = members.iter().map(|it| {
            let runs = self.rounding * self.with_piece.get(&it.row).unwrap_or(&0);
            it.with_more(runs as f64)
        });
        rounded.collect()
    }

    /// What a run costs in a window of these rows, by what the parts of a row cost there; `None` where
    /// it costs more than the pieces that it comes for, or what comes with it more than what comes with
    /// them.
    pub(crate) fn price(
        &self,
        rows: &[&Member],
        all: &[Member],
        cost: impl Fn(&Member) -> Option<Vec<u64>>,
    ) -> Option<Price> {
        let (mut own, mut with) = ((0, 0), (0, 0));
        for member in rows {
            let (run, piece) = member.run_and_piece(&cost(member)?);
            with.0 += run * self.with_run.get(&member.row).unwrap_or(&0);
            with.1 += run * self.with_piece.get(&member.row).unwrap_or(&0);
            if member.row == self.row {
                let kind = all.iter().find(|it| it.row == self.kind)?;
                own = (kind.run_and_piece(&cost(kind)?).0, piece);
            }
        }
        let is_paid = |(run, piece)| run <= self.pieces * piece;
        let pieces = |(run, piece): (u64, u64)| run as f64 / piece.max(1) as f64;
        (is_paid(own) && is_paid(with)).then(|| Price {
            pieces: pieces(own).max(pieces(with)),
            once: self.rounding * own.1,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{member::Part, rta::Arrival};
    use proptest::prelude::*;
    use std::rc::Rc;

    /// Runs that come each 700 cycles but for some that come sooner, and pieces each 10; a run is worth
    /// `PRICE` of them, and a segment of runs may have one piece more than its share.
    const MEAN: f64 = 700.0;
    const SAVED: f64 = 3.0;
    const EACH: f64 = 10.0;
    const PRICE: f64 = 25.0;

    fn member(row: usize, parts: usize) -> Member {
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
        Member {
            row,
            priority: 1,
            deadline: 100.0,
            arrival,
            cost: Rc::default(),
            parts: vec![part; parts],
            units: (parts > 1).then(|| crate::member::UnitCount {
                most: 30,
                extra: 2,
                without: BTreeMap::new(),
            }),
        }
    }

    fn trade(pieces: u64) -> Trade {
        Trade {
            row: 0,
            kind: 1,
            pieces,
            rounding: 3,
            with_run: BTreeMap::from([(2, 1), (3, 2)]),
            with_piece: BTreeMap::from([(3, 2)]),
        }
    }

    #[test]
    fn a_run_costs_what_comes_with_it_too() {
        let all = [member(0, 2), member(1, 2), member(2, 1), member(3, 1)];
        // With each run two pieces more; one of the kind that is traded costs less.
        let costs = [vec![1020, 10], vec![820, 10], vec![100], vec![20]];
        let price = |pieces, rows: &[usize]| {
            let rows: Vec<&Member> = rows.iter().map(|row| &all[*row]).collect();
            trade(pieces).price(&rows, &all, |it| Some(costs[it.row].clone()))
        };
        // 800 for pieces of 10, and 100 + 2 * 20 for pieces of 2 * 20.
        let found = price(80, &[0, 2, 3]).unwrap();
        assert_eq!((found.pieces, found.once), (80.0, 30));
        assert_eq!(price(79, &[0, 2, 3]), None);
        let found = price(80, &[2, 3]).unwrap();
        assert_eq!((found.pieces, found.once), (140.0 / 40.0, 0));
        assert_eq!(price(3, &[2, 3]), None);
        // Where neither the runs nor their pieces matter.
        let found = price(25, &[3]).unwrap();
        assert_eq!((found.pieces, found.once), (1.0, 0));
    }

    #[test]
    fn rounding_adds_what_comes_with_pieces() {
        let rounded = trade(25).rounded(&[member(0, 2), member(3, 1)]);
        let bursts = rounded.iter().map(|it| it.arrival.sustained.unwrap().1);
        assert_eq!(bursts.collect::<Vec<_>>(), [2.0, 8.0]);
    }

    /// Runs, each with how long it lasts and its pieces: none before what the law allows.
    fn runs(tries: &[(f64, f64)]) -> Vec<(f64, u32)> {
        let mut level = 0.0_f64;
        let runs = tries.iter().map(|(part, longer)| {
            // So many of the pieces that there is time for, at the shortest time that is allowed.
            let per_time = 1.0 / MEAN + (1.0 - part) / (EACH * PRICE);
            let least = (level + 1.0 - (SAVED - 1.0)).max(0.0) / per_time;
            let time = (least + longer).max(10.0);
            let pieces = (part * time / EACH) as u32;
            let left_out = time / EACH - f64::from(pieces);
            level = (level + 1.0 - time / MEAN - left_out / PRICE).max(0.0);
            (time, pieces)
        });
        runs.collect()
    }

    proptest! {
        #[test]
        fn no_window_of_traded_runs_demands_more(
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
            let (mut starts, mut pieces, mut now) = (Vec::new(), Vec::new(), 0.0);
            for (time, count) in runs {
                starts.push(now);
                pieces.extend((0..count).map(|n| now + time * f64::from(n) / f64::from(count)));
                now += time;
            }
            for (part, length) in windows {
                let begin = starts[(part * starts.len() as f64) as usize];
                let within = |times: &[f64]| {
                    times.iter().filter(|at| (begin..begin + length).contains(at)).count() as f64
                };
                let demand = within(&starts) * PRICE + within(&pieces);
                let most = (SAVED + length / MEAN).ceil() * PRICE + (length / EACH).ceil();
                prop_assert!(demand <= most + 2.0 + 1e-6, "{demand} of {most} in {length}");
            }
        }
    }
}
