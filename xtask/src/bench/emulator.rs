//! QEMU with the plugin that counts.

use std::{
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};

use super::report::Report;
use crate::{boards, cargo, ui};

/// Longest time that a program may take, in seconds of the host.
const PATIENCE: Duration = Duration::from_secs(600);

/// Builds the plugin and returns the library that QEMU loads.
pub(super) fn plugin() -> Result<PathBuf> {
    let profile = "tools";
    let mut command = cargo::cargo(&[
        "build",
        "--quiet",
        "--profile",
        profile,
        "--package",
        "cost",
    ]);
    cargo::wait(&mut command)?;
    Ok(cargo::target_dir().join(profile).join("libcost.so"))
}

/// A file for the report of the run called `name`.
pub(super) fn report_path(name: &str) -> Result<PathBuf> {
    let folder = cargo::target_dir().join("bench");
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("cannot create {}", folder.display()))?;
    Ok(folder.join(format!("{name}.json")))
}

/// The emulated board with the plugin loaded; the caller adds the serial line.
pub(super) fn command(elf: &Path, plugin: &Path, report: &Path) -> Result<Command> {
    let (_, machine) = boards::emulated()?;
    let load = format!(
        "{},elf={},out={}",
        plugin.display(),
        elf.display(),
        report.display()
    );
    let mut command = Command::new("qemu-system-arm");
    command
        .args(["-M", &machine, "-nographic", "-plugin", &load, "-kernel"])
        .arg(elf);
    Ok(command)
}

/// Runs a program that ends by semihosting, and returns what it cost.
pub(super) fn run(elf: &Path, arguments: &[String]) -> Result<Report> {
    let report = report_path("program")?;
    let _ = std::fs::remove_file(&report);
    let mut semihosting = String::from("enable=on,target=native");
    for argument in std::iter::once(elf.to_string_lossy().into_owned()).chain(arguments.to_vec()) {
        // QEMU's own escape for a comma.
        semihosting.push_str(",arg=");
        semihosting.push_str(&argument.replace(',', ",,"));
    }
    let plugin = plugin()?;
    ui::status("Counting", &elf.display().to_string());
    let mut qemu = command(elf, &plugin, &report)?
        .args(["-monitor", "none", "-serial", "null"])
        .args(["-semihosting-config", &semihosting])
        .stdin(Stdio::null())
        .spawn()
        .context("cannot start qemu-system-arm")?;
    let start = Instant::now();
    while qemu.try_wait().context("cannot wait for QEMU")?.is_none() {
        if start.elapsed() > PATIENCE {
            let _ = qemu.kill();
            let _ = qemu.wait();
            bail!("{} did not end in {} s", elf.display(), PATIENCE.as_secs());
        }
        thread::sleep(Duration::from_millis(10));
    }
    Report::read(&report)
}
