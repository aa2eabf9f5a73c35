//! Walks over graphs: of the blocks of a function, and of calls.

use std::collections::BTreeSet;

use crate::{Block, Function, Instruction, Loop};

/// Returns all that is reached from some beginnings, which are part of it.
pub(crate) fn reachable<T: Copy + Ord, N: IntoIterator<Item = T>>(
    from: impl IntoIterator<Item = T>,
    mut next: impl FnMut(T) -> N,
) -> BTreeSet<T> {
    let mut reached: BTreeSet<T> = from.into_iter().collect();
    let mut work: Vec<T> = reached.iter().copied().collect();
    while let Some(one) = work.pop() {
        work.extend(next(one).into_iter().filter(|to| reached.insert(*to)));
    }
    reached
}

impl Function {
    /// Its instructions, block by block.
    pub(crate) fn instructions(&self) -> impl Iterator<Item = &Instruction> {
        self.blocks.iter().flat_map(|block| &block.instructions)
    }

    /// The functions whose calls in it return.
    pub(crate) fn returning_calls(&self) -> impl Iterator<Item = u32> {
        self.blocks.iter().filter_map(Block::returning_call)
    }

    /// Returns the blocks that are reached from some blocks, which are part of them. No path goes on behind a block
    /// that ends it.
    pub(crate) fn reach(
        &self,
        from: impl IntoIterator<Item = usize>,
        ends: impl Fn(usize) -> bool,
    ) -> BTreeSet<usize> {
        reachable(from, |block| {
            let goes_on = !ends(block);
            self.blocks[block].next().filter(move |_| goes_on)
        })
    }

    /// Whether a path from a block leads to a block that is judged `Some(true)`. No path goes on behind a block that is
    /// judged `Some(false)`.
    pub(crate) fn leads(&self, from: usize, judge: impl Fn(usize) -> Option<bool>) -> bool {
        let mut is_found = false;
        let from = Some(from).filter(|from| *from < self.blocks.len());
        reachable(from, |block| {
            let judged = judge(block);
            is_found |= judged == Some(true);
            self.blocks[block].next().filter(move |_| judged.is_none())
        });
        is_found
    }
}

impl Block {
    /// The blocks that may be executed next.
    pub(crate) fn next(&self) -> impl Iterator<Item = usize> {
        self.successors.iter().map(|edge| edge.to)
    }

    /// The called function, if the call returns.
    pub(crate) fn returning_call(&self) -> Option<u32> {
        self.call.filter(|_| !self.traps)
    }

    /// The address of its last instruction: a call, if it has one.
    pub(crate) fn last(&self) -> u32 {
        self.instructions.last().map_or(0, |last| last.address)
    }
}

impl Loop {
    /// Its blocks, those of inner loops too.
    pub(crate) fn blocks_of<'a>(
        &'a self,
        function: &'a Function,
    ) -> impl Iterator<Item = &'a Block> + Clone {
        self.blocks.iter().map(|block| &function.blocks[*block])
    }
}
