//! `cargo xtask sim`: G-code programs on the virtual machine.

mod curves;
mod plot;
mod quality;
mod recorder;
mod serve;
#[cfg(test)]
mod tests;
mod trace;

use std::{
    ffi::OsString,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use anstream::println;
use anyhow::{Context, Result};
use clap::Parser;
use common::{
    cargo,
    text::{self, separated},
    tools, ui,
};
use host::{
    figures::Figures,
    machine::Ends,
    output,
    play::{self, Run},
    program::Program,
    session, settings,
};
use leadscrew::{settings::Settings, sim::Simulator};
use serde::Serialize;

use quality::{Meter, Quality};
use recorder::Instruments;
use serve::Memory;
use trace::{Samples, Table};

/// Run a G-code program on the virtual machine
///
/// The machine is the firmware's own code on a virtual clock, so a program runs as fast as the
/// computer goes and gives the same step edges every time. It is streamed as senders do. The exit
/// status is 1 when a line was refused or an alarm rose.
///
/// With --pty or --tcp the same machine runs in real time, for any sender to connect to.
#[derive(Parser)]
#[command(bin_name = "cargo xtask sim", styles = ui::STYLES, max_term_width = 100, version)]
#[command(after_help = ui::AXES)]
#[command(group = clap::ArgGroup::new("what").required(true).args(["file", "pty", "tcp", "session"]))]
struct Options {
    /// The program
    file: Option<PathBuf>,
    /// Change a setting, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE")]
    set: Vec<String>,
    /// Read settings from a file of $n=value lines
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Write every step event: time in ns from the first step, steps of each axis after it
    #[arg(
        long,
        value_name = "OUT.csv",
        requires = "file",
        conflicts_with = "on_target"
    )]
    trace: Option<PathBuf>,
    /// Draw the tool path, and speed and acceleration over time
    #[arg(
        long,
        value_name = "OUT.svg",
        requires = "file",
        conflicts_with = "on_target"
    )]
    plot: Option<PathBuf>,
    /// Measure how good the motion is: step times, jumps, accelerations and jerks, the distance from
    /// the programmed path, the speed in its corners; --plot then draws jerk and distance as well, and
    /// --json has the figures under the key `quality`
    #[arg(long, requires = "file", conflicts_with = "on_target")]
    quality: bool,
    /// Write answers, messages and figures
    #[arg(long, value_name = "OUT.json", requires = "file")]
    json: Option<PathBuf>,
    /// Run the virtual machine on the emulated chip instead of this computer
    #[arg(long, requires = "file")]
    on_target: bool,
    /// Serve the machine in real time at a new serial device, until Ctrl-C
    #[arg(long, value_name = "PATH")]
    pty: Option<PathBuf>,
    /// Serve the machine in real time at a TCP address such as 127.0.0.1:2323, until Ctrl-C
    #[arg(long, value_name = "ADDR:PORT")]
    tcp: Option<String>,
    /// Give the served machine limit switches at the ends of its travel, in whose middle it stands,
    /// and a probe plate 10 mm above the low end of Z
    #[arg(long, conflicts_with_all = ["file", "session", "flash"])]
    switches: bool,
    /// Keep what is stored in this file, as the machine's flash does; a new file is a new machine
    #[arg(long, value_name = "FILE", conflicts_with_all = ["file", "session", "set", "settings"])]
    flash: Option<PathBuf>,
    /// Replay recorded exchanges in virtual time
    #[arg(long, value_name = "IN.json", requires = "out", conflicts_with_all = ["set", "settings"])]
    session: Option<PathBuf>,
    /// Where to write what was received
    #[arg(long, value_name = "OUT.json", requires = "session")]
    out: Option<PathBuf>,
}

fn main() -> ExitCode {
    let options = Options::parse();
    common::main(|| run(&options))
}

