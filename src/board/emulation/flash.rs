//! The flash for settings as memory: the emulator's own flash cannot be written.
//!
//! The memory is RAM that no program uses: it keeps its contents through a reset, and is zero at
//! power-up. The bits are inverted, so that zero means erased.

use crate::board::flash::BOTH;

/// Behind the RAM of the board's chip, in the 192 KiB that the emulated one has.
const FIRST: *mut u8 = 0x2002_0000 as *mut u8;
const _: () = assert!(BOTH <= 64 * 1024);

/// Reads bytes; the caller of this and of the functions below has checked the range.
#[expect(unsafe_code, reason = "memory that no program uses")]
pub(in crate::board) fn read_flash(offset: usize, bytes: &mut [u8]) {
    for (byte, index) in bytes.iter_mut().zip(offset..) {
        // SAFETY: the emulated chip has this memory, the linker does not know it, and only these
        // functions use it.
        *byte = !unsafe { FIRST.add(index).read_volatile() };
    }
}

/// Programs bytes: clears bits, which stay clear until they are erased.
#[expect(unsafe_code, reason = "memory that no program uses")]
pub(in crate::board) fn write_flash(offset: usize, bytes: &[u8]) {
    for (byte, index) in bytes.iter().zip(offset..) {
        // SAFETY: as in `read_flash`.
        unsafe {
            let programmed = FIRST.add(index).read_volatile() | !byte;
            FIRST.add(index).write_volatile(programmed);
        }
    }
}

/// Erases bytes: sets all bits.
#[expect(unsafe_code, reason = "memory that no program uses")]
pub(in crate::board) fn erase_flash(offset: usize, length: usize) {
    for index in offset..offset + length {
        // SAFETY: as in `read_flash`.
        unsafe { FIRST.add(index).write_volatile(0) };
    }
}
