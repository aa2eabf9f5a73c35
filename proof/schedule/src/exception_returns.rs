//! Returns of handlers, as an erratum of the processor has them: Arm 838869 (ES0182 of the STM32F405) may take the
//! vector of another exception where the store before the return is still in the write buffer.
//!
//! A return that loads the program counter from the stack waits for the stores before it, as does a barrier.

use crate::{App, Block, Config, Flaw, Instruction, Operation, Program, Rule, releases::handlers};

/// The link register.
const LINK_REGISTER: u8 = 14;

/// The returns that may overtake a store.
pub(crate) fn flaws(program: &Program<'_>, app: &App, config: &Config) -> Vec<Flaw> {
    if !config.limits.returns_after_stores {
        return Vec::new();
    }
    let tasks = app.tasks.iter().filter(|task| task.priority > 0);
    let handlers = tasks.flat_map(|task| handlers(program.image, config, task));
    let functions = handlers.filter_map(|handler| program.function(handler));
    let blocks = functions.flat_map(|function| &function.blocks);
    let flaws = blocks.filter(|block| overtakes(block)).map(|block| {
        let what =
            "a handler may return before its last store has ended: erratum 838869 of the processor";
        let remedy = "End the handler with a barrier, `cortex_m::asm::dsb()`.";
        program
            .image
            .flaw(Rule::ForbiddenInstruction, block.last(), what, remedy)
    });
    let mut flaws: Vec<Flaw> = flaws.collect();
    flaws.sort();
    flaws.dedup();
    flaws
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
    use crate::Decoder;

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
}
