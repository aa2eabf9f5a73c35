//! Response times of all rows at one step rate and baud rate.
//!
//! Several statements about the instruction cache are true at once, each gives a response time that
//! is safe, and the least of them counts:
//!
//! * *uncached*: nothing but the line in use is ever in the cache;
//! * *cold*: one run misses each of its lines once, if all of them fit the cache. A preemption may
//!   cost the one that is preempted all its lines again: where the least recently used line is
//!   replaced, one line too many may push out all others, so what the preempting task touches says
//!   nothing;
//! * *persistent*: if the lines of all that may run in a busy window fit the cache together, none is
//!   pushed out in it, and each is missed once in the whole window;
//! * *loops*: the same for the loops of a task and those that preempt it most often; see
//!   [`crate::keeping`].

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Point, Traded, Wcet,
    company::{Company, Streams},
    keeping::{Keeping, Kept},
    member::Member,
    model::{CACHE_LINES, OUTSTANDING_TRANSFER, RESTART, RETRY},
    rta::{self, Arrival, Load},
    subject::{Cost, Subject},
    trade::{Price, Trade},
};

/// Lines that are fetched again when a task goes on behind a preemption without a cache.
const REFETCHED: u64 = 2;
/// Response times above so many deadlines are not looked for.
const HOPELESS: f64 = 4.0;

/// A section that may hold tasks up.
#[derive(Debug, Clone)]
pub(crate) struct Blocking {
    /// Lowest priority that it may be in.
    pub(crate) priority: u8,
    pub(crate) ceiling: Option<u8>,
    pub(crate) cycles: u64,
    pub(crate) lines: BTreeSet<u32>,
    pub(crate) retries: bool,
    pub(crate) place: String,
}

impl Blocking {
    /// Whether it holds up a task of this priority.
    pub(crate) fn holds(&self, priority: u8) -> bool {
        self.priority < priority && self.ceiling.is_none_or(|ceiling| ceiling >= priority)
    }
}

/// A row's response.
#[derive(Debug, Clone)]
pub(crate) struct Response {
    pub(crate) arrival: Arrival,
    pub(crate) deadline: f64,
    /// The execution time that counts, and why.
    pub(crate) cycles: u64,
    pub(crate) via: &'static str,
    /// Share of the processor that it takes in the long run.
    pub(crate) share: f64,
    pub(crate) blocking: u64,
    pub(crate) blocking_source: String,
    /// `None`: it has no end.
    pub(crate) response: Option<u64>,
    /// How many pieces of work a traded run costs, where runs are traded.
    pub(crate) price: Option<f64>,
}

impl Response {
    pub(crate) fn is_met(&self) -> bool {
        let response = self.response.map(|response| response as f64);
        response.is_some_and(|response| response <= self.deadline)
    }
}

/// The responses by row; `None` for a row without a deadline.
///
/// # Errors
///
/// Tells which formula is wrong. A row without a bound ends it too.
pub(crate) fn all(
    subject: &Subject<'_>,
    sections: &[Blocking],
    point: Point,
) -> Result<Vec<Option<Response>>, String> {
    up_to(subject, sections, point, HOPELESS)
}

/// Whether every deadline is met.
///
/// # Errors
///
/// As [`all`].
pub(crate) fn are_met(
    subject: &Subject<'_>,
    sections: &[Blocking],
    point: Point,
) -> Result<bool, String> {
    let responses = up_to(subject, sections, point, 1.0)?;
    let share = utilisation(subject, &responses);
    Ok(share <= 1.0 && responses.iter().flatten().all(Response::is_met))
}

/// The responses that are no longer than so many deadlines.
fn up_to(
    subject: &Subject<'_>,
    sections: &[Blocking],
    point: Point,
    deadlines: f64,
) -> Result<Vec<Option<Response>>, String> {
    let named = subject.config.numbers(&subject.clock, point)?;
    let mut members = Vec::new();
    for row in 0..subject.rows.len() {
        members.extend(Member::new(subject, row, &named, point)?);
    }
    let trades = Trade::all(subject, point)?.into_iter();
    let trades = trades.map(|trade| (trade.rounded(&members), trade));
    let trades: Vec<(Vec<Member>, Trade)> = trades.collect();
    let mut responses: Vec<Option<Response>> = vec![None; subject.rows.len()];
    for index in 0..members.len() {
        let row = members[index].row;
        if subject.rows[row].kind_of.is_some() {
            continue;
        }
        let regimes = subject.regimes();
        let own = subject.regime(row);
        let regimes = regimes.into_iter().filter(|it| own.is_none() || *it == own);
        let found = regimes.map(|regime| {
            let respond = |members, trade| {
                let mut window = Window::new((subject, &named), sections, members, index, regime);
                window.trade = trade;
                window.limit = (deadlines * window.own.deadline).clamp(0.0, 1e12) as u64;
                window.respond()
            };
            let trades = { trades.iter() }.filter(|(_, trade)| trade.is_in(subject, regime));
            let found = trades.map(|(members, trade)| respond(members, Some(trade)));
            // Each is an upper bound.
            let best = found.min_by_key(|found| found.response.unwrap_or(u64::MAX));
            best.unwrap_or_else(|| respond(&members, None))
        });
        responses[row] = found.max_by_key(|found| found.response.unwrap_or(u64::MAX));
    }
    Ok(responses)
}

