//! The firmware's tasks: their names, from the source, and what each cost.

use anstream::println;
use anyhow::{Result, ensure};
use owo_colors::OwoColorize;

use super::report::Report;

/// The emulated board has no step timer and no watchdog: these handlers stand for the hardware.
pub(super) const STAND_INS: [&str; 2] = ["TIM2", "TIM3"];
/// Code outside of handlers: initialisation and idling.
pub(super) const THREAD: &str = "thread";
/// The step interrupt.
pub(super) const STEP: &str = "step";
/// The task that computes the times of the steps.
pub(super) const PREPARE: &str = "prepare";

/// Vectors and the tasks on them, from the RTIC application's source.
pub(super) struct Names(Vec<(String, String)>);

impl Names {
    /// Finds `binds = VECTOR … fn task(`, and the software tasks of a sole dispatcher.
    pub(super) fn of(source: &str) -> Result<Self> {
        let identifier = |text: &str| -> String {
            let letters = text.trim_start().chars();
            letters
                .take_while(|letter| letter.is_alphanumeric() || *letter == '_')
                .collect()
        };
        let mut names = Vec::new();
        for part in source.split("binds =").skip(1) {
            if let Some((_, function)) = part.split_once(" fn ") {
                names.push((identifier(part), identifier(function)));
            }
        }
        if let Some((_, rest)) = source.split_once("dispatchers = [") {
            let dispatchers = rest.split(']').next().unwrap_or_default();
            if !dispatchers.contains(',') {
                let software = source.split("async fn ").skip(1).map(identifier);
                // Functions that are no tasks take no context.
                let is_task = |name: &String| source.contains(&format!("{name}::Context"));
                let software: Vec<String> = software.filter(is_task).collect();
                names.push((identifier(dispatchers), software.join(", ")));
            }
        }
        ensure!(
            names.iter().any(|(_, task)| task == STEP),
            "the application has no task {STEP:?}"
        );
        Ok(Self(names))
    }

    /// Replaces the names of handlers by those of tasks.
    pub(super) fn apply(&self, report: &mut Report) {
        for task in &mut report.tasks {
            if let Some((_, name)) = self.0.iter().find(|(vector, _)| *vector == task.name) {
                task.name.clone_from(name);
            }
        }
    }
}

/// Prints what each task cost.
pub(super) fn print(report: &Report) {
    let head = format!(
        "{:<20}{:>9}{:>12}{:>12}{:>8}{:>8}{:>8}{:>12}{:>8}",
        "task", "runs", "cyc./run", "ins./run", "min", "99.9 %", "max", "cycles", "MMIO"
    );
    println!("{}", head.bold());
    for (index, task) in report.tasks.iter().enumerate() {
        // Initialisation and idling say nothing, unless they are the program.
        let is_idle = index == 0 && report.tasks.len() > 1;
        if is_idle || STAND_INS.contains(&task.name.as_str()) {
            continue;
        }
        let per_run = |amount: u64| amount as f64 / task.activations.max(1) as f64;
        println!(
            "{:<20}{:>9}{:>12.1}{:>12.1}{:>8}{:>8}{:>8}{:>12}{:>8.1}",
            task.name,
            task.activations,
            per_run(task.cycles),
            per_run(task.instructions),
            task.min_cycles,
            task.all_but_one_in(1000),
            task.max_cycles,
            task.cycles,
            per_run(task.peripheral_reads + task.peripheral_writes),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_from_the_application() {
        let source = "
            #[rtic::app(device = pac, dispatchers = [I2C2_EV])]
            #[task(binds = SysTick, priority = 4)]
            fn step(cx: step::Context) {}
            #[task(
                binds = I2C3_EV, priority = 2,
            )]
            fn prepare(mut cx: prepare::Context) {}
            #[task(priority = 1)]
            async fn interpret(mut cx: interpret::Context) -> ! {}
            #[task(priority = 1)]
            async fn report(mut cx: report::Context) -> ! {}
            async fn released() {}
        ";
        let pair = |vector: &str, task: &str| (vector.to_owned(), task.to_owned());
        let expected = [
            pair("SysTick", "step"),
            pair("I2C3_EV", "prepare"),
            pair("I2C2_EV", "interpret, report"),
        ];
        assert_eq!(Names::of(source).unwrap().0, expected);
    }

    #[test]
    fn an_application_without_steps_is_refused() {
        assert!(Names::of("#[task(binds = SysTick)] fn tick() {}").is_err());
    }
}
