//! `cargo xtask monitor`: a live picture of what a machine does.

mod page;
mod path_follower;
mod picture;
mod rehearsal;
mod sending;
mod source;
mod svg;
mod tap;
mod track;
mod watch;

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
};

use anyhow::{Context, Result, ensure};
use clap::Parser;
use common::{BAUD, ui};
use grbl_client::Machine;
use simulation::{Job, interrupt::interruptions, output::Output, program::Program, pty::Pty};

use path_follower::PathFollower;
use picture::Shared;
use rehearsal::Rehearsal;
use sending::Sending;
use source::Source;
use track::Track;
use watch::Watch;

/// Show in a browser what a machine does
///
/// The machine is a board at a serial port, any machine that speaks Grbl, or the simulator. A page on
/// this computer shows path, position, state and speed. With FILE the program is streamed, and the
/// command ends with it; otherwise it ends with Ctrl-C. With --link a sender connects through it, and
/// every byte passes. Of FILE, or of the --program that a sender sends, the page shows the whole path
/// from the beginning, what has been cut of it, and how long the rest will take.
#[derive(Parser)]
#[command(bin_name = "cargo xtask monitor", styles = ui::STYLES, max_term_width = 100, version)]
#[command(after_help = ui::AXES)]
#[command(group = clap::ArgGroup::new("where").required(true).args(["port", "tcp", "sim"]))]
struct Options {
    /// The program; `-` is standard input
    #[arg(conflicts_with = "link")]
    file: Option<PathBuf>,
    /// The program that is sent by somebody else: the page shows its path and the time that is left
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    program: Option<PathBuf>,
    /// The serial port of the machine, such as /dev/ttyACM0
    #[arg(long, value_name = "DEVICE")]
    port: Option<PathBuf>,
    /// The TCP address of the machine, such as 127.0.0.1:2323
    #[arg(long, value_name = "ADDR:PORT")]
    tcp: Option<String>,
    /// Watch the virtual machine, in real time
    #[arg(long)]
    sim: bool,
    /// The baud rate of the serial port
    #[arg(long, value_name = "BAUD", default_value_t = BAUD, requires = "port")]
    baud: u32,
    /// Read settings of the virtual machine from a file of $n=value lines; with --program, those of a
    /// machine that is already in motion and cannot be asked
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Change a setting of the virtual machine, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE", requires = "sim")]
    set: Vec<String>,
    /// Make a serial device at which a sender reaches the machine
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// Where the page is served; port 0 is any that is free
    #[arg(long, value_name = "ADDR:PORT", default_value = "127.0.0.1:0")]
    http: String,
    /// Draw the picture into a file at the end
    #[arg(long, value_name = "OUT.svg")]
    svg: Option<PathBuf>,
}

fn main() -> ExitCode {
    let options = Options::parse();
    common::main(|| run(&options))
}

fn run(options: &Options) -> Result<ExitCode> {
    let program = options.file.as_deref().map(Program::open).transpose()?;
    let svg = options.svg.as_deref().map(Output::create).transpose()?;
    // The virtual machine ends when this function does.
    let Source {
        link,
        simulator: _simulator,
    } = source(options)?;
    let stop = interruptions()?;
    let shared = Arc::<Shared>::default();
    let (mut machine, settings) = source::greet(link, &stop)?;
    let name = machine.link.name.clone();
    let (job, path_follower) = rehearse(options, &mut machine)?.unzip();
    let track = Track::new(machine.status, &settings);
    let mut watch = Watch::new((machine.link, track), options.sim, shared.clone());
    watch.expect(path_follower);
    let link = options.link.as_deref().map(Pty::at).transpose()?;
    let file = options.file.as_deref().and_then(Path::file_name);
    let title = file.map_or_else(|| name, |name| name.to_string_lossy().into_owned());
    shared.lock().title = title;
    let at = page::serve(&options.http, &shared, job)?;
    ui::status("Showing", &format!("http://{at}/ (Ctrl-C ends)"));
    let mut job = program.map(Sending::new);
    let watched = watch.run(link.as_ref().map(|(pty, _)| pty), job.as_mut(), &stop);
    shared.change(picture::Picture::end);
    page::wait_for_pages(&shared);
    if let (Some(output), Some(path)) = (svg, &options.svg) {
        svg::save(output, &shared.lock())?;
        ui::status("Drawn", &path.display().to_string());
    }
    ui::status("Extents", &svg::extents(&shared.lock()));
    watched?;
    let refused = job.map_or(0, |job| job.refused);
    Ok(ExitCode::from(u8::from(refused > 0)))
}

/// Runs the program in advance, if there is one that can be read twice.
fn rehearse(options: &Options, machine: &mut Machine) -> Result<Option<(Job, PathFollower)>> {
    let has_machine = options.sim || options.program.is_some();
    ensure!(
        options.settings.is_none() || has_machine,
        "--settings needs --sim or --program"
    );
    let file = options.program.as_ref().or(options.file.as_ref());
    let Some(path) = file.filter(|path| **path != Path::new("-")) else {
        return Ok(None);
    };
    let mut answers = source::answers(machine)?;
    if let Some(settings) = options.settings.as_ref().filter(|_| !options.sim) {
        let text = fs::read_to_string(settings);
        let text = text.with_context(|| format!("cannot read {}", settings.display()))?;
        answers.settings = text.lines().map(str::to_owned).collect();
    }
    match Rehearsal::of(path, &answers) {
        Ok(Rehearsal { job, path_follower }) => Ok(Some((job, path_follower))),
        // The machine is watched all the same.
        Err(error) if options.program.is_none() => {
            ui::warning(&format!("the path of the job is not shown: {error:#}"));
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

fn source(options: &Options) -> Result<Source> {
    if !options.sim {
        return Source::open(
            options.port.as_deref(),
            options.baud,
            options.tcp.as_deref(),
        );
    }
    let stream = ["$792=1", "$793=1"].map(str::to_owned);
    let set: Vec<_> = options.set.iter().chain(&stream).cloned().collect();
    Source::simulated(options.settings.as_deref(), &set)
}
