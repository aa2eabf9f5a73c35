//! Bounds against what was observed.

use std::fmt::Write as _;

use anstream::println;
use owo_colors::OwoColorize;
use schedule::{
    Replay, Report, Task, Wcet,
    replay::{Runs, STAND_INS, Summary},
};

/// Blocks that were never executed that are printed for each task.
const NEVER_LINES: usize = 6;

/// One kind of run.
#[derive(Debug)]
pub(crate) struct Row {
    name: String,
    bound: Wcet,
    runs: Runs,
    /// Most that the bound may be above what was observed, each observed cycle.
    limit: Option<f64>,
}

/// See the module.
#[derive(Debug, Default)]
pub(crate) struct Verdict {
    pub(crate) rows: Vec<Row>,
    /// The violations, one sentence each.
    pub(crate) failures: Vec<String>,
}

impl Row {
    fn ratio(&self) -> f64 {
        self.bound.warm as f64 / self.runs.warm_max.max(1) as f64
    }

    /// The bounds of the row that a run exceeded, one sentence each.
    fn excess(&self, task: &Task) -> Vec<String> {
        let Runs {
            warm_max,
            cached_max,
            uncached_max,
            stack_max,
            ..
        } = self.runs;
        let pairs = [
            ("cycles with a warm cache", warm_max, self.bound.warm),
            (
                "cycles with the cache as it was",
                cached_max,
                self.bound.cold,
            ),
            ("cycles without a cache", uncached_max, self.bound.uncached),
            ("bytes of stack", stack_max, task.stack_bytes),
        ];
        pairs
            .iter()
            // A cold bound of 0: its code does not fit the cache.
            .filter(|(_, observed, bound)| *bound != 0 && observed > bound)
            .map(|(what, observed, bound)| {
                format!("{}: {observed} {what}, and the bound is {bound}", self.name)
            })
            .collect()
    }
}

impl Verdict {
    /// Compares.
    pub(crate) fn of(report: &Report, summary: &Summary, limits: &Replay) -> Self {
        let mut verdict = Self::default();
        for violation in &summary.violations {
            let place = violation.place.join(" < ");
            let text = format!("{}, {} times: {place}", violation.what, violation.count);
            verdict.failures.push(text);
        }
        let tasks = summary.tasks.iter();
        for runs in tasks.filter(|runs| !STAND_INS.contains(&runs.name.as_str())) {
            let task = report.tasks.iter().find(|task| task.name == runs.name);
            let Some((task, bound)) = task.and_then(|task| Some((task, task.wcet?))) else {
                verdict.failures.push(format!("{} has no bound", runs.name));
                continue;
            };
            let row = Row {
                name: runs.name.clone(),
                bound,
                runs: runs.clone(),
                limit: None,
            };
            verdict.failures.extend(row.excess(task));
            verdict.rows.push(row);
        }
        verdict.check_sections(report, summary);
        verdict.check_limits(limits);
        verdict
    }

    pub(crate) fn is_passed(&self) -> bool {
        self.failures.is_empty()
    }

    /// No section may have been longer than the longest that begins at the same place. One that holds
    /// up no task with a deadline does not count: such code may call through pointers.
    fn check_sections(&mut self, report: &Report, summary: &Summary) {
        let timed = report
            .tasks
            .iter()
            .filter(|it| it.deadline_cycles.is_some());
        let lowest = timed.map(|it| it.priority).min().unwrap_or(0);
        for held in &summary.sections {
            let same = report.sections.iter().filter(|one| one.place == held.place);
            let Some(longest) = same.clone().map(|one| one.cycles).max() else {
                let place = &held.place;
                let text =
                    format!("a section with tasks held up is not known to the analysis: {place}");
                self.failures.push(text);
                continue;
            };
            let is_below = |ceiling: Option<u8>| ceiling.is_some_and(|ceiling| ceiling < lowest);
            let is_exempt = same
                .into_iter()
                .any(|one| one.exempt.is_some() || one.cycles == 0 || is_below(one.ceiling));
            if !is_exempt && held.cycles > longest {
                self.failures.push(format!(
                    "a section with tasks held up lasted {} cycles, and the bound is {longest}: {}",
                    held.cycles, held.place
                ));
            }
        }
    }

