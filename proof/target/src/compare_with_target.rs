//! The same programs on the host, on the chip's processor, and on the firmware: one machine.

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, Result, ensure};
use common::options::Check as Options;
use common::options::Subject as What;
use common::{cargo, check::Verdict};
use indicatif::ProgressBar;
use leadscrew::settings::StepRate;
use simulation::{figures::Figures, job_times::JobTimes, play, proven, settings::Loaded};

use crate::{bring_up, calibrate, latency, on_target, qemu};

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let verdict = match options.what {
        What::Calibration => calibrate::check().map(|()| Verdict::Passed),
        What::BringUp => bring_up::check(),
        What::Records => latency::check(),
        What::Chip => on_the_chip().map(|()| Verdict::Passed),
        What::Firmware => in_the_firmware().map(|()| Verdict::Passed),
    };
    verdict?.print();
    Ok(ExitCode::SUCCESS)
}

/// A fast machine, on which the examples step often.
const FAST: [&str; 6] = [
    "$110=5000",
    "$111=5000",
    "$112=3000",
    "$120=500",
    "$121=500",
    "$122=300",
];

/// The programs of `examples/` for any machine: the one with settings of its name needs those.
fn examples() -> Result<Vec<PathBuf>> {
    let folder = cargo::root().join("examples");
    let entries = fs::read_dir(&folder).context("there is no folder examples")?;
    let paths = entries.flatten().map(|entry| entry.path());
    let mut paths: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|ending| ending == "nc"))
        .filter(|path| !path.with_extension("settings").exists())
        .collect();
    paths.sort();
    ensure!(!paths.is_empty(), "there are no examples");
    Ok(paths)
}

/// Default settings, and fast ones, for a firmware with a proven step rate.
fn machines(step_rate: StepRate) -> Result<[Loaded; 2]> {
    let mut fast = Loaded::new(step_rate);
    for assignment in FAST {
        fast.apply(assignment)?;
    }
    Ok([Loaded::new(step_rate), fast])
}

/// Every figure of the virtual machine is the same on the host and on the emulated processor.
fn on_the_chip() -> Result<()> {
    cargo::need_qemu()?;
    for path in examples()? {
        for machine in machines(proven::committed())? {
            // Profiles of time are taken on the host alone.
            let here = Figures {
                times: JobTimes::default(),
                ..play::play(&path, &machine.settings)?
            };
            let there = on_target::play(&path, &machine)?;
            let name = path.display();
            ensure!(
                here == there,
                "{name}: {} here, {} on the chip",
                summary(&here),
                summary(&there)
            );
        }
    }
    Ok(())
}

/// The firmware gives the same answers and the same steps as the virtual machine.
fn in_the_firmware() -> Result<()> {
    cargo::need_qemu()?;
    let (board, emulator) = firmware::boards::emulated()?;
    let elf = firmware::firmware(&board)?;
    let step_rate = crate::step_rate(&elf)?;
    for path in examples()? {
        for machine in machines(step_rate)? {
            let here = play::play(&path, &machine.settings)?;
            let bar = ProgressBar::hidden();
            let there = qemu::play_file(&path, &elf, &emulator, &machine, bar)?;
            compare(&path, &here, &there)?;
        }
    }
    Ok(())
}

/// The results that must be equal although bytes arrive at other times.
fn compare(path: &Path, here: &Figures, there: &Figures) -> Result<()> {
    let name = path.display();
    ensure!(here.responses == there.responses, "{name}: other answers");
    ensure!(here.messages == there.messages, "{name}: other messages");
    ensure!(
        here.end == there.end && here.steps_axis == there.steps_axis,
        "{name}: {} in the virtual machine, {} in the firmware",
        summary(here),
        summary(there)
    );
    Ok(())
}

fn summary(figures: &Figures) -> String {
    format!(
        "{} lines, steps {:?}, at {:?}, hash {}",
        figures.lines, figures.steps_axis, figures.end.steps, figures.event_hash
    )
}
