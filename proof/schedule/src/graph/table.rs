//! Jump tables of `TBB` and `TBH`.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Address, Decoder, Image, Instruction, Operation, stack};

/// The register of the program counter.
const PC: u8 = 15;

/// A jump table.
pub(super) struct Table {
    /// Where its entries lie.
    pub(super) address: u32,
    /// The instruction that makes this address, if the jump does not do so itself.
    pub(super) maker: Option<u32>,
}

/// A function's code from its first byte to its last, reached or not.
pub(super) struct Sweep {
    instructions: BTreeMap<u32, Instruction>,
    /// Where constants lie that instructions load or point to.
    constants: BTreeSet<u32>,
}

impl Sweep {
    /// Of the code in `start..end`; `None` if something in it cannot be decoded.
    pub(super) fn new(image: &Image, start: u32, end: u32) -> Option<Self> {
        let mut sweep = Self {
            instructions: BTreeMap::new(),
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
            sweep.instructions.insert(address, instruction);
            sweep.constants.extend(constant(&instruction.operation));
            address = instruction.end();
        }
        Some(sweep)
    }

    /// The table by which the instruction at `jump` jumps, its address being in register `base`.
    ///
    /// The address is known if the instructions before make it, without a call in between; whether
    /// one can come between them from elsewhere is not looked at.
    pub(super) fn table(&self, jump: u32, base: u8) -> Option<Table> {
        if base == PC {
            let address = self.instructions.get(&jump)?.end();
            return Some(Table {
                address,
                maker: None,
            });
        }
        let makes = |instruction: &Instruction| {
            matches!(instruction.operation, Operation::Constant { to, .. } if to == base)
                && !instruction.is_conditional()
        };
        let mut before = self.instructions.range(..jump).rev();
        let (&maker, _) = before.find(|(_, instruction)| makes(instruction))?;
        let between = self.instructions.range(maker..jump);
        let address = stack::constant(base, between.map(|(_, instruction)| instruction))?;
        Some(Table {
            address,
            maker: Some(maker),
        })
    }

    /// Where a table leads to, whose entries have so many bytes and count from `from`; `None` if it
    /// leads anywhere but to instructions.
    ///
    /// The table ends where a block begins, or at the first constant after the code.
    pub(super) fn targets(
        &self,
        image: &Image,
        table: &Table,
        from: u32,
        entry_bytes: u8,
    ) -> Option<BTreeSet<u32>> {
        let begin = table.address;
        let code = image.data_end(begin).filter(|_| image.is_data(begin))?;
        let constant = self.constants.range(begin + 1..code).next();
        let end = constant.map_or(code, |&constant| without_padding(image, begin, constant));
        let entries = (begin..end).step_by(entry_bytes.into());
        let targets: BTreeSet<u32> = entries
            .filter_map(|entry| match entry_bytes {
                1 => image.byte(entry).map(u32::from),
                _ => image.half(entry).map(u32::from),
            })
            .map(|entry| from + 2 * entry)
            // A padding entry leads into the table.
            .filter(|&to| to >= code)
            .collect();
        let are_known = targets.iter().all(|to| self.instructions.contains_key(to));
        (!targets.is_empty() && are_known).then_some(targets)
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
