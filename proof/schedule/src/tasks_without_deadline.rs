//! Uncounted loops of tasks without a deadline, and the execution time of these tasks besides.
//!
//! `idle` feeds the watchdog when all of them have come to their end. So each of their loops has to
//! end. A loop without a count that does not feed the watchdog must be named in `schedule.toml`,
//! with the reason why it ends; any other such loop is an error. All else that these tasks do has a
//! bound, which is a figure of the report: each way of a run, without the rounds of the loops that
//! are named.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Bound, Cache, Count, Flaw, Function, Loop, Place, Report, Rule, TasksWithoutDeadline, Total,
    UncountedLoops,
    bounds::source_function,
    config::{Watchdog, is_named},
    findings,
    loops::DepthFirst,
    stack::{self, pointer},
    startup,
    system::{System, misconfigured},
    walks::reachable,
    wcet::{Functions, Wcets},
};

/// Reports the loops of the tasks without a deadline, the execution time besides, and flaws.
pub(crate) fn report_loops(
    system: &System<'_>,
    named: &BTreeMap<String, u64>,
    report: &mut Report,
) {
    let rows = system.rows.iter().filter(|row| row.times.is_none());
    let rows: Vec<_> = rows.collect();
    let Some(watchdog) = system.config.watchdog.as_ref().filter(|_| !rows.is_empty()) else {
        return;
    };
    let pointers = findings::pointers(system);
    let excluded_by_watchdog = excluded_functions(system, watchdog);
    let mut reached = BTreeSet::new();
    for row in &rows {
        let left_out = row.excluded.union(&excluded_by_watchdog).copied().collect();
        reached.extend(reach(system, row.root, &left_out, &pointers));
    }
    let mut found = TasksWithoutDeadline {
        tasks: rows.iter().map(|row| row.name.clone()).collect(),
        uncounted: (watchdog.uncounted.iter())
            .map(|entry| UncountedLoops {
                reason: entry.reason.clone(),
                places: Vec::new(),
            })
            .collect(),
        ..TasksWithoutDeadline::default()
    };
    let mut flaws = of_entries(watchdog);
    for function in system.program.functions_at(&reached) {
        for (place, within) in uncounted(system, watchdog, function, &mut found) {
            match entry(watchdog, &within) {
                Some(index) => {
                    let first = place.frames.first().map_or("", String::as_str);
                    found.uncounted[index]
                        .places
                        .push(format!("{within}: {first}"));
                }
                None => flaws.push(unnamed(&within, place)),
            }
        }
    }
    let roots: BTreeSet<u32> = rows.iter().map(|row| row.root).collect();
    let excluded = rows.iter().flat_map(|row| &row.excluded).copied().collect();
    let mut functions = system.program.functions().clone();
    for function in functions.values_mut() {
        strip(function, &excluded_by_watchdog);
    }
    found.rest_cycles = bounded_cycles(system, functions, &roots, named, &excluded, &pointers);
    if found.rest_cycles.is_none() {
        let what = "how long tasks without a deadline take besides their loops is not known";
        let remedy = "Let no function call itself; say in `schedule.toml` what pointers call.";
        flaws.push(Flaw::new(
            Rule::UnboundedLoop,
            what,
            rows[0].task.place(),
            remedy,
        ));
    }
    report.undeadlined = Some(found);
    report.flaws.extend(flaws);
}

/// The functions that `schedule.toml` excludes from this analysis.
fn excluded_functions(system: &System<'_>, watchdog: &Watchdog) -> BTreeSet<u32> {
    let is_excluded = |name: &str| {
        watchdog
            .excluded
            .iter()
            .any(|it| is_named(name, &it.function))
    };
    let functions = system.program.functions().values();
    let excluded_by_watchdog = functions.filter(|function| is_excluded(&function.name));
    excluded_by_watchdog
        .map(|function| function.address)
        .collect()
}

