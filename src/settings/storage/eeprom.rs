//! The storage in an EEPROM, for boards whose flash has no room: two copies of each record.
//!
//! ```text
//! first copies   0x0000          │ generations │ settings │ origins │ $N0 │ $N1 │ $I │ tools … │
//! second copies  0x1000, 0x0800  │ the same                                                    │
//! copy           number of the change: u32 │ length: u16 │ record │ CRC-32 of all before
//! ```
//!
//! The whole copy with the higher number counts. A change is written over the other copy, so that a loss of power at
//! any byte leaves the contents of before. Then the older copy is marked as such by the highest bit of its length,
//! which counts as 0 in the CRC-32. A marked copy without a whole newer copy says that the newer copy is damaged, not
//! torn. The record of generations has a bit for each record that was ever stored. No copy shares a page with another:
//! a page that is being written may lose all of its bytes. Where each copy is never changes, or firmware could not read
//! what older firmware has stored.
//!
//! An EEPROM of 4 KiB has room for half as many tools, each on one page, and for the settings of four axes.

use super::{
    journal::Loaded,
    record::{self, Generations, Key, RECORD_BYTES, Record},
};
use crate::{
    axis::AXES,
    settings::{Change, Changes, StoreError, Stored, ToolEntry, ToolTable},
};

/// Bytes of a page of the smallest EEPROM that is large enough: larger ones have whole pages of more.
pub const PAGE_BYTES: usize = 32;
/// KiB of the larger EEPROM, which has room for all tools and axes: more change nothing.
pub const EEPROM_KIB: usize = 8;
/// KiB of the smallest one.
pub const SMALL_EEPROM_KIB: usize = 4;

/// The bit of the length of a copy that is marked as older.
const OLDER_COPY: u16 = 1 << 15;
/// Bytes of the number and the length, and of the checksum.
const HEADER_BYTES: usize = 6;
const CHECKSUM_BYTES: usize = 4;

/// Where the copies of each kind of record are among the first ones, and their bytes: whole pages.
#[derive(Debug)]
struct Layout {
    generations: (usize, usize),
    settings: (usize, usize),
    origins: (usize, usize),
    lines: [(usize, usize); 3],
    first_tool: (usize, usize),
    tools: usize,
}

/// Of 8 KiB, on pages of 64 bytes.
const LARGE: Layout = Layout {
    generations: (0, 64),
    settings: (64, LONGEST_BYTES),
    origins: (768, LONGEST_BYTES),
    lines: [(1472, 192), (1664, 192), (1856, 192)],
    first_tool: (2048, 64),
    tools: 32,
};

/// Of 4 KiB, on pages of 32 bytes.
const SMALL: Layout = Layout {
    generations: (0, 64),
    settings: (64, 512),
    origins: (576, 480),
    lines: [(1056, 160), (1216, 160), (1376, 160)],
    first_tool: (1536, 32),
    tools: 16,
};

const LONGEST_BYTES: usize = 704;

const _: () = assert!(
    RECORD_BYTES + HEADER_BYTES + CHECKSUM_BYTES <= LONGEST_BYTES,
    "the longest record has no room in the EEPROM: give it the room of tools"
);

/// Number of records with room for all tools.
const RECORDS: usize = 1 + Key::ALL.len() + LARGE.tools;
/// The index of the record of generations, and that of the first tool's.
const GENERATIONS_INDEX: usize = 0;
const FIRST_TOOL_INDEX: usize = 1 + Key::ALL.len();

/// An EEPROM.
pub trait Eeprom {
    /// Reads bytes.
    ///
    /// # Errors
    /// If the EEPROM does not answer.
    fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), EepromError>;

    /// Writes bytes of one page of [`PAGE_BYTES`].
    ///
    /// # Errors
    /// If the EEPROM does not answer.
    fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EepromError>;
}

/// The reason for which an EEPROM fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EepromError {
    /// It does not acknowledge, in the time that a write takes.
    NoAcknowledge,
    /// Something holds a line of the bus low.
    Stuck,
}

