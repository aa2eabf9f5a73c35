//! The longest path through a function whose loops have bounds.
//!
//! Without its back edges, a reducible graph is acyclic, and its longest path is found block by block
//! in topological order. Each loop adds its longest iteration as often as its bound allows; inner loops
//! are solved first. Time is linear in the size of the graph; a test compares the result with the
//! enumeration of all paths.

use std::collections::{BTreeMap, BTreeSet};

/// A graph with costs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Graph {
    /// Cost of each block.
    pub(crate) costs: Vec<u64>,
    /// Successors of each block with the cost of the edge.
    pub(crate) edges: Vec<Vec<(usize, u64)>>,
    /// Blocks where a path may end.
    pub(crate) ends: Vec<bool>,
    /// Loops, the inner before the outer.
    pub(crate) loops: Vec<LoopPaths>,
}

/// A loop of a graph.
#[derive(Debug, Clone)]
pub(crate) struct LoopPaths {
    pub(crate) head: usize,
    /// Whether each block belongs to it.
    pub(crate) blocks: Vec<bool>,
    /// Iterations for each entry; `None`: the caller counts [`Longest::iterations`].
    pub(crate) most: Option<u64>,
    /// Iterations in all, when they are not counted for each entry.
    pub(crate) total: Option<u64>,
    /// Blocks that are executed exactly once in an iteration: with iterations counted in all, such
    /// blocks cost nothing where the loop is entered. The head is one of them when each arrival at
    /// the head counts as an iteration.
    pub(crate) in_runs: BTreeSet<usize>,
}

/// The longest path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Longest {
    pub(crate) cost: u64,
    /// How often each block is on it.
    pub(crate) counts: Vec<u64>,
    /// The loops counted by the caller: head, cost of the longest iteration, counts of its blocks.
    pub(crate) iterations: BTreeMap<usize, (u64, Vec<u64>)>,
}

/// Dual values of the longest paths: from each block, the cost of the rest of a path, that block included, where it
/// comes to an end. No edge of the graph makes a longer one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Duals {
    /// To where a path may end.
    pub(crate) path: Vec<Option<u64>>,
    /// For each loop by its head: to the end of an iteration.
    pub(crate) iterations: BTreeMap<usize, Vec<Option<u64>>>,
}

/// The loops solved so far.
struct Found {
    /// By their heads.
    iterations: BTreeMap<usize, LongestIteration>,
    /// Blocks that are charged with the iterations of their loop only.
    is_free: Vec<bool>,
}

/// The longest iteration of a loop.
struct LongestIteration {
    cost: u64,
    /// Its blocks, the head first.
    path: Vec<usize>,
    most: u64,
    /// Whether some of its blocks are charged here only.
    counts_in_runs: bool,
}

impl Graph {
    /// The longest path from block 0; `None` when no end can be reached.
    pub(crate) fn longest(&self) -> Option<Longest> {
        self.longest_from(0)
    }

    /// The longest path from a block; `None` when no end can be reached, or the path begins amid a
    /// loop, whose bound does not count the iterations from there.
    pub(crate) fn longest_from(&self, source: usize) -> Option<Longest> {
        if source != 0 && self.loops.iter().any(|looped| looped.blocks[source]) {
            return None;
        }
        let order = self.order(source);
        let mut found = self.none_found();
        for looped in &self.loops {
            self.solve(looped, &order, &mut found);
        }
        let paths = self.path_costs(&order, source, None, &found);
        let end = (0..self.costs.len())
            .filter(|block| self.ends[*block])
            .filter_map(|block| paths[block].map(|(cost, _)| (cost, block)))
            .max()?;
        let mut counts = vec![0; self.costs.len()];
        let path = back(&paths, end.1);
        expand(&mut counts, &found, &path, 1, None);
        let open = self.loops.iter().filter(|looped| looped.most.is_none());
        let iterations = open.filter_map(|looped| {
            let iteration = found.iterations.get(&looped.head)?;
            let mut counts = vec![0; self.costs.len()];
            expand(&mut counts, &found, &iteration.path, 1, Some(looped.head));
            Some((looped.head, (iteration.cost, counts)))
        });
        Some(Longest {
            cost: end.0,
            counts,
            iterations: iterations.collect(),
        })
    }

