//! Critical sections of machine code, in which interrupts are masked.
//!
//! A section begins where `BASEPRI`, `PRIMASK` or `FAULTMASK` is raised, and ends where the mask is
//! restored, on every path through the function. Zero restores the mask, and so does a value that was
//! read from the register outside of the section; any other value raises the mask. Sections are
//! charged without a cache, so the length holds wherever the code is. All functions of the image are
//! analysed: idle, initialisation and libraries too.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Cache, Function, Operation,
    budget::Budgets,
    graph::{BASEPRI, BASEPRI_MAX, FAULTMASK, PRIMASK},
    model, persistence,
    wcet::Wcets,
};

/// The ceiling of a section whose level is not known: it may hold up every task.
pub(crate) const UNKNOWN_CEILING: u8 = u8::MAX;

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
    /// Its blocks, in its function.
    pub(crate) blocks: BTreeSet<usize>,
    /// The functions that are called in it, directly or not.
    pub(crate) reached: BTreeSet<u32>,
    /// Lines that its code touches.
    pub(crate) lines: BTreeSet<u32>,
    /// Whether it stores exclusively.
    pub(crate) retries: bool,
}

/// The kind of register that holds interrupts back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Mask {
    Priority,
    All,
    Faults,
}

impl Mask {
    /// The kinds that an instruction writes.
    fn of(operation: Operation) -> impl Iterator<Item = Self> {
        let masks = match operation {
            Operation::Interrupts {
                primask, faultmask, ..
            } => [
                primask.then_some(Self::All),
                faultmask.then_some(Self::Faults),
            ],
            Operation::WriteSpecial { register, .. } => match register {
                BASEPRI | BASEPRI_MAX => [Some(Self::Priority), None],
                PRIMASK => [Some(Self::All), None],
                FAULTMASK => [Some(Self::Faults), None],
                _ => [None; 2],
            },
            _ => [None; 2],
        };
        masks.into_iter().flatten()
    }

    /// The bits that hold interrupts back.
    const fn bits(self) -> u32 {
        match self {
            Self::Priority => 0xff,
            Self::All | Self::Faults => 1,
        }
    }
}

/// The effect of an instruction on a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Effect {
    /// The mask holds up tasks up to this priority, or all.
    Raises(Option<u8>),
    /// The mask is cleared.
    Clears,
    /// The mask has the value that it had at this instruction.
    Restores(u32),
}

/// A write of a mask.
#[derive(Debug, Clone, Copy)]
struct Write {
    block: usize,
    address: u32,
    mask: Mask,
    effect: Effect,
}

/// The blocks of a section, and those with which it ends.
#[derive(Debug, Clone)]
struct Extent {
    mask: Mask,
    block: usize,
    address: u32,
    ceiling: Option<u8>,
    blocks: BTreeSet<usize>,
    ends: BTreeSet<usize>,
    /// Whether the first block of the section may be executed again within the section.
    is_entered_again: bool,
}

/// All sections of the program.
pub(crate) fn find(wcets: &Wcets<'_>) -> Vec<Held> {
    let functions = wcets.functions.values();
    functions
        .flat_map(|function| of_function(wcets, function))
        .collect()
}

fn of_function(wcets: &Wcets<'_>, function: &Function) -> Vec<Held> {
    let extents = extents(function);
    let held = extents.iter().map(|extent| {
        let Extent { blocks, ends, .. } = extent;
        let escaping = |block: &usize| function.blocks[*block].ends && !ends.contains(block);
        let called = blocks
            .iter()
            .filter_map(|block| function.blocks[*block].call);
        let called: BTreeSet<u32> = called.collect();
        let mut lines: BTreeSet<u32> = called
            .iter()
            .flat_map(|call| (*wcets.lines(*call)).clone())
            .collect();
        // A call that never returns ends the section, and the machine.
        let is_back = |block: &&usize| !function.blocks[**block].traps;
        let calls = blocks.iter().filter(is_back);
        let calls = calls.filter_map(|block| function.blocks[*block].call);
        let reached = calls.flat_map(|call| wcets.reach(call)).collect();
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
            address: extent.address,
            ceiling: extent.ceiling,
            cycles: longest(wcets, function, extent.block, blocks, ends),
            escapes: blocks.iter().any(escaping),
            blocks: blocks.clone(),
            reached,
            lines,
            retries,
        }
    });
    held.collect()
}

