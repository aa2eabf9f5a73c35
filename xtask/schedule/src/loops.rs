//! Natural loops of a function.
//!
//! A way back to a block that dominates where it comes from makes a loop; any other way back goes
//! into the middle of one, and the loop cannot be bounded.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Block, Loop};

/// The loops of a function, and the blocks where loops are entered in their middle.
pub(crate) struct Loops {
    /// The outer before the inner.
    pub(crate) natural: Vec<Loop>,
    pub(crate) irreducible: Vec<usize>,
}

/// Finds the loops of a function.
pub(crate) fn find(blocks: &[Block]) -> Loops {
    let mut loops = Loops {
        natural: Vec::new(),
        irreducible: Vec::new(),
    };
    if blocks.is_empty() {
        return loops;
    }
    let predecessors = predecessors(blocks);
    let walk = Walk::new(blocks);
    let dominators = Dominators::new(&walk.order, &predecessors);
    let mut by_head: BTreeMap<usize, Loop> = BTreeMap::new();
    for &(from, head) in &walk.back {
        if !dominators.dominates(head, from) {
            loops.irreducible.push(head);
            continue;
        }
        let found = by_head.entry(head).or_insert_with(|| Loop {
            head,
            blocks: BTreeSet::from([head]),
            back: BTreeSet::new(),
            bound: None,
            total: None,
            lines: BTreeSet::new(),
        });
        found.back.insert(from);
        let mut work = vec![from];
        while let Some(block) = work.pop() {
            if found.blocks.insert(block) {
                work.extend(&predecessors[block]);
            }
        }
    }
    loops.natural = by_head.into_values().collect();
    loops
        .natural
        .sort_by_key(|found| std::cmp::Reverse(found.blocks.len()));
    loops
}

/// The blocks from which each block is reached.
fn predecessors(blocks: &[Block]) -> Vec<Vec<usize>> {
    let mut predecessors = vec![Vec::new(); blocks.len()];
    for (from, block) in blocks.iter().enumerate() {
        for edge in &block.successors {
            predecessors[edge.to].push(from);
        }
    }
    predecessors
}

/// A walk through the graph, depth first.
struct Walk {
    /// The blocks that are reached, each after those it follows but on ways back.
    order: Vec<usize>,
    /// Ways back: from, to.
    back: Vec<(usize, usize)>,
}

impl Walk {
    fn new(blocks: &[Block]) -> Self {
        #[derive(Clone, Copy, PartialEq)]
        enum State {
            New,
            Open,
            Done,
        }
        let mut states = vec![State::New; blocks.len()];
        let mut walk = Self {
            order: Vec::new(),
            back: Vec::new(),
        };
        let mut stack = vec![(0, 0)];
        states[0] = State::Open;
        while let Some((block, way)) = stack.pop() {
            let Some(edge) = blocks[block].successors.get(way) else {
                states[block] = State::Done;
                walk.order.push(block);
                continue;
            };
            stack.push((block, way + 1));
            match states[edge.to] {
                State::New => {
                    states[edge.to] = State::Open;
                    stack.push((edge.to, 0));
                }
                State::Open => walk.back.push((block, edge.to)),
                State::Done => {}
            }
        }
        walk.order.reverse();
        walk
    }
}

/// Which block is passed on each way to which (K. Cooper, T. Harvey, K. Kennedy 2001).
struct Dominators {
    /// The place of each block in the order; `None`: it is not reached.
    place: Vec<Option<usize>>,
    /// The place of the last dominator of each, by place.
    last: Vec<usize>,
}

impl Dominators {
    fn new(order: &[usize], predecessors: &[Vec<usize>]) -> Self {
        const NONE: usize = usize::MAX;
        let mut place = vec![None; predecessors.len()];
        for (index, &block) in order.iter().enumerate() {
            place[block] = Some(index);
        }
        let mut last = vec![NONE; order.len()];
        last[0] = 0;
        let mut changes = true;
        while changes {
            changes = false;
            for (index, &block) in order.iter().enumerate().skip(1) {
                let known = predecessors[block]
                    .iter()
                    .filter_map(|&from| place[from])
                    .filter(|&from| last[from] != NONE);
                let joined = known.reduce(|left, right| common(&last, left, right));
                if let Some(joined) = joined
                    && last[index] != joined
                {
                    last[index] = joined;
                    changes = true;
                }
            }
        }
        Self { place, last }
    }

    fn dominates(&self, block: usize, other: usize) -> bool {
        let (Some(block), Some(mut other)) = (self.place[block], self.place[other]) else {
            return false;
        };
        while other > block {
            other = self.last[other];
        }
        other == block
    }
}

/// The last block that dominates both, by their places.
fn common(last: &[usize], mut left: usize, mut right: usize) -> usize {
    while left != right {
        if left > right {
            left = last[left];
        } else {
            right = last[right];
        }
    }
    left
}
