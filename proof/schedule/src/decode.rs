//! Thumb-2 instructions of the Cortex-M4F: Armv7E-M with FPv4-SP.
//!
//! Armv7-M Architecture Reference Manual (DDI 0403E), chapters A5 to A7. Encodings that the
//! processor does not have, and those nobody met yet, are [`Unknown`]: never a guess.

mod float;
mod narrow;
mod wide;

use std::{error::Error, fmt};

pub use float::{DIVIDE, MOVE_TWO, MULTIPLY_ADD};

use crate::{Address, Instruction, Operation, Writeback};

/// The condition of what is executed always.
pub(crate) const ALWAYS: u8 = 14;

/// An encoding that the decoder does not know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unknown {
    /// Where it is.
    pub address: u32,
    /// Its halves; the second is without meaning when it is a short one.
    pub code: [u16; 2],
}

impl fmt::Display for Unknown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = self.code;
        write!(f, "the decoder does not know the instruction {first:04x}")?;
        if size(first) == 4 {
            write!(f, " {second:04x}")?;
        }
        write!(f, " at {:#010x}", self.address)
    }
}

impl Error for Unknown {}

/// When an instruction writes the condition flags.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Flags {
    Kept,
    Set,
    /// Only where no `IT` is before it.
    SetOutsideIfThen,
}

/// An instruction without its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Decoded {
    operation: Operation,
    /// Its own condition: of a branch.
    condition: Option<u8>,
    flags: Flags,
}

impl Decoded {
    const fn new(operation: Operation) -> Self {
        Self::with(operation, Flags::Kept)
    }

    const fn with(operation: Operation, flags: Flags) -> Self {
        Self {
            operation,
            condition: None,
            flags,
        }
    }
}

/// The length in bytes of the instruction that begins with `first`.
pub const fn size(first: u16) -> u8 {
    if first >> 11 >= 0b11101 { 4 } else { 2 }
}

/// Decodes consecutive instructions; the conditions of an `IT` are kept for the instructions after
/// it.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    /// Conditions of the last `IT` for the next instructions, in reverse order.
    conditions: Vec<u8>,
}

impl Decoder {
    /// A decoder that no `IT` has gone through.
    pub fn new() -> Self {
        Self::default()
    }

    /// Decodes the instruction at `address`; the second half is ignored when it is a short one.
    ///
    /// # Errors
    ///
    /// When the encoding is not known.
    pub fn decode(&mut self, address: u32, code: [u16; 2]) -> Result<Instruction, Unknown> {
        let given = self.conditions.pop();
        let bytes = size(code[0]);
        let (first, second) = (u32::from(code[0]), u32::from(code[1]));
        let pc = address.wrapping_add(4);
        let decoded = if bytes == 4 {
            wide::decode(pc, first, second)
        } else {
            narrow::decode(pc, first)
        };
        let decoded = decoded.ok_or(Unknown { address, code })?;
        if let Operation::IfThen(count) = decoded.operation {
            self.conditions = if_then(first, count);
        }
        Ok(Instruction {
            address,
            bytes,
            operation: decoded.operation,
            condition: given.or(decoded.condition).unwrap_or(ALWAYS),
            in_if_then: given.is_some(),
            sets_flags: match decoded.flags {
                Flags::Kept => false,
                Flags::Set => true,
                Flags::SetOutsideIfThen => given.is_none(),
            },
        })
    }
}

/// The conditions that an `IT` gives to `count` instructions, the first of them last.
fn if_then(code: u32, count: u8) -> Vec<u8> {
    let condition = bits(code, 4, 4) as u8;
    let parity = |index: u8| bits(code, u32::from(4 - index), 1) as u8;
    (1..count)
        .rev()
        .map(|index| condition & !1 | parity(index))
        .chain([condition])
        .collect()
}

/// `count` bits of `word` from bit `low`.
const fn bits(word: u32, low: u32, count: u32) -> u32 {
    (word >> low) & ((1 << count) - 1)
}

/// A register's number in `word` from bit `low`, of four bits.
const fn register(word: u32, low: u32) -> u8 {
    bits(word, low, 4) as u8
}

/// The mask of one register.
const fn mask(register: u8) -> u16 {
    1 << register
}

/// The low `count` bits of `word` as a signed distance, added to `pc`.
const fn relative(pc: u32, word: u32, count: u32) -> u32 {
    let shift = 32 - count;
    pc.wrapping_add_signed((word << shift).cast_signed() >> shift)
}

/// Where a load or store is, and its writeback.
type Access = (Address, Option<Writeback>);

/// A load or store of registers of `bytes` bytes each: how many words, the first of one or two, and all.
const fn transfer(
    is_load: bool,
    (words, first, registers): (u8, Option<u8>, u16),
    bytes: u8,
    (address, writeback): Access,
) -> Decoded {
    Decoded::new(if is_load {
        Operation::Load {
            writes: registers,
            first,
            words,
            bytes,
            address,
            writeback,
        }
    } else {
        Operation::Store {
            words,
            address,
            writeback,
            source: first,
            reads: registers,
            bytes,
        }
    })
}

/// The place of a load or store of words, at a distance from a register that may be written back.
fn indexed(pc: u32, first: u32, second: u32) -> Option<Access> {
    const PROGRAM_COUNTER: u8 = 15;
    let has_writeback = bits(first, 5, 1) == 1;
    let base = register(first, 0);
    let bytes = bits(second, 0, 8).cast_signed() * 4;
    let is_up = bits(first, 7, 1) == 1;
    let distance = if is_up { bytes } else { -bytes };
    let is_before = bits(first, 8, 1) == 1;
    let offset = if is_before { distance } else { 0 };
    let address = match (base, has_writeback) {
        (PROGRAM_COUNTER, false) => Address::Absolute((pc & !3).wrapping_add_signed(offset)),
        (PROGRAM_COUNTER, true) => return None,
        _ => Address::Offset { base, offset },
    };
    Some((address, has_writeback.then_some((base, distance))))
}

#[cfg(test)]
mod tests;
