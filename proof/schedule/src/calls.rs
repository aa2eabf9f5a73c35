//! Values across calls: what functions are called with, and what they return.
//!
//! A function that others call is entered with what all of them have in common. One that a vector
//! or a pointer leads to may be entered with anything.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Block, Image, Operation, Region,
    graph::Graph,
    value_analysis::{self, FunctionSummary, States},
    values::{Callees, State, Surroundings, Value},
};

/// The results of the value analysis of every function.
pub(crate) struct Calls {
    callees: Callees,
    summary: BTreeMap<u32, FunctionSummary>,
    states: BTreeMap<u32, States>,
}

impl Calls {
    /// Follows the values through all functions.
    pub(crate) fn new(image: &Image, graphs: &BTreeMap<u32, Graph>) -> Self {
        let mut calls = Self {
            callees: Callees::default(),
            summary: BTreeMap::new(),
            states: BTreeMap::new(),
        };
        let free = free(image, graphs);
        let order = Order::new(graphs);
        for &address in order.callers_first.iter().rev() {
            calls.learn(image, address, &graphs[&address].blocks);
        }
        // Solve for the contents of statics, then again with these contents.
        calls.follow(image, graphs, &free, &order);
        calls.callees.statics = calls.statics(image, graphs);
        calls.follow(image, graphs, &free, &order);
        calls
    }

    /// Follows the values through all functions, with what is known of them so far.
    fn follow(
        &mut self,
        image: &Image,
        graphs: &BTreeMap<u32, Graph>,
        free: &BTreeSet<u32>,
        order: &Order,
    ) {
        let mut entries: BTreeMap<u32, State> = BTreeMap::new();
        for &address in &order.callers_first {
            let blocks = &graphs[&address].blocks;
            let is_known = !free.contains(&address) && !order.cyclic.contains(&address);
            let entry = entries.remove(&address).filter(|_| is_known);
            let around = self.around(image, address);
            let states =
                value_analysis::solve(around, blocks, entry.unwrap_or_else(State::at_entry));
            for (callee, state) in called(around, blocks, &states) {
                let joined = match entries.get(&callee) {
                    Some(known) => known.join(&state),
                    None => state,
                };
                entries.insert(callee, joined);
            }
            self.states.insert(address, states);
        }
    }

    /// Words of RAM to which only pointers into one region are ever stored by their address.
    fn statics(&self, image: &Image, graphs: &BTreeMap<u32, Graph>) -> BTreeMap<u32, Region> {
        let mut words: BTreeMap<u32, Value> = BTreeMap::new();
        let mut add = |word: u32, value: Value| {
            let initial = image.word(word).map_or(value, Value::Constant);
            let known = words.entry(word).or_insert(initial);
            *known = known.join(value);
        };
        for (&address, graph) in graphs {
            let around = self.around(image, address);
            let Some(states) = self.states(address) else {
                continue;
            };
            value_analysis::visit(around, &graph.blocks, states, |state, instruction| {
                for (word, value) in state.stored(instruction.operation) {
                    add(word, value);
                }
            });
        }
        let regions = words
            .into_iter()
            .map(|(word, value)| (word, value.region()));
        regions
            .filter(|&(_, region)| region != Region::Unknown)
            .collect()
    }

    /// Learns what a function does whatever it is called with. What it calls comes first.
    fn learn(&mut self, image: &Image, address: u32, blocks: &[Block]) {
        let nothing = Surroundings {
            image,
            callees: None,
            lowest_pointer: i32::MIN,
        };
        let states = value_analysis::solve(nothing, blocks, State::at_entry());
        let lowest_pointer = FunctionSummary::of(nothing, blocks, &states).lowest_pointer;
        let around = Surroundings {
            image,
            callees: Some(&self.callees),
            lowest_pointer,
        };
        let states = value_analysis::solve(around, blocks, State::at_entry());
        let summary = FunctionSummary::of(around, blocks, &states);
        if summary.writes_arguments {
            self.callees.write_arguments.insert(address);
        }
        if summary.result != Region::Unknown {
            self.callees.results.insert(address, summary.result);
        }
        self.callees.writes.insert(address, summary.writes.clone());
        self.summary.insert(address, summary);
    }

    /// The surroundings of the function at `address`.
    pub(crate) fn around<'a>(&'a self, image: &'a Image, address: u32) -> Surroundings<'a> {
        let summary = self.summary.get(&address);
        Surroundings {
            image,
            callees: Some(&self.callees),
            lowest_pointer: summary.map_or(i32::MIN, |summary| summary.lowest_pointer),
        }
    }

    /// The states of the function at `address`.
    pub(crate) fn states(&self, address: u32) -> Option<&States> {
        self.states.get(&address)
    }
}

/// The functions that a block calls, with the states in which they are entered.
fn called(around: Surroundings<'_>, blocks: &[Block], before: &States) -> Vec<(u32, State)> {
    let mut found = Vec::new();
    for (block, state) in blocks.iter().zip(before) {
        let (Some(callee), Some(state), Some((last, others))) =
            (block.call, state, block.instructions.split_last())
        else {
            continue;
        };
        let mut state = state.clone();
        for instruction in others {
            state.step(around, instruction);
        }
        found.push((callee, state.before(last).called()));
    }
    found
}

/// Functions whose arguments are unknown: handlers, and targets of pointers.
fn free(image: &Image, graphs: &BTreeMap<u32, Graph>) -> BTreeSet<u32> {
    let mut found: BTreeSet<u32> = image
        .words()
        .filter(|word| word & 1 == 1)
        .map(|word| word & !1)
        .collect();
    for graph in graphs.values() {
        let mut halves = BTreeMap::new();
        let instructions = graph.blocks.iter().flat_map(|block| &block.instructions);
        for instruction in instructions {
            match instruction.operation {
                Operation::Constant { to, value } => {
                    halves.insert(to, value);
                    found.insert(value & !1);
                }
                Operation::ConstantTop { to, value } => {
                    // The halves may be far apart: any lower half seen for this register.
                    let low = halves.get(&to).copied().unwrap_or_default();
                    found.insert((low & 0xffff | u32::from(value) << 16) & !1);
                }
                _ => {}
            }
        }
    }
    found.retain(|address| graphs.contains_key(address));
    found
}

/// The order in which functions are followed.
struct Order {
    /// Each after all that call it.
    callers_first: Vec<u32>,
    /// Functions that a later function of the order calls.
    cyclic: BTreeSet<u32>,
}

impl Order {
    fn new(graphs: &BTreeMap<u32, Graph>) -> Self {
        let mut order = Self {
            callers_first: Vec::new(),
            cyclic: BTreeSet::new(),
        };
        let mut open = BTreeSet::new();
        let mut done = BTreeSet::new();
        for &address in graphs.keys() {
            order.visit(graphs, address, &mut open, &mut done);
        }
        order.callers_first.reverse();
        order
    }

    fn visit(
        &mut self,
        graphs: &BTreeMap<u32, Graph>,
        address: u32,
        open: &mut BTreeSet<u32>,
        done: &mut BTreeSet<u32>,
    ) {
        if open.contains(&address) {
            self.cyclic.insert(address);
            return;
        }
        let Some(graph) = graphs.get(&address).filter(|_| done.insert(address)) else {
            return;
        };
        open.insert(address);
        for callee in graph.blocks.iter().filter_map(|block| block.call) {
            self.visit(graphs, callee, open, done);
        }
        open.remove(&address);
        self.callers_first.push(address);
    }
}
