//! The flash of the journal as memory: the emulator's own flash cannot be written.
//!
//! The memory is RAM that nothing initialises: it keeps its contents through a reset, and is zero at
//! power-up. The bits are inverted, so that zero means erased. It is RAM of the program, because no two versions of
//! QEMU agree on the memory beside the 128 KiB of the chip.

use core::{cell::UnsafeCell, convert::Infallible, mem::MaybeUninit};

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use super::{pac, serial::FlashEraseReceiver};

/// Bytes of a sector, half of what a chip has, and of both sectors.
const SECTOR: usize = 8 * 1024;
pub(super) const BOTH: usize = 2 * SECTOR;

/// The bytes of both sectors, inverted.
struct Sectors(UnsafeCell<MaybeUninit<[u8; BOTH]>>);

#[expect(unsafe_code, reason = "memory that nothing initialises")]
// SAFETY: `SettingsFlash`, of which there is one, alone uses them.
unsafe impl Sync for Sectors {}

#[unsafe(link_section = ".uninit.emulated_flash")]
#[expect(unsafe_code, reason = "a section")]
static SECTORS: Sectors = Sectors(UnsafeCell::new(MaybeUninit::uninit()));

/// Returns the address of a byte, which is in the sectors whatever the offset is.
const fn byte(offset: usize) -> *mut u8 {
    SECTORS.0.get().cast::<u8>().wrapping_add(offset % BOTH)
}

/// The two sectors.
pub(crate) struct SettingsFlash;

#[expect(clippy::unused_self, reason = "whoever has it may use the memory")]
impl SettingsFlash {
    /// Returns the sectors.
    pub(super) const fn new(_: pac::FLASH) -> Self {
        Self
    }

    /// Does nothing: an erase takes no time.
    pub(super) fn set_receiver(&mut self, _: FlashEraseReceiver) {}
}

impl ErrorType for SettingsFlash {
    type Error = Infallible;
}

#[expect(unsafe_code, reason = "memory that nothing initialises")]
impl ReadNorFlash for SettingsFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        for (read, index) in bytes.iter_mut().zip(offset as usize..) {
            // SAFETY: `byte` returns addresses of this memory alone.
            *read = !unsafe { byte(index).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        BOTH
    }
}

#[expect(unsafe_code, reason = "memory that nothing initialises")]
impl NorFlash for SettingsFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        for index in from..to {
            // SAFETY: as in `read`.
            unsafe { byte(index as usize).write_volatile(0) };
        }
        Ok(())
    }

    /// Clears bits, which stay clear until they are erased.
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        for (written, index) in bytes.iter().zip(offset as usize..) {
            // SAFETY: as in `read`.
            unsafe {
                let programmed = byte(index).read_volatile() | !written;
                byte(index).write_volatile(programmed);
            }
        }
        Ok(())
    }
}