/// What is traded, and what that costs.
///
/// # Errors
///
/// Tells which formula is wrong.
pub(crate) fn traded(
    subject: &Subject<'_>,
    point: Point,
    costs: f64,
) -> Result<Option<Traded>, String> {
    let trades = Trade::all(subject, point)?;
    let largest = trades.iter().max_by_key(|trade| trade.pieces());
    Ok(largest.map(|trade| Traded {
        row: subject.rows[trade.kind()].name.clone(),
        pieces: trade.pieces(),
        costs,
    }))
}

/// Share of the processor that all runs take together, in the regime where that is most.
pub(crate) fn utilisation(subject: &Subject<'_>, responses: &[Option<Response>]) -> f64 {
    let regimes = subject.regimes().into_iter().map(|regime| {
        let rows = responses.iter().enumerate();
        let rows = rows.filter(|(row, _)| subject.regime(*row).is_none_or(|it| Some(it) == regime));
        rows.filter_map(|(_, it)| it.as_ref())
            .map(|it| it.share)
            .sum()
    });
    regimes.fold(0.0, f64::max)
}

/// A response that holds.
struct Found {
    response: Option<u64>,
    cycles: u64,
    share: f64,
    via: &'static str,
    price: Option<f64>,
}

/// Which cost of a row counts in a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Warm,
    Cold,
    Uncached,
}

impl Kind {
    /// The cost, and the kind that it is.
    fn of(self, wcet: Wcet) -> (u64, Self) {
        match self {
            Self::Warm => (wcet.warm, self),
            Self::Cold if wcet.cold != 0 && wcet.cold <= wcet.uncached => (wcet.cold, self),
            _ => (wcet.uncached, Self::Uncached),
        }
    }
}

/// The busy window of one row.
struct Window<'a> {
    subject: &'a Subject<'a>,
    named: &'a BTreeMap<String, u64>,
    members: &'a [Member],
    trade: Option<&'a Trade>,
    own: &'a Member,
    others: Vec<&'a Member>,
    /// Runs of the same task that may have begun before this one was due.
    yielding: Vec<&'a Member>,
    /// Longer responses are not looked for.
    limit: u64,
    miss: u64,
    is_cached: bool,
    blocking: u64,
    blocking_lines: BTreeSet<u32>,
    blocking_retries: bool,
    blocking_source: String,
}

