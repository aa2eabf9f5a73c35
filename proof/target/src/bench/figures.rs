//! From the reports of the runs to the figures.

use anstream::println;
use anyhow::{Context, Result};
use owo_colors::OwoColorize;
use serde_json::{Map, Value, json};

use super::{
    report::{Report, Task},
    tasks::{PREPARE, STAND_INS, STEP, THREAD},
};

/// Instructions and cycles, of one run or of the mean one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Cost {
    pub(super) cycles: f64,
    pub(super) instructions: f64,
}

impl Cost {
    fn of(task: &Task) -> Self {
        Self {
            cycles: task.cycles as f64,
            instructions: task.instructions as f64,
        }
    }

    fn sum(costs: impl IntoIterator<Item = Self>) -> Self {
        costs.into_iter().fold(Self::default(), |sum, cost| Self {
            cycles: sum.cycles + cost.cycles,
            instructions: sum.instructions + cost.instructions,
        })
    }

    fn minus(self, other: Self) -> Self {
        Self {
            cycles: self.cycles - other.cycles,
            instructions: self.instructions - other.instructions,
        }
    }

    pub(super) fn per(self, count: u64) -> Self {
        Self {
            cycles: self.cycles / count as f64,
            instructions: self.instructions / count as f64,
        }
    }
}

/// Reports of a workload, and of its settings alone.
pub(super) struct Run {
    pub(super) whole: Report,
    pub(super) settings: Report,
    /// The cost of computing the times of the steps, within the whole.
    pub(super) step_times: Cost,
    /// The divisor of the cost.
    pub(super) count: u64,
}

impl Run {
    /// The cost of each task for the workload without its settings, per step, period or line.
    fn costs(&self) -> Vec<(&str, Cost)> {
        let cost = |report: &Report, name: &str| {
            let found = report.tasks.iter().find(|task| task.name == name);
            found.map(Cost::of).unwrap_or_default()
        };
        let names = self.whole.tasks.iter().map(|task| task.name.as_str());
        names
            .filter(|name| *name != THREAD && !STAND_INS.contains(name))
            .map(|name| {
                let spent = cost(&self.whole, name).minus(cost(&self.settings, name));
                (name, spent.per(self.count))
            })
            .collect()
    }

    fn step(&self) -> Result<&Task> {
        let mut tasks = self.whole.tasks.iter();
        let step = tasks.find(|task| task.name == STEP);
        step.context("the step interrupt never ran")
    }
}

/// One figure of the result.
pub(super) struct Figure {
    pub(super) key: &'static str,
    pub(super) meaning: &'static str,
    pub(super) cost: Cost,
    /// Cycles it should not exceed.
    pub(super) target: Option<f64>,
    /// Its terms, by task.
    pub(super) parts: Vec<(String, Cost)>,
    /// The part for the times of the steps.
    pub(super) step_times: Option<Cost>,
}

impl Figure {
    fn new(key: &'static str, meaning: &'static str, target: Option<f64>, cost: Cost) -> Self {
        Self {
            key,
            meaning,
            cost,
            target,
            parts: Vec::new(),
            step_times: None,
        }
    }

    /// The sum over the tasks that `is_counted` chooses.
    fn sum(
        key: &'static str,
        meaning: &'static str,
        target: Option<f64>,
        run: &Run,
        is_counted: fn(&str) -> bool,
    ) -> Self {
        let mut parts = run.costs();
        parts.retain(|(name, _)| is_counted(name));
        parts.sort_by(|(_, a), (_, b)| b.cycles.total_cmp(&a.cycles));
        let cost = Cost::sum(parts.iter().map(|&(_, cost)| cost));
        let parts = parts
            .into_iter()
            .map(|(name, cost)| (name.to_owned(), cost));
        Self {
            parts: parts.collect(),
            step_times: Some(run.step_times.per(run.count)),
            ..Self::new(key, meaning, target, cost)
        }
    }
}

impl Figure {
    /// The same without the times of the steps.
    fn without_step_times(mut self) -> Self {
        let step_times = self.step_times.unwrap_or_default();
        self.cost = self.cost.minus(step_times);
        if let Some((_, prepare)) = self.parts.iter_mut().find(|(name, _)| name == PREPARE) {
            *prepare = prepare.minus(step_times);
        }
        self
    }
}