/// The functions that a root calls, also through pointers, without panics and excluded functions.
fn reach(
    system: &System<'_>,
    root: u32,
    excluded: &BTreeSet<u32>,
    pointers: &BTreeMap<u32, BTreeSet<u32>>,
) -> BTreeSet<u32> {
    let program = system.program;
    let is_followed = |at: &u32| {
        let is_over = program.is_panic(*at) || excluded.contains(at);
        !is_over && program.function(*at).is_some()
    };
    let called = |at: u32| {
        let blocks = program.function(at).into_iter().flat_map(|it| &it.blocks);
        let calls = blocks.filter_map(|block| block.call);
        let pointed = pointers.get(&at).into_iter().flatten().copied();
        calls.chain(pointed).filter(is_followed)
    };
    reachable(Some(root).filter(is_followed), called)
}

/// The loops of a function that nothing counts and that do not feed the watchdog: where each is, and in which
/// function of the source. Counts the others.
fn uncounted(
    system: &System<'_>,
    watchdog: &Watchdog,
    function: &Function,
    found: &mut TasksWithoutDeadline,
) -> Vec<(Place, String)> {
    let image = system.image;
    let mut uncounted = Vec::new();
    for looped in &function.loops {
        if looped.bound.is_some() || looped.total.is_some() {
            found.counted += 1;
        } else if startup::feeds(function, looped, watchdog) {
            found.fed += 1;
        } else {
            let place = image.place(function.blocks[looped.head].start());
            uncounted.push((place, looped.within.clone()));
        }
    }
    // A loop with two entries is no loop of the graph.
    let flaws = function
        .flaws
        .iter()
        .filter(|flaw| flaw.rule == Rule::IrreducibleLoop);
    uncounted.extend(flaws.map(|flaw| {
        let frames = image.frames(flaw.place.address);
        let within = source_function(frames.iter()).unwrap_or_else(|| function.name.clone());
        (flaw.place.clone(), within)
    }));
    uncounted
}

/// The entry of `schedule.toml` that names a function.
fn entry(watchdog: &Watchdog, within: &str) -> Option<usize> {
    let names = |functions: &[String]| functions.iter().any(|name| is_named(within, name));
    let mut entries = watchdog.uncounted.iter();
    entries.position(|entry| names(&entry.functions))
}

fn unnamed(within: &str, place: Place) -> Flaw {
    let what = format!(
        "nothing counts a loop in `{within}`, and it may keep `idle` from feeding the watchdog"
    );
    let remedy = "Give it a constant number of runs; or write `// wcet-bound: N`; or say in `[[watchdog.uncounted]]` of \
         `schedule.toml` what ends it.";
    Flaw::new(Rule::UncountedLoop, what, place, remedy)
}

/// The flaws of the entries themselves.
fn of_entries(watchdog: &Watchdog) -> Vec<Flaw> {
    let mut flaws = Vec::new();
    let mut seen = BTreeSet::new();
    for entry in &watchdog.uncounted {
        if entry.reason.trim().is_empty() {
            let what = format!(
                "`schedule.toml` does not say what ends loops in `{}`",
                entry.functions.join("`, `")
            );
            flaws.push(misconfigured(what, "Give it a reason."));
        }
        for name in entry.functions.iter().filter(|name| !seen.insert(*name)) {
            let what = format!("`schedule.toml` says twice what ends loops in `{name}`");
            flaws.push(misconfigured(what, "Say it once."));
        }
    }
    flaws
}

