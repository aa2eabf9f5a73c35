//! `cargo xtask sim`: G-code programs on the virtual machine.

mod axes_with_backlash;
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

use std::{ffi::OsString, os::unix::net::UnixStream, path::Path, process::ExitCode, time::Instant};

use anstream::println;
use anyhow::{Context, Result};
use common::options::{self, Sim as Options, Verb};
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

use gantry::Sides;
use power_up::PowerUp;
use recorder::Recording;
use serve::{Server, Tcp, Terminal, UsbIp};

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Sim(options) => run(&options),
        other => other.refuse(),
    })
}

fn run(options: &Options) -> Result<ExitCode> {
    if let (Some(input), Some(output)) = (&options.session, &options.out) {
        let all = session::replay_file(input, output)?;
        return Ok(ExitCode::from(u8::from(!all)));
    }
    // Every file is checked before the program runs: first the inputs, then the outputs.
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
    interrupt::end_with_owner()?;
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
    let took = speed_text(&figures, start.elapsed().as_secs_f64());
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
    let flash = options.flash.as_deref();
    let (figures, name) = if let Some(address) = &options.usbip {
        let server = UsbIp::at(address, simulator, flash, &mut recording)?;
        let title = format!("usbip://{}", server.address());
        (server.serve(stop)?, title)
    } else {
        let server = Server::new(*simulator, flash, &mut recording);
        if let Some(path) = &options.pty {
            let mut terminal = Terminal::at(path)?;
            let title = path.display().to_string();
            (server.serve(&mut terminal, stop)?, title)
        } else {
            let address = options.tcp.as_deref().context("no port is given")?;
            let mut tcp = Tcp::at(address)?;
            let title = format!("tcp://{}", tcp.address()?);
            (server.serve(&mut tcp, stop)?, title)
        }
    };
    ui::status("Stopped", "");
    recording.finish(figures, Vec::new(), &settings, &name)?;
    Ok(ExitCode::SUCCESS)
}

/// Hands on to the tool that runs the virtual machine under QEMU.
fn on_target(path: &Path, statements: &[String], options: &Options) -> Result<ExitCode> {
    cargo::need_qemu()?;
    let mut arguments = vec![OsString::from("sim-on-target"), path.into()];
    for statement in statements {
        arguments.extend(["--set".into(), format!("${statement}").into()]);
    }
    if let Some(json) = &options.json {
        arguments.extend(["--json".into(), json.as_os_str().into()]);
    }
    tools::become_tool(tools::TARGET, arguments)
}

/// What a run took.
fn speed_text(figures: &Figures, took_s: f64) -> String {
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
