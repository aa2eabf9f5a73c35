//! The cycle table.

use crate::decode::{Class, Flow, Instruction};

/// Name and calibration of the table.
pub const MODEL: &str = "Cortex-M4 TRM r0p1 (DDI 0439) at 0 wait states, pipeline refill P = 2: \
    ALU and multiplications 1; LDR 2, or 1 after an LDR whose result is not its address; \
    STR 1, with a register offset 2; LDM, STM, PUSH, POP, LDRD, STRD, VLDR, VSTR 1 + words; \
    LDREX, STREX, MRS, MSR, CPS 2; barriers 1 + P; taken branches 1 + P, not taken 1, TBB 2 + P; \
    IT 0 after a 16-bit instruction, else 1; SDIV, UDIV 7 (manual: 2 to 12); VADD, VMUL 1, VMLA, \
    VFMA 3, VDIV, VSQRT 14; exception entry 12, exit 12, tail-chaining not credited. Calibration: \
    a model of this table gave 48.0 cycles a step for Klipper's one-stepper and 207 for its \
    three-stepper benchmark on the STM32F407, where 46 and 205 are published as measured \
    (+4.3 %, +1.0 %). Not modelled: bus waits of peripherals, flash cache misses, stalls on \
    results, floating-point registers saved at exception entry";

/// Cycles to refill the pipeline after a taken branch: the manual says 1 to 3.
pub const REFILL: u64 = 2;
/// Cycles from the request of an exception to its first instruction.
pub const EXCEPTION_ENTRY: u64 = 12;
/// Cycles from the return instruction to the interrupted program.
pub const EXCEPTION_EXIT: u64 = 12;

/// How an instruction was executed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "four independent facts")]
pub struct Circumstances {
    /// Another instruction than the next one followed.
    pub taken: bool,
    /// The instruction accessed memory: a transfer without an access was skipped by its condition.
    pub touched: bool,
    /// The instruction follows a load whose result is not part of its address.
    pub follows_load: bool,
    /// The instruction follows a 16-bit instruction in memory.
    pub follows_short: bool,
}

/// Cycles that one execution takes.
pub fn cycles(instruction: &Instruction, how: Circumstances) -> u64 {
    let base = match instruction.class {
        Class::Load | Class::StoreIndexed | Class::Multiple(_) if !how.touched => 1,
        Class::Load if how.follows_load && instruction.flow == Flow::Next => 1,
        Class::Plain | Class::Store | Class::Branch => 1,
        Class::Load
        | Class::StoreIndexed
        | Class::Exclusive
        | Class::TableBranch
        | Class::Special => 2,
        Class::Multiple(words) => 1 + u64::from(words),
        Class::IfThen(_) => u64::from(!how.follows_short),
        Class::Divide => 7,
        Class::Barrier => 1 + REFILL,
        Class::FloatMultiplyAdd => 3,
        Class::FloatDivide => 14,
    };
    base + if how.taken { REFILL } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::decode;

    fn cost(first: u16, second: u16, how: Circumstances) -> u64 {
        cycles(&decode(0, first, second).unwrap(), how)
    }

    #[test]
    fn a_load_into_the_program_counter_is_never_paired() {
        let how = Circumstances {
            taken: true,
            touched: true,
            follows_load: true,
            follows_short: false,
        };
        assert_eq!(cost(0xf85d, 0xfb04, how), 2 + REFILL);
    }

    #[test]
    fn skipped_instructions_take_a_cycle() {
        let how = Circumstances::default();
        assert_eq!(cost(0xbd10, 0, how), 1); // pop {r4, pc}
        assert_eq!(cost(0x5088, 0, how), 1); // str r0, [r1, r2]
        assert_eq!(cost(0x4770, 0, how), 1); // bx lr
    }

    #[test]
    fn it_is_folded_into_a_short_instruction() {
        let follows_short = Circumstances {
            follows_short: true,
            ..Circumstances::default()
        };
        assert_eq!(cost(0xbf08, 0, follows_short), 0);
        assert_eq!(cost(0xbf08, 0, Circumstances::default()), 1);
    }
}
