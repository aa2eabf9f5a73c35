//! The comparison of measured times with proven bounds.
//!
//! A record begins when the task's first instructions have been executed and ends before its last
//! ones, so it is always shorter than what the bounds are for. Of the bounds, that part is taken off
//! which is outside of every record.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{self, Stdio},
};

use anyhow::{Context, Result};
use common::{cargo, tools};
use firmware::boards::Board;
use serde::{Deserialize, Serialize};

use super::measurement::{Clock, Task, Unit};

/// Cycles from the entry of an exception to the record of its time: a part of the task's execution
/// that is also in its latency. 12 for the entry, 5 for the vector, and the first instructions of
/// the task, from a cold cache.
const BEGINNING: u64 = 120;

/// The proven bounds of a firmware.
pub(super) struct Proof {
    /// The bounds, by the name of the task.
    pub(super) bounds: BTreeMap<String, Bound>,
    /// The clock of the core, Hz.
    pub(super) core_hz: u64,
    /// The reason for a missing proof.
    pub(super) missing: Option<String>,
}

impl Proof {
    /// Analyses the measured firmware itself, so that the bounds include the cost of recording, at
    /// the step rate of the image.
    pub(super) fn of(elf: &Path, board: &Board) -> Result<Self> {
        let hz = crate::step_rate(elf)?.hz();
        let report = Report::of(elf, board, hz)?;
        Ok(Self {
            bounds: bounds(&report),
            core_hz: report.clock_hz,
            missing: flaws(&report),
        })
    }
}

/// The part of the analysis' report that is used here.
#[derive(Debug, Default, Deserialize)]
struct Report {
    clock_hz: u64,
    tasks: Vec<ReportedTask>,
    flaws: Vec<ReportedFlaw>,
}

/// One task of it.
#[derive(Debug, Deserialize)]
struct ReportedTask {
    name: String,
    wcet_cycles: Option<u64>,
    response_cycles: Option<u64>,
}

/// One flaw of it.
#[derive(Debug, Deserialize)]
struct ReportedFlaw {
    what: String,
}

impl Report {
    /// Has a firmware analysed.
    fn of(elf: &Path, board: &Board, hz: u32) -> Result<Self> {
        let file = cargo::target_dir().join(format!("latency-{}.json", process::id()));
        let rate = hz.to_string();
        let mut command = tools::command(tools::SCHEDULE)?;
        command.args(["--board", &board.argument(), "--step-rate", &rate, "--elf"]);
        command.arg(elf).arg("--json").arg(&file);
        // A missing proof makes the command fail, and is reported later.
        let ended = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
        ended.context("cannot start the analysis")?;
        let text = fs::read(&file).context("the analysis has left no report")?;
        let _ = fs::remove_file(&file);
        serde_json::from_slice(&text).context("the report cannot be read")
    }
}

/// The first flaw of a recorded firmware, in one sentence.
fn flaws(report: &Report) -> Option<String> {
    let first = report.flaws.first()?;
    Some(format!(
        "{} flaws found; the first is: {}",
        report.flaws.len(),
        first.what
    ))
}

/// The proven bounds of a task, cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Bound {
    /// Its execution time, with entry and exit of the exception.
    pub(crate) execution: u64,
    /// From its release to its end.
    pub(crate) response: Option<u64>,
}

/// The bounds in a report, by the name of the task. A task of several modes has the largest.
fn bounds(report: &Report) -> BTreeMap<String, Bound> {
    let mut bounds: BTreeMap<String, Bound> = BTreeMap::new();
    for task in &report.tasks {
        let Some(execution) = task.wcet_cycles else {
            continue;
        };
        let name = task.name.split(':').next().unwrap_or_default();
        let response = task.response_cycles;
        let bound = bounds.entry(name.into()).or_insert(Bound {
            execution,
            response,
        });
        bound.execution = bound.execution.max(execution);
        // No response time is no bound, whatever the other modes have.
        let both = bound.response.zip(response);
        bound.response = both.map(|(one, other)| one.max(other));
    }
    bounds
}

/// A bound, and what it says of the maximum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(crate) struct Comparison {
    /// The bound, cycles.
    pub(crate) bound: u64,
    /// By how much the maximum is above it: 0, it is not; `None`: the clock does not allow a comparison.
    pub(crate) above: Option<u64>,
}

