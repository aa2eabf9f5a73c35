//! Value analysis: the abstract state before each block of a function, as a forward data-flow analysis.

use std::collections::BTreeSet;

use crate::{
    Block, Instruction, Operation, Region,
    values::{ARGUMENTS, Origins, Spans, State, Surroundings, Value, sources},
};

/// The frame pointer, by convention.
const FRAME_POINTER: u8 = 7;
const STACK_POINTER: u8 = 13;

/// The states before each block; `None` where execution does not come.
pub(crate) type States = Vec<Option<State>>;

/// Solves a data-flow problem: the state before each block of a function; `None`: it is not reached. A path ends where
/// there is no state after a block.
pub(crate) fn data_flow<S: Clone + PartialEq>(
    blocks: &[Block],
    entry: S,
    mut after: impl FnMut(usize, S) -> Option<S>,
    join: impl Fn(&S, &S) -> S,
) -> Vec<Option<S>> {
    let mut before = vec![None; blocks.len()];
    let Some(first) = before.first_mut() else {
        return before;
    };
    *first = Some(entry);
    let mut work = BTreeSet::from([0]);
    while let Some(index) = work.pop_first() {
        let state = before[index].clone();
        let Some(state) = state.and_then(|state| after(index, state)) else {
            continue;
        };
        for to in blocks[index].next() {
            let known = before[to].as_ref();
            let joined = known.map_or_else(|| state.clone(), |known| join(known, &state));
            if known != Some(&joined) {
                before[to] = Some(joined);
                work.insert(to);
            }
        }
    }
    before
}

/// The values before each block of a function.
pub(crate) fn solve(around: Surroundings<'_>, blocks: &[Block], entry: State) -> States {
    let after = |index: usize, mut state: State| {
        state.pass(around, &blocks[index]);
        Some(state)
    };
    data_flow(blocks, entry, after, State::join)
}

/// Calls `show` for each instruction with the state before it.
pub(crate) fn visit(
    around: Surroundings<'_>,
    blocks: &[Block],
    before: &States,
    mut show: impl FnMut(&State, &Instruction),
) {
    for (block, state) in blocks.iter().zip(before) {
        let Some(mut state) = state.clone() else {
            continue;
        };
        for instruction in &block.instructions {
            show(&state.before(instruction), instruction);
            state.step(around, instruction);
        }
    }
}

/// The summary of a function: use of its frame, writes through its arguments, and result.
#[derive(Debug, Clone)]
pub(crate) struct FunctionSummary {
    /// The lowest place of its frame that it makes a pointer to.
    pub(crate) lowest_pointer: i32,
    /// Whether the function may write to its arguments on the stack.
    pub(crate) writes_arguments: bool,
    /// Bytes that the function writes through each of its arguments, without writes through
    /// pointers that were kept in memory.
    pub(crate) writes: Writes,
    /// The memory that its result points into.
    pub(crate) result: Region,
}

impl FunctionSummary {
    pub(crate) fn of(around: Surroundings<'_>, blocks: &[Block], before: &States) -> Self {
        let mut lowest_pointer = i32::MAX;
        let mut highest_written = i32::MIN;
        let mut result: Option<Value> = None;
        let mut writes = Writes::default();
        visit(around, blocks, before, |state, instruction| {
            match frame_pointer(state, instruction.operation) {
                Some(Some(pointer)) => {
                    lowest_pointer = lowest_pointer.min(pointer);
                    highest_written = highest_written.max(pointer);
                }
                Some(None) => (lowest_pointer, highest_written) = (i32::MIN, i32::MAX),
                None => {}
            }
            if let Operation::Store { address, words, .. }
            | Operation::FloatStore { address, words, .. } = instruction.operation
                && let Some(slot) = state.address(address).in_frame()
            {
                highest_written = highest_written.max(slot + 4 * i32::from(words) - 1);
            }
            add_writes(around, state, instruction.operation, &mut writes);
            if instruction.is_return() {
                let value = state.get(0).abroad();
                result = Some(result.map_or(value, |known| known.join(value)));
            }
        });
        // The result of a jump out of the function is not known here.
        let leaves = blocks
            .iter()
            .any(|block| block.ends && block.call.is_some());
        for spans in &mut writes {
            merge(spans);
        }
        Self {
            lowest_pointer,
            writes_arguments: highest_written >= 0,
            writes,
            result: match result {
                Some(value) if !leaves => value.region(),
                _ => Region::Unknown,
            },
        }
    }
}

