//! A board: a probe reads it while it runs, and a sender may stream to its serial port.

#[cfg(not(feature = "probe"))]
use super::{Options, outcome::Outcome};

/// Without probe-rs nothing is measured.
#[cfg(not(feature = "probe"))]
pub(super) fn measure(_name: &str, _options: &Options) -> anyhow::Result<Outcome> {
    anyhow::bail!("this program has no probe-rs")
}

#[cfg(feature = "probe")]
pub(super) use with_probe::measure;

#[cfg(feature = "probe")]
mod with_probe {
    use std::{
        thread::{self, JoinHandle},
        time::{Duration, Instant},
    };

    use anyhow::{Context, Result};
    use common::ui;
    use probe_rs::{MemoryInterface as _, Session};

    use crate::{
        flash,
        latency::{
            Chip, Live, Options, bounds,
            channels::Memory,
            chosen_workload, duration, follow, interrupted, is_over,
            measurement::{Clock, Task},
            open,
            outcome::{Outcome, judge},
            port, workload,
        },
    };

    /// The processor's cycle counter.
    const CYCCNT: u32 = 0xe000_1004;

    /// Longer than a firmware takes to set up its memory.
    const SET_UP: Duration = Duration::from_millis(100);

    /// Measures on a board.
    pub(in crate::latency) fn measure(name: &str, options: &Options) -> Result<Outcome> {
        let workload = chosen_workload(options)?;
        let board = firmware::boards::named(name)?;
        let elf = firmware::traced(&board)?;
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
            if is_over(start, duration(options), &stop) {
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
