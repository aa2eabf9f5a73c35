//! Jump tables of `TBB` and `TBH`.

use std::collections::BTreeSet;

use crate::{Address, Decoder, Image, Operation};

/// A function's code from its first byte to its last, reached or not.
pub(super) struct Sweep {
    /// Where instructions begin.
    starts: BTreeSet<u32>,
    /// Where constants lie that instructions load or point to.
    constants: BTreeSet<u32>,
}

impl Sweep {
    /// Of the code in `start..end`; `None` if something in it cannot be decoded.
    pub(super) fn new(image: &Image, start: u32, end: u32) -> Option<Self> {
        let mut sweep = Self {
            starts: BTreeSet::new(),
            constants: BTreeSet::new(),
        };
        let mut decoder = Decoder::new();
        let mut address = start;
        while address < end {
            if image.is_data(address) {
                address = image.data_end(address).filter(|&to| to > address)?;
                decoder = Decoder::new();
                continue;
            }
            let instruction = decoder.decode(address, image.code(address)?).ok()?;
            sweep.starts.insert(address);
            sweep.constants.extend(constant(&instruction.operation));
            address = instruction.end();
        }
        Some(sweep)
    }

    /// Where the table at `table`, whose entries have so many bytes, leads to; `None` if it leads
    /// anywhere but to instructions.
    ///
    /// It ends where code goes on, or where the first constant lies that is kept behind it.
    pub(super) fn targets(
        &self,
        image: &Image,
        table: u32,
        entry_bytes: u8,
    ) -> Option<BTreeSet<u32>> {
        let code = image.data_end(table).filter(|_| image.is_data(table))?;
        let constant = self.constants.range(table..code).next();
        let end = constant.map_or(code, |&constant| without_padding(image, table, constant));
        let entries = (table..end).step_by(entry_bytes.into());
        let targets: BTreeSet<u32> = entries
            .filter_map(|entry| match entry_bytes {
                1 => image.byte(entry).map(u32::from),
                _ => image.half(entry).map(u32::from),
            })
            .map(|entry| table + 2 * entry)
            // What fills the table up leads into it.
            .filter(|&to| to >= code)
            .collect();
        (!targets.is_empty() && targets.is_subset(&self.starts)).then_some(targets)
    }
}

/// Where what is before a constant ends without the `NOP`s that align the constant.
fn without_padding(image: &Image, from: u32, constant: u32) -> u32 {
    const NOP: u16 = 0xbf00;
    let halves = (from..constant).rev().skip(1).step_by(2);
    halves
        .take_while(|&half| image.half(half) == Some(NOP))
        .last()
        .unwrap_or(constant)
}

/// The constant in the code that an instruction loads or points to.
fn constant(operation: &Operation) -> Option<u32> {
    match *operation {
        Operation::Constant { value, .. } => Some(value),
        Operation::Load {
            address: Address::Absolute(address),
            ..
        }
        | Operation::FloatLoad {
            address: Address::Absolute(address),
            ..
        } => Some(address),
        _ => None,
    }
}