/// Parts of what a line costs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Parts {
    /// From a short line without blanks to a command.
    pub(super) parse: Cost,
    /// The backward pass for a block that re-plans 100.
    pub(super) pass: Cost,
}

/// The figures, from the runs with one axis, with three axes, of short lines, and of lines of 10 steps,
/// and from parts of those and others.
pub(super) fn all([one, three, lines, raster]: [&Run; 4], parts: Parts) -> Result<Vec<Figure>> {
    let steps = [one.step()?, three.step()?, lines.step()?];
    let activations = steps.map(|task| task.activations).into_iter().sum();
    let mean = Cost::sum(steps.map(Cost::of)).per(activations);
    let max = |of: fn(&Task) -> u64| steps.map(of).into_iter().max().unwrap_or(0) as f64;
    let worst = Cost {
        cycles: max(|task| task.max_cycles),
        instructions: max(|task| task.max_instructions),
    };
    let steps = [
        Figure::new(
            "step_isr_mean_cycles",
            "step interrupt, mean of the three workloads",
            Some(110.0),
            mean,
        ),
        Figure::new(
            "step_isr_max_cycles",
            "step interrupt, worst",
            Some(200.0),
            worst,
        ),
        Figure::sum(
            "cycles_per_step_1axis",
            "all tasks, 1 axis at 100 kHz, per step",
            Some(250.0),
            one,
            |_| true,
        ),
        Figure::sum(
            "cycles_per_period_3axis",
            "all tasks, 3 axes at 100, 73, 51 kHz, per 10 µs",
            Some(420.0),
            three,
            |_| true,
        ),
    ];
    Ok(steps
        .into_iter()
        .chain(of_lines(lines, raster, parts))
        .collect())
}

/// The figures of lines.
fn of_lines(lines: &Run, raster: &Run, parts: Parts) -> [Figure; 4] {
    [
        // The times of a line's steps go with its steps, and are in the figures per step.
        Figure::sum(
            "cycles_per_g1_line",
            "all but steps and their times, per short G1 line",
            Some(8000.0),
            lines,
            |name| name != STEP,
        )
        .without_step_times(),
        Figure::new(
            "cycles_parse_g1_line",
            "    parsing: words, checks and the modal state",
            Some(1200.0),
            parts.parse,
        ),
        Figure::sum(
            "cycles_per_raster_line",
            "all tasks, per line of 10 steps",
            Some(168.0e6 / 5000.0),
            raster,
            |_| true,
        ),
        Figure::new(
            "cycles_replan_100_blocks",
            "backward pass, per new block that re-plans 100",
            Some(3000.0),
            parts.pass,
        ),
    ]
}

/// Prints the figures.
pub(super) fn print(figures: &[Figure]) {
    let head = format!(
        "{:<50}{:>10}{:>14}{:>9}",
        "", "cycles", "instructions", "target"
    );
    println!("{}", head.bold());
    for figure in figures {
        let target = figure
            .target
            .map_or_else(String::new, |target| format!("{target:.0}"));
        let row = row(figure.meaning, figure.cost);
        match figure.target {
            Some(most) if figure.cost.cycles > most => {
                println!("{row}{target:>9} {}", "missed".red());
            }
            _ => println!("{row}{target:>9}"),
        }
        for (name, cost) in &figure.parts {
            println!("{}", self::row(&format!("    {name}"), *cost).dimmed());
        }
        if let Some(cost) = figure.step_times {
            println!("{}", self::row("    the times of the steps", cost).dimmed());
        }
    }
}

fn row(what: &str, cost: Cost) -> String {
    format!("{what:<50}{:>10.1}{:>14.1}", cost.cycles, cost.instructions)
}

