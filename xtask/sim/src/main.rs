//! `cargo xtask sim`: G-code programs on the virtual machine.

mod coils;
mod contour;
mod gantry;
mod marks;
mod plot;
mod power_up;
mod quality;
mod recorder;
mod samples;
mod series;
mod serve;
#[cfg(test)]
mod tests;
mod tool_table;
mod trace;

use std::{
    ffi::OsString,
    os::unix::net::UnixStream,
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
use leadscrew::{axis::AXES, settings::Settings, sim::Simulator};
use simulation::{
    figures::Figures,
    interrupt,
    lock::Lock,
    output,
    play::{self, Run},
    program::Program,
    session, settings, summary,
};

use gantry::{SecondMotor, Sides};
use power_up::PowerUp;
use recorder::Recording;
use serve::{Server, Tcp, Terminal};

/// Run a G-code program on the virtual machine
///
/// The machine is the firmware's own code on a virtual clock, so a program runs as fast as the
/// computer goes and gives the same step edges every time. It is streamed as senders do, to a
/// machine that is unlocked as after homing. The exit status is 1 when a line was refused or an
/// alarm rose.
///
/// With --pty or --tcp the same machine runs in real time, for any sender to connect to.
#[derive(Parser)]
#[command(bin_name = "cargo xtask sim", styles = ui::STYLES, max_term_width = 100, version)]
#[command(after_help = ui::AXES)]
#[command(group = clap::ArgGroup::new("what").required(true).args(["file", "pty", "tcp", "session"]))]
struct Options {
    /// The program; `-` is standard input
    file: Option<PathBuf>,
    /// Change a setting, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE")]
    set: Vec<String>,
    /// Speak the RepRap dialect: '$780=1', and each line with its number and checksum
    #[arg(long, conflicts_with_all = ["on_target", "session"])]
    reprap: bool,
    /// Read settings from a file of $n=value lines
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Read the tool table from a file of LinuxCNC, in mm: a line like 'T1 P1 Z10.16 D3.048' for each
    /// tool. Tools of the machine that are not in it stay
    #[arg(long, value_name = "FILE", conflicts_with_all = ["on_target", "session"])]
    tool_table: Option<PathBuf>,
    /// Write every step event: time in ns from the first step, steps of each axis after it
    #[arg(long, value_name = "OUT.csv", conflicts_with_all = ["on_target", "session"])]
    trace: Option<PathBuf>,
    /// Write which coils are energised whenever that changes, if motors are driven by phases: time in ns from
    /// power-up, IN1 to IN4 of each axis
    #[arg(
        long,
        value_name = "OUT.csv",
        requires = "file",
        conflicts_with = "on_target"
    )]
    coils: Option<PathBuf>,
    /// Draw the tool path, with the holes of canned cycles and the contour of cutter compensation, and
    /// speed and acceleration over time
    #[arg(long, value_name = "OUT.svg", conflicts_with_all = ["on_target", "session"])]
    plot: Option<PathBuf>,
    /// Measure how good the motion is: step times, jumps, accelerations and jerks, the distance from
    /// the programmed path, the speed in its corners; --plot then draws jerk and distance as well, and
    /// --json has the figures under the key `quality`
    #[arg(long, requires = "file", conflicts_with = "on_target")]
    quality: bool,
    /// Write answers, messages and figures
    #[arg(long, value_name = "OUT.json", conflicts_with = "session")]
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
    /// Give the machine limit switches at the ends of its travel, in whose middle it stands, and a
    /// probe plate 10 mm above the low end of Z
    #[arg(long, conflicts_with_all = ["on_target", "session"])]
    switches: bool,
    /// Give X, Y or Z a second motor with a limit switch of its own, so far ahead of the first one: 'Y=3' is a
    /// gantry that is skewed by 3 mm. Homing squares it, and where both motors stand is printed; repeatable
    #[arg(
        long,
        value_name = "AXIS=MM",
        requires = "switches",
        conflicts_with_all = ["on_target", "session", "pty", "tcp"]
    )]
    second: Vec<SecondMotor>,
    /// Begin the program locked where homing is on ($22=1), as a machine is at power-up
    #[arg(long, requires = "file", conflicts_with = "on_target")]
    locked: bool,
    /// Keep what is stored in this file, as the machine's flash does; a new file is a new machine.
    /// Settings that are given beside it are stored there
    #[arg(long, value_name = "FILE", conflicts_with_all = ["on_target", "session"])]
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
    // What is wrong with what was asked for is told before anything runs: first what is read, then
    // what is written.
    let mut set = options.set.clone();
    if options.reprap {
        set.push("$780=1".into());
    }
    let loaded = settings::load(options.settings.as_deref(), &set)?;
    let tools = options.tool_table.as_deref().map(tool_table::read);
    let tools = tools.transpose()?.unwrap_or_default();
    let program = options.file.as_deref().map(Program::open).transpose()?;
    if let (Some(path), true) = (&options.file, options.on_target) {
        return on_target(path, &loaded.statements, options);
    }
    let _lock = options.flash.as_deref().map(Lock::of).transpose()?;
    let power_up = PowerUp {
        loaded: &loaded,
        tools: &tools,
        flash: options.flash.as_deref(),
        has_switches: options.switches,
        second: &options.second,
    };
    let simulator = power_up.simulator()?;
    // Caught from here on: Ctrl-C leaves no file that is half written.
    let interrupted = interrupt::interruptions()?;
    let recording = Recording::create(options, simulator.session())?;
    match program {
        Some(program) => {
            recording.remove_when(interrupted);
            play(program, simulator, recording, options)
        }
        None => serve(simulator, recording, &interrupted, options),
    }
}

