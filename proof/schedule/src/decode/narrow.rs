//! Instructions of 16 bits.

use super::{Decoded, Flags, bits, mask, register, relative, transfer};
use crate::{Address, Operation};

const STACK_POINTER: u8 = 13;

pub(super) fn decode(pc: u32, code: u32) -> Option<Decoded> {
    let (low, high) = (low(code, 0), low(code, 8));
    Some(match bits(code, 10, 6) {
        0..=0b01_0000 => arithmetic(code),
        0b01_0001 => return special(code),
        0b01_0010 | 0b01_0011 => {
            let address = Address::Absolute((pc & !3) + bits(code, 0, 8) * 4);
            load(high, address, 4)
        }
        0b01_0100..=0b10_0111 => single(code),
        0b10_1000 | 0b10_1001 => Decoded::new(Operation::Constant {
            to: high,
            value: (pc & !3) + bits(code, 0, 8) * 4,
        }),
        0b10_1010 | 0b10_1011 => Decoded::new(Operation::Add {
            to: high,
            from: STACK_POINTER,
            value: bits(code, 0, 8).cast_signed() * 4,
        }),
        0b10_1100..=0b10_1111 => return miscellaneous(pc, code, low),
        0b11_0000..=0b11_0011 => {
            return multiple(bits(code, 11, 1) == 1, bits(code, 0, 8) as u16, high);
        }
        0b11_0100..=0b11_0111 => match bits(code, 8, 4) {
            14 => Decoded::new(Operation::Trap),
            15 => Decoded::new(Operation::Supervisor),
            condition => Decoded {
                condition: Some(condition as u8),
                ..Decoded::new(Operation::Jump(relative(pc, code << 1, 9)))
            },
        },
        0b11_1000 | 0b11_1001 => Decoded::new(Operation::Jump(relative(pc, code << 1, 12))),
        _ => return None,
    })
}

/// A register's number in `code` from bit `at`, of three bits.
const fn low(code: u32, at: u32) -> u8 {
    bits(code, at, 3) as u8
}

/// Shifts, additions, moves, comparisons, logic.
fn arithmetic(code: u32) -> Decoded {
    let (to, from, high) = (low(code, 0), low(code, 3), low(code, 8));
    let small = bits(code, 6, 3);
    let byte = bits(code, 0, 8);
    let operation = match bits(code, 9, 7) {
        0..=0b000_1011 if code >> 6 == 0 => Operation::Copy { to, from },
        0..=0b000_1011 | 0b000_1101 => Operation::Plain { writes: mask(to) },
        0b000_1100 => Operation::AddRegister {
            to,
            left: from,
            right: Some(small as u8),
        },
        0b000_1110 => Operation::Add {
            to,
            from,
            value: small.cast_signed(),
        },
        0b000_1111 => Operation::Add {
            to,
            from,
            value: -small.cast_signed(),
        },
        0b001_0000..=0b001_0011 => Operation::Constant {
            to: high,
            value: byte,
        },
        0b001_0100..=0b001_0111 => {
            let operation = Operation::Compare {
                left: high,
                value: byte,
            };
            return Decoded::with(operation, Flags::Set);
        }
        0b001_1000..=0b001_1011 => Operation::Add {
            to: high,
            from: high,
            value: byte.cast_signed(),
        },
        0b001_1100..=0b001_1111 => Operation::Add {
            to: high,
            from: high,
            value: -(byte.cast_signed()),
        },
        _ => return logic(code, to, from),
    };
    Decoded::with(operation, Flags::SetOutsideIfThen)
}

/// `AND` to `MVN`.
fn logic(code: u32, to: u8, from: u8) -> Decoded {
    let operation = match bits(code, 6, 4) {
        10 => {
            let operation = Operation::CompareRegisters {
                left: to,
                right: from,
            };
            return Decoded::with(operation, Flags::Set);
        }
        // TST, CMN.
        8 | 11 => return Decoded::with(Operation::Plain { writes: 0 }, Flags::Set),
        13 => Operation::Multiply {
            writes: mask(to),
            added: None,
        },
        _ => Operation::Plain { writes: mask(to) },
    };
    Decoded::with(operation, Flags::SetOutsideIfThen)
}

/// Operations on all sixteen registers, and branches to one.
fn special(code: u32) -> Option<Decoded> {
    let to = low(code, 0) | (bits(code, 7, 1) as u8) << 3;
    let from = register(code, 3);
    Some(Decoded::new(match (bits(code, 8, 2), to) {
        (0 | 2, 15) => Operation::JumpComputed,
        (0, _) => Operation::AddRegister {
            to,
            left: to,
            right: Some(from),
        },
        (1, _) => {
            let operation = Operation::CompareRegisters {
                left: to,
                right: from,
            };
            return Some(Decoded::with(operation, Flags::Set));
        }
        (2, _) => Operation::Copy { to, from },
        (_, 0) => Operation::JumpRegister(from),
        (_, 8) => Operation::CallRegister(from),
        _ => return None,
    }))
}

