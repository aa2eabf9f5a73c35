//! The tool table: the offset and the diameter of each tool that has been measured.
//!
//! # Cost
//! The table has one place in memory, and stays there: no function takes or returns it by value. Its
//! lengths are of 32 bits, as no tool is longer than 2 m.

use core::num::NonZeroU8;

use crate::{axis::LINEAR, units::Nm};

/// Tools that the table holds, at most: fewer where they are kept in 4 KiB.
pub const TOOLS: usize = if cfg!(feature = "eeprom-4") { 16 } else { 32 };

/// A tool of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ToolEntry {
    /// The number of the tool.
    pub number: NonZeroU8,
    /// The tool length offset along X, Y and Z, nm.
    pub offset: [Nm; LINEAR],
    /// The diameter, nm. Cutter compensation on the other side has a negative one.
    pub diameter: Nm,
}

impl ToolEntry {
    /// Most that a length may be, either way: 2147.483647 mm.
    pub const LONGEST: Nm = Nm(i32::MAX as i64);

    /// Returns a tool without an offset and a diameter.
    #[must_use]
    pub const fn new(number: NonZeroU8) -> Self {
        Self {
            number,
            offset: [Nm(0); LINEAR],
            diameter: Nm(0),
        }
    }

    /// Returns the offset, and the diameter behind it.
    pub fn lengths(&self) -> impl Iterator<Item = Nm> {
        self.offset.into_iter().chain([self.diameter])
    }

    /// Returns the offset, and the diameter behind it.
    pub fn lengths_mut(&mut self) -> impl Iterator<Item = &mut Nm> {
        self.offset.iter_mut().chain([&mut self.diameter])
    }

    /// Returns whether the table can hold the lengths: none is more than [`Self::LONGEST`].
    #[must_use]
    pub fn fits(&self) -> bool {
        self.lengths()
            .all(|length| -Self::LONGEST.0 <= length.0 && length.0 <= Self::LONGEST.0)
    }
}

/// The tool table. A tool keeps its slot as long as it is in the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ToolTable {
    /// The number of the tool in each slot, 0 for none.
    numbers: [u8; TOOLS],
    /// Its offset and diameter, nm; 0 for none.
    lengths: [[i32; LINEAR + 1]; TOOLS],
}

impl ToolTable {
    /// Returns a table without tools.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            numbers: [0; TOOLS],
            lengths: [[0; LINEAR + 1]; TOOLS],
        }
    }

    /// Returns whether the table has no tool.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.numbers.iter().all(|&number| number == 0)
    }

    /// Returns the tool with a number.
    #[must_use]
    pub fn get(&self, number: u8) -> Option<ToolEntry> {
        let number = NonZeroU8::new(number)?;
        self.slot(self.slot_with(number)?)
    }

    /// Returns the tool of a slot.
    #[must_use]
    pub fn slot(&self, slot: usize) -> Option<ToolEntry> {
        let number = self.numbers.get(slot).copied().and_then(NonZeroU8::new)?;
        let mut entry = ToolEntry::new(number);
        for (length, &nm) in entry.lengths_mut().zip(self.lengths.get(slot)?) {
            *length = Nm(i64::from(nm));
        }
        Some(entry)
    }

    /// Returns the slot of the tool with a number.
    #[must_use]
    pub fn slot_with(&self, number: NonZeroU8) -> Option<usize> {
        let mut numbers = self.numbers.iter();
        numbers.position(|&known| known == number.get())
    }

    /// Returns the slot of the tool with a number, or a free one; `None` when the table is full.
    #[must_use]
    pub fn slot_of(&self, number: NonZeroU8) -> Option<usize> {
        let free = || self.numbers.iter().position(|&known| known == 0);
        self.slot_with(number).or_else(free)
    }

    /// Returns a tool by its place in the order of the numbers, counted from 0.
    #[must_use]
    pub fn nth(&self, place: usize) -> Option<ToolEntry> {
        let known = |number: &&u8| **number != 0;
        let mut numbers = self.numbers.iter().filter(known);
        let number = numbers.find(|number| {
            let lower = self
                .numbers
                .iter()
                .filter(known)
                .filter(|other| other < number);
            lower.count() == place
        })?;
        self.get(*number)
    }

    /// Replaces the tool of a slot, whose lengths must fit. Returns the tool before.
    pub fn replace(&mut self, slot: usize, entry: Option<ToolEntry>) -> Option<ToolEntry> {
        let before = self.slot(slot);
        if let Some(number) = self.numbers.get_mut(slot)
            && let Some(lengths) = self.lengths.get_mut(slot)
        {
            *number = entry.map_or(0, |entry| entry.number.get());
            *lengths = [0; LINEAR + 1];
            let new = entry.iter().flat_map(ToolEntry::lengths);
            for (length, Nm(nm)) in lengths.iter_mut().zip(new) {
                *length = nm as i32;
            }
        }
        before
    }

    /// Removes all tools.
    pub fn clear(&mut self) {
        *self = Self::new();
    }
}

impl Default for ToolTable {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tool(number: u8) -> ToolEntry {
        ToolEntry::new(NonZeroU8::new(number).unwrap())
    }

    #[test]
    fn a_tool_keeps_its_slot_and_leaves_it_free() {
        let mut table = ToolTable::new();
        assert!(table.is_empty());
        for (slot, number) in [9, 4, 200].into_iter().enumerate() {
            assert_eq!(table.slot_of(tool(number).number), Some(slot));
            assert_eq!(table.replace(slot, Some(tool(number))), None);
        }
        assert_eq!(table.slot_of(tool(4).number), Some(1));
        assert_eq!(table.replace(1, None), Some(tool(4)));
        assert_eq!(
            (table.get(4), table.slot(1), table.get(0)),
            (None, None, None)
        );
        assert_eq!(table.slot_of(tool(7).number), Some(1));
        table.replace(1, Some(tool(7)));
        let numbers = [0, 1, 2, 3].map(|place| table.nth(place).map(|entry| entry.number.get()));
        assert_eq!(numbers, [Some(7), Some(9), Some(200), None]);
        assert_eq!(table.get(200), table.slot(2));
        table.clear();
        assert!(table.is_empty());
    }

    #[test]
    fn lengths_are_whole_nanometres_up_to_two_metres() {
        let mut table = ToolTable::new();
        let mut entry = tool(1);
        entry.offset = [ToolEntry::LONGEST, Nm(-ToolEntry::LONGEST.0), Nm(1)];
        entry.diameter = Nm(-1);
        assert!(entry.fits());
        table.replace(0, Some(entry));
        assert_eq!(table.get(1), Some(entry));
        for length in 0..=LINEAR {
            let mut longer = entry;
            *longer.lengths_mut().nth(length).unwrap() = Nm(ToolEntry::LONGEST.0 + 1);
            assert!(!longer.fits());
        }
    }

    #[test]
    fn a_full_table_has_a_slot_for_its_own_tools_only() {
        let mut table = ToolTable::new();
        for number in 1..=TOOLS as u8 {
            let slot = table.slot_of(tool(number).number).unwrap();
            table.replace(slot, Some(tool(number)));
        }
        assert_eq!(table.slot_of(tool(33).number), None);
        assert_eq!(table.slot_of(tool(32).number), Some(31));
        assert_eq!(table.replace(TOOLS, Some(tool(33))), None);
        assert_eq!(table.get(33), None);
    }
}
