//! What bootloaders, probes and the drive of an ST-LINK make of a file, by its ending, with what they refuse.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use board_data::Board;
use formats::read::{self, OwnedPart};

/// Start of every chip's flash and RAM.
const FLASH: u32 = 0x0800_0000;
const RAM: u32 = 0x2000_0000;
/// The RAM within which FYSETC's bootloader wants the stack.
const FYSETC_RAM: u32 = 0x2_0000;

/// Reads a file as the board's loader takes it.
///
/// # Errors
/// The loader would refuse it.
pub(crate) fn read(path: &Path, board: &Board, start: u32) -> Result<Vec<OwnedPart>> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let kind = path.extension().unwrap_or_default().to_string_lossy();
    let parts = match &*kind {
        "hex" => read::hex(&bytes),
        "dfu" => read::dfuse(&bytes).map(|file| file.parts),
        "uf2" => read::uf2(&bytes, board.uf2_family.context("the board takes no UF2")?),
        _ => flat(bytes, start),
    };
    let parts = parts.with_context(|| format!("{}", path.display()))?;
    let end = FLASH + board.part.flash_kib * 1024;
    for (address, bytes) in &parts {
        let is_within = *address >= start && address + bytes.len() as u32 <= end;
        ensure!(
            is_within,
            "{address:#x} is in a bootloader, or outside of the flash"
        );
    }
    Ok(parts)
}

fn word(bytes: &[u8], at: usize) -> Result<u32> {
    let word = bytes.get(at..at + 4).context("the file is cut")?;
    Ok(u32::from_le_bytes(word.try_into()?))
}

/// A bootloader writes the file of an SD card unchanged, if the vectors are plausible: BIGTREETECH's checks the reset
/// vector, FYSETC's the stack.
fn flat(bytes: Vec<u8>, start: u32) -> Result<Vec<OwnedPart>> {
    let (stack, reset) = (word(&bytes, 0)?, word(&bytes, 4)?);
    ensure!(
        reset & 0xff00_0000 == FLASH,
        "the reset vector is {reset:#x}"
    );
    ensure!(
        stack.wrapping_sub(RAM) <= FYSETC_RAM,
        "the stack is at {stack:#x}"
    );
    Ok(vec![(start, bytes)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_file_without_vectors_at_its_start_is_refused() {
        let file = |stack: u32, reset: u32| [stack, reset].map(u32::to_le_bytes).concat();
        assert!(flat(file(0x2002_0000, 0x0800_8101), 0x0800_8000).is_ok());
        for wrong in [
            file(0x2002_0000, 0x0000_8101),
            file(0x1000_0000, 0x0800_8101),
            vec![0; 7],
        ] {
            assert!(flat(wrong, 0x0800_8000).is_err());
        }
    }
}
