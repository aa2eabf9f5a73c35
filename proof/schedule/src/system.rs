//! The analysed system: the program, the application and `schedule.toml`, brought together.

use std::{
    cell::RefCell,
    collections::{BTreeMap, BTreeSet, HashMap},
    rc::Rc,
};

use crate::{
    App, AppTask, Cache, Clock, Config, Flaw, Formula, Function, Image, Model, Place, Point,
    Program, Rule, Wcet,
    config::{self, ModeConfig, TaskConfig},
    memo::memoised,
    model::LINE_BYTES,
    persistence::{self, Share},
    persistent_window::{PersistentCost, ResidentTasks},
    rta::Arrival,
    stack,
    wcet::Wcets,
};

/// A kind of run of a task: a row of the table.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    /// Name of the task, and of its mode.
    pub(crate) name: String,
    pub(crate) task: AppTask,
    /// Its handler.
    pub(crate) root: u32,
    /// The handler, and the handlers in other vectors that call it.
    entries: Vec<u32>,
    /// Functions that are not called in it.
    pub(crate) excluded: BTreeSet<u32>,
    /// When it is released, and must have ended; `None`: it has no deadline.
    pub(crate) times: Option<ModeConfig>,
    /// The row of which its runs are a special kind: they are among that one's.
    pub(crate) kind_of: Option<usize>,
}

impl Row {
    /// The handlers in vectors: the task's own, and the callers of the task.
    pub(crate) fn entries(&self) -> &[u32] {
        &self.entries
    }

    /// The longest of its entries, if the time of each is known.
    fn longest(&self, time: impl Fn(u32) -> Option<u64>) -> Option<u64> {
        let times: Option<Vec<_>> = self.entries.iter().map(|entry| time(*entry)).collect();
        times?.into_iter().max()
    }
}

/// The cost of a row.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cost {
    /// `cold` is 0 where the cache does not hold the row's code.
    pub(crate) wcet: Wcet,
    pub(crate) lines: BTreeSet<u32>,
    /// Whether it stores exclusively: a store that is preempted is tried again.
    pub(crate) retries: bool,
}

/// A row, and the values of the bounds that it uses.
type Key = (usize, Vec<u64>);
type PersistentKey = (usize, Vec<u64>, Vec<usize>, Share);

/// Everything that does not depend on the step rate.
pub(crate) struct System<'a> {
    pub(crate) image: &'a Image,
    pub(crate) program: &'a Program<'a>,
    pub(crate) app: &'a App,
    pub(crate) config: &'a Config,
    pub(crate) clock: Clock,
    pub(crate) model: Model,
    pub(crate) axes: u8,
    pub(crate) rows: Vec<Row>,
    /// Functions that are called at most so often in an activation: the name of the number.
    pub(crate) limited: BTreeMap<u32, String>,
    /// Named bounds that each row's code uses.
    used: Vec<BTreeSet<String>>,
    /// Costs by row and the values of the bounds that it uses.
    costs: RefCell<HashMap<Key, Option<Rc<Cost>>>>,
    /// The same with persistent loops, the rows whose lines stay in the cache, and the most lines that
    /// a visit loads.
    persistent_costs: RefCell<HashMap<PersistentKey, Option<(PersistentCost, u64)>>>,
}

impl<'a> System<'a> {
    pub(crate) fn new(
        program: &'a Program<'a>,
        app: &'a App,
        config: &'a Config,
        (clock, model): (Clock, Model),
        axes: u8,
        flaws: &mut Vec<Flaw>,
    ) -> Self {
        let mut new = Self {
            image: program.image,
            program,
            app,
            config,
            clock,
            model,
            axes,
            rows: Vec::new(),
            limited: BTreeMap::new(),
            used: Vec::new(),
            costs: RefCell::default(),
            persistent_costs: RefCell::default(),
        };
        let mut tasks: Vec<&AppTask> = app.tasks.iter().filter(|task| task.priority > 0).collect();
        tasks.sort_by_key(|task| std::cmp::Reverse(task.priority));
        for task in tasks {
            new.add(task, flaws);
        }
        for name in config.task.keys() {
            if !app.tasks.iter().any(|task| task.name == *name) {
                let what = format!("`schedule.toml` has times for `{name}`, which is no task");
                flaws.push(misconfigured(what, "Remove them, or correct the name."));
            }
        }
        new.limit(flaws);
        new.add_substitution(flaws);
        new.used = new.rows.iter().map(|row| new.names(row)).collect();
        new
    }

