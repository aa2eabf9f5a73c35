//! Response times of all rows at one step rate and baud rate.
//!
//! Each of the following models of the instruction cache gives a safe response time, and the least
//! response time counts:
//!
//! * *uncached*: only the line in use is ever in the cache;
//! * *cold*: one run misses each of its lines once, if all of them fit the cache. A preemption may evict
//!   all lines of the preempted task: with replacement of the least recently used line, one line too
//!   many may evict all others, so the lines of the preempting task do not limit the eviction;
//! * *persistent*: if the lines of all tasks in a busy window fit the cache together, none is evicted in
//!   the window, and each is missed once in the whole window;
//! * *loops*: the same for the loops of a task and the tasks that preempt it most often; see
//!   [`crate::persistent_window`].

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::{
    Point, SubstitutedRuns, Wcet,
    model::{CACHE_LINES, OUTSTANDING_TRANSFER, RESTART, RETRY},
    persistent_window::PersistentCost,
    preempting_tasks::{PreemptingTasks, Streams},
    row_demand::RowDemand,
    rta::{Arrival, Demand, Load},
    substitution::{Substitution, SubstitutionCost},
    system::{Cost, System},
};

/// Lines that are fetched again when a task resumes after a preemption without a cache.
const REFETCHED: u64 = 2;
/// Response times above so many deadlines are not computed.
pub(crate) const HOPELESS: f64 = 4.0;

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

/// Work with persistent loops, with what it costs others.
const fn load((arrival, cost): &(Arrival, PersistentCost)) -> Load {
    Load {
        arrival: *arrival,
        cost: cost.all,
    }
}

/// Whether the statements about the instruction cache are used, or only that without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flash {
    Cached,
    Uncached,
    /// Only that without it and that of persistent loops: as in a certificate.
    Certified,
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
    /// How many units of work a substituted run costs, where runs are substituted.
    pub(crate) substitution_cost: Option<f64>,
    /// The demand from which the response time is computed.
    pub(crate) demand: Demand,
    /// What the demand is made of.
    pub(crate) derivation: Derivation,
}

/// Which costs make up the demand of a window, if that is one without a cache or with persistent loops.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct Derivation {
    /// The regime that the window is in.
    pub(crate) regime: Option<String>,
    /// With persistent loops, the rows whose lines stay in the cache: warm and cold ones.
    pub(crate) resident: Option<(Vec<usize>, Vec<usize>)>,
    /// Units for one substituted run, and units that a window may have beyond those of its whole runs.
    pub(crate) substitution: Option<(u64, u64)>,
    /// The longest section that holds the row up, where it is, and whether any such section stores exclusively.
    pub(crate) section: u64,
    pub(crate) section_place: String,
    pub(crate) section_retries: bool,
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
    system: &System<'_>,
    sections: &[Blocking],
    point: Point,
) -> Result<Vec<Option<Response>>, String> {
    up_to(system, sections, point, (HOPELESS, Flash::Cached))
}

/// Whether every deadline is met.
///
/// # Errors
///
/// As [`all`].
pub(crate) fn are_met(
    system: &System<'_>,
    sections: &[Blocking],
    point: Point,
    flash: Flash,
) -> Result<bool, String> {
    let responses = up_to(system, sections, point, (1.0, flash))?;
    let share = utilisation(system, &responses);
    Ok(share <= 1.0 && responses.iter().flatten().all(Response::is_met))
}

/// The responses that are no longer than so many deadlines.
fn up_to(
    system: &System<'_>,
    sections: &[Blocking],
    point: Point,
    limits: (f64, Flash),
) -> Result<Vec<Option<Response>>, String> {
    let mut responses: Vec<Option<Response>> = vec![None; system.rows.len()];
    let length = |found: &Response| found.response.unwrap_or(u64::MAX);
    for (row, found) in windows(system, sections, point, limits)? {
        if responses[row]
            .as_ref()
            .is_none_or(|longest| length(longest) <= length(&found))
        {
            responses[row] = Some(found);
        }
    }
    Ok(responses)
}