/// The writes of masks in a function. A block begins with each write that raises a mask for
/// certain, and ends with each write that may restore a mask.
fn writes(function: &Function) -> Vec<Write> {
    let blocks = function.blocks.iter().enumerate();
    let all = blocks.flat_map(|(block, it)| it.instructions.iter().map(move |at| (block, at)));
    let writes = all.flat_map(|(block, instruction)| {
        let (operation, address) = (instruction.operation, instruction.address);
        Mask::of(operation).filter_map(move |mask| {
            let effect = effect(function, address, operation, mask);
            // A conditional write does not end a section.
            let may_count = !instruction.is_conditional() || matches!(effect, Effect::Raises(_));
            may_count.then_some(Write {
                block,
                address,
                mask,
                effect,
            })
        })
    });
    writes.collect()
}

fn effect(function: &Function, address: u32, operation: Operation, mask: Mask) -> Effect {
    let ceiling = |value: Option<u32>| match mask {
        // Logical priorities count upwards from the lowest of sixteen levels.
        Mask::Priority => Some(value.map_or(UNKNOWN_CEILING, |value| {
            16_u8.saturating_sub((value as u8) >> 4)
        })),
        Mask::All | Mask::Faults => None,
    };
    let value = function.specials.get(&address).copied();
    let saved = function.saved.get(&address).copied();
    match (operation, value, saved) {
        (Operation::Interrupts { off: true, .. }, ..) => Effect::Raises(None),
        (Operation::Interrupts { off: false, .. }, ..) => Effect::Clears,
        // It never lowers the level, and zero has no effect.
        (
            Operation::WriteSpecial {
                register: BASEPRI_MAX,
                ..
            },
            value,
            _,
        ) => Effect::Raises(ceiling(value)),
        (_, Some(value), _) if value & mask.bits() == 0 => Effect::Clears,
        (_, None, Some(read)) => Effect::Restores(read),
        (_, value, _) => Effect::Raises(ceiling(value)),
    }
}

/// The sections of a function. A register that is restored to a raised value, after the end of the
/// section in which the value was read, begins another section.
fn extents(function: &Function) -> Vec<Extent> {
    let writes = writes(function);
    let mut begins: BTreeMap<(u32, Mask, Option<u8>), Write> = writes
        .iter()
        .filter_map(|write| match write.effect {
            Effect::Raises(ceiling) => Some(((write.address, write.mask, ceiling), *write)),
            Effect::Clears | Effect::Restores(_) => None,
        })
        .collect();
    loop {
        let found: Vec<Extent> = begins
            .iter()
            .map(|(&(.., ceiling), write)| extent(function, &writes, write, ceiling))
            .collect();
        let mut more = false;
        for write in &writes {
            let Effect::Restores(read) = write.effect else {
                continue;
            };
            let raised = found.iter().filter(|extent| {
                let is_within = |address| holds(function, extent, address);
                extent.mask == write.mask && is_within(read) && !is_within(write.address)
            });
            for extent in raised {
                let key = (write.address, write.mask, extent.ceiling);
                more |= begins.insert(key, *write).is_none();
            }
        }
        if !more {
            return found;
        }
    }
}

/// Whether an instruction is executed within a section.
fn holds(function: &Function, extent: &Extent, address: u32) -> bool {
    let mut blocks = extent.blocks.iter();
    blocks.any(|block| {
        let mut instructions = function.blocks[*block].instructions.iter();
        let follows_restore =
            *block != extent.block || address > extent.address || extent.is_entered_again;
        follows_restore && instructions.any(|it| it.address == address)
    })
}

