//! The journal: two sectors of flash in which each change is a new record after the old ones.
//!
//! The journal owns the flash. The newest whole record of each key counts: `sequential-storage`
//! finds it by a CRC-32 of its contents and a CRC-16 of its length, and copies the newest records
//! to the other page before it erases a full one. `sectors.rs` protects that erase against a power
//! cut.
//!
//! `$RST` changes several keys and must happen at once. Each record bears a generation of its key, and
//! one record says which generations count; records of older generations count as absent. So a `$RST`
//! is one record as well.

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
    record::{self, GENERATIONS, Generations, KEYS, Key, RECORD_BYTES, Record},
    sectors::{PageError, Sectors},
};
use crate::settings::{Change, Erasing, StoreError, Stored, TOOLS, ToolTable};

/// Bytes of the longest record that can be read: longer than any of this firmware, as newer
/// firmware may write longer ones.
const BUFFER_BYTES: usize = 1024;
const _: () = assert!(
    BUFFER_BYTES > RECORD_BYTES,
    "make BUFFER_BYTES larger: it must hold a record and its key"
);

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
}

impl Default for Loaded {
    /// Returns the contents of a new machine.
    fn default() -> Self {
        Self {
            stored: Stored::default(),
            is_first_boot: true,
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
            sectors: Sectors {
                flash,
                erasing: Erasing::Allowed,
            },
            cache: empty_cache(),
            generations: None,
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
            Ok(Some(stored)) => {
                return Ok(Loaded {
                    stored,
                    is_first_boot: false,
                });
            }
            // One record, so that there is no second first boot.
            Ok(None) if self.is_blank()? => self.write_generations(Generations::default()),
            Ok(None) | Err(Fault::Unreadable) => self.format(),
            Err(refused @ Fault::Refused(_)) => Err(refused),
        };
        prepared
            .map(|()| Loaded::default())
            .map_err(Fault::into_store_error)
    }

    /// Reads the tool table, after [`Self::load`]: into its place, as it is large.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the flash fails. The table has what has been read before.
    pub fn load_tools(&mut self, tools: &mut ToolTable) -> Result<(), StoreError> {
        tools.clear();
        let read = self.generations().and_then(|mut generations| {
            let mut generation = *generations.of_tools();
            self.read_tools(&mut generation, Some(tools))
        });
        read.map(|_| ()).map_err(Fault::into_store_error)
    }

    /// Stores a change; `stored` and `tools` have everything with the change made. Where it clears the
    /// tools, `tools` is not read.
    ///
    /// A power cut at any time leaves the contents of before, or all of the change.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the flash fails, [`StoreError::NoRoom`] for a startup line or a slot
    /// that does not exist, [`StoreError::MustWait`] when erasing is postponed and the change needs it, or comes
    /// after one that does.
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

    /// Returns everything that is stored; `None` when nothing ever was.
    fn read_all(&mut self) -> Result<Option<Stored>, Fault> {
        self.sectors.recover()?;
        let valid = self.fetch_generations()?;
        let mut newest = valid.unwrap_or_default();
        let mut is_empty = valid.is_none();
        let mut stored = Stored::default();
        for key in Key::ALL {
            let mut buffer = [0; BUFFER_BYTES];
            let Some(record) = self.fetch(key as u8, &mut buffer)? else {
                continue;
            };
            is_empty = false;
            let known = newest.of(key);
            // A record of a newer generation than is known: the record of generations was lost.
            if let Some((generation, contents)) = record::open(record)
                && generation >= *known
            {
                *known = generation;
                key.read(contents, &mut stored);
            }
        }
        is_empty &= !self.read_tools(newest.of_tools(), None)?;
        self.generations = Some(newest);
        Ok((!is_empty).then_some(stored))
    }

    /// Reads the records of the tools, those of newer generations than is known to find it out, and the
    /// tools of this generation into the table. Returns whether there is any record.
    fn read_tools(
        &mut self,
        generation: &mut u32,
        mut tools: Option<&mut ToolTable>,
    ) -> Result<bool, Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        self.operate(|map| {
            let mut has_record = false;
            let mut records = poll_once(map.fetch_all_items(&mut buffer))?;
            // From the oldest record to the newest.
            while let Some((key, record)) = poll_once(records.next::<&[u8]>(&mut buffer))? {
                let Some(slot) = record::tool_slot(key) else {
                    continue;
                };
                has_record = true;
                let Some((newer, contents)) = record::open(record) else {
                    continue;
                };
                *generation = newer.max(*generation);
                if let Some(tools) = tools.as_deref_mut()
                    && newer == *generation
                {
                    tools.replace(slot, record::read_tool(contents));
                }
            }
            Ok(has_record)
        })
    }

    /// Returns the generations that count, which are known after [`Journal::load`].
    fn generations(&mut self) -> Result<Generations, Fault> {
        if self.generations.is_none() {
            self.read_all()?;
        }
        Ok(self.generations.unwrap_or_default())
    }

    fn fetch_generations(&mut self) -> Result<Option<Generations>, Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        let record = self.fetch(GENERATIONS, &mut buffer)?;
        Ok(record
            .and_then(record::open)
            .map(|(_, contents)| Generations::read(contents)))
    }

    /// Makes all records of these keys older than any that counts, and those of the tools where a change
    /// clears these.
    fn outdate(&mut self, change: Change, keys: &[Key]) -> Result<(), Fault> {
        let mut generations = self.generations()?;
        if change.clears_tools() {
            let generation = generations.of_tools();
            *generation = generation.wrapping_add(1);
        }
        for &key in keys {
            let generation = generations.of(key);
            *generation = generation.wrapping_add(1);
        }
        // Also if the write fails: the record may be complete enough to count.
        self.generations = Some(generations);
        self.write_generations(generations)
    }

    fn write_generations(&mut self, generations: Generations) -> Result<(), Fault> {
        self.generations = Some(generations);
        let mut record = Record::new(0);
        generations.write(&mut record)?;
        self.store(GENERATIONS, &record)
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
        if self.is_newest(key, record)? {
            return Ok(());
        }
        self.store(key, record)
    }

    fn is_newest(&mut self, key: u8, record: &Record) -> Result<bool, Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        Ok(self.fetch(key, &mut buffer)? == Some(record.bytes()))
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
        self.sectors.erase().or(Err(StoreError::Flash))?;
        self.write_generations(Generations::default())
    }

    fn fetch<'a>(&mut self, key: u8, buffer: &'a mut [u8]) -> Result<Option<&'a [u8]>, Fault> {
        self.operate(|map| Ok(poll_once(map.fetch_item(buffer, &key))?))
    }

    /// Stores a record. A word that has lost a bit without being programmed spoils the first record
    /// written there; the record is then written once more, after that word.
    fn store(&mut self, key: u8, record: &Record) -> Result<(), Fault> {
        match self.append(key, record) {
            Err(Fault::Refused(StoreError::Flash)) => self.append(key, record),
            result => result,
        }
    }

    #[inline(never)]
    fn append(&mut self, key: u8, record: &Record) -> Result<(), Fault> {
        let mut buffer = [0; BUFFER_BYTES];
        self.operate(|map| {
            Ok(poll_once(map.store_item(
                &mut buffer,
                &key,
                &record.bytes(),
            ))?)
        })
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