impl<'a> Window<'a> {
    fn new(
        (subject, named): (&'a Subject<'a>, &'a BTreeMap<String, u64>),
        sections: &[Blocking],
        members: &'a [Member],
        index: usize,
        regime: Option<&str>,
    ) -> Self {
        let own = &members[index];
        let others = members.iter().enumerate();
        let others = others.filter(|(at, it)| *at != index && it.priority >= own.priority);
        let others = others.filter(|(_, it)| !subject.are_apart(it.row, own.row));
        let others =
            others.filter(|(_, it)| subject.regime(it.row).is_none_or(|it| Some(it) == regime));
        let (yielding, others): (Vec<&Member>, Vec<&Member>) =
            { others.map(|(_, it)| it) }.partition(|it| subject.yields(it.row, own.row));
        let holding = sections
            .iter()
            .filter(|section| section.holds(own.priority));
        let worst = holding.clone().max_by_key(|section| section.cycles);
        Self {
            subject,
            named,
            members,
            trade: None,
            own,
            others,
            limit: 0,
            miss: subject.model.miss(),
            is_cached: !subject.model.prefetch,
            blocking: worst.map_or(0, |section| section.cycles),
            blocking_lines: holding
                .clone()
                .flat_map(|section| section.lines.clone())
                .chain(yielding.iter().flat_map(|it| it.cost.lines.clone()))
                .collect(),
            blocking_retries: { holding }.any(|section| section.retries),
            blocking_source: worst.map_or_else(String::new, |section| section.place.clone()),
            yielding,
        }
    }

    fn respond(self) -> Response {
        let (cycles, share) = self.cost(Kind::Uncached);
        let found = |(response, price), (cycles, share), via| Found {
            response,
            cycles,
            share,
            via,
            price,
        };
        let response = self.response(Kind::Uncached, Kind::Uncached, 0);
        let mut all = vec![found(response, (cycles, share), "uncached")];
        if self.is_cached {
            let response = self.response(Kind::Uncached, Kind::Cold, 0);
            all.push(found(response, (cycles, share), "uncached"));
            if self.own.cost.wcet.cold != 0 {
                let response = self.response(Kind::Cold, Kind::Cold, 0);
                all.push(found(response, self.cost(Kind::Cold), "cold"));
            }
            if let Some(lines) = self.shared_lines() {
                let response = self.response(Kind::Warm, Kind::Warm, lines as u64 * self.miss);
                all.push(found(response, self.cost(Kind::Warm), "persistent"));
            }
            let preempting = self.preempting();
            for beside in 1..=preempting.len() {
                let guests = 0..=beside;
                let found = guests.filter_map(|it| self.keeping(&preempting, it, beside - it));
                all.extend(found);
            }
        }
        // Each is an upper bound.
        let bounded = all.iter().filter(|found| found.response.is_some());
        let least_share = bounded.map(|found| found.share).reduce(f64::min);
        let best = all
            .into_iter()
            .min_by_key(|found| found.response.unwrap_or(u64::MAX));
        let best = best.unwrap_or(found((None, None), (cycles, share), "uncached"));
        Response {
            arrival: self.own.arrival,
            deadline: self.own.deadline,
            cycles: best.cycles,
            via: best.via,
            share: least_share.unwrap_or(best.share),
            blocking: self.held_up(),
            blocking_source: self.source(),
            response: best.response,
            price: best.price,
        }
    }

    /// What a run costs at most, and the share of the processor of all runs.
    fn cost(&self, kind: Kind) -> (u64, f64) {
        let parts = self.own.parts.iter();
        let shares = parts.map(|part| part.arrival.rate() * kind.of(part.wcet).0 as f64);
        (kind.of(self.own.cost.wcet).0, shares.sum())
    }

    /// What preempts the row, the most frequent first.
    fn preempting(&self) -> Vec<&'a Member> {
        let others = self.others.iter();
        let higher = others.filter(|other| other.priority > self.own.priority);
        let mut higher: Vec<&Member> = higher.copied().collect();
        higher.sort_by(|one, other| other.arrival.rate().total_cmp(&one.arrival.rate()));
        higher
    }

    /// The response where loops keep their code beside that of guests and of tasks that they stand: the
    /// first so many of those that preempt the row.
    fn keeping(&self, preempting: &[&Member], guests: usize, stood: usize) -> Option<Found> {
        let company = Company::new(self.subject, self.named, preempting, (guests, stood))?;
        let own = company.kept(self.own)?;
        let same = self.others.iter();
        let same = same.filter(|other| other.priority == self.own.priority);
        let equals: Vec<Streams> = same.map(|it| company.kept(it)).collect::<Option<_>>()?;
        let yielding = self.yielding.iter();
        let yielding: Vec<(Kept, u64)> = yielding
            .map(|it| company.run(it.row))
            .collect::<Option<_>>()?;
        let visits = equals.iter().map(|it| it.1);
        let visits = visits.chain(yielding.iter().map(|it| it.1));
        // One that preempts may be preempted in a visit, too.
        let preempted = preempting.iter().skip(guests + stood);
        let preempted: Vec<u64> = preempted
            .map(|it| Some(company.run(it.row)?.1))
            .collect::<Option<_>>()?;
        let visits = visits.chain(preempted);
        let visit = visits.fold(own.1, u64::max);
        let restart = RESTART + if self.retries() { RETRY } else { 0 };
        let cost = |member: &Member| {
            let again = self.reloading(member.priority, Kind::Uncached, Kind::Uncached);
            company.cost(member, visit, (restart, again))
        };
        let price = self.price(|member| {
            if member.priority == self.own.priority {
                let (streams, _) = company.kept(member)?;
                return Some(streams.iter().map(|(_, kept)| kept.all).collect());
            }
            Some(vec![cost(member)?])
        })?;
        let loads = preempting.iter().map(|member| {
            Some(Load {
                arrival: member.arrival,
                cost: cost(member)?,
            })
        });
        let once = self.blocking + company.beside.share.of_uncached(self.blocking, self.miss);
        let shares = own.0.iter();
        let share = shares.map(|(arrival, kept)| arrival.rate() * kept.alone as f64);
        let share = share.sum();
        let keeping = Keeping {
            own: own.0,
            equals: equals.into_iter().flat_map(|it| it.0).collect(),
            preempting: loads.collect::<Option<_>>()?,
            once: once
                + OUTSTANDING_TRANSFER
                + company.beside.share.of_visit
                + yielding.iter().map(|it| it.0.all).max().unwrap_or(0)
                + price.once,
        };
        Some(Found {
            response: Some(keeping.response(self.limit)?),
            cycles: company.run(self.own.row)?.0.alone,
            share,
            via: "loops",
            price: self.trade.map(|_| price.pieces),
        })
    }

