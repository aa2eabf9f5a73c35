//! Blocks of the instructions that a walk has found.

use std::collections::HashMap;

use super::{Graph, Walk};
use crate::{Block, Edge, Flaw, Image, Instruction, Operation, Rule};

impl Walk<'_, '_> {
    pub(super) fn finish(mut self, address: u32) -> Graph {
        let mut blocks: Vec<Block> = Vec::new();
        let mut index = HashMap::new();
        let mut open: Vec<Instruction> = Vec::new();
        let mut instructions = self.instructions.values().peekable();
        while let Some(&instruction) = instructions.next() {
            open.push(instruction);
            let at = instruction.address;
            let next = instruction.end();
            let goes_on = instructions
                .peek()
                .is_some_and(|following| following.address == next);
            if goes_on && !self.successors.contains_key(&at) && !self.leaders.contains(&next) {
                continue;
            }
            index.insert(open[0].address, blocks.len());
            blocks.push(Block {
                instructions: std::mem::take(&mut open),
                successors: Vec::new(),
                call: self.calls.get(&at).copied(),
                ends: self.ends.contains(&at),
                traps: self.traps.contains(&at),
            });
        }
        self.connect(&mut blocks, &index);
        self.flaws
            .retain(|flaw| !is_impossible(self.graphs.image, &blocks, flaw));
        if let Some(&first) = index.get(&address) {
            move_to_front(&mut blocks, first);
        }
        Graph {
            returns: blocks.iter().any(|block| block.ends),
            blocks,
            flaws: self.flaws,
        }
    }

    fn connect(&mut self, blocks: &mut [Block], index: &HashMap<u32, usize>) {
        for block in blocks {
            let Some(last) = block.instructions.last() else {
                continue;
            };
            let simple = vec![(last.end(), false)];
            let successors = self.successors.get(&last.address).unwrap_or(&simple);
            for (to, is_taken) in successors {
                match index.get(to) {
                    Some(&to) => block.successors.push(Edge {
                        to,
                        is_taken: *is_taken,
                    }),
                    // Its flaw has been noted when it was decoded.
                    None => block.traps = true,
                }
            }
        }
    }
}

/// Makes `first` the first block.
fn move_to_front(blocks: &mut [Block], first: usize) {
    blocks.swap(0, first);
    for edge in blocks.iter_mut().flat_map(|block| &mut block.successors) {
        if edge.to == 0 {
            edge.to = first;
        } else if edge.to == first {
            edge.to = 0;
        }
    }
}

/// Whether a trap stands for a value that a `match` cannot have: the compiler puts its own trap
/// where a jump table has no entry, and nothing else leads there.
fn is_impossible(image: &Image, blocks: &[Block], flaw: &Flaw) -> bool {
    const TRAP: u16 = 0xdefe;
    let at = flaw.place.address;
    if flaw.rule != Rule::ReachableTrap || image.half(at) != Some(TRAP) {
        return false;
    }
    let Some(trap) = blocks.iter().position(|block| block.start() == at) else {
        return false;
    };
    let mut leading = blocks
        .iter()
        .filter(|block| block.successors.iter().any(|edge| edge.to == trap))
        .peekable();
    leading.peek().is_some()
        && leading.all(|block| {
            let last = block.instructions.last();
            last.is_some_and(|last| matches!(last.operation, Operation::TableJump { .. }))
        })
}
