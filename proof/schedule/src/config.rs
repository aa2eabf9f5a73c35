//! `schedule.toml`: what the analysis cannot know from the program.

mod numbers;

use std::collections::BTreeMap;

use serde::Deserialize;

pub use numbers::Point;
use numbers::ProgramNumbers;

use crate::Formula;

/// The file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The requirements on the report, ...
    pub require: Require,
    /// ... and what instead, where the program has a feature of that name.
    #[serde(default)]
    pub require_of: BTreeMap<String, Require>,
    /// Limits that are not times.
    pub limits: Limits,
    /// The point of the table.
    pub table: Table,
    /// Named numbers: loop bounds, and what they are made of.
    #[serde(default)]
    pub bounds: BTreeMap<String, Formula>,
    /// The tasks.
    pub task: BTreeMap<String, TaskConfig>,
    /// The exempt functions, with the reason.
    #[serde(default)]
    pub exempt: Vec<Exempt>,
    /// Functions that may store to registers on which the proof rests.
    #[serde(default)]
    pub register: Vec<RegisterConfig>,
    /// Flags with which hardware releases tasks.
    #[serde(default)]
    pub flag: Vec<FlagConfig>,
    /// Registers that say how often hardware releases tasks.
    #[serde(default)]
    pub control: Vec<ControlConfig>,
    /// Functions that must be in RAM.
    #[serde(default)]
    pub resident: Vec<Exempt>,
    /// Stores that only a test lets happen.
    #[serde(default)]
    pub guarded: Vec<GuardedStore>,
    /// Functions or files whose stores may be those of two tasks.
    #[serde(default)]
    pub shared: Vec<SharedStatic>,
    /// Calls through pointers.
    #[serde(default)]
    pub pointer: Vec<Pointer>,
    /// Functions that are called at most so often in one activation.
    #[serde(default)]
    pub calls: BTreeMap<String, Formula>,
    /// Runs that replace units of work.
    pub substitution: Option<SubstitutionConfig>,
    /// The claims of the numbers of this file.
    #[serde(default)]
    pub figure: Vec<FigureConfig>,
    /// The requirements on a replay.
    #[serde(default)]
    pub replay: Replay,
    /// The order of the initialisation.
    pub startup: Option<Startup>,
    /// The watchdog.
    pub watchdog: Option<Watchdog>,
    /// What the program says; the file has nothing of it.
    #[serde(skip)]
    pub program: ProgramNumbers,
}

/// The order of the initialisation. Functions are named by the ends of their paths.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Startup {
    /// The function of the program that contains the initialisation.
    pub function: String,
    /// Functions each of which must be over before the next begins.
    pub order: Vec<String>,
    /// The function that makes the outputs safe.
    pub safe: String,
    /// Functions that may access peripherals before `safe` has ended.
    pub before: Vec<String>,
}

/// The watchdog, and where it need not be fed.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Watchdog {
    /// The register to which is written what feeds it, ...
    pub key: u32,
    /// ... and what that is.
    pub feed: u32,
    /// How long it waits at least.
    pub period: Formula,
    /// Functions with loops that may last and do not feed it.
    #[serde(default)]
    pub unfed: Vec<FeedExemption>,
    /// Loops of tasks without a deadline that nothing counts.
    #[serde(default)]
    pub uncounted: Vec<Uncounted>,
    /// Functions that such tasks call whose loops and whose time are left out.
    #[serde(default)]
    pub excluded: Vec<Exempt>,
}

/// Loops that nothing counts.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Uncounted {
    /// The functions of the source that they are in: how their names end.
    pub functions: Vec<String>,
    /// The reason why they end.
    pub reason: String,
}

/// A function that need not feed the watchdog.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeedExemption {
    /// How its name ends.
    pub function: String,
    /// Why.
    pub reason: String,
    /// Which programs have it, if not all.
    pub only: Option<String>,
}

/// The claim of some numbers of the file, and its evidence.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigureConfig {
    /// The numbers, or tables of numbers: keys with dots between them.
    pub names: Vec<String>,
    /// The claim, a sentence.
    pub claim: String,
    /// How far that is known.
    pub known: Evidence,
    /// Files that keep or check it.
    pub by: Vec<String>,
}

