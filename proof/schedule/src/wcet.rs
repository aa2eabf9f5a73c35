//! Worst-case execution times of functions, those that they call included.
//!
//! Callees first; a callee costs the same wherever it is called. Loops that are bounded over a whole
//! activation (`// wcet-total`) are kept separate until the task is known: each costs its longest iteration
//! so often, on top of the path without these iterations. Those whose total has the same name share one
//! budget: the most expensive iteration of them all counts.

use std::{
    cell::RefCell,
    collections::{BTreeMap, BTreeSet, HashMap},
    rc::Rc,
};

use crate::{
    Block, Cache, Count, Function, Instruction, Loop, Model, Region,
    budget::{ALL_CALLS, Budget, Budgets, Open, add_open, budget},
    loops::in_runs,
    memo::memoised,
    model::{self, CACHE_LINES},
    paths::{Duals, Graph, Longest, LoopPaths},
    persistence::{PersistentLoops, Share},
    walks::reachable,
};

/// Functions by their addresses.
pub type Functions = BTreeMap<u32, Function>;
/// The cost of a function.
#[derive(Debug, Clone, Default)]
pub(crate) struct Bound {
    /// Cycles of the longest path, without the iterations of `open`.
    pub(crate) path: u64,
    /// Loops bounded over the activation.
    pub(crate) open: Budgets,
    /// How often each block is executed on that path, and in the longest iteration of each open loop.
    counts: Vec<u64>,
    iterations: BTreeMap<usize, Vec<u64>>,
}

impl Bound {
    /// Cycles, for an activation in which nothing else runs the same loops.
    pub(crate) fn cycles(&self) -> u64 {
        self.path + self.open.values().map(Open::cycles).sum::<u64>()
    }
}

/// Known bounds; `None`: there is none.
type Bounds = HashMap<(u32, Cache), Option<Rc<Bound>>>;

/// Computes bounds.
pub(crate) struct Wcets<'a> {
    pub(crate) functions: &'a Functions,
    pub(crate) model: &'a Model,
    /// Values of named bounds.
    pub(crate) named: &'a BTreeMap<String, u64>,
    /// Functions that are not called.
    pub(crate) excluded: BTreeSet<u32>,
    /// Functions that are called at most so often in one activation, when the number is known.
    pub(crate) limited: BTreeMap<u32, Option<u64>>,
    /// Lines that stay in the cache together with a persistent loop: the lines of the tasks that
    /// preempt the loop.
    pub(crate) resident_lines: BTreeSet<u32>,
    /// The share by which code outside of such loops pays for these lines.
    pub(crate) share: Share,
    /// Named bounds that are evaluated with several values.
    pub(crate) varied: BTreeSet<String>,
    bounds: RefCell<Bounds>,
    loops: RefCell<HashMap<u32, Rc<PersistentLoops>>>,
    touched: RefCell<HashMap<u32, Rc<BTreeSet<u32>>>>,
}

impl<'a> Wcets<'a> {
    pub(crate) fn new(
        functions: &'a Functions,
        model: &'a Model,
        named: &'a BTreeMap<String, u64>,
        excluded: BTreeSet<u32>,
    ) -> Self {
        Self {
            functions,
            model,
            named,
            excluded,
            limited: BTreeMap::new(),
            resident_lines: BTreeSet::new(),
            share: Share::default(),
            varied: BTreeSet::new(),
            bounds: RefCell::default(),
            loops: RefCell::default(),
            touched: RefCell::default(),
        }
    }

    /// The function that a block calls, if it returns and is not excluded.
    pub(crate) fn callee(&self, block: &Block) -> Option<u32> {
        let call = block.returning_call();
        call.filter(|call| !self.excluded.contains(call))
    }

    /// The functions that a root calls, directly or not, with the root itself, but without
    /// functions that never return.
    pub(crate) fn reach(&self, root: u32) -> BTreeSet<u32> {
        let called = |at: u32| {
            let blocks = self
                .functions
                .get(&at)
                .into_iter()
                .flat_map(|it| &it.blocks);
            blocks.filter_map(|block| self.callee(block))
        };
        reachable([root], called)
    }