const fn load(to: u8, address: Address, bytes: u8) -> Decoded {
    transfer(true, (1, Some(to), mask(to)), bytes, (address, None))
}

const fn store(source: u8, address: Address, bytes: u8) -> Decoded {
    transfer(
        false,
        (1, Some(source), mask(source)),
        bytes,
        (address, None),
    )
}

/// Loads and stores of one register.
fn single(code: u32) -> Decoded {
    let (value, base) = (low(code, 0), low(code, 3));
    let offset = |scale: u32| Address::Offset {
        base,
        offset: (bits(code, 6, 5) * scale).cast_signed(),
    };
    let stack = Address::Offset {
        base: STACK_POINTER,
        offset: bits(code, 0, 8).cast_signed() * 4,
    };
    match bits(code, 11, 5) {
        0b01010 | 0b01011 => {
            let address = Address::Indexed {
                base,
                index: low(code, 6),
                shift: 0,
            };
            match bits(code, 9, 3) {
                0 => store(value, address, 4),
                1 => store(value, address, 2),
                2 => store(value, address, 1),
                4 => load(value, address, 4),
                5 | 7 => load(value, address, 2),
                _ => load(value, address, 1),
            }
        }
        0b01100 => store(value, offset(4), 4),
        0b01101 => load(value, offset(4), 4),
        0b01110 => store(value, offset(1), 1),
        0b01111 => load(value, offset(1), 1),
        0b10000 => store(value, offset(2), 2),
        0b10001 => load(value, offset(2), 2),
        0b10010 => store(low(code, 8), stack, 4),
        _ => load(low(code, 8), stack, 4),
    }
}

/// Stack, compare-and-branch, extensions, hints, `IT`.
fn miscellaneous(pc: u32, code: u32, to: u8) -> Option<Decoded> {
    let operation = match bits(code, 8, 4) {
        0 => {
            let value = bits(code, 0, 7).cast_signed() * 4;
            Operation::Add {
                to: STACK_POINTER,
                from: STACK_POINTER,
                value: if bits(code, 7, 1) == 1 { -value } else { value },
            }
        }
        1 | 3 | 9 | 11 => Operation::JumpOnZero {
            register: to,
            to: pc.wrapping_add(bits(code, 9, 1) << 6 | bits(code, 3, 5) << 1),
            is_zero: bits(code, 11, 1) == 0,
        },
        // 0b1011_1010_10 is HLT of Armv8-M.
        2 | 10 if code >> 6 != 0x2ea => Operation::Plain { writes: mask(to) },
        4 | 5 => {
            let list = bits(code, 0, 8) | bits(code, 8, 1) << 14;
            return push(list as u16);
        }
        6 if code & 0xffec == 0xb660 && bits(code, 0, 2) != 0 => Operation::Interrupts {
            off: bits(code, 4, 1) == 1,
            primask: bits(code, 1, 1) == 1,
            faultmask: bits(code, 0, 1) == 1,
        },
        12 | 13 => {
            let list = bits(code, 0, 8) | bits(code, 8, 1) << 15;
            return multiple(true, list as u16, STACK_POINTER);
        }
        14 => Operation::Trap,
        15 if bits(code, 0, 4) != 0 => {
            let conditional = 4 - bits(code, 0, 4).trailing_zeros();
            Operation::IfThen(conditional as u8)
        }
        15 => match bits(code, 4, 4) {
            0 | 1 | 4 => Operation::Nothing,
            2 | 3 => Operation::Wait,
            _ => return None,
        },
        _ => return None,
    };
    Some(Decoded::new(operation))
}

/// The number of registers in `list`, which is not empty.
const fn count(list: u16) -> Option<u8> {
    match list.count_ones() as u8 {
        0 => None,
        words => Some(words),
    }
}

fn push(list: u16) -> Option<Decoded> {
    let (base, words) = (STACK_POINTER, count(list)?);
    let offset = -4 * i32::from(words);
    let place = (Address::Offset { base, offset }, Some((base, offset)));
    Some(transfer(false, (words, None, list), 4, place))
}

/// `POP`, and `LDM` and `STM` of low registers.
fn multiple(is_load: bool, list: u16, base: u8) -> Option<Decoded> {
    let words = count(list)?;
    let address = Address::Offset { base, offset: 0 };
    // A base that is loaded keeps what was loaded.
    let is_kept = is_load && list & mask(base) != 0;
    let writeback = (!is_kept).then_some((base, 4 * i32::from(words)));
    Some(transfer(
        is_load,
        (words, None, list),
        4,
        (address, writeback),
    ))
}
