//! Records of the journal: the stored values as bytes.
//!
//! ```text
//! record      format: 1 │ generation: u32 │ contents
//! generations (key: u8, generation: u32)…
//! settings    (number: u16, type: u8, value)…
//! origins     axes: u8, (name: u8, (i64 as zigzag) for each axis)…: nm, or millionths of a degree
//! lines       the text
//! tool        number: u8, 0 for none, (i64 as zigzag) for X, Y, Z and the diameter: nm; i32 in 4 KiB
//! ```
//!
//! Numbers have their low byte first. Each value bears its type, so that firmware with other
//! settings, other axes or another type of the same setting can read it. A value that is unknown or
//! out of range is skipped; a missing one keeps its default.
//!
//! No 8 bytes in a row are all 0xFF: the journal takes these for flash that is not written.

use core::num::NonZeroU8;

use heapless::Vec;

use crate::{
    axis::{AXES, Axes, LETTERS},
    model::WorkCoordinates,
    settings::{
        Change, Kind, STARTUP_LINES, STORED_LINE, Setting, StoreError, Stored, StoredLine, TOOLS,
        ToolEntry, Value, setting, table::TABLE,
    },
    units::{MicroDegrees, Nm},
};

/// The format of the records. A change of it voids every record; a change of the contents does not
/// need it.
const FORMAT: u8 = 1;
/// Bytes of the format and the generation.
pub(super) const HEADER_BYTES: usize = 1 + 4;
/// Bytes of the longest record: of the settings or the origins with six axes.
pub(super) const RECORD_BYTES: usize = {
    let settings = settings_record_bytes(LETTERS.len());
    let origins = origins_record_bytes(LETTERS.len());
    if settings > origins {
        settings
    } else {
        origins
    }
};
/// Farthest coordinate that is read, nm: double precision holds it exactly.
const FARTHEST: u64 = 1 << 53;

const _: () = assert!(
    HEADER_BYTES + STORED_LINE <= RECORD_BYTES,
    "make STORED_LINE shorter, or count its record in RECORD_BYTES"
);

/// Bytes of all settings of a machine with `axes` axes.
const fn settings_bytes(axes: usize) -> usize {
    let (mut bytes, mut index) = (0, 0);
    while index < TABLE.len() {
        let row = &TABLE[index];
        let value_type = match row.kind {
            Kind::Flag(_)
            | Kind::AnyBit(_)
            | Kind::Bits(..)
            | Kind::AxisMask(_)
            | Kind::Byte { .. } => WHOLE,
            Kind::Number(..) | Kind::AxisNumber(..) => NUMBER,
            Kind::AxisResolution(_) => MILLIONTHS,
        };
        bytes += row.settings(axes) * (2 + 1 + value_bytes(value_type));
        index += 1;
    }
    bytes
}

/// Bytes of all origins, positions and rotations of a machine with `axes` axes.
const fn origins_bytes(axes: usize) -> usize {
    let systems = WorkCoordinates::ALL.len();
    1 + (systems + 2 + systems.div_ceil(axes)) * (1 + 8 * axes)
}

/// Bytes of the record of the settings of a machine with `axes` axes.
pub(super) const fn settings_record_bytes(axes: usize) -> usize {
    HEADER_BYTES + settings_bytes(axes)
}

/// Bytes of the longest record of its origins.
pub(super) const fn origins_record_bytes(axes: usize) -> usize {
    HEADER_BYTES + origins_bytes(axes)
}

/// Key of the record of generations.
pub(super) const GENERATIONS: u8 = 0x10;
/// Key of the record of the first slot of the tool table; those of the other slots follow.
const FIRST_TOOL: u8 = 0x20;
/// Number of keys.
pub(super) const KEYS: usize = FIRST_TOOL_INDEX + TOOLS;
/// The indices of the records of generations and of the first tool among those of all keys: the others' are first.
pub(super) const GENERATIONS_INDEX: usize = Key::ALL.len();
pub(super) const FIRST_TOOL_INDEX: usize = GENERATIONS_INDEX + 1;

/// The key of each record that holds something of [`Stored`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Key {
    Settings = 0,
    Origins = 1,
    Startup0 = 2,
    Startup1 = 3,
    BuildInfo = 4,
}

