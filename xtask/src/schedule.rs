//! `cargo xtask schedule`: proves from the firmware's machine code that every deadline is met.
//!
//! The analysis is the library `xtask/schedule`; this shows what it finds. `docs/scheduling.md`
//! explains the proof.

mod document;
mod instant;
mod page;
#[cfg(test)]
mod sample;
mod text;

pub(crate) use document::BOARD;

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anstream::{eprintln, println};
use anyhow::{Context, Result, anyhow, ensure};
use leadscrew::axis::AXES;
use owo_colors::OwoColorize;
use schedule::{Input, Report};

use crate::{boards, build, calibrate, cargo, figures, replay, test::Verdict, ui};

/// Prove from the machine code that every task meets its deadline
///
/// Builds the firmware, bounds the execution time of every task from the ELF file, and from that,
/// the priorities and `schedule.toml` its response time. Fails when a deadline can be missed, a
/// panic, recursion, an indirect call or an unbounded loop can be reached from a task with a
/// deadline, interrupts are off for too long anywhere, or the binary is not what the source says.
/// docs/scheduling.md explains the proof.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The board
    #[arg(long, value_name = "NAME", default_value = "netduino-plus-2")]
    board: String,
    /// Number of axes of the firmware, 3 to 6; without it, as many as these tools have
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(3..=6))]
    axes: Option<u8>,
    /// Analyse this program instead of building the firmware
    #[arg(long, value_name = "FILE")]
    elf: Option<PathBuf>,
    /// Step rate of the table: pulses of all axes together in a second; without it, the required
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..))]
    step_rate: Option<u32>,
    /// Baud rate of the table; without it, the firmware's
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    baud: Option<u32>,
    /// Write the report to a file, for programs
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Write the report as a page with pictures
    #[arg(long, value_name = "OUT")]
    html: Option<PathBuf>,
    /// Write the report that the documents show
    #[arg(long, conflicts_with_all = ["elf", "step_rate", "baud"])]
    write: bool,
    /// Fail when the report that the documents show is out of date
    #[arg(long, conflicts_with_all = ["elf", "step_rate", "baud", "write"])]
    check: bool,
    /// Run the firmware under a busy workload in QEMU, and compare with the proof what it executes
    #[arg(long, conflicts_with_all = ["write", "check"])]
    replay: bool,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let board = boards::named(&options.board)?;
    let axes = options.axes.unwrap_or(AXES as u8);
    let elf = match &options.elf {
        Some(elf) => elf.clone(),
        None => build::compile_for(&board, axes)?,
    };
    let report = analyse_with(&elf, &board.name, axes, options.step_rate, options.baud)?;
    print(&report);
    if let Some(path) = &options.json {
        figures::write_json(path, &report)?;
    }
    if let Some(path) = &options.html {
        let page = page::page(&report, cargo::root())?;
        fs::write(path, page).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if options.write {
        document::write(&report, &elf)?;
    }
    if options.check {
        ui::status("Checked", &document::check(&report, &elf)?);
    }
    for flaw in &report.flaws {
        eprintln!("{}", text::flaw(flaw));
    }
    let is_confirmed = !options.replay || replay::run(&board, &elf, &report)?;
    Ok(if report.flaws.is_empty() && is_confirmed {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// The report on a program with as many axes as these tools have.
pub(crate) fn analyse(
    elf: &Path,
    board: &str,
    step_rate_hz: Option<u32>,
    baud: Option<u32>,
) -> Result<Report> {
    analyse_with(elf, board, AXES as u8, step_rate_hz, baud)
}

/// The report on a program with any number of axes.
fn analyse_with(
    elf: &Path,
    board: &str,
    axes: u8,
    step_rate_hz: Option<u32>,
    baud: Option<u32>,
) -> Result<Report> {
    let input = Input {
        elf,
        root: cargo::root(),
        board,
        axes,
        step_rate_hz,
        baud,
        measured: calibrate::measured(board)?,
    };
    schedule::analyse(&input).map_err(|error| anyhow!("{error}"))
}

/// For `cargo xtask test`: the firmware that the documents show is proven, and is what they show.
pub(crate) fn check() -> Result<Verdict> {
    let (elf, report) = proven(BOARD, document::AXES)?;
    Ok(Verdict::Counted(document::check(&report, &elf)?))
}

/// For `cargo xtask test`: a firmware is proven.
pub(crate) fn prove(board: &str, axes: u8) -> Result<Verdict> {
    let (_, report) = proven(board, axes)?;
    Ok(Verdict::Counted(text::verdict(&report)))
}

/// Builds and analyses a firmware, and fails when it is not proven.
fn proven(board: &str, axes: u8) -> Result<(PathBuf, Report)> {
    let elf = build::compile_for(&boards::named(board)?, axes)?;
    let report = analyse_with(&elf, board, axes, None, None)?;
    for flaw in &report.flaws {
        eprintln!("{}", text::flaw(flaw));
    }
    ensure!(
        report.flaws.is_empty(),
        "{board} with {axes} axes: {}",
        text::verdict(&report)
    );
    Ok((elf, report))
}

/// The report in the terminal.
fn print(report: &Report) {
    let mut lines = text::heading(report).into_iter();
    if let Some(first) = lines.next() {
        println!("{}", first.bold());
    }
    for line in lines {
        println!("{line}");
    }
    println!();
    for (index, line) in text::tasks(report).lines().enumerate() {
        if index < 2 {
            println!("{}", line.bold());
        } else {
            println!("{line}");
        }
    }
    println!();
    for (name, value) in text::figures(report) {
        figures::row(name, &value);
    }
    for (tasks, source) in text::blocking(report) {
        figures::row("held up", &format!("{tasks}: {source}"));
    }
    for row in &report.requirements {
        let text = text::requirement(row);
        let text = if row.is_met {
            text
        } else {
            text.red().to_string()
        };
        figures::row("required", &text);
    }
    println!();
    if report.flaws.is_empty() {
        println!("{} {}", "proven".green().bold(), text::verdict(report));
    } else {
        println!("{} {}", "not proven".red().bold(), text::verdict(report));
    }
}
