//! `cargo xtask sim`: G-code programs on the virtual machine.

#[cfg(test)]
mod tests;
mod watch;

use std::{
    cell::RefCell,
    path::{Path, PathBuf},
    process::ExitCode,
    rc::Rc,
    time::Instant,
};

use anstream::println;
use anyhow::{Context, Result, bail};
use indicatif::ProgressBar;
use leadscrew::{
    settings::Settings,
    sim::{Simulator, Stream, StreamEnd, Switch},
    units::TICKS_PER_SECOND,
};

use crate::{
    figures::{self, Figures, Final, separated},
    machine::{BAUD, Ends},
    on_target, plot,
    program::Program,
    quality::{self, Meter},
    serve::{self, Memory},
    session, settings,
    trace::{Motion, Samples, Table},
    ui,
};
use watch::{Observer, Source, Watched};

/// Run a G-code program on the virtual machine
///
/// The machine is the firmware's own code on a virtual clock, so a program runs as fast as the
/// computer goes and gives the same step edges every time. It is streamed as senders do. The exit
/// status is 1 when a line was refused or an alarm rose.
///
/// With --pty or --tcp the same machine runs in real time, for any sender to connect to.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true).args(["file", "pty", "tcp", "session"]))]
pub(crate) struct Options {
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

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
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
    let (figures, took) = if options.on_target {
        let start = Instant::now();
        let figures = on_target::play(path, &loaded)?;
        let took_s = start.elapsed().as_secs_f64();
        (figures, format!("{took_s:.2} s, with the build"))
    } else {
        simulate(path, &settings, options)?
    };
    figures.print();
    if let Some(quality) = &figures.quality {
        println!("{}", quality::text(quality));
    }
    figures::row("took", &took);
    if let Some(path) = &options.json {
        figures.write_json(path)?;
    }
    Ok(ExitCode::from(u8::from(!figures.is_clean())))
}

/// What a run took.
fn pace(figures: &Figures, took_s: f64) -> String {
    let rate = figures.events as f64 / took_s.max(1e-9);
    let rate = separated(rate as u64);
    let times = figures.motion_time_s / took_s.max(1e-9);
    format!("{took_s:.2} s, {rate} step events per second, {times:.0} times real time")
}

/// Runs a program and says nothing.
pub(crate) fn play(path: &Path, settings: &Settings) -> Result<Figures> {
    let program = Program::open(path)?;
    let observer = Observer::new(ProgressBar::hidden());
    let mut simulator = Box::new(Simulator::new(settings));
    let (figures, _) = stream(program, &mut simulator, settings, observer)?;
    Ok(figures)
}

/// What a recorded program did, and what the machine says of itself at the end.
pub(crate) struct Played {
    pub(crate) figures: Figures,
    /// What `$G`, `$#` and `?` say.
    pub(crate) said: Vec<String>,
}

/// Runs a recorded program amid switches and says nothing.
pub(crate) fn play_recorded(
    path: &Path,
    settings: &Settings,
    switches: &[Switch],
) -> Result<Played> {
    let program = Program::recorded(path)?;
    let mut simulator = Box::new(Simulator::new(settings));
    for switch in switches {
        // Fewer than fit.
        let _ = simulator.mount(*switch);
    }
    let observer = Observer::new(ProgressBar::hidden());
    let (figures, _) = stream(program, &mut simulator, settings, observer)?;
    let said = ["$G\n", "$#\n", "?"]
        .into_iter()
        .flat_map(|text| ask(&mut simulator, text.as_bytes()))
        .collect();
    Ok(Played { figures, said })
}

/// Sends something to a machine that has come to rest, and returns what it says.
fn ask(simulator: &mut Simulator, bytes: &[u8]) -> Vec<String> {
    for byte in bytes {
        simulator.receive(*byte);
        simulator.settle();
    }
    let mut said = Vec::new();
    while let Some(byte) = simulator.send() {
        said.push(byte);
        simulator.settle();
    }
    let said = String::from_utf8_lossy(&said);
    let lines = said
        .lines()
        .filter(|line| !line.is_empty() && *line != "ok");
    lines.map(str::to_owned).collect()
}

