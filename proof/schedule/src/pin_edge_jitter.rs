//! When the edges of the step pins come after the release of their task: the jitter.
//!
//! The first store to a port's set-reset register outputs the pins that the previous run has
//! computed. The jitter is the longest path to that store, from a cold cache, less the shortest.

use std::collections::BTreeSet;

use crate::{Cache, Function, Model, Region, budget::Budgets, model, wcet::Wcets};

/// Cycles of the fastest entry into an exception: chained to the end of another.
const SHORTEST_ENTRY: u64 = 6;
/// Cycles of a taken branch at best.
const SHORTEST_REFILL: u64 = 1;

/// Earliest and latest end of a store after the exception's request, cycles, without blocking.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Latency {
    /// The register.
    pub(crate) register: u32,
    pub(crate) earliest: u64,
    pub(crate) latest: u64,
}

/// The latency of the first store to each set-reset register that the function at `root` writes.
/// `None` when one cannot be bounded.
pub(crate) fn latencies(wcets: &Wcets<'_>, root: u32) -> Option<Vec<Latency>> {
    let function = wcets.functions.get(&root)?;
    let targets = function.stores.iter().filter_map(|store| store.to);
    let registers: BTreeSet<u32> = targets.filter(|to| is_set_reset(*to)).collect();
    let latencies = registers.into_iter().map(|register| {
        let stores = function.stores.iter();
        let stores = stores.filter(|store| store.to == Some(register));
        let stores: BTreeSet<u32> = stores.map(|store| store.at).collect();
        Some(Latency {
            register,
            earliest: SHORTEST_ENTRY + shortest(function, &stores)?,
            latest: wcets.model.entry() + wcets.model.miss() + longest(wcets, function, &stores)?,
        })
    });
    latencies.collect()
}

/// Whether an address is the set-reset register of a port: RM0090 table 1 and 8.4.7.
const fn is_set_reset(address: u32) -> bool {
    matches!(address, 0x4002_0000..=0x4002_2bff) && address & 0x3ff == 0x18
}

/// The index of the first of the stores in a block.
fn place(function: &Function, stores: &BTreeSet<u32>, block: usize) -> Option<usize> {
    let instructions = &function.blocks[block].instructions;
    instructions
        .iter()
        .position(|it| stores.contains(&it.address))
}

fn longest(wcets: &Wcets<'_>, function: &Function, stores: &BTreeSet<u32>) -> Option<u64> {
    let wanted = function.reach([0], |block| place(function, stores, block).is_some());
    let mut open = Budgets::new();
    let is_wanted = |block: usize| wanted.contains(&block);
    let mut graph = wcets.graph(function, Cache::Warm, &mut open, is_wanted)?;
    let touched = wcets.touched_by_blocks(function);
    let mut lines = BTreeSet::new();
    for &block in &wanted {
        graph.ends[block] = false;
        let Some(store) = place(function, stores, block) else {
            lines.extend(&touched[block]);
            continue;
        };
        let mut part = function.blocks[block].clone();
        part.instructions.truncate(store + 1);
        let cycles = part.instructions.iter().map(|at| {
            let region = function.regions.get(&at.address).copied();
            wcets.model.cycles(at, region.unwrap_or(Region::Unknown))
        });
        graph.costs[block] = cycles.sum();
        lines.extend(model::lines(&part));
        graph.edges[block].clear();
        graph.ends[block] = true;
    }
    let warm = Wcets::longest(function, &graph, 0, open)?;
    Some(warm + lines.len() as u64 * wcets.model.miss())
}

/// The fewest cycles to one of the stores: everything in the cache, nothing waits.
fn shortest(function: &Function, stores: &BTreeSet<u32>) -> Option<u64> {
    let mut cycles_to: Vec<Option<u64>> = vec![None; function.blocks.len()];
    *cycles_to.first_mut()? = Some(0);
    let mut work = BTreeSet::from([(0, 0)]);
    let mut best: Option<u64> = None;
    while let Some((cycles, block)) = work.pop_first() {
        let instructions = &function.blocks[block].instructions;
        let store = place(function, stores, block);
        let part = &instructions[..store.map_or(instructions.len(), |store| store + 1)];
        let end = cycles + part.iter().map(Model::least).sum::<u64>();
        if store.is_some() {
            best = Some(best.map_or(end, |best| best.min(end)));
            continue;
        }
        for edge in &function.blocks[block].successors {
            let new = end + if edge.is_taken { SHORTEST_REFILL } else { 0 };
            if cycles_to[edge.to].is_none_or(|old| new < old) {
                cycles_to[edge.to] = Some(new);
                work.insert((new, edge.to));
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::{testing, wcet::Functions};

    #[test]
    fn the_jitter_of_an_edge_is_the_difference_of_its_paths() {
        let shape: &[(u32, &[usize])] = &[(2, &[1, 2]), (9, &[2]), (3, &[3]), (50, &[])];
        let mut function = testing::function(shape);
        let store = function.blocks[2].instructions[1].address;
        function.stores = [(store, 0x4002_0818), (store + 2, 0x2000_0000)]
            .map(|(at, to)| testing::store(at, to, None))
            .into();
        let functions = Functions::from([(function.address, function)]);
        let model = Model::new(&testing::CLOCK);
        let named = BTreeMap::new();
        let wcets = Wcets::new(&functions, &model, &named, BTreeSet::new());
        let found = latencies(&wcets, 0x0800_0000).unwrap();
        let expected = Latency {
            register: 0x4002_0818,
            earliest: 6 + 2 + 2,
            // One line for the vector, and of the blocks 1, 2 and 1.
            latest: 12 + 2 + 9 + 2 + 5 * 5,
        };
        assert_eq!(found, [expected]);
    }
}
