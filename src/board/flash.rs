//! The two flash sectors that the linker script leaves free: what outlives power.
//!
//! The chip has one bank: while it programs a word (16 µs a byte) no instruction can be fetched, and
//! while it erases a sector (up to 0.8 s) neither. No pulse can be output and no byte received then.
//! So the flash is written at rest only: the session asks for it when the machine stands still, and
//! goes on, and takes the next line, when it is done.
//!
//! The emulator has no flash controller, and memory that no task uses stands in for the sectors, to
//! the same rules; what is stored there lasts until the emulator ends.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use leadscrew::settings::{Journal, Loaded};
use stm32f4xx_hal::flash::FlashExt;

use super::pac;

/// Bytes of a sector: 1 and 2 of the chip.
const SECTOR: usize = 16 * 1024;
/// Bytes of both.
const SECTORS: usize = 2 * SECTOR;
/// Where the emulator keeps them: the last quarter of the RAM, which the linker script leaves free.
const EMULATED: *mut u8 = 0x2001_8000 as *mut u8;

/// The settings' sectors.
pub(crate) struct Flash {
    controller: pac::FLASH,
    /// Their first byte.
    start: *mut u8,
    is_emulated: bool,
}

#[expect(unsafe_code, reason = "memory that the linker script sets aside")]
// SAFETY: nothing else uses the controller after start, nor the memory, and there is one `Flash`.
unsafe impl Send for Flash {}

impl Flash {
    /// The sectors of the chip; in the emulator memory that is as if erased.
    pub(super) fn new(controller: pac::FLASH, is_emulated: bool) -> Self {
        let start = if is_emulated { EMULATED } else { start() };
        let mut flash = Self {
            controller,
            start,
            is_emulated,
        };
        if is_emulated {
            flash.emulate(0, SECTORS, |_| 0xff);
        }
        flash
    }

    /// What is stored in the sectors, and the journal that stores there from now on.
    pub(super) fn load(self) -> (Journal<Self>, Loaded) {
        let mut journal = Journal::new(self);
        // Flash that fails is like new: the machine works, and says what it cannot store.
        let loaded = journal.load().unwrap_or_default();
        (journal, loaded)
    }

    /// Changes bytes of the memory that stands in for the sectors.
    #[expect(unsafe_code, reason = "memory outside of the program's")]
    fn emulate(&mut self, offset: usize, length: usize, change: impl Fn((usize, u8)) -> u8) {
        debug_assert!(self.is_emulated && offset + length <= SECTORS);
        for index in 0..length {
            // SAFETY: within the memory, which is ours alone.
            unsafe {
                let place = self.start.add(offset + index);
                place.write_volatile(change((index, place.read_volatile())));
            }
        }
    }

    /// The distance of a byte from the beginning of the chip's flash.
    fn from_beginning(&self, offset: usize) -> usize {
        self.start as usize - self.controller.address() + offset
    }

    /// Whether an operation went well; what it has changed is not read from the caches again.
    fn end(&mut self, result: Result<(), stm32f4xx_hal::flash::Error>) -> Result<(), Error> {
        let registers = &self.controller;
        registers
            .acr()
            .modify(|_, w| w.dcen().clear_bit().icen().clear_bit());
        registers
            .acr()
            .modify(|_, w| w.dcrst().set_bit().icrst().set_bit());
        registers
            .acr()
            .modify(|_, w| w.dcrst().clear_bit().icrst().clear_bit());
        registers
            .acr()
            .modify(|_, w| w.dcen().set_bit().icen().set_bit());
        result.or(Err(Error::Other))
    }

    /// Forgets the errors of earlier operations, which would fail this one.
    #[expect(unsafe_code, reason = "flags that are cleared by writing ones")]
    fn begin(&mut self) {
        // SAFETY: EOP, OPERR, WRPERR, PGAERR, PGPERR and PGSERR; the register has no others to write.
        self.controller.sr().write(|w| unsafe { w.bits(0xf3) });
    }
}

/// The first byte of the sectors.
#[expect(unsafe_code, reason = "a symbol of the linker script")]
fn start() -> *mut u8 {
    unsafe extern "C" {
        static mut _settings_start: u8;
    }
    &raw mut _settings_start
}

type Error = NorFlashErrorKind;

/// Whether a piece lies within the sectors.
fn check(offset: u32, length: usize) -> Result<usize, Error> {
    let offset = offset as usize;
    if offset <= SECTORS && length <= SECTORS - offset {
        Ok(offset)
    } else {
        Err(Error::OutOfBounds)
    }
}

impl ErrorType for Flash {
    type Error = Error;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    #[expect(unsafe_code, reason = "memory that changes behind the compiler's back")]
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        let offset = check(offset, bytes.len())?;
        for (index, byte) in (offset..).zip(bytes) {
            // SAFETY: within the sectors.
            *byte = unsafe { self.start.add(index).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        SECTORS
    }
}

impl NorFlash for Flash {
    /// Programming is by the byte, in any voltage; a power cut can tear a word as it tears a byte.
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        let length = to.checked_sub(from).ok_or(Error::OutOfBounds)? as usize;
        let from = check(from, length)?;
        if !from.is_multiple_of(SECTOR) || !length.is_multiple_of(SECTOR) {
            return Err(Error::NotAligned);
        }
        for offset in (from..from + length).step_by(SECTOR) {
            if self.is_emulated {
                self.emulate(offset, SECTOR, |_| 0xff);
                continue;
            }
            let place = self.from_beginning(offset);
            let sector = self.controller.sector(place).ok_or(Error::OutOfBounds)?;
            self.begin();
            let result = self.controller.unlocked().erase(sector.number);
            self.end(result)?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        let offset = check(offset, bytes.len())?;
        if self.is_emulated {
            self.emulate(offset, bytes.len(), |(index, old)| old & bytes[index]);
            return Ok(());
        }
        let place = self.from_beginning(offset);
        self.begin();
        let result = self.controller.unlocked().program(place, bytes.iter());
        self.end(result)
    }
}