/// How long a run from each of these roots takes, one after the other, in functions from which everything else has
/// been cut; `None`: it is not known.
fn bounded_cycles(
    system: &System<'_>,
    mut functions: Functions,
    roots: &BTreeSet<u32>,
    named: &BTreeMap<String, u64>,
    excluded: &BTreeSet<u32>,
    pointers: &BTreeMap<u32, BTreeSet<u32>>,
) -> Option<u64> {
    let frame = system.model.entry_and_exit() + system.model.lazy_save() + system.model.miss();
    // A pointer is taken to call the costliest function, which may call through pointers itself.
    loop {
        let wcets = Wcets::new(&functions, &system.model, named, excluded.clone());
        let costliest = costliest(&wcets, pointers);
        let cycles = roots
            .iter()
            .map(|root| Some(wcets.bound(*root, Cache::Uncached)?.cycles() + frame));
        let cycles: Option<u64> = cycles.sum();
        drop(wcets);
        if !resolve(&mut functions, &costliest) {
            return cycles;
        }
    }
}

/// Removes the iterations of uncounted loops, and the calls of excluded functions.
fn strip(function: &mut Function, excluded_by_watchdog: &BTreeSet<u32>) {
    for block in &mut function.blocks {
        block.call = block
            .call
            .filter(|call| !excluded_by_watchdog.contains(call));
    }
    for looped in &mut function.loops {
        if looped.bound.is_none() && looped.total.is_none() {
            looped.total = Some(Total {
                bound: Bound::new(Count::Number(0), ""),
                per: None,
                in_runs: BTreeSet::new(),
            });
        }
    }
    unroll(function);
}

/// Makes loops with two entries acyclic: an edge back in such a loop leads to a copy of the graph. There are as many
/// copies as such edges: each loop can be passed once from any of its entries.
fn unroll(function: &mut Function) {
    let back = back_edges(function);
    let (blocks, loops) = (function.blocks.clone(), function.loops.clone());
    let size = blocks.len();
    function.blocks.clear();
    function.loops.clear();
    for copy in 0..=back.len() {
        let first = copy * size;
        for (from, block) in blocks.iter().enumerate() {
            let edges = block.successors.iter().filter_map(|edge| {
                let mut edge = *edge;
                let is_back = back.contains(&(from, edge.to));
                edge.to += first + if is_back { size } else { 0 };
                (!is_back || copy < back.len()).then_some(edge)
            });
            let mut block = block.clone();
            block.successors = edges.collect();
            function.blocks.push(block);
        }
        let shifted = |all: &BTreeSet<usize>| all.iter().map(|block| block + first).collect();
        function.loops.extend(loops.iter().map(|looped| Loop {
            head: looped.head + first,
            blocks: shifted(&looped.blocks),
            back: shifted(&looped.back),
            ..looped.clone()
        }));
    }
}

/// The back edges of a function that belong to no natural loop.
fn back_edges(function: &Function) -> BTreeSet<(usize, usize)> {
    let search = DepthFirst::search(&function.blocks);
    let mut back: BTreeSet<(usize, usize)> = search.back.into_iter().collect();
    for looped in &function.loops {
        back.retain(|(from, to)| *to != looped.head || !looped.back.contains(from));
    }
    back
}

/// For each function that calls through pointers, the costliest possible callee.
fn costliest(wcets: &Wcets<'_>, pointers: &BTreeMap<u32, BTreeSet<u32>>) -> BTreeMap<u32, u32> {
    // A function without a bound is the costliest.
    let cost = |at: &u32| {
        let bound = wcets.bound(*at, Cache::Uncached);
        bound.map_or(u64::MAX, |bound| bound.cycles())
    };
    let costliest = pointers.iter().filter_map(|(function, called)| {
        let called = called.iter().filter(|at| !wcets.excluded.contains(at));
        Some((*function, *called.max_by_key(|at| cost(at))?))
    });
    costliest.collect()
}