/// Runs a program with everything that is asked for; also says what the run took.
fn simulate(path: &Path, settings: &Settings, options: &Options) -> Result<(Figures, String)> {
    let program = Program::open(path)?;
    let mut observer = Observer::new(ui::progress(program.length(), "bytes"));
    observer.prints = true;
    observer.table = options.trace.as_deref().map(Table::create).transpose()?;
    observer.samples = options.plot.as_ref().map(|_| Samples::default());
    let meter = Rc::new(RefCell::new(Meter::new(settings)));
    observer.meter = options.quality.then(|| meter.clone());
    let start = Instant::now();
    let mut simulator = Box::new(Simulator::new(settings));
    let (mut figures, motion) = stream(program, &mut simulator, settings, observer)?;
    let (quality, traces) = meter.replace(Meter::new(settings)).finish();
    let traces = options.quality.then_some(&traces);
    figures.quality = options.quality.then_some(quality);
    let took = pace(&figures, start.elapsed().as_secs_f64());
    if figures.lines == 0 {
        ui::warning(&format!("{} is empty", path.display()));
    }
    if let (Some(output), Some(motion)) = (&options.plot, motion) {
        let name = path.file_name().unwrap_or(path.as_os_str());
        plot::draw(
            output,
            &plot::Picture {
                title: &name.to_string_lossy(),
                subtitle: &subtitle(&figures),
                motion: &motion,
                limits_mm_s2: settings.acceleration_mm_s2.0.map(f64::from),
                limits_mm_s3: quality::jerk_limits(settings),
                traces,
            },
        )?;
    }
    Ok((figures, took))
}

fn subtitle(figures: &Figures) -> String {
    let time = figures::duration(figures.motion_time_s);
    let (lines, events) = (separated(figures.lines), separated(figures.events));
    format!("{lines} lines, {time}, {events} step events")
}

/// Streams a program through a fresh machine.
fn stream(
    program: Program,
    simulator: &mut Simulator,
    settings: &Settings,
    observer: Observer,
) -> Result<(Figures, Option<Motion>)> {
    let source = Source::new(program, &observer);
    let (lines, failure) = (source.lines.clone(), source.failure.clone());
    let mut watcher = Watched { observer, lines };
    let mut stream = Stream::new(simulator, source, BAUD);
    let end = stream.run(&mut watcher);
    let observer = watcher.observer;
    observer.bar.finish_and_clear();
    if let Some(error) = failure.borrow_mut().take() {
        return Err(error);
    }
    if let Some(error) = observer.failure {
        return Err(error);
    }
    if let Some(table) = observer.table {
        table.finish()?;
    }
    let answered = observer.responses.iter().count();
    if end == StreamEnd::Stuck {
        bail!("the machine stands still after {answered} answers and does not go on");
    }
    let tally = &observer.tally;
    let snapshot = stream.simulator.snapshot();
    let scale = settings
        .steps_per_mm
        .0
        .map(|scale| scale.millionths() as f64 * 1e-6);
    let figures = Figures {
        lines: stream.lines,
        responses: observer.responses,
        messages: observer.messages,
        end: Final::new(snapshot.state.name().into(), &snapshot.steps.0, settings),
        steps_axis: tally.pulses.0.to_vec(),
        motion_time_s: tally.motion_ticks() as f64 / f64::from(TICKS_PER_SECOND),
        events: tally.events,
        late: u64::from(stream.simulator.late()),
        event_hash: format!("{:016x}", tally.hash),
        quality: None,
    };
    let motion = observer.samples.map(|samples| samples.finish(scale));
    Ok((figures, motion))
}
