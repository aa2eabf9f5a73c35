//! Functions from their graphs: loops, accesses, and flaws.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Flaw, Function, Image, Instruction, Operation, Rule, Store,
    graph::Graph,
    loops, restored_masks,
    value_analysis::{self, States},
    values::{State, Surroundings},
};

/// The remedy for a panic.
pub(crate) const PANIC_REMEDY: &str = "Write it so that the compiler sees that it cannot happen: \
    `get`, a mask, `wrapping_*` or an iterator instead of an index, `unwrap` or a division.";

/// The functions that never return because they panic.
pub(crate) fn panics(image: &Image, graphs: &BTreeMap<u32, Graph>) -> BTreeSet<u32> {
    let named = |address: u32| {
        let name = image.name(address);
        name.contains("panicking") || name.contains("rust_begin_unwind")
    };
    let mut found: BTreeSet<u32> = BTreeSet::new();
    loop {
        let before = found.len();
        for (&address, graph) in graphs {
            let mut calls = graph.blocks.iter().filter_map(|block| block.call);
            if !graph.returns && (named(address) || calls.any(|to| found.contains(&to))) {
                found.insert(address);
            }
        }
        if found.len() == before {
            return found;
        }
    }
}

/// A function with its loops, and the flaws of its flow.
pub(crate) fn build(image: &Image, address: u32, graph: Graph, panics: &BTreeSet<u32>) -> Function {
    let Graph {
        blocks,
        mut flaws,
        returns,
    } = graph;
    let loops = loops::find(&blocks);
    let mut add = |rule, at, what: &str, remedy: &str| {
        flaws.push(Flaw::new(rule, what, image.place(at), remedy));
    };
    for block in &blocks {
        if let (Some(call), Some(last)) = (block.call, block.instructions.last())
            && panics.contains(&call)
            && !panics.contains(&address)
        {
            let what = "a panic can be reached";
            add(Rule::ReachablePanic, last.address, what, PANIC_REMEDY);
        }
    }
    for &head in &loops.irreducible {
        let what = "a loop is entered at two places";
        let remedy = "Write it as one `for` or `while` loop.";
        add(Rule::IrreducibleLoop, blocks[head].start(), what, remedy);
    }
    Function {
        address,
        name: image.name(address),
        blocks,
        loops: loops.natural,
        flaws,
        returns,
        ..Function::default()
    }
}

/// Writes what is known of the accesses into `function`.
pub(crate) fn describe(around: Surroundings<'_>, function: &mut Function, states: &States) {
    let Function {
        blocks,
        regions,
        addresses,
        specials,
        saved,
        stores,
        ..
    } = function;
    *saved = restored_masks::find(around, blocks, states);
    value_analysis::visit(around, blocks, states, |state, instruction| {
        let at = instruction.address;
        if let Some((address, _)) = instruction.operation.access() {
            let value = state.address(address);
            regions.insert(at, value.region());
            addresses.extend(value.constant().map(|address| (at, address)));
        }
        stores.extend(store(state, instruction));
        if let Operation::WriteSpecial { from, .. } = instruction.operation {
            specials.extend(state.get(from).constant().map(|value| (at, value)));
        }
    });
}

/// Returns the store of an instruction, if it is one.
fn store(state: &State, instruction: &Instruction) -> Option<Store> {
    let (address, bytes) = instruction.operation.stored()?;
    let value = match instruction.operation {
        Operation::Store {
            source: Some(source),
            words: 1,
            ..
        } => state.get(source).constant(),
        _ => None,
    };
    let to = state.address(address);
    Some(Store {
        at: instruction.address,
        to: to.constant(),
        region: to.region(),
        bytes: bytes.cast_unsigned(),
        value,
    })
}
