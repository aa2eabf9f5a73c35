//! `cargo xtask soak`: random histories for the virtual machine, and rules that hold in each. `cargo xtask fuzz`:
//! random inputs.

mod action;
mod bench;
mod fuzz;
#[path = "../../../tests/support/pulses.rs"]
mod pulses;
mod quiet;
#[path = "../../../tests/support/random_lines.rs"]
mod random_lines;
mod rules;
mod search;
mod setup;

use std::{process::ExitCode, time::Duration};

use anyhow::{Result, ensure};
use common::options::{self, Soak as Options, Verb};
use common::ui;
use indicatif::{HumanCount, ProgressBar};
use simulation::proven;

use search::{Done, Until};

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Soak(options) => run(&options),
        Verb::Fuzz(options) => fuzz::run(&options),
        other => other.refuse(),
    })
}

/// Greatest growth of the process behind the first histories, KiB.
const GROWTH_KIB: u64 = 8 * 1024;
/// The first histories: the process has what it needs then.
const FIRST: u64 = 50;

fn run(options: &Options) -> Result<ExitCode> {
    let until = match (options.machine_hours, options.histories) {
        (Some(hours), _) => Until::MachineHours(hours),
        (_, Some(count)) => Until::Histories(count),
        _ => Until::Elapsed(Duration::from_secs(options.seconds)),
    };
    let progress = ProgressBar::new_spinner();
    let mut memory = None;
    let searched = search::search(options.seed, until, proven::committed(), None, |done| {
        if done.histories == FIRST {
            memory = resident_kib();
        }
        progress.set_message(figures(done));
        progress.tick();
    });
    progress.finish_and_clear();
    let done = match searched {
        Ok(done) => done,
        Err(broken) => {
            anstream::println!("{broken}");
            ui::status(
                "Broken",
                &format!(
                    "again: cargo xtask soak --seed {} --histories 1",
                    broken.seed
                ),
            );
            return Ok(ExitCode::FAILURE);
        }
    };
    if let (Some(before), Some(after)) = (memory, resident_kib()) {
        ensure!(
            after <= before + GROWTH_KIB,
            "the memory grows: {before} KiB, then {after} KiB"
        );
    }
    ui::status("Soaked", &figures(&done));
    Ok(ExitCode::SUCCESS)
}

fn figures(done: &Done) -> String {
    format!(
        "{} histories, {} actions, {:.2} h of the machine: no rule is broken",
        HumanCount(done.histories),
        HumanCount(done.actions),
        done.machine_seconds / 3600.0
    )
}

/// Memory of this process in use, KiB; `None` where nobody says.
fn resident_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}
