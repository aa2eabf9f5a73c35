//! The flash of the journal: 16 KiB of each of two sectors, which the board's file chooses. RM0090 3.6, RM0390 3.5.
//!
//! The chip cannot read its flash while it erases or programs, so code in flash stands still: 16 µs
//! for a word and 100 µs at most (data sheet, `t_prog`), which is longer than a byte of the sender, up to 2 s for
//! a sector. Both are done at standstill only. The sender goes on meanwhile, so code in RAM waits for the end
//! and receives the bytes.
//!
//! # Cost
//!
//! [`erase`] and [`program`] are in RAM, with everything that they call inlined. They raise the threshold of the
//! processor's priorities above that of every task: each would wait for the flash, with the
//! receiver's bytes behind it.

use cortex_m::register::basepri;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use stm32f4xx_hal::pac::flash::cr::PSIZE;

use super::{
    chosen::{WIRING, flash_access},
    pac,
    serial::FlashEraseReceiver,
    step_timer, supply,
    vectors::nvic_priority,
    watchdog,
};

/// Bytes used of a sector, and of both sectors.
const SECTOR: usize = 16 * 1024;
pub(super) const BOTH: usize = 2 * SECTOR;
/// Threshold that masks every task: the priority of the step interrupt, the highest.
const MASK_ALL_TASKS: u8 = nvic_priority(5);
/// Keys that unlock programming and erasing.
const UNLOCK_KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];

/// `FLASH_CR` at rest.
const LOCKED: u32 = 1 << 31;

/// The two sectors, with the registers of the flash and the receiver for the time of an erase,
/// which is set before tasks run.
pub(crate) struct SettingsFlash {
    registers: pac::FLASH,
    receiver: Option<FlashEraseReceiver>,
}

/// The reason for which an operation fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FlashError {
    /// Not whole words or sectors.
    NotAligned,
    /// Beyond the end.
    OutOfBounds,
    /// The chip reports an error, the supply is too low, or the machine has begun to move.
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
    /// Returns the sectors, without a receiver.
    pub(super) const fn new(registers: pac::FLASH) -> Self {
        Self {
            registers,
            receiver: None,
        }
    }

    /// Sets the receiver for the time of an erase.
    pub(super) fn set_receiver(&mut self, receiver: FlashEraseReceiver) {
        self.receiver = Some(receiver);
    }

    /// Runs an operation on the unlocked registers.
    ///
    /// # Errors
    ///
    /// If the supply is too low, the operation returns false, or the chip reports an error.
    fn operate(
        &mut self,
        operation: impl FnOnce(&pac::FLASH, Option<&mut FlashEraseReceiver>) -> bool,
    ) -> Result<(), FlashError> {
        let flash = &self.registers;
        watchdog::feed();
        if supply::is_low() {
            return Err(FlashError::Refused);
        }
        // A bootloader may have left the flash unlocked; keys that are not asked for lock it up to a reset (RM0090
        // 3.6.1).
        if flash.cr().read().lock().bit_is_set() {
            for key in UNLOCK_KEYS {
                flash.keyr().write(|w| w.key().set(key));
            }
        }
        if flash.cr().read().lock().bit_is_set() {
            return Err(FlashError::Refused);
        }
        clear_errors(flash);
        let is_refused = !operation(flash, self.receiver.as_mut()) || has_errors(flash);
        clear_errors(flash);
        // Nothing but the lock: what a locked register keeps would erase or program with the next key.
        flash.cr().write(|w| w.lock().set_bit());
        let is_refused = is_refused || flash.cr().read().bits() != LOCKED;
        // The data cache holds the sector as it was before.
        flash.acr().write(|w| flash_access(w));
        flash.acr().write(|w| flash_access(w).dcrst().set_bit());
        flash.acr().write(|w| flash_access(w).dcen().set_bit());
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
        // A full journal takes long at the frequency of the internal oscillator.
        watchdog::feed();
        for (byte, index) in bytes.iter_mut().zip(offset..) {
            // SAFETY: `sector_offset` has checked that the byte is in the sectors.
            *byte = unsafe { (address(index) as *const u8).read_volatile() };
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
        let sectors = offset / SECTOR..(offset + length as usize) / SECTOR;
        for page in sectors {
            let sector = WIRING.journal[page].sector;
            self.operate(|flash, receiver| erase(flash, sector, receiver))?;
        }
        Ok(())
    }

    #[expect(unsafe_code, reason = "memory beside the program")]
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let offset = sector_offset(offset, bytes.len(), 4)?;
        let (words, _) = bytes.as_chunks::<4>();
        for (&word, index) in words.iter().zip((offset..).step_by(4)) {
            let place = address(index) as *mut u32;
            let word = u32::from_le_bytes(word);
            self.operate(|flash, receiver| program(flash, place, word, receiver))?;
            // The chip reports no error for a bit that should be set and stays clear.
            // SAFETY: `sector_offset` has checked that the word is in the sectors, which no reference points to.
            if unsafe { place.read_volatile() } != word {
                return Err(FlashError::Refused);
            }
        }
        Ok(())
    }
}

