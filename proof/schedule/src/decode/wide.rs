//! Instructions of 32 bits but floating point.

mod memory;

use super::{Decoded, Flags, bits, float, mask, register, relative};
use crate::Operation;

const PROGRAM_COUNTER: u8 = 15;

pub(super) fn decode(pc: u32, first: u32, second: u32) -> Option<Decoded> {
    let is_coprocessor = bits(first, 10, 1) == 1;
    match bits(first, 11, 2) {
        1 | 3 if is_coprocessor => float::decode(pc, first, second),
        1 if bits(first, 9, 1) == 1 => shifted_register(first, second),
        1 if bits(first, 6, 1) == 0 => memory::multiple(first, second),
        1 => memory::dual_exclusive_table(pc, first, second),
        2 if bits(second, 15, 1) == 1 => branch_or_control(pc, first, second),
        2 if bits(first, 9, 1) == 0 => modified_constant(first, second),
        2 => plain_constant(pc, first, second),
        3 => match bits(first, 8, 2) {
            0 | 1 => memory::single(pc, first, second),
            2 => register_processing(first, second),
            _ => multiply_divide(first, second),
        },
        _ => None,
    }
}

const fn flags(first: u32) -> Flags {
    if bits(first, 4, 1) == 1 {
        Flags::Set
    } else {
        Flags::Kept
    }
}

/// Arithmetic with a register that may be shifted.
fn shifted_register(first: u32, second: u32) -> Option<Decoded> {
    let left = register(first, 0);
    let to = register(second, 8);
    let from = register(second, 0);
    let is_shifted = second & 0x70f0 != 0;
    let plain = Operation::Plain { writes: mask(to) };
    let code = bits(first, 5, 4);
    let operation = match code {
        0 | 4 | 8 | 13 if to == PROGRAM_COUNTER => {
            return comparison(first, code == 13 && !is_shifted, from);
        }
        2 if left == PROGRAM_COUNTER && !is_shifted => Operation::Copy { to, from },
        8 => Operation::AddRegister {
            to,
            left,
            right: (!is_shifted).then_some(from),
        },
        0..=4 | 6 | 10 | 11 | 13 | 14 => plain,
        _ => return None,
    };
    (to != PROGRAM_COUNTER).then_some(Decoded::with(operation, flags(first)))
}

/// `TST`, `TEQ`, `CMN` and `CMP` of registers; only the last is known when it `is_plain`.
fn comparison(first: u32, is_plain: bool, right: u8) -> Option<Decoded> {
    if bits(first, 4, 1) == 0 {
        return None;
    }
    let left = register(first, 0);
    let operation = if is_plain {
        Operation::CompareRegisters { left, right }
    } else {
        Operation::Plain { writes: 0 }
    };
    Some(Decoded::with(operation, Flags::Set))
}

/// Twelve bits that stand for a constant: repeated bytes, or eight bits rotated.
const fn expand(code: u32) -> u32 {
    let byte = bits(code, 0, 8);
    match bits(code, 8, 4) {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (0x80 | bits(code, 0, 7)).rotate_right(bits(code, 7, 5)),
    }
}

/// The twelve bits of a constant.
const fn twelve(first: u32, second: u32) -> u32 {
    bits(first, 10, 1) << 11 | bits(second, 12, 3) << 8 | bits(second, 0, 8)
}

/// Arithmetic with a constant from twelve bits.
fn modified_constant(first: u32, second: u32) -> Option<Decoded> {
    const FARTHEST: u32 = 1 << 31;
    let from = register(first, 0);
    let to = register(second, 8);
    let value = expand(twelve(first, second));
    let sets = bits(first, 4, 1) == 1;
    let is_comparison = to == PROGRAM_COUNTER && sets;
    let operation = match bits(first, 5, 4) {
        13 if is_comparison => Operation::Compare { left: from, value },
        // CMN sets the flags as a comparison with the negative does, but for two values.
        8 if is_comparison && value != 0 && value != FARTHEST => Operation::Compare {
            left: from,
            value: value.wrapping_neg(),
        },
        0 | 4 | 8 if is_comparison => Operation::Plain { writes: 0 },
        _ if to == PROGRAM_COUNTER => return None,
        2 if from == PROGRAM_COUNTER => Operation::Constant { to, value },
        3 if from == PROGRAM_COUNTER => Operation::Constant { to, value: !value },
        2 => Operation::Or { to, from, value },
        8 => Operation::Add {
            to,
            from,
            value: value.cast_signed(),
        },
        13 => Operation::Add {
            to,
            from,
            value: value.cast_signed().wrapping_neg(),
        },
        0 | 1 | 3 | 4 | 10 | 11 | 14 => Operation::Plain { writes: mask(to) },
        _ => return None,
    };
    Some(Decoded::with(operation, flags(first)))
}

