//! The CRC of the image, compared at power-up with the CRC that a tool writes into the image after linking.

use core::slice;

use super::watchdog;

/// Mark of an image as the linker leaves it, which is not checked, and of one with its CRC.
const UNSEALED: u32 = u32::from_le_bytes(*b"CRC?");
const SEALED: u32 = u32::from_le_bytes(*b"CRC=");
/// CRC-32 as in Ethernet and zip files.
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
/// Bytes between two times that the watchdog is fed: a few ms at the frequency of the internal oscillator.
const CHUNK_BYTES: usize = 4096;

/// The mark and the CRC of everything that is loaded but these two words. `xtask/firmware/src/boards/seal.rs` writes them.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a symbol that a tool can find")]
static IMAGE_CHECK: [u32; 2] = [UNSEALED, 0];

#[expect(unsafe_code, reason = "symbols of the linker script")]
unsafe extern "C" {
    static __vector_table: u8;
    static _vectors_end: u8;
    static __stext: u8;
    static __etext: u8;
    static __srodata: u8;
    static __erodata: u8;
    static __sdata: u8;
    static __edata: u8;
    static __sidata: u8;
}

/// Returns whether the image is the one that was built: its vectors, code, constants and initial values.
#[expect(unsafe_code, reason = "words that are written after linking")]
pub(super) fn is_whole() -> bool {
    let words = &raw const IMAGE_CHECK;
    // SAFETY: reads a static, which nothing changes while the program runs.
    let [mark, crc] = unsafe { words.read_volatile() };
    match mark {
        UNSEALED => true,
        SEALED => crc == compute(words.addr()),
        _ => false,
    }
}

/// Computes the CRC without the words at an address, which are among the constants.
fn compute(words: usize) -> u32 {
    let [vectors, code, constants, values] = sections();
    let (before, rest) = constants.split_at(words.wrapping_sub(constants.as_ptr().addr()));
    let (_, after) = rest.split_at(size_of_val(&IMAGE_CHECK));
    let mut digest = CRC.digest();
    for section in [vectors, code, before, after, values] {
        for piece in section.chunks(CHUNK_BYTES) {
            watchdog::feed();
            digest.update(piece);
        }
    }
    digest.finalize()
}

/// Returns what is loaded into flash: vectors, code, constants, and the initial values of data.
#[expect(unsafe_code, reason = "memory that the linker has laid out")]
fn sections() -> [&'static [u8]; 4] {
    let section = |start: *const u8, bytes: usize| {
        // SAFETY: the linker has put that many bytes there, and flash of the program does not change.
        unsafe { slice::from_raw_parts(start, bytes) }
    };
    let between = |start: *const u8, end: *const u8| section(start, end.addr() - start.addr());
    let values = (&raw const __edata).addr() - (&raw const __sdata).addr();
    [
        between(&raw const __vector_table, &raw const _vectors_end),
        between(&raw const __stext, &raw const __etext),
        between(&raw const __srodata, &raw const __erodata),
        section(&raw const __sidata, values),
    ]
}