impl From<EepromError> for StoreError {
    fn from(_: EepromError) -> Self {
        Self::Flash
    }
}

/// The storage in an EEPROM of so many KiB, [`SMALL_EEPROM_KIB`] or [`EEPROM_KIB`], in the place of
/// [`Journal`](super::Journal).
#[derive(Debug)]
pub struct EepromStore<E, const KIB: usize = EEPROM_KIB> {
    eeprom: E,
    /// The copy of each record that counts, after [`Self::load`].
    newest: [Option<StoredCopy>; RECORDS],
    /// The newest generation of each key.
    generations: Generations,
    /// The records that were stored once, a bit for each index.
    present: u64,
    /// Those whose newest copy is missing.
    lost: u64,
}

/// A whole copy of a record.
#[derive(Debug, Clone, Copy)]
struct StoredCopy {
    number: u32,
    is_second: bool,
    length: u16,
    /// There was a newer one.
    is_old: bool,
}

impl<E, const KIB: usize> EepromStore<E, KIB> {
    const LAYOUT: Layout = if KIB < EEPROM_KIB { SMALL } else { LARGE };
    const RECORDS: usize = FIRST_TOOL_INDEX + Self::LAYOUT.tools;

    /// Tools that there is room for.
    pub const TOOLS: usize = Self::LAYOUT.tools;

    /// Whether there is room for the settings and the origins of this firmware's axes.
    pub const HAS_ROOM: bool = {
        let extra = HEADER_BYTES + CHECKSUM_BYTES;
        record::settings_record_bytes(AXES) + extra <= Self::LAYOUT.settings.1
            && record::origins_record_bytes(AXES) + extra <= Self::LAYOUT.origins.1
    };

    /// Returns the address of a copy of a record, and the bytes that it may have.
    const fn place(index: usize, is_second: bool) -> (u16, usize) {
        let layout = Self::LAYOUT;
        let (offset, bytes) = match index {
            GENERATIONS_INDEX => layout.generations,
            1 => layout.settings,
            2 => layout.origins,
            3 => layout.lines[0],
            4 => layout.lines[1],
            5 => layout.lines[2],
            index => {
                let (first, bytes) = layout.first_tool;
                (first + bytes * (index - FIRST_TOOL_INDEX), bytes)
            }
        };
        let first = if is_second { KIB * 1024 / 2 } else { 0 };
        ((first + offset) as u16, bytes)
    }
}

impl<E: Eeprom, const KIB: usize> EepromStore<E, KIB> {
    /// Returns the storage in an EEPROM with any contents.
    #[must_use]
    pub const fn new(eeprom: E) -> Self {
        Self {
            eeprom,
            newest: [None; RECORDS],
            generations: Generations::NONE,
            present: 0,
            lost: 0,
        }
    }

    /// Returns the EEPROM, mutably.
    pub fn eeprom(&mut self) -> &mut E {
        &mut self.eeprom
    }

    /// Reads everything but the tool table; once, after power-up.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the EEPROM fails.
    pub fn load(&mut self) -> Result<Loaded, StoreError> {
        for index in 0..Self::RECORDS {
            let newest = self.find_newest(index)?;
            if let Some(known) = self.newest.get_mut(index) {
                *known = newest;
            }
        }
        let mut buffer = [0; RECORD_BYTES];
        if let Some((_, contents)) = self.fetch(GENERATIONS_INDEX, &mut buffer)? {
            self.generations = Generations::read(contents);
            self.present = read_present(contents);
        }
        self.assess();
        let mut stored = Stored::default();
        for key in Key::ALL {
            let Some((generation, contents)) = self.fetch(index_of(key), &mut buffer)? else {
                continue;
            };
            let known = self.generations.of(key);
            // A record of a newer generation than is known: the record of generations was lost.
            if generation >= *known {
                *known = generation;
                key.read(contents, &mut stored);
            }
        }
        for slot in 0..Self::TOOLS {
            if let Some((generation, _)) = self.fetch(FIRST_TOOL_INDEX + slot, &mut buffer)? {
                let known = self.generations.of_tools();
                *known = generation.max(*known);
            }
        }
        let is_first_boot = self.newest.iter().all(Option::is_none);
        let present = self.present;
        for (index, copy) in self.newest.iter().enumerate().skip(1) {
            self.present |= u64::from(copy.is_some()) << index;
        }
        if is_first_boot {
            // One record, so that there is no second first boot.
            self.write_generations()?;
        } else if self.is_lost(GENERATIONS_INDEX) || self.present != present {
            // Everything is read, whatever becomes of it.
            let _ = self.write_generations();
        }
        let mut damaged = Changes::default();
        for index in (1..Self::RECORDS).filter(|&index| self.is_lost(index)) {
            damaged.insert(record::change_at(record_index(index)));
        }
        damaged.clear_lines(&mut stored);
        Ok(Loaded {
            stored,
            is_first_boot,
            damaged,
        })
    }