fn run(options: &Options) -> Result<ExitCode> {
    if let (Some(input), Some(output)) = (&options.session, &options.out) {
        let all = session::replay_file(input, output)?;
        return Ok(ExitCode::from(u8::from(!all)));
    }
    let loaded = settings::load(options.settings.as_deref(), &options.set)?;
    let settings = loaded.settings;
    if options.pty.is_some() || options.tcp.is_some() {
        let memory = match &options.flash {
            Some(path) => Memory::File(path.clone()),
            None => Memory::Settings(Box::new(settings)),
        };
        let switches = options.switches.then(|| Ends::of(&settings));
        if let Some(path) = &options.pty {
            serve::pty(path, &memory, switches.as_ref())?;
        }
        if let Some(address) = &options.tcp {
            serve::tcp(address, &memory, switches.as_ref())?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let path = options.file.as_deref().context("no program is given")?;
    if options.on_target {
        return on_target(path, &loaded.statements, options);
    }
    let (measured, took) = simulate(path, &settings, options)?;
    measured.figures.print();
    if let Some(quality) = &measured.quality {
        println!("{}", quality::text(quality));
    }
    text::row("took", &took);
    if let Some(path) = &options.json {
        output::write_json(path, &measured)?;
    }
    Ok(ExitCode::from(u8::from(!measured.figures.is_clean())))
}

/// Hands on to the tool that runs the virtual machine under QEMU.
fn on_target(path: &Path, statements: &[String], options: &Options) -> Result<ExitCode> {
    Program::open(path)?;
    cargo::need_qemu()?;
    let mut arguments = vec![OsString::from("sim"), path.into()];
    for statement in statements {
        arguments.extend(["--set".into(), format!("${statement}").into()]);
    }
    if let Some(json) = &options.json {
        arguments.extend(["--json".into(), json.into()]);
    }
    tools::become_tool(tools::TARGET, arguments)
}

/// What a run shows, and how good its motion is, where that was asked for.
#[derive(Serialize)]
struct Measured {
    #[serde(flatten)]
    figures: Figures,
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<Quality>,
}

/// What a run took.
fn pace(figures: &Figures, took_s: f64) -> String {
    let rate = figures.events as f64 / took_s.max(1e-9);
    let rate = separated(rate as u64);
    let times = figures.motion_time_s / took_s.max(1e-9);
    format!("{took_s:.2} s, {rate} step events per second, {times:.0} times real time")
}

/// Runs a program with everything that is asked for; also says what the run took.
fn simulate(path: &Path, settings: &Settings, options: &Options) -> Result<(Measured, String)> {
    let program = Program::open(path)?;
    let mut instruments = Instruments {
        table: options.trace.as_deref().map(Table::create).transpose()?,
        samples: options.plot.as_ref().map(|_| Samples::default()),
        meter: options.quality.then(|| Meter::new(settings)),
    };
    let run = Run {
        bar: output::progress(program.length(), "bytes"),
        prints: true,
        recorder: &mut instruments,
    };
    let start = Instant::now();
    let mut simulator = Box::new(Simulator::new(settings));
    let figures = play::stream(program, &mut simulator, settings, run)?;
    let took = pace(&figures, start.elapsed().as_secs_f64());
    if figures.lines == 0 {
        ui::warning(&format!("{} is empty", path.display()));
    }
    let Instruments {
        table,
        samples,
        meter,
    } = instruments;
    table.map(Table::finish).transpose()?;
    let (quality, traces) = meter.map(Meter::finish).unzip();
    if let (Some(output), Some(samples)) = (&options.plot, samples) {
        let name = path.file_name().unwrap_or(path.as_os_str());
        let scale = settings
            .steps_per_mm
            .0
            .map(|scale| scale.millionths() as f64 * 1e-6);
        plot::draw(
            output,
            &plot::Picture {
                title: &name.to_string_lossy(),
                subtitle: &subtitle(&figures),
                motion: &samples.finish(scale),
                limits_mm_s2: settings.acceleration_mm_s2.0.map(f64::from),
                limits_mm_s3: quality::jerk_limits(settings),
                traces: traces.as_ref(),
            },
        )?;
    }
    Ok((Measured { figures, quality }, took))
}

fn subtitle(figures: &Figures) -> String {
    let time = text::duration(figures.motion_time_s);
    let (lines, events) = (separated(figures.lines), separated(figures.events));
    format!("{lines} lines, {time}, {events} step events")
}
