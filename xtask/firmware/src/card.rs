//! The file that a board's bootloader takes from the SD card: the flash from the program's start on.

use std::path::{Path, PathBuf};

use crate::{
    boards::{Board, compile, image::parts, layout},
    formats,
};
use anyhow::{Context, Result};

/// Writes the file of a board whose bootloader wants one, beside its ELF file, and returns its path.
pub fn write(board: &Board, elf: &Path) -> Result<Option<PathBuf>> {
    let Some(name) = &board.bootloader_file else {
        return Ok(None);
    };
    let image = compile::read(elf)?;
    layout::check(board, &image).with_context(|| format!("{}", elf.display()))?;
    let flash = formats::flat(&parts(&image)?, board.chosen_memory().flash_start);
    let file = elf.with_extension("").join(name);
    compile::replace(&file, &flash)?;
    Ok(Some(file))
}
