//! The flash in which settings outlive power: sectors 1 and 2, 16 KiB each.
//!
//! The chip cannot read its flash while it erases or programs, so everything that runs from flash
//! stands still: 16 µs for a word, 0.8 s for a sector. So it does at standstill only. Meanwhile the
//! sender goes on, so the waiting is done by code in RAM, which receives its bytes. RM0090 3.6, RM0390
//! 3.5.

use cortex_m::register::basepri;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use stm32f4xx_hal::pac::flash::cr::PSIZE;

use super::{emulation, pac, serial::FlashEraseReceiver, step_timer};

/// Bytes of a sector, and of both.
const SECTOR: usize = 16 * 1024;
pub(super) const BOTH: usize = 2 * SECTOR;
/// Number of the first sector.
const FIRST: u8 = 1;
/// Level of the step interrupt: as a threshold it keeps every task from running.
const ALL_TASKS: u8 = (16 - 5) << 4;
/// The keys that unlock programming and erasing.
const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];

#[expect(unsafe_code, reason = "a symbol of the linker script")]
unsafe extern "C" {
    /// Where the first sector begins.
    static mut _settings_start: [u32; BOTH / 4];
}

/// The two sectors, the flash's registers, and the receiver while a sector is erased: none
/// before tasks run.
pub(crate) struct SettingsFlash {
    registers: pac::FLASH,
    receiver: Option<FlashEraseReceiver>,
}

/// Why an operation fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FlashError {
    /// Not whole words or sectors.
    NotAligned,
    /// Beyond the end.
    OutOfBounds,
    /// The chip refuses, or the machine has begun to move.
    Refused,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotAligned => NorFlashErrorKind::NotAligned,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::Refused => NorFlashErrorKind::Other,
        }
    }
}

impl SettingsFlash {
    /// Takes over the registers.
    pub(super) const fn new(registers: pac::FLASH) -> Self {
        Self {
            registers,
            receiver: None,
        }
    }

    /// Sets the receiver while a sector is erased.
    pub(super) fn set_receiver(&mut self, receiver: FlashEraseReceiver) {
        self.receiver = Some(receiver);
    }

    /// Runs an operation on the unlocked registers.
    ///
    /// # Errors
    ///
    /// If the operation returns false, or the chip reports an error.
    fn operate(
        &mut self,
        operation: impl FnOnce(&pac::FLASH, Option<&mut FlashEraseReceiver>) -> bool,
    ) -> Result<(), FlashError> {
        let flash = &self.registers;
        for key in KEYS {
            flash.keyr().write(|w| w.key().set(key));
        }
        clear_errors(flash);
        let is_refused = !operation(flash, self.receiver.as_mut()) || has_errors(flash);
        clear_errors(flash);
        flash.cr().write(|w| w.lock().set_bit());
        // What the cache holds of the sector is old.
        flash.acr().modify(|_, w| w.dcen().clear_bit());
        flash.acr().modify(|_, w| w.dcrst().set_bit());
        flash
            .acr()
            .modify(|_, w| w.dcrst().clear_bit().dcen().set_bit());
        if is_refused {
            Err(FlashError::Refused)
        } else {
            Ok(())
        }
    }
}

impl ErrorType for SettingsFlash {
    type Error = FlashError;
}

impl ReadNorFlash for SettingsFlash {
    const READ_SIZE: usize = 1;