/// The comparisons of a task; `None` where nothing is proven.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub(crate) struct Verdict {
    pub(crate) latency: Option<Comparison>,
    pub(crate) execution: Option<Comparison>,
    pub(crate) response: Option<Comparison>,
}

impl Verdict {
    /// Whether a maximum is above its bound.
    pub(crate) fn is_refuted(&self) -> bool {
        let all = [self.latency, self.execution, self.response];
        all.into_iter()
            .flatten()
            .any(|one| one.above.is_some_and(|above| above != 0))
    }
}

/// Compares a task with its bound.
///
/// In the emulator, tasks are released and preempted by other hardware than the response times are
/// proven for, so response times are not compared. An execution time is: no instruction takes less
/// than a cycle, so more instructions than the bound has cycles refute it.
pub(crate) fn compare(task: &Task, bound: &Bound, clock: Clock) -> Verdict {
    let is_chip = clock.unit == Unit::Cycles;
    let compared = |bound: u64, max: u64| Comparison {
        bound,
        above: Some(max.saturating_sub(bound)),
    };
    let on_chip = |bound: u64, max: u64| Comparison {
        bound,
        above: is_chip.then(|| max.saturating_sub(bound)),
    };
    let own = bound.execution.saturating_sub(clock.entry_and_exit);
    Verdict {
        latency: bound.response.map(|response| {
            let start = response.saturating_sub(bound.execution) + BEGINNING;
            on_chip(start.min(response), task.latency.summary().max)
        }),
        execution: Some(compared(own, task.proven_execution)),
        response: bound
            .response
            .map(|response| on_chip(response, task.response.summary().max)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A task with one latency, execution and response.
    fn task(latency: u64, execution: u64) -> Task {
        let mut task = Task {
            proven_execution: execution,
            ..Task::default()
        };
        task.latency.add(latency);
        task.execution.add(execution);
        task.response.add(latency + execution);
        task
    }

    const BOUND: Bound = Bound {
        execution: 300,
        response: Some(900),
    };

    #[test]
    fn a_maximum_at_the_bound_is_allowed_and_one_above_it_is_not() {
        let verdict = |latency, execution| compare(&task(latency, execution), &BOUND, Clock::CHIP);
        let at = verdict(600, 276);
        assert!(!at.is_refuted(), "{at:?}");
        let above = verdict(600, 277).execution.unwrap();
        assert_eq!((above.bound, above.above), (276, Some(1)));
        let late = verdict(721, 100);
        assert_eq!(late.latency.unwrap().above, Some(1));
        assert_eq!(late.response.unwrap().above, Some(0));
        assert!(late.is_refuted());
        assert_eq!(verdict(700, 230).response.unwrap().above, Some(30));
    }

    #[test]
    fn the_emulator_compares_executions_only() {
        let verdict = compare(&task(50_000, 300), &BOUND, Clock::EMULATOR);
        assert!(!verdict.is_refuted());
        let [latency, response] = [verdict.latency, verdict.response].map(Option::unwrap);
        assert_eq!((latency.above, response.above), (None, None));
        let verdict = compare(&task(0, 301), &BOUND, Clock::EMULATOR);
        assert!(verdict.is_refuted());
    }

    #[test]
    fn a_task_without_a_response_time_is_compared_by_its_execution() {
        let bound = Bound {
            response: None,
            ..BOUND
        };
        let verdict = compare(&task(50_000, 300), &bound, Clock::CHIP);
        assert_eq!(verdict.execution.unwrap().above, Some(24));
        assert!(verdict.latency.is_none());
    }

    #[test]
    fn a_report_gives_each_task_its_longest_mode() {
        let row = |name: &str, wcet_cycles, response_cycles| ReportedTask {
            name: name.into(),
            wcet_cycles,
            response_cycles,
        };
        let report = Report {
            tasks: vec![
                row("step", Some(300), Some(400)),
                row("prepare: segment", Some(9000), Some(20_000)),
                row("prepare: entry", Some(7000), Some(30_000)),
                row("wake", None, None),
            ],
            ..Report::default()
        };
        let bounds = bounds(&report);
        assert_eq!(bounds.len(), 2);
        let expected = Bound {
            execution: 9000,
            response: Some(30_000),
        };
        assert_eq!(bounds["prepare"], expected);
        assert_eq!(bounds["step"].execution, 300);
    }
}
