//! `cargo xtask view`: a job as a page to look at.

use std::{ffi::OsStr, io::Write as _, os::unix::net::UnixStream, process::ExitCode};

use anstream::println;
use anyhow::{Context, Result, bail};
use common::options::{self, Verb, View as Options};
use common::{
    text::{self, duration, separated},
    ui,
};
use leadscrew::sim::Simulator;
use pages::{page, picture};
use simulation::Recording;
use simulation::{
    interrupt,
    machine::SwitchPositions,
    output::{self, Output},
    play::{self, Run},
    program::Program,
    settings, summary,
};
use tempfile::TempDir;

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::View(options) => run(&options),
        other => other.refuse(),
    })
}

fn run(options: &Options) -> Result<ExitCode> {
    let loaded = settings::load(options.settings.as_deref(), &options.set)?;
    let program = Program::open(&options.file)?;
    let name = match options.file.file_name() {
        Some(name) if !options.file.is_standard_input() => name,
        _ => OsStr::new("standard input"),
    };
    let name = name.to_string_lossy();
    let named = options.output.as_ref().or(options.picture.as_ref());
    let stop = interrupt::interruptions()?;
    let folder = named.is_none().then(temporary).transpose()?;
    let path = match (named, &folder) {
        (Some(path), _) => path.to_path_buf(),
        (None, Some(folder)) => folder.path().join(page_name(&name)),
        (None, None) => bail!("no file is named"),
    };
    let mut output = Output::create(&path)?;
    remove_when(stop, &output, folder.as_ref());
    let mut simulator = Box::new(Simulator::new(&loaded.settings));
    if options.switches {
        SwitchPositions::of(&loaded.settings).mount_on(&mut simulator);
    }
    play::unlock(&mut simulator);
    let mut recording = Recording::new(simulator.session());
    let run = Run {
        bar: output::progress(program.length(), "bytes"),
        prints: true,
        recorder: &mut recording,
    };
    let figures = play::stream(program, &mut simulator, run)?;
    if figures.lines == 0 {
        ui::warning(&format!("{name} is empty"));
    }
    summary::print_faults(&figures);
    let is_clean = figures.is_clean();
    text::row("motion time", &duration(figures.whole_time_s()));
    if let Some(parts) = figures.times.text() {
        text::row("of it", &parts);
    }
    let job = recording.finish(&figures, &name, &loaded.settings);
    let (what, page) = match &options.picture {
        Some(_) => ("picture", picture::draw(&job)),
        None => ("page", page::write(&job)),
    };
    output
        .write_all(page.as_bytes())
        .with_context(|| format!("cannot write the {what}"))?;
    output.finish()?;
    folder.map(TempDir::keep);
    let (size, pieces) = (page.len() as u64, job.path.vertices as u64);
    println!(
        "{what:>16}  {} bytes, {} points: {}",
        separated(size),
        separated(pieces),
        path.display()
    );
    if named.is_none() && !options.no_open {
        ui::status("Opening", &path.display().to_string());
        ui::open(path.as_os_str());
    }
    Ok(ExitCode::from(u8::from(!is_clean)))
}

/// Where a page lies that nobody has named: in a folder of its own, so that nobody else has put it there.
fn temporary() -> Result<TempDir> {
    tempfile::Builder::new()
        .prefix("leadscrew-view-")
        .tempdir()
        .context("cannot make a temporary folder")
}

/// Has Ctrl-C leave neither a page that is half written nor the folder for it.
fn remove_when(stop: UnixStream, output: &Output, folder: Option<&TempDir>) {
    let folder = folder.map(|folder| folder.path().to_owned());
    interrupt::remove_when(stop, output.partial().into_iter().chain(folder).collect());
}

/// The file of the page of a program.
fn page_name(program: &str) -> String {
    let stem = program.replace(
        |letter: char| !letter.is_ascii_alphanumeric() && letter != '.',
        "-",
    );
    format!("{stem}.html")
}
