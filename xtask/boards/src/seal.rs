//! The CRC of an image, which the firmware compares at power-up: `static IMAGE_CHECK` of `src/board/image_check.rs`.

use anyhow::{Context, Result, ensure};

use crate::image::{PatchedWords, segments, symbol};

/// The mark of an image as the linker leaves it, and of one with its CRC.
const UNSEALED: [u8; 4] = *b"CRC?";
const SEALED: [u8; 4] = *b"CRC=";
/// The mark and the CRC.
const CHECK: PatchedWords = PatchedWords {
    symbol: "IMAGE_CHECK",
    marks: &[UNSEALED, SEALED],
};
/// CRC-32 as in Ethernet and zip files.
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// Writes the CRC into an image, as the last that is written into it.
pub fn seal(image: &mut [u8]) -> Result<()> {
    let words = CHECK.place(image)?;
    let crc = compute(image)?;
    image[words].copy_from_slice(&[SEALED, crc.to_le_bytes()].concat());
    Ok(())
}

/// Computes the CRC of everything that is loaded but the two words, in the order of addresses.
fn compute(image: &[u8]) -> Result<u32> {
    let words = symbol(image, CHECK.symbol)?;
    let mut segments = segments(image)?;
    segments.retain(|segment| !segment.bytes.is_empty());
    segments.sort_by_key(|segment| segment.load_address);
    let mut digest = CRC.digest();
    let mut is_left_out = false;
    for segment in &segments {
        let loaded = segment.loaded();
        let Some(at) = loaded.contains(&words).then(|| words - loaded.start) else {
            digest.update(segment.bytes);
            continue;
        };
        let (before, rest) = segment.bytes.split_at(at as usize);
        digest.update(before);
        digest.update(rest.get(8..).context("the image ends within its CRC")?);
        is_left_out = true;
    }
    ensure!(is_left_out, "the place of the CRC is not loaded");
    Ok(digest.finalize())
}
