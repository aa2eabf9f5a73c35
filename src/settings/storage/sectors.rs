//! Two flash sectors as the pages of the journal, whose erasing survives a power cut.
//!
//! A sector whose erase was cut off may hold anything, also contents that look like a page in use. So
//! the end of each sector is a log of the erases of the *other* one:
//!
//! ```text
//! sector 0 │ page 0 … │ log: (begun, done) (begun, done) …  of erasing sector 1 │ marks of page 0 │
//! sector 1 │ page 1 … │ log: (begun, done) (begun, done) …  of erasing sector 0 │ marks of page 1 │
//! ```
//!
//! `begun` is programmed before an erase, `done` after it. If the last erase is not done, it is
//! repeated before anything is read.
//!
//! A log that is itself half erased may show an old erase as not done. So `begun` is a number, one
//! higher each time, with its complement: bits that are erased or not yet programmed make the word
//! invalid but never a higher number. No word of it is programmed twice.
//!
//! The marks say which changes have been stored to their end, so that a record torn by a power cut differs from a
//! damaged record:
//!
//! ```text
//! marks │ base: u32, its complement │ the same, where the first is damaged │ key, key, … of each change after it │
//! ```
//!
//! The number of the newest change is the base and the number of keys. A base is there before the page is in use, and
//! a key is programmed after its record. Bits of a word may be cleared one after the other (RM0090 3.6.3).
//!
//! An erase may have to wait. `sequential-storage` erases a page only after it has closed the other one, so
//! while erasing is postponed, closing a page is refused, before anything has changed.

use core::ops::Range;

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind};
use embedded_storage_async::nor_flash as page;

use super::{record::HEADER_BYTES, stamp::STAMP_BYTES};
use crate::settings::Erasing;

/// Bytes of the log and the marks at the end of a sector.
const END_BYTES: usize = 512;
/// Bytes of the log: 29 erases of the other sector before its own.
const LOG_BYTES: usize = END_BYTES - MARKS_BYTES;
/// Bytes of a base, and bases.
const BASE_BYTES: usize = 8;
const BASES: usize = 2;
/// Keys that there is room for: as many as a page has records, of which the shortest is an empty line.
pub(super) const MARKED_KEYS: usize = 264;
const MARKS_BYTES: usize = BASES * BASE_BYTES + MARKED_KEYS;
/// Bytes of the shortest record in a page, with its header and its key, in whole words.
const SHORTEST_BYTES: usize = 8 + (1 + STAMP_BYTES + HEADER_BYTES).next_multiple_of(4);
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
    /// Number of the newest change that is stored to its end.
    pub(super) newest: u32,
    /// The sector that was written last.
    written: u32,
}