/// The responses of each row in each regime, with its number, that are no longer than so many deadlines.
///
/// # Errors
///
/// As [`all`].
pub(crate) fn windows(
    system: &System<'_>,
    sections: &[Blocking],
    point: Point,
    (deadlines, flash): (f64, Flash),
) -> Result<Vec<(usize, Response)>, String> {
    let named = system.config.numbers(&system.clock, point)?;
    let mut row_demands = Vec::new();
    for row in 0..system.rows.len() {
        row_demands.extend(RowDemand::new(system, row, &named, point)?);
    }
    let substitutions = Substitution::all(system, point)?.into_iter();
    let substitutions =
        substitutions.map(|substitution| (substitution.rounded(&row_demands), substitution));
    let substitutions: Vec<(Vec<RowDemand>, Substitution)> = substitutions.collect();
    let mut windows = Vec::new();
    for index in 0..row_demands.len() {
        let row = row_demands[index].row;
        if system.rows[row].kind_of.is_some() {
            continue;
        }
        let regimes = system.regimes();
        let own = system.regime(row);
        let regimes = regimes.into_iter().filter(|it| own.is_none() || *it == own);
        let found = regimes.map(|regime| {
            let respond = |row_demands, substitution| {
                let mut window =
                    Window::new((system, &named), sections, row_demands, index, regime);
                window.substitution = substitution;
                window.is_cached &= flash != Flash::Uncached;
                window.is_certified = flash == Flash::Certified;
                window.limit = (deadlines * window.own.deadline).clamp(0.0, 1e12) as u64;
                window.respond()
            };
            let substitutions = substitutions
                .iter()
                .filter(|(_, substitution)| substitution.is_in(system, regime));
            let found = substitutions
                .map(|(row_demands, substitution)| respond(row_demands, Some(substitution)));
            // Each is an upper bound.
            let best = found.min_by_key(|found| found.response.unwrap_or(u64::MAX));
            let mut best = best.unwrap_or_else(|| respond(&row_demands, None));
            best.derivation.regime = regime.map(str::to_owned);
            (row, best)
        });
        windows.extend(found);
    }
    Ok(windows)
}

/// How long tasks with deadlines may keep the processor from those without, which have lower priorities,
/// cycles; `None`: more than `limit`.
///
/// All rows that may be due together are in the demand of a row of the lowest priority: the row to
/// which no other row yields.
///
/// # Errors
///
/// As [`all`].
pub(crate) fn undeadlined_wait(
    system: &System<'_>,
    sections: &[Blocking],
    point: Point,
    limit: u64,
) -> Result<Option<u64>, String> {
    let responses = all(system, sections, point)?;
    let rows = system
        .rows
        .iter()
        .zip(&responses)
        .filter_map(|(row, response)| Some((row.task.priority, response.as_ref()?)));
    let Some(lowest) = rows.clone().map(|(priority, _)| priority).min() else {
        return Ok(Some(0));
    };
    let busy = rows
        .filter(|(priority, _)| *priority == lowest)
        .map(|(_, response)| response.demand.busy(limit));
    let busy: Option<Vec<u64>> = busy.collect();
    Ok(busy.and_then(|busy| busy.into_iter().max()))
}

/// The substituted runs and their cost.
///
/// # Errors
///
/// Tells which formula is wrong.
pub(crate) fn substituted_runs(
    system: &System<'_>,
    point: Point,
    costs: f64,
) -> Result<Option<SubstitutedRuns>, String> {
    let substitutions = Substitution::all(system, point)?;
    let largest = substitutions
        .iter()
        .max_by_key(|substitution| substitution.units());
    Ok(largest.map(|substitution| SubstitutedRuns {
        row: system.rows[substitution.kind()].name.clone(),
        units: substitution.units(),
        costs,
    }))
}

