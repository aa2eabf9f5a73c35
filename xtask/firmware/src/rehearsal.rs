//! The firmware of a board on models of its chip: `tests/virtual_board`, in a workspace of its own.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use crate::{
    boards::{Board, compile, layout, rates},
    image, release,
    released::Released,
};
use anyhow::{Context, Result, bail, ensure};
use board_data::Input;
use common::{cargo, tools, ui};

/// The program that every board runs, and a homing cycle with short axes: its file, its settings, what the simulator is
/// asked for beside them.
const PROGRAM: &str = "examples/plate.nc";
const HOMING: &str = "$H\n";
const HOMING_SETTINGS: [&str; 4] = ["$22=1", "$130=4", "$131=4", "$132=4"];

/// How a board is rehearsed.
#[derive(Debug, Clone, Copy)]
pub struct Options<'a> {
    /// `--short`: only what matters most, without programs; `--start`: only that it starts and moves.
    pub extent: Option<&'static str>,
    /// Every line from the firmware is shown.
    pub shows_lines: bool,
    /// Where Cargo builds the firmware.
    pub into: &'a Path,
    /// The folder of a release whose files are taken instead.
    pub from: Option<&'a Path>,
}

/// Rehearses a board with as many axes as were asked for; returns what it did, a line for each part.
pub fn rehearse(board: &Board, options: Options<'_>) -> Result<String> {
    // The simulator's, before anything is asked of it.
    cargo::ask_for_clock(board.chip.clocks.core_mhz);
    let (elf, mut files) = match options.from {
        Some(folder) => of_release(board, folder)?,
        None => built(board, options.into)?,
    };
    let mut command = virtual_board(board, &elf)?;
    // Of two methods that take the same file, the first one's is at hand.
    files.dedup();
    for file in files {
        command.arg("--file").arg(file);
    }
    if let Some(extent) = options.extent {
        command.arg(extent);
    } else {
        for job in jobs(board, &elf.with_extension("jobs"))? {
            command.args(["--job", &job]);
        }
    }
    if options.shows_lines {
        command.arg("--lines");
    }
    let output = command.stderr(Stdio::inherit()).output();
    let output = output.context("the models of chips cannot be started")?;
    let text = String::from_utf8_lossy(&output.stdout);
    let axes = cargo::axes();
    ensure!(
        output.status.success(),
        "{} with {axes} axes is not as it should be\n{}",
        board.name,
        text.trim_end()
    );
    Ok(text.trim_end().to_owned())
}

/// The ELF file of a release, and the files for all methods of the board.
fn of_release(board: &Board, folder: &Path) -> Result<(PathBuf, Vec<PathBuf>)> {
    let released = Released::open(folder)?;
    let methods = release::flashing(board);
    let files = methods.iter().map(|method| released.file(board, method));
    Ok((released.elf(board)?, files.collect::<Result<_>>()?))
}

/// The same of a firmware that is built.
fn built(board: &Board, into: &Path) -> Result<(PathBuf, Vec<PathBuf>)> {
    let elf = build(board, into)?;
    let files = release::write(board, &elf)?.into_iter();
    Ok((elf, files.map(|(_, file)| file).collect()))
}

/// What serves a board to a sender at an address, by `--tcp` or `--usbip`.
pub fn served(board: &Board, by: &str, address: &str) -> Result<Command> {
    let mut command = virtual_board(board, &build(board, &cargo::target_dir())?)?;
    command.args([by, address]);
    Ok(command)
}

/// What runs the firmware of a board.
fn virtual_board(board: &Board, elf: &Path) -> Result<Command> {
    let axes = cargo::axes().to_string();
    let mut command = tools::command(tools::VIRTUAL_BOARD)?;
    command.args(["--board", &board.argument(), "--axes", &axes, "--elf"]);
    command.arg(elf);
    Ok(command)
}

/// Builds the firmware of a board, with the step rate in it that is proven.
fn build(board: &Board, into: &Path) -> Result<PathBuf> {
    let axes = cargo::axes();
    let mut firmware = compile::image_in(into, board, &[])?;
    layout::check(board, &firmware)?;
    let rates = rates::read()?;
    // A file elsewhere may have the name of one of the project's.
    let is_own = board.file == board_data::Board::path(&board.name, cargo::root());
    let rate = rates.get(&board.name).filter(|_| is_own);
    match rate.and_then(|of| of.get(usize::from(axes) - 3)) {
        Some(&hz) => image::write(&mut firmware, hz)?,
        None => ui::warning(
            "no proven step rate is known: the firmware keeps to 30 000 steps per second",
        ),
    }
    let elf = compile::place(board, "-rehearsed");
    compile::replace(&elf, &firmware)?;
    Ok(elf)
}

/// The programs that a board runs, each with the simulator's step events and its settings. Motors that are driven by
/// phases have no steps; more axes than three move as three do.
fn jobs(board: &Board, folder: &Path) -> Result<Vec<String>> {
    let axes = cargo::axes();
    let Some(wiring) = board.wiring(axes.into()) else {
        bail!("{} has no {axes} axes", board.name);
    };
    if axes != 3 || wiring.step.is_empty() {
        return Ok(Vec::new());
    }
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let program = cargo::root().join(PROGRAM);
    let mut jobs = vec![job(&program, &folder.join("program.csv"), &[], &[])?];
    // The simulator's second motor closes a switch of its own. One that is polled is seen up to 1 ms later, some steps
    // more or less.
    let polled = wiring.polled();
    let has_polled_limit = polled.iter().any(|input| matches!(input, Input::Limit(_)));
    if wiring.second.is_empty() && !has_polled_limit {
        let homing = folder.join("homing.nc");
        fs::write(&homing, HOMING).with_context(|| format!("cannot write {}", homing.display()))?;
        let with = ["--locked", "--switches"];
        let events = folder.join("homing.csv");
        jobs.push(job(&homing, &events, &HOMING_SETTINGS, &with)?);
    }
    Ok(jobs)
}

/// Has the simulator write the step events of a program.
fn job(program: &Path, events: &Path, settings: &[&str], with: &[&str]) -> Result<String> {
    let mut command = tools::command(tools::SIM)?;
    command.arg(program).arg("--trace").arg(events).args(with);
    for setting in settings {
        command.args(["--set", setting]);
    }
    cargo::wait(command.stdout(Stdio::null()))?;
    let words = [program, events].map(|path| path.to_string_lossy().into_owned());
    let settings = settings.iter().map(|setting| (*setting).to_owned());
    Ok(words
        .into_iter()
        .chain(settings)
        .collect::<Vec<_>>()
        .join(","))
}
