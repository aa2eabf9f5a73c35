//! What is stored, in two sectors of flash: each change is a new record after the old ones.
//!
//! Owns the flash. The newest record of a part that is whole counts; `sequential-storage` finds it
//! by a CRC-32 of its contents, a CRC-16 of its length, and closes a full page and carries the
//! newest records over before it erases the old page. What it leaves open, a page half erased, is
//! closed by `sectors.rs`.
//!
//! `$RST` touches several parts and must happen at once: every record bears the generation of its
//! group of parts, one record says which generations count, and older ones count as absent. So a
//! `$RST` is one record as well.

use core::{
    fmt,
    future::Future,
    pin::pin,
    task::{Context, Poll, Waker},
};

use embedded_storage::nor_flash::NorFlash;
use sequential_storage::{
    Error,
    cache::{
        Cache, key_pointers::ArrayKeyPointers, page_pointers::ArrayPagePointers,
        page_states::ArrayPageStates,
    },
    map::{MapConfig, MapStorage},
};

use super::{
    record::{self, GENERATIONS, Generations, KEYS, Part, Record},
    sectors::Sectors,
};
use crate::settings::{Change, StoreError, Stored};

/// Bytes of the longest record that can be read; newer firmware may write longer ones than this.
const LONGEST: usize = 1024;

type Found = Cache<ArrayPageStates<2>, ArrayPagePointers<2>, ArrayKeyPointers<u8, KEYS>, u8>;
type Map<'a, F> = MapStorage<u8, &'a mut Sectors<F>, Found>;

/// The journal in the first two sectors of a flash.
///
/// A change may take long, an erase stops some chips for up to 0.8 s: only at rest.
pub struct Journal<F: NorFlash> {
    sectors: Sectors<F>,
    /// Where the newest records are, so that a full page is carried over in one pass.
    found: Found,
    /// Of each group the newest generation that was ever seen; `None` until it is read.
    generations: Option<Generations>,
}

impl<F: NorFlash> fmt::Debug for Journal<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut journal = f.debug_struct("Journal");
        journal.field("generations", &self.generations);
        journal.finish_non_exhaustive()
    }
}

/// What was stored when the power came.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// Everything stored.
    pub stored: Stored,
    /// Whether nothing was ever stored, or nothing of it can be read.
    pub is_first_boot: bool,
}

impl Default for Loaded {
    /// A new machine.
    fn default() -> Self {
        Self {
            stored: Stored::default(),
            is_first_boot: true,
        }
    }
}

/// Why the pages cannot be used.
#[derive(Debug)]
enum Fault {
    /// They hold no journal, or one damaged beyond repair.
    Unreadable,
    /// The flash fails, or what is asked for is impossible.
    Refused(StoreError),
}

impl Fault {
    /// The reason that is told to the user. A journal that was just made anew is readable, so
    /// if it is not, there was no room.
    fn reason(self) -> StoreError {
        match self {
            Self::Unreadable => StoreError::NoRoom,
            Self::Refused(error) => error,
        }
    }
}

impl From<StoreError> for Fault {
    fn from(error: StoreError) -> Self {
        Self::Refused(error)
    }
}

impl<S> From<Error<S>> for Fault {
    fn from(error: Error<S>) -> Self {
        match error {
            Error::Storage { .. } => Self::Refused(StoreError::Flash),
            // Its enum may grow; all else is about what the pages hold.
            _ => Self::Unreadable,
        }
    }
}

impl<F: NorFlash> Journal<F> {
    /// A journal in a flash that holds one, or anything else.
    #[must_use]
    pub fn new(flash: F) -> Self {
        Self {
            sectors: Sectors { flash },
            found: nothing_found(),
            generations: None,
        }
    }

    /// The flash.
    pub fn flash(&mut self) -> &mut F {
        &mut self.sectors.flash
    }

    /// The flash, given back.
    #[must_use]
    pub fn into_flash(self) -> F {
        self.sectors.flash
    }

    /// Reads everything and makes good what a power cut has left undone; once, after power-up.
    ///
    /// A flash without a journal is made one.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the flash fails.
    pub fn load(&mut self) -> Result<Loaded, StoreError> {
        let is_new = match self.read_all() {
            Ok(Some(stored)) => {
                return Ok(Loaded {
                    stored,
                    is_first_boot: false,
                });
            }
            // A record of nothing, so that there is no second first boot.
            Ok(None) if self.is_blank()? => self.put_generations(Generations::default()),
            Ok(None) | Err(Fault::Unreadable) => self.format(),
            Err(refused @ Fault::Refused(_)) => Err(refused),
        };
        is_new.map(|()| Loaded::default()).map_err(Fault::reason)
    }

    /// Stores what has changed; `stored` is everything as it shall be.
    ///
    /// A power cut at any time leaves what was stored before, or all of the change.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the flash fails, [`StoreError::NoRoom`] for a startup line that
    /// there is not.
    pub fn write(&mut self, change: Change, stored: &Stored) -> Result<(), StoreError> {
        match self.write_change(change, stored) {
            // Whatever the pages hold, everything is at hand.
            Err(Fault::Unreadable) => self.rewrite(stored),
            result @ (Ok(()) | Err(Fault::Refused(_))) => result,
        }
        .map_err(Fault::reason)
    }

