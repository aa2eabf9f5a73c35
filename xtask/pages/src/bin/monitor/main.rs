//! `cargo xtask monitor`: a live picture of what a machine does.

mod control;
mod http;
mod page;
mod path_follower;
mod picture;
mod rehearsal;
mod site;
mod source;
mod svg;
mod tap;
mod track;
mod values;
mod watch;

use std::{fs, path::Path, process::ExitCode, sync::Arc};

use anyhow::{Context, Result, ensure};
use common::options::{self, Monitor as Options, Verb};
use common::ui;
use grbl_client::{JobGuard, Machine, Transmission, guard, link};
use simulation::{
    Job, interrupt::interruptions, output::Output, playing::RaisedAlarm, program::Program, pty::Pty,
};

use path_follower::PathFollower;
use picture::Shared;
use rehearsal::Rehearsal;
use source::Source;
use track::Track;
use watch::Watch;

fn main() -> ExitCode {
    guard::become_guard_if_asked();
    common::main(|| match options::read() {
        Verb::Monitor(options) if options.control => control::run(&options),
        Verb::Monitor(options) => run(&options),
        other => other.refuse(),
    })
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
    let (rehearsed, expected) = rehearse(options, &mut machine)?;
    let (job, path_follower) = rehearsed.unzip();
    // It may have moved since.
    machine.report()?;
    let track = Track::new(machine.status, &settings);
    let mut watch = Watch::new((machine.link, track), options.sim, shared.clone());
    watch.begin(path_follower, expected)?;
    let link = options.link.as_deref().map(Pty::at).transpose()?;
    let file = options.file.as_deref().and_then(Path::file_name);
    let title = file.map_or_else(|| name, |name| name.to_string_lossy().into_owned());
    shared.lock().title = title;
    let url = page::serve(&options.listen, &shared, job)?;
    ui::status("Showing", &format!("{url} (Ctrl-C ends)"));
    let mut job = program.map(transmission).transpose()?;
    // Ctrl-C while the job was tried: nothing has been sent.
    ensure!(!link::is_stopped(&stop)?, link::Stopped);
    let guard = job
        .as_ref()
        .map(|_| JobGuard::of(watch.link()))
        .transpose()?;
    let watched = watch.run(link.as_ref().map(|(pty, _)| pty), job.as_mut(), &stop);
    if let Some(mut guard) = guard {
        if watched.is_ok() {
            guard.dismiss();
        } else if !guard.hold() {
            ui::warning("the machine has not taken the hold: it may still move");
        }
    }
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

/// The transmission of a program, which refused lines do not end.
fn transmission(mut program: Program) -> Result<Transmission> {
    let mut lines = Vec::new();
    while let Some(line) = program.next_line()? {
        lines.push(line);
    }
    let mut job = Transmission::new(&[], &lines, 0, true);
    job.has_keyboard = false;
    Ok(job)
}

/// A job that is known in advance, and the alarm in which it ends.
type Rehearsed = (Option<(Job, PathFollower)>, Option<RaisedAlarm>);

/// Runs the program in advance, if there is one that can be read twice.
fn rehearse(options: &Options, machine: &mut Machine) -> Result<Rehearsed> {
    let has_machine = options.sim || options.program.is_some();
    ensure!(
        options.settings.is_none() || has_machine,
        "--settings needs --sim or --program"
    );
    let file = options.program.as_ref().or(options.file.as_ref());
    let Some(path) = file.filter(|path| !path.is_standard_input()) else {
        return Ok((None, None));
    };
    let mut answers = source::answers(machine)?;
    if let Some(settings) = options.settings.as_ref().filter(|_| !options.sim) {
        let text = fs::read_to_string(settings);
        let text = text.with_context(|| format!("cannot read {}", settings.display()))?;
        answers.settings = text.lines().map(str::to_owned).collect();
    }
    match Rehearsal::of(path, &answers) {
        Ok(Rehearsal { job, path_follower }) => Ok((Some((job, path_follower)), None)),
        // The machine is watched all the same.
        Err(error) if options.program.is_none() => {
            ui::warning(&format!("the path of the job is not shown: {error:#}"));
            Ok((None, error.downcast().ok()))
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
    let mut set = options.set.clone();
    if !options.control {
        set.extend(["$792=1", "$793=1"].map(str::to_owned));
    }
    Source::simulated(options.settings.as_deref(), &set)
}
