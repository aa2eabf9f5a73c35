//! The file that a board's bootloader takes from the SD card: the flash from the program's start on.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use boards::{Board, compile};
use object::{
    LittleEndian,
    elf::{FileHeader32, PT_LOAD},
    read::elf::{FileHeader as _, ProgramHeader as _},
};

/// The value of flash that nothing is written to.
const ERASED: u8 = 0xff;

/// Writes the file of a board whose bootloader wants one, beside its ELF file, and returns its path.
pub fn write(board: &Board, elf: &Path) -> Result<Option<PathBuf>> {
    let Some(name) = &board.bootloader_file else {
        return Ok(None);
    };
    let image = compile::read(elf)?;
    let segments = segments(&image).with_context(|| format!("{}", elf.display()))?;
    let memory = &board.memory;
    let flash = flat(&segments, memory.flash_start, memory.flash_bytes)?;
    let file = elf.with_extension("").join(name);
    compile::replace(&file, &flash)?;
    Ok(Some(file))
}

/// What the chip's flash has to hold: addresses with their bytes.
fn segments(image: &[u8]) -> Result<Vec<(u32, &[u8])>> {
    let header = FileHeader32::<LittleEndian>::parse(image).context("this is no ELF file")?;
    let endian = header.endian()?;
    let all = header.program_headers(endian, image)?.iter();
    let loaded =
        all.filter(|segment| segment.p_type(endian) == PT_LOAD && segment.p_filesz(endian) > 0);
    loaded
        .map(|segment| {
            let bytes = segment.data(endian, image);
            let bytes = bytes.map_err(|()| anyhow::anyhow!("a segment is not in the file"))?;
            Ok((segment.p_paddr(endian), bytes))
        })
        .collect()
}

/// Returns the flash from an address on, up to the last byte of the segments.
fn flat(segments: &[(u32, &[u8])], start: u32, most_bytes: u32) -> Result<Vec<u8>> {
    let mut flash = Vec::new();
    for (address, bytes) in segments {
        let offset = address.checked_sub(start).filter(|offset| {
            let end = u64::from(*offset) + bytes.len() as u64;
            end <= u64::from(most_bytes)
        });
        let offset =
            offset.with_context(|| format!("{address:#x} is not in the program's flash"))?;
        let place = offset as usize..offset as usize + bytes.len();
        if flash.len() < place.end {
            flash.resize(place.end, ERASED);
        }
        flash[place].copy_from_slice(bytes);
    }
    // RM0090 2.4: the first word is the stack's, the second the address of the first instruction.
    let reset = flash.get(4..8).and_then(|word| word.first_chunk());
    let reset = u32::from_le_bytes(*reset.context("the program has no vectors at its start")?);
    let is_own = (start..start + flash.len() as u32).contains(&reset);
    ensure!(is_own, "the program does not begin with its vectors");
    Ok(flash)
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: u32 = 0x0800_8000;

    /// The two vectors of a program that begins behind them.
    fn vectors(reset: u32) -> Vec<u8> {
        [0x2002_0000, reset].map(u32::to_le_bytes).concat()
    }

    #[test]
    fn the_file_has_each_segment_at_its_place_and_nothing_between() {
        let vectors = vectors(START + 0x11);
        let segments = [(START + 16, &[1, 2, 3][..]), (START, &vectors)];
        let flash = flat(&segments, START, 32).unwrap();
        let hole = [ERASED; 8];
        assert_eq!(flash, [&vectors, &hole[..], &[1, 2, 3]].concat());
    }

    #[test]
    fn a_program_that_the_bootloader_could_not_start_is_refused() {
        let right = vectors(START + 9);
        for (address, bytes, most_bytes, reason) in [
            (START - 16, &right, 32, "not in the program's flash"),
            (START + 28, &right, 32, "not in the program's flash"),
            (
                START,
                &vectors(0x0800_0101),
                32,
                "does not begin with its vectors",
            ),
            (START, &vec![0; 4], 32, "no vectors"),
        ] {
            let error = flat(&[(address, bytes)], START, most_bytes).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }
}
