//! The result of an analysis, as `--json` prints it.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::Flaw;

/// Everything that was found out.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Report {
    /// Name of the board.
    pub board: String,
    /// SHA-256 of the ELF file, in hexadecimal.
    pub elf_sha256: String,
    /// Whether the cycle table comes from measurements on a board.
    pub calibrated: bool,
    /// The calibration file, when there is one.
    pub calibration: Option<String>,
    /// Axes that the firmware is built for.
    pub axes: u8,
    /// Clock of the core, Hz.
    pub clock_hz: u64,
    /// Clock of the step timer, Hz: its ticks.
    pub timer_hz: u64,
    /// Step rate that the table is for: pulses of all axes together, per second.
    pub step_rate_hz: u32,
    /// Baud rate that the table is for; 0 over USB.
    pub baud: u32,
    /// The tasks, the highest priority first.
    pub tasks: Vec<Task>,
    /// Share of the processor that the tasks with deadlines take at most.
    pub utilisation: f64,
    /// Which runs may come instead of units of work.
    pub substitution: Option<SubstitutedRuns>,
    /// The highest proven step rate for each baud rate.
    pub proven_step_rate_hz: BTreeMap<String, u32>,
    /// The same without any assumption about the instruction cache.
    pub uncached_step_rate_hz: BTreeMap<String, u32>,
    /// How long tasks with deadlines may keep the processor from tasks without: at the step rate of
    /// the table, at all required rates and at all proven rates.
    pub undeadlined_waits: Vec<UndeadlinedWait>,
    /// The tasks that each task releases.
    pub releases: BTreeMap<String, BTreeSet<String>>,
    /// The tasks without deadlines, which also keep `idle` from feeding the watchdog.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub undeadlined: Option<TasksWithoutDeadline>,
    /// Longest run of the step task with a warm cache, exception entry and exit included, cycles.
    pub step_wcet_cycles: u64,
    /// Most by which an edge of a step pin moves, µs.
    pub step_edge_jitter_us: f64,
    /// Deepest stack over all priorities, bytes.
    pub stack_worst_bytes: u64,
    /// Stack of each level.
    pub stack: Vec<Stack>,
    /// RAM that is left for the stack, bytes.
    pub stack_available_bytes: u64,
    /// Sections in which tasks are held up.
    pub sections: Vec<Section>,
    /// Slack of the tasks by step rate, at [`Report::baud`].
    pub curve: Vec<Curve>,
    /// The requirements of `schedule.toml`, and whether they are met.
    pub requirements: Vec<Requirement>,
    /// The assumptions of the proof, a sentence each.
    pub assumptions: Vec<String>,
    /// The constants of the program that `schedule.toml` may name.
    pub constants: BTreeMap<String, f64>,
    /// The numbers of `schedule.toml` that it counts on.
    pub figures: Vec<KnownFigures>,
    /// The comments that state bounds which nothing counts.
    pub believed: BTreeSet<BelievedLoop>,
    /// The flaws; empty: proven.
    pub flaws: Vec<Flaw>,
}

/// Numbers of `schedule.toml` that no analysis gives.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct KnownFigures {
    /// Their names and formulas.
    pub formulas: BTreeMap<String, String>,
    /// Their claim about the program.
    pub claim: String,
    /// How far that is known.
    pub known: String,
    /// Files that keep or check it.
    pub by: Vec<String>,
}

/// How far the bounds of the loops of a row are known.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct LoopCounts {
    /// Loops that the analysis counts.
    pub counted: usize,
    /// The same, where a comment states no less.
    pub counted_and_stated: usize,
    /// Loops of which only a comment says how often they run.
    pub believed: usize,
}

/// A bound that is believed.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct BelievedLoop {
    /// `file:line` of the comment.
    pub place: String,
    /// The number, or its name.
    pub count: String,
    /// Why it holds, as the comment says.
    pub reason: String,
}

/// Worst-case execution times, entry and exit of the exception included, cycles.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Wcet {
    /// With every instruction in the cache.
    pub warm: u64,
    /// From a cold cache, each line missed once.
    pub cold: u64,
    /// With a miss for every line of every block.
    pub uncached: u64,
}

/// How long tasks with deadlines may run one after another, with what holds them up.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UndeadlinedWait {
    /// Step rate that it is for, Hz.
    pub step_rate_hz: u32,
    /// Baud rate that it is for.
    pub baud: u32,
    /// The time, cycles; `None`: no bound.
    pub cycles: Option<u64>,
}

impl UndeadlinedWait {
    /// The time in µs at a clock; infinite without a bound.
    #[must_use]
    pub fn us(&self, clock_hz: u64) -> f64 {
        let us = |cycles| cycles as f64 * 1e6 / clock_hz as f64;
        self.cycles.map_or(f64::INFINITY, us)
    }
}

/// The tasks without a deadline: their loops, and what they take besides.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct TasksWithoutDeadline {
    /// Their names.
    pub tasks: Vec<String>,
    /// Loops that are counted, or whose number of runs the source states.
    pub counted: usize,
    /// Loops that feed the watchdog in each iteration.
    pub fed: usize,
    /// The others.
    pub uncounted: Vec<UncountedLoops>,
    /// How long a run of each of the tasks takes, one after the other, without the iterations of
    /// uncounted loops, cycles; `None`: not known.
    pub rest_cycles: Option<u64>,
}

/// Loops that nothing counts, and that end for the same reason.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct UncountedLoops {
    /// The reason why they end.
    pub reason: String,
    /// The function that each is in, and where.
    #[serde(skip)]
    pub places: Vec<String>,
}

