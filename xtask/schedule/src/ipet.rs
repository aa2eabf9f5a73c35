//! The longest path as a linear program (implicit path enumeration, Li and Malik 1995).
//!
//! What enters a block leaves it; back edges are taken as often as the loop's bound allows for each
//! entry; a line of the cache is missed once, if a block that touches it is executed. The relaxation
//! of the integer program is never below it, so the bound is safe.

use std::collections::{BTreeMap, BTreeSet};

use microlp::{ComparisonOp, OptimizationDirection, Problem, Variable};

use crate::paths::Graph;

/// What the solver may be off: it disturbs the program a little, against cycling. The longest path
/// is a whole number and not above the solution, so rounding up behind this is safe.
const SLACK: f64 = 0.01;

/// What is looked for in a graph.
pub(crate) struct Search<'a> {
    pub(crate) graph: &'a Graph,
    /// Where the path begins.
    pub(crate) source: usize,
    /// Lines that each block touches, and what the first touch of one costs.
    pub(crate) touched: &'a [BTreeSet<u32>],
    pub(crate) miss: u64,
}

/// The longest path.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Solution {
    pub(crate) cost: u64,
    /// How often each block is on it.
    pub(crate) counts: Vec<f64>,
}

/// Terms of a sum, each variable once: the solver takes no other.
type Terms = BTreeMap<usize, (Variable, f64)>;

fn add(terms: &mut Terms, variable: Variable, factor: f64) {
    terms.entry(variable.idx()).or_insert((variable, 0.0)).1 += factor;
}

fn constrain(problem: &mut Problem, terms: Terms, op: ComparisonOp, right: f64) {
    let terms: Vec<_> = terms.into_values().filter(|term| term.1 != 0.0).collect();
    if !terms.is_empty() {
        problem.add_constraint(terms, op, right);
    }
}

/// An edge as a variable: from, to, how often.
type Flow = (usize, usize, Variable);