/// Share of the processor that all runs take together, in the regime where that is most.
pub(crate) fn utilisation(system: &System<'_>, responses: &[Option<Response>]) -> f64 {
    let regimes = system.regimes().into_iter().map(|regime| {
        let rows = responses.iter().enumerate();
        let rows = rows.filter(|(row, _)| system.regime(*row).is_none_or(|it| Some(it) == regime));
        rows.filter_map(|(_, it)| it.as_ref())
            .map(|it| it.share)
            .sum()
    });
    regimes.fold(0.0, f64::max)
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
    system: &'a System<'a>,
    named: &'a BTreeMap<String, u64>,
    row_demands: &'a [RowDemand],
    substitution: Option<&'a Substitution>,
    own: &'a RowDemand,
    others: Vec<&'a RowDemand>,
    /// Runs of the same task that may have begun before this one was due.
    yielding: Vec<&'a RowDemand>,
    /// Longer responses are not computed.
    limit: u64,
    miss: u64,
    is_cached: bool,
    is_certified: bool,
    blocking: u64,
    blocking_lines: BTreeSet<u32>,
    blocking_retries: bool,
    blocking_source: String,
}

impl<'a> Window<'a> {
    fn new(
        (system, named): (&'a System<'a>, &'a BTreeMap<String, u64>),
        sections: &[Blocking],
        row_demands: &'a [RowDemand],
        index: usize,
        regime: Option<&str>,
    ) -> Self {
        let own = &row_demands[index];
        let others = row_demands.iter().enumerate();
        let others = others.filter(|(at, it)| *at != index && it.priority >= own.priority);
        let others = others.filter(|(_, it)| !system.are_exclusive(it.row, own.row));
        let others =
            others.filter(|(_, it)| system.regime(it.row).is_none_or(|it| Some(it) == regime));
        let (yielding, others): (Vec<&RowDemand>, Vec<&RowDemand>) =
            { others.map(|(_, it)| it) }.partition(|it| system.yields(it.row, own.row));
        let mut holding = sections
            .iter()
            .filter(|section| section.holds(own.priority));
        let worst = holding.clone().max_by_key(|section| section.cycles);
        Self {
            system,
            named,
            row_demands,
            substitution: None,
            own,
            others,
            limit: 0,
            miss: system.model.miss(),
            is_cached: !system.model.prefetch,
            is_certified: false,
            blocking: worst.map_or(0, |section| section.cycles),
            blocking_lines: holding
                .clone()
                .flat_map(|section| section.lines.clone())
                .chain(yielding.iter().flat_map(|it| it.cost.lines.clone()))
                .collect(),
            blocking_retries: holding.any(|section| section.retries),
            blocking_source: worst.map_or_else(String::new, |section| section.place.clone()),
            yielding,
        }
    }

    fn respond(self) -> Response {
        let found = |own, others, more, via| {
            let (cost, demand) = (self.cost(own), self.response(own, others, more));
            self.answer(cost, via, demand, None)
        };
        let mut all = vec![found(Kind::Uncached, Kind::Uncached, 0, "uncached")];
        if self.is_cached && !self.is_certified {
            all.push(found(Kind::Uncached, Kind::Cold, 0, "uncached"));
            if self.own.cost.wcet.cold != 0 {
                all.push(found(Kind::Cold, Kind::Cold, 0, "cold"));
            }
            if let Some(lines) = self.shared_lines() {
                let more = lines as u64 * self.miss;
                all.push(found(Kind::Warm, Kind::Warm, more, "persistent"));
            }
        }
        if self.is_cached {
            let preempting = self.preempting();
            for resident in 1..=preempting.len() {
                let warm = 0..=resident;
                let found = warm
                    .filter_map(|it| self.with_persistent_loops(&preempting, it, resident - it));
                all.extend(found);
            }
        }
        // Each is an upper bound.
        let bounded = all.iter().filter(|found| found.response.is_some());
        let least_share = bounded.map(|found| found.share).reduce(f64::min);
        let best = all
            .into_iter()
            .min_by_key(|found| found.response.unwrap_or(u64::MAX));
        let best = best.unwrap_or_else(|| found(Kind::Uncached, Kind::Uncached, 0, "uncached"));
        Response {
            share: least_share.unwrap_or(best.share),
            ..best
        }
    }

    /// A response that holds: cycles and share of the row, response time and demand, with such rows in the cache.
    fn answer(
        &self,
        (cycles, share): (u64, f64),
        via: &'static str,
        (response, substitution_cost, demand): (Option<u64>, Option<f64>, Demand),
        resident: Option<(Vec<usize>, Vec<usize>)>,
    ) -> Response {
        Response {
            arrival: self.own.arrival,
            deadline: self.own.deadline,
            cycles,
            via,
            share,
            blocking: self.held_up(),
            blocking_source: self.source(),
            response,
            substitution_cost,
            demand,
            derivation: Derivation {
                regime: None,
                resident,
                substitution: self.substitution.map(Substitution::units_and_rounding),
                section: self.blocking,
                section_place: self.blocking_source.clone(),
                section_retries: self.blocking_retries,
            },
        }
    }

    /// The highest cost of a run, and the share of the processor of all runs.
    fn cost(&self, kind: Kind) -> (u64, f64) {
        let parts = self.own.parts.iter();
        let shares = parts.map(|part| part.arrival.rate() * kind.of(part.wcet).0 as f64);
        (kind.of(self.own.cost.wcet).0, shares.sum())
    }

    /// The rows that preempt this row, the most frequent first.
    fn preempting(&self) -> Vec<&'a RowDemand> {
        let others = self.others.iter();
        let higher = others.filter(|other| other.priority > self.own.priority);
        let mut higher: Vec<&RowDemand> = higher.copied().collect();
        higher.sort_by(|one, other| other.arrival.rate().total_cmp(&one.arrival.rate()));
        higher
    }

