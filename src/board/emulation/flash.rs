//! The flash for settings as memory: the emulator's own flash cannot be written.
//!
//! The memory is RAM that nothing initialises: it keeps its contents through a reset, and is zero at
//! power-up. The bits are inverted, so that zero means erased. It is RAM of the program, because no two
//! versions of QEMU agree on what is beside the 128 KiB that the chip has.

use core::{cell::UnsafeCell, mem::MaybeUninit};

use crate::board::flash::BOTH;

/// The bytes of both sectors, inverted.
struct Sectors(UnsafeCell<MaybeUninit<[u8; BOTH]>>);

#[expect(unsafe_code, reason = "memory that nothing initialises")]
// SAFETY: `SettingsFlash`, of which there is one, alone calls the functions of this file.
unsafe impl Sync for Sectors {}

#[unsafe(link_section = ".uninit.emulated_flash")]
#[expect(unsafe_code, reason = "a section")]
static SECTORS: Sectors = Sectors(UnsafeCell::new(MaybeUninit::uninit()));

/// Returns the address of a byte.
const fn byte(offset: usize) -> *mut u8 {
    SECTORS.0.get().cast::<u8>().wrapping_add(offset)
}

/// Reads bytes; the caller of this and of the functions below has checked the range.
#[expect(unsafe_code, reason = "memory that nothing initialises")]
pub(in crate::board) fn read_flash(offset: usize, bytes: &mut [u8]) {
    for (read, index) in bytes.iter_mut().zip(offset..) {
        // SAFETY: the byte is in the sectors, which only these functions use, one at a time.
        *read = !unsafe { byte(index).read_volatile() };
    }
}

/// Programs bytes: clears bits, which stay clear until they are erased.
#[expect(unsafe_code, reason = "memory that nothing initialises")]
pub(in crate::board) fn write_flash(offset: usize, bytes: &[u8]) {
    for (written, index) in bytes.iter().zip(offset..) {
        // SAFETY: as in `read_flash`.
        unsafe {
            let programmed = byte(index).read_volatile() | !written;
            byte(index).write_volatile(programmed);
        }
    }
}

/// Erases bytes: sets all bits.
#[expect(unsafe_code, reason = "memory that nothing initialises")]
pub(in crate::board) fn erase_flash(offset: usize, length: usize) {
    for index in offset..offset + length {
        // SAFETY: as in `read_flash`.
        unsafe { byte(index).write_volatile(0) };
    }
}
