//! Checks and their outcomes: for `cargo xtask test`, and for tools that it starts as checks.
//!
//! A tool that is started with [`VARIABLE`] set is a check. The tool prints its count on standard output, or
//! [`SKIPPED`] and the reason for the omission, or the reason of a failure.

use std::{
    env,
    ffi::OsStr,
    iter,
    process::{Command, ExitCode, Stdio},
    sync::{Mutex, PoisonError},
    thread::{self, ScopedJoinHandle},
    time::{Duration, Instant},
};

use anstream::{eprintln, println};
use anyhow::{Context, Error, Result, bail};
use owo_colors::{AnsiColors, OwoColorize};

use crate::{
    cargo,
    tools::{self, Tool},
    ui,
};

/// Set for a tool that is a check of another one.
const VARIABLE: &str = "LEADSCREW_CHECK";
/// What a tool prints that has checked nothing, before the reason.
const SKIPPED: &str = "skipped: ";

/// What a check that did not fail has to say.
#[derive(Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It passed.
    Passed,
    /// It passed, with these figures.
    Counted(String),
    /// It was not made, for this reason.
    Skipped(String),
}

impl Verdict {
    /// Reads what a tool has printed.
    fn read(text: &str) -> Self {
        match text.strip_prefix(SKIPPED) {
            Some(reason) => Self::Skipped(reason.into()),
            None if text.is_empty() => Self::Passed,
            None => Self::Counted(text.into()),
        }
    }

    /// Prints it for the tool that has started this one.
    pub fn print(&self) {
        match self {
            Self::Passed => {}
            Self::Counted(figures) => println!("{figures}"),
            Self::Skipped(reason) => println!("{SKIPPED}{reason}"),
        }
    }
}

/// Whether this tool is a check.
pub fn is_check() -> bool {
    env::var_os(VARIABLE).is_some()
}

/// Makes a tool that a command starts a check.
pub fn as_check(command: &mut Command) -> &mut Command {
    command.env(VARIABLE, "1")
}

/// Prints why a check has failed, if this tool is one.
pub(crate) fn fail(error: &Error) {
    if is_check() {
        println!("{error}");
    }
}

/// Has a tool check something.
pub fn by<A: AsRef<OsStr>>(
    tool: Tool,
    arguments: impl IntoIterator<Item = A>,
    axes: u8,
) -> Result<Verdict> {
    let mut command = tools::command_for(tool, axes)?;
    verdict_of(tool, command.args(arguments))
}

/// The same with a variable of the environment.
pub fn with_variable<A: AsRef<OsStr>>(
    tool: Tool,
    arguments: impl IntoIterator<Item = A>,
    (variable, value): (&str, &str),
) -> Result<Verdict> {
    let mut command = tools::command_for(tool, cargo::axes())?;
    verdict_of(tool, command.args(arguments).env(variable, value))
}

fn verdict_of(tool: Tool, command: &mut Command) -> Result<Verdict> {
    let output = as_check(command)
        .stderr(Stdio::inherit())
        .output()
        .with_context(|| format!("cannot start {}", tool.name))?;
    let text = String::from_utf8_lossy(&output.stdout);
    match (output.status.success(), text.trim()) {
        (true, text) => Ok(Verdict::read(text)),
        (false, "") => bail!("{} has failed ({})", tool.name, output.status),
        (false, reason) => bail!("{reason}"),
    }
}

/// One check.
pub struct Check {
    /// What it is called.
    pub name: String,
    /// What it does.
    pub run: Box<dyn Fn() -> Result<Verdict> + Send>,
}

impl Check {
    /// A check.
    pub fn new(
        name: impl Into<String>,
        run: impl Fn() -> Result<Verdict> + Send + 'static,
    ) -> Self {
        Self {
            name: name.into(),
            run: Box::new(run),
        }
    }
}

/// What became of a check.
struct Outcome {
    name: String,
    took: Duration,
    result: Result<Verdict>,
}

/// Makes the checks whose names contain a text, or the one that has it as its name, some of them at the same time, or
/// lists them.
pub fn run(
    mut checks: Vec<Check>,
    only: Option<&str>,
    list: bool,
    at_once: usize,
) -> Result<ExitCode> {
    if let Some(part) = only {
        let is_whole = checks.iter().any(|check| check.name == part);
        checks.retain(|check| check.name == part || !is_whole && check.name.contains(part));
        if checks.is_empty() {
            bail!("no check is called {part:?}: see `cargo xtask test --all --list`");
        }
    }
    if list {
        for check in &checks {
            println!("{}", check.name);
        }
        return Ok(ExitCode::SUCCESS);
    }
    let outcomes = make_all(checks, at_once);
    if env::var_os(VARIABLE).is_some() {
        verdict_on(&outcomes).print();
    }
    Ok(report(&outcomes))
}

