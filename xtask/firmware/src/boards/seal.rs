//! The CRC of an image, which the firmware compares at power-up: `static IMAGE_CHECK` of `src/board/image_check.rs`.

use std::ops::Range;

use anyhow::{Context, Result, bail, ensure};

use super::image::{PatchedWords, parts, symbol};

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

/// Makes sure that an image has the CRC of what is in it.
pub fn check(image: &[u8]) -> Result<()> {
    let words = &image[CHECK.place(image)?];
    let crc = compute(image)?.to_le_bytes();
    ensure!(
        *words == [SEALED, crc].concat(),
        "the image has another CRC than it names: it is damaged"
    );
    Ok(())
}

/// Computes the CRC of everything that is loaded but the two words, in the order of addresses.
fn compute(image: &[u8]) -> Result<u32> {
    let parts = parts(image)?;
    let loaded = parts.iter().map(|(start, bytes)| {
        let start = u64::from(*start);
        start..start + bytes.len() as u64
    });
    compare(&loaded.collect::<Vec<_>>(), &checked(image)?)?;
    crc_without(symbol(image, CHECK.symbol)?, &parts)
}

/// What the firmware computes the CRC of: vectors, code, constants, and the initial values of data.
fn checked(image: &[u8]) -> Result<Vec<Range<u64>>> {
    let address = |name: &str| symbol(image, name).map(u64::from);
    let values = address("__sidata")?;
    let sections = [
        address("__vector_table")?..address("_vectors_end")?,
        address("__stext")?..address("__etext")?,
        address("__srodata")?..address("__erodata")?,
        values..values + (address("__edata")? - address("__sdata")?),
    ];
    Ok(sections.into_iter().filter(|it| !it.is_empty()).collect())
}

/// Compares the loaded bytes with the bytes that the firmware checks: with other bytes the firmware would not start.
fn compare(loaded: &[Range<u64>], checked: &[Range<u64>]) -> Result<()> {
    if let Some(other) = loaded.iter().find(|it| !checked.contains(it)) {
        bail!(
            "{:#010x} to {:#010x} is loaded, and no section of which the firmware checks the CRC",
            other.start,
            other.end - 1
        );
    }
    ensure!(
        loaded == checked,
        "the firmware checks the CRC of what is not loaded"
    );
    Ok(())
}

/// The CRC of parts of the memory, by their addresses, without the two words at an address.
fn crc_without(words: u32, parts: &[(u32, &[u8])]) -> Result<u32> {
    let mut digest = CRC.digest();
    let mut is_left_out = false;
    for (start, bytes) in parts {
        let at = words.checked_sub(*start).map(|at| at as usize);
        let Some(at) = at.filter(|at| *at < bytes.len()) else {
            digest.update(bytes);
            continue;
        };
        let (before, rest) = bytes.split_at(at);
        digest.update(before);
        digest.update(rest.get(8..).context("the image ends within its CRC")?);
        is_left_out = true;
    }
    ensure!(is_left_out, "the place of the CRC is not loaded");
    Ok(digest.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crc_is_that_of_ethernet_over_everything_but_its_own_words() {
        let parts = [(0x100, &b"12345"[..]), (0x200, b"6\0\0\0\0\0\0\0\x01789")];
        // The value that catalogues of CRCs give for these nine digits.
        assert_eq!(crc_without(0x201, &parts).unwrap(), 0xcbf4_3926);
        assert_ne!(crc_without(0x202, &parts).unwrap(), 0xcbf4_3926);
        for (words, reason) in [(0x300, "is not loaded"), (0x206, "ends within")] {
            let error = crc_without(words, &parts).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }

    #[test]
    fn what_is_loaded_and_not_checked_is_refused() {
        let [vectors, code, more] = [0x100..0x200, 0x200..0x300, 0x400..0x410];
        let own = [vectors.clone(), code.clone()];
        assert!(compare(&own, &own).is_ok());
        let error = compare(&[vectors.clone(), code, more], &own).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("0x00000400 to 0x0000040f is loaded")
        );
        assert!(compare(&[vectors], &own).is_err());
    }
}