    /// The dual values of the longest path from block 0.
    pub(crate) fn duals(&self) -> Duals {
        let order = self.order(0);
        let mut found = self.none_found();
        let mut iterations = BTreeMap::new();
        for looped in &self.loops {
            iterations.insert(looped.head, self.rests(&order, Some(looped), &found));
            self.solve(looped, &order, &mut found);
        }
        Duals {
            path: self.rests(&order, None, &found),
            iterations,
        }
    }

    fn none_found(&self) -> Found {
        Found {
            iterations: BTreeMap::new(),
            is_free: vec![false; self.costs.len()],
        }
    }

    /// Solves a loop whose inner loops are solved.
    fn solve(&self, looped: &LoopPaths, order: &[usize], found: &mut Found) {
        let paths = self.path_costs(order, looped.head, Some(&looped.blocks), found);
        let iteration = self.longest_iteration(looped, &paths);
        found.iterations.insert(looped.head, iteration);
        let is_all = looped.in_runs.contains(&looped.head);
        for (block, is_free) in found.is_free.iter_mut().enumerate() {
            *is_free |= looped.in_runs.contains(&block) || is_all && looped.blocks[block];
        }
    }

    /// The longest rest of a path from each block, or of an iteration of a loop.
    fn rests(
        &self,
        order: &[usize],
        looped: Option<&LoopPaths>,
        found: &Found,
    ) -> Vec<Option<u64>> {
        let mut rests: Vec<Option<u64>> = vec![None; self.costs.len()];
        let is_inside = |block: usize| looped.is_none_or(|looped| looped.blocks[block]);
        for &block in order.iter().rev().filter(|block| is_inside(**block)) {
            let ends = match looped {
                Some(looped) => !looped.in_runs.is_empty() && self.leaves(looped, block),
                None => self.ends[block],
            };
            let after = self.edges[block].iter().filter_map(|&(to, edge)| {
                if looped.is_some_and(|looped| looped.head == to) {
                    return Some(edge);
                }
                let is_free = found.is_free[block] && found.is_free[to];
                let rest = rests[to].filter(|_| is_inside(to) && !self.is_back(block, to))?;
                Some(rest + if is_free { 0 } else { edge })
            });
            let rest = after.chain(ends.then_some(0)).max();
            let cost = self.cost(block, looped.map(|looped| looped.head), found);
            rests[block] = rest.map(|rest| rest + cost);
        }
        rests
    }

    /// Whether a path may go from a block of a loop to where the loop has ended.
    fn leaves(&self, looped: &LoopPaths, block: usize) -> bool {
        let mut edges = self.edges[block].iter();
        self.ends[block] || edges.any(|(to, _)| !looped.blocks[*to])
    }

    /// The cost of a block on a path, with the iterations of its loop, unless those are the path.
    fn cost(&self, block: usize, own: Option<usize>, found: &Found) -> u64 {
        if found.is_free[block] {
            return 0;
        }
        let iteration = found.iterations.get(&block).filter(|_| own != Some(block));
        self.costs[block] + iteration.map_or(0, |iteration| iteration.most * iteration.cost)
    }

    /// Blocks in an order in which every edge but those back leads forwards.
    fn order(&self, source: usize) -> Vec<usize> {
        let mut order = Vec::with_capacity(self.costs.len());
        let mut is_seen = vec![false; self.costs.len()];
        let mut stack = vec![(source, 0)];
        is_seen[source] = true;
        while let Some((block, next)) = stack.pop() {
            if let Some((to, _)) = self.edges[block].get(next) {
                stack.push((block, next + 1));
                if !is_seen[*to] {
                    is_seen[*to] = true;
                    stack.push((*to, 0));
                }
            } else {
                order.push(block);
            }
        }
        order.reverse();
        order
    }