/// The generation of each key whose records count, and that of all tools; those of older ones count as
/// absent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Generations([u32; Key::ALL.len() + 1]);

impl Generations {
    /// Those of a new machine.
    pub(super) const NONE: Self = Self([0; Key::ALL.len() + 1]);

    /// Returns the generation of a key.
    pub(super) fn of(&mut self, key: Key) -> &mut u32 {
        &mut self.0[key as usize]
    }

    /// Returns the generation of the tools.
    pub(super) fn of_tools(&mut self) -> &mut u32 {
        &mut self.0[Key::ALL.len()]
    }

    /// Reads the contents of their record.
    pub(super) fn read(mut contents: &[u8]) -> Self {
        let mut generations = Self::default();
        while let (Some([key]), Some(generation)) = (next(&mut contents), next(&mut contents)) {
            if let Some(known) = generations.0.get_mut(usize::from(key)) {
                *known = u32::from_le_bytes(generation);
            }
        }
        generations
    }

    /// Writes the contents of their record.
    pub(super) fn write(&self, record: &mut Record) -> Result<(), StoreError> {
        for (key, generation) in (0..).zip(self.0) {
            record.append(&[key])?;
            record.append(&generation.to_le_bytes())?;
        }
        Ok(())
    }
}

/// A record being written.
pub(super) struct Record(Vec<u8, RECORD_BYTES>);

impl Record {
    /// Returns a record without contents.
    pub(super) fn new(generation: u32) -> Self {
        let mut bytes = Vec::new();
        let _ = bytes.push(FORMAT);
        let _ = bytes.extend_from_slice(&generation.to_le_bytes());
        Self(bytes)
    }

    /// Returns all bytes.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.0
    }

    pub(super) fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.0.extend_from_slice(bytes).or(Err(StoreError::NoRoom))
    }
}

/// Returns the key of the record of a slot of the tool table.
pub(super) fn tool_key(slot: usize) -> Option<u8> {
    let offset = u8::try_from(slot).ok().filter(|_| slot < TOOLS)?;
    Some(FIRST_TOOL + offset)
}

/// Returns the index of a key among all.
pub(super) fn index_of(key: u8) -> Option<usize> {
    match usize::from(key) {
        index if index < Key::ALL.len() => Some(index),
        _ if key == GENERATIONS => Some(GENERATIONS_INDEX),
        _ => tool_slot(key).map(|slot| FIRST_TOOL_INDEX + slot),
    }
}

/// Returns the key with an index.
pub(super) fn key_at(index: usize) -> Option<u8> {
    match index.checked_sub(FIRST_TOOL_INDEX) {
        Some(slot) => tool_key(slot),
        None if index == GENERATIONS_INDEX => Some(GENERATIONS),
        None => Some(index as u8),
    }
}

/// Returns the change that stores the record with an index.
pub(super) fn change_at(index: usize) -> Change {
    match (index.checked_sub(FIRST_TOOL_INDEX), Key::ALL.get(index)) {
        (Some(slot), _) => Change::Tool(slot),
        (None, Some(Key::Settings)) => Change::Settings,
        (None, Some(Key::Origins)) => Change::Origins,
        (None, Some(Key::Startup0)) => Change::Startup(0),
        (None, Some(Key::Startup1)) => Change::Startup(1),
        (None, Some(Key::BuildInfo)) => Change::BuildInfo,
        (None, None) => Change::RestoreAll,
    }
}

/// Returns the slot of the tool table whose record has a key.
pub(super) fn tool_slot(key: u8) -> Option<usize> {
    let slot = usize::from(key.checked_sub(FIRST_TOOL)?);
    (slot < TOOLS).then_some(slot)
}

/// Writes the contents of the record of a slot of the tool table.
pub(super) fn write_tool(tool: Option<ToolEntry>, record: &mut Record) -> Result<(), StoreError> {
    let Some(tool) = tool else {
        return record.append(&[0]);
    };
    record.append(&[tool.number.get()])?;
    for nm in tool.lengths() {
        record.append(&zigzag(nm).to_le_bytes())?;
    }
    Ok(())
}