    /// The same functions themselves.
    pub(crate) fn reached(&self, root: u32) -> impl Iterator<Item = &'a Function> + use<'a> {
        let (reached, functions) = (self.reach(root).into_iter(), self.functions);
        reached.filter_map(|address| functions.get(&address))
    }

    /// The cost of a function with a warm cache or without one; `None`: no bound.
    pub(crate) fn bound(&self, address: u32, cache: Cache) -> Option<Rc<Bound>> {
        let cache = if cache == Cache::Cold {
            Cache::Warm
        } else {
            cache
        };
        if let Some(known) = self.bounds.borrow().get(&(address, cache)) {
            return known.clone();
        }
        // A recursive function finds no bound for itself.
        self.bounds.borrow_mut().insert((address, cache), None);
        let bound = self.compute(address, cache).map(Rc::new);
        self.bounds
            .borrow_mut()
            .insert((address, cache), bound.clone());
        bound
    }

    fn compute(&self, address: u32, cache: Cache) -> Option<Bound> {
        let function = self.functions.get(&address)?;
        let mut bound = Bound::default();
        let graph = self.graph(function, cache, &mut bound.open, |_| true)?;
        let longest = graph.longest()?;
        let persistent = self.persistent(function, cache);
        bound.path =
            longest.cost + self.edge_cost(function, persistent.as_deref(), cache, None, (0, false));
        add_iterations(&mut bound.open, function, &graph, &longest);
        let iterations = longest.iterations.into_iter();
        bound.iterations = iterations
            .map(|(head, (_, counts))| (head, counts))
            .collect();
        bound.counts = longest.counts;
        Some(bound)
    }

    /// The dual values of a function's longest path.
    pub(crate) fn duals(&self, address: u32, cache: Cache) -> Option<Duals> {
        let function = self.functions.get(&address)?;
        let graph = self.graph(function, cache, &mut Budgets::new(), |_| true)?;
        Some(graph.duals())
    }

    /// The persistent loops of a function.
    pub(crate) fn persistent_loops(&self, function: &Function) -> Rc<PersistentLoops> {
        memoised(&self.loops, function.address, || {
            Rc::new(PersistentLoops::new(self, function))
        })
    }

    fn persistent(&self, function: &Function, cache: Cache) -> Option<Rc<PersistentLoops>> {
        let has_persistent = matches!(cache, Cache::Loops | Cache::Shared);
        has_persistent.then(|| self.persistent_loops(function))
    }

    /// The cost of the edge into a block, without the block: that of its fetches.
    fn edge_cost(
        &self,
        function: &Function,
        persistent: Option<&PersistentLoops>,
        cache: Cache,
        from: Option<usize>,
        (to, is_taken): (usize, bool),
    ) -> u64 {
        let refill = if is_taken { self.model.refill() } else { 0 };
        let share = match cache {
            Cache::Warm | Cache::Cold => return refill,
            Cache::Uncached | Cache::Loops => Share::default(),
            Cache::Shared => self.share,
        };
        let next = &function.blocks[to];
        let looped = |block: usize| persistent.and_then(|it| Some((it.of_block[block]?, it)));
        let before = from.and_then(looped).map(|(one, _)| one);
        refill
            + match looped(to) {
                Some((one, _)) if before == Some(one) => 0,
                Some((one, it)) => self.model.miss() * it.lines[&one] + share.of_visit,
                None => {
                    let falls = from.filter(|from| {
                        !is_taken && before.is_none() && function.blocks[*from].call.is_none()
                    });
                    let lines = match falls {
                        Some(from) => model::new_lines(&function.blocks[from], next),
                        None => model::lines(next).count() as u64,
                    };
                    lines * (self.model.miss() + share.of_line)
                }
            }
    }

    fn fetches(&self, block: &Block) -> u64 {
        model::lines(block).count() as u64 * self.model.miss()
    }

