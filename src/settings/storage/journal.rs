//! The journal: two sectors of flash in which each change is a new record after the old ones.
//!
//! The journal owns the flash. The newest whole record of each key counts. `sequential-storage` finds this record by a
//! CRC-32 of its contents and a CRC-16 of its length, and copies the newest records to the other page before it erases
//! a full one. `sectors.rs` protects that erase against a power cut.
//!
//! `$RST` changes several keys and must happen at once. Each record bears a generation of its key, and
//! one record says which generations count; records of older generations count as absent. So a `$RST`
//! is one record as well.
//!
//! Where a record is damaged, the record before it would count. So each record bears a stamp with the versions of all
//! keys (`stamp.rs`), and marks at the end of the sector say which changes have been stored (`sectors.rs`). What is
//! found to be missing is reported at each start, until it is stored anew. Records without stamps, of older firmware,
//! are stored with them at the first start.

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
    record::{
        self, FIRST_TOOL_INDEX, GENERATIONS, GENERATIONS_INDEX, Generations, KEYS, Key,
        RECORD_BYTES, Record,
    },
    sectors::{MARKED_KEYS, PageError, Sectors},
    stamp::{STAMP_BYTES, Stamp, Stamped, Versions, next_version},
};
use crate::settings::{Change, Changes, Erasing, StoreError, Stored, TOOLS, ToolTable};

/// Bytes of the longest record that can be read: longer than any of this firmware, as newer
/// firmware may write longer ones.
const BUFFER_BYTES: usize = 1024;
const _: () = assert!(
    BUFFER_BYTES > STAMP_BYTES + RECORD_BYTES,
    "make BUFFER_BYTES larger: it must hold a record and its key"
);

/// How often a record is written at most, where words are damaged.
const APPENDS: u32 = 8;

type RecordCache = Cache<ArrayPageStates<2>, ArrayPagePointers<2>, ArrayKeyPointers<u8, KEYS>, u8>;
type Map<'a, F> = MapStorage<u8, &'a mut Sectors<F>, RecordCache>;

/// The journal in the first two sectors of a flash.
///
/// Changes are for standstill only, and erasing may have to wait: it stops some chips for up to 0.8 s.
pub struct Journal<F: NorFlash> {
    sectors: Sectors<F>,
    /// Addresses of the newest records, so that a full page is copied in one pass.
    cache: RecordCache,
    /// The newest generation of each key; `None` until the journal is read.
    generations: Option<Generations>,
    /// The newest stamp: the versions that the keys should have.
    stamp: Stamp,
    /// The versions of the records that are found.
    found: Versions,
    /// A change waits for an erase, and every later one behind it.
    is_full: bool,
}

impl<F: NorFlash> fmt::Debug for Journal<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut journal = f.debug_struct("Journal");
        journal.field("generations", &self.generations);
        journal.finish_non_exhaustive()
    }
}

/// The contents of the journal at power-up.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// The contents.
    pub stored: Stored,
    /// Whether the journal was empty or unreadable.
    pub is_first_boot: bool,
    /// What is damaged: an older record stands in for it, or the default, as always for a startup line.
    pub damaged: Changes,
}

impl Default for Loaded {
    /// Returns the contents of a new machine.
    fn default() -> Self {
        Self {
            stored: Stored::default(),
            is_first_boot: true,
            damaged: Changes::default(),
        }
    }
}

/// What is in the pages.
struct Survey {
    /// The key of the record with the newest stamp, or else of the last record; `None` without any.
    newest_key: Option<u8>,
    /// The keys whose newest record has no stamp.
    without_stamp: [bool; KEYS],
}

impl Default for Survey {
    fn default() -> Self {
        Self {
            newest_key: None,
            without_stamp: [false; KEYS],
        }
    }
}

/// The reason for which the pages cannot be used.
#[derive(Debug)]
enum Fault {
    /// The pages hold no journal, or one damaged beyond repair.
    Unreadable,
    /// The flash fails, or the change is impossible.
    Refused(StoreError),
}