    #[expect(unsafe_code, reason = "memory beside the program")]
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let offset = sector_offset(offset, bytes.len(), 1)?;
        if emulation::is_emulated() {
            emulation::read_flash(offset, bytes);
            return Ok(());
        }
        let first = (&raw const _settings_start).cast::<u8>();
        for (byte, index) in bytes.iter_mut().zip(offset..) {
            // SAFETY: `sector_offset` has made sure that it is in the sectors.
            *byte = unsafe { first.add(index).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        BOTH
    }
}

impl NorFlash for SettingsFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let length = to.checked_sub(from).ok_or(FlashError::OutOfBounds)?;
        let offset = sector_offset(from, length as usize, SECTOR)?;
        if emulation::is_emulated() {
            emulation::erase_flash(offset, length as usize);
            return Ok(());
        }
        let sectors = offset / SECTOR..(offset + length as usize) / SECTOR;
        for sector in sectors {
            self.operate(|flash, receiver| erase(flash, FIRST + sector as u8, receiver))?;
        }
        Ok(())
    }

    #[expect(unsafe_code, reason = "memory beside the program")]
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let offset = sector_offset(offset, bytes.len(), 4)?;
        if emulation::is_emulated() {
            emulation::write_flash(offset, bytes);
            return Ok(());
        }
        let first = (&raw mut _settings_start).cast::<u32>();
        let (words, _) = bytes.as_chunks::<4>();
        for (&word, index) in words.iter().zip(offset / 4..) {
            self.operate(|flash, _| {
                flash
                    .cr()
                    .write(|w| w.psize().variant(PSIZE::Psize32).pg().set_bit());
                // SAFETY: `sector_offset` keeps it in the sectors, which nothing refers to.
                unsafe { first.add(index).write_volatile(u32::from_le_bytes(word)) };
                while flash.sr().read().bsy().bit_is_set() {}
                true
            })?;
            // The chip says nothing of a bit that was to be set and stays clear.
            // SAFETY: see above.
            if unsafe { first.add(index).read_volatile() } != u32::from_le_bytes(word) {
                return Err(FlashError::Refused);
            }
        }
        Ok(())
    }
}

/// Returns the offset in the sectors at which an operation begins.
fn sector_offset(offset: u32, length: usize, unit: usize) -> Result<usize, FlashError> {
    let offset = offset as usize;
    if !offset.is_multiple_of(unit) || !length.is_multiple_of(unit) {
        return Err(FlashError::NotAligned);
    }
    match offset.checked_add(length) {
        Some(end) if end <= BOTH => Ok(offset),
        Some(_) | None => Err(FlashError::OutOfBounds),
    }
}

fn has_errors(flash: &pac::FLASH) -> bool {
    let status = flash.sr().read();
    status.pgserr().bit() || status.pgperr().bit() || status.pgaerr().bit() || status.wrperr().bit()
}

fn clear_errors(flash: &pac::FLASH) {
    flash.sr().write(|w| {
        w.pgserr().clear_bit_by_one().pgperr().clear_bit_by_one();
        w.pgaerr().clear_bit_by_one().wrperr().clear_bit_by_one()
    });
}

/// Erases a sector, and receives what the sender sends meanwhile. Returns false, with nothing done,
/// while the step timer runs: the door may have been opened, and Z be on its way to be parked.
///
/// Runs from RAM, and calls nothing that does not. No task runs, as each would wait for the flash
/// with the receiver's bytes behind it.
#[inline(never)]
#[unsafe(link_section = ".data.erase")]
#[expect(unsafe_code, reason = "a section in RAM, and the tasks' threshold")]
fn erase(flash: &pac::FLASH, sector: u8, mut receiver: Option<&mut FlashEraseReceiver>) -> bool {
    let threshold = basepri::read();
    // SAFETY: the threshold only rises, for the time of this function.
    unsafe { basepri::write(ALL_TASKS) };
    let is_still = !step_timer::is_running();
    if is_still {
        flash.cr().write(|w| {
            w.psize().variant(PSIZE::Psize32);
            // SAFETY: one of the numbers of sectors.
            unsafe { w.snb().bits(sector) };
            w.ser().set_bit().strt().set_bit()
        });
        while flash.sr().read().bsy().bit_is_set() {
            if let Some(receiver) = &mut receiver {
                receiver.receive();
            }
        }
    }
    // SAFETY: as it was before.
    unsafe { basepri::write(threshold) };
    is_still
}