/// Resolves the calls through pointers in all blocks. Returns whether any call changed.
fn resolve(functions: &mut Functions, costliest: &BTreeMap<u32, u32>) -> bool {
    let mut is_new = false;
    for (address, function) in functions {
        for block in &mut function.blocks {
            let Some((last, before)) = block.instructions.split_last() else {
                continue;
            };
            let Some(register) = pointer(&last.operation) else {
                continue;
            };
            let known = stack::constant(register, before).map(|at| at & !1);
            let called = known.or_else(|| costliest.get(address).copied());
            if called.is_some() && block.call != called {
                block.call = called;
                // A jump ends the function as its target does.
                block.ends |= block.traps;
                block.traps = false;
                is_new = true;
            }
        }
    }
    is_new
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Model, Operation, testing};

    /// Blocks as 0 -> 1, 2; 1 -> 3 or 2; 2 -> 4 or 1; both end: a loop with two entries.
    const TWO_ENTRIES: [(u32, &[usize]); 6] = [
        (1, &[5, 2]),
        (10, &[3, 2]),
        (100, &[4, 1]),
        (1, &[]),
        (1, &[]),
        (1000, &[1]),
    ];

    /// The cost of a function with its callees.
    fn cost(functions: &Functions, address: u32) -> Option<u64> {
        let (model, named) = (Model::new(&testing::CLOCK), BTreeMap::new());
        let wcets = Wcets::new(functions, &model, &named, BTreeSet::new());
        Some(wcets.bound(address, Cache::Warm)?.cycles())
    }

    fn alone(function: Function) -> u64 {
        let address = function.address;
        cost(&BTreeMap::from([(address, function)]), address).unwrap()
    }

    #[test]
    fn a_loop_with_two_entries_is_passed_once_from_each() {
        let mut function = testing::function(&TWO_ENTRIES);
        assert_eq!(back_edges(&function).len(), 1);
        strip(&mut function, &BTreeSet::new());
        assert_eq!(back_edges(&function).len(), 0);
        // 0, 5, 1, 2 and in a second pass 1, 3, or: 2, 1, 2.
        let longest = alone(function);
        let path = 1 + 1000 + 10 + 100;
        assert!(longest >= path + 10, "{longest}");
        assert!(longest < path + 250, "{longest}");
    }

    #[test]
    fn rounds_that_nothing_counts_cost_nothing() {
        let blocks: [(u32, &[usize]); 3] = [(1, &[1]), (100, &[1, 2]), (1, &[])];
        let with = |bound: bool| {
            let mut function = testing::function(&blocks);
            let mut looped = testing::counted(1, &[1], &[1], 7);
            looped.bound = looped.bound.filter(|_| bound);
            function.loops.push(looped);
            strip(&mut function, &BTreeSet::new());
            alone(function)
        };
        let once = with(false);
        assert!((102..150).contains(&once), "{once}");
        assert_eq!(with(true) - once, 7 * 100);
    }

    #[test]
    fn a_pointer_leads_to_the_costliest_and_a_function_without_a_bound_is_costlier_still() {
        let root = 0x0800_0000;
        let mut functions = BTreeMap::new();
        for (address, length) in [(root, 2), (0x0900_0000, 10), (0x0a00_0000, 300)] {
            let mut function = testing::function(&[(length, &[])]);
            function.address = address;
            functions.insert(address, function);
        }
        let last = functions.get_mut(&root).unwrap().blocks[0]
            .instructions
            .last_mut();
        last.unwrap().operation = Operation::CallRegister(3);
        let pointers = BTreeMap::from([(root, BTreeSet::from([0x0900_0000, 0x0a00_0000]))]);
        let resolved = |mut functions: Functions| {
            let (model, named) = (Model::new(&testing::CLOCK), BTreeMap::new());
            let wcets = Wcets::new(&functions, &model, &named, BTreeSet::new());
            let found = costliest(&wcets, &pointers);
            drop(wcets);
            assert!(resolve(&mut functions, &found));
            assert!(!resolve(&mut functions, &found));
            cost(&functions, root)
        };
        let cycles = resolved(functions.clone()).unwrap();
        assert!((302..350).contains(&cycles), "{cycles}");
        let endless = functions.get_mut(&0x0900_0000).unwrap();
        endless.blocks[0].call = Some(0x0900_0000);
        assert_eq!(resolved(functions), None);
    }
}