/// How far a claim is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Evidence {
    /// The program cannot do otherwise, by an argument.
    Constructed,
    /// All cases there are have been tried.
    EveryCase,
    /// Random programs have been tried.
    Random,
    /// Followed in the replay.
    Replayed,
    /// A manual says so.
    Manual,
    /// A limit with which the analysis compares a result.
    Compared,
    /// Nothing checks it.
    Believed,
    /// A promise and no claim about the program: the proof shows that it is kept.
    Promised,
}

impl Evidence {
    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Constructed => "held by the code, by the argument there",
            Self::EveryCase => "tested for every case",
            Self::Random => "tested on random programs",
            Self::Replayed => "checked in each run of the replay",
            Self::Manual => "as a manual says",
            Self::Compared => "compared with what the analysis finds",
            Self::Believed => "taken for granted",
            Self::Promised => "what the proof shows",
        }
    }
}

/// Runs of a mode that may come instead of units of work, beyond what their rate would allow.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubstitutionConfig {
    /// The row: name of the task, and of the mode.
    pub row: String,
    /// The name of the replacing runs, ...
    pub kind: String,
    /// ... and functions that are not called in them.
    #[serde(default)]
    pub excludes: Vec<String>,
    /// Units for which one run more may come.
    pub units: Formula,
    /// Units that a window may have beyond the units of its whole runs.
    pub rounding: Formula,
    /// Runs of other tasks that come with each such run, ...
    #[serde(default)]
    pub with_run: BTreeMap<String, u64>,
    /// ... and with each unit.
    #[serde(default)]
    pub with_unit: BTreeMap<String, u64>,
}

/// The requirements on a replay.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Replay {
    /// Least runs of all tasks with deadlines together.
    pub activations: u64,
    /// The requirement on each long row.
    pub long_rows: Option<LongRows>,
    /// The greatest allowed ratio of the bound of a task, or of a row, to the observed maximum. A
    /// task stands for the longest of its rows.
    #[serde(default)]
    pub ratio: BTreeMap<String, f64>,
}

/// How far the bounds of long rows may be above what is observed.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LongRows {
    /// Rows whose bound with a warm cache is above this, cycles.
    pub above_cycles: u64,
    /// The greatest allowed ratio of the bound to the observed maximum.
    pub ratio: f64,
}

/// A required result.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Require {
    /// Step rate that must be proven at each baud rate, Hz, ...
    pub step_rate_hz: BTreeMap<String, u32>,
    /// ... with up to so many axes.
    pub axes: u8,
    /// Most jitter of an edge on a step pin.
    pub jitter_us: f64,
    /// Longest run of the step task with a warm cache.
    pub step_wcet_cycles: u64,
    /// How long tasks with deadlines may keep the processor from those without, at the required step rate
    /// of each baud rate, µs.
    #[serde(default)]
    pub undeadlined_wait_us: BTreeMap<String, f64>,
}

/// Limits that are not times.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Longest section in which all interrupts are off.
    pub critical_section_cycles: u64,
    /// Most lines of the instruction cache that one task of the two highest priorities touches.
    pub icache_lines: usize,
    /// The highest priority of a task that may use floating point: its registers are saved for no other.
    #[serde(default)]
    pub float_priority: Option<u8>,
    /// Whether the code must not bring about errata of the processor.
    #[serde(default)]
    pub errata: bool,
    /// Bytes at the end of the stack that must not be touched.
    pub stack_guard_bytes: Formula,
    /// Step rate above which no proof is tried, a second: what the queues of the program are made for.
    pub step_rate_hz: Option<Formula>,
}

/// The default point of the table.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// The task that drives the step pins.
    pub step_task: String,
    /// Pulses of all axes together, per second, ...
    pub step_rate_hz: u32,
    /// ... and what instead, where the program has a feature of that name.
    #[serde(default)]
    pub step_rate_of: BTreeMap<String, u32>,
    /// Bits per second.
    pub baud: Formula,
    /// The assumptions of the proof, a sentence each.
    #[serde(default)]
    pub assumptions: Vec<String>,
}

