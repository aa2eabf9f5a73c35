//! The flash of a chip.

use crate::Chip;

/// The first address.
pub const FLASH: u32 = 0x0800_0000;
/// A byte that is erased.
const ERASED: u8 = 0xff;

/// NOR flash in sectors.
#[derive(Debug)]
pub(crate) struct Flash {
    bytes: Vec<u8>,
    /// The offset at which each sector ends.
    ends: Vec<usize>,
}

impl Flash {
    pub(crate) fn new(chip: Chip) -> Self {
        let ends = chip.sectors().scan(0, |end, bytes| {
            *end += bytes as usize;
            Some(*end)
        });
        let ends: Vec<_> = ends.collect();
        Self {
            bytes: vec![ERASED; ends.last().copied().unwrap_or_default()],
            ends,
        }
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    pub(crate) fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.bytes
    }

    /// The place of some bytes, if all of them are in the flash.
    fn place(&self, address: u32, length: usize) -> Option<std::ops::Range<usize>> {
        let start = address.checked_sub(FLASH)? as usize;
        let end = start.checked_add(length)?;
        (start < self.bytes.len() && end <= self.bytes.len()).then_some(start..end)
    }

    pub(crate) fn read(&self, address: u32, length: usize) -> Option<&[u8]> {
        self.bytes.get(self.place(address, length)?)
    }

    /// Programs bytes: clears bits.
    pub(crate) fn program(&mut self, address: u32, bytes: &[u8]) -> Option<()> {
        let place = self.place(address, bytes.len())?;
        for (cell, byte) in self.bytes[place].iter_mut().zip(bytes) {
            *cell &= byte;
        }
        Some(())
    }

    /// The number of the sector of an address.
    pub(crate) fn sector(&self, address: u32) -> Option<usize> {
        let offset = self.place(address, 1)?.start;
        self.ends.iter().position(|end| offset < *end)
    }

    pub(crate) fn erase(&mut self, sector: usize) {
        let start = sector.checked_sub(1).map_or(0, |before| self.ends[before]);
        self.bytes[start..self.ends[sector]].fill(ERASED);
    }

    pub(crate) fn erase_all(&mut self) {
        self.bytes.fill(ERASED);
    }
}