    /// The response with persistent loops beside the code of warm tasks and of cold ones: the
    /// first so many of those that preempt the row.
    fn with_persistent_loops(
        &self,
        preempting: &[&RowDemand],
        warm: usize,
        cold: usize,
    ) -> Option<Response> {
        let tasks = PreemptingTasks::new(self.system, self.named, preempting, (warm, cold))?;
        let own = tasks.streams(self.own)?;
        let same = self.others.iter();
        let same = same.filter(|other| other.priority == self.own.priority);
        let equals: Vec<Streams> = same.map(|it| tasks.streams(it)).collect::<Option<_>>()?;
        let yielding = self.yielding.iter();
        let yielding: Vec<(PersistentCost, u64)> = yielding
            .map(|it| tasks.run(it.row))
            .collect::<Option<_>>()?;
        let visits = equals.iter().map(|it| it.1);
        let visits = visits.chain(yielding.iter().map(|it| it.1));
        // One that preempts may be preempted in a visit, too.
        let preempted = preempting.iter().skip(warm + cold);
        let preempted: Vec<u64> = preempted
            .map(|it| Some(tasks.run(it.row)?.1))
            .collect::<Option<_>>()?;
        let visits = visits.chain(preempted);
        let visit = visits.fold(own.1, u64::max);
        let restart = RESTART + if self.retries() { RETRY } else { 0 };
        let cost = |row_demand: &RowDemand| {
            let reload = self.reloading(row_demand.priority, Kind::Uncached, Kind::Uncached);
            tasks.cost(row_demand, visit, (restart, reload))
        };
        let substitution_cost = self.substitution_cost(|row_demand| {
            if row_demand.priority == self.own.priority {
                let (streams, _) = tasks.streams(row_demand)?;
                return Some(streams.iter().map(|(_, cost)| cost.all).collect());
            }
            Some(vec![cost(row_demand)?])
        })?;
        let loads = preempting.iter().map(|row_demand| {
            Some(Load {
                arrival: row_demand.arrival,
                cost: cost(row_demand)?,
            })
        });
        let once = self.blocking + tasks.cached.share.of_uncached(self.blocking, self.miss);
        let shares = own.0.iter();
        let share = shares.map(|(arrival, cost)| arrival.rate() * cost.alone as f64);
        let share = share.sum();
        let mut others: Vec<Load> = equals.iter().flat_map(|it| &it.0).map(load).collect();
        others.extend(loads.collect::<Option<Vec<_>>>()?);
        let demand = Demand {
            own: own.0.iter().map(load).collect(),
            others,
            once: once
                + OUTSTANDING_TRANSFER
                + tasks.cached.share.of_visit
                + yielding.iter().map(|it| it.0.all).max().unwrap_or(0)
                + substitution_cost.once,
        };
        let response = Some(demand.response(self.limit)?);
        let units = self.substitution.map(|_| substitution_cost.units);
        let cost = (tasks.run(self.own.row)?.0.alone, share);
        let resident = Some((tasks.warm, tasks.cold));
        Some(self.answer(cost, "loops", (response, units, demand), resident))
    }

