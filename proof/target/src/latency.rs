//! `cargo xtask latency`: how long tasks wait and take, measured, beside what is proven of them.
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
    path::{Path, PathBuf},
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

/// Measure how long tasks wait and take, beside the bounds that are proven
///
/// Without --board, on the emulated board, whose time base is its own: see docs/latency.md. On a
/// board, through a debug probe. The exit status is 1 when a maximum is above its bound.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The program that is executed meanwhile; without it, one that keeps every task busy
    file: Option<PathBuf>,
    /// The board to measure
    #[arg(long, value_name = "NAME", conflicts_with = "qemu")]
    board: Option<String>,
    /// Measure on the emulated board: the default
    #[arg(long)]
    qemu: bool,
    /// How long to measure, repeating the program; without it, a FILE is executed once
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    seconds: Option<u64>,
    /// The board's serial port, to send the program to; without it, you send one
    #[arg(long, value_name = "DEVICE", requires = "board")]
    port: Option<PathBuf>,
    /// The probe, as `VID:PID` or `VID:PID:SERIAL`, where there is more than one
    #[arg(long, value_name = "PROBE", requires = "board")]
    probe: Option<String>,
    /// Change a setting before, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE")]
    set: Vec<String>,
    /// Print JSON instead of tables
    #[arg(long)]
    json: bool,
    /// Draw the histograms
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
}

/// How long is measured when nobody says.
const SECONDS: u64 = 10;
/// Time between two looks at what has been found so far.
const LOOK: Duration = Duration::from_millis(500);
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

impl Options {
    /// What the firmware executes.
    fn workload(&self) -> Result<Workload> {
        let once = self.file.is_some() && self.seconds.is_none();
        Workload::new(self.file.as_deref(), once)
    }

    /// When to stop; `None`: when the workload ends.
    fn duration(&self) -> Option<Duration> {
        match (self.seconds, &self.file) {
            (Some(seconds), _) => Some(Duration::from_secs(seconds)),
            (None, None) => Some(Duration::from_secs(SECONDS)),
            (None, Some(_)) => None,
        }
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
        // Before the look: what comes until then is in it.
        let over = is_over();
        chip.hold()?;
        let batch = channels.drain(chip)?;
        chip.go()?;
        measurement.push(&batch);
        if over {
            return Ok(measurement.finish());
        }
        if shown.elapsed() > LOOK {
            show(measurement.tasks());
            shown = Instant::now();
        }
        thread::sleep(PERIOD);
    }
}

/// What has been found so far, where standard error is a terminal.
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
