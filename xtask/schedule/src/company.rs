//! The tasks that preempt a row, where loops keep their code: which of them are guests, and what a
//! run of each costs.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    keeping::{Beside, Kept},
    kept::Share,
    member::Member,
    rta::Arrival,
    subject::Subject,
};

/// What a row has to do, and how many lines one of its visits loads at most.
pub(crate) type Streams = (Vec<(Arrival, Kept)>, u64);

/// Who preempts.
pub(crate) struct Company<'a> {
    subject: &'a Subject<'a>,
    named: &'a BTreeMap<String, u64>,
    /// Rows of the guests, and of those that are stood.
    guests: Vec<usize>,
    stood: Vec<usize>,
    pub(crate) beside: Beside,
}

impl<'a> Company<'a> {
    /// Of those that preempt, the first are guests, those next are stood. `None`: the cache does not hold
    /// so much.
    pub(crate) fn new(
        subject: &'a Subject<'a>,
        named: &'a BTreeMap<String, u64>,
        preempting: &[&Member],
        (guests, stood): (usize, usize),
    ) -> Option<Self> {
        let (guests, others) = preempting.split_at_checked(guests)?;
        let stood = others.get(..stood)?;
        let rows = |members: &[&Member]| members.iter().map(|it| it.row).collect();
        let lines = |members: &[&Member]| -> BTreeSet<u32> {
            let lines = members.iter().flat_map(|it| &it.cost.lines);
            lines.copied().collect()
        };
        let all = [guests, stood].concat();
        let sizes = (lines(guests).len(), lines(&all).len());
        Some(Self {
            subject,
            named,
            guests: rows(guests),
            stood: rows(stood),
            beside: Beside {
                rows: rows(&all),
                lines: lines(&all),
                share: Share::new(sizes.0, sizes.1, subject.model.miss())?,
            },
        })
    }

    /// What a row costs, and how many lines one of its visits loads at most.
    pub(crate) fn run(&self, row: usize) -> Option<(Kept, u64)> {
        self.subject.kept(row, self.named, &self.beside)
    }

    /// The same by the streams of its work.
    pub(crate) fn kept(&self, member: &Member) -> Option<Streams> {
        member.kept(self.subject, self.named, &self.beside)
    }

    /// What a run of a task that preempts costs, with what it costs those that it preempts and those
    /// that preempt it. `visit`: most lines that one loads; `restart`: what it costs those that it preempts;
    /// `again`: the same of the cache, if it does not stay for them.
    pub(crate) fn cost(
        &self,
        member: &Member,
        visit: u64,
        (restart, again): (u64, u64),
    ) -> Option<u64> {
        if self.guests.contains(&member.row) {
            return Some(member.cost.wcet.warm + restart);
        }
        if self.stood.contains(&member.row) {
            return Some(member.cost.wcet.uncached + restart + again);
        }
        // It may end a visit, and with that a stretch.
        let reload = visit * self.subject.model.miss() + self.beside.share.of_visit;
        Some(self.run(member.row)?.0.all + restart + again + reload)
    }
}
