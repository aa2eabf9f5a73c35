//! `cargo xtask build`: the firmware, as an ELF file for each board.

use std::{fs, path::PathBuf, process::ExitCode};

use anyhow::{Context, Result};

use crate::{
    boards::{self, Board},
    cargo, ui,
};

/// Build the firmware
///
/// Leaves `target/firmware/BOARD.elf`. Asks rustup for the compiler's target when it is missing.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The board; every board without it
    #[arg(long, value_name = "NAME")]
    board: Option<String>,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    for board in boards::chosen(options.board.as_deref())? {
        let elf = firmware(&board)?;
        ui::status("Built", &elf.display().to_string());
    }
    Ok(ExitCode::SUCCESS)
}

/// Builds the firmware for `board` and returns its ELF file.
///
/// Cargo gives every board's program the same name, so each is copied to one of its own.
pub(crate) fn firmware(board: &Board) -> Result<PathBuf> {
    cargo::need_target()?;
    let mut command = cargo::cargo(&["build", "--release", "--bin", "leadscrew"]);
    cargo::wait(command.args(cargo::for_board(board)))?;
    let folder = cargo::target_dir().join("firmware");
    let elf = folder.join(format!("{}.elf", board.name));
    let built = cargo::target_dir()
        .join(cargo::TARGET)
        .join("release/leadscrew");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    fs::copy(&built, &elf)
        .with_context(|| format!("cannot copy {} to {}", built.display(), elf.display()))?;
    Ok(elf)
}
