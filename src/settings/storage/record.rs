//! What a record of the journal holds.
//!
//! ```text
//! record      format: 1 │ generation: u32 │ contents
//! generations (part: u8, generation: u32)…
//! settings    (number: u16, kind: u8, value)…
//! origins     axes: u8, (name: u8, (nm: i64 as zigzag) for each axis)…
//! lines       the text
//! ```
//!
//! Numbers have their low byte first. Each value says what it is, so that other firmware can read
//! it: one with other settings, other axes, other types of the same setting. What is unknown or out
//! of range is left out, what is missing keeps its default.
//!
//! No 8 bytes in a row are all 0xFF: to the journal that is flash not written yet.

use heapless::Vec;

use super::restore::{Raw, restore};
use crate::{
    axis::Axes,
    settings::{
        STARTUP_LINES, STORED_LINE, StoreError, Stored, StoredLine,
        table::{TABLE, Value},
    },
    units::Nm,
};

/// The format of the records, for the day when it cannot say itself what it holds.
const FORMAT: u8 = 1;
/// Bytes of the longest record: origins of 6 axes take 398, settings of 6 axes 396.
const LONGEST: usize = 512;
/// Farthest coordinate that is read, nm: what double precision holds exactly.
const FARTHEST: u64 = 1 << 53;

/// Key of the record of generations.
pub(super) const GENERATIONS: u8 = 0x10;
/// How many keys there are.
pub(super) const KEYS: usize = Part::ALL.len() + 1;

/// A part that has a record of its own; its key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Part {
    Settings = 0,
    Origins = 1,
    Startup0 = 2,
    Startup1 = 3,
    BuildInfo = 4,
}

/// The generation of each part whose records count; those of older ones count as absent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Generations([u32; Part::ALL.len()]);

impl Generations {
    /// That of a part.
    pub(super) fn of(&mut self, part: Part) -> &mut u32 {
        &mut self.0[part as usize]
    }

    /// Reads the contents of their record.
    pub(super) fn read(mut contents: &[u8]) -> Self {
        let mut generations = Self::default();
        // wcet-bound: 128
        while let (Some([part]), Some(generation)) = (take(&mut contents), take(&mut contents)) {
            if let Some(known) = generations.0.get_mut(usize::from(part)) {
                *known = u32::from_le_bytes(generation);
            }
        }
        generations
    }

    /// Writes the contents of their record.
    pub(super) fn write(&self, record: &mut Record) -> Result<(), StoreError> {
        // wcet-bound: 5
        for (part, generation) in (0..).zip(self.0) {
            record.put(&[part])?;
            record.put(&generation.to_le_bytes())?;
        }
        Ok(())
    }
}

/// A record being written.
pub(super) struct Record(Vec<u8, LONGEST>);

impl Record {
    /// One without contents.
    pub(super) fn new(generation: u32) -> Self {
        let mut bytes = Vec::new();
        let _ = bytes.push(FORMAT);
        let _ = bytes.extend_from_slice(&generation.to_le_bytes());
        Self(bytes)
    }

    /// All of it.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.0
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.0.extend_from_slice(bytes).or(Err(StoreError::NoRoom))
    }
}

/// The generation and the contents of a record; `None` of a format that is not known.
pub(super) fn open(mut record: &[u8]) -> Option<(u32, &[u8])> {
    let [format] = take(&mut record)?;
    let generation = take(&mut record)?;
    (format == FORMAT).then_some((u32::from_le_bytes(generation), record))
}

impl Part {
    /// Every part.
    pub(super) const ALL: [Self; 5] = [
        Self::Settings,
        Self::Origins,
        Self::Startup0,
        Self::Startup1,
        Self::BuildInfo,
    ];

    /// The part of a startup line.
    pub(super) fn startup(line: usize) -> Option<Self> {
        const LINES: [Part; STARTUP_LINES] = [Part::Startup0, Part::Startup1];
        LINES.get(line).copied()
    }

    /// Writes the contents of its record.
    pub(super) fn write(self, stored: &Stored, record: &mut Record) -> Result<(), StoreError> {
        match self {
            Self::Settings => write_settings(stored, record),
            Self::Origins => write_origins(stored, record),
            Self::Startup0 => record.put(&stored.startup[0]),
            Self::Startup1 => record.put(&stored.startup[1]),
            Self::BuildInfo => record.put(&stored.build_info),
        }
    }

