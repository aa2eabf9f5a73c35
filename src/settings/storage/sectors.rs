//! Two flash sectors as the pages of the journal, whose erasing survives a power cut.
//!
//! A sector whose erase was cut off may hold anything, also contents that look like a page in use. So
//! the end of each sector is a log of the erases of the *other* one:
//!
//! ```text
//! sector 0 │ page 0 … │ log: (begun, done) (begun, done) …  of erasing sector 1 │
//! sector 1 │ page 1 … │ log: (begun, done) (begun, done) …  of erasing sector 0 │
//! ```
//!
//! `begun` is programmed before an erase, `done` after it. If the last erase is not done, it is
//! repeated before anything is read.
//!
//! A log that is itself half erased may show an old erase as not done. So `begun` is a number, one
//! higher each time, with its complement: bits that are erased or not yet programmed make the word
//! invalid but never a higher number. No word is programmed twice.
//!
//! An erase may have to wait. `sequential-storage` erases a page only after it has closed the other one, so
//! while erasing is postponed, closing a page is refused, before anything has changed.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind};
use embedded_storage_async::nor_flash as page;

use crate::settings::Erasing;

/// Bytes of the log at the end of a sector: 64 erases of the other sector before its own.
const LOG_BYTES: usize = 512;
/// Bytes of an entry of the log.
const ENTRY_BYTES: usize = 8;
/// The second word of an entry whose erase is done.
const DONE: [u8; 4] = [0; 4];
/// A word that is not programmed.
const ERASED: [u8; 4] = [0xff; 4];

/// Two sectors of a flash, from its beginning.
#[derive(Debug)]
pub(super) struct Sectors<F> {
    pub(super) flash: F,
    pub(super) erasing: Erasing,
}

/// The reason for which an operation on a page fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PageError {
    /// The flash fails.
    Flash,
    /// It would need an erase.
    MustWait,
}

impl NorFlashError for PageError {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<F: NorFlash> Sectors<F> {
    /// Bytes of a page.
    pub(super) const PAGE_BYTES: usize = {
        assert!(F::READ_SIZE <= 4 && F::WRITE_SIZE <= 4);
        F::ERASE_SIZE - LOG_BYTES
    };
    /// Bytes of both pages.
    pub(super) const PAGES_BYTES: u32 = 2 * Self::PAGE_BYTES as u32;

    /// Refuses what needs an erase, now or next.
    pub(super) fn check_erasing(&self) -> Result<(), PageError> {
        match self.erasing {
            Erasing::Allowed => Ok(()),
            Erasing::Postponed => Err(PageError::MustWait),
        }
    }

    /// Repeats the erase that a power cut has interrupted.
    pub(super) fn recover(&mut self) -> Result<(), PageError> {
        let last = self.last_erase().or(Err(PageError::Flash))?;
        if let Some(last) = last
            && last.done == ERASED
        {
            self.check_erasing()?;
            self.erase_sector(last.sector)
                .and_then(|()| self.flash.write(last.entry + 4, &DONE))
                .or(Err(PageError::Flash))?;
        }
        Ok(())
    }

    /// Erases both sectors.
    pub(super) fn erase(&mut self) -> Result<(), F::Error> {
        self.erase_logged(0)?;
        self.erase_logged(1)
    }

    /// Returns whether no byte is programmed.
    pub(super) fn is_blank(&mut self) -> Result<bool, F::Error> {
        let mut bytes = [0; 64];
        for address in (0..2 * F::ERASE_SIZE as u32).step_by(bytes.len()) {
            self.flash.read(address, &mut bytes)?;
            if bytes != [0xff; 64] {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Erases a sector so that a power cut cannot leave it half erased.
    fn erase_logged(&mut self, sector: u32) -> Result<(), F::Error> {
        let number = self.last_erase()?.map_or(0, |last| last.number);
        let mut free_entry = None;
        for entry in log::<F>(sector).step_by(ENTRY_BYTES) {
            if self.word(entry)? == ERASED && self.word(entry + 4)? == ERASED {
                free_entry = Some(entry);
                break;
            }
        }
        // A log is full after dozens of power cuts in a row; then the erase is not protected.
        let Some(entry) = free_entry else {
            return self.erase_sector(sector);
        };
        self.flash.write(entry, &begun(number.saturating_add(1)))?;
        self.erase_sector(sector)?;
        self.flash.write(entry + 4, &DONE)
    }

    /// Returns the last erase that was begun.
    fn last_erase(&mut self) -> Result<Option<LoggedErase>, F::Error> {
        let mut last: Option<LoggedErase> = None;
        for sector in [0, 1] {
            for entry in log::<F>(sector).step_by(ENTRY_BYTES) {
                let word = self.word(entry)?;
                let number = u16::from_le_bytes([word[0], word[1]]);
                if word == begun(number) && last.is_none_or(|last| last.number < number) {
                    let done = self.word(entry + 4)?;
                    last = Some(LoggedErase {
                        number,
                        sector,
                        entry,
                        done,
                    });
                }
            }
        }
        Ok(last)
    }

    fn erase_sector(&mut self, sector: u32) -> Result<(), F::Error> {
        let size = F::ERASE_SIZE as u32;
        self.flash.erase(sector * size, (sector + 1) * size)
    }

    fn word(&mut self, address: u32) -> Result<[u8; 4], F::Error> {
        let mut word = [0; 4];
        self.flash.read(address, &mut word)?;
        Ok(word)
    }

    /// Returns the address of a byte of the pages.
    fn address(offset: u32) -> u32 {
        let page = Self::PAGE_BYTES as u32;
        offset / page * F::ERASE_SIZE as u32 + offset % page
    }
}

/// An entry of the log.
#[derive(Clone, Copy)]
struct LoggedErase {
    number: u16,
    /// The sector that is erased.
    sector: u32,
    /// Address of the entry.
    entry: u32,
    done: [u8; 4],
}

/// Returns the first word of an entry.
const fn begun(number: u16) -> [u8; 4] {
    let (number, complement) = (number.to_le_bytes(), (!number).to_le_bytes());
    [number[0], number[1], complement[0], complement[1]]
}

/// Returns the addresses of the log of a sector's erases, in the other sector.
fn log<F: NorFlash>(sector: u32) -> core::ops::Range<u32> {
    let end = (2 - sector) * F::ERASE_SIZE as u32;
    end - LOG_BYTES as u32..end
}

impl<F: NorFlash> ErrorType for Sectors<F> {
    type Error = PageError;
}

impl<F: NorFlash> page::ReadNorFlash for Sectors<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PageError> {
        let read = self.flash.read(Self::address(offset), bytes);
        read.or(Err(PageError::Flash))
    }

    fn capacity(&self) -> usize {
        Self::PAGES_BYTES as usize
    }
}

impl<F: NorFlash> page::NorFlash for Sectors<F> {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = Self::PAGE_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), PageError> {
        self.check_erasing()?;
        let page = Self::PAGE_BYTES as u32;
        for sector in from / page..to / page {
            self.erase_logged(sector).or(Err(PageError::Flash))?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PageError> {
        let page = Self::PAGE_BYTES as u32;
        if offset % page == page - Self::WRITE_SIZE as u32 {
            // The mark of a closed page.
            self.check_erasing()?;
        }
        let written = self.flash.write(Self::address(offset), bytes);
        written.or(Err(PageError::Flash))
    }
}
