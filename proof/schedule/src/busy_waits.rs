//! Busy-waiting loops, for which a stated bound is not accepted.
//!
//! A loop whose number of runs the source states must make progress by itself. A loop that reads a
//! peripheral, directly or in a called function, needs an exit that depends on a counter. A loop
//! whose exits depend only on memory that the loop does not write waits for another writer.

mod polled_memory;

use std::collections::BTreeSet;

use crate::{
    Block, Bound, Count, Flaw, Function, Image, Instruction, Loop, Operation, Region, Rule,
    loops::is_on_every_path, walks::reachable, wcet::Functions,
};

/// Returns a flaw for each busy-waiting loop of a function that has a stated bound and a wanted
/// head.
pub(crate) fn flaws(
    image: &Image,
    functions: &Functions,
    function: &Function,
    is_wanted: impl Fn(usize) -> bool,
) -> Vec<Flaw> {
    let waiting = function.loops.iter().filter(|one| {
        is_wanted(one.head)
            && stated(one).next().is_some()
            && is_busy_wait(functions, function, one)
    });
    let flaws = waiting.filter_map(|one| {
        let head = function.blocks[one.head].start();
        let read = own_instructions(function, one)
            .find(|it| is_peripheral(function, it))
            .map_or(head, |it| it.address);
        let (rule, what) = if has_counted_end(function, one) {
            let counted = one.counted?.returns;
            let is_less = |count: &Count| matches!(count, Count::Number(it) if *it < counted);
            let origin = &stated(one).find(|bound| is_less(&bound.count))?.origin;
            let what = format!("a loop that waits may run {counted} times, in spite of {origin}");
            (Rule::WrongBound, what)
        } else {
            let what =
                "a bound is stated for a loop that waits: what it reads decides how often it runs";
            (Rule::Wait, what.to_owned())
        };
        let remedy =
            "Let a task be released when it is ready; or count the runs, and end at a constant.";
        Some(image.flaw(rule, read, what, remedy))
    });
    flaws.collect()
}

/// The bounds that the source states for a loop, and their places.
fn stated(one: &Loop) -> impl Iterator<Item = &Bound> {
    let totals = one.total.iter().map(|total| &total.bound);
    let bounds = one.bound.iter().chain(totals);
    bounds.filter(|bound| bound.is_stated())
}

fn own_instructions<'a>(
    function: &'a Function,
    one: &'a Loop,
) -> impl Iterator<Item = &'a Instruction> {
    one.blocks_of(function)
        .flat_map(|block| &block.instructions)
}

/// Whether an instruction reads a register of a peripheral or of the processor.
fn is_peripheral(function: &Function, instruction: &Instruction) -> bool {
    let is_load = matches!(instruction.operation, Operation::Load { .. });
    let region = function.regions.get(&instruction.address);
    is_load
        && matches!(
            region,
            Some(
                Region::Ahb
                    | Region::Apb1
                    | Region::Apb2
                    | Region::Usb
                    | Region::Private
                    | Region::Uncosted
            )
        )
}

/// Whether a loop, or a function called in it, waits for a peripheral or for another writer of
/// memory.
pub(crate) fn is_busy_wait(functions: &Functions, function: &Function, one: &Loop) -> bool {
    let called = called(functions, function, one);
    let reads = |function: &&Function| {
        function
            .instructions()
            .any(|it| is_peripheral(function, it))
    };
    called.iter().any(reads)
        || depends_on_external_state(function, one)
        || polled_memory::polls_memory(function, one, &called)
}

/// Whether a loop by itself, without its callees, reads a peripheral or memory that others write.
pub(crate) fn depends_on_external_state(function: &Function, one: &Loop) -> bool {
    let has_calls = one.blocks_of(function).any(|block| block.call.is_some());
    own_instructions(function, one).any(|it| is_peripheral(function, it))
        || !has_calls && polled_memory::polls_memory(function, one, &[])
}

/// Whether a loop by itself reads a peripheral, and no counter ends it.
pub(crate) fn polls(function: &Function, one: &Loop) -> bool {
    own_instructions(function, one).any(|it| is_peripheral(function, it))
        && one.bound.is_none()
        && !has_counted_end(function, one)
}

/// The functions that are called in a loop, directly or not.
fn called<'a>(functions: &'a Functions, function: &Function, one: &Loop) -> Vec<&'a Function> {
    let calls = one.blocks_of(function).filter_map(Block::returning_call);
    let called = |at: u32| {
        functions
            .get(&at)
            .into_iter()
            .flat_map(Function::returning_calls)
    };
    let reached = reachable(calls, called);
    reached.iter().filter_map(|at| functions.get(at)).collect()
}

/// Whether an end of a loop depends on a counter: a register that changes by a constant in each run
/// and in nothing else, compared with what does not change.
fn has_counted_end(function: &Function, one: &Loop) -> bool {
    let counters = counters(function, one);
    one.blocks.iter().any(|index| {
        let block = &function.blocks[*index];
        block.next().any(|to| !one.blocks.contains(&to))
            && is_on_every_path(function, one, &BTreeSet::from([*index]))
            && tests_counter(block, &counters)
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
fn tests_counter(block: &Block, counters: &BTreeSet<u8>) -> bool {
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
