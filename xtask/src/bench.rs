//! `cargo xtask bench`: what the firmware costs, in instructions and modelled cycles.
//!
//! The firmware itself runs in QEMU, is fed over its serial line, and a plugin (`xtask/cost`)
//! charges every executed instruction to the exception handler it belongs to. A task is a handler;
//! what preempts it is not in its cost, and 24 cycles for entry and exit are. Not counted: what
//! runs outside handlers (initialisation, idling), the handler that stands for the step timer, and
//! what the workload's settings cost, which a run without the program tells.

mod emulator;
mod figures;
mod profile;
mod report;
mod sender;
mod workload;

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anstream::println;
use anyhow::{Context, Result};
use owo_colors::OwoColorize;

use emulator::Emulator;
use figures::Run;
use report::Report;
use workload::Workload;

use crate::{boards, build, ui};

/// Count what the firmware costs on the emulated chip, in instructions and modelled cycles
///
/// Streams three workloads to the firmware under QEMU: one axis at 100 kHz, three axes at 100, 73
/// and 51 kHz, and short G1 lines. Counts are exact and repeat; cycles are those of the table that
/// `model` in the JSON output names.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Write the figures to a file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Show where the cycles go: by task, function and source line
    #[arg(long)]
    profile: bool,
    /// Count another program instead: one that ends by semihosting
    #[arg(long, value_name = "FILE", conflicts_with = "json")]
    elf: Option<PathBuf>,
    /// Arguments of that program
    #[arg(requires = "elf")]
    arguments: Vec<String>,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let emulator = Emulator::new()?;
    match &options.elf {
        Some(elf) => program(&emulator, elf, options)?,
        None => firmware(&emulator, options)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// Counts a program that ends by itself.
fn program(emulator: &Emulator, elf: &Path, options: &Options) -> Result<()> {
    let report = emulator.run(elf, &options.arguments)?;
    tasks(&report);
    if options.profile {
        profile::print(&report, elf)?;
    }
    Ok(())
}

/// Counts the firmware and prints its figures.
fn firmware(emulator: &Emulator, options: &Options) -> Result<()> {
    let (board, _) = boards::emulated()?;
    let elf = build::firmware(&board)?;
    let count = |workload: &Workload| {
        ui::status("Counting", workload.name);
        let run = Run {
            settings: emulator.stream(&elf, workload, false)?,
            whole: emulator.stream(&elf, workload, true)?,
        };
        println!("\n{}", workload.name.bold());
        tasks(&run.whole);
        if options.profile {
            profile::print(&run.whole, &elf)?;
        }
        anyhow::Ok((run, workload.count))
    };
    let one = count(&workload::one_axis())?;
    let three = count(&workload::three_axes())?;
    let lines = count(&workload::short_lines())?;
    let figures = figures::all([&one, &three, &lines].map(|(run, count)| (run, *count)));
    println!();
    figures::print(&figures);
    if let Some(path) = &options.json {
        let json = figures::json(&figures, &one.0.whole.model);
        fs::write(path, format!("{json:#}\n"))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Prints what each task cost.
fn tasks(report: &Report) {
    let head = format!(
        "{:<14}{:>10}{:>12}{:>12}{:>8}{:>8}{:>8}{:>14}{:>14}{:>8}",
        "task",
        "runs",
        "cyc./run",
        "ins./run",
        "min",
        "99.9 %",
        "max",
        "cycles",
        "instructions",
        "MMIO"
    );
    println!("{}", head.bold());
    for task in &report.tasks {
        let per_run = |amount: u64| amount as f64 / task.activations.max(1) as f64;
        println!(
            "{:<14}{:>10}{:>12.1}{:>12.1}{:>8}{:>8}{:>8}{:>14}{:>14}{:>8.1}",
            task.name,
            task.activations,
            per_run(task.cycles),
            per_run(task.instructions),
            task.min_cycles,
            task.all_but_one_in(1000),
            task.max_cycles,
            task.cycles,
            task.instructions,
            per_run(task.peripheral_reads + task.peripheral_writes),
        );
    }
}
