//! `cargo xtask schedule --replay`: what the firmware does on the emulated chip, against the proof.
//!
//! The firmware runs in QEMU under a busy workload, and a plugin (`xtask/cost`, which hands on to
//! `schedule::replay`) follows every instruction of the tasks that have deadlines: the way that it
//! takes must be one of the static graph, loops may not exceed their bounds, accesses must go where
//! they were predicted to. What each run costs by the cycle table of the analysis is compared with
//! the bound. QEMU knows no time: this checks paths, bounds and regions, not the table.

mod driver;
mod verdict;
mod workload;

use std::{
    fs,
    path::{Path, PathBuf},
};

use anstream::println;
use anyhow::{Context, Result};
use owo_colors::OwoColorize;
use schedule::{Config, Report, replay::Summary};

use self::{driver::Driver, verdict::Verdict};
use crate::{
    boards::{self, Board},
    build, cargo, ui,
};

/// Follows a firmware of which `report` was made; whether nothing contradicts it.
pub(crate) fn run(board: &Board, elf: &Path, report: &Report) -> Result<bool> {
    cargo::need_qemu()?;
    let (emulated, machine) = boards::emulated()?;
    anyhow::ensure!(
        board.name == emulated.name,
        "QEMU does not emulate {}, only {}",
        board.name,
        emulated.name
    );
    let elf = build::as_if_proven(elf, report.step_rate_hz)?;
    let plugin = plugin()?;
    let out = cargo::target_dir().join("replay.json");
    let _ = fs::remove_file(&out);
    let load = [
        plugin.to_string_lossy().replace(',', ",,"),
        argument("elf", &elf.to_string_lossy()),
        argument("root", &cargo::root().to_string_lossy()),
        argument("board", &board.name),
        argument("axes", &report.axes.to_string()),
        argument("rate", &report.step_rate_hz.to_string()),
        argument("baud", &report.baud.to_string()),
        argument("out", &out.to_string_lossy()),
    ];
    let mut driver = Driver::boot(&elf, &machine, &["-plugin", &load.join(",")])?;
    let played = workload::run(&mut driver, report.step_rate_hz);
    let counts = driver.counts();
    driver.quit()?;
    let text = fs::read_to_string(&out).context("the plugin has left no report")?;
    let summary: Summary = serde_json::from_str(&text).context("the plugin's report is damaged")?;
    let verdict = Verdict::of(report, &summary, &limits()?);
    println!();
    verdict::print(&verdict, &summary);
    println!("{counts}; coverage in {}", out.display().dimmed());
    played?;
    Ok(verdict.is_passed())
}

/// What `schedule.toml` asks of a replay.
fn limits() -> Result<schedule::Replay> {
    let path = cargo::root().join("schedule.toml");
    let text =
        fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let config = Config::parse(&text).map_err(anyhow::Error::msg)?;
    Ok(config.replay)
}

/// Builds the plugin.
fn plugin() -> Result<PathBuf> {
    const PROFILE: &str = "tools";
    let build = [
        "build",
        "--quiet",
        "--profile",
        PROFILE,
        "--package",
        "cost",
    ];
    cargo::wait(&mut cargo::cargo(&build))?;
    ui::status(
        "Replaying",
        "the firmware in QEMU, every instruction followed",
    );
    Ok(cargo::target_dir().join(PROFILE).join("libcost.so"))
}

/// An argument of the plugin, with QEMU's own escape for a comma.
fn argument(key: &str, value: &str) -> String {
    format!("{key}={}", value.replace(',', ",,"))
}