/// The figures as JSON: each under its key, and the instructions under `…_instructions`.
pub(super) fn json(figures: &[Figure], interval_errors: [f64; 3], model: &str) -> Value {
    let mut object = Map::new();
    for figure in figures {
        let stem = figure.key.strip_suffix("_cycles").unwrap_or(figure.key);
        object.insert(figure.key.into(), rounded(figure.cost.cycles));
        object.insert(
            format!("{stem}_instructions"),
            rounded(figure.cost.instructions),
        );
        if let Some(cost) = figure.step_times {
            object.insert(format!("{stem}_step_times"), rounded(cost.cycles));
        }
        if !figure.parts.is_empty() {
            let parts = figure.parts.iter();
            let parts = parts.map(|(name, cost)| (name.clone(), rounded(cost.cycles)));
            object.insert(format!("{stem}_by_task"), Value::Object(parts.collect()));
        }
    }
    for (axis, error) in ["x", "y", "z"].into_iter().zip(interval_errors) {
        object.insert(format!("interval_error_3axis_{axis}"), json!(error));
    }
    object.insert("model".into(), model.into());
    object.into()
}

/// To a tenth.
fn rounded(value: f64) -> Value {
    json!((value * 10.0).round() / 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(tasks: &[(&str, u64, u64)]) -> Report {
        let tasks: Vec<Value> = tasks
            .iter()
            .map(|&(name, activations, cycles)| {
                json!({
                    "name": name, "activations": activations, "cycles": cycles,
                    "instructions": cycles / 2, "min_cycles": 50, "max_cycles": 70,
                    "max_instructions": 35, "peripheral_reads": 0, "peripheral_writes": 0,
                    "histogram": [],
                })
            })
            .collect();
        serde_json::from_value(json!({
            "model": "", "cycles": 0, "tasks": tasks, "sites": [], "functions": [],
            "unexplained": 0, "unknown": [],
        }))
        .unwrap()
    }

    fn parts() -> Parts {
        let cost = |cycles| Cost {
            cycles,
            instructions: 0.5 * cycles,
        };
        Parts {
            parse: cost(20.0),
            pass: cost(30.0),
        }
    }

    fn run(count: u64) -> Run {
        Run {
            whole: report(&[
                ("thread", 1, 9999),
                ("TIM2", 9, 999),
                ("step", 10, 600),
                ("prepare", 2, 500),
            ]),
            settings: report(&[("thread", 1, 99), ("prepare", 1, 100)]),
            step_times: Cost {
                cycles: 200.0,
                instructions: 100.0,
            },
            count,
        }
    }

    #[test]
    fn idling_settings_and_the_stand_in_are_not_counted() {
        let [one, three, lines, raster] = [10, 20, 4, 5].map(run);
        let figures = all([&one, &three, &lines, &raster], parts()).unwrap();
        let cycles: Vec<f64> = figures.iter().map(|figure| figure.cost.cycles).collect();
        assert_eq!(cycles, [60.0, 70.0, 100.0, 50.0, 50.0, 20.0, 200.0, 30.0]);
    }

    #[test]
    fn every_figure_has_its_instructions() {
        let [one, three, lines, raster] = [10, 20, 4, 5].map(run);
        let json = json(
            &all([&one, &three, &lines, &raster], parts()).unwrap(),
            [0.0, 0.25, 0.5],
            "table",
        );
        assert_eq!(json["step_isr_mean_cycles"], 60.0);
        assert_eq!(json["step_isr_mean_instructions"], 30.0);
        assert_eq!(json["step_isr_max_instructions"], 35.0);
        assert_eq!(json["cycles_per_step_1axis_instructions"], 50.0);
        assert_eq!(json["cycles_per_period_3axis_instructions"], 25.0);
        assert_eq!(json["cycles_per_g1_line"], 50.0);
        assert_eq!(json["cycles_per_g1_line_instructions"], 25.0);
        assert_eq!(json["cycles_per_g1_line_step_times"], 50.0);
        assert_eq!(json["cycles_per_g1_line_by_task"]["prepare"], 50.0);
        assert_eq!(json["cycles_parse_g1_line"], 20.0);
        assert_eq!(json["cycles_per_raster_line"], 200.0);
        assert_eq!(json["cycles_replan_100_blocks_instructions"], 15.0);
        assert_eq!(json["interval_error_3axis_y"], 0.25);
        assert_eq!(json["model"], "table");
    }

    #[test]
    fn a_firmware_that_never_steps_has_no_figures() {
        let mut one = run(1);
        one.whole.tasks.retain(|task| task.name != "step");
        assert!(all([&one, &run(1), &run(1), &run(1)], parts()).is_err());
    }
}
