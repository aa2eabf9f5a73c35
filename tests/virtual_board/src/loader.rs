//! What bootloaders, probes and the drive of an ST-LINK make of a file, by its ending, with what they refuse.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use board_data::Board;
use ihex::{Reader, Record};

/// Bytes at an address of the flash.
type Part = (u32, Vec<u8>);

/// Start of every chip's flash and RAM.
const FLASH: u32 = 0x0800_0000;
const RAM: u32 = 0x2000_0000;
/// The RAM within which FYSETC's bootloader wants the stack.
const FYSETC_RAM: u32 = 0x2_0000;

/// Reads a file as the board's loader takes it.
///
/// # Errors
/// The loader would refuse it.
pub(crate) fn read(path: &Path, board: &Board, start: u32) -> Result<Vec<Part>> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let kind = path.extension().unwrap_or_default().to_string_lossy();
    let parts = match &*kind {
        "hex" => hex(&bytes),
        "dfu" => dfuse(&bytes),
        "uf2" => uf2(&bytes, board.uf2_family.context("the board takes no UF2")?),
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
fn flat(bytes: Vec<u8>, start: u32) -> Result<Vec<Part>> {
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

/// Records of a hex file, each with a checksum.
fn hex(bytes: &[u8]) -> Result<Vec<Part>> {
    let mut parts: Vec<Part> = Vec::new();
    let (mut upper, mut has_ended) = (0, false);
    for record in Reader::new(std::str::from_utf8(bytes)?) {
        match record? {
            Record::ExtendedLinearAddress(address) => upper = u32::from(address) << 16,
            Record::Data { offset, value } => {
                let at = upper | u32::from(offset);
                match parts.last_mut() {
                    Some((start, bytes)) if *start + bytes.len() as u32 == at => {
                        bytes.extend(value);
                    }
                    _ => parts.push((at, value)),
                }
            }
            Record::EndOfFile => has_ended = true,
            other => anyhow::bail!("a record of another kind: {other:?}"),
        }
    }
    ensure!(has_ended, "the file is cut");
    Ok(parts)
}

/// The checks of dfu-util, and the elements that the bootloader in the ROM gets: USB DFU 1.1, appendix B; ST UM0391.
fn dfuse(bytes: &[u8]) -> Result<Vec<Part>> {
    const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_JAMCRC);
    let suffix = bytes.len().checked_sub(16).context("the file is cut")?;
    ensure!(
        &bytes[suffix + 8..suffix + 12] == b"UFD\x10",
        "there is no suffix"
    );
    ensure!(
        word(bytes, suffix + 12)? == CRC.checksum(&bytes[..suffix + 12]),
        "the CRC is wrong"
    );
    // The device of the ROM, and the version of the format.
    ensure!(
        word(bytes, suffix + 2)? == 0x0483_df11,
        "it is for another device"
    );
    ensure!(
        bytes[suffix + 6..suffix + 8] == [0x1a, 0x01],
        "it is not of DfuSe"
    );
    ensure!(bytes.starts_with(b"DfuSe\x01"), "there is no prefix");
    ensure!(
        word(bytes, 6)? as usize == suffix,
        "its length is another one"
    );
    ensure!(
        bytes[10] == 1 && &bytes[11..18] == b"Target\0",
        "it has other targets"
    );
    let mut parts = Vec::new();
    let mut at = 285;
    for _ in 0..word(bytes, 281)? {
        let (address, length) = (word(bytes, at)?, word(bytes, at + 4)? as usize);
        let data = bytes[..suffix].get(at + 8..at + 8 + length);
        parts.push((address, data.context("an element is cut")?.to_vec()));
        at += 8 + length;
    }
    ensure!(at == suffix, "something is between elements and suffix");
    Ok(parts)
}

/// Blocks of UF2, of which a bootloader leaves those of other families out.
fn uf2(bytes: &[u8], family: u32) -> Result<Vec<Part>> {
    const BLOCK_BYTES: usize = 512;
    let blocks = bytes.chunks(BLOCK_BYTES);
    let count = blocks.len() as u32;
    let mut parts = Vec::new();
    for (number, block) in (0..).zip(blocks) {
        let is_block = block.len() == BLOCK_BYTES
            && word(block, 0)? == 0x0a32_4655
            && word(block, 4)? == 0x9e5d_5157
            && word(block, 508)? == 0x0ab1_6f30;
        ensure!(is_block, "block {number} is none");
        ensure!(
            word(block, 20)? == number && word(block, 24)? == count,
            "a block is missing"
        );
        ensure!(
            word(block, 28)? == family,
            "block {number} is of another family"
        );
        let length = word(block, 16)? as usize;
        let data = block[32..508]
            .get(..length)
            .context("a block is too long")?;
        parts.push((word(block, 12)?, data.to_vec()));
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A record with its checksum.
    fn record(bytes: &[u8]) -> String {
        let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        let bytes = [bytes, &[sum.wrapping_neg()]].concat();
        let digits = bytes.iter().map(|byte| format!("{byte:02X}"));
        format!(":{}\n", digits.collect::<Vec<_>>().concat())
    }

    #[test]
    fn a_hex_file_that_is_cut_or_damaged_is_refused() {
        let upper = record(&[2, 0, 0, 4, 0x08, 0x00]);
        let data = record(&[3, 0x01, 0x00, 0, 7, 8, 9]) + &record(&[1, 0x01, 0x03, 0, 10]);
        let end = record(&[0, 0, 0, 1]);
        let whole = format!("{upper}{data}{end}");
        let parts = hex(whole.as_bytes()).unwrap();
        assert_eq!(parts, [(FLASH + 0x100, vec![7, 8, 9, 10])]);
        let damaged = whole.replace("0708", "0709");
        for wrong in [&format!("{upper}{data}"), &damaged] {
            assert!(hex(wrong.as_bytes()).is_err(), "{wrong}");
        }
    }

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

    #[test]
    fn a_uf2_file_with_a_wrong_block_is_refused() {
        let block = |number: u32, family: u32| {
            let words = [
                0x0a32_4655,
                0x9e5d_5157,
                0x2000,
                FLASH + 256 * number,
                256,
                number,
                2,
                family,
            ];
            let mut block: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            block.resize(508, number as u8);
            block.extend(0x0ab1_6f30_u32.to_le_bytes());
            block
        };
        let parts = uf2(&[block(0, 5), block(1, 5)].concat(), 5).unwrap();
        assert_eq!(parts, [(FLASH, vec![0; 256]), (FLASH + 256, vec![1; 256])]);
        for wrong in [
            [block(0, 5), block(1, 6)].concat(),
            [block(1, 5), block(0, 5)].concat(),
            block(0, 5),
            [block(0, 5), block(1, 5)[..500].to_vec()].concat(),
        ] {
            assert!(uf2(&wrong, 5).is_err());
        }
    }
}
