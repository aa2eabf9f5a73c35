//! `cargo xtask latency`: how long tasks wait and take, measured, with the proven bounds.
//!
//! The firmware is built with the feature `trace`: each task with a deadline writes a record of
//! each of its activations into a ring in memory, which a debugger reads while it runs. On a board
//! the debugger is a probe; of the emulated board it is QEMU's connection for debuggers.
//! `docs/latency.md` says what is measured.

mod board;
mod bounds;
mod channels;
mod distribution;
mod emulator;
mod measurement;
mod nesting;
mod outcome;
mod picture;
#[cfg(feature = "probe")]
mod port;
mod workload;

use std::{
    io::IsTerminal as _,
    path::Path,
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread,
    time::{Duration, Instant},
};

use anstream::println;
use anyhow::{Context, Result};
use common::options::Latency as Options;
use common::ui;
use indicatif::{ProgressBar, ProgressStyle};

pub(crate) use self::emulator::check;
#[cfg(feature = "probe")]
pub(crate) use self::port::open as open_port;
use self::{
    channels::{Channels, Memory},
    measurement::{Clock, Measurement, Task},
    workload::Workload,
};
use crate::flash;

/// How long is measured when nobody says.
const SECONDS: u64 = 10;
/// Time between two checks of the measurement so far.
const CHECK_INTERVAL: Duration = Duration::from_millis(500);
/// How long a firmware may take to start.
const START_TIMEOUT: Duration = Duration::from_mins(1);

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let outcome = match &options.board {
        Some(_) if !cfg!(feature = "probe") => return flash::again(),
        Some(name) => board::measure(name, options)?,
        None => emulator::measure(options)?,
    };
    if let Some(path) = &options.plot {
        picture::draw(path, &outcome)?;
        ui::status("Drawn", &path.display().to_string());
    }
    if options.json {
        println!("{:#}", outcome.json());
    } else {
        println!("{}", outcome.subject);
        println!("\n{}", outcome.histograms());
        println!("{}\n{}", outcome.table(), outcome.notes().trim_end());
    }
    if outcome.is_refuted() {
        ui::warning("a maximum is above its bound: the model of the chip is wrong");
    }
    Ok(ExitCode::from(u8::from(outcome.is_refuted())))
}

/// The workload of the firmware.
fn chosen_workload(options: &Options) -> Result<Workload> {
    let once = options.file.is_some() && options.seconds.is_none();
    Workload::new(options.file.as_deref(), once)
}

/// When to stop; `None`: when the workload ends.
fn duration(options: &Options) -> Option<Duration> {
    match (options.seconds, &options.file) {
        (Some(seconds), _) => Some(Duration::from_secs(seconds)),
        (None, None) => Some(Duration::from_secs(SECONDS)),
        (None, Some(_)) => None,
    }
}

/// A chip whose memory can be read while its firmware runs.
trait Chip: Memory {
    /// Before records are read.
    fn hold(&mut self) -> Result<()> {
        Ok(())
    }

    /// After that.
    fn go(&mut self) -> Result<()> {
        Ok(())
    }

    /// The address of the counter that the firmware's clock is.
    fn clock(&self) -> u32;
}

/// Finds the rings of a firmware that has just been started.
fn open(chip: &mut dyn Chip, elf: &Path) -> Result<Channels> {
    let start = Instant::now();
    loop {
        chip.hold()?;
        let clock = chip.clock();
        let channels = Channels::open(chip, elf, clock);
        chip.go()?;
        if channels.is_ok() || start.elapsed() > START_TIMEOUT {
            return channels.context("cannot find the records of the firmware");
        }
        thread::sleep(Duration::from_millis(20));
    }
}

/// Reads records until it is over, and shows what they say meanwhile.
fn follow(
    chip: &mut dyn Chip,
    channels: &mut Channels,
    clock: Clock,
    is_over: &dyn Fn() -> bool,
    show: &mut dyn FnMut(&[Task]),
) -> Result<Vec<Task>> {
    /// Long enough for the firmware to get on.
    const PERIOD: Duration = Duration::from_millis(2);
    let mut measurement = Measurement::new(channels.tasks(), clock);
    let mut shown = Instant::now();
    loop {
        // Before the check, which includes all records up to then.
        let over = is_over();
        chip.hold()?;
        let batch = channels.drain(chip)?;
        chip.go()?;
        measurement.push(&batch);
        if over {
            return Ok(measurement.finish());
        }
        if shown.elapsed() > CHECK_INTERVAL {
            show(measurement.tasks());
            shown = Instant::now();
        }
        thread::sleep(PERIOD);
    }
}

/// Prints the results so far, where standard error is a terminal.
struct Live(Option<ProgressBar>);

impl Live {
    fn new() -> Self {
        if !std::io::stderr().is_terminal() {
            return Self(None);
        }
        let style = ProgressStyle::with_template("{elapsed}\n{msg}");
        let style = style.expect("the template is fixed");
        Self(Some(ProgressBar::no_length().with_style(style)))
    }

    fn show(&self, table: impl FnOnce() -> String) {
        if let Some(bar) = &self.0 {
            bar.set_message(table());
            bar.tick();
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}

/// Whether Ctrl-C has been pressed since.
fn interrupted() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGINT, stop.clone())
        .context("cannot catch Ctrl-C")?;
    Ok(stop)
}

/// Whether a measurement that began then is over.
fn is_over(start: Instant, duration: Option<Duration>, stop: &AtomicBool) -> bool {
    stop.load(Relaxed) || duration.is_some_and(|duration| start.elapsed() >= duration)
}