impl Search<'_> {
    /// The longest path; `None` when no end can be reached, or it has no bound.
    pub(crate) fn solve(&self) -> Option<Solution> {
        let mut problem = Problem::new(OptimizationDirection::Maximize);
        let size = self.graph.costs.len();
        let reached = self.reached();
        let begin = problem.add_var(self.graph.costs[self.source] as f64, (1.0, 1.0));
        let mut into: Vec<Terms> = vec![Terms::new(); size];
        let mut out: Vec<Terms> = vec![Terms::new(); size];
        add(&mut into[self.source], begin, 1.0);
        let mut flows: Vec<Flow> = Vec::new();
        for &block in &reached {
            if self.graph.ends[block] {
                let end = problem.add_var(0.0, (0.0, 1.0));
                add(&mut out[block], end, 1.0);
            }
            for &(to, cost) in &self.graph.edges[block] {
                let cost = (cost + self.graph.costs[to]) as f64;
                let flow = problem.add_var(cost, (0.0, f64::INFINITY));
                add(&mut into[to], flow, 1.0);
                add(&mut out[block], flow, 1.0);
                flows.push((block, to, flow));
            }
        }
        for &block in &reached {
            let mut balance = into[block].clone();
            for (variable, factor) in out[block].values() {
                add(&mut balance, *variable, -factor);
            }
            constrain(&mut problem, balance, ComparisonOp::Eq, 0.0);
        }
        self.bound_loops(&mut problem, &flows, begin, &into);
        self.miss_lines(&mut problem, &reached, &into);
        let solution = problem.solve().ok()?.into_solution().ok()?;
        let count = |terms: &Terms| {
            let counts = terms
                .values()
                .map(|(variable, _)| solution.var_value(*variable));
            counts.sum()
        };
        Some(Solution {
            cost: (solution.objective() - SLACK).ceil().max(0.0) as u64,
            counts: into.iter().map(count).collect(),
        })
    }

    fn reached(&self) -> BTreeSet<usize> {
        let mut reached = BTreeSet::from([self.source]);
        let mut work = vec![self.source];
        while let Some(block) = work.pop() {
            let new = self.graph.edges[block].iter().map(|edge| edge.0);
            work.extend(new.filter(|to| reached.insert(*to)));
        }
        reached
    }

    fn bound_loops(&self, problem: &mut Problem, flows: &[Flow], begin: Variable, into: &[Terms]) {
        for rounds in &self.graph.rounds {
            let mut terms = Terms::new();
            for &(from, to, flow) in flows.iter().filter(|flow| flow.1 == rounds.head) {
                debug_assert_eq!(to, rounds.head);
                if rounds.blocks[from] {
                    add(&mut terms, flow, 1.0);
                } else if let Some(most) = rounds.most {
                    add(&mut terms, flow, -(most as f64));
                }
            }
            if let Some(most) = rounds.most.filter(|_| rounds.blocks[self.source]) {
                add(&mut terms, begin, -(most as f64));
            }
            let right = rounds.total.filter(|_| rounds.most.is_none());
            let right = right.unwrap_or(0) as f64;
            constrain(problem, terms, ComparisonOp::Le, right);
            for block in &rounds.in_runs {
                constrain(problem, into[*block].clone(), ComparisonOp::Le, right);
            }
        }
    }

    fn miss_lines(&self, problem: &mut Problem, reached: &BTreeSet<usize>, into: &[Terms]) {
        let mut users: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for &block in reached {
            for &line in self.touched.get(block).into_iter().flatten() {
                users.entry(line).or_default().push(block);
            }
        }
        for blocks in users.values() {
            let missed = problem.add_var(self.miss as f64, (0.0, 1.0));
            let mut terms = Terms::new();
            add(&mut terms, missed, 1.0);
            for (variable, factor) in blocks.iter().flat_map(|block| into[*block].values()) {
                add(&mut terms, *variable, -factor);
            }
            constrain(problem, terms, ComparisonOp::Le, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::Rounds;
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

        /// Adds code behind a block; the block where it ends.
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
                    let rounds = (0..1000).map(|block| blocks.contains(&block));
                    self.rounds.push(Rounds {
                        head,
                        blocks: rounds.collect(),
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

        /// Every path, one after another: the greatest cost, with a miss for each new line.
        fn enumerate(
            &self,
            block: usize,
            left: &BTreeMap<usize, u64>,
            cost: u64,
            lines: &BTreeSet<u32>,
            search: &Search<'_>,
        ) -> u64 {
            let cost = cost + self.costs[block];
            let touched = search.touched.get(block).into_iter().flatten();
            let lines: BTreeSet<u32> = touched.chain(lines).copied().collect();
            let mut worst = if self.ends[block] {
                cost + search.miss * lines.len() as u64
            } else {
                0
            };
            for (to, way) in &self.edges[block] {
                let mut left = left.clone();
                if let Some(rounds) = self.rounds.iter().find(|rounds| rounds.head == *to) {
                    let most = rounds.most.unwrap();
                    let left = left.entry(*to).or_insert(most);
                    if !rounds.blocks[block] {
                        *left = most;
                    } else if *left == 0 {
                        continue;
                    } else {
                        *left -= 1;
                    }
                }
                worst = worst.max(self.enumerate(*to, &left, cost + way, &lines, search));
            }
            worst
        }

        /// Few enough paths to go along each.
        fn is_small(&self) -> bool {
            self.rounds.len() <= 3 && self.costs.len() <= 16
        }
    }

    proptest! {
        #[test]
        fn the_longest_path_is_that_of_enumeration(code in code()) {
            let graph = Graph::of(&code);
            prop_assume!(graph.is_small());
            let search = Search { graph: &graph, source: 0, touched: &[], miss: 0 };
            let enumerated = graph.enumerate(0, &BTreeMap::new(), 0, &BTreeSet::new(), &search);
            let solution = search.solve().unwrap();
            prop_assert_eq!(solution.cost, enumerated);
            let longest = graph.longest().unwrap();
            prop_assert_eq!(longest.cost, enumerated);
            let cost: u64 = longest.counts.iter().zip(&graph.costs).map(|(n, cost)| n * cost).sum();
            prop_assert!(cost <= enumerated);
        }

        #[test]
        fn a_cold_cache_is_never_underestimated(code in code(), shift in 0_usize..3) {
            let graph = Graph::of(&code);
            prop_assume!(graph.is_small());
            let lines = |block: usize| (block >> shift) as u32;
            let touched: Vec<_> = (0..graph.costs.len())
                .map(|block| BTreeSet::from([lines(block), lines(block + 1)]))
                .collect();
            let search = Search { graph: &graph, source: 0, touched: &touched, miss: 5 };
            let enumerated = graph.enumerate(0, &BTreeMap::new(), 0, &BTreeSet::new(), &search);
            let all: BTreeSet<u32> = touched.iter().flatten().copied().collect();
            let solution = search.solve().unwrap();
            prop_assert!(solution.cost >= enumerated);
            prop_assert!(solution.cost <= graph.longest().unwrap().cost + 5 * all.len() as u64);
        }
    }

    #[test]
    fn a_total_counts_over_all_entries() {
        // 0 -> 1 -> 2 -> 2, 2 -> 1, 1 -> 3; the inner loop runs ten times in all.
        let mut graph = Graph {
            costs: vec![0, 0, 100, 0],
            edges: vec![
                vec![(1, 0)],
                vec![(2, 0), (3, 0)],
                vec![(2, 0), (1, 0)],
                vec![],
            ],
            ends: vec![false, false, false, true],
            rounds: Vec::new(),
        };
        let is_in = |blocks: [usize; 2]| (0..4).map(|block| blocks.contains(&block)).collect();
        graph.rounds = vec![
            Rounds {
                head: 2,
                blocks: is_in([2, 2]),
                most: None,
                total: Some(10),
                in_runs: BTreeSet::new(),
            },
            Rounds {
                head: 1,
                blocks: is_in([1, 2]),
                most: Some(5),
                total: None,
                in_runs: BTreeSet::new(),
            },
        ];
        let search = Search {
            graph: &graph,
            source: 0,
            touched: &[],
            miss: 0,
        };
        assert_eq!(search.solve().unwrap().cost, 5 * 100 + 10 * 100);
        graph.rounds[0].in_runs = BTreeSet::from([2]);
        let search = Search {
            graph: &graph,
            source: 0,
            touched: &[],
            miss: 0,
        };
        assert_eq!(search.solve().unwrap().cost, 10 * 100);
    }
}