/// Reads the contents of the record of a slot of the tool table.
pub(super) fn read_tool(mut contents: &[u8]) -> Option<ToolEntry> {
    let [number] = next(&mut contents)?;
    let mut tool = ToolEntry::new(NonZeroU8::new(number)?);
    for length in tool.lengths_mut() {
        *length = unzigzag(u64::from_le_bytes(next(&mut contents)?));
    }
    tool.fits().then_some(tool)
}

/// Writes the same in a page of a small EEPROM: a number is an i32 there.
pub(super) fn write_short_tool(
    tool: Option<ToolEntry>,
    record: &mut Record,
) -> Result<(), StoreError> {
    record.append(&[tool.map_or(0, |tool| tool.number.get())])?;
    for Nm(nm) in tool.iter().flat_map(ToolEntry::lengths) {
        record.append(&(nm as i32).to_le_bytes())?;
    }
    Ok(())
}

/// Reads what [`write_short_tool`] has written.
pub(super) fn read_short_tool(mut contents: &[u8]) -> Option<ToolEntry> {
    let [number] = next(&mut contents)?;
    let mut tool = ToolEntry::new(NonZeroU8::new(number)?);
    for length in tool.lengths_mut() {
        *length = Nm(i32::from_le_bytes(next(&mut contents)?).into());
    }
    tool.fits().then_some(tool)
}

/// Returns the generation and the contents of a record; `None` of an unknown format.
pub(super) fn open(mut record: &[u8]) -> Option<(u32, &[u8])> {
    let [format] = next(&mut record)?;
    let generation = next(&mut record)?;
    (format == FORMAT).then_some((u32::from_le_bytes(generation), record))
}

impl Key {
    /// Every key.
    pub(super) const ALL: [Self; 5] = [
        Self::Settings,
        Self::Origins,
        Self::Startup0,
        Self::Startup1,
        Self::BuildInfo,
    ];

    /// Returns the key of a startup line.
    pub(super) fn startup(line: usize) -> Option<Self> {
        const LINES: [Key; STARTUP_LINES] = [Key::Startup0, Key::Startup1];
        LINES.get(line).copied()
    }

    /// Writes the contents of its record.
    pub(super) fn write(self, stored: &Stored, record: &mut Record) -> Result<(), StoreError> {
        match self {
            Self::Settings => write_settings(stored, record),
            Self::Origins => write_origins(stored, record),
            Self::Startup0 => record.append(&stored.startup[0]),
            Self::Startup1 => record.append(&stored.startup[1]),
            Self::BuildInfo => record.append(&stored.build_info),
        }
    }

    /// Reads the known values in range from the contents of its record.
    #[inline(never)]
    pub(super) fn read(self, contents: &[u8], stored: &mut Stored) {
        match self {
            Self::Settings => read_settings(contents, stored),
            Self::Origins => {
                let _ = read_origins(contents, stored);
            }
            Self::Startup0 => read_line(contents, &mut stored.startup[0]),
            Self::Startup1 => read_line(contents, &mut stored.startup[1]),
            Self::BuildInfo => read_line(contents, &mut stored.build_info),
        }
    }
}

/// The types of values: a whole number of 16 bits, one in single precision, millionths of 64 bits.
const WHOLE: u8 = 0x02;
const NUMBER: u8 = 0x14;
const MILLIONTHS: u8 = 0x28;

/// Returns the bytes of a value: the low digit of its type, so that an unknown value can be skipped.
const fn value_bytes(value_type: u8) -> usize {
    (value_type & 0xf) as usize
}

fn write_settings(stored: &Stored, record: &mut Record) -> Result<(), StoreError> {
    for setting in Setting::all() {
        record.append(&setting.number().to_le_bytes())?;
        match setting.value(&stored.settings) {
            Value::Whole(whole) => {
                record.append(&[WHOLE])?;
                record.append(&whole.to_le_bytes())?;
            }
            Value::Number(number) => {
                record.append(&[NUMBER])?;
                record.append(&number.to_le_bytes())?;
            }
            Value::Millionths(millionths) => {
                record.append(&[MILLIONTHS])?;
                record.append(&millionths.to_le_bytes())?;
            }
        }
    }
    Ok(())
}