    fn add(&mut self, task: &AppTask, flaws: &mut Vec<Flaw>) {
        let Some(config) = self.config.task.get(&task.name) else {
            let what = format!("`schedule.toml` says nothing of the task `{}`", task.name);
            let remedy = "Give it a period and a deadline, or say why it has none.";
            flaws.push(Flaw::new(Rule::Configuration, what, task.place(), remedy));
            return;
        };
        let Some(own) = self.image.symbol(&task.vector) else {
            return;
        };
        // A vector that calls the task's handler takes a little longer than that handler.
        let default = self.image.symbol("DefaultHandler");
        let callers = config
            .vectors
            .iter()
            .filter_map(|vector| self.image.symbol(vector));
        let callers = callers.filter(|caller| *caller != own && Some(*caller) != default);
        let mut entries: Vec<_> = callers.collect();
        entries.push(own);
        let root = entries[0];
        let mut excluded = BTreeSet::new();
        for exempt in &self.config.exempt {
            let functions = self.program.functions().values();
            let exact = functions.filter(|function| function.name == exempt.function);
            excluded.extend(exact.map(|function| function.address));
        }
        let row = |name: String, excluded, times| Row {
            name,
            task: task.clone(),
            root,
            entries: entries.clone(),
            excluded,
            times,
            kind_of: None,
        };
        let times = times(config);
        if times.is_some() || config.mode.is_empty() {
            if times.is_none() && config.undeadlined.is_none() {
                let what = format!(
                    "the task `{}` has no deadline and no reason for that",
                    task.name
                );
                flaws.push(misconfigured(what, "Give it a period and a deadline."));
            }
            self.rows
                .push(row(task.name.clone(), excluded.clone(), times));
        }
        for (name, mode) in &config.mode {
            let mut excluded = excluded.clone();
            excluded.extend(self.excluded(name, &mode.excludes, flaws));
            let name = format!("{}: {name}", task.name);
            self.rows
                .push(row(name, excluded, Some(mode_times(&task.name, mode))));
        }
    }

    /// The functions that a mode excludes.
    fn excluded(&self, mode: &str, names: &[String], flaws: &mut Vec<Flaw>) -> BTreeSet<u32> {
        let mut excluded = BTreeSet::new();
        for function in names {
            let found = self.functions_named(function);
            let flaw = match found.len() {
                0 => Some((
                    "is no function of the binary",
                    "Correct the name; an excluded function must be `#[inline(never)]`.",
                )),
                1 => None,
                _ => Some((
                    "is the name of several functions",
                    "Give more of the path of the function that is meant.",
                )),
            };
            if let Some((what, remedy)) = flaw {
                let what = format!("the mode `{mode}` excludes `{function}`, which {what}");
                flaws.push(misconfigured(what, remedy));
            }
            excluded.extend(found);
        }
        excluded
    }

    /// Adds the row of the runs that may come instead of units of work.
    fn add_substitution(&mut self, flaws: &mut Vec<Flaw>) {
        let Some(substitution) = &self.config.substitution else {
            return;
        };
        let of = self
            .rows
            .iter()
            .position(|row| row.name == substitution.row);
        let with = substitution
            .with_run
            .keys()
            .chain(substitution.with_unit.keys());
        let names = with.chain([&substitution.row]);
        for name in names.filter(|name| !self.rows.iter().any(|row| row.name == **name)) {
            let what = format!("`schedule.toml` substitutes runs of `{name}`, which is no row");
            flaws.push(misconfigured(what, "Correct the name."));
        }
        let Some(of) = of else {
            return;
        };
        let mut row = self.rows[of].clone();
        row.excluded
            .extend(self.excluded(&substitution.kind, &substitution.excludes, flaws));
        row.name = format!("{}: {}", row.task.name, substitution.kind);
        row.kind_of = Some(of);
        self.rows.insert(of + 1, row);
    }

