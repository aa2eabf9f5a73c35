//! What the rounds of loops that are bounded over a whole activation are counted against.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Count, Function, Loop, Total};

/// A loop: its function, its head; or with [`CALLS`] all calls of the function.
pub(crate) type Place = (u32, usize);
pub(crate) const CALLS: usize = usize::MAX;

/// What the rounds of loops are counted against.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Budget {
    /// A number of its own.
    Own(Place),
    /// One for all loops that give this name.
    Named(String),
}

/// Rounds that are paid from a budget.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Open {
    /// How many.
    pub(crate) times: u64,
    /// What the dearest costs.
    pub(crate) cost: u64,
    /// The loop of that round.
    pub(crate) place: Place,
}

impl Open {
    pub(crate) fn cycles(&self) -> u64 {
        self.times * self.cost
    }
}

pub(crate) type Budgets = BTreeMap<Budget, Open>;

/// Adds rounds to a budget: the dearest counts, wherever.
pub(crate) fn add_open(open: &mut Budgets, budget: Budget, one: Open) {
    let known = open.entry(budget).or_insert(one);
    if one.cost > known.cost {
        *known = one;
    }
}

/// What the rounds of a loop are counted against.
pub(crate) fn budget(function: &Function, head: usize) -> Budget {
    let mut loops = function.loops.iter().filter(|looped| looped.head == head);
    match loops.find_map(|looped| looped.total.as_ref()) {
        Some(Total {
            count: Count::Named(name),
            ..
        }) => Budget::Named(name.clone()),
        _ => Budget::Own((function.address, head)),
    }
}

/// Whether each way round a loop leads through one of these blocks.
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
