//! Loops whose exits depend on polled memory.
//!
//! Each exit condition of a loop is followed back through the registers from which the condition is
//! computed. If all of these values are loaded from addresses that the loop does not write, and
//! none of them counts, then only another writer ends the loop.

use crate::{Address, Function, Instruction, Loop, Operation, Region};

/// The register with the result of a call, and the registers with its arguments.
const RESULT: u16 = 1;
const ARGUMENTS: u16 = 0xf;
const STACK_POINTER: u8 = 13;

/// The values on which the exits of a loop depend: the loads, and whether a call returns one.
struct ExitConditions<'a> {
    loads: Vec<&'a Instruction>,
    is_called: bool,
}

/// Whether the exits of a loop depend only on memory that neither the loop nor its callees write.
pub(super) fn polls_memory(function: &Function, one: &Loop, called: &[&Function]) -> bool {
    let Some(ExitConditions { loads, is_called }) = exit_conditions(function, one) else {
        return false;
    };
    let own = one
        .blocks_of(function)
        .flat_map(|block| &block.instructions);
    let called = called.iter().copied();
    let called = called.flat_map(|function| function.instructions().map(move |it| (function, it)));
    let all = own.map(|it| (function, it)).chain(called);
    let mut stores = all.filter(|(_, it)| is_store(&it.operation));
    (is_called || !loads.is_empty())
        && stores.all(|(from, store)| {
            let mut loads = loads.iter();
            !is_called && loads.all(|load| are_disjoint(function, load, from, store))
        })
}

/// The values on which the exits of a loop depend, followed back through registers; `None` if there
/// are others than loads and calls.
fn exit_conditions<'a>(function: &'a Function, one: &'a Loop) -> Option<ExitConditions<'a>> {
    let blocks = one.blocks_of(function);
    let all: Vec<&Instruction> = blocks.clone().flat_map(|it| &it.instructions).collect();
    let leaving = blocks.filter(|block| block.next().any(|to| !one.blocks.contains(&to)));
    let mut found = ExitConditions {
        loads: Vec::new(),
        is_called: false,
    };
    let mut deciding = 0;
    for block in leaving {
        let (before, registers) = test(&block.instructions)?;
        deciding |= found.within(before, registers)?;
    }
    // Any write of a register in the loop may reach the beginning of a block.
    loop {
        let before = deciding;
        for instruction in &all {
            if instruction.operation.writes() & deciding != 0 {
                deciding |= found.followed(instruction)?;
            }
        }
        if deciding == before {
            return Some(found);
        }
    }
}

impl<'a> ExitConditions<'a> {
    /// Follows registers back to the beginning of a block: returns the registers from which they are computed.
    fn within(&mut self, instructions: &'a [Instruction], registers: u16) -> Option<u16> {
        let mut deciding = registers;
        for instruction in instructions.iter().rev() {
            let written = instruction.operation.writes() & deciding;
            if written == 0 {
                continue;
            }
            let from = self.followed(instruction)?;
            let is_kept = instruction.is_conditional()
                || matches!(instruction.operation, Operation::Plain { .. });
            deciding = if is_kept {
                deciding
            } else {
                deciding & !written
            } | from;
        }
        Some(deciding)
    }

    /// The registers from which the results of an instruction are computed; `None` if the
    /// instruction may count.
    fn followed(&mut self, instruction: &'a Instruction) -> Option<u16> {
        match instruction.operation {
            Operation::Load {
                address,
                writeback: None,
                ..
            } if !is_in_frame(address) => {
                self.loads.push(instruction);
                Some(in_address(address))
            }
            Operation::Constant { .. } | Operation::ConstantTop { .. } => Some(0),
            Operation::Copy { from, .. } => Some(1 << from),
            // A value masked or shifted in its own register was loaded before.
            Operation::Plain { writes } => Some(writes),
            Operation::Call(_) => {
                self.is_called = true;
                Some(ARGUMENTS)
            }
            _ => None,
        }
    }
}

const fn is_in_frame(address: Address) -> bool {
    matches!(
        address,
        Address::Offset {
            base: STACK_POINTER,
            ..
        }
    )
}

/// The instructions before the test on which the branch at the end of a block depends, and the
/// tested registers; `None` if these are not known.
fn test(instructions: &[Instruction]) -> Option<(&[Instruction], u16)> {
    let (last, before) = instructions.split_last()?;
    if let Operation::JumpOnZero { register, .. } = last.operation {
        return Some((before, 1 << register));
    }
    let at = before.iter().rposition(|it| it.sets_flags)?;
    let registers = match before[at].operation {
        Operation::Compare { left, .. } => 1 << left,
        Operation::CompareRegisters { left, right } => 1 << left | 1 << right,
        // A test of bits of the value that was loaded just before.
        Operation::Plain { writes: 0 } => {
            let mut values = before[..at].iter().rev();
            values.find_map(|it| match it.operation {
                Operation::Load { writes, .. } => Some(writes),
                Operation::Call(_) => Some(RESULT),
                _ => None,
            })?
        }
        Operation::Plain { writes } => writes,
        _ => return None,
    };
    Some((&before[..at], registers))
}

const fn in_address(address: Address) -> u16 {
    match address {
        Address::Absolute(_) => 0,
        Address::Offset { base, .. } => 1 << base,
        Address::Indexed { base, index, .. } => 1 << base | 1 << index,
    }
}

/// Whether an instruction writes to memory that is not the function's own frame.
fn is_store(operation: &Operation) -> bool {
    let stored = operation.stored();
    stored.is_some_and(|(address, _)| !is_in_frame(address))
}

/// Whether a load and a store access different memory.
fn are_disjoint(
    function: &Function,
    load: &Instruction,
    from: &Function,
    store: &Instruction,
) -> bool {
    let addresses = (
        function.addresses.get(&load.address),
        from.addresses.get(&store.address),
    );
    if let (Some(one), Some(other)) = addresses {
        const MOST_BYTES: u32 = 64;
        return one.abs_diff(*other) >= MOST_BYTES
            || one != other && words(load) == 1 && words(store) == 1 && one / 4 != other / 4;
    }
    let region = |function: &Function, at| function.regions.get(&at).copied();
    let regions = (region(function, load.address), region(from, store.address));
    matches!(regions, (Some(one), Some(other)) if one != other && one != Region::Unknown && other != Region::Unknown)
}

const fn words(instruction: &Instruction) -> u8 {
    match instruction.operation {
        Operation::Load { words, .. } | Operation::Store { words, .. } => words,
        Operation::StoreExclusive { .. } => 1,
        _ => u8::MAX,
    }
}
