//! Loops whose number of runs follows from constants.
//!
//! A loop is followed run by run, beginning with what is known where it is entered. When all paths
//! back to its head are closed by comparisons of known values, it has been run to its end.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Block, Instruction, Loop, Operation, Runs,
    value_analysis::States,
    values::{State, Surroundings},
};

/// Most runs that are followed.
const MOST_RUNS: u64 = 5_000;
/// Most instructions that are followed for one loop.
const MOST_STEPS: u64 = 300_000;

/// Follows `one`; `None` when its end is not found.
pub(crate) fn runs(
    around: Surroundings<'_>,
    blocks: &[Block],
    states: &States,
    one: &Loop,
) -> Option<Runs> {
    let mut run = Run {
        around,
        blocks,
        one,
        steps: 0,
        may_end: false,
        is_decided: false,
    };
    let found = |least, returns, is_open| Runs {
        least,
        returns,
        is_open,
    };
    let mut state = entry(around, blocks, states, one)?;
    let (mut least, mut returns) = (0, 0);
    while returns < MOST_RUNS
        && let Some(next) = run.follow(&state)
    {
        let Some(next) = next else {
            return Some(found(least, returns, false));
        };
        if next == state || !run.is_decided {
            return None;
        }
        state = next;
        returns += 1;
        if !run.may_end {
            least = returns;
        }
    }
    Some(found(least, returns, true))
}

/// The state where the loop is entered.
fn entry(around: Surroundings<'_>, blocks: &[Block], states: &States, one: &Loop) -> Option<State> {
    let outside = blocks
        .iter()
        .zip(states)
        .enumerate()
        .filter(|(index, _)| !one.blocks.contains(index));
    let mut joined: Option<State> = None;
    // The function may begin with the loop.
    if one.head == 0 {
        return None;
    }
    for (_, (block, state)) in outside {
        if !block.successors.iter().any(|edge| edge.to == one.head) {
            continue;
        }
        let Some(mut state) = state.clone() else {
            continue;
        };
        state.pass(around, block);
        joined = Some(joined.map_or_else(|| state.clone(), |known| known.join(&state)));
    }
    joined
}

/// One loop being followed.
struct Run<'a> {
    around: Surroundings<'a>,
    blocks: &'a [Block],
    one: &'a Loop,
    steps: u64,
    /// Whether a way led out of the loop in a run that may also go on.
    may_end: bool,
    /// Whether a branch out of the loop was decided.
    is_decided: bool,
}

impl Run<'_> {
    /// Follows one run from the head; the state in which the head is reached again, if it is.
    /// `None` when it takes too long.
    #[expect(
        clippy::option_option,
        reason = "no answer, or the answer that there is no state"
    )]
    fn follow(&mut self, state: &State) -> Option<Option<State>> {
        let mut before = BTreeMap::from([(self.one.head, state.clone())]);
        let mut again: Option<State> = None;
        let mut work = BTreeSet::from([self.one.head]);
        while let Some(index) = work.pop_first() {
            let mut state = before[&index].clone();
            let block = &self.blocks[index];
            self.steps += block.instructions.len() as u64;
            if self.steps > MOST_STEPS {
                return None;
            }
            let Some((last, others)) = block.instructions.split_last() else {
                continue;
            };
            for instruction in others {
                state.step(self.around, instruction);
            }
            let taken = decide(&state, last);
            state.step(self.around, last);
            state.settle();
            self.note_ends(block, taken);
            self.may_end |= block.ends || block.traps;
            for edge in &block.successors {
                if taken.is_some_and(|taken| taken != edge.is_taken) {
                    continue;
                }
                self.may_end |= !self.one.blocks.contains(&edge.to);
                if edge.to == self.one.head {
                    again = Some(again.map_or_else(|| state.clone(), |known| known.join(&state)));
                } else if self.one.blocks.contains(&edge.to) {
                    let joined = match before.get(&edge.to) {
                        Some(known) => known.join(&state),
                        None => state.clone(),
                    };
                    if before.get(&edge.to) != Some(&joined) {
                        before.insert(edge.to, joined);
                        work.insert(edge.to);
                    }
                }
            }
        }
        Some(again)
    }

    /// Notes whether the end of `block` decides if the loop goes on.
    fn note_ends(&mut self, block: &Block, taken: Option<bool>) {
        let leaves = |to: usize| !self.one.blocks.contains(&to);
        let mut edges = block.successors.iter();
        let ends_loop = block.ends || block.traps || edges.clone().any(|edge| leaves(edge.to));
        let ends_run = edges.any(|edge| edge.to == self.one.head);
        if block.successors.len() < 2 && !block.ends && !block.traps {
            return;
        }
        self.is_decided |= taken.is_some() && (ends_loop || ends_run);
    }
}

/// Whether the branch at the end of a block is taken, if that is known.
fn decide(state: &State, last: &Instruction) -> Option<bool> {
    match last.operation {
        Operation::Jump(_) => state.flags().holds(last.condition),
        Operation::JumpOnZero {
            register, is_zero, ..
        } => {
            let value = state.get(register).constant()?;
            Some((value == 0) == is_zero)
        }
        _ => None,
    }
}