impl Fault {
    /// Returns the error that is reported. A journal that has just been made anew is readable; if
    /// it is not, there was no room.
    fn into_store_error(self) -> StoreError {
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

impl From<PageError> for Fault {
    fn from(error: PageError) -> Self {
        Self::Refused(match error {
            PageError::Flash => StoreError::Flash,
            PageError::MustWait => StoreError::MustWait,
        })
    }
}

impl From<Error<PageError>> for Fault {
    fn from(error: Error<PageError>) -> Self {
        match error {
            Error::Storage { value, .. } => value.into(),
            // The enum may grow; all other errors are about the contents of the pages.
            _ => Self::Unreadable,
        }
    }
}

impl<F: NorFlash> Journal<F> {
    /// Returns the journal in a flash with any contents.
    #[must_use]
    pub fn new(flash: F) -> Self {
        Self {
            sectors: Sectors::new(flash),
            cache: empty_cache(),
            generations: None,
            stamp: Stamp::NONE,
            found: Stamp::NONE.versions,
            is_full: false,
        }
    }

    /// Returns the flash, mutably.
    pub fn flash(&mut self) -> &mut F {
        &mut self.sectors.flash
    }

    /// Returns the flash.
    #[must_use]
    pub fn into_flash(self) -> F {
        self.sectors.flash
    }

    /// Reads everything but the tool table, and completes an operation that a power cut has interrupted; once, after
    /// power-up.
    ///
    /// A flash without a journal gets an empty one.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the flash fails.
    pub fn load(&mut self) -> Result<Loaded, StoreError> {
        let prepared = match self.read_all() {
            Ok(Some(mut stored)) => {
                let damaged = self.damaged();
                damaged.clear_lines(&mut stored);
                return Ok(Loaded {
                    stored,
                    is_first_boot: false,
                    damaged,
                });
            }
            // One record, so that there is no second first boot.
            Ok(None) if self.is_blank()? => self.write_generations(Generations::default()),
            Ok(None) | Err(Fault::Unreadable) => self.begin_anew(),
            Err(refused @ Fault::Refused(_)) => Err(refused),
        };
        prepared
            .map(|()| Loaded {
                damaged: self.damaged(),
                ..Loaded::default()
            })
            .map_err(Fault::into_store_error)
    }

    /// Reads the tool table, after [`Self::load`]: into its place, as it is large.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the flash fails. The table has what has been read before.
    pub fn load_tools(&mut self, tools: &mut ToolTable) -> Result<(), StoreError> {
        tools.clear();
        let read = self.generations().and_then(|mut generations| {
            let counting = *generations.of_tools();
            self.visit(|key, stamped| {
                if let Some(slot) = record::tool_slot(key)
                    && let Some((generation, contents)) = record::open(stamped.record)
                    && generation == counting
                {
                    tools.replace(slot, record::read_tool(contents));
                }
            })
        });
        read.map_err(Fault::into_store_error)
    }

    /// Stores a change; `stored` and `tools` have everything with the change made. Where it clears the
    /// tools, `tools` is not read.
    ///
    /// A power cut at any time leaves the contents of before, or all of the change.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the flash fails, [`StoreError::NoRoom`] for a startup line or a slot
    /// that does not exist, [`StoreError::MustWait`] when erasing is postponed and this change needs an erase, or comes
    /// after a change that does.
    #[inline(never)]
    pub fn write(
        &mut self,
        change: Change,
        erasing: Erasing,
        stored: &Stored,
        tools: &ToolTable,
    ) -> Result<(), StoreError> {
        self.is_full &= erasing == Erasing::Postponed;
        if self.is_full {
            return Err(StoreError::MustWait);
        }
        self.sectors.erasing = erasing;
        let written = self.write_or_rewrite(change, stored, tools);
        self.is_full = written == Err(StoreError::MustWait);
        written
    }

    fn write_or_rewrite(
        &mut self,
        change: Change,
        stored: &Stored,
        tools: &ToolTable,
    ) -> Result<(), StoreError> {
        match self.write_change(change, stored, tools) {
            // `stored` and `tools` are complete without the pages.
            Err(Fault::Unreadable) => self.rewrite(change, stored, tools),
            result @ (Ok(()) | Err(Fault::Refused(_))) => result,
        }
        .map_err(Fault::into_store_error)
    }

    fn write_change(
        &mut self,
        change: Change,
        stored: &Stored,
        tools: &ToolTable,
    ) -> Result<(), Fault> {
        match change {
            Change::Settings => self.write_key(Key::Settings, stored),
            Change::Origins => self.write_key(Key::Origins, stored),
            Change::Startup(line) => {
                let key = Key::startup(line).ok_or(StoreError::NoRoom)?;
                self.write_key(key, stored)
            }
            Change::BuildInfo => self.write_key(Key::BuildInfo, stored),
            Change::Tool(slot) => self.write_tool(slot, tools),
            Change::RestoreSettings => self.outdate(change, &[Key::Settings]),
            Change::RestoreOrigins => self.outdate(change, &[Key::Origins]),
            Change::RestoreAll => self.outdate(change, &Key::ALL),
        }
    }

    /// Returns everything that is stored; `None` when nothing ever was, or nothing is found.
    fn read_all(&mut self) -> Result<Option<Stored>, Fault> {
        self.sectors.recover()?;
        let mut newest = self.fetch_generations()?;
        let survey = self.survey(newest.of_tools())?;
        self.assess(&survey)?;
        let Some(key) = survey.newest_key else {
            return Ok(None);
        };
        if !self.has_record(key)? {
            // Records in a page that does not count as used.
            return Err(Fault::Unreadable);
        }
        let mut stored = Stored::default();
        for key in Key::ALL {
            let mut buffer = [0; BUFFER_BYTES];
            let record = self.fetch(key as u8, &mut buffer)?;
            let known = newest.of(key);
            // A record of a newer generation than is known: the record of generations was lost.
            if let Some((generation, contents)) = record.and_then(record::open)
                && generation >= *known
            {
                *known = generation;
                key.read(contents, &mut stored);
            }
        }
        self.generations = Some(newest);
        // Everything is read, whatever becomes of it.
        let _ = self.stamp_all(&survey);
        Ok(Some(stored))
    }

    /// Finds the newest stamp, the version of each key's newest record, and the generation of the newest tools.
    fn survey(&mut self, of_tools: &mut u32) -> Result<Survey, Fault> {
        let mut survey = Survey::default();
        let (mut newest, mut found) = (Stamp::NONE, Stamp::NONE.versions);
        self.visit(|key, stamped| {
            let Some(index) = record::index_of(key) else {
                return;
            };
            if index >= FIRST_TOOL_INDEX
                && let Some((generation, _)) = record::open(stamped.record)
            {
                *of_tools = generation.max(*of_tools);
            }
            let stamp = stamped.stamp.unwrap_or(Stamp::NONE);
            found[index] = stamp.versions[index];
            survey.without_stamp[index] = stamped.stamp.is_none();
            if stamp.number >= newest.number {
                newest = stamp;
                survey.newest_key = Some(key);
            }
        })?;
        (self.stamp, self.found) = (newest, found);
        Ok(survey)
    }

    /// Compares what is found with what should be.
    fn assess(&mut self, survey: &Survey) -> Result<(), Fault> {
        let flash = |_| StoreError::Flash;
        let found = self.stamp.number;
        let marks = self.sectors.newest_marks().map_err(flash)?;
        self.sectors.newest = found;
        match marks {
            None if found != 0 => self.lose_all(),
            // Nothing, or what older firmware has left.
            None if survey.newest_key.is_none() => {}
            None => self.sectors.begin_marks().map_err(flash)?,
            // The power was cut before the mark.
            Some(marks) if marks.newest < found => {
                // Without it, this record would not be missed.
                let key = survey.newest_key.unwrap_or(GENERATIONS);
                let _ = self.sectors.append_mark(marks, key);
            }
            Some(marks) => {
                for missing in (found..marks.newest).rev().take(MARKED_KEYS + 1) {
                    let key = self.sectors.marked_key(marks, missing + 1);
                    match key.map_err(flash)?.and_then(record::index_of) {
                        Some(index) => self.lose(index),
                        None => self.lose_all(),
                    }
                }
                self.stamp.number = marks.newest;
                self.sectors.newest = marks.newest;
            }
        }
        let newest = self.stamp.versions[GENERATIONS_INDEX];
        // The first one of a journal is as none.
        if self.is_lost(GENERATIONS_INDEX) && newest != 1 {
            // The records that a restoration has cleared may count again: each key is reported as lost until it is
            // stored anew.
            for index in 0..KEYS {
                if self.stamp.versions.get(index) != Some(&0) {
                    self.lose(index);
                }
            }
            self.stamp.versions[GENERATIONS_INDEX] = self.found[GENERATIONS_INDEX].max(1);
        }
        Ok(())
    }

    /// Notes that the newest record of a key is missing.
    #[inline(never)]
    fn lose(&mut self, index: usize) {
        if let (Some(version), Some(found)) = (
            self.stamp.versions.get_mut(index),
            self.found.get(index).copied(),
        ) && *version == found
        {
            *version = next_version(found);
        }
    }

    /// Notes that the newest record of any key may be missing.
    fn lose_all(&mut self) {
        (0..KEYS)
            .filter(|&index| index != GENERATIONS_INDEX)
            .for_each(|index| self.lose(index));
    }

    #[inline(never)]
    fn is_lost(&self, index: usize) -> bool {
        self.stamp.versions.get(index) != self.found.get(index)
    }

    /// Returns what is damaged.
    fn damaged(&self) -> Changes {
        let mut damaged = Changes::default();
        for index in (0..KEYS).filter(|&index| index != GENERATIONS_INDEX) {
            if self.is_lost(index) {
                damaged.insert(record::change_at(index));
            }
        }
        damaged
    }

    /// Stores the records without a stamp with one.
    fn stamp_all(&mut self, survey: &Survey) -> Result<(), Fault> {
        for index in 0..KEYS {
            let has_none = survey.without_stamp.get(index) == Some(&true);
            if let Some(key) = record::key_at(index).filter(|_| has_none && !self.is_lost(index)) {
                if index == GENERATIONS_INDEX {
                    // Not the first one of a journal.
                    self.stamp.versions[index] = 1;
                }
                let mut buffer = [0; BUFFER_BYTES];
                if let Some(record) = self.fetch(key, &mut buffer)? {
                    self.store(key, record)?;
                }
            }
        }
        Ok(())
    }

    /// Begins a new journal where none is found, or one that is damaged beyond repair. Where there are marks of one,
    /// everything is lost.
    fn begin_anew(&mut self) -> Result<(), Fault> {
        let marks = self.sectors.newest_marks().or(Err(StoreError::Flash))?;
        (self.stamp, self.found) = (Stamp::NONE, Stamp::NONE.versions);
        if let Some(marks) = marks.filter(|marks| marks.newest > 0) {
            self.stamp.number = marks.newest;
            self.sectors.newest = marks.newest;
            self.lose_all();
        }
        self.format()
    }

    /// Visits all records, from the oldest to the newest.
    fn visit(&mut self, mut visit: impl FnMut(u8, Stamped<'_>)) -> Result<(), Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        self.operate(|map| {
            let mut records = poll_once(map.fetch_all_items(&mut buffer))?;
            while let Some((key, stamped)) = poll_once(records.next::<Stamped<'_>>(&mut buffer))? {
                visit(key, stamped);
            }
            Ok(())
        })
    }

    /// Returns the generations that count, which are known after [`Journal::load`].
    fn generations(&mut self) -> Result<Generations, Fault> {
        if self.generations.is_none() {
            self.read_all()?;
        }
        Ok(self.generations.unwrap_or_default())
    }

    fn fetch_generations(&mut self) -> Result<Generations, Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        let record = self.fetch(GENERATIONS, &mut buffer)?;
        let opened = record.and_then(record::open);
        Ok(opened.map_or(Generations::NONE, |(_, contents)| {
            Generations::read(contents)
        }))
    }

