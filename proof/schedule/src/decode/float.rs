//! Instructions of the single-precision floating-point extension, FPv4-SP.

use super::{Decoded, Flags, bits, indexed, mask, register};
use crate::Operation;

/// Cycles of additions, comparisons, conversions and moves: one, and one to wait for an operand.
const SIMPLE: u8 = 2;
/// Cycles of a move of two core registers, and one to wait for an operand.
pub const MOVE_TWO: u8 = 3;
/// Cycles of a multiplication with an addition, and one to wait for an operand.
pub const MULTIPLY_ADD: u8 = 4;
/// Cycles of a division or a square root, and one to wait for an operand.
pub const DIVIDE: u8 = 15;

const PROGRAM_COUNTER: u8 = 15;

const fn float(cycles: u8, writes: u16) -> Decoded {
    Decoded::new(Operation::Float { cycles, writes })
}

pub(super) fn decode(pc: u32, first: u32, second: u32) -> Option<Decoded> {
    // Coprocessors 10 and 11; bit 12 is set only in later extensions.
    if bits(second, 9, 3) != 0b101 || bits(first, 12, 1) == 1 {
        return None;
    }
    let is_double = bits(second, 8, 1) == 1;
    if bits(first, 8, 4) != 0b1110 {
        return transfer(pc, first, second, is_double);
    }
    if bits(second, 4, 1) == 1 {
        return Some(move_one(first, second));
    }
    if is_double {
        return None;
    }
    let cycles = match bits(first, 4, 4) & 0b1011 {
        0 | 1 | 9 | 10 => MULTIPLY_ADD,
        8 => DIVIDE,
        11 if bits(first, 0, 4) == 1 && bits(second, 6, 2) == 0b11 => DIVIDE,
        2 | 3 | 11 => SIMPLE,
        _ => return None,
    };
    Some(float(cycles, 0))
}

/// Between one core register and one floating-point register or the flags.
fn move_one(first: u32, second: u32) -> Decoded {
    let to_core = bits(first, 4, 1) == 1;
    let core = register(second, 12);
    match (to_core, core) {
        (true, PROGRAM_COUNTER) => Decoded {
            flags: Flags::Set,
            ..float(SIMPLE, 0)
        },
        (true, _) => float(SIMPLE, mask(core)),
        (false, _) => float(SIMPLE, 0),
    }
}

/// Loads, stores, and moves of two registers.
fn transfer(pc: u32, first: u32, second: u32, is_double: bool) -> Option<Decoded> {
    let is_before = bits(first, 8, 1) == 1;
    let has_writeback = bits(first, 5, 1) == 1;
    let is_up = bits(first, 7, 1) == 1;
    let count = bits(second, 0, 8) as u8;
    let words = match (is_before, is_up, has_writeback) {
        (false, false, false) => return move_two(first, second),
        (true, _, false) => 1 + u8::from(is_double),
        (false, true, _) | (true, false, true) if count != 0 => count,
        _ => return None,
    };
    let (address, writeback) = indexed(pc, first, second)?;
    Some(Decoded::new(if bits(first, 4, 1) == 1 {
        Operation::FloatLoad {
            words,
            address,
            writeback,
        }
    } else {
        Operation::FloatStore {
            words,
            address,
            writeback,
        }
    }))
}

fn move_two(first: u32, second: u32) -> Option<Decoded> {
    let to_core = bits(first, 4, 1) == 1;
    let writes = if to_core {
        mask(register(first, 0)) | mask(register(second, 12))
    } else {
        0
    };
    (bits(first, 6, 1) == 1 && bits(second, 4, 1) == 1).then_some(float(MOVE_TWO, writes))
}