    /// A function as a graph with costs, or the part of it with the blocks that are wanted. Gathers
    /// the open loops of what it calls.
    pub(crate) fn graph(
        &self,
        function: &Function,
        cache: Cache,
        open: &mut Budgets,
        is_wanted: impl Fn(usize) -> bool,
    ) -> Option<Graph> {
        let mut graph = Graph::default();
        let persistent = self.persistent(function, cache);
        let persistent = persistent.as_deref();
        for (index, block) in function.blocks.iter().enumerate() {
            let is_excluded = block.call.is_some_and(|call| self.excluded.contains(&call));
            let is_out = is_excluded || !is_wanted(index);
            let is_persistent = persistent.is_some_and(|it| it.of_block[index].is_some());
            let inside = if is_persistent { Cache::Warm } else { cache };
            graph.costs.push(if is_out {
                0
            } else {
                self.block(function, block, inside, open)?
            });
            graph.ends.push(block.ends && !is_out);
            let edges = block.successors.iter();
            let edges = edges.filter(|edge| !is_out && is_wanted(edge.to));
            let edges = edges.map(|edge| {
                let to = (edge.to, edge.is_taken);
                (
                    edge.to,
                    self.edge_cost(function, persistent, cache, Some(index), to),
                )
            });
            graph.edges.push(edges.collect());
        }
        let is_closed = |looped: &&Loop| {
            let mut back = looped.back.iter();
            back.any(|from| graph.edges[*from].iter().any(|edge| edge.0 == looped.head))
        };
        let mut loops: Vec<&Loop> = function.loops.iter().filter(is_closed).collect();
        loops.sort_by_key(|looped| looped.blocks.len());
        for looped in loops {
            graph.loops.push(self.loop_paths(function, looped)?);
        }
        Some(graph)
    }

    fn loop_paths(&self, function: &Function, looped: &Loop) -> Option<LoopPaths> {
        let (total, most) = match &looped.total {
            Some(total) => (Some(self.number(&total.bound.count)?), None),
            None => (None, Some(looped.most(self.named, &self.varied)?)),
        };
        let blocks = 0..function.blocks.len();
        Some(LoopPaths {
            head: looped.head,
            blocks: blocks.map(|block| looped.blocks.contains(&block)).collect(),
            most,
            total,
            in_runs: in_runs(function, looped).cloned().unwrap_or_default(),
        })
    }

    /// A bound as a number; `None` when its name is not known.
    pub(crate) fn number(&self, count: &Count) -> Option<u64> {
        count.value(self.named)
    }

    /// A block with what it calls, without its fetches.
    fn block(
        &self,
        function: &Function,
        block: &Block,
        cache: Cache,
        open: &mut Budgets,
    ) -> Option<u64> {
        let instructions = block.instructions.iter();
        let mut cycles: u64 = instructions.map(|at| self.cycles(function, at)).sum();
        let refill = self.model.refill();
        let Some(call) = self.callee(block) else {
            let is_return = block.ends && block.call.is_none();
            return Some(cycles + if is_return { refill } else { 0 });
        };
        let callee = self.bound(call, cache)?;
        for (budget, one) in &callee.open {
            add_open(open, budget.clone(), *one);
        }
        let cost = callee.path + refill;
        match self.limited.get(&call) {
            Some(most) => {
                let place = (call, ALL_CALLS);
                let times = (*most)?;
                add_open(open, Budget::Own(place), Open { times, cost, place });
            }
            None => cycles += cost,
        }
        Some(cycles)
    }

    fn cycles(&self, function: &Function, at: &Instruction) -> u64 {
        let region = function.regions.get(&at.address).copied();
        self.model.cycles(at, region.unwrap_or(Region::Unknown))
    }

    /// Lines of a function and its callees.
    pub(crate) fn lines(&self, address: u32) -> Rc<BTreeSet<u32>> {
        memoised(&self.touched, address, || {
            let blocks = self.reached(address).flat_map(|function| &function.blocks);
            Rc::new(blocks.flat_map(model::lines).collect())
        })
    }

    /// The cost of a task's function from a cold cache, if the cache holds all of it: each line is
    /// missed once.
    pub(crate) fn cold(&self, address: u32) -> Option<u64> {
        let lines = self.lines(address).len();
        if lines > CACHE_LINES || self.model.prefetch {
            return None;
        }
        let warm = self.bound(address, Cache::Warm)?.cycles();
        Some(warm + lines as u64 * self.model.miss())
    }