    /// Finds out what is lost. All that is stored may be, where the newest record of generations is: what a restoration
    /// has cleared may be there again. So each copy is marked, and that record can be written anew.
    fn assess(&mut self) {
        let copies = self.newest;
        let has_any = copies.iter().any(Option::is_some);
        let has_generations = copies[GENERATIONS_INDEX].is_some_and(|copy| !copy.is_old);
        for (index, copy) in copies.iter().enumerate() {
            match copy {
                Some(copy) if copy.is_old => self.lost |= 1 << index,
                Some(copy) if !has_generations => {
                    self.mark_old(index, *copy);
                    self.lost |= 1 << index;
                }
                None if self.present & 1 << index != 0 => self.lost |= 1 << index,
                Some(_) | None => {}
            }
        }
        self.lost |= u64::from(has_any && !has_generations) << GENERATIONS_INDEX;
    }

    const fn is_lost(&self, index: usize) -> bool {
        self.lost & 1 << index != 0
    }

    /// Reads the tool table, after [`Self::load`]: into its place, as it is large.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the EEPROM fails. The table has what has been read before.
    pub fn load_tools(&mut self, tools: &mut ToolTable) -> Result<(), StoreError> {
        tools.clear();
        let counting = *self.generations.of_tools();
        let mut buffer = [0; RECORD_BYTES];
        for slot in 0..Self::TOOLS {
            if let Some((generation, contents)) =
                self.fetch(FIRST_TOOL_INDEX + slot, &mut buffer)?
                && generation == counting
            {
                let tool = if KIB < EEPROM_KIB {
                    record::read_short_tool(contents)
                } else {
                    record::read_tool(contents)
                };
                tools.replace(slot, tool);
            }
        }
        Ok(())
    }

    /// Stores a change; `stored` and `tools` have everything with the change made.
    ///
    /// A loss of power at any time leaves the contents of before, or all of the change.
    ///
    /// # Errors
    /// [`StoreError::Flash`] when the EEPROM fails, [`StoreError::NoRoom`] for a startup line or a slot
    /// that does not exist.
    #[inline(never)]
    pub fn write(
        &mut self,
        change: Change,
        stored: &Stored,
        tools: &ToolTable,
    ) -> Result<(), StoreError> {
        match change {
            Change::Settings => self.write_key(Key::Settings, stored),
            Change::Origins => self.write_key(Key::Origins, stored),
            Change::Startup(line) => {
                let key = Key::startup(line).ok_or(StoreError::NoRoom)?;
                self.write_key(key, stored)
            }
            Change::BuildInfo => self.write_key(Key::BuildInfo, stored),
            Change::Tool(slot) => self.write_tool(slot, tools.slot(slot)),
            Change::RestoreSettings => self.outdate(change, &[Key::Settings]),
            Change::RestoreOrigins => self.outdate(change, &[Key::Origins]),
            Change::RestoreAll => self.outdate(change, &Key::ALL),
        }
    }