fn read_settings(mut contents: &[u8], stored: &mut Stored) {
    while let (Some(number), Some([value_type])) = (next(&mut contents), next(&mut contents)) {
        let Some((value, others)) = contents.split_at_checked(value_bytes(value_type)) else {
            break;
        };
        contents = others;
        let setting = Setting::with_number(u16::from_le_bytes(number));
        if let (Some(setting), Some(value)) = (setting, read_value(value_type, value)) {
            let _ = setting.restore(&mut stored.settings, value);
        }
    }
    setting::adjust_all(&mut stored.settings);
}

fn read_value(value_type: u8, mut bytes: &[u8]) -> Option<Value> {
    Some(match value_type {
        WHOLE => Value::Whole(u16::from_le_bytes(next(&mut bytes)?)),
        NUMBER => Value::Number(f32::from_le_bytes(next(&mut bytes)?)),
        MILLIONTHS => {
            let millionths = u64::from_le_bytes(next(&mut bytes)?);
            Value::Millionths(i64::try_from(millionths).unwrap_or(i64::MAX))
        }
        _ => return None,
    })
}

/// The name of the rotations of the work coordinate systems from the first one on, as many as there
/// are axes; the others follow, each name that of its first system.
const ROTATIONS: u8 = 128;

/// Returns the stored positions with their names: 54 and on for `G54` and on, 28 and 30.
fn positions(stored: &mut Stored) -> impl Iterator<Item = (u8, &mut Axes<Nm>)> {
    let origins = &mut stored.origins;
    let references = [(28, &mut origins.g28), (30, &mut origins.g30)];
    (54..).zip(&mut origins.coordinates.0).chain(references)
}

fn write_origins(stored: &Stored, record: &mut Record) -> Result<(), StoreError> {
    record.append(&[AXES as u8])?;
    // One list reads and writes: it is written from a copy.
    for (name, position) in positions(&mut stored.clone()) {
        record.append(&[name])?;
        for &nm in position.iter() {
            record.append(&zigzag(nm).to_le_bytes())?;
        }
    }
    write_rotations(stored, record)
}

fn write_rotations(stored: &Stored, record: &mut Record) -> Result<(), StoreError> {
    let rotations = &stored.origins.rotations.0;
    for (name, some) in (ROTATIONS..).step_by(AXES).zip(rotations.chunks(AXES)) {
        if some.iter().all(|angle| *angle == MicroDegrees::ZERO) {
            continue;
        }
        record.append(&[name])?;
        for axis in 0..AXES {
            let angle = some.get(axis).copied().unwrap_or_default();
            let code = zigzag(Nm(i64::from(angle.millionths())));
            record.append(&code.to_le_bytes())?;
        }
    }
    Ok(())
}

fn read_origins(mut contents: &[u8], stored: &mut Stored) -> Option<()> {
    let [axes] = next(&mut contents)?;
    while let Some([name]) = next(&mut contents) {
        let mut read = Axes::default();
        let first_system = name.checked_sub(ROTATIONS).map(usize::from);
        for axis in 0..usize::from(axes) {
            let nm = unzigzag(u64::from_le_bytes(next(&mut contents)?));
            let rotations = &mut stored.origins.rotations.0;
            if let Some(rotation) = first_system.and_then(|first| rotations.get_mut(first + axis)) {
                *rotation = MicroDegrees::new(nm.0);
            }
            if let Some(coordinate) = read.0.get_mut(axis)
                && nm.0.unsigned_abs() <= FARTHEST
            {
                *coordinate = nm;
            }
        }
        if let Some((_, position)) = positions(stored).find(|(known, _)| *known == name) {
            *position = read;
        }
    }
    Some(())
}

fn read_line(contents: &[u8], line: &mut StoredLine) {
    if contents.len() <= STORED_LINE {
        line.clear();
        let _ = line.extend_from_slice(contents);
    }
}

/// Returns a signed number as an unsigned one, so that small negative numbers have no bytes of 0xFF.
const fn zigzag(nm: Nm) -> u64 {
    (nm.0 << 1 ^ nm.0 >> 63).cast_unsigned()
}

const fn unzigzag(code: u64) -> Nm {
    Nm((code >> 1).cast_signed() ^ -(code & 1).cast_signed())
}

/// Returns the first `N` bytes and removes them; `None` when there are fewer.
fn next<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, others) = bytes.split_first_chunk()?;
    *bytes = others;
    Some(*first)
}

#[cfg(test)]
mod tests;
