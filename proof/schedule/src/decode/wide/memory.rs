//! Loads and stores of core registers, and jumps by a table.

use super::{
    super::{Access, indexed, transfer},
    Decoded, PROGRAM_COUNTER, bits, mask, register,
};
use crate::{Address, Operation};

/// A register that a load or store names as target: only a whole word may go to the program counter.
const fn target(word: u32, low: u32) -> Option<u8> {
    match register(word, low) {
        PROGRAM_COUNTER => None,
        register => Some(register),
    }
}

/// `LDM`, `STM`.
pub(super) fn multiple(first: u32, second: u32) -> Option<Decoded> {
    let base = register(first, 0);
    let list = second as u16;
    let words = list.count_ones() as u8;
    let bytes = 4 * i32::from(words);
    let has_writeback = bits(first, 5, 1) == 1;
    let (offset, distance) = match bits(first, 7, 2) {
        1 => (0, bytes),
        2 => (-bytes, -bytes),
        _ => return None,
    };
    if words == 0 || base == PROGRAM_COUNTER {
        return None;
    }
    let address = Address::Offset { base, offset };
    let writeback = has_writeback.then_some((base, distance));
    let is_load = bits(first, 4, 1) == 1;
    Some(transfer(
        is_load,
        (words, None, list),
        4,
        (address, writeback),
    ))
}

/// `LDRD`, `STRD`, exclusive loads and stores, table branches.
pub(super) fn dual_exclusive_table(pc: u32, first: u32, second: u32) -> Option<Decoded> {
    let is_before = bits(first, 8, 1) == 1;
    let has_writeback = bits(first, 5, 1) == 1;
    if !is_before && !has_writeback {
        return exclusive_or_table(first, second);
    }
    let place = indexed(pc, first, second)?;
    let (one, other) = (target(second, 12)?, target(second, 8)?);
    let is_load = bits(first, 4, 1) == 1;
    let is_possible = is_load || register(first, 0) != PROGRAM_COUNTER;
    let registers = (2, Some(one), mask(one) | mask(other));
    is_possible.then(|| transfer(is_load, registers, 4, place))
}

fn exclusive_or_table(first: u32, second: u32) -> Option<Decoded> {
    let is_load = bits(first, 4, 1) == 1;
    let base = register(first, 0);
    let is_word = bits(first, 7, 1) == 0;
    let kind = bits(second, 4, 4);
    if !is_word && kind < 2 {
        let table = Operation::TableJump {
            base,
            index: register(second, 0),
            entry_bytes: 1 + kind as u8,
        };
        return (is_load && bits(second, 8, 8) == 0xf0).then_some(Decoded::new(table));
    }
    let (offset, to) = match (is_word, kind) {
        (true, _) => (bits(second, 0, 8).cast_signed() * 4, register(second, 8)),
        (false, 4 | 5) => (0, register(second, 0)),
        _ => return None,
    };
    let address = Address::Offset { base, offset };
    let value = target(second, 12)?;
    if base == PROGRAM_COUNTER {
        return None;
    }
    Some(Decoded::new(if is_load {
        Operation::LoadExclusive {
            writes: mask(value),
            address,
        }
    } else if to == PROGRAM_COUNTER {
        return None;
    } else {
        Operation::StoreExclusive { to, address }
    }))
}

/// The address of a load or store of one register, and its writeback.
fn address(pc: u32, first: u32, second: u32) -> Option<Access> {
    let base = register(first, 0);
    let wide = bits(second, 0, 12).cast_signed();
    if base == PROGRAM_COUNTER {
        let offset = if bits(first, 7, 1) == 1 { wide } else { -wide };
        let address = (pc & !3).wrapping_add_signed(offset);
        return Some((Address::Absolute(address), None));
    }
    if bits(first, 7, 1) == 1 {
        return Some((Address::Offset { base, offset: wide }, None));
    }
    if bits(second, 11, 1) == 0 {
        let is_indexed = bits(second, 6, 5) == 0;
        let index = register(second, 0);
        let shift = bits(second, 4, 2) as u8;
        return is_indexed.then_some((Address::Indexed { base, index, shift }, None));
    }
    let small = bits(second, 0, 8).cast_signed();
    let is_before = bits(second, 10, 1) == 1;
    let has_writeback = bits(second, 8, 1) == 1;
    let distance = if bits(second, 9, 1) == 1 {
        small
    } else {
        -small
    };
    let offset = if is_before { distance } else { 0 };
    (is_before || has_writeback).then_some((
        Address::Offset { base, offset },
        has_writeback.then_some((base, distance)),
    ))
}

/// `LDR`, `STR` and their kind.
pub(super) fn single(pc: u32, first: u32, second: u32) -> Option<Decoded> {
    const WORD: u32 = 2;
    let is_load = bits(first, 4, 1) == 1;
    let size = bits(first, 5, 2);
    let is_signed = bits(first, 8, 1) == 1;
    if size > WORD || is_signed && (!is_load || size == WORD) {
        return None;
    }
    let value = register(second, 12);
    let (address, writeback) = address(pc, first, second)?;
    if value == PROGRAM_COUNTER && (!is_load || size != WORD) {
        // PLD and PLI, which do nothing here.
        let is_preload = is_load && writeback.is_none();
        return is_preload.then_some(Decoded::new(Operation::Nothing));
    }
    let is_possible = is_load || !matches!(address, Address::Absolute(_));
    let registers = (1, Some(value), mask(value));
    is_possible.then(|| transfer(is_load, registers, 1 << size, (address, writeback)))
}
