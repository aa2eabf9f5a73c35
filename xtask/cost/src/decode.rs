//! Thumb-2 instructions of the Cortex-M4F, as far as their cost and their flow need.
//!
//! Armv7-M Architecture Reference Manual (DDI 0403E), chapters A5 and A6. Encodings that the
//! processor does not have, and those nobody met yet, are [`None`]: never a guess.

mod float;
mod wide;

/// What an instruction costs depends on this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// Arithmetic, logic, multiplication, moves, hints; floating point but what follows below.
    Plain,
    /// `SDIV`, `UDIV`.
    Divide,
    /// A load of one core register.
    Load,
    /// A store of one core register, address from a register and a constant.
    Store,
    /// A store of one core register, address from two registers.
    StoreIndexed,
    /// This many words loaded or stored: `LDM`, `PUSH`, `LDRD`, `VLDR`…
    Multiple(u8),
    /// `LDREX`, `STREX` and their kind.
    Exclusive,
    /// Any change of flow, but table branches and loads of the program counter.
    Branch,
    /// `TBB`, `TBH`.
    TableBranch,
    /// `IT` with the number of instructions that depend on it.
    IfThen(u8),
    /// `MRS`, `MSR`, `CPS`, moves between two core and two floating-point registers.
    Special,
    /// `DMB`, `DSB`, `ISB`.
    Barrier,
    /// `VMLA`, `VFMA` and their kind.
    FloatMultiplyAdd,
    /// `VDIV`, `VSQRT`.
    FloatDivide,
}

/// Where execution goes after an instruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// To the next one.
    Next,
    /// To this address, if the condition holds.
    Jump(u32),
    /// To this function, if the condition holds.
    Call(u32),
    /// To a function that a register names.
    CallComputed,
    /// To where a register or a table says.
    JumpComputed,
    /// Back to the caller, or out of an exception.
    Return,
}

/// One decoded instruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instruction {
    /// Length in bytes, 2 or 4.
    pub size: u8,
    /// What it costs.
    pub class: Class,
    /// Where it goes.
    pub flow: Flow,
    /// Registers a [`Class::Load`] writes, bit 0 = R0.
    pub loaded: u16,
    /// Registers the address of a [`Class::Load`] is made of.
    pub address: u16,
}

impl Instruction {
    const fn new(size: u8, class: Class, flow: Flow) -> Self {
        Self {
            size,
            class,
            flow,
            loaded: 0,
            address: 0,
        }
    }

    /// A load of `target` from an address made of the registers in `address`.
    const fn load(size: u8, target: u32, address: u16) -> Self {
        Self {
            size,
            class: Class::Load,
            flow: Flow::Next,
            loaded: 1 << target,
            address,
        }
    }
}

/// The length in bytes of the instruction that begins with `first`.
#[must_use]
pub const fn size(first: u16) -> u8 {
    if first >> 11 >= 0b11101 { 4 } else { 2 }
}

/// Decodes the instruction at `address`; `second` is ignored when it is a short one.
#[must_use]
pub fn decode(address: u32, first: u16, second: u16) -> Option<Instruction> {
    let pc = address.wrapping_add(4);
    if size(first) == 4 {
        wide::decode(pc, first.into(), second.into())
    } else {
        narrow(pc, first.into())
    }
}

/// `count` bits of `word` from bit `low`.
const fn bits(word: u32, low: u32, count: u32) -> u32 {
    (word >> low) & ((1 << count) - 1)
}

/// The low `count` bits of `word` as a signed distance, added to `pc`.
const fn relative(pc: u32, word: u32, count: u32) -> u32 {
    let shift = 32 - count;
    pc.wrapping_add_signed((word << shift).cast_signed() >> shift)
}

/// A 16-bit instruction.
fn narrow(pc: u32, code: u32) -> Option<Instruction> {
    const fn of(class: Class) -> Instruction {
        Instruction::new(2, class, Flow::Next)
    }
    let base = 1 << bits(code, 3, 3);
    let register = bits(code, 8, 3);
    Some(match bits(code, 10, 6) {
        0b01_0001 => special(code)?,
        // Shifts, additions, moves, comparisons; arithmetic and logic; addresses.
        0..=0b01_0000 | 0b10_1000..=0b10_1011 => of(Class::Plain),
        0b01_0010 | 0b01_0011 => Instruction::load(2, register, 0),
        0b01_0100..=0b01_0111 => match bits(code, 9, 3) {
            0..=2 => of(Class::StoreIndexed),
            _ => Instruction::load(2, bits(code, 0, 3), base | 1 << bits(code, 6, 3)),
        },
        0b01_1000..=0b10_0011 if bits(code, 11, 1) == 1 => {
            Instruction::load(2, bits(code, 0, 3), base)
        }
        0b10_0110 | 0b10_0111 => Instruction::load(2, register, 1 << 13),
        0b01_1000..=0b10_0101 => of(Class::Store),
        0b10_1100..=0b10_1111 => miscellaneous(pc, code)?,
        0b11_0000..=0b11_0011 => multiple(2, bits(code, 0, 8))?,
        0b11_0100..=0b11_0111 => match bits(code, 8, 4) {
            14 | 15 => of(Class::Plain),
            _ => Instruction::new(2, Class::Branch, Flow::Jump(relative(pc, code << 1, 9))),
        },
        0b11_1000 | 0b11_1001 => {
            Instruction::new(2, Class::Branch, Flow::Jump(relative(pc, code << 1, 12)))
        }
        _ => return None,
    })
}

