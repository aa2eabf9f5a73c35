//! Loops that keep their code in the instruction cache, although the whole task does not.
//!
//! While a loop runs, nothing but its own lines and those of the tasks that preempt it are used. If
//! all of them together fit the cache, none is pushed out before the loop is left, whatever order
//! they are used in: each is missed at most once.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Block, Count, Function, Loop, Operation, model::CACHE_LINES, wcet::Wcets};

/// Rounds that a loop is taken to have whose bound varies with the step rate.
const VARIED_ROUNDS: u64 = 100;

/// The loops of a function that keep their code, the outermost of those within each other.
#[derive(Debug, Clone, Default)]
pub(crate) struct Kept {
    /// For each block the head of its loop.
    pub(crate) of_block: Vec<Option<usize>>,
    /// For each head, how many lines are missed in one visit.
    pub(crate) lines: BTreeMap<usize, u64>,
    /// Whether an exclusive store is in any of them.
    pub(crate) retries: bool,
}

impl Kept {
    pub(crate) fn new(wcets: &Wcets<'_>, function: &Function) -> Self {
        let mut new = Self {
            of_block: vec![None; function.blocks.len()],
            lines: BTreeMap::new(),
            retries: false,
        };
        if wcets.model.prefetch || function.loops.is_empty() {
            return new;
        }
        let touched = wcets.touched_by_blocks(function);
        let mut loops: Vec<&Loop> = function.loops.iter().collect();
        loops.sort_by_key(|looped| std::cmp::Reverse(looped.blocks.len()));
        for looped in loops {
            if new.of_block[looped.head].is_some() {
                continue;
            }
            let own = looped.blocks.iter().flat_map(|block| &touched[*block]);
            let own: BTreeSet<u32> = own.copied().collect();
            let all = own.union(&wcets.beside).count();
            if all > CACHE_LINES || !pays(wcets, looped, own.len(), all) {
                continue;
            }
            new.lines.insert(looped.head, all as u64);
            for block in &looped.blocks {
                new.of_block[*block] = Some(looped.head);
                new.retries |= has_exclusive_store(wcets, &function.blocks[*block]);
            }
        }
        new
    }
}

/// Whether a block, or what it calls, has an exclusive store.
fn has_exclusive_store(wcets: &Wcets<'_>, block: &Block) -> bool {
    let stores = |block: &Block| {
        let mut instructions = block.instructions.iter();
        instructions.any(|it| matches!(it.operation, Operation::StoreExclusive { .. }))
    };
    let call = block
        .call
        .filter(|call| !block.traps && !wcets.excluded.contains(call));
    let called = call.map(|call| wcets.reach(call)).unwrap_or_default();
    let called = called
        .iter()
        .filter_map(|address| wcets.functions.get(address));
    stores(block) || called.flat_map(|function| &function.blocks).any(stores)
}

/// Whether loading all lines for a visit costs less than fetching those of the loop each round.
fn pays(wcets: &Wcets<'_>, looped: &Loop, own: usize, all: usize) -> bool {
    let total = looped.total.as_ref().map(|total| &total.count);
    let count = total.or(looped.bound.as_ref().map(|bound| &bound.count));
    // One decision for all values: so that costs grow evenly with them.
    let rounds = count.map_or(0, |count| match count {
        Count::Number(number) => *number,
        Count::Named(name) if wcets.varied.contains(name) => VARIED_ROUNDS,
        Count::Named(_) => wcets.number(count).unwrap_or(0),
    });
    rounds.saturating_mul(own as u64) > 2 * all as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Cache, Model, testing, wcet::Functions};

    /// One loop of 20 rounds of 4 + 6 instructions, and code before and behind it.
    fn bounds(beside: usize) -> [u64; 3] {
        let shape: &[(u32, &[usize])] = &[(3, &[1]), (4, &[2, 3]), (6, &[1]), (2, &[])];
        let mut function = testing::function(shape);
        function.loops = vec![testing::counted(1, &[1, 2], &[2], 20)];
        let functions = Functions::from([(function.address, function)]);
        let model = Model::new(&testing::CLOCK);
        let named = BTreeMap::new();
        let mut wcets = Wcets::new(&functions, &model, &named, BTreeSet::new());
        wcets.beside = (0..beside as u32).collect();
        [Cache::Loops, Cache::Outside, Cache::Visits]
            .map(|cache| wcets.bound(0x0800_0000, cache).unwrap().cycles())
    }

    #[test]
    fn a_loop_that_fits_is_loaded_once() {
        // Blocks of one or two lines: 2, 2, 2 and 1; the refill of the return.
        let outside = 3 + 5 * 2 + 2 + 5 + 3;
        let inside = 21 * 4 + 20 * 6;
        assert_eq!(bounds(10), [outside + inside + 5 * (4 + 10), outside, 1]);
    }

    #[test]
    fn a_loop_that_does_not_fit_beside_the_others_is_fetched_each_round() {
        let found = bounds(61);
        let all = 3 + 10 + 21 * (4 + 10) + 20 * (6 + 10) + 2 + 5 + 3;
        assert_eq!(found, [all, all, 0]);
    }
}
