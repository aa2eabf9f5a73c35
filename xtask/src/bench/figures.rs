//! From the reports of the runs to the figures.

use anstream::println;
use owo_colors::OwoColorize;
use serde_json::{Map, Value, json};

use super::report::{Report, Task};

/// The step interrupt's vector on the emulated board.
const STEP: &str = "TIM2";
/// The emulated board has no step timer: this handler stands for the hardware.
const STAND_IN: &str = "SysTick";
/// What runs outside handlers: initialisation and idling.
const THREAD: &str = "thread";

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

    fn sum(costs: impl Iterator<Item = Self>) -> Self {
        costs.fold(Self::default(), |sum, cost| Self {
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

    fn per(self, count: u64) -> Self {
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
}

impl Run {
    /// What the tasks chosen by `is_counted` cost for the workload without its settings.
    fn cost(&self, is_counted: impl Fn(&str) -> bool) -> Cost {
        let sum = |report: &Report| {
            let tasks = report.tasks.iter();
            let counted = tasks.filter(|task| is_counted(&task.name) && task.name != THREAD);
            Cost::sum(counted.filter(|task| task.name != STAND_IN).map(Cost::of))
        };
        sum(&self.whole).minus(sum(&self.settings))
    }

    fn step(&self) -> Option<&Task> {
        self.whole.tasks.iter().find(|task| task.name == STEP)
    }
}

/// One figure of the result.
pub(super) struct Figure {
    key: &'static str,
    meaning: &'static str,
    cost: Cost,
    /// Cycles it should not exceed.
    target: Option<f64>,
}

/// The figures, from the runs of [`super::workload`] and what each one's cost is divided by.
pub(super) fn all([one, three, lines]: [(&Run, u64); 3]) -> Vec<Figure> {
    let steps: Vec<&Task> = [one.0, three.0, lines.0]
        .map(Run::step)
        .into_iter()
        .flatten()
        .collect();
    let activations = steps.iter().map(|task| task.activations).sum::<u64>();
    let mean = Cost::sum(steps.iter().copied().map(Cost::of)).per(activations.max(1));
    let max = |of: fn(&Task) -> u64| steps.iter().copied().map(of).max().unwrap_or(0) as f64;
    let worst = Cost {
        cycles: max(|task| task.max_cycles),
        instructions: max(|task| task.max_instructions),
    };
    vec![
        Figure {
            key: "step_isr_mean_cycles",
            meaning: "step interrupt, mean of the three workloads",
            cost: mean,
            target: Some(110.0),
        },
        Figure {
            key: "step_isr_max_cycles",
            meaning: "step interrupt, worst",
            cost: worst,
            target: Some(200.0),
        },
        Figure {
            key: "cycles_per_step_1axis",
            meaning: "all tasks, 1 axis at 100 kHz, per step",
            cost: one.0.cost(|_| true).per(one.1),
            target: Some(250.0),
        },
        Figure {
            key: "cycles_per_period_3axis",
            meaning: "all tasks, 3 axes at 100, 73, 51 kHz, per 10 µs",
            cost: three.0.cost(|_| true).per(three.1),
            target: None,
        },
        Figure {
            key: "cycles_per_g1_line",
            meaning: "all but the step interrupt, per short G1 line",
            cost: lines.0.cost(|name| name != STEP).per(lines.1),
            target: Some(8000.0),
        },
    ]
}

/// Prints the figures.
pub(super) fn print(figures: &[Figure]) {
    let head = format!(
        "{:<52}{:>10}{:>14}{:>9}",
        "", "cycles", "instructions", "target"
    );
    println!("{}", head.bold());
    for figure in figures {
        let target = figure
            .target
            .map_or_else(String::new, |target| format!("{target:.0}"));
        let is_missed = figure
            .target
            .is_some_and(|target| figure.cost.cycles > target);
        let row = format!(
            "{:<52}{:>10.1}{:>14.1}{target:>9}",
            figure.meaning, figure.cost.cycles, figure.cost.instructions
        );
        if is_missed {
            println!("{row} {}", "missed".red());
        } else {
            println!("{row}");
        }
    }
}

/// The figures as JSON: each under its key, and the instructions under `…_instructions`.
pub(super) fn json(figures: &[Figure], model: &str) -> Value {
    let mut object = Map::new();
    let rounded = |value: f64| json!((value * 10.0).round() / 10.0);
    for figure in figures {
        let twin = figure
            .key
            .strip_suffix("_cycles")
            .unwrap_or(figure.key)
            .to_owned()
            + "_instructions";
        object.insert(figure.key.into(), rounded(figure.cost.cycles));
        object.insert(twin, rounded(figure.cost.instructions));
    }
    object.insert("model".into(), model.into());
    object.into()
}
