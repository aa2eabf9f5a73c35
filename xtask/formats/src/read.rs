//! What loaders, programmers and probes make of a file, with what they refuse.

use anyhow::{Context as _, Result, bail, ensure};
use ihex::{Reader, ReaderOptions, Record};

use crate::{
    BLOCK_BYTES, DFU_CRC, DFU_PRODUCT, DFU_VENDOR, DFUSE_FORMAT, DFUSE_VERSION, HAS_FAMILY,
    SUFFIX_BYTES, TARGET_NAME_BYTES, UF2_END, UF2_START,
};

/// Bytes at an address of the flash.
pub type OwnedPart = (u32, Vec<u8>);

/// A `DfuSe` file.
#[derive(Debug, PartialEq, Eq)]
pub struct Dfuse {
    /// The name of its target.
    pub name: String,
    /// Its elements.
    pub parts: Vec<OwnedPart>,
}

fn word(bytes: &[u8], at: usize) -> Result<u32> {
    let word = bytes.get(at..at + 4).context("the file is cut")?;
    Ok(u32::from_le_bytes(word.try_into()?))
}

/// Reads the records of a hex file, each with a checksum. Records that follow each other are one part.
pub fn hex(bytes: &[u8]) -> Result<Vec<OwnedPart>> {
    let text = std::str::from_utf8(bytes).context("a hex file is text")?;
    let mut parts: Vec<OwnedPart> = Vec::new();
    let (mut upper, mut has_ended) = (0, false);
    let options = ReaderOptions {
        stop_after_first_error: true,
        stop_after_eof: false,
    };
    for (number, record) in (1..).zip(Reader::new_with_options(text, options)) {
        let record = record.with_context(|| format!("record {number} is wrong"))?;
        ensure!(!has_ended, "record {number} stands behind the last one");
        match record {
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
            other => bail!("record {number} is of another kind: {other:?}"),
        }
    }
    ensure!(has_ended, "the file is cut");
    Ok(parts)
}

/// Makes the checks of dfu-util, and reads the elements that the bootloader in the ROM gets: USB DFU 1.1, appendix B; ST
/// UM0391.
pub fn dfuse(bytes: &[u8]) -> Result<Dfuse> {
    const TARGET_AT: usize = 11;
    const NAME_AT: usize = TARGET_AT + 11;
    const SIZE_AT: usize = NAME_AT + TARGET_NAME_BYTES;
    let suffix = bytes.len().checked_sub(SUFFIX_BYTES.into());
    let suffix = suffix.context("the file is cut")?;
    ensure!(
        bytes[suffix + 8..suffix + 11] == *b"UFD" && bytes[suffix + 11] == SUFFIX_BYTES,
        "there is no suffix: the file is cut, or something is behind it"
    );
    ensure!(
        word(bytes, suffix + 12)? == DFU_CRC.checksum(&bytes[..suffix + 12]),
        "the CRC is wrong"
    );
    ensure!(
        word(bytes, suffix + 2)? == u32::from(DFU_VENDOR) << 16 | u32::from(DFU_PRODUCT),
        "it is for another device"
    );
    ensure!(
        bytes[suffix + 6..suffix + 8] == DFUSE_VERSION.to_le_bytes(),
        "it is not of DfuSe"
    );
    ensure!(
        bytes.starts_with(b"DfuSe") && bytes.get(5) == Some(&DFUSE_FORMAT),
        "there is no prefix"
    );
    ensure!(
        word(bytes, 6)? as usize == suffix,
        "its length is another one"
    );
    ensure!(
        bytes[10] == 1 && bytes[TARGET_AT..].starts_with(b"Target\0"),
        "it has other targets"
    );
    let name = { bytes.get(NAME_AT..SIZE_AT) }.context("the file is cut")?;
    let name = name.split(|byte| *byte == 0).next().unwrap_or_default();
    let first = SIZE_AT + 8;
    ensure!(
        word(bytes, SIZE_AT)? as usize + first == suffix,
        "its target has another length"
    );
    let mut parts = Vec::new();
    let mut at = first;
    for _ in 0..word(bytes, SIZE_AT + 4)? {
        let (address, length) = (word(bytes, at)?, word(bytes, at + 4)? as usize);
        let data = bytes[..suffix]
            .get(at + 8..)
            .and_then(|it| it.get(..length));
        parts.push((address, data.context("an element is cut")?.to_vec()));
        at += 8 + length;
    }
    ensure!(at == suffix, "something is between elements and suffix");
    Ok(Dfuse {
        name: String::from_utf8_lossy(name).into_owned(),
        parts,
    })
}

