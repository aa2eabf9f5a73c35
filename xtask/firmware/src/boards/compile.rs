//! The firmware as Cargo builds it, of which nothing is proven: an ELF file for each board.

use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    process,
    sync::atomic::{AtomicU32, Ordering},
};

use anyhow::{Context, Result};
use common::cargo;

use super::{Board, layout, seal};

/// Copies that this program has made.
static COPIES: AtomicU32 = AtomicU32::new(0);

/// Builds the firmware for `board`, of which nothing is proven, and returns its ELF file.
pub fn firmware(board: &Board) -> Result<PathBuf> {
    let elf = place(board, "");
    replace(&elf, &image(board, &[])?)?;
    Ok(elf)
}

/// Has Cargo build a firmware, and returns the ELF file's contents, sealed by their CRC. One that does not lie in
/// the chip's memory as the board's file wants it is refused.
pub fn image(board: &Board, options: &[&str]) -> Result<Vec<u8>> {
    image_in(&cargo::target_dir(), board, options)
}

/// The same, with what Cargo builds in a folder.
pub fn image_in(target: &Path, board: &Board, options: &[&str]) -> Result<Vec<u8>> {
    cargo::need_target()?;
    // Cargo gives every board's program the same name: nobody else may build until it has been read.
    let path = target.join("firmware.lock");
    let lock = fs::create_dir_all(target).and_then(|()| File::create(&path));
    let lock = lock.and_then(|lock| lock.lock().map(|()| lock));
    let _lock = lock.with_context(|| format!("cannot lock {}", path.display()))?;
    let mut command = cargo::cargo(&["build", "--release", "--bin", "leadscrew"]);
    board.compile_into(target, &mut command);
    cargo::wait(command.args(options))?;
    let built = target.join(cargo::TARGET);
    let mut image = read(&built.join("release/leadscrew"))?;
    let refused = || format!("this firmware would not start on the {}", board.title);
    layout::check(board, &image).with_context(refused)?;
    layout::check_board(board, &image).with_context(refused)?;
    seal::seal(&mut image)?;
    Ok(image)
}

/// Where a firmware is kept: Cargo gives every board's program the same name.
pub fn place(board: &Board, suffix: &str) -> PathBuf {
    let folder = cargo::target_dir().join("firmware");
    let machine = if board.is_in_qemu { "-qemu" } else { "" };
    folder.join(format!("{}{machine}{suffix}.elf", board.name))
}

/// Reads a file.
pub fn read(elf: &Path) -> Result<Vec<u8>> {
    fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))
}

/// Writes a file: under another name first, because an emulator may be reading the one that is
/// there.
pub fn replace(elf: &Path, image: &[u8]) -> Result<()> {
    let copy = copy_next_to(elf, image)?;
    fs::rename(&copy, elf).with_context(|| format!("cannot write {}", elf.display()))
}

/// Writes a file beside another one, under a name that nobody knows.
pub fn copy_next_to(elf: &Path, image: &[u8]) -> Result<PathBuf> {
    let number = COPIES.fetch_add(1, Ordering::Relaxed);
    let copy = elf.with_extension(format!("{}-{number}", process::id()));
    let folder = elf.parent().unwrap_or(elf);
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(&copy, image))
        .with_context(|| format!("cannot write {}", copy.display()))?;
    Ok(copy)
}
