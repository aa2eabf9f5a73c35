//! Budgets: how often loops may run in a whole activation.

use std::collections::BTreeMap;

use crate::{Bound, Count, Function};

/// A loop: its function, its head; or with [`ALL_CALLS`] all calls of the function.
pub(crate) type Place = (u32, usize);
pub(crate) const ALL_CALLS: usize = usize::MAX;

/// The budget against which the iterations of a loop are counted.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Budget {
    /// The own total of a loop.
    Own(Place),
    /// The total that all loops with this name share.
    Named(String),
}

/// Iterations that count against a budget.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Open {
    /// Their number.
    pub(crate) times: u64,
    /// The cost of the most expensive one.
    pub(crate) cost: u64,
    /// The loop of that iteration.
    pub(crate) place: Place,
}

impl Open {
    pub(crate) fn cycles(&self) -> u64 {
        self.times * self.cost
    }
}

pub(crate) type Budgets = BTreeMap<Budget, Open>;

/// Adds iterations to a budget: only the most expensive counts, in whichever loop.
pub(crate) fn add_open(open: &mut Budgets, budget: Budget, one: Open) {
    let known = open.entry(budget).or_insert(one);
    if one.cost > known.cost {
        *known = one;
    }
}

/// Returns the budget of a loop.
pub(crate) fn budget(function: &Function, head: usize) -> Budget {
    let mut loops = function.loops.iter().filter(|looped| looped.head == head);
    match loops
        .find_map(|looped| looped.total.as_ref())
        .map(|total| &total.bound)
    {
        Some(Bound {
            count: Count::Named(name),
            ..
        }) => Budget::Named(name.clone()),
        _ => Budget::Own((function.address, head)),
    }
}
