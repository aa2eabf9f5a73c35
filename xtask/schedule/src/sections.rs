//! Sections in which interrupts are held back, from machine code.
//!
//! Each begins where `BASEPRI` or `PRIMASK` is raised and ends where it is restored, on whatever way
//! through the function. Their code is charged without a cache, so the length holds wherever they
//! are. All functions of the image are looked at: idle, initialisation and libraries too.

use std::collections::BTreeSet;

use crate::{Cache, Function, Operation, budget::Budgets, graph, model, persistence, wcet::Wcets};

/// A section.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Held {
    /// Its function.
    pub(crate) function: u32,
    /// The instruction that begins it.
    pub(crate) address: u32,
    /// Priority up to which tasks are held up; `None`: all.
    pub(crate) ceiling: Option<u8>,
    /// Its longest time, when there is one.
    pub(crate) cycles: Option<u64>,
    /// Whether the function may return before its end.
    pub(crate) escapes: bool,
    /// Lines that its code touches.
    pub(crate) lines: BTreeSet<u32>,
    /// Whether it stores exclusively.
    pub(crate) retries: bool,
}

/// The kind of register that holds interrupts back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mask {
    Priority,
    All,
}

/// All sections of the program.
pub(crate) fn find(wcets: &Wcets<'_>) -> Vec<Held> {
    let functions = wcets.functions.values();
    functions
        .flat_map(|function| of_function(wcets, function))
        .collect()
}

fn of_function(wcets: &Wcets<'_>, function: &Function) -> Vec<Held> {
    let begins = (0..function.blocks.len()).filter_map(|block| begin(function, block));
    begins
        .map(|(block, address, mask, ceiling)| {
            let (blocks, ends) = extent(function, block, address, mask);
            let escaping = |block: &usize| function.blocks[*block].ends && !ends.contains(block);
            let called = blocks
                .iter()
                .filter_map(|block| function.blocks[*block].call);
            let called: BTreeSet<u32> = called.collect();
            let mut lines: BTreeSet<u32> = called
                .iter()
                .flat_map(|call| (*wcets.lines(*call)).clone())
                .collect();
            let reached = called.iter().flat_map(|call| wcets.reach(*call)).collect();
            let mut own = blocks.iter().map(|block| &function.blocks[*block]);
            let retries = own.any(persistence::stores_exclusively)
                || persistence::has_exclusive_store(wcets, &reached);
            lines.extend(
                blocks
                    .iter()
                    .flat_map(|block| model::lines(&function.blocks[*block])),
            );
            Held {
                function: function.address,
                address,
                ceiling,
                cycles: longest(wcets, function, block, &blocks, &ends),
                escapes: blocks.iter().any(escaping),
                lines,
                retries,
            }
        })
        .collect()
}

/// The section that begins in a block: the block, the instruction, the kind, the ceiling.
fn begin(function: &Function, block: usize) -> Option<(usize, u32, Mask, Option<u8>)> {
    let instructions = &function.blocks[block].instructions;
    let (first, last) = (instructions.first()?, instructions.last()?);
    let written = |address: u32| function.specials.get(&address).copied();
    // Logical priorities count upwards from the lowest of sixteen levels.
    let ceiling = |value: u32| Some(16_u8.saturating_sub((value as u8) >> 4));
    match (first.operation, last.operation) {
        (Operation::Interrupts { off: true }, _) => Some((block, first.address, Mask::All, None)),
        (Operation::WriteSpecial { register: 18, .. }, _) => {
            let value = written(first.address);
            let ceiling = value.map_or(Some(u8::MAX), ceiling);
            Some((block, first.address, Mask::Priority, ceiling))
        }
        (_, Operation::WriteSpecial { register: 17, .. }) => {
            let value = written(last.address).filter(|value| *value != 0)?;
            Some((block, last.address, Mask::Priority, ceiling(value)))
        }
        (_, Operation::WriteSpecial { register: 16, .. }) => {
            written(last.address).filter(|value| value & 1 != 0)?;
            Some((block, last.address, Mask::All, None))
        }
        _ => None,
    }
}

