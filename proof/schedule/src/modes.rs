//! Whether each path through a task belongs to one of its modes.
//!
//! A mode lists the functions that its runs do not call, and its WCET covers the remaining paths. A
//! path that calls two functions which no mode has together would be covered by no WCET. So the sets
//! of functions that paths may call are followed through the task, a bit for each excluded function; a
//! set that is part of another set is dropped.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Flaw, Rule,
    system::{Row, System},
    wcet::Functions,
};

/// Functions that a path calls, a bit for each.
type Called = u64;
/// Most functions that the modes of a task exclude together.
const MOST: usize = 64;

/// Paths through tasks that no mode has.
pub(crate) fn flaws(system: &System<'_>) -> Vec<Flaw> {
    let mut tasks: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    for row in &system.rows {
        if row.times.is_some() && row.kind_of.is_none() {
            tasks.entry(&row.task.name).or_default().push(row);
        }
    }
    let tasks = tasks.into_iter().filter(|(_, rows)| rows.len() > 1);
    tasks
        .filter_map(|(name, rows)| of_task(system, name, &rows))
        .collect()
}

fn of_task(system: &System<'_>, name: &str, rows: &[&Row]) -> Option<Flaw> {
    let exempt = rows.iter().map(|row| row.excluded.clone());
    let exempt = exempt.reduce(|one, other| &one & &other)?;
    let tagged: BTreeSet<u32> = rows.iter().flat_map(|row| &row.excluded).copied().collect();
    let tagged: Vec<u32> = tagged.difference(&exempt).copied().collect();
    if tagged.len() > MOST {
        let what = format!("the modes of `{name}` exclude more than {MOST} functions");
        let remedy = "Exclude fewer: those that the others are called from.";
        return Some(Flaw::new(Rule::Mode, what, rows[0].task.place(), remedy));
    }
    let excluded = rows.iter().map(|row| {
        let bits = tagged.iter().enumerate();
        let bits = bits.filter(|(_, function)| row.excluded.contains(function));
        bits.fold(0, |bits, (bit, _)| bits | 1 << bit)
    });
    let mut paths = CallPaths {
        functions: system.program.functions(),
        tagged: &tagged,
        excluded: excluded.collect(),
        never: &exempt,
        known: BTreeMap::new(),
        uncovered: None,
    };
    for root in rows[0].entries() {
        paths.of(*root);
    }
    let (at, called) = paths.uncovered?;
    let names = tagged.iter().enumerate();
    let names = names.filter(|(bit, _)| called >> bit & 1 == 1);
    let names: Vec<String> = names
        .map(|(_, function)| format!("`{}`", system.image.name(*function)))
        .collect();
    let what = format!(
        "a run of `{name}` may call {}, and no mode allows all of them",
        names.join(" and ")
    );
    let remedy = "Do one of them in a run, and pend the task again for the other; or let a mode in \
         `schedule.toml` exclude none of them.";
    Some(system.flaw(Rule::Mode, at, what, remedy))
}

/// The paths through the functions of a task.
struct CallPaths<'a> {
    functions: &'a Functions,
    tagged: &'a [u32],
    /// The functions that each mode excludes.
    excluded: Vec<Called>,
    /// Functions that no mode calls.
    never: &'a BTreeSet<u32>,
    known: BTreeMap<u32, Vec<Called>>,
    /// The first path found that no mode covers: the instruction that calls the deciding function,
    /// and the set of called functions.
    uncovered: Option<(u32, Called)>,
}