/// A task.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskConfig {
    /// Shortest time between two releases.
    pub period: Option<Formula>,
    /// Time until it must have ended.
    pub deadline: Option<Formula>,
    /// Releases a second in the long run, ...
    pub rate: Option<Formula>,
    /// ... and how many more in any window.
    pub burst: Option<Formula>,
    /// Releases that may come together, a period after those before.
    pub group: Option<u64>,
    /// Why it has no deadline.
    pub undeadlined: Option<String>,
    /// Its kinds of run.
    #[serde(default)]
    pub mode: BTreeMap<String, ModeConfig>,
    /// Other vectors whose handlers call the task.
    #[serde(default)]
    pub vectors: Vec<String>,
    /// The tasks that it may release.
    #[serde(default)]
    pub releases: Vec<String>,
}

/// A kind of run of a task.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModeConfig {
    /// Functions that are not called in such a run.
    #[serde(default)]
    pub excludes: Vec<String>,
    /// As for the task.
    pub period: Formula,
    /// As for the task.
    pub deadline: Formula,
    /// As for the task.
    pub rate: Option<Formula>,
    /// As for the task.
    pub burst: Option<Formula>,
    /// As for the task.
    pub group: Option<u64>,
    /// How long after it is due such a run may be released.
    pub jitter: Option<Formula>,
    /// The units on which its cost depends.
    pub units: Option<Units>,
    /// Modes of the task with precedence: no run of this mode begins while a run of such a mode is
    /// due, so each holds those runs up once.
    #[serde(default)]
    pub yields_to: Vec<String>,
    /// Modes of the task of which no run is due while such a run is: neither holds up the other.
    #[serde(default)]
    pub exclusive_with: Vec<String>,
    /// The task is in one of its regimes at a time, and changes it only when no run is due; without a
    /// name, such runs are in all of them.
    pub regime: Option<String>,
}

/// Units of work of which a run does a varying number: the cost of a run is charged with each run,
/// that of a unit with each unit.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Units {
    /// The named bound that is their greatest number in one run.
    pub bound: String,
    /// How many there are in a second, of all runs together.
    pub rate: Formula,
    /// How many more there may be in each run.
    pub extra: Formula,
    /// How many more may have to be done at once in any window; without it, each comes by itself.
    pub burst: Option<Formula>,
}

/// Stores to registers that the proof rests on, which are allowed.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegisterConfig {
    /// The first address, ...
    pub from: u32,
    /// ... and the end of the range.
    pub to: u32,
    /// Functions or files that store to them, also inlined: parts of their paths.
    pub by: Vec<String>,
    /// Whether these may compute the address.
    #[serde(default)]
    pub computed: bool,
    /// Why that does no harm.
    pub reason: String,
}

/// A flag with which hardware releases a task.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlagConfig {
    /// The vector that it releases.
    pub vector: String,
    /// The register with the flag, which each run looks at, ...
    pub register: u32,
    /// ... and the one by which a run clears it: by a store, ...
    pub clears: u32,
    /// ... or by a read.
    #[serde(default)]
    pub is_read: bool,
}

/// Registers to which some values only may be written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlConfig {
    /// The feature of the programs that it is for; without it, all.
    pub feature: Option<String>,
    /// Their addresses.
    pub registers: Vec<u32>,
    /// The bits that matter; without it, all, and the register must be written wherever its peripheral is used.
    pub mask: Option<u32>,
    /// The values of these bits.
    pub values: Vec<Formula>,
    /// What that ensures.
    pub reason: String,
}

/// Stores to a register that only a test of another lets happen.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GuardedStore {
    /// The register.
    pub register: u32,
    /// The register that is tested.
    pub test: u32,
    /// What that ensures.
    pub reason: String,
}

/// Stores to the same part of a static by tasks of several priorities.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SharedStatic {
    /// Functions or files of all these stores, also inlined: parts of their paths.
    pub by: Vec<String>,
    /// Why no store is lost.
    pub reason: String,
}

/// A function that is excused, or something else that is said of a function.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Exempt {
    /// Its whole path.
    pub function: String,
    /// Why.
    pub reason: String,
}

/// The callees of a function's pointers: for the stack of tasks without a deadline.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pointer {
    /// How its name ends.
    pub function: String,
    /// How the names of what it may call begin or end.
    pub calls: Vec<String>,
}