/// Whether a section of this kind ends with a block.
fn is_end(function: &Function, block: usize, begin: u32, mask: Mask) -> bool {
    let Some(last) = function.blocks[block].instructions.last() else {
        return false;
    };
    if last.address == begin || !graph::restores(last) {
        return false;
    }
    let value = function.specials.get(&last.address).copied();
    match last.operation {
        Operation::WriteSpecial { register: 17, .. } => {
            mask == Mask::Priority && value.is_none_or(|value| value == 0)
        }
        Operation::WriteSpecial { register: 16, .. } => {
            mask == Mask::All && value.is_none_or(|value| value & 1 == 0)
        }
        _ => mask == Mask::All,
    }
}

/// The blocks of a section and those where it ends.
fn extent(
    function: &Function,
    block: usize,
    begin: u32,
    mask: Mask,
) -> (BTreeSet<usize>, BTreeSet<usize>) {
    let (mut blocks, mut ends) = (BTreeSet::from([block]), BTreeSet::new());
    let mut work = vec![block];
    while let Some(block) = work.pop() {
        if is_end(function, block, begin, mask) {
            ends.insert(block);
            continue;
        }
        let successors = function.blocks[block].successors.iter().map(|edge| edge.to);
        work.extend(successors.filter(|to| blocks.insert(*to)));
    }
    (blocks, ends)
}

fn longest(
    wcets: &Wcets<'_>,
    function: &Function,
    source: usize,
    blocks: &BTreeSet<usize>,
    ends: &BTreeSet<usize>,
) -> Option<u64> {
    let mut open = Budgets::new();
    let is_inside = |block: usize| blocks.contains(&block);
    let mut graph = wcets.graph(function, Cache::Uncached, &mut open, is_inside)?;
    for &block in ends {
        graph.edges[block].clear();
        graph.ends[block] = true;
    }
    let first = model::lines(&function.blocks[source]).count() as u64 * wcets.model.miss();
    Some(Wcets::longest(function, &graph, source, open)? + first)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::{Model, testing, wcet::Functions};

    fn sections(change: impl Fn(&mut Function)) -> Vec<Held> {
        // 0: raises; 1 and 2: two ways; 3: restores; 4: behind it.
        let shape: &[(u32, &[usize])] =
            &[(1, &[1, 2]), (4, &[3]), (8, &[3]), (2, &[4]), (100, &[])];
        let mut function = testing::function(shape);
        function.blocks[0].instructions[0].operation = Operation::WriteSpecial {
            register: 18,
            from: 0,
        };
        function.blocks[3].instructions[1].operation = Operation::WriteSpecial {
            register: 17,
            from: 1,
        };
        function.specials.insert(function.blocks[0].start(), 0xd0);
        change(&mut function);
        let functions = Functions::from([(function.address, function)]);
        let model = Model::new(&testing::CLOCK);
        let named = BTreeMap::new();
        find(&Wcets::new(&functions, &model, &named, BTreeSet::new()))
    }

    #[test]
    fn a_section_lasts_from_raise_to_restore() {
        let found = sections(|_| {});
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].ceiling, Some(3));
        // Cycles 2 + 8 + 1 + 2; lines of the blocks: 1, 2 and 1.
        assert_eq!(found[0].cycles, Some(13 + 5 * 4));
        assert!(!found[0].escapes);
    }

    #[test]
    fn interrupts_that_stay_off_are_seen() {
        let found = sections(|function| {
            function.blocks[0].instructions[0].operation = Operation::Interrupts { off: true };
        });
        // `BASEPRI` does not end what `PRIMASK` began.
        assert_eq!((found[0].ceiling, found[0].escapes), (None, true));
    }

    #[test]
    fn a_direct_write_of_the_priority_begins_a_section_too() {
        let found = sections(|function| {
            let first = &mut function.blocks[0].instructions[0];
            first.operation = Operation::WriteSpecial {
                register: 17,
                from: 0,
            };
        });
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].ceiling, Some(3));
    }
}
