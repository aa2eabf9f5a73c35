//! `cargo xtask bench`: what the firmware costs, in instructions and modelled cycles.

mod emulator;
mod profile;
mod report;

use std::{path::PathBuf, process::ExitCode};

use anstream::println;
use anyhow::Result;
use owo_colors::OwoColorize;

use report::Report;

use crate::cargo;

/// Count what the firmware costs on the emulated chip, in instructions and modelled cycles
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Show where the cycles go: by function and by source line
    #[arg(long)]
    profile: bool,
    /// Count another program instead, one that ends by semihosting
    #[arg(long, value_name = "FILE")]
    elf: Option<PathBuf>,
    /// Arguments of that program
    #[arg(requires = "elf")]
    arguments: Vec<String>,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    cargo::need_qemu()?;
    if let Some(elf) = &options.elf {
        let report = emulator::run(elf, &options.arguments)?;
        tasks(&report);
        if options.profile {
            println!();
            profile::print(&report, elf, None)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints what each task cost.
fn tasks(report: &Report) {
    let head = format!(
        "{:<14}{:>10}{:>12}{:>10}{:>8}{:>8}{:>14}{:>14}{:>8}",
        "task", "runs", "mean cyc.", "mean ins.", "min", "max", "cycles", "instructions", "MMIO"
    );
    println!("{}", head.bold());
    for task in &report.tasks {
        let per_run = |amount: u64| amount as f64 / task.activations.max(1) as f64;
        println!(
            "{:<14}{:>10}{:>12.1}{:>10.1}{:>8}{:>8}{:>14}{:>14}{:>8.1}",
            task.name,
            task.activations,
            per_run(task.cycles),
            per_run(task.instructions),
            task.min_cycles,
            task.max_cycles,
            task.cycles,
            task.instructions,
            per_run(task.peripheral_reads + task.peripheral_writes),
        );
    }
}
