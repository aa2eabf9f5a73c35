//! The file that a board's bootloader takes from the SD card: the flash from the program's start on.

use std::path::{Path, PathBuf};

use crate::boards::{Board, compile, image::segments, layout};
use anyhow::{Context, Result};

/// The value of flash that nothing is written to.
const ERASED: u8 = 0xff;

/// Writes the file of a board whose bootloader wants one, beside its ELF file, and returns its path.
pub fn write(board: &Board, elf: &Path) -> Result<Option<PathBuf>> {
    let Some(name) = &board.bootloader_file else {
        return Ok(None);
    };
    let image = compile::read(elf)?;
    layout::check(board, &image).with_context(|| format!("{}", elf.display()))?;
    let segments = segments(&image)?;
    let segments = segments.iter().map(|it| (it.load_address, it.bytes));
    let flash = flat(segments, board.chosen_memory().flash_start);
    let file = elf.with_extension("").join(name);
    compile::replace(&file, &flash)?;
    Ok(Some(file))
}

/// Returns the flash from an address on, up to the last byte of the segments, none of which begins before it.
fn flat<'a>(segments: impl Iterator<Item = (u32, &'a [u8])>, start: u32) -> Vec<u8> {
    let mut flash = Vec::new();
    for (address, bytes) in segments.filter(|(_, bytes)| !bytes.is_empty()) {
        let offset = (address - start) as usize;
        let place = offset..offset + bytes.len();
        if flash.len() < place.end {
            flash.resize(place.end, ERASED);
        }
        flash[place].copy_from_slice(bytes);
    }
    flash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_has_each_segment_at_its_place_and_nothing_between() {
        let start = 0x0800_8000;
        let segments = [
            (start + 8, &[1, 2, 3][..]),
            (start, &[4, 5]),
            (0x2000_0000, &[]),
        ];
        let flash = flat(segments.into_iter(), start);
        assert_eq!(flash, [4, 5, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 2, 3]);
    }
}