    /// Cycles of the longest path through a graph from a block, with the iterations of all loops
    /// that are bounded over a whole activation: the graph's own and its callees', in `open`.
    pub(crate) fn longest(
        function: &Function,
        graph: &Graph,
        source: usize,
        mut open: Budgets,
    ) -> Option<u64> {
        let longest = graph.longest_from(source)?;
        add_iterations(&mut open, function, graph, &longest);
        Some(longest.cost + open.values().map(Open::cycles).sum::<u64>())
    }

    /// Lines of each block and its callees.
    pub(crate) fn touched_by_blocks(&self, function: &Function) -> Vec<BTreeSet<u32>> {
        let blocks = function.blocks.iter().map(|block| {
            let mut lines: BTreeSet<u32> = model::lines(block).collect();
            if let Some(call) = self.callee(block) {
                lines.extend(self.lines(call).iter());
            }
            lines
        });
        blocks.collect()
    }

    /// How often each block of each function is executed on the worst path of a root.
    pub(crate) fn block_counts(&self, root: u32, cache: Cache) -> BTreeMap<(u32, usize), u64> {
        let mut block_counts = BTreeMap::new();
        let Some(bound) = self.bound(root, cache) else {
            return block_counts;
        };
        self.count(root, cache, 1, None, &mut block_counts);
        for one in bound.open.values() {
            let (address, head) = one.place;
            let iteration_of = Some(head).filter(|head| *head != ALL_CALLS);
            self.count(address, cache, one.times, iteration_of, &mut block_counts);
        }
        block_counts
    }

    /// Counts a path of a function so many times: the longest, or the longest iteration of a loop.
    fn count(
        &self,
        address: u32,
        cache: Cache,
        times: u64,
        iteration_of: Option<usize>,
        block_counts: &mut BTreeMap<(u32, usize), u64>,
    ) {
        let Some(bound) = self.bound(address, cache) else {
            return;
        };
        let counts = match iteration_of {
            None => Some(&bound.counts),
            Some(head) => bound.iterations.get(&head),
        };
        let counts = counts.into_iter().flatten().enumerate();
        for (block, count) in counts.filter(|(_, count)| **count > 0) {
            *block_counts.entry((address, block)).or_default() += times * count;
            let function = self.functions.get(&address);
            let block = function.and_then(|function| function.blocks.get(block));
            let call = block.and_then(|block| self.callee(block));
            if let Some(call) = call.filter(|call| !self.limited.contains_key(call)) {
                self.count(call, cache, times * count, None, block_counts);
            }
        }
    }

    /// Cycles of each instruction of a block, those of its fetches on the first.
    pub(crate) fn costs(
        &self,
        function: &'a Function,
        block: usize,
        cache: Cache,
    ) -> Vec<(u32, u64)> {
        let Some(block) = function.blocks.get(block) else {
            return Vec::new();
        };
        let instructions = block.instructions.iter();
        let costs = instructions.map(|at| (at.address, self.cycles(function, at)));
        let mut costs: Vec<_> = costs.collect();
        let is_taken = block.ends || block.call.is_some();
        if let (Some(last), true) = (costs.last_mut(), is_taken) {
            last.1 += self.model.refill();
        }
        if let (Some(first), Cache::Uncached) = (costs.first_mut(), cache) {
            first.1 += self.fetches(block);
        }
        costs
    }
}

