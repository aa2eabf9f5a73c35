//! Natural loops of a function.
//!
//! An edge to a block that dominates its source is a back edge and makes a loop; any other edge
//! back enters a loop in the middle, and such a loop cannot be bounded.

use std::{
    cmp::Reverse,
    collections::{BTreeMap, BTreeSet},
    iter,
};

use crate::{Block, Function, Loop};

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
    let order = DepthFirst::search(blocks);
    let dominators = order.dominators();
    let mut by_head: BTreeMap<usize, Loop> = BTreeMap::new();
    for &(from, head) in &order.back {
        let mut passed = iter::successors(Some(from), |block| dominators[*block]);
        if !passed.any(|block| block == head) {
            loops.irreducible.push(head);
            continue;
        }
        let found = by_head.entry(head).or_insert_with(|| Loop {
            head,
            blocks: BTreeSet::from([head]),
            ..Loop::default()
        });
        found.back.insert(from);
        let mut work = vec![from];
        while let Some(block) = work.pop() {
            if found.blocks.insert(block) {
                work.extend(&order.sources[block]);
            }
        }
    }
    loops.natural = by_head.into_values().collect();
    loops
        .natural
        .sort_by_key(|found| Reverse(found.blocks.len()));
    loops
}

/// Blocks in the order of a search in depth.
pub(crate) struct DepthFirst {
    /// Those that are reached, each after all that are first reached from it.
    finished: Vec<usize>,
    /// Edges to a block from which the search has come.
    pub(crate) back: Vec<(usize, usize)>,
    /// The blocks before each.
    sources: Vec<Vec<usize>>,
}

impl DepthFirst {
    pub(crate) fn search(blocks: &[Block]) -> Self {
        let mut order = Self {
            finished: Vec::new(),
            back: Vec::new(),
            sources: vec![Vec::new(); blocks.len()],
        };
        for (from, block) in blocks.iter().enumerate() {
            for edge in &block.successors {
                order.sources[edge.to].push(from);
            }
        }
        let mut is_reached = vec![false; blocks.len()];
        let mut is_open = vec![false; blocks.len()];
        // With the number of edges that have been followed.
        let mut path = Vec::new();
        let mut next = (!blocks.is_empty()).then_some(0);
        loop {
            if let Some(reached) = next {
                is_reached[reached] = true;
                is_open[reached] = true;
                path.push((reached, 0));
            }
            let Some((block, followed)) = path.last_mut() else {
                return order;
            };
            next = None;
            let mut edges = blocks[*block].successors.iter().rev();
            let Some(edge) = edges.nth(*followed) else {
                is_open[*block] = false;
                order.finished.push(*block);
                path.pop();
                continue;
            };
            *followed += 1;
            if is_open[edge.to] {
                order.back.push((*block, edge.to));
            } else if !is_reached[edge.to] {
                next = Some(edge.to);
            }
        }
    }

    /// The nearest other block that is on all paths to a block, for each that has one: Cooper, Harvey and Kennedy, A Simple,
    /// Fast Dominance Algorithm, 2001.
    fn dominators(&self) -> Vec<Option<usize>> {
        let mut number = vec![0; self.sources.len()];
        for (index, &block) in self.finished.iter().enumerate() {
            number[block] = index;
        }
        let Some((&first, others)) = self.finished.split_last() else {
            return Vec::new();
        };
        let mut dominators = vec![None; self.sources.len()];
        let mut is_changed = true;
        while is_changed {
            is_changed = false;
            for &block in others.iter().rev() {
                let sources = self.sources[block].iter().copied();
                let known = sources.filter(|&from| from == first || dominators[from].is_some());
                let common = known.reduce(|mut one, mut other| {
                    while one != other {
                        let earlier = if number[one] < number[other] {
                            &mut one
                        } else {
                            &mut other
                        };
                        *earlier = dominators[*earlier].unwrap_or(first);
                    }
                    one
                });
                is_changed |= dominators[block] != common;
                dominators[block] = common;
            }
        }
        dominators
    }
}

/// Whether every iteration of a loop executes one of these blocks.
pub(crate) fn is_on_every_path(
    function: &Function,
    looped: &Loop,
    through: &BTreeSet<usize>,
) -> bool {
    let judge = |block: usize| {
        let is_over = through.contains(&block) || !looped.blocks.contains(&block);
        let returns = function.blocks[block].next().any(|to| to == looped.head);
        if is_over {
            Some(false)
        } else {
            returns.then_some(true)
        }
    };
    !function.leads(looped.head, judge)
}

/// The blocks that each run of a loop with a total executes, where every iteration executes one of them.
pub(crate) fn in_runs<'l>(function: &Function, looped: &'l Loop) -> Option<&'l BTreeSet<usize>> {
    let in_runs = &looped.total.as_ref()?.in_runs;
    is_on_every_path(function, looped, in_runs).then_some(in_runs)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    /// The blocks that are reached without coming through one.
    fn reached(blocks: &[Block], without: usize) -> BTreeSet<usize> {
        let mut seen = BTreeSet::new();
        let mut work = vec![0];
        while let Some(block) = work.pop() {
            if block != without && seen.insert(block) {
                work.extend(blocks[block].successors.iter().map(|edge| edge.to));
            }
        }
        seen
    }

    proptest! {
        #![proptest_config(crate::cases(1000))]

        #[test]
        fn loops_are_what_dominators_define(
            edges in prop::collection::vec(prop::collection::vec(0..9_usize, 0..4), 9)
        ) {
            let blocks: Vec<_> = edges
                .iter()
                .enumerate()
                .map(|(index, to)| testing::block(index, 1, to))
                .collect();
            let all = reached(&blocks, usize::MAX);
            let dominates = |head, block| head == block || !reached(&blocks, head).contains(&block);
            let found = find(&blocks);
            let mut backs = 0;
            for head in all.iter().copied() {
                let sources = all.iter().copied().filter(|from| edges[*from].contains(&head));
                let back: BTreeSet<_> = sources.filter(|from| dominates(head, *from)).collect();
                let natural = found.natural.iter().find(|it| it.head == head);
                prop_assert_eq!(natural.map_or_else(BTreeSet::new, |it| it.back.clone()), back.clone());
                backs += back.len();
                let Some(natural) = natural else { continue };
                // Those from which an end of the loop is reached without its head.
                let is_within = |block: usize| {
                    let mut seen = BTreeSet::from([head]);
                    let mut work = vec![block];
                    while let Some(next) = work.pop() {
                        if seen.insert(next) {
                            work.extend(&edges[next]);
                        }
                    }
                    block == head || back.iter().any(|end| *end != head && seen.contains(end))
                };
                let within: BTreeSet<_> = all.iter().copied().filter(|it| is_within(*it)).collect();
                let blocks: BTreeSet<_> = natural.blocks.intersection(&all).copied().collect();
                prop_assert_eq!(blocks, within);
            }
            // Without irreducible loops nothing else leads back: what is left of the graph has an order.
            if found.irreducible.is_empty() {
                let order = DepthFirst::search(&blocks);
                let place = |block| order.finished.iter().position(|it| *it == block);
                let is_forward = |from: &usize, to: &usize| place(*to) < place(*from);
                let turned = all.iter().flat_map(|from| {
                    let unique: BTreeSet<_> = edges[*from].iter().collect();
                    unique.into_iter().filter(move |to| !is_forward(from, to)).collect::<Vec<_>>()
                });
                prop_assert_eq!(turned.count(), backs);
            }
        }
    }
}
