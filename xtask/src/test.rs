//! `cargo xtask test`: everything that can be tested without hardware.

use std::{
    fs, iter,
    process::ExitCode,
    sync::{Mutex, PoisonError},
    thread::{self, ScopedJoinHandle},
    time::{Duration, Instant},
};

use anstream::{eprintln, println};
use anyhow::{Result, bail};
use owo_colors::{AnsiColors, OwoColorize};

use crate::{
    agree,
    boards::{self, Board},
    build, calibrate,
    cargo::{self, cargo, for_board, wait},
    clients, docs, latency, proof, schedule, ui,
};

/// Test everything that needs no hardware
///
/// Formatting, lints, host tests with three, four and six axes, the firmware of every board and the
/// proof of its timing, tests on the emulated processor, and the firmware over its serial line. Goes on after a failure and
/// lists what failed. Asks rustup for what rustup can give.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Only the checks whose name contains this
    #[arg(value_name = "NAME")]
    only: Option<String>,
    /// List the checks and do nothing
    #[arg(long)]
    list: bool,
    /// Instead, drive sender programs at the simulator and at the firmware: gets them with pip and
    /// npm, and skips what cannot be had
    #[arg(long)]
    clients: bool,
}

/// What a check that did not fail has to say.
pub(crate) enum Verdict {
    /// It passed.
    Passed,
    /// It passed, with these figures.
    Counted(String),
    /// It was not made, for this reason.
    Skipped(String),
}

/// One check.
struct Check {
    name: String,
    run: Box<dyn Fn() -> Result<Verdict> + Send>,
}

impl Check {
    fn new(name: impl Into<String>, run: impl Fn() -> Result<()> + Send + 'static) -> Self {
        Self {
            name: name.into(),
            run: Box::new(move || run().map(|()| Verdict::Passed)),
        }
    }
}