    /// The longest path to each block from `start`, its own costs included, without back edges, and
    /// the block before. Only through blocks that `within` names.
    fn path_costs(
        &self,
        order: &[usize],
        start: usize,
        within: Option<&Vec<bool>>,
        found: &Found,
    ) -> Vec<Option<(u64, usize)>> {
        let mut paths: Vec<Option<(u64, usize)>> = vec![None; self.costs.len()];
        let is_inside = |block: usize| within.is_none_or(|within| within[block]);
        let cost = |block: usize| self.cost(block, within.map(|_| start), found);
        paths[start] = Some((cost(start), start));
        for &block in order {
            let Some((so_far, _)) = paths[block] else {
                continue;
            };
            for &(to, edge) in &self.edges[block] {
                if !is_inside(to) || to == start || self.is_back(block, to) {
                    continue;
                }
                let is_free = found.is_free[block] && found.is_free[to];
                let new = so_far + if is_free { 0 } else { edge } + cost(to);
                if paths[to].is_none_or(|(old, _)| old < new) {
                    paths[to] = Some((new, block));
                }
            }
        }
        paths
    }

    /// Whether an edge closes a loop.
    fn is_back(&self, from: usize, to: usize) -> bool {
        let mut loops = self.loops.iter();
        loops.any(|looped| looped.head == to && looped.blocks[from])
    }

    fn longest_iteration(
        &self,
        looped: &LoopPaths,
        paths: &[Option<(u64, usize)>],
    ) -> LongestIteration {
        let blocks = (0..self.costs.len()).filter(|block| looped.blocks[*block]);
        let mut longest = blocks
            .clone()
            .flat_map(|block| self.edges[block].iter().map(move |edge| (block, edge)))
            .filter(|(_, (to, _))| *to == looped.head)
            .filter_map(|(block, (_, cost))| paths[block].map(|(path, _)| (path + cost, block)))
            .max();
        if !looped.in_runs.is_empty() {
            let last = blocks.filter(|block| self.leaves(looped, *block));
            let last = last.filter_map(|block| paths[block].map(|(path, _)| (path, block)));
            longest = longest.max(last.max());
        }
        LongestIteration {
            cost: longest.map_or(0, |(cost, _)| cost),
            path: longest.map_or_else(Vec::new, |(_, block)| back(paths, block)),
            most: looped.most.unwrap_or(0),
            counts_in_runs: !looped.in_runs.is_empty(),
        }
    }
}

/// The blocks of the longest path to `end`.
fn back(paths: &[Option<(u64, usize)>], end: usize) -> Vec<usize> {
    let mut path = vec![end];
    let mut block = end;
    while let Some((_, before)) = paths[block].filter(|(_, before)| *before != block) {
        path.push(before);
        block = before;
    }
    path.reverse();
    path
}