/// Reads blocks of UF2, of which a bootloader leaves those of other families out.
pub fn uf2(bytes: &[u8], family: u32) -> Result<Vec<OwnedPart>> {
    let [first, second] = UF2_START;
    let blocks = bytes.chunks(BLOCK_BYTES);
    let count = blocks.len() as u32;
    ensure!(count > 0, "the file is empty");
    let mut parts = Vec::new();
    for (number, block) in (0..).zip(blocks) {
        let is_block = block.len() == BLOCK_BYTES
            && word(block, 0)? == first
            && word(block, 4)? == second
            && word(block, BLOCK_BYTES - 4)? == UF2_END;
        ensure!(is_block, "block {number} is none");
        ensure!(
            word(block, 20)? == number && word(block, 24)? == count,
            "a block is missing: {number} of {count} is another one"
        );
        ensure!(
            word(block, 8)? == HAS_FAMILY && word(block, 28)? == family,
            "block {number} is of another family"
        );
        let length = word(block, 16)? as usize;
        let data = block[32..BLOCK_BYTES - 4].get(..length);
        let data = data.with_context(|| format!("block {number} is too long"))?;
        parts.push((word(block, 12)?, data.to_vec()));
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLASH: u32 = 0x0800_0000;

    /// A record with its checksum.
    fn record(bytes: &[u8]) -> String {
        let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        let bytes = [bytes, &[sum.wrapping_neg()]].concat();
        let digits = bytes.iter().map(|byte| format!("{byte:02X}"));
        format!(":{}\n", digits.collect::<Vec<_>>().concat())
    }

    #[test]
    fn a_hex_file_that_is_cut_damaged_or_longer_is_refused() {
        let upper = record(&[2, 0, 0, 4, 0x08, 0x00]);
        let data = record(&[3, 0x01, 0x00, 0, 7, 8, 9]) + &record(&[1, 0x01, 0x03, 0, 10]);
        let end = record(&[0, 0, 0, 1]);
        let whole = format!("{upper}{data}{end}");
        let parts = hex(whole.as_bytes()).unwrap();
        assert_eq!(parts, [(FLASH + 0x100, vec![7, 8, 9, 10])]);
        let start = record(&[4, 0, 0, 5, 8, 0, 1, 1]);
        for (wrong, reason) in [
            (format!("{upper}{data}"), "the file is cut"),
            (whole.replace("0708", "0709"), "record 2 is wrong"),
            (format!("{whole}{data}"), "record 5 stands behind"),
            (format!("{upper}{start}{end}"), "record 2 is of another"),
        ] {
            let error = hex(wrong.as_bytes()).unwrap_err().to_string();
            assert!(error.starts_with(reason), "{wrong}: {error}");
        }
        assert!(hex(&[0xff, 0xfe]).is_err());
    }

    #[test]
    fn a_dfuse_file_that_is_not_for_the_rom_or_damaged_is_refused() {
        let parts: [(u32, &[u8]); 2] = [(FLASH, &[1, 2, 3, 4]), (FLASH + 0x100, &[5, 6])];
        let whole = crate::dfuse(&parts, "A board");
        let read = dfuse(&whole).unwrap();
        let wanted = parts.map(|(at, bytes)| (at, bytes.to_vec()));
        assert_eq!((&*read.name, &read.parts[..]), ("A board", &wanted[..]));
        // Each with its CRC made anew, but for the first three.
        let body = whole.len() - 4;
        let with_crc = |mut bytes: Vec<u8>| {
            bytes.extend(DFU_CRC.checksum(&bytes).to_le_bytes());
            bytes
        };
        let changed = |at: usize, byte: u8| {
            let mut bytes = whole[..body].to_vec();
            bytes[at] = byte;
            with_crc(bytes)
        };
        let mut flipped = whole.clone();
        flipped[290] ^= 1;
        let between = [&whole[..body - 12], &[0], &whole[body - 12..body]].concat();
        for (wrong, reason) in [
            (flipped, "the CRC is wrong"),
            (whole[..whole.len() - 1].to_vec(), "there is no suffix"),
            ([&*whole, b"\n"].concat(), "there is no suffix"),
            (whole[..9].to_vec(), "the file is cut"),
            (changed(body - 10, 0x10), "it is for another device"),
            (changed(body - 6, 0x00), "it is not of DfuSe"),
            (changed(0, b'd'), "there is no prefix"),
            (changed(6, 0xff), "its length is another one"),
            (changed(10, 2), "it has other targets"),
            (changed(17, 1), "it has other targets"),
            (changed(277, 0xff), "its target has another length"),
            (changed(281, 3), "an element is cut"),
            (changed(281, 1), "something is between"),
            (changed(289 + 3, 1), "an element is cut"),
            (with_crc(between), "its length is another one"),
        ] {
            let error = dfuse(&wrong).unwrap_err().to_string();
            assert!(error.starts_with(reason), "{reason}: {error}");
        }
    }

    #[test]
    fn a_uf2_file_with_a_wrong_block_is_refused() {
        let parts: [(u32, &[u8]); 1] = [(FLASH, &[7; 300])];
        let whole = crate::uf2(&parts, 5);
        let read = uf2(&whole, 5).unwrap();
        assert_eq!(read[0], (FLASH, vec![7; 256]));
        assert_eq!((read.len(), read[1].0), (2, FLASH + 256));
        let changed = |at: usize, byte: u8| {
            let mut bytes = whole.clone();
            bytes[at] = byte;
            bytes
        };
        let (one, other) = whole.split_at(BLOCK_BYTES);
        for (wrong, reason) in [
            (changed(BLOCK_BYTES + 28, 6), "block 1 is of another family"),
            (changed(9, 0), "block 0 is of another family"),
            (changed(17, 2), "block 0 is too long"),
            (changed(0, 0), "block 0 is none"),
            (changed(2 * BLOCK_BYTES - 1, 0), "block 1 is none"),
            ([other, one].concat(), "a block is missing"),
            (one.to_vec(), "a block is missing"),
            ([&*whole, one].concat(), "a block is missing"),
            ([&*whole, b"\n"].concat(), "a block is missing"),
            (whole[..1000].to_vec(), "block 1 is none"),
            (Vec::new(), "the file is empty"),
        ] {
            let error = uf2(&wrong, 5).unwrap_err().to_string();
            assert!(error.starts_with(reason), "{reason}: {error}");
        }
    }
}