impl Config {
    /// Reads the text of the file.
    ///
    /// # Errors
    ///
    /// Tells what is wrong with it, and where.
    pub fn parse(text: &str) -> Result<Self, String> {
        toml::from_str(text).map_err(|error| format!("schedule.toml: {error}"))
    }

    /// The file for a program with some features: something else may be required of it, at another step rate.
    #[must_use]
    pub fn of_features(mut self, features: &[String]) -> Self {
        let special = of_features(&mut self.require_of, features);
        self.require = special.unwrap_or(self.require);
        let rate = of_features(&mut self.table.step_rate_of, features);
        self.table.step_rate_hz = rate.unwrap_or(self.table.step_rate_hz);
        self.control.retain(|it| {
            let feature = it.feature.as_ref();
            feature.is_none_or(|it| features.contains(it))
        });
        self
    }

    /// The file without what it says of some tasks.
    #[must_use]
    pub fn without_tasks(mut self, names: &[String]) -> Self {
        for task in names {
            self.task.remove(task);
        }
        for task in self.task.values_mut() {
            task.releases.retain(|name| !names.contains(name));
        }
        self
    }

    /// Why a function is excused, if it is.
    pub fn exemption(&self, function: &str) -> Option<&str> {
        let exempt = self.exempt.iter();
        let mut found = exempt.filter(|exempt| function == exempt.function);
        found.next().map(|exempt| exempt.reason.as_str())
    }
}

/// What there is for some features: a key names one, or several with `+` between them, of which all must be there. The key
/// with the most features counts.
fn of_features<T>(table: &mut BTreeMap<String, T>, features: &[String]) -> Option<T> {
    let has = |feature: &str| features.iter().any(|own| own == feature);
    let fitting = table.keys().filter(|key| key.split('+').all(has));
    let key = fitting.max_by_key(|key| key.split('+').count())?.clone();
    table.remove(&key)
}

/// Whether a function's full name ends with the given one, which begins at the start of a word.
pub(crate) fn is_named(full: &str, name: &str) -> bool {
    full.strip_suffix(name).is_some_and(|before| {
        before.is_empty() || before.ends_with("::") || before.ends_with(['<', ' '])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_function_is_named_by_the_end_of_its_path() {
        assert!(is_named("leadscrew::board::panic::panic", "panic::panic"));
        assert!(is_named("main", "main"));
        assert!(!is_named("leadscrew::domain", "main"));
        assert!(!is_named("main", "app::main"));
    }

    #[test]
    fn what_is_required_may_depend_on_a_feature() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../schedule.toml");
        let text = std::fs::read_to_string(file).unwrap();
        let step_wcet = |features: &[&str]| {
            let features: Vec<String> = features.iter().map(|it| (*it).to_owned()).collect();
            let config = Config::parse(&text).unwrap().of_features(&features);
            config.require.step_wcet_cycles
        };
        let plain = step_wcet(&[]);
        assert_eq!(step_wcet(&["chip-f446"]), plain);
        assert_eq!(step_wcet(&["chip-f446", "usb"]), plain);
        assert!(step_wcet(&["chip-f446", "phases"]) > plain);
    }

    #[test]
    fn what_is_required_of_a_slower_clock_is_required_at_its_own_step_rate() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../schedule.toml");
        let text = std::fs::read_to_string(file).unwrap();
        let of = |features: &[&str]| {
            let features: Vec<String> = features.iter().map(|it| (*it).to_owned()).collect();
            let config = Config::parse(&text).unwrap().of_features(&features);
            (config.table.step_rate_hz, config.require.step_rate_hz)
        };
        let (usual, required) = of(&["chip-f405"]);
        assert!(required.values().any(|rate| *rate == usual));
        let (slower, required) = of(&["chip-f411", "clock-96"]);
        assert!(slower < usual);
        assert!(required.values().any(|rate| *rate == slower));
    }

    #[test]
    fn an_unknown_key_is_refused() {
        let error = Config::parse("[task.step]\nperoid = 1\n").unwrap_err();
        assert!(error.contains("peroid"), "{error}");
    }
}
