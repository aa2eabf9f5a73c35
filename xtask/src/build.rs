//! `cargo xtask build`: the firmware, as an ELF file for each board.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{self, ExitCode},
    sync::atomic::{AtomicU32, Ordering},
};

use anyhow::{Context, Result};
use leadscrew::axis::AXES;

use crate::{
    boards::{self, Board},
    cargo,
    figures::separated,
    proof, ui,
};

/// Copies that this program has made.
static COPIES: AtomicU32 = AtomicU32::new(0);

/// Build the firmware
///
/// Leaves `target/firmware/BOARD.elf`, with the step rate in it for which its timing is proven, and
/// fails when it cannot be proven. Asks rustup for the compiler's target when it is missing.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The board; every board without it
    #[arg(long, value_name = "NAME")]
    board: Option<String>,
    /// Prove nothing: the firmware then keeps to 30 000 steps per second
    #[arg(long)]
    unproven: bool,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    for board in boards::chosen(options.board.as_deref())? {
        let elf = if options.unproven {
            compile(&board)?
        } else {
            proven(&board)?
        };
        ui::status("Built", &elf.display().to_string());
    }
    Ok(ExitCode::SUCCESS)
}

/// Builds the firmware for `board`, proves it, and returns its ELF file with what is proven in it.
pub(crate) fn proven(board: &Board) -> Result<PathBuf> {
    let (elf, proof) = prove_with(board, &[], "")?;
    proof.map(|()| elf)
}

/// As [`proven`], for what moves nothing: when nothing can be proven, the firmware says so itself.
pub(crate) fn firmware(board: &Board) -> Result<PathBuf> {
    proven_if_possible(board, &[], "")
}

fn proven_if_possible(board: &Board, options: &[&str], suffix: &str) -> Result<PathBuf> {
    let (elf, proof) = prove_with(board, options, suffix)?;
    if let Err(error) = proof {
        ui::warning(&format!("{error:#}"));
    }
    Ok(elf)
}

/// Builds a firmware, proves it and writes what is proven into it; also gives what of that failed.
///
/// The file is whole at any time, for somebody may boot it: no firmware takes the place of a proven
/// one before it is proven.
fn prove_with(board: &Board, options: &[&str], suffix: &str) -> Result<(PathBuf, Result<()>)> {
    let mut image = build(board, AXES as u8, options)?;
    let elf = place(board, suffix);
    let copy = copy_beside(&elf, &image)?;
    let proof = prove(&copy, board).and_then(|hz| proof::write(&mut image, hz));
    fs::remove_file(&copy).with_context(|| format!("cannot remove {}", copy.display()))?;
    replace(&elf, &image)?;
    Ok((elf, proof))
}

/// The step rate that a firmware is proven for.
fn prove(elf: &Path, board: &Board) -> Result<u32> {
    let hz = proof::prove(elf, board)
        .context("no step rate is proven: `--unproven` builds the firmware all the same")?;
    let rate = separated(hz.into());
    ui::status(
        "Proven",
        &format!("{} for {rate} steps per second", board.name),
    );
    Ok(hz)
}

/// Builds the firmware for `board`, of which nothing is proven, and returns its ELF file.
pub(crate) fn compile(board: &Board) -> Result<PathBuf> {
    compile_for(board, AXES as u8)
}

/// The same with another number of axes than this program has.
pub(crate) fn compile_for(board: &Board, axes: u8) -> Result<PathBuf> {
    let suffix = if usize::from(axes) == AXES {
        String::new()
    } else {
        format!("-{axes}-axes")
    };
    let elf = place(board, &suffix);
    replace(&elf, &build(board, axes, &[])?)?;
    Ok(elf)
}

/// Builds the firmware that records its activations, see `src/board/trace.rs`.
pub(crate) fn traced(board: &Board) -> Result<PathBuf> {
    proven_if_possible(board, &["--features", "trace"], "-trace")
}

/// The same for the emulated board, by the emulator's clock.
pub(crate) fn traced_for_emulator(board: &Board) -> Result<PathBuf> {
    let options = ["--features", "trace-emulated"];
    proven_if_possible(board, &options, "-trace-emulated")
}

/// Has Cargo build a firmware, and returns the ELF file's contents.
fn build(board: &Board, axes: u8, options: &[&str]) -> Result<Vec<u8>> {
    cargo::need_target()?;
    let mut command = cargo::cargo(&["build", "--release", "--bin", "leadscrew"]);
    command.args(cargo::for_board_with(board, axes));
    cargo::wait(command.args(options))?;
    let built = cargo::target_dir().join(cargo::TARGET);
    read(&built.join("release/leadscrew"))
}

/// Where a firmware is kept: Cargo gives every board's program the same name.
fn place(board: &Board, suffix: &str) -> PathBuf {
    let folder = cargo::target_dir().join("firmware");
    folder.join(format!("{}{suffix}.elf", board.name))
}

/// Copies a firmware and lets the copy say that it is proven for a step rate: for what finds out
/// what happens at rates that are not.
pub(crate) fn as_if_proven(elf: &Path, hz: u32) -> Result<PathBuf> {
    let copy = elf.with_extension(format!("{hz}-hz.elf"));
    write_rate(elf, &copy, hz)?;
    Ok(copy)
}

/// Writes a copy of a firmware with a step rate in it.
fn write_rate(elf: &Path, copy: &Path, hz: u32) -> Result<()> {
    let mut image = read(elf)?;
    proof::write(&mut image, hz).with_context(|| format!("{}", elf.display()))?;
    replace(copy, &image)
}

fn read(elf: &Path) -> Result<Vec<u8>> {
    fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))
}

/// Writes a file: under another name first, because an emulator may be reading the one that is
/// there.
fn replace(elf: &Path, image: &[u8]) -> Result<()> {
    let copy = copy_beside(elf, image)?;
    fs::rename(&copy, elf).with_context(|| format!("cannot write {}", elf.display()))
}

/// Writes a file beside another one, under a name that nobody knows.
fn copy_beside(elf: &Path, image: &[u8]) -> Result<PathBuf> {
    let number = COPIES.fetch_add(1, Ordering::Relaxed);
    let copy = elf.with_extension(format!("{}-{number}", process::id()));
    let folder = elf.parent().unwrap_or(elf);
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(&copy, image))
        .with_context(|| format!("cannot write {}", copy.display()))?;
    Ok(copy)
}
