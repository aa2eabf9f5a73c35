//! Natural loops of a function.
//!
//! An edge to a block that dominates its source is a back edge and makes a loop; any other edge
//! back enters a loop in the middle, and such a loop cannot be bounded.

use std::{
    cmp::Reverse,
    collections::{BTreeMap, BTreeSet},
};

use petgraph::{
    Direction::Incoming,
    algo::dominators::simple_fast,
    graph::{DiGraph, NodeIndex},
    visit::{DfsEvent, depth_first_search},
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
    if blocks.is_empty() {
        return loops;
    }
    let edges = (0..).zip(blocks).flat_map(|(from, block)| {
        let successors = block.successors.iter();
        successors.map(move |edge| (from, edge.to as u32))
    });
    let mut graph = DiGraph::<(), ()>::new();
    for _ in blocks {
        graph.add_node(());
    }
    graph.extend_with_edges(edges);
    let start = NodeIndex::new(0);
    let dominators = simple_fast(&graph, start);
    let mut by_head: BTreeMap<usize, Loop> = BTreeMap::new();
    depth_first_search(&graph, [start], |event| {
        let DfsEvent::BackEdge(from, head) = event else {
            return;
        };
        let dominates = dominators
            .dominators(from)
            .is_some_and(|mut passed| passed.any(|block| block == head));
        let index = head.index();
        if !dominates {
            loops.irreducible.push(index);
            return;
        }
        let found = by_head.entry(index).or_insert_with(|| Loop {
            head: index,
            blocks: BTreeSet::from([index]),
            back: BTreeSet::new(),
            bound: None,
            counted: None,
            total: None,
            lines: BTreeSet::new(),
            within: String::new(),
        });
        found.back.insert(from.index());
        let mut work = vec![from];
        while let Some(block) = work.pop() {
            if found.blocks.insert(block.index()) {
                work.extend(graph.neighbors_directed(block, Incoming));
            }
        }
    });
    loops.natural = by_head.into_values().collect();
    loops
        .natural
        .sort_by_key(|found| Reverse(found.blocks.len()));
    loops
}

/// Whether every iteration of a loop executes one of these blocks.
pub(crate) fn is_on_every_path(
    function: &Function,
    looped: &Loop,
    through: &BTreeSet<usize>,
) -> bool {
    let mut seen = BTreeSet::new();
    let mut work = vec![looped.head];
    while let Some(block) = work.pop() {
        if through.contains(&block) || !seen.insert(block) {
            continue;
        }
        let next = function.blocks[block].successors.iter().map(|edge| edge.to);
        let inside: Vec<usize> = next.filter(|to| looped.blocks.contains(to)).collect();
        if inside.contains(&looped.head) {
            return false;
        }
        work.extend(inside);
    }
    true
}