    /// Enough must have been seen, and the bounds be near it.
    fn check_limits(&mut self, limits: &Replay) {
        let runs: u64 = self.rows.iter().map(|row| row.runs.activations).sum();
        if runs < limits.activations {
            let least = limits.activations;
            let text = format!("{runs} activations were followed, and {least} are asked for");
            self.failures.push(text);
        }
        for row in &mut self.rows {
            let long = limits.long_rows;
            let long = long.filter(|long| row.bound.warm > long.above_cycles);
            row.limit = long.map(|long| long.ratio);
        }
        for (task, limit) in &limits.ratio {
            let kind = format!("{task}: ");
            let rows = self.rows.iter_mut();
            let rows = rows.filter(|row| row.name == *task || row.name.starts_with(&kind));
            // Of several kinds of runs the one that gives the task's execution time.
            let Some(row) = rows.max_by_key(|row| row.bound.warm) else {
                self.failures.push(format!("{task} was not followed"));
                continue;
            };
            row.limit = Some(row.limit.map_or(*limit, |least| least.min(*limit)));
        }
        for row in &self.rows {
            let (name, ratio) = (&row.name, row.ratio());
            if let Some(limit) = row.limit.filter(|limit| ratio > *limit) {
                self.failures.push(format!(
                    "{name}: its bound is {ratio:.3} times what was observed, more than {limit}"
                ));
            }
        }
    }
}

/// Prints the table and the verdict.
pub(crate) fn print(verdict: &Verdict, summary: &Summary) {
    let head = format!(
        "{:<20}{:>9}{:>10}{:>8}{:>8}{:>7}{:>9}{:>8}{:>8}{:>8}{:>8}{:>11}",
        "task",
        "runs",
        "preempted",
        "bound",
        "max",
        "ratio",
        "limit",
        "cold",
        "max",
        "uncach.",
        "max",
        "blocks"
    );
    println!("{}", head.bold());
    for row in &verdict.rows {
        println!("{}", line(row));
    }
    println!(
        "\n{} instructions, {} accesses by tasks, {} of them in regions that are not predicted",
        summary.instructions, summary.accesses, summary.unpredicted
    );
    for row in &verdict.rows {
        for never in row.runs.never.iter().take(NEVER_LINES) {
            println!("{} {}: {never}", "never executed".dimmed(), row.name);
        }
    }
    for failure in &verdict.failures {
        println!("{} {failure}", "violation".red().bold());
    }
    let words = if verdict.is_passed() {
        "holds: nothing executed contradicts the analysis"
            .green()
            .to_string()
    } else {
        "does not hold".red().to_string()
    };
    println!("replay {words}");
}

