//! The emulated board: a sender streams to it, and QEMU's connection for debuggers reads it.

use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering::Relaxed},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, ensure};
use common::{cargo, check::Verdict, ui};
use indicatif::ProgressBar;
use simulation::{
    figures::Figures,
    settings::{self, Loaded},
};
use target::emulator::{Debugger, Emulator, FIRST_USART, symbol};

use super::{
    Chip, Live, Options, bounds,
    channels::Memory,
    chosen_workload, duration, follow, interrupted, is_over,
    measurement::{Clock, Task},
    open,
    outcome::{Outcome, judge},
    workload::{self, Workload},
};
use crate::qemu;

/// The emulated timer that counts virtual nanoseconds: TIM5's counter.
const CLOCK: u32 = 0x4000_0c24;

/// Measures on the emulated board.
pub(super) fn measure(options: &Options) -> Result<Outcome> {
    let workload = chosen_workload(options)?;
    cargo::need_qemu()?;
    let (board, machine) = firmware::boards::emulated()?;
    let elf = firmware::traced(&board)?;
    let proof = bounds::Proof::of(&elf, &board)?;
    let loaded = workload::settings(&elf, options.file.as_deref(), &options.set)?;
    ui::status("Booting", &format!("{} under QEMU", board.name));
    let run = Run {
        elf: &elf,
        machine: &machine,
        workload: &workload,
        loaded: &loaded,
        duration: duration(options),
    };
    let outcome = |tasks: &[Task]| Outcome {
        subject: format!("{} under QEMU: {}", board.name, workload.name()),
        clock: Clock::EMULATOR,
        core_hz: proof.core_hz,
        tasks: judge(tasks, &proof.bounds, Clock::EMULATOR),
        unproven: proof.missing.clone(),
    };
    let live = Live::new();
    let (tasks, _) = run.follow(&mut |tasks| live.show(|| outcome(tasks).table()))?;
    drop(live);
    Ok(outcome(&tasks))
}

/// Executes a short program on the emulated board and compares what is recorded with what the pins
/// did: a check of `cargo xtask test`.
pub(crate) fn check() -> Result<Verdict> {
    /// For a motion of 2 s, in which the host finds the time to read however busy it is.
    const PULSES: u64 = 25_000;
    /// Events in which no pulse begins or ends: the start, the stop, and very long waits.
    const OTHERS: u64 = 20;
    cargo::need_qemu()?;
    let (board, machine) = firmware::boards::emulated()?;
    let workload = Workload::of(b"G1X100F3000\n");
    let assignments = ["$100=250", "$110=6000", "$120=1000"].map(str::to_owned);
    let run = Run {
        elf: &firmware::traced(&board)?,
        machine: &machine,
        workload: &workload,
        loaded: &settings::load(None, &assignments)?,
        duration: None,
    };
    let (tasks, figures) = run.follow(&mut |_| ())?;
    ensure!(figures.events == PULSES, "{} pulses", figures.events);
    let task = |name: &str| {
        let mut tasks = tasks.iter();
        tasks
            .find(|task| task.name == name)
            .with_context(|| format!("no records of {name}"))
    };
    let (step, prepare) = (task("step")?, task("prepare")?);
    // Each pulse begins with an interrupt and ends with another, and a segment may end with one more.
    let (interrupts, segments) = (
        u64::from(step.activations),
        task("segment_start")?.activations,
    );
    ensure!(
        (2 * PULSES..=2 * PULSES + u64::from(segments) + OTHERS).contains(&interrupts),
        "{interrupts} step interrupts for {PULSES} pulses in {segments} segments"
    );
    ensure!(
        step.recorded + step.dropped() == interrupts && step.recorded > 127,
        "{} step interrupts were recorded of {interrupts}",
        step.recorded
    );
    // Nothing preempts a step, so none is uncertain; some of the others are not, either.
    let known = step.execution.summary();
    ensure!(known.count == step.recorded && known.min > 0, "{known:?}");
    for (name, values) in [
        ("execution", &prepare.execution),
        ("latency", &prepare.latency),
    ] {
        let count = values.summary().count;
        ensure!(count > 10, "{count} times the {name} of prepare is known");
    }
    // How many are dropped is a matter of when a busy host comes to read them.
    for task in [step, prepare] {
        ensure!(
            task.drops_for_want_of_room(),
            "records of {} were dropped though there was room",
            task.name
        );
    }
    Ok(Verdict::Counted(format!(
        "{interrupts} step interrupts, {} recorded",
        step.recorded
    )))
}

/// One run of the emulated board.
struct Run<'a> {
    elf: &'a Path,
    machine: &'a str,
    workload: &'a Workload,
    loaded: &'a Loaded,
    duration: Option<Duration>,
}

impl Run<'_> {
    /// Streams the workload and reads records until both are over.
    fn follow(&self, show: &mut dyn FnMut(&[Task])) -> Result<(Vec<Task>, Figures)> {
        let shift = format!("shift={}", Clock::SHIFT);
        let options = ["-icount", &shift];
        let mut emulator = Emulator::start_with(self.elf, self.machine, FIRST_USART, &options)?;
        let debugger = emulator.debugger()?;
        let mut chip = Emulated(debugger);
        chip.go()?;
        let mut channels = open(&mut chip, self.elf)?;
        chip.put_plate(self.elf)?;
        let stop = interrupted()?;
        let start = Instant::now();
        let has_ended = AtomicBool::new(false);
        let loaded = self.loaded;
        thread::scope(|scope| {
            let sender = scope.spawn(|| {
                let program = self.workload.program();
                let played = qemu::play(&mut emulator, program, loaded, ProgressBar::hidden());
                has_ended.store(true, Relaxed);
                played
            });
            let over = || {
                if is_over(start, self.duration, &stop) {
                    self.workload.stop();
                }
                // What has been sent is executed to its end.
                has_ended.load(Relaxed)
            };
            let tasks = follow(&mut chip, &mut channels, Clock::EMULATOR, &over, show);
            self.workload.stop();
            let figures = sender.join().expect("the sender does not panic");
            Ok((tasks?, figures?))
        })
    }
}

/// The emulated chip.
struct Emulated(Debugger);

impl Memory for Emulated {
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
        self.0.read(address, bytes)
    }

    fn write(&mut self, address: u32, word: u32) -> Result<()> {
        self.0.write(address, &[word])
    }
}

impl Emulated {
    /// Puts a plate under the probe that is closed for a part of the path of Z, so that there are
    /// edges to take care of.
    fn put_plate(&mut self, elf: &Path) -> Result<()> {
        const CONTACTS: &str = "CONTACTS";
        const PLATE: u32 = 13 * 4;
        const HIGHEST_CLOSED: i32 = 160;
        let address = symbol(elf, CONTACTS)? as u32 + PLATE;
        self.hold()?;
        self.write(address, HIGHEST_CLOSED.cast_unsigned())?;
        self.go()
    }
}

impl Chip for Emulated {
    fn hold(&mut self) -> Result<()> {
        self.0.interrupt()
    }

    fn go(&mut self) -> Result<()> {
        self.0.resume()
    }

    fn clock(&self) -> u32 {
        CLOCK
    }
}