    /// Looks for the functions whose calls are limited.
    fn limit(&mut self, flaws: &mut Vec<Flaw>) {
        for name in self.config.calls.keys() {
            let found = self.functions_named(name);
            if found.is_empty() {
                let what =
                    format!("`schedule.toml` limits calls of `{name}`, which is no function");
                let remedy = "Correct the name; such a function must be `#[inline(never)]`.";
                flaws.push(misconfigured(what, remedy));
            }
            let found = found.into_iter().map(|address| (address, calls_name(name)));
            self.limited.extend(found);
        }
    }

    fn functions_named(&self, name: &str) -> Vec<u32> {
        let functions = self.program.functions().values();
        let named = functions.filter(|function| config::is_named(&function.name, name));
        named.map(|function| function.address).collect()
    }

    /// Names of the bounds of the loops that a row may run.
    fn names(&self, row: &Row) -> BTreeSet<String> {
        let loops = self.functions_of(row).flat_map(|function| &function.loops);
        let counts = loops.flat_map(|looped| {
            let bound = looped.bound.as_ref().map(|bound| &bound.count);
            bound
                .into_iter()
                .chain(looped.total.as_ref().map(|total| &total.bound.count))
        });
        let named = counts.filter_map(|count| match count {
            crate::Count::Named(name) => Some(name.clone()),
            crate::Count::Number(_) => None,
        });
        let reached = self.functions_of(row);
        let limited = reached.filter_map(|it| self.limited.get(&it.address).cloned());
        named.chain(limited).collect()
    }

    /// The functions that a row may run.
    pub(crate) fn functions_of(&self, row: &Row) -> impl Iterator<Item = &Function> {
        static NO_NUMBERS: BTreeMap<String, u64> = BTreeMap::new();
        self.wcets(row, &NO_NUMBERS).reached(row.root)
    }

    /// The calculator of a row, with these values of the named bounds.
    pub(crate) fn wcets<'b>(&'b self, row: &Row, named: &'b BTreeMap<String, u64>) -> Wcets<'b> {
        let functions = self.program.functions();
        let mut wcets = Wcets::new(functions, &self.model, named, row.excluded.clone());
        for (address, name) in &self.limited {
            wcets.limited.insert(*address, named.get(name).copied());
        }
        let units = row.times.as_ref().and_then(|times| times.units.as_ref());
        wcets.varied =
            units.map_or_else(BTreeSet::new, |units| self.config.following(&units.bound));
        wcets
    }

