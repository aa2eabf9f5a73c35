//! The firmware with what is proven of it: an ELF file for each board.
#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

pub mod boards;
pub mod drive;
pub mod flash;
pub mod image;
mod licenses;
pub mod rehearsal;
pub mod release;
pub mod released;

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use crate::boards::{
    Board,
    compile::{self, copy_next_to, place, replace},
};
use anyhow::{Context, Result};
use common::{cargo, text::separated, tools, ui};

/// Builds the firmware for `board`, proves it, and returns its ELF file with what is proven in it.
pub fn proven(board: &Board) -> Result<PathBuf> {
    let (elf, proof) = prove_with(board, &[], "")?;
    proof.map(|()| elf)
}

/// As [`proven`], for what moves nothing: when nothing can be proven, the firmware says so itself.
pub fn firmware(board: &Board) -> Result<PathBuf> {
    proven_if_possible(board, &[], "")
}

fn proven_if_possible(board: &Board, options: &[&str], suffix: &str) -> Result<PathBuf> {
    let (elf, proof) = prove_with(board, options, suffix)?;
    if let Err(error) = proof {
        ui::warning(&format!("{error:#}"));
    }
    Ok(elf)
}

/// Builds and proves a firmware and writes the proven step rate into the file. Also returns the failures of the proof.
///
/// The file is whole at any time, for somebody may boot it: no firmware takes the place of a proven
/// one before it is proven.
fn prove_with(board: &Board, options: &[&str], suffix: &str) -> Result<(PathBuf, Result<()>)> {
    let elf = place(board, suffix);
    let (image, proof) = prove_in(&cargo::target_dir(), board, options, &elf)?;
    replace(&elf, &image)?;
    Ok((elf, proof.map(|_| ())))
}

/// The same with what Cargo builds in a folder, and without writing the file. Returns its contents, and the proven step
/// rate, Hz, which is in them.
fn prove_in(
    into: &Path,
    board: &Board,
    options: &[&str],
    elf: &Path,
) -> Result<(Vec<u8>, Result<u32>)> {
    let mut image = compile::image_in(into, board, options)?;
    let copy = copy_next_to(elf, &image)?;
    let proof = prove(&copy, board).and_then(|hz| image::write(&mut image, hz).map(|()| hz));
    fs::remove_file(&copy).with_context(|| format!("cannot remove {}", copy.display()))?;
    Ok((image, proof))
}

/// The step rate that a firmware is proven for.
fn prove(elf: &Path, board: &Board) -> Result<u32> {
    let hz = rate(elf, &board.argument())
        .context("no step rate is proven: `--unproven` builds the firmware all the same")?;
    let rate = separated(hz.into());
    ui::status(
        "Proven",
        &format!("{} for {rate} steps per second", board.name),
    );
    Ok(hz)
}

/// The step rate that the analysis of an image proves.
fn rate(elf: &Path, board: &str) -> Result<u32> {
    let mut arguments = ["--rate", "--board", board, "--elf"]
        .map(OsStr::new)
        .to_vec();
    arguments.push(elf.as_os_str());
    let rate = tools::output(tools::SCHEDULE, arguments)?;
    rate.parse().context("the analysis gives no rate")
}

/// Builds the firmware that also speaks to hosts of 3D printers, `$780=1`, as [`firmware`].
pub fn for_hosts(board: &Board) -> Result<PathBuf> {
    proven_if_possible(board, &["--features", "reprap"], "-reprap")
}

/// Builds the firmware that records its activations, see `src/board/trace.rs`.
pub fn traced(board: &Board) -> Result<PathBuf> {
    proven_if_possible(board, &["--features", "trace"], "-trace")
}

/// Copies a firmware and declares the copy proven for a step rate: for experiments at rates without a proof.
pub fn as_if_proven(elf: &Path, hz: u32) -> Result<PathBuf> {
    let copy = elf.with_extension(format!("{hz}-hz.elf"));
    write_rate(elf, &copy, hz)?;
    Ok(copy)
}

/// Writes a copy of a firmware with a step rate in it.
fn write_rate(elf: &Path, copy: &Path, hz: u32) -> Result<()> {
    let mut image = compile::read(elf)?;
    image::write(&mut image, hz).with_context(|| format!("{}", elf.display()))?;
    replace(copy, &image)
}