    fn write_change(&mut self, change: Change, stored: &Stored) -> Result<(), Fault> {
        match change {
            Change::Settings => self.put(Part::Settings, stored),
            Change::Origins => self.put(Part::Origins, stored),
            Change::Startup(line) => {
                let part = Part::startup(line).ok_or(StoreError::NoRoom)?;
                self.put(part, stored)
            }
            Change::BuildInfo => self.put(Part::BuildInfo, stored),
            Change::RestoreSettings => self.restore(&[Part::Settings]),
            Change::RestoreOrigins => self.restore(&[Part::Origins]),
            Change::RestoreAll => self.restore(&Part::ALL),
        }
    }

    /// Everything that is stored; `None` when nothing ever was.
    fn read_all(&mut self) -> Result<Option<Stored>, Fault> {
        self.sectors.recover().or(Err(StoreError::Flash))?;
        let valid = self.fetch_generations()?;
        let mut newest = valid.unwrap_or_default();
        let mut is_empty = valid.is_none();
        let mut stored = Stored::default();
        // wcet-bound: 5
        for part in Part::ALL {
            let mut buffer = [0; LONGEST];
            let Some(record) = self.fetch(part as u8, &mut buffer)? else {
                continue;
            };
            is_empty = false;
            let known = newest.of(part);
            // A newer one than is known: the record of generations was lost, this one was not.
            if let Some((generation, contents)) = record::open(record)
                && generation >= *known
            {
                *known = generation;
                part.read(contents, &mut stored);
            }
        }
        self.generations = Some(newest);
        Ok((!is_empty).then_some(stored))
    }

    /// The generations that count. They are known after [`Journal::load`].
    fn generations(&mut self) -> Result<Generations, Fault> {
        if self.generations.is_none() {
            self.read_all()?;
        }
        Ok(self.generations.unwrap_or_default())
    }

    fn fetch_generations(&mut self) -> Result<Option<Generations>, Fault> {
        let mut buffer = [0; LONGEST];
        let record = self.fetch(GENERATIONS, &mut buffer)?;
        Ok(record
            .and_then(record::open)
            .map(|(_, contents)| Generations::read(contents)))
    }

    /// Makes records of these parts older than any that counts.
    fn restore(&mut self, parts: &[Part]) -> Result<(), Fault> {
        let mut generations = self.generations()?;
        for &part in parts {
            let generation = generations.of(part);
            *generation = generation.wrapping_add(1);
        }
        // Also if this fails, for it may have come as far as to count.
        self.generations = Some(generations);
        self.put_generations(generations)
    }

    fn put_generations(&mut self, generations: Generations) -> Result<(), Fault> {
        self.generations = Some(generations);
        let mut record = Record::new(0);
        generations.write(&mut record)?;
        self.store(GENERATIONS, &record)
    }

    /// Stores a part, unless just this is stored.
    fn put(&mut self, part: Part, stored: &Stored) -> Result<(), Fault> {
        let generation = *self.generations()?.of(part);
        let mut record = Record::new(generation);
        part.write(stored, &mut record)?;
        if self.is_newest(part as u8, &record)? {
            return Ok(());
        }
        self.store(part as u8, &record)
    }

    fn is_newest(&mut self, key: u8, record: &Record) -> Result<bool, Fault> {
        let mut buffer = [0; LONGEST];
        Ok(self.fetch(key, &mut buffer)? == Some(record.bytes()))
    }

    fn is_blank(&mut self) -> Result<bool, StoreError> {
        self.sectors.is_blank().or(Err(StoreError::Flash))
    }

    /// Gives up what the pages hold and stores everything anew.
    fn rewrite(&mut self, stored: &Stored) -> Result<(), Fault> {
        self.format()?;
        // wcet-bound: 5
        Part::ALL
            .iter()
            .try_for_each(|&part| self.put(part, stored))
    }

    /// Gives up what the pages hold.
    fn format(&mut self) -> Result<(), Fault> {
        self.found = nothing_found();
        self.sectors.erase().or(Err(StoreError::Flash))?;
        self.put_generations(Generations::default())
    }

    fn fetch<'a>(&mut self, key: u8, buffer: &'a mut [u8]) -> Result<Option<&'a [u8]>, Fault> {
        self.operate(|map| Ok(complete(map.fetch_item(buffer, &key))?))
    }

    /// Stores a record. A word that has lost a bit without being programmed spoils the first one that is
    /// put there: then it is put once more, behind that place.
    fn store(&mut self, key: u8, record: &Record) -> Result<(), Fault> {
        match self.append(key, record) {
            Err(Fault::Refused(StoreError::Flash)) => self.append(key, record),
            result => result,
        }
    }

    #[inline(never)]
    fn append(&mut self, key: u8, record: &Record) -> Result<(), Fault> {
        let mut buffer = [0; LONGEST];
        self.operate(|map| {
            Ok(complete(map.store_item(
                &mut buffer,
                &key,
                &record.bytes(),
            ))?)
        })
    }

    fn operate<T>(&mut self, operation: impl FnOnce(&mut Map<'_, F>) -> T) -> T {
        let pages = const { MapConfig::new(0..Sectors::<F>::BOTH) };
        let found = core::mem::replace(&mut self.found, nothing_found());
        let mut map = MapStorage::new(&mut self.sectors, pages, found);
        let result = operation(&mut map);
        self.found = map.destroy().1;
        result
    }
}

fn nothing_found() -> Found {
    Cache::new(
        ArrayPageStates::new(),
        ArrayPagePointers::new(),
        ArrayKeyPointers::new(),
    )
}

/// Runs a future that never waits, because no operation of the flash does.
fn complete<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    // wcet-bound: 1
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
    }
}
