//! The virtual machine on the emulated processor, instead of this computer's.

use std::{
    fs::{self, File},
    io::{BufRead, BufReader, BufWriter, Write},
    path::{Path, PathBuf},
    process::{self, ExitCode},
    str::FromStr,
    time::Instant,
};

use anyhow::{Context, Result, bail, ensure};
use common::options::SimOnTarget as Options;
use common::{
    cargo::{self, cargo},
    text, ui,
};
use firmware::boards::Board;
use leadscrew::{axis::AXES, units::TICKS_PER_SECOND};
use serde_json::Value;
use simulation::{
    figures::{Figures, Final},
    output,
    program::Program,
    sender::Response,
    settings::{self, Loaded},
    summary,
};
use target::emulator::semihosting;

/// The test program that holds the virtual machine.
const TEST: &str = "target_sim";

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let loaded = settings::load(None, &options.set)?;
    let start = Instant::now();
    let figures = play(&options.file, &loaded)?;
    let took_s = start.elapsed().as_secs_f64();
    summary::print(&figures);
    text::row("took", &format!("{took_s:.2} s, with the build"));
    if let Some(path) = &options.json {
        output::write_json(path, &figures)?;
    }
    Ok(ExitCode::from(u8::from(!figures.is_clean())))
}

/// Runs a program on the virtual machine in QEMU.
pub(crate) fn play(path: &Path, loaded: &Loaded) -> Result<Figures> {
    let folder = tempfile::tempdir().context("there is no room for the files of the run")?;
    let folder = folder.path();
    let lines = write_program(path, &folder.join("program.nc"))?;
    let mut settings = format!("{}\n", loaded.settings.step_rate.in_image());
    for statement in &loaded.statements {
        settings.push_str(statement);
        settings.push('\n');
    }
    fs::write(folder.join("settings.txt"), settings).context("cannot write the settings")?;
    let (board, _) = firmware::boards::emulated()?;
    let elf = build(&board, TEST)?;
    ui::status("Emulating", &format!("{} ({lines} lines)", path.display()));
    semihosting::output(&elf, folder)?;
    let results = folder.join("figures.txt");
    let file = File::open(&results).context("the emulated machine has written no figures")?;
    read_figures(BufReader::new(file), loaded)
}

/// Copies a program as a sender would send it; returns the number of lines.
fn write_program(from: &Path, to: &Path) -> Result<u64> {
    let mut program = Program::open(from)?;
    let file = File::create(to).with_context(|| format!("cannot create {}", to.display()))?;
    let mut writer = BufWriter::new(file);
    let mut lines = 0;
    while let Some(mut line) = program.next_line()? {
        line.push(b'\n');
        writer.write_all(&line)?;
        lines += 1;
    }
    writer.flush()?;
    Ok(lines)
}

/// Builds a test program for a board, and returns its ELF file.
pub(crate) fn build(board: &Board, test: &str) -> Result<PathBuf> {
    cargo::need_target()?;
    ui::status("Building", &format!("tests/{test}.rs for {}", board.name));
    let mut command = cargo(&["build", "--release", "--example", test]);
    board.compile(&mut command);
    command.arg("--message-format=json-render-diagnostics");
    let output = command
        .stderr(process::Stdio::inherit())
        .output()
        .context("cannot start cargo")?;
    ensure!(output.status.success(), "tests/{test}.rs does not compile");
    let messages = output.stdout.split(|byte| *byte == b'\n');
    let elf = messages
        .filter_map(|line| serde_json::from_slice::<Value>(line).ok())
        .find(|message| message["target"]["name"] == test && message["executable"].is_string());
    let elf = elf.context("cargo names no executable")?;
    Ok(PathBuf::from(
        elf["executable"].as_str().unwrap_or_default(),
    ))
}

/// Reads what `tests/target_sim.rs` writes.
fn read_figures(lines: impl BufRead, loaded: &Loaded) -> Result<Figures> {
    let mut figures = Figures::default();
    for line in lines.lines() {
        let line = line.context("cannot read the figures")?;
        let (name, value) = line.split_once(' ').unwrap_or((&line, ""));
        let end = &mut figures.end;
        match name {
            "answer" => {
                let response = Response::parse(value);
                let response = response.with_context(|| format!("{value:?} is no answer"))?;
                figures.responses.push(response);
            }
            "message" => {
                let (answers, text) = value.split_once(' ').unwrap_or((value, ""));
                // The welcome belongs to power-up, not to the program.
                if !text.starts_with("Grbl ") {
                    figures.messages.push((number(answers)?, text.into()));
                }
            }
            "end" if value == "Complete" => {}
            "end" => bail!("the machine stands still and does not go on"),
            "lines" => figures.lines = number(value)?,
            "state" => end.state = state(value),
            "steps" => end.steps.push(number(value)?),
            "pulses" => figures.steps_axis.push(number(value)?),
            "ticks" => {
                figures.motion_time_s = number::<u64>(value)? as f64 / f64::from(TICKS_PER_SECOND);
            }
            "events" => figures.events = number(value)?,
            "late" => figures.late = number(value)?,
            "hash" => figures.event_hash = value.into(),
            _ => bail!("the figures hold {line:?}"),
        }
    }
    // What the emulated machine does not write would be 0: the compiler asks for each new figure here.
    let Figures {
        lines: _,
        responses: _,
        messages: _,
        end: _,
        steps_axis: _,
        motion_time_s: _,
        events: _,
        late: _,
        event_hash: _,
        times: _,
        refusals: _,
        foreign_line: _,
    } = &figures;
    ensure!(
        figures.end.steps.len() == AXES,
        "the emulated machine has written half its figures"
    );
    figures.end = Final::new(figures.end.state, &figures.end.steps, &loaded.settings);
    Ok(figures)
}

fn number<T: FromStr>(text: &str) -> Result<T> {
    let value = text.parse().ok();
    value.with_context(|| format!("{text:?} is no number"))
}

/// Grbl's name of a state, from the library's.
fn state(name: &str) -> String {
    match name {
        "HoldSlowing" => "Hold:1".into(),
        "HoldComplete" => "Hold:0".into(),
        name => name.into(),
    }
}
