//! The files in which a firmware is given to those who write it into a chip's flash.
//!
//! | format | described in |
//! |---|---|
//! | Intel HEX | Intel, *Hexadecimal Object File Format Specification*, 1988 |
//! | DfuSe | ST UM0391, *`DfuSe` file format specification*; the suffix: USB DFU 1.1, appendix B |
//! | UF2 | <https://github.com/microsoft/uf2> |

#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

pub mod read;

use std::collections::BTreeMap;

/// Bytes of flash at an address.
pub type Part<'a> = (u32, &'a [u8]);

/// The value of flash to which nothing is written.
pub const ERASED: u8 = 0xff;

/// Returns the flash from an address on, up to the last byte of the parts, none of which begins before it.
pub fn flat(parts: &[Part<'_>], start: u32) -> Vec<u8> {
    let mut flash = Vec::new();
    for (address, bytes) in parts {
        let offset = (address - start) as usize;
        let place = offset..offset + bytes.len();
        if flash.len() < place.end {
            flash.resize(place.end, ERASED);
        }
        flash[place].copy_from_slice(bytes);
    }
    flash
}

/// Bytes of a record of data, and the kinds of records.
const RECORD_BYTES: usize = 16;
const DATA_RECORD: u8 = 0;
const END_RECORD: u8 = 1;
const UPPER_ADDRESS_RECORD: u8 = 4;

/// Returns an Intel HEX file of the parts, and of nothing between them.
pub fn hex(parts: &[Part<'_>]) -> String {
    let mut text = String::new();
    let mut upper = 0;
    for (start, bytes) in parts {
        let mut at = *start;
        let mut rest = *bytes;
        while !rest.is_empty() {
            if at >> 16 != upper {
                upper = at >> 16;
                record(
                    &mut text,
                    0,
                    UPPER_ADDRESS_RECORD,
                    &(upper as u16).to_be_bytes(),
                );
            }
            // No record goes over the end of its 64 KiB.
            let room = 0x1_0000 - (at & 0xffff) as usize;
            let (data, after) = rest.split_at(rest.len().min(RECORD_BYTES).min(room));
            record(&mut text, at as u16, DATA_RECORD, data);
            at += data.len() as u32;
            rest = after;
        }
    }
    record(&mut text, 0, END_RECORD, &[]);
    text
}

/// Appends a record, whose bytes with the last one add up to 0.
fn record(text: &mut String, address: u16, kind: u8, data: &[u8]) {
    let [high, low] = address.to_be_bytes();
    let mut bytes = vec![data.len() as u8, high, low, kind];
    bytes.extend(data);
    let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    bytes.push(sum.wrapping_neg());
    text.push(':');
    text.extend(bytes.iter().map(|byte| format!("{byte:02X}")));
    text.push('\n');
}

/// The bootloader in the ROM of the chips, as a USB device.
const DFU_VENDOR: u16 = 0x0483;
const DFU_PRODUCT: u16 = 0xdf11;
/// The version of DFU that files of `DfuSe` name, and that of their own format.
const DFUSE_VERSION: u16 = 0x011a;
const DFUSE_FORMAT: u8 = 1;
/// Bytes of the name of a target.
const TARGET_NAME_BYTES: usize = 255;
const SUFFIX_BYTES: u8 = 16;
/// The CRC of Ethernet without its last inversion.
const DFU_CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_JAMCRC);

/// Returns a `DfuSe` file of the parts, and of nothing between them, for the flash of a chip.
pub fn dfuse(parts: &[Part<'_>], name: &str) -> Vec<u8> {
    let mut elements = Vec::new();
    for (address, bytes) in parts {
        elements.extend(address.to_le_bytes());
        elements.extend((bytes.len() as u32).to_le_bytes());
        elements.extend(*bytes);
    }
    let mut target = b"Target".to_vec();
    // Alternate setting 0, which has a name.
    target.push(0);
    target.extend(1_u32.to_le_bytes());
    let padding = std::iter::repeat(0);
    target.extend(name.bytes().chain(padding).take(TARGET_NAME_BYTES));
    target.extend((elements.len() as u32).to_le_bytes());
    target.extend((parts.len() as u32).to_le_bytes());
    target.extend(elements);
    let mut file = b"DfuSe".to_vec();
    file.push(DFUSE_FORMAT);
    let prefix_bytes = file.len() + 5;
    file.extend(((prefix_bytes + target.len()) as u32).to_le_bytes());
    file.push(1);
    file.extend(target);
    // Any release of the device.
    for word in [0xffff, DFU_PRODUCT, DFU_VENDOR, DFUSE_VERSION] {
        file.extend(word.to_le_bytes());
    }
    file.extend(b"UFD");
    file.push(SUFFIX_BYTES);
    file.extend(DFU_CRC.checksum(&file).to_le_bytes());
    file
}

/// Bytes of a block of UF2, and of flash in it.
const BLOCK_BYTES: usize = 512;
const PAGE_BYTES: u32 = 256;
/// What a block begins and ends with, and the flag of a block that names a family of chips.
const UF2_START: [u32; 2] = [0x0a32_4655, 0x9e5d_5157];
const UF2_END: u32 = 0x0ab1_6f30;
const HAS_FAMILY: u32 = 0x2000;

/// Returns a UF2 file of the pages of the parts, for a family of chips.
pub fn uf2(parts: &[Part<'_>], family: u32) -> Vec<u8> {
    let mut pages: BTreeMap<u32, [u8; PAGE_BYTES as usize]> = BTreeMap::new();
    for (start, bytes) in parts {
        for (address, byte) in (*start..).zip(*bytes) {
            let page = pages.entry(address - address % PAGE_BYTES);
            let page = page.or_insert([ERASED; PAGE_BYTES as usize]);
            page[(address % PAGE_BYTES) as usize] = *byte;
        }
    }
    let mut file = Vec::with_capacity(pages.len() * BLOCK_BYTES);
    let count = pages.len() as u32;
    for (number, (address, page)) in (0_u32..).zip(&pages) {
        let [first, second] = UF2_START;
        let words = [
            first, second, HAS_FAMILY, *address, PAGE_BYTES, number, count, family,
        ];
        file.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        file.extend(page);
        file.resize((number as usize + 1) * BLOCK_BYTES - 4, 0);
        file.extend(UF2_END.to_le_bytes());
    }
    file
}

#[cfg(test)]
mod tests {
    use ihex::{Reader, Record};

    use super::*;

    const START: u32 = 0x0800_8000;

    /// A short part, one over the end of 64 KiB whose length fills no record, and one in a page of the second.
    fn parts() -> Vec<(u32, Vec<u8>)> {
        let long = (0..0x1_0123_u32).map(|it| (it * 7 + it / 256) as u8);
        let long: Vec<u8> = long.collect();
        let after = START + 0x200 + long.len() as u32 + 5;
        vec![
            (START, vec![1, 2, 3]),
            (START + 0x200, long),
            (after, vec![0xab; 33]),
        ]
    }

    fn borrowed(parts: &[(u32, Vec<u8>)]) -> Vec<Part<'_>> {
        parts.iter().map(|(at, bytes)| (*at, &bytes[..])).collect()
    }

    #[test]
    fn a_flat_file_has_each_part_at_its_place_and_nothing_between() {
        let parts = [(START + 8, &[1, 2, 3][..]), (START, &[4, 5])];
        let flash = flat(&parts, START);
        assert_eq!(flash, [4, 5, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 2, 3]);
    }

    #[test]
    fn another_reader_finds_in_a_hex_file_the_parts_and_nothing_else() {
        let parts = parts();
        let text = hex(&borrowed(&parts));
        let (mut upper, mut read) = (0_u32, BTreeMap::new());
        let mut has_ended = false;
        for record in Reader::new(&text) {
            match record.unwrap() {
                Record::ExtendedLinearAddress(address) => upper = address.into(),
                Record::Data { offset, value } => {
                    let at = upper << 16 | u32::from(offset);
                    assert!(usize::from(offset) + value.len() <= 0x1_0000);
                    read.extend((at..).zip(value));
                }
                Record::EndOfFile => has_ended = true,
                other => panic!("{other:?}"),
            }
        }
        let wanted = parts.iter().flat_map(|(at, bytes)| (*at..).zip(bytes));
        assert!(has_ended && read.into_iter().eq(wanted.map(|(at, byte)| (at, *byte))));
    }

    #[test]
    fn another_reader_finds_in_a_uf2_file_the_pages_of_the_parts() {
        let parts = parts();
        let file = uf2(&borrowed(&parts), 0x5775_5a57);
        let (flash, families) = uf2_decode::convert_from_uf2(&file).unwrap();
        assert_eq!(families.into_keys().collect::<Vec<_>>(), [0x5775_5a57]);
        let mut wanted = flat(&borrowed(&parts), START);
        wanted.resize(wanted.len().next_multiple_of(PAGE_BYTES as usize), ERASED);
        // Between pages that the file does not have, the reader puts zeros.
        wanted[PAGE_BYTES as usize..2 * PAGE_BYTES as usize].fill(0);
        assert_eq!(flash, wanted);
    }

    /// dfu-util reads such a file in `tests/dfu_util.rs`.
    #[test]
    fn a_dfuse_file_has_each_part_with_its_address_and_length() {
        let parts = parts();
        let file = dfuse(&borrowed(&parts), "leadscrew");
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!(
            (&file[..6], word(6), file[10]),
            (&b"DfuSe\x01"[..], file.len() - 16, 1)
        );
        assert_eq!((&file[11..18], word(18)), (&b"Target\0"[..], 1));
        assert_eq!(&file[22..32], b"leadscrew\0");
        assert_eq!((word(277), word(281)), (file.len() - 16 - 285, parts.len()));
        let mut at = 285;
        for (address, bytes) in &parts {
            assert_eq!((word(at), word(at + 4)), (*address as usize, bytes.len()));
            assert_eq!(&file[at + 8..at + 8 + bytes.len()], bytes);
            at += 8 + bytes.len();
        }
        let suffix = b"\xff\xff\x11\xdf\x83\x04\x1a\x01UFD\x10";
        assert_eq!(&file[at..at + 12], suffix);
        assert_eq!(
            word(at + 12),
            !crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&file[..at + 12]) as usize
        );
        assert_eq!(file.len(), at + 16);
    }
}