/// All offsets from a pointer.
const ALL: (i32, i32) = (i32::MIN, i32::MAX);

/// Bytes that a function writes through each of its arguments.
type Writes = [Spans; ARGUMENTS as usize];

/// Adds the bytes that an instruction writes through the arguments of its function.
fn add_writes(around: Surroundings<'_>, state: &State, operation: Operation, writes: &mut Writes) {
    if let Some((address, length)) = operation.stored() {
        let to = state.address(address);
        // A word that is stored to the place of its load does not count.
        let is_put_back = |distance: i32, source: u8| {
            let place = to.add(distance).argument_offset();
            place.is_some_and(|(register, distance)| {
                let value = state.get(source);
                value.is_loaded_from_argument(register, distance)
            })
        };
        let mut stored = (0..).step_by(4).zip(sources(operation)).peekable();
        if stored.peek().is_none() {
            add_writes_through(writes, to, &[(0, length)]);
        }
        for (distance, source) in stored {
            if !is_put_back(distance, source) {
                add_writes_through(writes, to, &[(distance, distance + 4)]);
            }
        }
        // Any function may write through a pointer that is in memory.
        let slot = to.in_frame();
        if slot.is_none_or(|slot| slot >= around.lowest_pointer) {
            for source in sources(operation) {
                add_writes_through(writes, state.get(source), &[ALL]);
            }
        }
    }
    match operation {
        Operation::Call(callee) | Operation::Jump(callee) => {
            let known = around
                .callees
                .and_then(|callees| callees.writes.get(&callee));
            if let Some(spans) = known {
                for (register, spans) in (0..).zip(spans) {
                    add_writes_through(writes, state.get(register), spans);
                }
            } else if matches!(operation, Operation::Call(_)) {
                add_unknown(writes, state);
            }
        }
        Operation::CallRegister(_) => add_unknown(writes, state),
        _ => {}
    }
}

/// Adds all bytes that an unknown function may write.
fn add_unknown(writes: &mut Writes, state: &State) {
    for register in 0..ARGUMENTS {
        add_writes_through(writes, state.get(register), &[ALL]);
    }
}

/// Adds the bytes that are written through a pointer.
fn add_writes_through(writes: &mut Writes, pointer: Value, spans: &[(i32, i32)]) {
    for (register, to) in (0..).zip(writes) {
        match pointer.argument_offset() {
            Some((other, base)) if other == register => {
                let from = |distance: i32| base.saturating_add(distance);
                to.extend(spans.iter().map(|&(start, end)| (from(start), from(end))));
            }
            None if pointer.origins().contains(Origins::argument(register)) => {
                to.extend(spans.first().map(|_| ALL));
            }
            _ => {}
        }
    }
}

/// Puts spans in order and joins those that touch.
fn merge(spans: &mut Spans) {
    spans.sort_unstable();
    let mut merged: Spans = Vec::new();
    for &(start, end) in spans.iter() {
        match merged.last_mut() {
            Some((_, last)) if start <= *last => *last = end.max(*last),
            _ => merged.push((start, end)),
        }
    }
    *spans = merged;
}

/// The slot of the frame to which an instruction makes a pointer, `None` if the slot is not known;
/// or no pointer at all.
#[expect(
    clippy::option_option,
    reason = "a pointer that may be missing, to what may be unknown"
)]
fn frame_pointer(state: &State, operation: Operation) -> Option<Option<i32>> {
    let (to, sources, distance) = match operation {
        Operation::Copy { to, from } => (to, [Some(from), None], 0),
        Operation::Add { to, from, value } => (to, [Some(from), None], value),
        Operation::AddRegister { to, left, right } => (to, [Some(left), right], 0),
        _ => return None,
    };
    if to == STACK_POINTER || to == FRAME_POINTER {
        return None;
    }
    sources.into_iter().flatten().find_map(|source| {
        let value = state.get(source).add(distance);
        match value.in_frame() {
            Some(slot) => Some(Some(slot)),
            None => (source == STACK_POINTER).then_some(None),
        }
    })
}