/// Operations on all sixteen registers, and branches to one.
fn special(code: u32) -> Option<Instruction> {
    let target = bits(code, 0, 3) | bits(code, 7, 1) << 3;
    let source = bits(code, 3, 4);
    let computed = if source == 14 {
        Flow::Return
    } else {
        Flow::JumpComputed
    };
    let (class, flow) = match (bits(code, 8, 2), target) {
        (0, 15) => (Class::Branch, Flow::JumpComputed),
        (2, 15) => (Class::Branch, computed),
        (0..=2, _) => (Class::Plain, Flow::Next),
        (_, 0) => (Class::Branch, computed),
        (_, 8) => (Class::Branch, Flow::CallComputed),
        _ => return None,
    };
    Some(Instruction::new(2, class, flow))
}

/// Stack, compare-and-branch, hints, `IT`.
fn miscellaneous(pc: u32, code: u32) -> Option<Instruction> {
    let (class, flow) = match bits(code, 8, 4) {
        0 | 2 | 14 => (Class::Plain, Flow::Next),
        1 | 3 | 9 | 11 => {
            let distance = bits(code, 9, 1) << 6 | bits(code, 3, 5) << 1;
            (Class::Branch, Flow::Jump(pc.wrapping_add(distance)))
        }
        4 | 5 => return multiple(2, bits(code, 0, 9)),
        6 if code & 0xffe8 == 0xb660 => (Class::Special, Flow::Next),
        10 if bits(code, 6, 2) != 2 => (Class::Plain, Flow::Next),
        12 | 13 => {
            let pop = multiple(2, bits(code, 0, 9))?;
            let flow = match bits(code, 8, 1) {
                1 => Flow::Return,
                _ => Flow::Next,
            };
            return Some(Instruction { flow, ..pop });
        }
        15 if bits(code, 0, 4) != 0 => {
            let conditional = 4 - bits(code, 0, 4).trailing_zeros();
            (Class::IfThen(conditional as u8), Flow::Next)
        }
        15 if bits(code, 4, 4) <= 4 => (Class::Plain, Flow::Next),
        _ => return None,
    };
    Some(Instruction::new(2, class, flow))
}

/// A transfer of the registers in `list`.
fn multiple(size: u8, list: u32) -> Option<Instruction> {
    let words = list.count_ones() as u8;
    (words != 0).then_some(Instruction::new(size, Class::Multiple(words), Flow::Next))
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: u32 = 0x0800_1000;

    fn class(first: u16, second: u16) -> Option<Class> {
        decode(AT, first, second).map(|instruction| instruction.class)
    }

    fn flow(first: u16, second: u16) -> Option<Flow> {
        decode(AT, first, second).map(|instruction| instruction.flow)
    }

    #[test]
    fn encodings_that_the_processor_lacks_are_unknown() {
        let unknown = [
            (0xb600, 0),      // no CPS
            (0xb680, 0),      // no endianness change on Armv7-M
            (0xba80, 0),      // HLT, Armv8-M
            (0xbf50, 0),      // an unallocated hint
            (0xb400, 0),      // PUSH of nothing
            (0xe8d0, 0x0f20), // an unallocated exclusive
            (0xee30, 0x0b41), // VSUB.F64
            (0xfe00, 0x0a00), // VSEL, Armv8-M
            (0xee00, 0x0410), // coprocessor 4
            (0xf9a0, 0x0000), // advanced SIMD
            (0xfbf0, 0x0000), // an unallocated division
        ];
        for (first, second) in unknown {
            assert_eq!(class(first, second), None, "{first:04x} {second:04x}");
        }
    }

    #[test]
    fn branches_go_where_the_manual_says() {
        assert_eq!(flow(0xe7fe, 0), Some(Flow::Jump(AT)));
        assert_eq!(flow(0xd0fe, 0), Some(Flow::Jump(AT)));
        assert_eq!(flow(0xb108, 0), Some(Flow::Jump(AT + 6)));
        assert_eq!(flow(0xf000, 0xb800), Some(Flow::Jump(AT + 4)));
        assert_eq!(flow(0xf7ff, 0xfffe), Some(Flow::Call(AT)));
        assert_eq!(flow(0xf43f, 0xaffe), Some(Flow::Jump(AT)));
        assert_eq!(flow(0x4770, 0), Some(Flow::Return));
        assert_eq!(flow(0x4718, 0), Some(Flow::JumpComputed));
        assert_eq!(flow(0x4798, 0), Some(Flow::CallComputed));
        assert_eq!(flow(0xbd10, 0), Some(Flow::Return));
        assert_eq!(flow(0xe8bd, 0x8010), Some(Flow::Return));
        assert_eq!(flow(0xf85d, 0xfb04), Some(Flow::Return));
        assert_eq!(flow(0xe8df, 0xf000), Some(Flow::JumpComputed));
    }

    #[test]
    fn it_knows_how_many_instructions_it_governs() {
        assert_eq!(class(0xbf08, 0), Some(Class::IfThen(1)));
        assert_eq!(class(0xbf04, 0), Some(Class::IfThen(2)));
        assert_eq!(class(0xbf16, 0), Some(Class::IfThen(3)));
        assert_eq!(class(0xbf01, 0), Some(Class::IfThen(4)));
    }

    #[test]
    fn loads_know_their_registers() {
        let load = decode(AT, 0x58d1, 0).unwrap(); // ldr r1, [r2, r3]
        assert_eq!((load.loaded, load.address), (1 << 1, 1 << 2 | 1 << 3));
        let load = decode(AT, 0xf8d5, 0x4008).unwrap(); // ldr.w r4, [r5, #8]
        assert_eq!((load.loaded, load.address), (1 << 4, 1 << 5));
        let load = decode(AT, 0x9802, 0).unwrap(); // ldr r0, [sp, #8]
        assert_eq!((load.loaded, load.address), (1, 1 << 13));
    }
}
