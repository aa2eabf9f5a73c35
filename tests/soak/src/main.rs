//! `cargo xtask soak`: random histories for the virtual machine, and rules that hold in each. `cargo xtask fuzz`:
//! random inputs. `cargo xtask test --faults` and `rehearse --faults`: who finds inserted faults.

mod action;
mod answers;
mod bench;
mod day;
mod fuzz;
mod inserted;
mod outputs;
#[path = "../../../tests/support/pulses.rs"]
mod pulses;
mod quiet;
#[path = "../../../tests/support/random_lines.rs"]
mod random_lines;
mod reports;
mod rules;
mod search;
mod setup;

use std::{process::ExitCode, time::Duration};

use anyhow::{Result, bail, ensure};
use common::options::{self, Rehearse, Soak as Options, Test, Verb};
use common::ui;
use indicatif::{HumanCount, ProgressBar};
use simulation::proven;

use quiet::panic_of;
use search::{Done, Until};

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Soak(options) => run(&options),
        Verb::Fuzz(options) => fuzz::run(&options),
        Verb::Test(Test {
            faults: Some(name),
            write,
            ..
        }) => inserted::by_checks(&name, write),
        Verb::Rehearse(Rehearse {
            faults: Some(name), ..
        }) => inserted::by_rehearsal(&name),
        other => other.refuse(),
    })
}

/// Greatest growth of the process behind the first histories, KiB.
const GROWTH_KIB: u64 = 8 * 1024;
/// The first histories: the process has what it needs then.
const FIRST: u64 = 50;

fn run(options: &Options) -> Result<ExitCode> {
    if options.day {
        return run_day(options.seed);
    }
    if options.faults {
        return inserted::by_soak(options.seed, options.seconds);
    }
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
    ensure_no_growth(memory, GROWTH_KIB)?;
    let seeded = format!("from seed {}: {}", options.seed, figures(&done));
    ui::status("Soaked", &seeded);
    Ok(ExitCode::SUCCESS)
}

/// Hours of a day, and the growth of the process in it, KiB.
const DAY_HOURS: f64 = 24.0;
const DAY_GROWTH_KIB: u64 = 512;

fn run_day(seed: u64) -> Result<ExitCode> {
    let progress = ProgressBar::new_spinner();
    let (mut memory, mut summary) = (None, String::new());
    let panic = panic_of(|| {
        day::work(seed, DAY_HOURS, proven::committed(), |worked| {
            memory = memory.or_else(resident_kib);
            summary = format!(
                "{:.1} h, {} lines, {} bytes of the operator",
                worked.seconds / 3600.0,
                HumanCount(worked.lines),
                HumanCount(worked.presses)
            );
            progress.set_message(summary.clone());
            progress.tick();
        });
    });
    progress.finish_and_clear();
    if let Some(panic) = panic {
        bail!("{panic}\nafter {summary}; again: cargo xtask soak --day --seed {seed}");
    }
    ensure_no_growth(memory, DAY_GROWTH_KIB)?;
    ui::status("Worked", &summary);
    Ok(ExitCode::SUCCESS)
}

/// Fails if the process has grown since it had so much memory.
fn ensure_no_growth(before: Option<u64>, growth_kib: u64) -> Result<()> {
    if let (Some(before), Some(after)) = (before, resident_kib()) {
        ensure!(
            after <= before + growth_kib,
            "the memory grows: {before} KiB, then {after} KiB"
        );
    }
    Ok(())
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