/// Returns the offset at which an operation begins.
///
/// # Errors
///
/// If the operation is not in the sectors, or not on whole units.
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

/// Returns the address of a byte of the journal.
fn address(offset: usize) -> usize {
    WIRING.journal[offset / SECTOR].address + offset % SECTOR
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

/// Erases a sector, and receives the bytes that come meanwhile. Returns false, with nothing erased,
/// while the step timer runs: the door may have been opened, and Z may be on its way to be parked.
#[inline(never)]
#[unsafe(link_section = ".data.erase")]
#[expect(unsafe_code, reason = "a section in RAM")]
fn erase(flash: &pac::FLASH, sector: u8, receiver: Option<&mut FlashEraseReceiver>) -> bool {
    alone(|| {
        flash.cr().write(|w| {
            // The PAC would set the lock, as a reset does.
            w.lock().clear_bit().psize().variant(PSIZE::Psize32);
            // SAFETY: a sector of this number exists.
            unsafe { w.snb().bits(sector) };
            w.ser().set_bit().strt().set_bit()
        });
        wait(flash, receiver);
    })
}

/// Programs a word of the journal, and receives the bytes that come meanwhile. Returns false, with nothing
/// written, while the step timer runs.
#[inline(never)]
#[unsafe(link_section = ".data.program")]
#[expect(
    unsafe_code,
    reason = "a section in RAM, and memory beside the program"
)]
fn program(
    flash: &pac::FLASH,
    place: *mut u32,
    word: u32,
    receiver: Option<&mut FlashEraseReceiver>,
) -> bool {
    alone(|| {
        flash.cr().write(|w| {
            w.lock()
                .clear_bit()
                .psize()
                .variant(PSIZE::Psize32)
                .pg()
                .set_bit()
        });
        // SAFETY: `SettingsFlash::write` has checked that the word is in the sectors, which no reference
        // points to.
        unsafe { place.write_volatile(word) };
        wait(flash, receiver);
    })
}

/// Calls a function while no task runs, unless the step timer does. Returns whether it was called.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
#[expect(unsafe_code, reason = "the tasks' threshold")]
fn alone(operate: impl FnOnce()) -> bool {
    let threshold = basepri::read();
    // SAFETY: the threshold masks more than before, for the time of this function.
    unsafe { basepri::write(MASK_ALL_TASKS) };
    let is_still = !step_timer::is_running();
    if is_still {
        operate();
    }
    // SAFETY: the threshold of before.
    unsafe { basepri::write(threshold) };
    is_still
}

/// Waits for the end of an operation.
///
/// Other chips of the family set the flag of a busy flash some cycles after the operation has begun: the
/// barrier and the first read let them pass.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
fn wait(flash: &pac::FLASH, mut receiver: Option<&mut FlashEraseReceiver>) {
    cortex_m::asm::dsb();
    let _ = flash.sr().read();
    while flash.sr().read().bsy().bit_is_set() {
        watchdog::feed();
        if let Some(receiver) = &mut receiver {
            receiver.receive();
        }
    }
}
