//! Instructions of the single-precision floating-point extension, FPv4-SP.

use super::{Class, Flow, Instruction, bits};

const fn of(class: Class) -> Instruction {
    Instruction::new(4, class, Flow::Next)
}

pub(super) fn decode(first: u32, second: u32) -> Option<Instruction> {
    // Coprocessors 10 and 11; bit 12 is set only in later extensions.
    if bits(second, 9, 3) != 0b101 || bits(first, 12, 1) == 1 {
        return None;
    }
    let double = bits(second, 8, 1) == 1;
    if bits(first, 8, 4) != 0b1110 {
        return transfer(first, second, double);
    }
    if bits(second, 4, 1) == 1 {
        // Between one core register and one floating-point register or the flags.
        return Some(of(Class::Plain));
    }
    if double {
        return None;
    }
    Some(of(match bits(first, 4, 4) & 0b1011 {
        0 | 1 | 9 | 10 => Class::FloatMultiplyAdd,
        8 => Class::FloatDivide,
        11 if bits(first, 0, 4) == 1 && bits(second, 6, 2) == 0b11 => Class::FloatDivide,
        2 | 3 | 11 => Class::Plain,
        _ => return None,
    }))
}

/// Loads, stores, and moves of two registers.
fn transfer(first: u32, second: u32, double: bool) -> Option<Instruction> {
    let before = bits(first, 8, 1) == 1;
    let write_back = bits(first, 5, 1) == 1;
    let up = bits(first, 7, 1) == 1;
    match (before, up, write_back) {
        (false, false, false) => {
            (bits(first, 6, 1) == 1 && bits(second, 4, 1) == 1).then_some(of(Class::Special))
        }
        (true, _, false) => Some(of(Class::Multiple(if double { 2 } else { 1 }))),
        (false, true, _) | (true, false, true) => {
            let words = bits(second, 0, 8) as u8;
            (words != 0).then_some(of(Class::Multiple(words)))
        }
        _ => None,
    }
}