    /// Whether what may be preempted in this window stores exclusively.
    fn retries(&self) -> bool {
        let rows = [self.own].into_iter().chain(self.others.iter().copied());
        let mut rows = rows.chain(self.yielding.iter().copied());
        self.blocking_retries || rows.any(|it| it.cost.retries)
    }

    /// What a run that is traded costs in this window, by what the parts of a row cost; nothing without
    /// a trade.
    fn price(&self, cost: impl Fn(&Member) -> Option<Vec<u64>>) -> Option<Price> {
        let none = Price {
            pieces: 0.0,
            once: 0,
        };
        let rows: Vec<&Member> = { [self.own].into_iter() }
            .chain(self.others.iter().copied())
            .collect();
        let trade = self.trade;
        trade.map_or(Some(none), |it| it.price(&rows, self.members, cost))
    }

    /// Lines of all that may run in the window, if the cache holds them.
    fn shared_lines(&self) -> Option<usize> {
        let mut lines = self.blocking_lines.clone();
        lines.extend(&self.own.cost.lines);
        lines.extend(self.others.iter().flat_map(|other| &other.cost.lines));
        (lines.len() <= CACHE_LINES).then_some(lines.len())
    }

    /// The response time with these costs, and what a run that is traded costs. `more`: what the
    /// window pays once, besides blocking.
    fn response(&self, own: Kind, others: Kind, more: u64) -> (Option<u64>, Option<f64>) {
        let (_, own_kind) = own.of(self.own.cost.wcet);
        let loads = |member: &Member| {
            let is_kind = self.subject.rows[member.row].kind_of == Some(self.own.row);
            let is_own = is_kind || member.row == self.own.row;
            let preempts = member.priority > self.own.priority;
            let again = if preempts && own != Kind::Warm {
                self.reloading(member.priority, own_kind, others)
            } else {
                0
            };
            let more = again + if preempts { RESTART + RETRY } else { 0 };
            let kind = if is_own { own } else { others };
            let parts = member.parts.iter().map(|part| Load {
                arrival: part.arrival,
                cost: kind.of(part.wcet).0 + more,
            });
            parts.collect::<Vec<_>>()
        };
        let costs = |member: &Member| loads(member).iter().map(|load| load.cost).collect();
        let Some(price) = self.price(|member| Some(costs(member))) else {
            return (None, None);
        };
        let others = self.others.iter().flat_map(|other| loads(other));
        let others: Vec<Load> = others.collect();
        let once = self.held_up() + more + price.once;
        let response = rta::response(&loads(self.own), &others, once, self.limit);
        (response, self.trade.map(|_| price.pieces))
    }

    /// What holds the row up.
    fn source(&self) -> String {
        let yielding = self.yielding.iter();
        let names = yielding.map(|it| format!("a run of `{}`", self.subject.rows[it.row].name));
        let section = Some(self.blocking_source.clone()).filter(|source| !source.is_empty());
        names.chain(section).collect::<Vec<_>>().join(", ")
    }

    /// How long lower priorities, or what began before, hold the row up.
    fn held_up(&self) -> u64 {
        let yielding = self.yielding.iter().map(|it| it.cost.wcet.uncached);
        self.blocking + OUTSTANDING_TRANSFER + yielding.max().unwrap_or(0)
    }

    /// What a preemption by that priority costs those that may be preempted in this window.
    fn reloading(&self, priority: u8, own: Kind, others: Kind) -> u64 {
        let lines = |kind: Kind, cost: &Cost| match kind {
            Kind::Cold => cost.lines.len().min(CACHE_LINES) as u64,
            Kind::Warm | Kind::Uncached => REFETCHED,
        };
        let preempted = self.others.iter().filter(|other| other.priority < priority);
        let preempted = preempted.map(|other| lines(others.of(other.cost.wcet).1, &other.cost));
        let own = lines(own, &self.own.cost);
        self.miss * preempted.fold(own, u64::max)
    }
}

/// What the sections mean for the tasks: those that are not exempt and have a length.
pub(crate) fn blocking(
    subject: &Subject<'_>,
    held: &[crate::sections::Held],
    contexts: &BTreeMap<u32, u8>,
) -> Vec<Blocking> {
    let held = held.iter().filter_map(|section| {
        let name = subject.image.name(section.function);
        if subject.config.exemption(&name).is_some() {
            return None;
        }
        let frames = subject.image.frames(section.address);
        let own = frames.iter().find(|frame| frame.file.starts_with("src/"));
        Some(Blocking {
            priority: contexts.get(&section.function).copied().unwrap_or(0),
            ceiling: section.ceiling,
            cycles: section.cycles?,
            lines: section.lines.clone(),
            retries: section.retries,
            place: own.or(frames.first()).map_or(name, ToString::to_string),
        })
    });
    held.collect()
}