/// The blocks of a section and those where it ends. A restored value ends it that was read before:
/// outside of the section.
fn extent(function: &Function, writes: &[Write], begin: &Write, ceiling: Option<u8>) -> Extent {
    let mut inner: BTreeSet<u32> = BTreeSet::new();
    loop {
        let is_end = |block: usize| {
            writes.iter().any(|write| {
                let is_other = write.block == block && write.address != begin.address;
                is_other
                    && write.mask == begin.mask
                    && (block != begin.block || write.address > begin.address)
                    && match write.effect {
                        Effect::Clears => true,
                        Effect::Restores(_) => !inner.contains(&write.address),
                        Effect::Raises(_) => false,
                    }
            })
        };
        // The blocks that are reached without passing an end, and the reached ends.
        let blocks = function.reach([begin.block], is_end);
        let ends: BTreeSet<usize> = blocks.iter().copied().filter(|it| is_end(*it)).collect();
        let mut inside = blocks.difference(&ends);
        let is_entered_again =
            inside.any(|block| function.blocks[*block].next().any(|to| to == begin.block));
        let extent = Extent {
            mask: begin.mask,
            block: begin.block,
            address: begin.address,
            ceiling,
            blocks,
            ends,
            is_entered_again,
        };
        let within = writes.iter().filter(|write| {
            matches!(write.effect, Effect::Restores(read) if holds(function, &extent, read))
        });
        let before = inner.len();
        inner.extend(within.map(|write| write.address));
        if inner.len() == before {
            return extent;
        }
    }
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

    const OFF: Operation = Operation::Interrupts {
        off: true,
        primask: true,
        faultmask: false,
    };

    fn sections(change: impl Fn(&mut Function)) -> Vec<Held> {
        // 0: raises; 1 and 2: two paths; 3: restores; 4: after it.
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
        let restored = function.blocks[3].instructions[1].address;
        function.specials.insert(restored, 0);
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

    /// With a restored value that was read by the first instruction of a block.
    fn restored_from(block: usize) -> Vec<Held> {
        sections(|function| {
            let read = function.blocks[block].start();
            let restored = function.blocks[3].instructions[1].address;
            function.specials.remove(&restored);
            function.saved.insert(restored, read);
        })
    }

    #[test]
    fn what_was_read_within_a_section_does_not_end_it() {
        let found = restored_from(0);
        assert_eq!((found.len(), found[0].escapes), (1, false));
        let found = restored_from(1);
        assert_eq!((found.len(), found[0].escapes), (1, true));
    }

    #[test]
    fn a_value_that_is_not_known_begins_a_section_of_all() {
        let found = sections(|function| {
            function.specials.clear();
        });
        let ceilings: Vec<_> = found.iter().map(|it| (it.ceiling, it.escapes)).collect();
        assert_eq!(ceilings, [(Some(UNKNOWN_CEILING), true); 2]);
    }

    #[test]
    fn interrupts_that_stay_off_are_seen() {
        let found = sections(|function| {
            function.blocks[0].instructions[0].operation = OFF;
        });
        // `BASEPRI` does not end what `PRIMASK` began.
        assert_eq!((found[0].ceiling, found[0].escapes), (None, true));
    }

    #[test]
    fn interrupts_are_let_in_by_the_mask_that_kept_them_out() {
        let ended_by = |primask, faultmask| {
            let found = sections(|function| {
                function.blocks[0].instructions[0].operation = Operation::Interrupts {
                    off: true,
                    primask: true,
                    faultmask: true,
                };
                function.blocks[3].instructions[1].operation = Operation::Interrupts {
                    off: false,
                    primask,
                    faultmask,
                };
            });
            found.iter().map(|it| it.escapes).collect::<Vec<_>>()
        };
        assert_eq!(ended_by(true, true), [false, false]);
        assert_eq!(ended_by(true, false), [false, true]);
        assert_eq!(ended_by(false, true), [true, false]);
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