/// Runs a program.
fn play(
    program: Program,
    mut simulator: Box<Simulator>,
    mut recording: Recording,
    options: &Options,
) -> Result<ExitCode> {
    if !options.locked {
        power_up::unlock(&mut simulator);
    }
    let run = Run {
        bar: output::progress(program.length(), "bytes"),
        prints: true,
        recorder: &mut recording,
    };
    let start = Instant::now();
    let played = play::stream(program, &mut simulator, run);
    if let Some(path) = &options.flash {
        power_up::save(path, simulator.flash())?;
    }
    let figures = played?;
    let took = pace(&figures, start.elapsed().as_secs_f64());
    let name = match options.file.as_deref() {
        Some(path) if path != Path::new("-") => path,
        _ => Path::new("standard input"),
    };
    if figures.lines == 0 {
        ui::warning(&format!("{} is empty", name.display()));
    }
    if !options.switches && figures.misses_switches() {
        ui::warning("the machine has no switches and no probe: --switches mounts them");
    }
    summary::print(&figures);
    let sides = Sides::of(&options.second, &simulator);
    sides.iter().for_each(Sides::print);
    let name = name.file_name().unwrap_or_default().to_string_lossy();
    let settings = *simulator.session().settings();
    let is_clean = figures.is_clean();
    let quality = recording.finish(figures, sides, &settings, &name)?;
    if let Some(quality) = &quality {
        println!("{}", quality::text(quality));
    }
    text::row("took", &took);
    Ok(ExitCode::from(u8::from(!is_clean)))
}

/// Serves the machine until Ctrl-C.
fn serve(
    simulator: Box<Simulator>,
    mut recording: Recording,
    stop: &UnixStream,
    options: &Options,
) -> Result<ExitCode> {
    let settings = *simulator.session().settings();
    let server = Server::new(*simulator, options.flash.as_deref(), &mut recording);
    let (figures, name) = if let Some(path) = &options.pty {
        let mut terminal = Terminal::at(path)?;
        (
            server.serve(&mut terminal, stop)?,
            path.display().to_string(),
        )
    } else {
        let address = options.tcp.as_deref().context("no port is given")?;
        let mut tcp = Tcp::at(address)?;
        let title = format!("tcp://{}", tcp.address()?);
        (server.serve(&mut tcp, stop)?, title)
    };
    ui::status("Stopped", "");
    recording.finish(figures, Vec::new(), &settings, &name)?;
    Ok(ExitCode::SUCCESS)
}

/// Hands on to the tool that runs the virtual machine under QEMU.
fn on_target(path: &Path, statements: &[String], options: &Options) -> Result<ExitCode> {
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

/// What a run took.
fn pace(figures: &Figures, took_s: f64) -> String {
    let rate = figures.events as f64 / took_s.max(1e-9);
    let rate = separated(rate as u64);
    let times = figures.motion_time_s / took_s.max(1e-9);
    format!("{took_s:.2} s, {rate} step events per second, {times:.0} times real time")
}

/// The scale of each axis, steps/mm or steps/degree.
fn steps_per_mm(settings: &Settings) -> [f64; AXES] {
    let scales = settings.steps_per_mm.0;
    scales.map(|scale| scale.millionths() as f64 * 1e-6)
}