/// The marks of a page.
#[derive(Debug, Clone, Copy)]
pub(super) struct Marks {
    /// Number of the newest change.
    pub(super) newest: u32,
    /// Keys.
    keys: u32,
    sector: u32,
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
        let page = F::ERASE_SIZE - END_BYTES;
        assert!((page - 8) / SHORTEST_BYTES <= MARKED_KEYS);
        page
    };
    /// Bytes of both pages.
    pub(super) const PAGES_BYTES: u32 = 2 * Self::PAGE_BYTES as u32;

    /// Returns the sectors of a flash, from its beginning.
    pub(super) const fn new(flash: F) -> Self {
        Self {
            flash,
            erasing: Erasing::Allowed,
            newest: 0,
            written: 0,
        }
    }

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

    /// Returns the marks of the page in use.
    pub(super) fn newest_marks(&mut self) -> Result<Option<Marks>, F::Error> {
        let (first, second) = (self.marks(0)?, self.marks(1)?);
        let order = |marks: &Marks| (marks.newest, marks.keys);
        Ok(first.into_iter().chain(second).max_by_key(order))
    }

    /// Returns the key of a marked change; `None` for a change older than the marks.
    pub(super) fn marked_key(&mut self, marks: Marks, number: u32) -> Result<Option<u8>, F::Error> {
        let Some(index) = marks.keys.checked_sub(marks.newest - number + 1) else {
            return Ok(None);
        };
        let mut key = [0];
        self.flash.read(keys::<F>(marks.sector) + index, &mut key)?;
        Ok(Some(key[0]))
    }

    /// Begins the marks of the pages that firmware without marks has used.
    pub(super) fn begin_marks(&mut self) -> Result<(), F::Error> {
        for sector in [0, 1] {
            if self.word(sector * F::ERASE_SIZE as u32)? != ERASED {
                self.write_base(sector, self.newest)?;
            }
        }
        Ok(())
    }

    /// Marks the newest change, in the page that was written last.
    pub(super) fn mark(&mut self, key: u8) -> Result<(), F::Error> {
        self.mark_in(self.written, key)
    }

    /// Marks the newest change, in the page of these marks.
    pub(super) fn append_mark(&mut self, marks: Marks, key: u8) -> Result<(), F::Error> {
        self.mark_in(marks.sector, key)
    }

    #[inline(never)]
    fn mark_in(&mut self, sector: u32, key: u8) -> Result<(), F::Error> {
        if let Some(marks) = self.marks(sector)?
            && marks.newest.wrapping_add(1) == self.newest
            && marks.keys < MARKED_KEYS as u32
        {
            let place = keys::<F>(sector) + marks.keys;
            let mut word = self.word(place / 4 * 4)?;
            word[place as usize % 4] = key;
            self.flash.write(place / 4 * 4, &word)?;
        }
        let marks = self.marks(sector)?;
        if marks.is_none_or(|marks| marks.newest != self.newest) {
            // A base is damaged, or a bit of a key is.
            let keys = self.count_keys(sector)?;
            self.write_base(sector, self.newest.wrapping_sub(keys))?;
        }
        Ok(())
    }

    #[inline(never)]
    fn marks(&mut self, sector: u32) -> Result<Option<Marks>, F::Error> {
        let keys = self.count_keys(sector)?;
        Ok(self.base(sector)?.map(|base| Marks {
            newest: base.wrapping_add(keys),
            keys,
            sector,
        }))
    }

    fn count_keys(&mut self, sector: u32) -> Result<u32, F::Error> {
        let first = keys::<F>(sector);
        for count in 0..MARKED_KEYS as u32 {
            let mut key = [0];
            self.flash.read(first + count, &mut key)?;
            if key == [0xff] {
                return Ok(count);
            }
        }
        Ok(MARKED_KEYS as u32)
    }

    /// Returns the last valid base of a page.
    fn base(&mut self, sector: u32) -> Result<Option<u32>, F::Error> {
        let mut last = None;
        for place in bases::<F>(sector) {
            let base = u32::from_le_bytes(self.word(place)?);
            if self.word(place + 4)? == (!base).to_le_bytes() {
                last = Some(base);
            }
        }
        Ok(last)
    }

    /// Writes a base where there is room.
    fn write_base(&mut self, sector: u32, base: u32) -> Result<(), F::Error> {
        for place in bases::<F>(sector) {
            if self.word(place)? == ERASED && self.word(place + 4)? == ERASED {
                self.flash.write(place, &base.to_le_bytes())?;
                return self.flash.write(place + 4, &(!base).to_le_bytes());
            }
        }
        Ok(())
    }

    /// Begins the marks of a page that is going to be used. What a power cut has left of others is erased.
    fn begin_page(&mut self, sector: u32) -> Result<(), PageError> {
        let flash = |_| PageError::Flash;
        let marks = self.marks(sector).map_err(flash)?;
        if marks.is_some_and(|marks| marks.newest == self.newest) {
            return Ok(());
        }
        let first = keys::<F>(sector) - (BASES * BASE_BYTES) as u32;
        if self.word(first).map_err(flash)? != ERASED {
            self.check_erasing()?;
            self.erase_logged(sector).map_err(flash)?;
        }
        self.write_base(sector, self.newest).map_err(flash)
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
fn log<F: NorFlash>(sector: u32) -> Range<u32> {
    let begin = (2 - sector) * F::ERASE_SIZE as u32 - END_BYTES as u32;
    begin..begin + LOG_BYTES as u32
}

/// Returns the address of the first key in the marks of a page.
const fn keys<F: NorFlash>(sector: u32) -> u32 {
    (sector + 1) * F::ERASE_SIZE as u32 - MARKED_KEYS as u32
}

/// Returns the addresses of the bases of a page.
fn bases<F: NorFlash>(sector: u32) -> impl Iterator<Item = u32> {
    let end = keys::<F>(sector);
    (end - (BASES * BASE_BYTES) as u32..end).step_by(BASE_BYTES)
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
        self.written = offset / page;
        if offset.is_multiple_of(page) {
            // That of a page in use.
            self.begin_page(self.written)?;
        }
        let written = self.flash.write(Self::address(offset), bytes);
        written.or(Err(PageError::Flash))
    }
}
