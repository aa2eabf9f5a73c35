//! Functions made by hand, for tests.

use crate::{
    Block, Bound, Clock, Count, Edge, Function, Instruction, Loop, Operation, Region, Store,
};

/// The clocks of an STM32F405 at 168 MHz.
pub(crate) const CLOCK: Clock = Clock {
    hclk_hz: 168_000_000,
    timer_hz: 84_000_000,
    flash_wait_states: 5,
    prefetch: false,
    apb1_div: 4,
    apb2_div: 2,
    dma_wait: 0,
};

/// An instruction of one cycle and two bytes.
pub(crate) fn plain(address: u32) -> Instruction {
    Instruction {
        address,
        bytes: 2,
        operation: Operation::Plain { writes: 0 },
        condition: 14,
        in_if_then: false,
        sets_flags: false,
    }
}

/// A block of so many plain instructions, each block in lines of its own.
pub(crate) fn block(index: usize, length: u32, successors: &[usize]) -> Block {
    let begin = 0x0800_0000 + 0x1000 * index as u32;
    Block {
        instructions: (0..length).map(|at| plain(begin + 2 * at)).collect(),
        successors: successors
            .iter()
            .map(|&to| Edge {
                to,
                is_taken: false,
            })
            .collect(),
        call: None,
        ends: successors.is_empty(),
        traps: false,
    }
}

/// A function of such blocks: length and successors of each.
pub(crate) fn function(blocks: &[(u32, &[usize])]) -> Function {
    Function {
        address: 0x0800_0000,
        name: "f".to_owned(),
        blocks: blocks
            .iter()
            .enumerate()
            .map(|(index, (length, successors))| block(index, *length, successors))
            .collect(),
        returns: true,
        ..Function::default()
    }
}

/// A store of a word to a constant address.
pub(crate) fn store(at: u32, to: u32, value: Option<u32>) -> Store {
    Store {
        at,
        to: Some(to),
        region: Region::of(to),
        bytes: 4,
        value,
    }
}

pub(crate) fn bound(count: Count) -> Bound {
    Bound::new(count, "test")
}

/// A loop with a bound.
pub(crate) fn counted(head: usize, blocks: &[usize], back: &[usize], count: u64) -> Loop {
    Loop {
        head,
        blocks: blocks.iter().copied().collect(),
        back: back.iter().copied().collect(),
        bound: Some(bound(Count::Number(count))),
        ..Loop::default()
    }
}
