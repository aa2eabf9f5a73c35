//! Errata of the processor that the code must not bring about (ES0182 of the STM32F405).
//!
//! * Arm 838869: the return of a handler may take the vector of another exception where the store before the return is
//!   still in the write buffer. A return that loads the program counter from the stack waits for the stores before it,
//!   as does a barrier.
//! * Arm 776924: a division or a root in floating point may be lost where a handler interrupts it that has one or two
//!   instructions besides its return.
//! * Arm 752419: an interrupted load of the stack pointer is made again, and from another place where it moves its base.

use crate::{
    App, Block, Config, Flaw, Function, Instruction, Operation, Program, Rule, releases::handlers,
};

const STACK_POINTER: u8 = 13;
const LINK_REGISTER: u8 = 14;
/// What to do about each.
const REMEDY: &str = "838869: end the handler with `cortex_m::asm::dsb()`. 776924: begin it with more instructions. \
                      752419: load another register, and move that to the stack pointer.";
/// The instructions of a handler that is too short, its return included.
const SHORT_HANDLER: usize = 3;

/// The returns that may overtake a store, the handlers that are too short, and the loads of the stack pointer.
pub(crate) fn flaws(program: &Program<'_>, app: &App, config: &Config) -> Vec<Flaw> {
    if !config.limits.errata {
        return Vec::new();
    }
    let flaw = |at: u32, erratum: u32| {
        let what = format!("erratum {erratum} of the processor may occur");
        program
            .image
            .flaw(Rule::ForbiddenInstruction, at, what, REMEDY)
    };
    let mut flaws = Vec::new();
    let tasks = app.tasks.iter().filter(|task| task.priority > 0);
    let handlers = tasks.flat_map(|task| handlers(program.image, config, task));
    for handler in handlers.filter_map(|handler| program.function(handler)) {
        let last = handler.blocks.iter().filter(|it| overtakes(it));
        flaws.extend(last.map(|it| flaw(it.last(), 838_869)));
        let first = handler.instructions().next();
        let first = first.filter(|_| returns_within(&handler.blocks, 0, SHORT_HANDLER));
        flaws.extend(first.map(|it| flaw(it.address, 776_924)));
    }
    let all = program
        .functions()
        .values()
        .flat_map(Function::instructions);
    let loads = all.filter(|it| loads_stack_pointer(it));
    flaws.extend(loads.map(|it| flaw(it.address, 752_419)));
    flaws.sort();
    flaws.dedup();
    flaws
}

/// Whether a path from a block to the end of its function has at most so many instructions, without those of calls.
fn returns_within(blocks: &[Block], at: usize, most: usize) -> bool {
    let block = &blocks[at];
    let mut next = block.successors.iter();
    let left = most.checked_sub(block.instructions.len());
    left.is_some_and(|left| block.ends || next.any(|it| returns_within(blocks, it.to, left)))
}

/// Whether an instruction loads one word, into the stack pointer.
const fn loads_stack_pointer(instruction: &Instruction) -> bool {
    matches!(instruction.operation, Operation::Load { writes, words: 1, .. } if writes >> STACK_POINTER & 1 != 0)
}

/// Whether a block returns by the link register, with neither a barrier nor a load after its last store. A block
/// without a store counts as one that begins with a store.
fn overtakes(block: &Block) -> bool {
    let returns = |last: &Instruction| matches!(last.operation, Operation::JumpRegister(register) if register == LINK_REGISTER);
    let mut later = block.instructions.iter().rev();
    later.next().is_some_and(returns)
        && !later
            .take_while(|it| {
                !matches!(
                    it.operation,
                    Operation::Store { .. } | Operation::StoreExclusive { .. }
                )
            })
            .any(|it| matches!(it.operation, Operation::Barrier | Operation::Load { .. }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Decoder, testing};

    /// The last block of a handler, from its halves.
    fn block(halves: &[u16]) -> Block {
        let mut decoder = Decoder::new();
        let mut instructions = Vec::new();
        let mut at = 0;
        while at < halves.len() {
            let next = halves.get(at + 1).copied().unwrap_or(0);
            let address = 0x0800_0000 + 2 * at as u32;
            let instruction = decoder
                .decode(address, [halves[at], next])
                .expect("it is known");
            at += (instruction.end() - address) as usize / 2;
            instructions.push(instruction);
        }
        Block {
            instructions,
            successors: Vec::new(),
            call: None,
            ends: true,
            traps: false,
        }
    }

    #[test]
    fn a_return_waits_for_the_last_store_by_a_barrier_or_a_load() {
        const STORE: u16 = 0x6008; // str r0, [r1]
        const LOAD: u16 = 0x6808; // ldr r0, [r1]
        const RETURN: u16 = 0x4770; // bx lr
        assert!(overtakes(&block(&[STORE, RETURN])));
        assert!(overtakes(&block(&[LOAD, STORE, RETURN])));
        assert!(overtakes(&block(&[RETURN])));
        assert!(!overtakes(&block(&[STORE, LOAD, RETURN])));
        // dsb sy; pop {pc}
        assert!(!overtakes(&block(&[STORE, 0xf3bf, 0x8f4f, RETURN])));
        assert!(!overtakes(&block(&[STORE, 0xbd00])));
    }

    #[test]
    fn a_handler_is_too_short_where_a_path_through_it_has_two_instructions_and_a_return() {
        let handler = |lengths: [u32; 3]| {
            let [first, second, last] = lengths;
            let mut blocks =
                testing::function(&[(first, &[1, 2]), (second, &[2]), (last, &[])]).blocks;
            blocks[2].ends = true;
            returns_within(&blocks, 0, SHORT_HANDLER)
        };
        assert!(handler([1, 9, 2]) && handler([2, 1, 1]));
        assert!(!handler([1, 1, 3]) && !handler([3, 1, 1]));
    }

    #[test]
    fn a_word_is_not_loaded_into_the_stack_pointer() {
        let loads = |halves: &[u16]| block(halves).instructions.iter().any(loads_stack_pointer);
        // ldr.w sp, [r0]; ldr.w sp, [r0], #4
        assert!(loads(&[0xf8d0, 0xd000]) && loads(&[0xf850, 0xdb04]));
        // ldr r0, [sp]; pop {r4, pc}; ldr.w r12, [r0]
        assert!(!loads(&[0x9800, 0xbd10]) && !loads(&[0xf8d0, 0xc000]));
    }
}