    /// Makes all records of these keys older than any that counts, and those of the tools where a change
    /// clears these.
    fn outdate(&mut self, change: Change, keys: &[Key]) -> Result<(), Fault> {
        let mut generations = self.generations()?;
        let lost = self.stamp.versions;
        if change.clears_tools() {
            let generation = generations.of_tools();
            *generation = generation.wrapping_add(1);
            for index in FIRST_TOOL_INDEX..KEYS {
                self.stamp.versions[index] = self.found[index];
            }
        }
        for &key in keys {
            let generation = generations.of(key);
            *generation = generation.wrapping_add(1);
            self.stamp.versions[key as usize] = self.found[key as usize];
        }
        // Also if the write fails: the record may be complete enough to count.
        self.generations = Some(generations);
        let written = self.write_generations(generations);
        if written.is_err() {
            self.stamp.versions = lost;
        }
        written
    }

    fn write_generations(&mut self, generations: Generations) -> Result<(), Fault> {
        self.generations = Some(generations);
        let mut record = Record::new(0);
        generations.write(&mut record)?;
        self.store(GENERATIONS, record.bytes())
    }

    /// Stores the record of a key, unless the same is stored.
    fn write_key(&mut self, key: Key, stored: &Stored) -> Result<(), Fault> {
        let generation = *self.generations()?.of(key);
        let mut record = Record::new(generation);
        key.write(stored, &mut record)?;
        self.store_new(key as u8, &record)
    }

