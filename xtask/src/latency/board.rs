//! A board: a probe reads it while it runs, and a sender may stream to its serial port.

use std::process::ExitCode;

use anyhow::{Context, Result};

use super::Options;
#[cfg(not(feature = "flash"))]
use super::outcome::Outcome;
use crate::{boards, flash};

/// Runs this command again in an xtask that has probe-rs.
pub(super) fn again(name: &str, options: &Options) -> Result<ExitCode> {
    let board = boards::named(name)?;
    let text = |path: &std::path::Path| -> Result<String> {
        let path = std::path::absolute(path).context("there is no such path")?;
        Ok(path.to_string_lossy().into_owned())
    };
    let mut verb = vec!["latency".to_owned(), "--board".into(), board.name];
    if let Some(file) = &options.file {
        verb.push(text(file)?);
    }
    if let Some(seconds) = options.seconds {
        verb.extend(["--seconds".into(), seconds.to_string()]);
    }
    if let Some(port) = &options.port {
        verb.extend(["--port".into(), text(port)?]);
    }
    if let Some(probe) = &options.probe {
        verb.extend(["--probe".into(), probe.clone()]);
    }
    for set in &options.set {
        verb.extend(["--set".into(), set.clone()]);
    }
    if options.json {
        verb.push("--json".into());
    }
    if let Some(plot) = &options.plot {
        verb.extend(["--plot".into(), text(plot)?]);
    }
    let verb: Vec<_> = verb.iter().map(String::as_str).collect();
    flash::again(&verb)
}

/// Without probe-rs nothing is measured.
#[cfg(not(feature = "flash"))]
pub(super) fn measure(_name: &str, _options: &Options) -> Result<Outcome> {
    anyhow::bail!("this xtask has no probe-rs")
}

#[cfg(feature = "flash")]
pub(super) use with_probe::measure;

#[cfg(feature = "flash")]
mod with_probe {
    use std::{
        thread::{self, JoinHandle},
        time::{Duration, Instant},
    };

    use anyhow::{Context, Result};
    use probe_rs::{MemoryInterface as _, Session};

    use crate::{
        boards, build, flash,
        latency::{
            Chip, Live, Options, bounds,
            channels::Memory,
            follow, interrupted, is_over,
            measurement::{Clock, Task},
            open,
            outcome::{Outcome, judge},
            port, workload,
        },
        ui,
    };

    /// The processor's cycle counter.
    const CYCCNT: u32 = 0xe000_1004;

    /// Longer than a firmware takes to set up its memory.
    const SET_UP: Duration = Duration::from_millis(100);

    /// Measures on a board.
    pub(in crate::latency) fn measure(name: &str, options: &Options) -> Result<Outcome> {
        let workload = options.workload()?;
        let board = boards::named(name)?;
        let elf = build::traced(&board)?;
        let proof = bounds::Proof::of(&elf, &board)?;
        let loaded = workload::settings(&elf, options.file.as_deref(), &options.set)?;
        let session = flash::start(&board, options.probe.as_deref(), &elf)?;
        // In RAM there may be the rings of the firmware before: until they are set up anew.
        thread::sleep(SET_UP);
        let mut chip = Probed(session);
        let mut channels = open(&mut chip, &elf)?;
        let sender = if let Some(port) = &options.port {
            Some(port::stream(port, &workload, &loaded)?)
        } else {
            ui::status(
                "Measuring",
                "what your sender makes the board do; Ctrl-C ends",
            );
            None
        };
        let subject = match &options.port {
            Some(_) => format!("{name}: {}", workload.name()),
            None => format!("{name}: what its sender sent"),
        };
        let outcome = |tasks: &[Task]| Outcome {
            subject: subject.clone(),
            clock: Clock::CHIP,
            core_hz: proof.core_hz,
            tasks: judge(tasks, &proof.bounds, Clock::CHIP),
            unproven: proof.missing.clone(),
        };
        let (start, stop) = (Instant::now(), interrupted()?);
        let live = Live::new();
        let over = || {
            if is_over(start, options.duration(), &stop) {
                workload.stop();
                return true;
            }
            sender.as_ref().is_some_and(JoinHandle::is_finished)
        };
        let mut show = |tasks: &[Task]| live.show(|| outcome(tasks).table());
        let tasks = follow(&mut chip, &mut channels, Clock::CHIP, &over, &mut show)?;
        drop(live);
        if let Some(sender) = sender {
            sender.join().expect("the sender does not panic")?;
        }
        Ok(outcome(&tasks))
    }

    /// A chip that a probe reads while it runs.
    struct Probed(Session);

    impl Memory for Probed {
        fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
            let mut core = self.0.core(0)?;
            core.read(address.into(), bytes)
                .context("the probe cannot read the chip's memory")
        }

        fn write(&mut self, address: u32, word: u32) -> Result<()> {
            let mut core = self.0.core(0)?;
            core.write_word_32(address.into(), word)
                .context("the probe cannot write to the chip's memory")
        }
    }

    impl Chip for Probed {
        fn clock(&self) -> u32 {
            CYCCNT
        }
    }
}
