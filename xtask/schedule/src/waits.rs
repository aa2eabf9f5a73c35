//! Loops that wait: a bound that is stated for one is believed by nobody.
//!
//! A loop whose number of runs the source states must make progress by itself. One that reads a
//! peripheral needs an end that depends on a counter; and one that does nothing but read memory at
//! the same place, and look at it, waits for whoever writes there.

use std::collections::BTreeSet;

use crate::{Block, Flaw, Function, Image, Instruction, Loop, Operation, Region, Rule};

/// The loops of a function with a stated bound that wait.
pub(crate) fn flaws(image: &Image, function: &Function) -> Vec<Flaw> {
    let stated = function.loops.iter().filter(|one| {
        let bound = one.bound.as_ref().map(|bound| &bound.origin);
        let total = one.total.as_ref().map(|total| &total.origin);
        { bound.into_iter().chain(total) }.any(|origin| origin.contains(".rs:"))
    });
    let waiting = stated.filter(|one| waits(function, one));
    let flaws = waiting.map(|one| {
        let head = function.blocks[one.head].start();
        let read = { own_instructions(function, one) }
            .find(|it| is_peripheral(function, it))
            .map_or(head, |it| it.address);
        Flaw::new(
            Rule::Wait,
            "a bound is stated for a loop that waits: what it reads decides how often it runs",
            image.place(read),
            "Let a task be released when it is ready; or count the runs, and end at a constant.",
        )
    });
    flaws.collect()
}

fn own_instructions<'a>(
    function: &'a Function,
    one: &'a Loop,
) -> impl Iterator<Item = &'a Instruction> {
    let blocks = one.blocks.iter().map(|block| &function.blocks[*block]);
    blocks.flat_map(|block| &block.instructions)
}

/// Whether an instruction reads a register of a peripheral or of the processor.
fn is_peripheral(function: &Function, instruction: &Instruction) -> bool {
    let is_load = matches!(instruction.operation, Operation::Load { .. });
    let region = function.regions.get(&instruction.address);
    is_load
        && matches!(
            region,
            Some(Region::Ahb | Region::Apb1 | Region::Apb2 | Region::Private | Region::Uncosted)
        )
}

fn waits(function: &Function, one: &Loop) -> bool {
    let is_read = own_instructions(function, one).any(|it| is_peripheral(function, it));
    (is_read || only_looks(function, one)) && !has_counted_end(function, one)
}

/// Whether nothing in a loop changes but what is loaded from the same place each time.
fn only_looks(function: &Function, one: &Loop) -> bool {
    let mut loaded = 0_u16;
    let mut bases = 0_u16;
    for instruction in own_instructions(function, one) {
        match instruction.operation {
            Operation::Load {
                writes,
                writeback: None,
                address,
                ..
            } => {
                loaded |= writes;
                bases |= match address {
                    crate::Address::Absolute(_) => 0,
                    crate::Address::Offset { base, .. } => 1 << base,
                    crate::Address::Indexed { base, index, .. } => 1 << base | 1 << index,
                };
            }
            // What is loaded is masked or shifted in its register.
            Operation::Plain { writes } if writes & !loaded == 0 => {}
            Operation::Constant { .. }
            | Operation::Compare { .. }
            | Operation::CompareRegisters { .. }
            | Operation::Jump(_)
            | Operation::JumpOnZero { .. }
            | Operation::IfThen(_)
            | Operation::Barrier
            | Operation::Nothing => {}
            _ => return false,
        }
    }
    loaded & bases == 0
}

/// Whether an end of a loop depends on a counter: a register that changes by a constant in each run
/// and in nothing else, compared with what does not change.
fn has_counted_end(function: &Function, one: &Loop) -> bool {
    let counters = counters(function, one);
    one.blocks.iter().any(|index| {
        let block = &function.blocks[*index];
        let mut edges = block.successors.iter();
        let leaves = edges.any(|edge| !one.blocks.contains(&edge.to));
        leaves && is_on_each_way(function, one, *index) && looks_at(block, &counters)
    })
}

/// Registers that only an addition of a constant to themselves writes within a loop.
fn counters(function: &Function, one: &Loop) -> BTreeSet<u8> {
    let mut counted = BTreeSet::new();
    let mut others = 0_u16;
    for instruction in own_instructions(function, one) {
        match instruction.operation {
            Operation::Add { to, from, value } if to == from && value != 0 => {
                counted.insert(to);
            }
            operation => others |= operation.writes(),
        }
    }
    counted.retain(|register| others >> register & 1 == 0);
    counted
}

/// Whether the branch at the end of a block depends on a counter.
fn looks_at(block: &Block, counters: &BTreeSet<u8>) -> bool {
    let Some((last, before)) = block.instructions.split_last() else {
        return false;
    };
    if let Operation::JumpOnZero { register, .. } = last.operation {
        return counters.contains(&register);
    }
    let flags = before.iter().rev().find(|it| it.sets_flags);
    flags.is_some_and(|it| match it.operation {
        Operation::Add { to, .. } => counters.contains(&to),
        Operation::Compare { left, .. } => counters.contains(&left),
        Operation::CompareRegisters { left, right } => {
            counters.contains(&left) || counters.contains(&right)
        }
        _ => false,
    })
}

/// Whether no run of a loop leaves a block out.
fn is_on_each_way(function: &Function, one: &Loop, wanted: usize) -> bool {
    if wanted == one.head {
        return true;
    }
    let mut seen = BTreeSet::from([one.head]);
    let mut work = vec![one.head];
    while let Some(block) = work.pop() {
        for edge in &function.blocks[block].successors {
            if edge.to == one.head {
                return false;
            }
            if edge.to != wanted && one.blocks.contains(&edge.to) && seen.insert(edge.to) {
                work.push(edge.to);
            }
        }
    }
    true
}