fn line(row: &Row) -> String {
    let Row { bound, runs, .. } = row;
    let mut text = format!(
        "{:<20}{:>9}{:>10}{:>8}{:>8}{:>7.3}",
        row.name,
        runs.activations,
        runs.preempted,
        bound.warm,
        runs.warm_max,
        row.ratio()
    );
    let limit = row
        .limit
        .map(|limit| format!("{limit}"))
        .unwrap_or_default();
    let covered = format!("{}/{}", runs.executed, runs.blocks);
    // Writing to a string never fails.
    let _ = write!(
        text,
        "{limit:>9}{:>8}{:>8}{:>8}{:>8}{covered:>11}",
        bound.cold, runs.cached_max, bound.uncached, runs.uncached_max
    );
    text
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use schedule::{
        LongRows, Section,
        replay::{Held, Violation},
    };

    use super::*;

    fn report(warm: u64) -> Report {
        let task = |name: &str| Task {
            name: name.into(),
            wcet: Some(Wcet {
                warm,
                cold: 0,
                uncached: 3 * warm,
            }),
            stack_bytes: 100,
            ..Task::default()
        };
        Report {
            tasks: vec![
                task("step"),
                task("prepare: segment"),
                task("prepare: take"),
            ],
            sections: vec![Section {
                place: "lock (src/a.rs:1)".into(),
                ceiling: None,
                priority: 0,
                cycles: 30,
                exempt: None,
            }],
            ..Report::default()
        }
    }

    fn summary(warm_max: u64) -> Summary {
        let runs = |name: &str| Runs {
            name: name.into(),
            activations: 10,
            warm_max,
            ..Runs::default()
        };
        Summary {
            tasks: vec![runs("step"), runs("prepare: segment"), runs(STAND_INS[0])],
            ..Summary::default()
        }
    }

    fn limits(ratio: f64) -> Replay {
        let ratio = ["step", "prepare"].map(|task| (task.to_owned(), ratio));
        Replay {
            activations: 20,
            ratio: BTreeMap::from(ratio),
            ..Replay::default()
        }
    }

    #[test]
    fn what_stays_below_its_bounds_passes() {
        let verdict = Verdict::of(&report(115), &summary(100), &limits(1.15));
        assert_eq!(verdict.failures, Vec::<String>::new());
        assert_eq!(verdict.rows.len(), 2);
    }

    #[test]
    fn a_run_above_its_bound_fails() {
        let verdict = Verdict::of(&report(99), &summary(100), &limits(1.15));
        let failure = "step: 100 cycles with a warm cache, and the bound is 99";
        assert_eq!(verdict.failures[0], failure);
    }

    #[test]
    fn a_bound_far_above_what_was_observed_fails() {
        let verdict = Verdict::of(&report(116), &summary(100), &limits(1.15));
        assert!(verdict.failures[1].starts_with("prepare: segment: its bound is 1.160 times"));
        assert_eq!(verdict.failures.len(), 2);
    }

    #[test]
    fn each_long_row_has_a_limit_of_its_own() {
        let limits = |above_cycles| Replay {
            long_rows: Some(LongRows {
                above_cycles,
                ratio: 1.5,
            }),
            ..limits(1.6)
        };
        let failures = |above| Verdict::of(&report(151), &summary(100), &limits(above)).failures;
        assert_eq!(failures(151), [""; 0]);
        let failures = failures(150);
        assert!(failures[0].starts_with("step: its bound is 1.510 times"));
        assert_eq!(failures.len(), 2);
    }

    #[test]
    fn too_few_activations_fail() {
        let mut limits = limits(1.15);
        limits.activations = 21;
        let verdict = Verdict::of(&report(110), &summary(100), &limits);
        assert_eq!(
            verdict.failures,
            ["20 activations were followed, and 21 are asked for"]
        );
    }

    #[test]
    fn sections_are_compared_by_their_place() {
        let mut summary = summary(100);
        let held = |place: &str, cycles| Held {
            address: 2,
            place: place.into(),
            cycles,
        };
        summary.sections = vec![
            held("lock (src/a.rs:1)", 30),
            held("lock (src/a.rs:1)", 31),
            held("lock (src/a.rs:2)", 1),
        ];
        let verdict = Verdict::of(&report(110), &summary, &limits(1.15));
        assert_eq!(verdict.failures.len(), 2);
        assert!(verdict.failures[0].contains("lasted 31 cycles, and the bound is 30"));
        assert!(verdict.failures[1].contains("is not known to the analysis"));
    }

    #[test]
    fn a_section_that_holds_up_no_deadline_may_be_long() {
        let mut summary = summary(100);
        summary.sections = vec![Held {
            address: 2,
            place: "lock (src/a.rs:1)".into(),
            cycles: 31,
        }];
        for (ceiling, failures) in [(Some(1), 0), (Some(2), 1), (None, 1)] {
            let mut report = report(110);
            report.sections[0].ceiling = ceiling;
            for task in &mut report.tasks {
                task.priority = 2;
                task.deadline_cycles = Some(1000.0);
            }
            let verdict = Verdict::of(&report, &summary, &limits(1.15));
            assert_eq!(verdict.failures.len(), failures, "{ceiling:?}");
        }
    }

    #[test]
    fn a_violation_is_reported_with_its_place_and_count() {
        let mut summary = summary(100);
        summary.violations.push(Violation {
            what: "a loop runs more than 3 times".into(),
            place: vec!["f (src/a.rs:1)".into(), "g (src/b.rs:2)".into()],
            count: 7,
        });
        let verdict = Verdict::of(&report(110), &summary, &limits(1.15));
        let failure = "a loop runs more than 3 times, 7 times: f (src/a.rs:1) < g (src/b.rs:2)";
        assert_eq!(verdict.failures, [failure]);
    }
}