    /// Reads the contents of its record, as far as they are known and in range.
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

/// The kinds of values: a whole number of 16 bits, one in single precision, millionths of 64 bits.
const WHOLE: u8 = 0x02;
const NUMBER: u8 = 0x14;
const MILLIONTHS: u8 = 0x28;

/// Bytes of a value: the low digit of its kind, so that what is unknown can be left out.
fn length(kind: u8) -> usize {
    usize::from(kind & 0xf)
}

fn write_settings(stored: &Stored, record: &mut Record) -> Result<(), StoreError> {
    for row in &TABLE {
        for axis in 0..row.axes() {
            let Some(value) = row.value(&stored.settings, axis) else {
                continue;
            };
            record.put(&(row.number_of(axis)).to_le_bytes())?;
            match value {
                Value::Whole(whole) => {
                    record.put(&[WHOLE])?;
                    record.put(&whole.to_le_bytes())?;
                }
                Value::Number(number, _) => {
                    record.put(&[NUMBER])?;
                    record.put(&number.to_le_bytes())?;
                }
                Value::Resolution(resolution) => {
                    record.put(&[MILLIONTHS])?;
                    record.put(&resolution.millionths().to_le_bytes())?;
                }
            }
        }
    }
    Ok(())
}

fn read_settings(mut contents: &[u8], stored: &mut Stored) {
    // wcet-bound: 256
    while let (Some(number), Some([kind])) = (take(&mut contents), take(&mut contents)) {
        let Some((value, rest)) = contents.split_at_checked(length(kind)) else {
            break;
        };
        contents = rest;
        if let Some(raw) = raw(kind, value) {
            let _ = restore(&mut stored.settings, u16::from_le_bytes(number), raw);
        }
    }
    // Only together do they make sense, and either may have been left out.
    stored.settings.soft_limits &= stored.settings.homing;
}

fn raw(kind: u8, mut value: &[u8]) -> Option<Raw> {
    Some(match kind {
        WHOLE => Raw::Whole(u16::from_le_bytes(take(&mut value)?)),
        NUMBER => Raw::Number(f32::from_le_bytes(take(&mut value)?)),
        MILLIONTHS => Raw::Millionths(u64::from_le_bytes(take(&mut value)?)),
        _ => return None,
    })
}

/// The stored positions with their names: 54 to 59 for `G54` to `G59`, 28 and 30.
fn positions(stored: &mut Stored) -> impl Iterator<Item = (u8, &mut Axes<Nm>)> {
    let origins = &mut stored.origins;
    let references = [(28, &mut origins.g28), (30, &mut origins.g30)];
    (54..).zip(&mut origins.coordinates.0).chain(references)
}

fn write_origins(stored: &Stored, record: &mut Record) -> Result<(), StoreError> {
    record.put(&[crate::axis::AXES as u8])?;
    // One list for reading and writing: writing is done from a copy.
    for (name, position) in positions(&mut stored.clone()) {
        record.put(&[name])?;
        for &nm in position.iter() {
            record.put(&zigzag(nm).to_le_bytes())?;
        }
    }
    Ok(())
}

fn read_origins(mut contents: &[u8], stored: &mut Stored) -> Option<()> {
    let [axes] = take(&mut contents)?;
    // wcet-bound: 256
    while let Some([name]) = take(&mut contents) {
        let mut read = Axes::default();
        // wcet-bound: 255
        for axis in 0..usize::from(axes) {
            let nm = unzigzag(u64::from_le_bytes(take(&mut contents)?));
            if let Some(place) = read.0.get_mut(axis)
                && nm.0.unsigned_abs() <= FARTHEST
            {
                *place = nm;
            }
        }
        // wcet-bound: 8
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

/// Signed as unsigned, so that small numbers below 0 do not begin with bytes of 0xFF.
const fn zigzag(nm: Nm) -> u64 {
    (nm.0 << 1 ^ nm.0 >> 63).cast_unsigned()
}

const fn unzigzag(code: u64) -> Nm {
    Nm((code >> 1).cast_signed() ^ -(code & 1).cast_signed())
}

/// Takes the first bytes; `None` when there are not so many.
fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}

#[cfg(test)]
mod tests;