    /// Stores the record of a slot of the tool table, unless the same is stored.
    fn write_tool(&mut self, slot: usize, tools: &ToolTable) -> Result<(), Fault> {
        let key = record::tool_key(slot).ok_or(StoreError::NoRoom)?;
        let generation = *self.generations()?.of_tools();
        let mut record = Record::new(generation);
        record::write_tool(tools.slot(slot), &mut record)?;
        self.store_new(key, &record)
    }

    fn store_new(&mut self, key: u8, record: &Record) -> Result<(), Fault> {
        let is_lost = record::index_of(key).is_some_and(|index| self.is_lost(index));
        if !is_lost && self.is_newest(key, record)? {
            return Ok(());
        }
        self.store(key, record.bytes())
    }

    fn is_newest(&mut self, key: u8, record: &Record) -> Result<bool, Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        Ok(self.fetch(key, &mut buffer)? == Some(record.bytes()))
    }

    fn has_record(&mut self, key: u8) -> Result<bool, Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        Ok(self.fetch(key, &mut buffer)?.is_some())
    }

    fn is_blank(&mut self) -> Result<bool, StoreError> {
        self.sectors.is_blank().or(Err(StoreError::Flash))
    }

    /// Erases the pages and stores everything anew, after a change.
    fn rewrite(&mut self, change: Change, stored: &Stored, tools: &ToolTable) -> Result<(), Fault> {
        self.format()?;
        Key::ALL
            .iter()
            .try_for_each(|&key| self.write_key(key, stored))?;
        (0..TOOLS)
            .filter(|&slot| !change.clears_tools() && tools.slot(slot).is_some())
            .try_for_each(|slot| self.write_tool(slot, tools))
    }

    /// Erases the pages.
    fn format(&mut self) -> Result<(), Fault> {
        self.sectors.check_erasing()?;
        self.cache = empty_cache();
        for index in 0..KEYS {
            self.stamp.versions[index] = u8::from(self.is_lost(index));
            self.found[index] = 0;
        }
        self.sectors.erase().or(Err(StoreError::Flash))?;
        self.write_generations(Generations::default())
    }

    #[inline(never)]
    fn fetch<'a>(&mut self, key: u8, buffer: &'a mut [u8]) -> Result<Option<&'a [u8]>, Fault> {
        let stamped = self.operate(|map| poll_once(map.fetch_item::<Stamped<'_>>(buffer, &key)))?;
        Ok(stamped.map(|stamped| stamped.record))
    }

    /// Stores a record. A word that has lost a bit without being programmed spoils the first record
    /// written there; the record is then written again, after that word.
    #[inline(never)]
    fn store(&mut self, key: u8, record: &[u8]) -> Result<(), Fault> {
        let index = record::index_of(key).ok_or(StoreError::NoRoom)?;
        let mut stamp = self.stamp;
        stamp.number = stamp.number.saturating_add(1);
        stamp.versions[index] = next_version(stamp.versions[index]);
        let stamped = Stamped {
            stamp: Some(stamp),
            record,
        };
        let mut appended = self.append(key, &stamped);
        for _ in 1..APPENDS {
            if !matches!(appended, Err(Fault::Refused(StoreError::Flash))) {
                break;
            }
            appended = self.append(key, &stamped);
        }
        appended?;
        self.stamp = stamp;
        self.found[index] = stamp.versions[index];
        self.sectors.newest = stamp.number;
        // The record is stored all the same, and is marked at the next start.
        let _ = self.sectors.mark(key);
        Ok(())
    }

    #[inline(never)]
    fn append(&mut self, key: u8, stamped: &Stamped<'_>) -> Result<(), Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        Ok(self.operate(|map| poll_once(map.store_item(&mut buffer, &key, stamped)))?)
    }

    fn operate<T>(&mut self, operation: impl FnOnce(&mut Map<'_, F>) -> T) -> T {
        let pages = const { MapConfig::new(0..Sectors::<F>::PAGES_BYTES) };
        let cache = core::mem::replace(&mut self.cache, empty_cache());
        let mut map = MapStorage::new(&mut self.sectors, pages, cache);
        let result = operation(&mut map);
        self.cache = map.destroy().1;
        result
    }
}

fn empty_cache() -> RecordCache {
    Cache::new(
        ArrayPageStates::new(),
        ArrayPagePointers::new(),
        ArrayKeyPointers::new(),
    )
}

/// Runs a future that never waits, because no operation of the flash waits.
fn poll_once<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
    }
}