    /// Whether what may be preempted in this window stores exclusively.
    fn retries(&self) -> bool {
        let rows = [self.own].into_iter().chain(self.others.iter().copied());
        let mut rows = rows.chain(self.yielding.iter().copied());
        self.blocking_retries || rows.any(|it| it.cost.retries)
    }

    /// What a substituted run costs in this window, by what the parts of a row cost; nothing without
    /// a substitution.
    fn substitution_cost(
        &self,
        cost: impl Fn(&RowDemand) -> Option<Vec<u64>>,
    ) -> Option<SubstitutionCost> {
        let none = SubstitutionCost {
            units: 0.0,
            once: 0,
        };
        let rows: Vec<&RowDemand> = [self.own]
            .into_iter()
            .chain(self.others.iter().copied())
            .collect();
        let substitution = self.substitution;
        substitution.map_or(Some(none), |it| it.cost(&rows, self.row_demands, cost))
    }

    /// Lines of all that may run in the window, if the cache holds them.
    fn shared_lines(&self) -> Option<usize> {
        let mut lines = self.blocking_lines.clone();
        lines.extend(&self.own.cost.lines);
        lines.extend(self.others.iter().flat_map(|other| &other.cost.lines));
        (lines.len() <= CACHE_LINES).then_some(lines.len())
    }

    /// The response time with these costs, and what a substituted run costs. `more`: what the
    /// window pays once, besides blocking.
    fn response(&self, own: Kind, others: Kind, more: u64) -> (Option<u64>, Option<f64>, Demand) {
        let (_, own_kind) = own.of(self.own.cost.wcet);
        let loads = |row_demand: &RowDemand| {
            let is_kind = self.system.rows[row_demand.row].kind_of == Some(self.own.row);
            let is_own = is_kind || row_demand.row == self.own.row;
            let preempts = row_demand.priority > self.own.priority;
            let reload = if preempts && own != Kind::Warm {
                self.reloading(row_demand.priority, own_kind, others)
            } else {
                0
            };
            let more = reload + if preempts { RESTART + RETRY } else { 0 };
            let kind = if is_own { own } else { others };
            let parts = row_demand.parts.iter().map(|part| Load {
                arrival: part.arrival,
                cost: kind.of(part.wcet).0 + more,
            });
            parts.collect::<Vec<_>>()
        };
        let costs =
            |row_demand: &RowDemand| loads(row_demand).iter().map(|load| load.cost).collect();
        let Some(substitution_cost) = self.substitution_cost(|row_demand| Some(costs(row_demand)))
        else {
            return (None, None, Demand::default());
        };
        let others = self.others.iter().flat_map(|other| loads(other));
        let others: Vec<Load> = others.collect();
        let demand = Demand {
            own: loads(self.own),
            others,
            once: self.held_up() + more + substitution_cost.once,
        };
        let units = self.substitution.map(|_| substitution_cost.units);
        (demand.response(self.limit), units, demand)
    }

    /// The blocking of the row.
    fn source(&self) -> String {
        let yielding = self.yielding.iter();
        let names = yielding.map(|it| format!("a run of `{}`", self.system.rows[it.row].name));
        let section = Some(self.blocking_source.clone()).filter(|source| !source.is_empty());
        names.chain(section).collect::<Vec<_>>().join(", ")
    }

    /// How long lower priorities, or what began before, hold the row up.
    fn held_up(&self) -> u64 {
        let yielding = self.yielding.iter().map(|it| it.cost.wcet.uncached);
        self.blocking + OUTSTANDING_TRANSFER + yielding.max().unwrap_or(0)
    }

    /// Cycles for the lines that a preemption by such a priority evicts from the tasks of this
    /// window.
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

/// Blocking by sections: by all that are not exempt and have a length.
pub(crate) fn blocking(
    system: &System<'_>,
    held: &[crate::sections::Held],
    contexts: &BTreeMap<u32, u8>,
) -> Vec<Blocking> {
    let held = held.iter().filter_map(|section| {
        let name = system.image.name(section.function);
        if system.config.exemption(&name).is_some() {
            return None;
        }
        let frames = system.image.frames(section.address);
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
