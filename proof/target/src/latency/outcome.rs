//! The outcome of a measurement: as a table, as histograms, as JSON.

use std::{collections::BTreeMap, fmt::Write as _};

use owo_colors::OwoColorize;
use serde_json::{Value, json};

use super::{
    bounds::{Bound, Comparison, Verdict, compare},
    distribution::Distribution,
    measurement::{Clock, Task, Unit},
};

/// Characters of the longest bar of a histogram.
const BAR: f64 = 48.0;

/// The whole outcome.
pub(crate) struct Outcome {
    /// Program and board of the measurement: one line.
    pub(crate) subject: String,
    pub(crate) clock: Clock,
    /// The clock of the core, Hz.
    pub(crate) core_hz: u64,
    pub(crate) tasks: Vec<Measured>,
    /// The reason for a missing proof.
    pub(crate) unproven: Option<String>,
}

/// A task and what its bounds say.
pub(crate) struct Measured {
    pub(crate) task: Task,
    pub(crate) verdict: Verdict,
}

/// One quantity of a task.
pub(crate) struct Quantity<'a> {
    pub(crate) name: &'static str,
    pub(crate) values: &'a Distribution,
    pub(crate) comparison: Option<Comparison>,
}

/// The handler that stands in for hardware in the emulator: no task, but it preempts tasks.
const STAND_IN: &str = "stand-in";

/// Compares the tasks with what is proven of them.
pub(super) fn judge(
    tasks: &[Task],
    bounds: &BTreeMap<String, Bound>,
    clock: Clock,
) -> Vec<Measured> {
    let tasks = tasks.iter().filter(|task| task.name != STAND_IN);
    tasks
        .map(|task| Measured::new(task, bounds, clock))
        .collect()
}

impl Measured {
    /// Compares a task with what is proven of it.
    fn new(task: &Task, bounds: &BTreeMap<String, Bound>, clock: Clock) -> Self {
        let bound = bounds.get(&task.name);
        Self {
            task: task.clone(),
            verdict: bound.map_or_else(Verdict::default, |bound| compare(task, bound, clock)),
        }
    }

    /// Its quantities, as far as they have values.
    pub(crate) fn quantities(&self) -> impl Iterator<Item = Quantity<'_>> {
        let Self { task, verdict } = self;
        let all = [
            ("latency", &task.latency, verdict.latency),
            ("execution", &task.execution, verdict.execution),
            ("response", &task.response, verdict.response),
        ];
        all.into_iter()
            .map(|(name, values, comparison)| Quantity {
                name,
                values,
                comparison,
            })
            .filter(|quantity| quantity.values.summary().count != 0)
    }
}

impl Unit {
    /// Its name in texts.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Cycles => "cycles",
            Self::Instructions => "instructions",
        }
    }
}

impl Outcome {
    /// Whether a maximum is above its bound.
    pub(crate) fn is_refuted(&self) -> bool {
        let mut tasks = self.tasks.iter();
        tasks.any(|measured| measured.verdict.is_refuted())
    }

    /// The table.
    pub(crate) fn table(&self) -> String {
        let mut text = String::new();
        let head = format!(
            "{:<10} {:<10}{:>10}{:>9}{:>11}{:>9}{:>9}{:>9}{:>9}",
            "task", "what", "count", "min", "mean", "p99", "p99.9", "max", "bound"
        );
        let _ = writeln!(text, "{}", head.bold());
        for measured in &self.tasks {
            for (index, quantity) in measured.quantities().enumerate() {
                let name = if index == 0 { &*measured.task.name } else { "" };
                let _ = writeln!(text, "{name:<10} {}", quantity.row());
            }
        }
        text
    }

    /// Notes for reading the table.
    pub(crate) fn notes(&self) -> String {
        let mut text = String::new();
        let unit = self.clock.unit.name();
        let mhz = self.core_hz / 1_000_000;
        let _ = writeln!(
            text,
            "In {unit}; bounds in cycles of {mhz} MHz, less what is outside of a record."
        );
        if self.clock.unit == Unit::Instructions {
            text.push_str(EMULATED);
        }
        for measured in &self.tasks {
            let task = &measured.task;
            let (all, dropped) = (task.activations, task.dropped());
            let unsure = task.recorded - task.execution.summary().count;
            let unseen = task.recorded - task.latency.summary().count;
            let _ = writeln!(
                text,
                "{}: {all} activations, {dropped} not recorded; execution unknown of {unsure} \
                 that dropped ones may have preempted, release unknown of {unseen}",
                task.name
            );
        }
        if let Some(reason) = &self.unproven {
            let _ = writeln!(text, "Not proven: {reason}");
        }
        text
    }

    /// A histogram of each quantity.
    pub(crate) fn histograms(&self) -> String {
        let mut text = String::new();
        for measured in &self.tasks {
            for quantity in measured.quantities().filter(|one| one.name != "response") {
                let title = format!("{}, {}", measured.task.name, quantity.name);
                let _ = writeln!(text, "{}", title.bold());
                text.push_str(&bars(quantity.values));
            }
        }
        text
    }