    /// A flaw at an address.
    pub(crate) fn flaw(
        &self,
        rule: Rule,
        address: u32,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Flaw {
        self.image.flaw(rule, address, what, remedy)
    }

    pub(crate) fn point(&self, step_rate_hz: u32, baud: u32) -> Point {
        Point {
            step_rate_hz: step_rate_hz.into(),
            baud: baud.into(),
            axes: self.axes,
        }
    }

    /// The cost of a row with these values of the named bounds; `None`: no bound.
    pub(crate) fn cost(&self, row: usize, named: &BTreeMap<String, u64>) -> Option<Rc<Cost>> {
        let key = (row, self.values(row, named));
        memoised(&self.costs, key, || {
            self.compute(&self.rows[row], named).map(Rc::new)
        })
    }

    /// The cost of a row with persistent loops and resident code of other rows, and how many lines one
    /// of their visits loads at most.
    pub(crate) fn persistent_cost(
        &self,
        row: usize,
        named: &BTreeMap<String, u64>,
        resident: &ResidentTasks,
    ) -> Option<(PersistentCost, u64)> {
        let rows = resident.rows.clone();
        let key = (row, self.values(row, named), rows, resident.share);
        memoised(&self.persistent_costs, key, || {
            let mut wcets = self.wcets(&self.rows[row], named);
            wcets.resident_lines.clone_from(&resident.lines);
            wcets.share = resident.share;
            self.compute_persistent_cost(&self.rows[row], &wcets)
        })
    }

    /// The values of the bounds that a row uses.
    fn values(&self, row: usize, named: &BTreeMap<String, u64>) -> Vec<u64> {
        let used = self.used[row].iter();
        let values = used.map(|name| named.get(name).copied());
        values.map(|value| value.unwrap_or(u64::MAX)).collect()
    }

    fn compute_persistent_cost(
        &self,
        row: &Row,
        wcets: &Wcets<'_>,
    ) -> Option<(PersistentCost, u64)> {
        let frame = self.frame(row) + self.model.miss();
        let bound = |cache| row.longest(|entry| Some(wcets.bound(entry, cache)?.cycles()));
        let cost = PersistentCost {
            alone: bound(Cache::Loops)? + frame,
            // The vector is a line, too.
            all: bound(Cache::Shared)? + frame + wcets.share.of_line,
        };
        let functions = wcets.reached(row.root);
        let most =
            functions.filter_map(|it| wcets.persistent_loops(it).lines.values().copied().max());
        Some((cost, most.max().unwrap_or(0)))
    }

    /// Entry and exit, and the saving of floating-point registers.
    fn frame(&self, row: &Row) -> u64 {
        let float = if self.uses_float(row) {
            self.model.lazy_save()
        } else {
            0
        };
        self.model.entry_and_exit() + float
    }

    fn compute(&self, row: &Row, named: &BTreeMap<String, u64>) -> Option<Cost> {
        let wcets = self.wcets(row, named);
        let bound = |cache| row.longest(|entry| Some(wcets.bound(entry, cache)?.cycles()));
        let (warm, uncached) = (bound(Cache::Warm)?, bound(Cache::Uncached)?);
        let cold = row.longest(|entry| wcets.cold(entry));
        let frame = self.frame(row);
        let vector = self.model.miss();
        Some(Cost {
            wcet: Wcet {
                warm: warm + frame,
                cold: cold.map_or(0, |cold| cold + frame + vector),
                uncached: uncached + frame + vector,
            },
            lines: self.lines(row, &wcets),
            retries: persistence::has_exclusive_store(&wcets, &wcets.reach(row.root)),
        })
    }

    /// Lines of a row's code, and those of its vectors.
    fn lines(&self, row: &Row, wcets: &Wcets<'_>) -> BTreeSet<u32> {
        let table = self.image.symbol("__vector_table").unwrap_or(0x0800_0000);
        let slots = (table..).step_by(4).zip(self.image.vectors());
        let own = slots.filter(|(_, vector)| row.entries.contains(&(**vector & !1)));
        let mut lines: BTreeSet<_> = own.map(|(slot, _)| slot / LINE_BYTES).collect();
        for entry in &row.entries {
            lines.extend(wcets.lines(*entry).iter());
        }
        lines
    }

    pub(crate) fn uses_float(&self, row: &Row) -> bool {
        self.functions_of(row).any(stack::uses_float)
    }

    /// Whether no run of a row begins while one of the other is due.
    pub(crate) fn yields(&self, row: usize, to: usize) -> bool {
        let times = self.rows[row].times.as_ref();
        times.is_some_and(|times| times.yields_to.contains(&self.rows[to].name))
    }

    /// The regime that a row belongs to, if not to all.
    pub(crate) fn regime(&self, row: usize) -> Option<&str> {
        self.rows[row].times.as_ref()?.regime.as_deref()
    }

    /// All regimes; one without a name where there are none.
    pub(crate) fn regimes(&self) -> BTreeSet<Option<&str>> {
        let named = (0..self.rows.len()).filter_map(|row| self.regime(row));
        let named: BTreeSet<_> = named.map(Some).collect();
        if named.is_empty() {
            BTreeSet::from([None])
        } else {
            named
        }
    }

    /// Names of the rows that are said never to be due while this one is.
    pub(crate) fn exclusive_with(row: &Row) -> Vec<String> {
        let times = row.times.as_ref();
        times.map_or_else(Vec::new, |times| times.exclusive_with.clone())
    }

    /// Whether no run of one row is due while one of the other is.
    pub(crate) fn are_exclusive(&self, row: usize, other: usize) -> bool {
        let is_from = |row: usize, other: usize| {
            let times = self.rows[row].times.as_ref();
            times.is_some_and(|times| times.exclusive_with.contains(&self.rows[other].name))
        };
        let is_kind = |row: usize| self.rows[row].kind_of.is_some();
        is_kind(row) || is_kind(other) || is_from(row, other) || is_from(other, row)
    }

    /// The bound that is the number of a row's units of work, when they arrive, and how many more
    /// a run may have.
    ///
    /// # Errors
    ///
    /// Tells which formula is wrong.
    pub(crate) fn units(
        &self,
        row: &Row,
        point: Point,
    ) -> Result<Option<(String, Arrival, u64)>, String> {
        let Some(units) = row.times.as_ref().and_then(|times| times.units.as_ref()) else {
            return Ok(None);
        };
        let names = self.config.names(&self.clock, point);
        let rate = units.rate.value(&names)?.max(1.0) / self.clock.hclk_hz as f64;
        let burst = units.burst.as_ref().map(|burst| burst.value(&names));
        let burst = burst.transpose()?;
        let jitter = row.times.as_ref().and_then(|times| times.jitter.as_ref());
        let jitter = jitter.map(|jitter| jitter.value(&names));
        let arrival = Arrival {
            period: burst.map_or(1.0 / rate, |_| 1.0),
            group: 1,
            sustained: burst.map(|burst| (rate, burst)),
            jitter: jitter.transpose()?.unwrap_or(0.0),
        };
        let extra = units.extra.value(&names)?.max(0.0).ceil() as u64;
        Ok(Some((units.bound.clone(), arrival, extra)))
    }

    /// When a row is released, and its deadline, cycles.
    ///
    /// # Errors
    ///
    /// Tells which formula is wrong.
    pub(crate) fn arrival(
        &self,
        row: &Row,
        point: Point,
    ) -> Result<Option<(Arrival, f64)>, String> {
        let Some(times) = &row.times else {
            return Ok(None);
        };
        let names = self.config.names(&self.clock, point);
        let value = |formula: &Formula| {
            let value = formula.value(&names);
            value.map_err(|error| format!("`{}`: {error}", row.name))
        };
        let rate = times.rate.as_ref().map(value).transpose()?;
        let burst = times.burst.as_ref().map(value).transpose()?;
        let sustained = rate.map(|rate| (rate / self.clock.hclk_hz as f64, burst.unwrap_or(1.0)));
        let arrival = Arrival {
            period: value(&times.period)?,
            group: times.group.unwrap_or(1),
            sustained,
            jitter: times.jitter.as_ref().map_or(Ok(0.0), value)?,
        };
        Ok(Some((arrival, value(&times.deadline)?)))
    }
}

/// The name under which the number of calls of a function is kept.
pub(crate) fn calls_name(function: &str) -> String {
    format!("calls of {function}")
}

/// The times of a task whose runs are all of one kind.
fn times(config: &TaskConfig) -> Option<ModeConfig> {
    Some(ModeConfig {
        period: config.period.clone()?,
        deadline: config.deadline.clone()?,
        rate: config.rate.clone(),
        burst: config.burst.clone(),
        group: config.group,
        ..ModeConfig::default()
    })
}

/// The times of a mode, in which other modes and regimes have the names of their rows.
fn mode_times(task: &str, mode: &ModeConfig) -> ModeConfig {
    let of_task = |name: &String| format!("{task}: {name}");
    ModeConfig {
        yields_to: mode.yields_to.iter().map(of_task).collect(),
        exclusive_with: mode.exclusive_with.iter().map(of_task).collect(),
        regime: mode.regime.as_ref().map(of_task),
        ..mode.clone()
    }
}

pub(crate) fn misconfigured(what: String, remedy: &str) -> Flaw {
    Flaw::new(Rule::Configuration, what, Place::default(), remedy)
}
