//! 32-bit instructions but floating point.

use super::{Class, Flow, Instruction, bits, float, multiple, relative};

const STACK_POINTER: u32 = 13;
const PROGRAM_COUNTER: u32 = 15;

const fn of(class: Class) -> Instruction {
    Instruction::new(4, class, Flow::Next)
}

pub(super) fn decode(pc: u32, first: u32, second: u32) -> Option<Instruction> {
    let coprocessor = bits(first, 10, 1) == 1;
    match bits(first, 11, 2) {
        1 | 3 if coprocessor => float::decode(first, second),
        1 if bits(first, 9, 1) == 1 => {
            matches!(bits(first, 5, 4), 0..=4 | 6 | 8 | 10 | 11 | 13 | 14)
                .then_some(of(Class::Plain))
        }
        1 if bits(first, 6, 1) == 0 => load_store_multiple(first, second),
        1 => dual_exclusive_table(first, second),
        2 if bits(second, 15, 1) == 1 => branch_or_control(pc, first, second),
        2 if bits(first, 9, 1) == 0 => {
            matches!(bits(first, 5, 4), 0..=4 | 8 | 10 | 11 | 13 | 14).then_some(of(Class::Plain))
        }
        2 => matches!(
            bits(first, 4, 5),
            0 | 4 | 0xa | 0xc | 0x10 | 0x12 | 0x14 | 0x16 | 0x18 | 0x1a | 0x1c
        )
        .then_some(of(Class::Plain)),
        3 => match bits(first, 8, 2) {
            0 | 1 => load_store_single(first, second),
            // Shifts, extensions, parallel and saturating arithmetic, bit reversal, CLZ.
            2 => (bits(second, 12, 4) == 15).then_some(of(Class::Plain)),
            _ => multiply_divide(first),
        },
        _ => None,
    }
}

fn load_store_multiple(first: u32, second: u32) -> Option<Instruction> {
    let transfer = multiple(4, second)?;
    let load = bits(first, 4, 1) == 1;
    match bits(first, 7, 2) {
        1 | 2 if load && bits(second, 15, 1) == 1 => Some(Instruction {
            flow: Flow::Return,
            ..transfer
        }),
        1 | 2 => Some(transfer),
        _ => None,
    }
}

fn dual_exclusive_table(first: u32, second: u32) -> Option<Instruction> {
    let load = bits(first, 4, 1) == 1;
    let indexed = bits(first, 8, 1) == 1;
    let write_back = bits(first, 5, 1) == 1;
    if indexed || write_back {
        return Some(of(Class::Multiple(2)));
    }
    if bits(first, 7, 1) == 0 {
        return Some(of(Class::Exclusive));
    }
    match bits(second, 4, 4) {
        0 | 1 if load => Some(Instruction::new(4, Class::TableBranch, Flow::JumpComputed)),
        4 | 5 => Some(of(Class::Exclusive)),
        _ => None,
    }
}

fn branch_or_control(pc: u32, first: u32, second: u32) -> Option<Instruction> {
    let (j1, j2) = (bits(second, 13, 1), bits(second, 11, 1));
    let sign = bits(first, 10, 1);
    if bits(second, 12, 1) == 1 {
        let (i1, i2) = (!(j1 ^ sign) & 1, !(j2 ^ sign) & 1);
        let distance =
            sign << 24 | i1 << 23 | i2 << 22 | bits(first, 0, 10) << 12 | bits(second, 0, 11) << 1;
        let target = relative(pc, distance, 25);
        let flow = if bits(second, 14, 1) == 1 {
            Flow::Call(target)
        } else {
            Flow::Jump(target)
        };
        return Some(Instruction::new(4, Class::Branch, flow));
    }
    if bits(second, 14, 1) == 1 {
        return None;
    }
    if bits(first, 6, 4) < 14 {
        let distance =
            sign << 20 | j2 << 19 | j1 << 18 | bits(first, 0, 6) << 12 | bits(second, 0, 11) << 1;
        let flow = Flow::Jump(relative(pc, distance, 21));
        return Some(Instruction::new(4, Class::Branch, flow));
    }
    Some(of(match (bits(first, 4, 7), bits(second, 4, 4)) {
        (0x38 | 0x39 | 0x3e | 0x3f, _) => Class::Special,
        // Hints, CLREX, UDF.
        (0x3a | 0x7f, _) | (0x3b, 2) => Class::Plain,
        (0x3b, 4..=6) => Class::Barrier,
        _ => return None,
    }))
}

fn load_store_single(first: u32, second: u32) -> Option<Instruction> {
    let base = bits(first, 0, 4);
    let load = bits(first, 4, 1) == 1;
    let size = bits(first, 5, 2);
    let signed = bits(first, 8, 1) == 1;
    if size == 3 || signed && (!load || size == 2) {
        return None;
    }
    let literal = base == PROGRAM_COUNTER;
    let constant = bits(first, 7, 1) == 1 || bits(second, 11, 1) == 1;
    let indexed = !constant && !literal;
    if indexed && bits(second, 6, 5) != 0 {
        return None;
    }
    if !load {
        return match (literal, indexed) {
            (true, _) => None,
            (_, true) => Some(of(Class::StoreIndexed)),
            (_, false) => Some(of(Class::Store)),
        };
    }
    let target = bits(second, 12, 4);
    let address = match (literal, indexed) {
        (true, _) => 0,
        (_, true) => 1 << base | 1 << bits(second, 0, 4),
        (_, false) => 1 << base,
    };
    let transfer = Instruction::load(4, target, address);
    Some(match (target, size) {
        (PROGRAM_COUNTER, 2) if base == STACK_POINTER => Instruction {
            flow: Flow::Return,
            ..transfer
        },
        (PROGRAM_COUNTER, 2) => Instruction {
            flow: Flow::JumpComputed,
            ..transfer
        },
        // PLD and PLI, which do nothing here.
        (PROGRAM_COUNTER, _) => of(Class::Plain),
        _ => transfer,
    })
}

fn multiply_divide(first: u32) -> Option<Instruction> {
    match bits(first, 4, 4) {
        9 | 11 => Some(of(Class::Divide)),
        15 => None,
        _ => Some(of(Class::Plain)),
    }
}
