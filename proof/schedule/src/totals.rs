//! Totals of a run: that each holds for one call, or one entry of a loop, and that a run makes no more.
//!
//! A comment `// wcet-total: N` states the runs of a loop for one entry; `// wcet-total: N per f` states those in one
//! call of `f`, whatever calls and loops are in between, which is believed. All loops whose totals have the same name
//! share one budget. So on each path of a run there may be one such call or entry for each budget.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Cache, Flaw, Loop, Rule, Total,
    budget::{Budget, Budgets, budget},
    config::is_named,
    system::{Row, System},
    wcet::Wcets,
};

/// Reports the totals that a run of a row may need more than once.
pub(crate) fn flaws(
    system: &System<'_>,
    row: &Row,
    wcets: &Wcets<'_>,
    reached: &BTreeSet<u32>,
) -> Vec<Flaw> {
    let mut budgets: BTreeMap<Budget, Vec<(u32, &Total)>> = BTreeMap::new();
    for function in system.program.functions_at(reached) {
        for looped in &function.loops {
            if let Some(total) = &looped.total {
                let at = function.blocks[looped.head].start();
                let known = budgets.entry(budget(function, looped.head));
                known.or_default().push((at, total));
            }
        }
    }
    let flaws = budgets.into_iter().filter_map(|(budget, loops)| {
        let names: BTreeSet<&str> = loops.iter().filter_map(|it| it.1.per.as_deref()).collect();
        let functions = system.program.functions().values();
        let owners = functions.filter(|it| names.iter().any(|name| is_named(&it.name, name)));
        let mut entries = EntryCounts {
            wcets,
            owners: owners.map(|function| function.address).collect(),
            budget,
            known: BTreeMap::new(),
        };
        let count = entries.of(row.root);
        let shown = loops.iter().max_by_key(|it| it.1.per.is_some());
        let (at, total) = *shown.filter(|_| count > 1)?;
        let (origin, row) = (&total.bound.origin, &row.name);
        let what = match &total.per {
            Some(per) => format!(
                "the total at {origin} is that of one call of `{per}`, and a run of `{row}` may make several, or come to \
                 the loop without one"
            ),
            None => format!(
                "the total at {origin} is that of one entry of the loop, and a run of `{row}` may enter it, or others \
                 that share the total, {count} times"
            ),
        };
        let remedy = "Write `// wcet-total: N per f: reason`, where `f` is a function that is not inlined, and that each run calls \
             once; or write `// wcet-bound: N`.";
        Some(system.flaw(Rule::BelievedBound, at, what, remedy))
    });
    flaws.collect()
}

/// The most calls and entries on a path that need a budget.
struct EntryCounts<'a> {
    wcets: &'a Wcets<'a>,
    budget: Budget,
    /// The functions of which a call needs it.
    owners: BTreeSet<u32>,
    known: BTreeMap<u32, u64>,
}

impl EntryCounts<'_> {
    fn of(&mut self, address: u32) -> u64 {
        if self.owners.contains(&address) {
            return 1;
        }
        if let Some(known) = self.known.get(&address) {
            return *known;
        }
        // A recursive function has no bound.
        self.known.insert(address, 0);
        let count = self.longest(address).unwrap_or(0);
        self.known.insert(address, count);
        count
    }

    /// The longest path of a function, where a loop is entered again once or more.
    fn longest(&mut self, address: u32) -> Option<u64> {
        let wcets = self.wcets;
        let function = wcets.functions.get(&address)?;
        let mut open = Budgets::new();
        let mut graph = wcets.graph(function, Cache::Warm, &mut open, |_| true)?;
        for (block, cost) in function.blocks.iter().zip(&mut graph.costs) {
            let call = wcets.callee(block);
            *cost = call.map_or(0, |call| self.of(call));
        }
        let counts =
            |looped: &&Loop| looped.total.is_some() && budget(function, looped.head) == self.budget;
        let loops: Vec<&Loop> = function.loops.iter().filter(counts).collect();
        let entries = |from: Option<usize>, to: usize| -> u64 {
            let entered = loops.iter().filter(|looped| {
                looped.head == to && from.is_none_or(|from| !looped.blocks.contains(&from))
            });
            // Outside of the function that its total is for, an entry is one too many.
            let cost = |total: &Total| if total.per.is_some() { 2 } else { 1 };
            entered
                .filter_map(|looped| looped.total.as_ref())
                .map(cost)
                .sum()
        };
        for (from, edges) in graph.edges.iter_mut().enumerate() {
            for (to, cost) in edges {
                *cost = entries(Some(from), *to);
            }
        }
        for looped in &mut graph.loops {
            (looped.most, looped.total) = (Some(1), None);
            looped.in_runs.clear();
        }
        Some(graph.longest()?.cost + entries(None, 0))
    }
}
