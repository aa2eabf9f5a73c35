//! Interrupt masks that are restored to a value that was read from them before.
//!
//! A lock reads `BASEPRI`, raises it, and writes the first value back. In between, the compiler may
//! keep the value in a register or in a slot of the frame. Such a slot has no pointer to it, so
//! only stores to the slot itself change its value.

use std::collections::BTreeMap;

use crate::{
    Block, Instruction, Operation,
    graph::{BASEPRI, BASEPRI_MAX},
    value_analysis::{self, States, data_flow},
    values::{Surroundings, sources, targets},
};

/// The place of a value: a register, or a word of the frame by its offset from the stack pointer
/// at the function's beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    Register(u8),
    Slot(i32),
}

/// The values read from special registers, by the instruction that read each last.
type Kept = BTreeMap<Place, u32>;

/// Returns for each instruction that restores a special register the instruction that read the
/// restored value from the same register, by their addresses.
pub(crate) fn find(
    around: Surroundings<'_>,
    blocks: &[Block],
    states: &States,
) -> BTreeMap<u32, u32> {
    let mut slots = BTreeMap::new();
    let mut read = BTreeMap::new();
    value_analysis::visit(around, blocks, states, |state, instruction| {
        let address = instruction.operation.access().map(|(address, _)| address);
        let slot = address.and_then(|address| state.address(address).in_frame());
        slots.extend(slot.map(|slot| (instruction.address, slot)));
        if let Operation::ReadSpecial { register, .. } = instruction.operation {
            read.insert(instruction.address, register);
        }
    });
    if read.is_empty() {
        return BTreeMap::new();
    }
    let before = solve(blocks, &slots);
    let mut saved = BTreeMap::new();
    for (block, kept) in blocks.iter().zip(before) {
        let Some(mut kept) = kept else { continue };
        for instruction in &block.instructions {
            if let Operation::WriteSpecial { from, register } = instruction.operation
                && let Some(reader) = kept.get(&Place::Register(from))
                && read.get(reader).copied().map(mask_of) == Some(mask_of(register))
            {
                saved.insert(instruction.address, *reader);
            }
            step(&mut kept, instruction, &slots);
        }
    }
    saved
}

/// `BASEPRI_MAX` is `BASEPRI`, written on a condition.
const fn mask_of(register: u8) -> u8 {
    if register == BASEPRI_MAX {
        BASEPRI
    } else {
        register
    }
}

/// The values kept before each block; `None` for unreachable blocks.
fn solve(blocks: &[Block], slots: &BTreeMap<u32, i32>) -> Vec<Option<Kept>> {
    let after = |index: usize, mut kept: Kept| {
        for instruction in &blocks[index].instructions {
            step(&mut kept, instruction, slots);
        }
        Some(kept)
    };
    let join = |one: &Kept, other: &Kept| {
        let same = one
            .iter()
            .filter(|(place, reader)| other.get(place) == Some(reader));
        same.map(|(place, reader)| (*place, *reader)).collect()
    };
    data_flow(blocks, Kept::new(), after, join)
}

/// Follows an instruction.
fn step(kept: &mut Kept, instruction: &Instruction, slots: &BTreeMap<u32, i32>) {
    let operation = instruction.operation;
    let slot = slots.get(&instruction.address).copied();
    let made = made(kept, instruction, slot);
    if let (Some(slot), Some((_, bytes))) = (slot, operation.stored()) {
        kept.retain(|place, _| !is_touched(*place, slot, slot + bytes));
    }
    if let Operation::ReadSpecial { .. } = operation {
        // An earlier value of the same reader is overwritten.
        kept.retain(|_, reader| *reader != instruction.address);
    }
    let written = operation.writes();
    kept.retain(|place, _| match place {
        Place::Register(register) => written >> register & 1 == 0,
        Place::Slot(_) => true,
    });
    if !instruction.is_conditional() {
        let made = made.into_iter();
        kept.extend(made.filter_map(|(place, reader)| Some((place, reader?))));
    }
}

/// The places that an instruction writes with their new values; `slot` is the slot of its access.
fn made(kept: &Kept, instruction: &Instruction, slot: Option<i32>) -> Vec<(Place, Option<u32>)> {
    let find = |place: Place| kept.get(&place).copied();
    let places = slot.into_iter().flat_map(|slot| (slot..).step_by(4));
    let operation = instruction.operation;
    match operation {
        Operation::Copy { to, from } => vec![(Place::Register(to), find(Place::Register(from)))],
        Operation::ReadSpecial { to, .. } => {
            vec![(Place::Register(to), Some(instruction.address))]
        }
        Operation::Store { .. } => {
            let stored = places.zip(sources(operation));
            stored
                .map(|(slot, from)| (Place::Slot(slot), find(Place::Register(from))))
                .collect()
        }
        Operation::Load { .. } => {
            let loaded = targets(operation).zip(places);
            loaded
                .map(|(to, slot)| (Place::Register(to), find(Place::Slot(slot))))
                .collect()
        }
        _ => Vec::new(),
    }
}

/// Whether a range of the frame overlaps a place.
const fn is_touched(place: Place, begin: i32, end: i32) -> bool {
    match place {
        Place::Slot(slot) => slot < end && begin < slot + 4,
        Place::Register(_) => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Address, testing};

    /// The restored mask after two paths that store the register 1 to a slot, or another.
    fn kept(other: u8) -> Option<u32> {
        let shape: &[(u32, &[usize])] = &[(1, &[1, 2]), (1, &[3]), (1, &[3]), (2, &[])];
        let mut function = testing::function(shape);
        let address = Address::Offset {
            base: 13,
            offset: 8,
        };
        let store = |source: u8| Operation::Store {
            words: 1,
            address,
            writeback: None,
            source: Some(source),
            reads: 1 << source,
            bytes: 4,
        };
        let mut set = |block: usize, at: usize, operation| {
            let instruction = &mut function.blocks[block].instructions[at];
            instruction.operation = operation;
            instruction.address
        };
        let read = Operation::ReadSpecial {
            register: BASEPRI,
            to: 1,
        };
        let reader = set(0, 0, read);
        let stores = [set(1, 0, store(1)), set(2, 0, store(other))];
        let load = Operation::Load {
            writes: 1 << 4,
            first: Some(4),
            words: 1,
            bytes: 4,
            address,
            writeback: None,
        };
        let load = set(3, 0, load);
        let slots = stores
            .into_iter()
            .chain([load])
            .map(|at| (at, -8))
            .collect();
        let before = solve(&function.blocks, &slots);
        let mut last = before[3].clone().unwrap();
        step(&mut last, &function.blocks[3].instructions[0], &slots);
        let found = last.get(&Place::Register(4)).copied();
        assert!(found.is_none_or(|found| found == reader));
        found
    }

    #[test]
    fn a_mask_is_followed_through_a_slot_that_all_paths_write() {
        assert!(kept(1).is_some());
        assert_eq!(kept(2), None);
    }
}