    /// Makes all records of these keys older than any that counts, and those of the tools where a change
    /// clears these.
    fn outdate(&mut self, change: Change, keys: &[Key]) -> Result<(), StoreError> {
        if change.clears_tools() {
            let generation = self.generations.of_tools();
            *generation = generation.wrapping_add(1);
        }
        for &key in keys {
            let generation = self.generations.of(key);
            *generation = generation.wrapping_add(1);
        }
        self.write_generations()?;
        // Restored is all of it; what is not mended is reported again.
        let _ = self.mend(change, keys);
        Ok(())
    }

    /// Stores what a change restores and is lost.
    fn mend(&mut self, change: Change, keys: &[Key]) -> Result<(), StoreError> {
        for &key in keys {
            if self.is_lost(index_of(key)) {
                self.write_key(key, &Stored::default())?;
            }
        }
        for slot in 0..Self::TOOLS {
            if change.clears_tools() && self.is_lost(FIRST_TOOL_INDEX + slot) {
                self.write_tool(slot, None)?;
            }
        }
        Ok(())
    }

    fn write_generations(&mut self) -> Result<(), StoreError> {
        let mut record = Record::new(0);
        self.generations.write(&mut record)?;
        write_present(self.present, &mut record)?;
        self.store_copy(GENERATIONS_INDEX, record.bytes())
    }

    fn write_key(&mut self, key: Key, stored: &Stored) -> Result<(), StoreError> {
        let mut record = Record::new(*self.generations.of(key));
        key.write(stored, &mut record)?;
        self.store(index_of(key), record.bytes())
    }

    fn write_tool(&mut self, slot: usize, tool: Option<ToolEntry>) -> Result<(), StoreError> {
        if slot >= Self::TOOLS {
            return Err(StoreError::NoRoom);
        }
        let mut record = Record::new(*self.generations.of_tools());
        if KIB < EEPROM_KIB {
            record::write_short_tool(tool, &mut record)?;
        } else {
            record::write_tool(tool, &mut record)?;
        }
        self.store(FIRST_TOOL_INDEX + slot, record.bytes())
    }