/// What became of a check.
struct Outcome {
    name: String,
    took: Duration,
    result: Result<Verdict>,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let mut checks = if options.clients {
        with_clients()
    } else {
        checks()?
    };
    if let Some(part) = &options.only {
        checks.retain(|check| check.name.contains(part.as_str()));
        if checks.is_empty() {
            bail!("no check is called {part:?}: see `cargo xtask test --list`");
        }
    }
    if options.list {
        for check in &checks {
            println!("{}", check.name);
        }
        return Ok(ExitCode::SUCCESS);
    }
    // Senders wait most of the time.
    let at_once = if options.clients { 4 } else { 1 };
    Ok(report(&make_all(checks, at_once)))
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
    if let Err(error) = &result {
        ui::error(error);
    }
    let outcome = Outcome {
        name: check.name,
        took: start.elapsed(),
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
            Err(error) => eprintln!("{:>12} {name}: {}", "FAILED".red().bold(), error),
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

/// Every check, the quick ones first.
fn checks() -> Result<Vec<Check>> {
    let boards = boards::all()?;
    let mut checks = vec![
        Check::new("formatting", || {
            cargo::need_component("fmt", "rustfmt")?;
            wait(&mut cargo(&["fmt", "--all", "--check"]))
        }),
        Check::new("documents", docs::check),
        Check::new("lints, host", || {
            cargo::need_component("clippy", "clippy")?;
            wait(cargo(&["clippy", "--workspace", "--all-targets"]).args(["--", "-Dwarnings"]))
        }),
        Check::new("host tests", || {
            wait(&mut cargo(&["test", "--workspace", "--no-fail-fast"]))
        }),
    ];
    checks.push(Check::new("a day in virtual time", || {
        wait(&mut cargo(&[
            "test",
            "--profile",
            "tools",
            "--test",
            "endurance",
        ]))
    }));
    for axes in ["axes-4", "axes-6"] {
        checks.push(Check::new(format!("host tests, {axes}"), move || {
            wait(cargo(&["test", "--no-fail-fast", "--lib", "--tests"]).args(["--features", axes]))
        }));
    }
    for board in boards.clone() {
        checks.push(Check::new(format!("lints, {}", board.name), move || {
            lint(&board)
        }));
    }
    let proofs = proofs(&boards);
    for board in boards {
        checks.push(Check::new(format!("firmware, {}", board.name), move || {
            build::traced(&board)?;
            build::firmware(&board).map(drop)
        }));
    }
    checks.extend(proofs);
    checks.push(Check::new("tests on the target", on_target));
    checks.push(Check::new(
        "calibration without a counter",
        calibrate::check,
    ));
    checks.push(Check::new("firmware over its serial line", over_serial));
    checks.push(Check {
        name: "records of activations".into(),
        run: Box::new(latency::check),
    });
    checks.push(Check::new("the same on the chip", agree::on_the_chip));
    checks.push(Check::new(
        "the same in the firmware",
        agree::in_the_firmware,
    ));
    Ok(checks)
}

/// The proofs that every deadline is met, on every board.
fn proofs(boards: &[Board]) -> Vec<Check> {
    let shown = Check {
        name: "the proof that the documents show".into(),
        run: Box::new(schedule::check),
    };
    // The documents show three axes of this board.
    let others = boards.iter().map(|board| {
        let board = board.name.clone();
        let axes = if board == schedule::BOARD { 4 } else { 3 };
        Check {
            name: format!("the proof, {board}, {axes} axes"),
            run: Box::new(move || schedule::prove(&board, axes)),
        }
    });
    iter::once(shown).chain(others).collect()
}

/// Every sender program at every machine.
fn with_clients() -> Vec<Check> {
    let checks = clients::all().map(|(name, run)| Check {
        name,
        run: Box::new(run),
    });
    checks.collect()
}

/// Whether the project has tests whose file name starts so.
fn has_tests(prefix: &str) -> bool {
    let files = fs::read_dir(cargo::root().join("tests"));
    files.into_iter().flatten().flatten().any(|file| {
        let name = file.file_name();
        name.to_string_lossy().starts_with(prefix)
    })
}

/// Clippy over what is compiled for a board.
fn lint(board: &Board) -> Result<()> {
    cargo::need_component("clippy", "clippy")?;
    cargo::need_target()?;
    let mut command = cargo(&["clippy", "--lib", "--bins"]);
    if has_tests("target_") {
        command.args(["--test", "target_*"]);
    }
    wait(command.args(for_board(board)).args(["--", "-Dwarnings"]))?;
    let feature = if board.qemu.is_some() {
        "trace-emulated"
    } else {
        "trace"
    };
    let mut traced = cargo(&["clippy", "--bins", "--features", feature]);
    wait(traced.args(for_board(board)).args(["--", "-Dwarnings"]))
}

/// The tests that run on the emulated processor.
fn on_target() -> Result<()> {
    if !has_tests("target_") {
        bail!("there are no tests/target_*.rs");
    }
    cargo::need_qemu()?;
    cargo::need_target()?;
    let (board, _) = boards::emulated()?;
    // Other tests are the host's, and do not compile for the target.
    let mut command = cargo(&["test", "--release", "--no-fail-fast", "--test", "target_*"]);
    wait(command.args(for_board(&board)))
}

/// The firmware in QEMU, driven as a sender drives it.
fn over_serial() -> Result<()> {
    cargo::need_qemu()?;
    let (board, _) = boards::emulated()?;
    let elf = build::firmware(&board)?;
    let step_rate = proof::read(&elf)?.in_image();
    let mut command = cargo(&["test", "--test", "firmware"]);
    command.env("FIRMWARE_STEP_RATE", step_rate.to_string());
    command.env("SLOW_FIRMWARE_ELF", build::as_if_proven(&elf, 20_000)?);
    command.env("UNPROVEN_FIRMWARE_ELF", build::as_if_proven(&elf, 0)?);
    wait(command.env("FIRMWARE_ELF", elf))
}