/// Moves and additions of plain constants, bit fields, saturation.
fn plain_constant(pc: u32, first: u32, second: u32) -> Option<Decoded> {
    let from = register(first, 0);
    let to = register(second, 8);
    let value = twelve(first, second);
    let whole = bits(first, 0, 4) << 12 | value;
    let here = pc & !3;
    let is_relative = from == PROGRAM_COUNTER;
    let operation = match bits(first, 4, 5) {
        0 if is_relative => Operation::Constant {
            to,
            value: here.wrapping_add(value),
        },
        10 if is_relative => Operation::Constant {
            to,
            value: here.wrapping_sub(value),
        },
        0 => Operation::Add {
            to,
            from,
            value: value.cast_signed(),
        },
        10 => Operation::Add {
            to,
            from,
            value: -value.cast_signed(),
        },
        4 => Operation::Constant { to, value: whole },
        12 => Operation::ConstantTop {
            to,
            value: whole as u16,
        },
        16 | 18 | 20 | 22 | 24 | 26 | 28 => Operation::Plain { writes: mask(to) },
        _ => return None,
    };
    (to != PROGRAM_COUNTER).then_some(Decoded::new(operation))
}

fn branch_or_control(pc: u32, first: u32, second: u32) -> Option<Decoded> {
    let (j1, j2) = (bits(second, 13, 1), bits(second, 11, 1));
    let sign = bits(first, 10, 1);
    if bits(second, 12, 1) == 1 {
        let (i1, i2) = (!(j1 ^ sign) & 1, !(j2 ^ sign) & 1);
        let distance =
            sign << 24 | i1 << 23 | i2 << 22 | bits(first, 0, 10) << 12 | bits(second, 0, 11) << 1;
        let target = relative(pc, distance, 25);
        return Some(Decoded::new(if bits(second, 14, 1) == 1 {
            Operation::Call(target)
        } else {
            Operation::Jump(target)
        }));
    }
    if bits(second, 14, 1) == 1 {
        // A call into another instruction set, which is not there.
        return None;
    }
    let condition = bits(first, 6, 4);
    if condition < 14 {
        let distance =
            sign << 20 | j2 << 19 | j1 << 18 | bits(first, 0, 6) << 12 | bits(second, 0, 11) << 1;
        return Some(Decoded {
            condition: Some(condition as u8),
            ..Decoded::new(Operation::Jump(relative(pc, distance, 21)))
        });
    }
    control(first, second)
}

/// Special registers, hints, barriers, traps.
fn control(first: u32, second: u32) -> Option<Decoded> {
    let special = bits(second, 0, 8) as u8;
    let operation = match (bits(first, 4, 7), bits(second, 4, 4)) {
        (0x38 | 0x39, _) => {
            let operation = Operation::WriteSpecial {
                register: special,
                from: register(first, 0),
            };
            // The first registers hold the flags.
            let flags = if special < 4 { Flags::Set } else { Flags::Kept };
            return Some(Decoded::with(operation, flags));
        }
        (0x3a, _) => match special {
            0 | 1 | 4 | 0xf0.. => Operation::Nothing,
            2 | 3 => Operation::Wait,
            _ => return None,
        },
        (0x3b, 2) => Operation::ClearExclusive,
        (0x3b, 4..=6) => Operation::Barrier,
        (0x3e | 0x3f, _) => Operation::ReadSpecial {
            register: special,
            to: register(second, 8),
        },
        (0x7f, _) => Operation::Trap,
        _ => return None,
    };
    Some(Decoded::new(operation))
}

/// Shifts by a register, extensions, parallel and saturating arithmetic, bit reversal, `CLZ`.
fn register_processing(first: u32, second: u32) -> Option<Decoded> {
    let to = register(second, 8);
    if bits(second, 12, 4) != 15 || to == PROGRAM_COUNTER {
        return None;
    }
    let is_shift = bits(first, 7, 1) == 0 && bits(second, 4, 4) == 0;
    let flags = if is_shift { flags(first) } else { Flags::Kept };
    Some(Decoded::with(Operation::Plain { writes: mask(to) }, flags))
}

fn multiply_divide(first: u32, second: u32) -> Option<Decoded> {
    let to = register(second, 8);
    let added = Some(register(second, 12)).filter(|&added| added != PROGRAM_COUNTER);
    let operation = match bits(first, 4, 4) {
        // MLS subtracts.
        0 if bits(second, 4, 4) != 0 => Operation::Multiply {
            writes: mask(to),
            added: None,
        },
        0..=7 => Operation::Multiply {
            writes: mask(to),
            added,
        },
        9 | 11 => Operation::Divide { writes: mask(to) },
        8 | 10 | 12..=14 => Operation::Multiply {
            writes: mask(to) | mask(added?),
            added: None,
        },
        _ => return None,
    };
    (to != PROGRAM_COUNTER).then_some(Decoded::new(operation))
}