/// Adds the loops of a graph that are bounded over the activation.
fn add_iterations(open: &mut Budgets, function: &Function, graph: &Graph, longest: &Longest) {
    for (head, (cost, _)) in &longest.iterations {
        let found = graph.loops.iter().find(|it| it.head == *head);
        let one = Open {
            times: found.and_then(|it| it.total).unwrap_or(0),
            cost: *cost,
            place: (function.address, *head),
        };
        add_open(open, budget(function, *head), one);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Edge, Total,
        testing::{self, CLOCK},
    };

    fn bound(functions: &Functions, named: &[(&str, u64)], excluded: &[u32]) -> Option<u64> {
        let model = Model::new(&CLOCK);
        let named = named
            .iter()
            .map(|(name, value)| ((*name).to_owned(), *value));
        let named = named.collect();
        let excluded = excluded.iter().copied().collect();
        let wcets = Wcets::new(functions, &model, &named, excluded);
        wcets
            .bound(0x0800_0000, Cache::Warm)
            .map(|bound| bound.cycles())
    }

    /// `f` calls `g` in a loop of ten iterations; `g` has a loop of its own.
    fn caller(total: Option<Count>) -> Functions {
        let mut outer = testing::function(&[(4, &[1]), (2, &[1, 2]), (3, &[])]);
        outer.loops = vec![testing::counted(1, &[1], &[1], 10)];
        outer.blocks[1].call = Some(0x0900_0000);
        let mut inner = testing::function(&[(5, &[1]), (7, &[1, 2]), (1, &[])]);
        inner.blocks[1].successors[0].is_taken = true;
        inner.loops = vec![testing::counted(1, &[1], &[1], 3)];
        if let Some(count) = total {
            inner.loops[0].total = Some(Total {
                bound: testing::bound(count),
                per: None,
                in_runs: BTreeSet::from([1]),
            });
        }
        inner.address = 0x0900_0000;
        Functions::from([(outer.address, outer), (inner.address, inner)])
    }

    #[test]
    fn a_callee_costs_what_it_costs_at_each_call() {
        // Returns and calls refill the pipeline, as a taken branch does.
        let callee = 5 + 7 + 3 * (7 + 3) + 1 + 3;
        let expected = 4 + 11 * (2 + 3 + callee) + 3 + 3;
        assert_eq!(bound(&caller(None), &[], &[]), Some(expected));
    }

    #[test]
    fn a_total_counts_once_for_all_calls() {
        let callee = 5 + 1 + 3;
        let expected = 4 + 11 * (2 + 3 + callee) + 3 + 3 + 20 * (7 + 3);
        let functions = caller(Some(Count::Named("pulses".to_owned())));
        assert_eq!(bound(&functions, &[("pulses", 20)], &[]), Some(expected));
        assert_eq!(bound(&functions, &[], &[]), None);
    }

    #[test]
    fn loops_that_name_a_total_share_it() {
        let mut functions = caller(Some(Count::Named("pulses".to_owned())));
        // An iteration of the callee costs 7 + 3.
        let total = functions[&0x0900_0000].loops[0].total.clone();
        functions.get_mut(&0x0800_0000).unwrap().loops[0].total = total;
        let callee = 5 + 1 + 3;
        let expected = 4 + 3 + 3 + 20 * (2 + 3 + callee);
        assert_eq!(bound(&functions, &[("pulses", 20)], &[]), Some(expected));
    }

    #[test]
    fn an_excluded_function_is_never_called() {
        let mut functions = caller(None);
        let outer = functions.get_mut(&0x0800_0000).unwrap();
        let edge = Edge {
            to: 2,
            is_taken: false,
        };
        outer.blocks[0].successors.push(edge);
        assert_eq!(bound(&functions, &[], &[0x0900_0000]), Some(4 + 3 + 3));
    }

    #[test]
    fn recursion_and_unknown_loops_have_no_bound() {
        let mut functions = caller(None);
        let inner = functions.get_mut(&0x0900_0000).unwrap();
        inner.loops[0].bound = None;
        assert_eq!(bound(&functions, &[], &[]), None);
        let mut functions = caller(None);
        let inner = functions.get_mut(&0x0900_0000).unwrap();
        inner.blocks[0].call = Some(0x0800_0000);
        assert_eq!(bound(&functions, &[], &[]), None);
    }

    #[test]
    fn without_a_cache_each_block_is_fetched_each_time() {
        let functions = caller(None);
        let model = Model::new(&CLOCK);
        let named = BTreeMap::new();
        let wcets = Wcets::new(&functions, &model, &named, BTreeSet::new());
        let warm = wcets.bound(0x0900_0000, Cache::Warm).unwrap().cycles();
        let uncached = wcets.bound(0x0900_0000, Cache::Uncached).unwrap().cycles();
        // Blocks of 10, 14 and 2 bytes, with 12 bytes fetched ahead: two, two and one line.
        assert_eq!(uncached, warm + 5 * (2 + 4 * 2 + 1));
        let block_counts = wcets.block_counts(0x0800_0000, Cache::Warm);
        assert_eq!(block_counts[&(0x0900_0000, 1)], 44);
    }
}
