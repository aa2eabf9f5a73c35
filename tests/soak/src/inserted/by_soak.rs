//! `cargo xtask soak --faults`: which faults a soak of a minute finds.

use std::{
    process::{Command, ExitCode, Stdio},
    time::Instant,
};

use anyhow::{Context, Result, ensure};
use common::ui;

use super::{Sources, faults, is_found};

/// The table of faults.
pub(super) const TABLE: &str = "tests/soak_faults.toml";

/// Looks for each fault.
pub(crate) fn run(seed: u64, seconds: u64) -> Result<ExitCode> {
    let copy = Sources::new();
    let mut missed = Vec::new();
    for fault in faults(TABLE)? {
        copy.insert(&fault)?;
        copy.build(&["build", "--package", "soak"])
            .with_context(|| fault.name.clone())?;
        let start = Instant::now();
        let (seed, seconds) = (seed.to_string(), seconds.to_string());
        let status = Command::new(copy.target.join("debug/soak"))
            .args(["soak", "--seed", &seed, "--seconds", &seconds])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()?;
        let elapsed = start.elapsed().as_secs_f32();
        if is_found(status).with_context(|| fault.name.clone())? {
            ui::status("Found", &format!("{}, in {elapsed:.1} s", fault.name));
        } else {
            ui::status("Missed", &fault.name);
            missed.push(fault.name);
        }
    }
    copy.restore()?;
    ensure!(missed.is_empty(), "not found: {}", missed.join(", "));
    Ok(ExitCode::SUCCESS)
}