    /// Returns the generation and the contents of a record.
    fn fetch<'a>(
        &mut self,
        index: usize,
        buffer: &'a mut [u8; RECORD_BYTES],
    ) -> Result<Option<(u32, &'a [u8])>, EepromError> {
        let Some(copy) = self.newest.get(index).copied().flatten() else {
            return Ok(None);
        };
        let (address, _) = Self::place(index, copy.is_second);
        let Some(record) = buffer.get_mut(..copy.length.into()) else {
            return Ok(None);
        };
        self.eeprom.read(address + HEADER_BYTES as u16, record)?;
        Ok(record::open(record))
    }

    /// Returns the copy of a record that counts.
    fn find_newest(&mut self, index: usize) -> Result<Option<StoredCopy>, EepromError> {
        let first = self.whole_copy(index, false)?;
        let second = self.whole_copy(index, true)?;
        let (Some(first), Some(second)) = (first, second) else {
            return Ok(first.or(second));
        };
        let (older, newer) = if second.number > first.number {
            (first, second)
        } else {
            (second, first)
        };
        // The power was cut before the mark, or firmware without marks has written the newer one.
        if !older.is_old {
            self.mark_old(index, older);
        }
        Ok(Some(newer))
    }

    /// Marks a copy that is older than another one. Where that fails, the next start does it.
    fn mark_old(&mut self, index: usize, copy: StoredCopy) {
        let (address, _) = Self::place(index, copy.is_second);
        let [_, high] = (copy.length | OLDER_COPY).to_le_bytes();
        let place = address + HEADER_BYTES as u16 - 1;
        let _ = self.eeprom.write(place, &[high]);
    }

    /// Returns a copy of a record, if it is whole.
    fn whole_copy(
        &mut self,
        index: usize,
        is_second: bool,
    ) -> Result<Option<StoredCopy>, EepromError> {
        let (address, bytes) = Self::place(index, is_second);
        let mut header = [0; HEADER_BYTES];
        self.eeprom.read(address, &mut header)?;
        let [a, b, c, d, low, high] = header;
        let length = u16::from_le_bytes([low, high]);
        let is_old = length & OLDER_COPY != 0;
        let length = length & !OLDER_COPY;
        header[HEADER_BYTES - 1] = length.to_le_bytes()[1];
        let end = HEADER_BYTES + usize::from(length);
        if end + CHECKSUM_BYTES > bytes || usize::from(length) > RECORD_BYTES {
            return Ok(None);
        }
        let mut checksum = Crc32::NEW.with(&header);
        let mut piece = [0; PAGE_BYTES];
        for from in (HEADER_BYTES..end).step_by(piece.len()) {
            let bytes = piece.len().min(end - from);
            let piece = piece.split_at_mut(bytes).0;
            self.eeprom.read(address + from as u16, piece)?;
            checksum = checksum.with(piece);
        }
        let mut written = [0; CHECKSUM_BYTES];
        self.eeprom.read(address + end as u16, &mut written)?;
        let number = u32::from_le_bytes([a, b, c, d]);
        Ok((written == checksum.bytes()).then_some(StoredCopy {
            number,
            is_second,
            length,
            is_old,
        }))
    }

    /// Stores a record over the copy that does not count, unless the same is stored.
    fn store(&mut self, index: usize, record: &[u8]) -> Result<(), StoreError> {
        self.store_copy(index, record)?;
        if self.present & 1 << index != 0 {
            return Ok(());
        }
        self.present |= 1 << index;
        // The record is stored all the same; the next start completes this.
        let _ = self.write_generations();
        Ok(())
    }

    fn store_copy(&mut self, index: usize, record: &[u8]) -> Result<(), StoreError> {
        let newest = self.newest.get(index).copied().flatten();
        if let Some(copy) = newest
            && !self.is_lost(index)
            && usize::from(copy.length) == record.len()
        {
            let (address, _) = Self::place(index, copy.is_second);
            if self.has(address + HEADER_BYTES as u16, record)? {
                return Ok(());
            }
        }
        let copy = StoredCopy {
            number: newest.map_or(1, |copy| copy.number.saturating_add(1)),
            is_second: newest.is_some_and(|copy| !copy.is_second),
            length: u16::try_from(record.len()).or(Err(StoreError::NoRoom))?,
            is_old: false,
        };
        self.write_copy(index, copy, record)?;
        if let Some(newest) = self.newest.get_mut(index) {
            *newest = Some(copy);
        }
        self.lost &= !(1 << index);
        if let Some(older) = newest {
            self.mark_old(index, older);
        }
        Ok(())
    }

    fn write_copy(
        &mut self,
        index: usize,
        copy: StoredCopy,
        record: &[u8],
    ) -> Result<(), StoreError> {
        let mut image = heapless::Vec::<u8, LONGEST_BYTES>::new();
        let full = |()| StoreError::NoRoom;
        let header = [
            &copy.number.to_le_bytes()[..],
            &copy.length.to_le_bytes(),
            record,
        ];
        for part in header {
            image.extend_from_slice(part).map_err(|_| full(()))?;
        }
        let checksum = Crc32::NEW.with(&image).bytes();
        image.extend_from_slice(&checksum).map_err(|_| full(()))?;
        let (address, bytes) = Self::place(index, copy.is_second);
        if image.len() > bytes {
            return Err(StoreError::NoRoom);
        }
        for (at, page) in (address..)
            .step_by(PAGE_BYTES)
            .zip(image.chunks(PAGE_BYTES))
        {
            self.eeprom.write(at, page)?;
        }
        // One that is protected against writing acknowledges, and changes nothing.
        if self.has(address, &image)? {
            Ok(())
        } else {
            Err(StoreError::Flash)
        }
    }

    /// Returns whether the EEPROM has some bytes at an address.
    fn has(&mut self, address: u16, bytes: &[u8]) -> Result<bool, EepromError> {
        let mut found = [0; PAGE_BYTES];
        for (at, expected) in (address..)
            .step_by(PAGE_BYTES)
            .zip(bytes.chunks(PAGE_BYTES))
        {
            let found = found.split_at_mut(expected.len()).0;
            self.eeprom.read(at, found)?;
            if found != expected {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Returns the index of the record of a key.
const fn index_of(key: Key) -> usize {
    1 + key as usize
}

/// Returns the index among all keys of a record that is not that of generations.
const fn record_index(index: usize) -> usize {
    match index.checked_sub(FIRST_TOOL_INDEX) {
        Some(slot) => record::FIRST_TOOL_INDEX + slot,
        None => index - 1,
    }
}

/// The keys in the record of generations for both halves of the bits of the records that were stored once.
const PRESENT_KEYS: [u8; 2] = [0x40, 0x41];

fn read_present(contents: &[u8]) -> u64 {
    let entries = contents.as_chunks::<5>().0;
    let half = |key| {
        let entry = entries.iter().find(|entry| entry[0] == key);
        entry.map_or(0, |[_, half @ ..]| u64::from(u32::from_le_bytes(*half)))
    };
    PRESENT_KEYS
        .into_iter()
        .rev()
        .fold(0, |bits, key| bits << 32 | half(key))
}

fn write_present(present: u64, record: &mut Record) -> Result<(), StoreError> {
    for (key, half) in PRESENT_KEYS.into_iter().zip([present, present >> 32]) {
        record.append(&[key])?;
        record.append(&(half as u32).to_le_bytes())?;
    }
    Ok(())
}

/// CRC-32 as of Ethernet (IEEE 802.3), bit by bit.
#[derive(Clone, Copy)]
struct Crc32(u32);

impl Crc32 {
    const NEW: Self = Self(u32::MAX);
    const POLYNOMIAL: u32 = 0xedb8_8320;

    fn with(self, bytes: &[u8]) -> Self {
        Self(bytes.iter().fold(self.0, |sum, &byte| {
            (0..8).fold(sum ^ u32::from(byte), |sum, _| {
                sum >> 1 ^ if sum & 1 == 0 { 0 } else { Self::POLYNOMIAL }
            })
        }))
    }

    fn bytes(self) -> [u8; CHECKSUM_BYTES] {
        (!self.0).to_le_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_ethernet() {
        let sum = u32::from_le_bytes(Crc32::NEW.with(b"123456789").bytes());
        assert_eq!(sum, 0xcbf4_3926, "the check value of the catalogue of CRCs");
    }

    fn check_places<const KIB: usize>(page: usize) {
        let mut end = 0;
        for is_second in [false, true] {
            for index in 0..EepromStore::<(), KIB>::RECORDS {
                let (address, bytes) = EepromStore::<(), KIB>::place(index, is_second);
                assert_eq!((usize::from(address), bytes % page), (end, 0));
                end += bytes;
            }
        }
        assert_eq!(end, KIB * 1024);
    }

    #[test]
    fn no_copy_shares_a_page_with_another() {
        check_places::<SMALL_EEPROM_KIB>(32);
        check_places::<EEPROM_KIB>(64);
    }

    /// Bytes of `$790` and `$794`: no board with an EEPROM makes arcs in whole steps.
    const ARC_SETTINGS: usize = 2 * 5;

    #[test]
    fn the_small_eeprom_has_room_for_16_tools_and_four_axes() {
        const {
            assert!(EepromStore::<(), SMALL_EEPROM_KIB>::TOOLS == 16);
            assert!(EepromStore::<(), EEPROM_KIB>::HAS_ROOM);
        }
        let needed = |axes| {
            let records = [
                record::settings_record_bytes(axes) - ARC_SETTINGS,
                record::origins_record_bytes(axes),
            ];
            records.map(|bytes| bytes + 10)
        };
        let room = [SMALL.settings.1, SMALL.origins.1];
        let fits = |axes| {
            needed(axes)
                .into_iter()
                .zip(room)
                .all(|(needed, room)| needed <= room)
        };
        assert!(fits(3) && fits(4), "{:?} bytes of {room:?}", needed(4));
        assert!(
            !fits(5),
            "five axes fit, too: {:?} bytes of {room:?}",
            needed(5)
        );
    }
}