/// Counts the blocks of a path with the iterations of its loops, except the loop `own`.
fn expand(counts: &mut [u64], found: &Found, path: &[usize], times: u64, own: Option<usize>) {
    let own_iteration = own.and_then(|own| found.iterations.get(&own));
    let counts_in_runs = own_iteration.is_some_and(|iteration| iteration.counts_in_runs);
    let is_counted = |block: &&usize| counts_in_runs || !found.is_free[**block];
    for block in path.iter().filter(is_counted) {
        counts[*block] += times;
        let iteration = found.iterations.get(block).filter(|_| own != Some(*block));
        if let Some(iteration) = iteration.filter(|iteration| iteration.most > 0) {
            expand(
                counts,
                found,
                &iteration.path,
                times * iteration.most,
                Some(*block),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A program of structure: what reducible graphs are made of.
    #[derive(Debug, Clone)]
    enum Code {
        Step(u64),
        Then(Box<Code>, Box<Code>),
        Either(Box<Code>, Box<Code>),
        Repeat(u64, Box<Code>),
    }

    fn code() -> impl Strategy<Value = Code> {
        let step = (1_u64..50).prop_map(Code::Step);
        step.prop_recursive(4, 10, 2, |inner| {
            prop_oneof![
                (inner.clone(), inner.clone()).prop_map(|(a, b)| Code::Then(a.into(), b.into())),
                (inner.clone(), inner.clone()).prop_map(|(a, b)| Code::Either(a.into(), b.into())),
                (0_u64..3, inner).prop_map(|(most, a)| Code::Repeat(most, a.into())),
            ]
        })
    }

    impl Graph {
        fn block(&mut self, cost: u64) -> usize {
            self.costs.push(cost);
            self.edges.push(Vec::new());
            self.ends.push(false);
            self.costs.len() - 1
        }

        /// Adds code after a block; returns the block where the code ends.
        fn append(&mut self, from: usize, code: &Code) -> usize {
            match code {
                Code::Step(cost) => {
                    let block = self.block(*cost);
                    self.edges[from].push((block, cost % 3));
                    block
                }
                Code::Then(first, second) => {
                    let middle = self.append(from, first);
                    self.append(middle, second)
                }
                Code::Either(first, second) => {
                    let (first, second) = (self.append(from, first), self.append(from, second));
                    let join = self.block(1);
                    self.edges[first].push((join, 0));
                    self.edges[second].push((join, 3));
                    join
                }
                Code::Repeat(most, body) => {
                    let head = self.block(2);
                    self.edges[from].push((head, 0));
                    let last = self.append(head, body);
                    self.edges[last].push((head, 3));
                    let blocks = head..self.costs.len();
                    let inside = (0..1000).map(|block| blocks.contains(&block));
                    self.loops.push(LoopPaths {
                        head,
                        blocks: inside.collect(),
                        most: Some(*most),
                        total: None,
                        in_runs: BTreeSet::new(),
                    });
                    let exit = self.block(1);
                    self.edges[head].push((exit, 0));
                    exit
                }
            }
        }

        fn of(code: &Code) -> Self {
            let mut graph = Self::default();
            graph.block(1);
            let end = graph.append(0, code);
            graph.ends[end] = true;
            graph
        }

        /// Every path, one after another: the greatest cost.
        fn enumerate(&self, block: usize, left: &BTreeMap<usize, u64>, cost: u64) -> u64 {
            let cost = cost + self.costs[block];
            let mut worst = if self.ends[block] { cost } else { 0 };
            for (to, edge) in &self.edges[block] {
                let mut left = left.clone();
                if let Some(looped) = self.loops.iter().find(|looped| looped.head == *to) {
                    let most = looped.most.unwrap();
                    let left = left.entry(*to).or_insert(most);
                    if !looped.blocks[block] {
                        *left = most;
                    } else if *left == 0 {
                        continue;
                    } else {
                        *left -= 1;
                    }
                }
                worst = worst.max(self.enumerate(*to, &left, cost + edge));
            }
            worst
        }

        /// Few enough paths to go along each.
        fn is_small(&self) -> bool {
            self.loops.len() <= 3 && self.costs.len() <= 16
        }
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn the_longest_path_is_that_of_enumeration(code in code()) {
            let graph = Graph::of(&code);
            prop_assume!(graph.is_small());
            let enumerated = graph.enumerate(0, &BTreeMap::new(), 0);
            let longest = graph.longest().unwrap();
            prop_assert_eq!(longest.cost, enumerated);
            prop_assert_eq!(graph.duals().path[0], Some(enumerated));
            let cost: u64 = longest.counts.iter().zip(&graph.costs).map(|(n, cost)| n * cost).sum();
            prop_assert!(cost <= enumerated);
        }
    }

    #[test]
    fn a_path_may_begin_anywhere_but_amid_a_loop() {
        let graph = nested(Some(4));
        assert_eq!(graph.longest_from(3).unwrap().cost, 1000);
        assert_eq!(graph.longest_from(2), None);
    }

    fn looped(head: usize, blocks: &[usize], most: Option<u64>, size: usize) -> LoopPaths {
        let mut is_in = vec![false; size];
        for block in blocks {
            is_in[*block] = true;
        }
        LoopPaths {
            head,
            blocks: is_in,
            most,
            total: None,
            in_runs: BTreeSet::new(),
        }
    }

    /// 0 -> 1 (head) -> 2 (inner head) -> 2, 2 -> 1, 1 -> 3.
    fn nested(inner: Option<u64>) -> Graph {
        Graph {
            costs: vec![1, 10, 100, 1000],
            edges: vec![
                vec![(1, 0)],
                vec![(2, 3), (3, 0)],
                vec![(2, 3), (1, 3)],
                vec![],
            ],
            ends: vec![false, false, false, true],
            loops: vec![looped(2, &[2], inner, 4), looped(1, &[1, 2], Some(5), 4)],
        }
    }

    #[test]
    fn loops_within_loops_multiply() {
        let longest = nested(Some(4)).longest().unwrap();
        // Five iterations of 10 + 3 + 100 + 4 * 103 + 3, and once more 10.
        assert_eq!(
            longest.cost,
            1 + 10 + 5 * (10 + 3 + 100 + 4 * 103 + 3) + 1000
        );
        assert_eq!(longest.counts, [1, 6, 25, 1]);
    }

    #[test]
    fn a_loop_without_a_number_is_distinguished() {
        let longest = nested(None).longest().unwrap();
        assert_eq!(longest.cost, 1 + 10 + 5 * (10 + 3 + 100 + 3) + 1000);
        assert_eq!(longest.iterations[&2], (103, vec![0, 0, 1, 0]));
    }

    #[test]
    fn passes_count_the_arrivals_too() {
        let mut graph = nested(None);
        graph.loops[0].in_runs = BTreeSet::from([2]);
        graph.loops[0].total = Some(7);
        let longest = graph.longest().unwrap();
        // The inner loop costs nothing on the path: only the edges into it and out of it.
        assert_eq!(longest.cost, 1 + 10 + 5 * (10 + 3 + 3) + 1000);
        assert_eq!(longest.counts, [1, 6, 0, 1]);
        assert_eq!(longest.iterations[&2], (103, vec![0, 0, 1, 0]));
    }

    #[test]
    fn what_is_in_runs_only_costs_nothing_where_the_loop_is_entered() {
        // 0 -> 1 -> 2 (head, tests) -> 3 (runs) -> 2 or 4; 4 -> 1 or 5.
        let mut graph = Graph {
            costs: vec![1, 10, 100, 1000, 10_000, 0],
            edges: vec![
                vec![(1, 0)],
                vec![(2, 0)],
                vec![(3, 0), (4, 0)],
                vec![(2, 3), (4, 0)],
                vec![(1, 0), (5, 0)],
                vec![],
            ],
            ends: vec![false, false, false, false, false, true],
            loops: vec![
                looped(2, &[2, 3], None, 6),
                looped(1, &[1, 2, 3, 4], Some(4), 6),
            ],
        };
        graph.loops[0].total = Some(7);
        graph.loops[0].in_runs = BTreeSet::from([3]);
        let longest = graph.longest().unwrap();
        assert_eq!(longest.cost, 1 + 5 * (10 + 100 + 10_000));
        assert_eq!(longest.iterations[&2].0, 100 + 1000 + 3);
    }

    #[test]
    fn a_loop_without_an_exit_has_no_path() {
        let mut graph = nested(Some(1));
        graph.ends[3] = false;
        assert_eq!(graph.longest(), None);
    }
}