/// One task.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Task {
    /// Its name in the source.
    pub name: String,
    /// Its vector.
    pub vector: String,
    /// Its priority, a higher number is more urgent.
    pub priority: u8,
    /// Shortest time between two releases, cycles; `None`: no deadline, not analysed.
    pub period_cycles: Option<f64>,
    /// Where the period is from.
    pub period_source: String,
    /// Shortest time between two releases of a burst, cycles; `None`: the period.
    ///
    /// Release number `n`, from 0, comes at the earliest `max(n × spacing, (n - burst) × period)`
    /// after the first.
    pub spacing_cycles: Option<f64>,
    /// Releases that may come before their period.
    pub burst: f64,
    /// Execution times.
    pub wcet: Option<Wcet>,
    /// The one that the response time is made of.
    pub wcet_cycles: Option<u64>,
    /// Which that is: `cold` or `uncached`.
    pub via: String,
    /// Share of the processor that it takes at most in the long run.
    pub share: f64,
    /// Longest time that lower priorities hold it up, cycles.
    pub blocking_cycles: u64,
    /// Its blocking.
    pub blocking_source: String,
    /// Response time, cycles; `None`: unbounded.
    pub response_cycles: Option<u64>,
    /// Deadline, cycles.
    pub deadline_cycles: Option<f64>,
    /// Deadline less response time, µs.
    pub slack_us: Option<f64>,
    /// How far the bounds of its loops are known.
    pub loops: LoopCounts,
    /// Lines of the instruction cache that it touches.
    pub icache_lines: usize,
    /// Stack of one activation, exception frame included, bytes.
    pub stack_bytes: u64,
    /// Whether it uses floating point.
    pub uses_float: bool,
    /// Rows of the same task that are never due while this one is.
    pub exclusive_with: Vec<String>,
    /// The row of which its runs are a special kind, and which stands for them in all times.
    pub kind_of: Option<String>,
    /// The regime that it is due in, where its task has several.
    pub regime: Option<String>,
    /// The demand from which its response time is computed.
    pub window: Option<Window>,
    /// Its worst path by source line, in the order of their cost.
    pub worst_path: Vec<Line>,
}

/// The demand in the busy window of a task.
///
/// Job number `n` of the last of its own streams, from 0, is due `release(n)` after the window's
/// beginning, less the jitter, and ends with the smallest window `w = once + Σ own + Σ others`. Of the
/// others, the releases of `w + jitter` count, but one at least; of its own streams but the last, those
/// due before `release(n + 1)`; of the last, `n + 1`. The response time is the longest from when a job is
/// due to its end, of all jobs up to the first that ends before the next release.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Window {
    /// The task's own work: the last stream is the one whose ends count.
    pub own: Vec<Stream>,
    /// The work of tasks of higher and of the same priority.
    pub others: Vec<Stream>,
    /// Blocking, and what the window pays once besides, cycles.
    pub once: u64,
}

/// Releases of the same work.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Stream {
    /// Shortest time between two groups of releases, cycles, ...
    pub period: f64,
    /// ... and how many one has.
    pub group: u64,
    /// Releases a cycle in the long run; `None`: the period alone limits them.
    pub rate: Option<f64>,
    /// How many more there may be in any window.
    pub burst: f64,
    /// How much later than it is due a release may come, cycles.
    pub jitter: f64,
    /// The highest cost of one release, with the delay of other tasks, cycles.
    pub cost: u64,
}

/// Runs that may come instead of units of work.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SubstitutedRuns {
    /// Their row.
    pub row: String,
    /// For how many units one may come.
    pub units: u64,
    /// How many it costs at most, with all that comes with both.
    pub costs: f64,
}

/// A source line on a worst path.
#[derive(Debug, Clone, Serialize)]
pub struct Line {
    /// File, from the root of the project.
    pub file: String,
    /// Line number.
    pub line: u32,
    /// Function that it is in.
    pub function: String,
    /// Cycles that it takes on the path.
    pub cycles: u64,
    /// How often it is executed.
    pub count: u64,
}

/// A stretch of code in which tasks are held up.
#[derive(Debug, Clone, Serialize)]
pub struct Section {
    /// Where it begins: `function (file:line)`.
    pub place: String,
    /// Tasks up to this priority are held up; `None`: all.
    pub ceiling: Option<u8>,
    /// Priority of the task it is in; 0: idle and initialisation.
    pub priority: u8,
    /// Its longest time, cycles.
    pub cycles: u64,
    /// Why it does not count, when it does not.
    pub exempt: Option<String>,
}

/// The link to the sender, behind a word: `at 115200 baud`, `over USB`.
#[must_use]
pub fn link(word: &str, baud: u32, shown: impl Fn(u64) -> String) -> String {
    match baud {
        0 => "over USB".into(),
        _ => format!("{word} {} baud", shown(baud.into())),
    }
}

/// A figure that `schedule.toml` sets a limit to.
#[derive(Debug, Clone, Serialize)]
pub struct Requirement {
    /// The requirement in words: `step rate at 115200 baud`.
    pub what: String,
    /// The unit of both figures.
    pub unit: String,
    /// The limit.
    pub required: f64,
    /// The result.
    pub found: f64,
    /// Whether it is met.
    pub is_met: bool,
}

/// Stack of one priority level.
#[derive(Debug, Clone, Serialize)]
pub struct Stack {
    /// The level; 0: idle.
    pub priority: u8,
    /// The task that needs most.
    pub task: String,
    /// Bytes, exception frame included.
    pub bytes: u64,
}

/// The slack of each task at one step rate.
#[derive(Debug, Clone, Serialize)]
pub struct Curve {
    /// The step rate, Hz.
    pub step_rate_hz: u32,
    /// Slack of each task that has a deadline, µs; `None`: unbounded.
    pub slack_us: BTreeMap<String, Option<f64>>,
    /// Deadline of each of them at this step rate, µs.
    pub deadline_us: BTreeMap<String, f64>,
}