impl CallPaths<'_> {
    /// The sets of functions that are called on the paths through a function, itself included.
    fn of(&mut self, address: u32) -> Vec<Called> {
        if let Some(known) = self.known.get(&address) {
            return known.clone();
        }
        // A function that calls itself has a flaw of its own.
        self.known.insert(address, Vec::new());
        let bit = self.tagged.iter().position(|tagged| *tagged == address);
        let own = bit.map_or(0, |bit| 1 << bit);
        let mut found = Vec::new();
        let Some(function) = self.functions.get(&address) else {
            return vec![own];
        };
        let mut before: Vec<Vec<Called>> = vec![Vec::new(); function.blocks.len()];
        if let Some(first) = before.first_mut() {
            first.push(own);
        }
        let mut work = BTreeSet::from([0]);
        while let Some(index) = work.pop_first() {
            let Some(block) = function.blocks.get(index) else {
                continue;
            };
            let mut after = before[index].clone();
            if let Some(call) = block.returning_call() {
                if self.never.contains(&call) {
                    continue;
                }
                let callee = self.of(call);
                after = self.both(&after, &callee, block.last());
            }
            if block.ends {
                merge(&mut found, &after);
            }
            for edge in &block.successors {
                if merge(&mut before[edge.to], &after) {
                    work.insert(edge.to);
                }
            }
        }
        self.known.insert(address, found.clone());
        found
    }

    /// The sets of functions called on a path of the first and then a path of the second kind.
    fn both(&mut self, first: &[Called], second: &[Called], at: u32) -> Vec<Called> {
        let mut found = Vec::new();
        for (one, other) in first
            .iter()
            .flat_map(|one| second.iter().map(move |it| (one, it)))
        {
            let called = one | other;
            if self.uncovered.is_none() && !self.is_covered(called) {
                self.uncovered = Some((at, called));
            }
            merge(&mut found, &[called]);
        }
        found
    }

    /// Whether a mode has a path that calls these functions.
    fn is_covered(&self, called: Called) -> bool {
        let mut excluded = self.excluded.iter();
        excluded.any(|excluded| called & excluded == 0)
    }
}

/// Adds sets to others of which none is part of another; whether that changes them.
fn merge(sets: &mut Vec<Called>, more: &[Called]) -> bool {
    let mut is_new = false;
    for &one in more {
        if sets.iter().any(|known| one & !known == 0) {
            continue;
        }
        sets.retain(|known| known & !one != 0);
        sets.push(one);
        is_new = true;
    }
    is_new
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Function, testing};

    const FIRST: u32 = 0x0900_0000;
    const SECOND: u32 = 0x0a00_0000;

    fn function(address: u32) -> Function {
        Function {
            address,
            ..testing::function(&[(1, &[])])
        }
    }

    /// What is called on no mode's path, where the modes exclude one of two functions each.
    fn uncovered(shape: &[(u32, &[usize])], calls: &[(usize, u32)]) -> Option<Called> {
        let mut root = testing::function(shape);
        for &(block, callee) in calls {
            root.blocks[block].call = Some(callee);
        }
        let functions = [root, function(FIRST), function(SECOND)];
        let functions = functions
            .map(|function| (function.address, function))
            .into();
        let mut paths = CallPaths {
            functions: &functions,
            tagged: &[FIRST, SECOND],
            excluded: vec![1, 2],
            never: &BTreeSet::new(),
            known: BTreeMap::new(),
            uncovered: None,
        };
        paths.of(0x0800_0000);
        paths.uncovered.map(|(_, called)| called)
    }

    #[test]
    fn two_paths_of_one_mode_each_are_covered_and_one_path_of_both_is_not() {
        let fork: &[(u32, &[usize])] = &[(1, &[1, 2]), (1, &[3]), (1, &[3]), (1, &[])];
        assert_eq!(uncovered(fork, &[(1, FIRST), (2, SECOND)]), None);
        let through: &[(u32, &[usize])] = &[(1, &[1, 2]), (1, &[2]), (1, &[3]), (1, &[])];
        assert_eq!(uncovered(through, &[(1, FIRST), (2, SECOND)]), Some(3));
        assert_eq!(uncovered(through, &[(1, FIRST), (2, FIRST)]), None);
        let circle: &[(u32, &[usize])] = &[(1, &[1, 2]), (1, &[0]), (1, &[0, 3]), (1, &[])];
        assert_eq!(uncovered(circle, &[(1, FIRST), (2, SECOND)]), Some(3));
    }
}