/// What checks are, made as one.
fn verdict_on(outcomes: &[Outcome]) -> Verdict {
    let count = |is_so: fn(&Outcome) -> bool| outcomes.iter().filter(|it| is_so(it)).count();
    let failed = count(|it| it.result.is_err());
    let skipped = count(|it| matches!(it.result, Ok(Verdict::Skipped(_))));
    let made = outcomes.len() - skipped;
    let figures = format!("{failed} of {made} failed, {skipped} skipped");
    if made == 0 {
        Verdict::Skipped(figures)
    } else {
        Verdict::Counted(figures)
    }
}

/// Makes checks, some of them at the same time; the outcomes are in the order of the checks.
fn make_all(checks: Vec<Check>, at_once: usize) -> Vec<Outcome> {
    let left = Mutex::new(checks.into_iter().enumerate());
    let next = || left.lock().unwrap_or_else(PoisonError::into_inner).next();
    let mut outcomes: Vec<_> = thread::scope(|scope| {
        let work = || iter::from_fn(next).map(make).collect::<Vec<_>>();
        let workers: Vec<_> = (0..at_once).map(|_| scope.spawn(work)).collect();
        let made = workers.into_iter().map(ScopedJoinHandle::join);
        made.flat_map(|made| made.expect("checks do not panic"))
            .collect()
    });
    outcomes.sort_by_key(|(index, _)| *index);
    outcomes.into_iter().map(|(_, outcome)| outcome).collect()
}

/// Makes one check.
fn make((index, check): (usize, Check)) -> (usize, Outcome) {
    ui::status("Checking", &format!("{}: {}", index + 1, check.name));
    let start = Instant::now();
    let result = (check.run)();
    let took = start.elapsed();
    if let Err(error) = &result {
        ui::error(error);
    }
    // Where a run is cut off, what it has made is known.
    let seconds = took.as_secs_f32();
    ui::status(
        "Checked",
        &format!("{}: {} ({seconds:.0} s)", index + 1, check.name),
    );
    let outcome = Outcome {
        name: check.name,
        took,
        result,
    };
    (index, outcome)
}

/// Prints the list of outcomes.
fn report(outcomes: &[Outcome]) -> ExitCode {
    eprintln!();
    for outcome in outcomes {
        let seconds = outcome.took.as_secs_f32();
        let name = &outcome.name;
        match &outcome.result {
            Ok(verdict) => {
                let (word, colour, rest) = match verdict {
                    Verdict::Passed => ("ok", AnsiColors::Green, String::new()),
                    Verdict::Counted(figures) => ("ok", AnsiColors::Green, format!(": {figures}")),
                    Verdict::Skipped(reason) => {
                        ("skipped", AnsiColors::Yellow, format!(": {reason}"))
                    }
                };
                let word = format!("{word:>12}");
                let took = format!("({seconds:.0} s)");
                eprintln!(
                    "{} {name}{rest} {}",
                    word.color(colour).bold(),
                    took.dimmed()
                );
            }
            Err(error) => eprintln!("{:>12} {name}: {error:#}", "FAILED".red().bold()),
        }
    }
    let failed = outcomes.iter().filter(|outcome| outcome.result.is_err());
    match failed.count() {
        0 => ExitCode::SUCCESS,
        count => {
            eprintln!("\n{} of {} checks failed", count, outcomes.len());
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_tool_prints_is_its_verdict() {
        for (text, verdict) in [
            ("", Verdict::Passed),
            ("12 lines", Verdict::Counted("12 lines".into())),
            ("skipped: no QEMU", Verdict::Skipped("no QEMU".into())),
        ] {
            assert_eq!(Verdict::read(text), verdict);
        }
    }

    #[test]
    fn checks_are_made_once_each_and_reported_in_order() {
        let check = |name: &str, passes: bool| {
            Check::new(name, move || {
                anyhow::ensure!(passes, "it does not");
                Ok(Verdict::Passed)
            })
        };
        let checks = (0..9).map(|index| check(&index.to_string(), index != 4));
        let outcomes = make_all(checks.collect(), 3);
        let names: Vec<_> = outcomes.iter().map(|outcome| &*outcome.name).collect();
        assert_eq!(names.concat(), "012345678");
        let failed = outcomes.iter().filter(|outcome| outcome.result.is_err());
        assert_eq!(
            failed.map(|outcome| &*outcome.name).collect::<String>(),
            "4"
        );
        assert_eq!(report(&outcomes), ExitCode::FAILURE);
        let figures = "1 of 9 failed, 0 skipped".into();
        assert_eq!(verdict_on(&outcomes), Verdict::Counted(figures));
        let skipped = || Check::new("none", || Ok(Verdict::Skipped("no npm".into())));
        let figures = "0 of 0 failed, 2 skipped".into();
        let outcomes = make_all(vec![skipped(), skipped()], 1);
        assert_eq!(verdict_on(&outcomes), Verdict::Skipped(figures));
        assert!(run(vec![check("a", true)], Some("b"), false, 1).is_err());
        let both = || vec![check("ab", false), check("a", true)];
        assert_eq!(run(both(), Some("a"), false, 1).unwrap(), ExitCode::SUCCESS);
        assert_eq!(run(both(), Some("b"), false, 1).unwrap(), ExitCode::FAILURE);
    }
}