    /// The same for programs.
    pub(crate) fn json(&self) -> Value {
        let tasks: Vec<_> = self.tasks.iter().map(Measured::json).collect();
        json!({
            "subject": self.subject,
            "unit": self.clock.unit,
            "core_hz": self.core_hz,
            "bounds_unit": Unit::Cycles,
            "unproven": self.unproven,
            "is_refuted": self.is_refuted(),
            "tasks": tasks,
        })
    }
}

/// The meaning of the emulator's clock.
const EMULATED: &str = "\
    Under QEMU there is no cycle counter: time goes on by 8 ns of virtual time with each executed\n\
    instruction, whatever it is, and is told in instructions. Each takes a cycle at least, so an\n\
    execution of more instructions than its bound has cycles would refute the bound. Latencies and\n\
    responses are not compared: a handler stands in for the timers, and idling for the time between.\n";

impl Quantity<'_> {
    fn row(&self) -> String {
        let summary = self.values.summary();
        let bound = match self.comparison {
            None => String::from("-"),
            Some(comparison) => match comparison.above {
                None => format!("({})", comparison.bound),
                Some(_) => comparison.bound.to_string(),
            },
        };
        let row = format!(
            "{:<10}{:>10}{:>9}{:>11.1}{:>9}{:>9}{:>9}{bound:>9}",
            self.name,
            summary.count,
            summary.min,
            summary.mean,
            summary.p99,
            summary.p999,
            summary.max,
        );
        match self.comparison.and_then(|comparison| comparison.above) {
            None | Some(0) => row,
            Some(above) => format!("{row}  {}", format!("{above} above").red().bold()),
        }
    }

    fn json(&self) -> Value {
        let comparison = self.comparison;
        json!({
            "summary": self.values.summary(),
            "bound": comparison.map(|comparison| comparison.bound),
            "above_bound": comparison.and_then(|comparison| comparison.above),
            "histogram": self.values.classes(4),
        })
    }
}

impl Measured {
    fn json(&self) -> Value {
        let quantities = self.quantities();
        let quantities = quantities.map(|quantity| (quantity.name.to_owned(), quantity.json()));
        let mut task: serde_json::Map<String, Value> = quantities.collect();
        task.insert("name".into(), json!(self.task.name));
        task.insert("activations".into(), json!(self.task.activations));
        task.insert("recorded".into(), json!(self.task.recorded));
        task.insert("dropped".into(), json!(self.task.dropped()));
        Value::Object(task)
    }
}

/// A histogram; the length of a bar grows with the logarithm of its count, so that one is seen.
fn bars(values: &Distribution) -> String {
    let classes = values.classes(2);
    let highest = classes.iter().map(|class| class.count).max().unwrap_or(1);
    let length = |count: u64| {
        let share = (count as f64).ln_1p() / (highest as f64).ln_1p();
        (share * BAR).ceil() as usize
    };
    let mut text = String::new();
    let mut is_empty = false;
    for class in &classes {
        if class.count == 0 {
            if !is_empty {
                let _ = writeln!(text, "{:>9}", "…");
            }
            is_empty = true;
            continue;
        }
        is_empty = false;
        let bar = "█".repeat(length(class.count));
        let (from, to) = (class.from, class.to - 1);
        let _ = writeln!(text, "{from:>9} to {to:<9} {:>9} {bar}", class.count);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A measurement of one task with one activation.
    fn outcome(execution: u64, bound: Option<u64>, clock: Clock) -> Outcome {
        let mut task = Task {
            name: "step".into(),
            activations: 3,
            recorded: 1,
            proven_execution: execution,
            ..Task::default()
        };
        task.latency.add(20);
        task.execution.add(execution);
        task.response.add(20 + execution);
        let bounds = bound.map(|execution| {
            let bound = Bound {
                execution,
                response: Some(1000),
            };
            ("step".to_owned(), bound)
        });
        let bounds = bounds.into_iter().collect();
        Outcome {
            subject: "a test".into(),
            clock,
            core_hz: 168_000_000,
            tasks: vec![Measured::new(&task, &bounds, clock)],
            unproven: None,
        }
    }

    #[test]
    fn a_maximum_above_its_bound_is_seen_and_reported() {
        let outcome = outcome(300, Some(310), Clock::CHIP);
        assert!(outcome.is_refuted());
        assert!(outcome.table().contains("14 above"), "{}", outcome.table());
        assert_eq!(outcome.json()["is_refuted"], true);
        assert_eq!(outcome.json()["tasks"][0]["execution"]["above_bound"], 14);
    }

    #[test]
    fn the_emulators_latency_is_shown_with_its_bound_without_a_verdict() {
        let outcome = outcome(300, Some(310), Clock::EMULATOR);
        assert!(!outcome.is_refuted());
        assert!(outcome.table().contains("(810)"), "{}", outcome.table());
        assert!(outcome.notes().contains("no cycle counter"));
        let json = outcome.json();
        assert!(json["tasks"][0]["latency"]["above_bound"].is_null());
        assert_eq!(json["unit"], "instructions");
    }

    #[test]
    fn dropped_records_and_missing_bounds_are_reported() {
        let outcome = outcome(300, None, Clock::CHIP);
        assert!(!outcome.is_refuted());
        assert!(outcome.notes().contains("3 activations, 2 not recorded"));
        assert_eq!(outcome.json()["tasks"][0]["dropped"], 2);
        assert!(outcome.histograms().contains("█"));
    }
}
