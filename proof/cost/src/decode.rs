//! The properties of an instruction on which its cost and flow depend.
//!
//! The decoder is that of the timing analysis. What it does not know is [`None`]: never a guess.

pub use schedule::decode::size;
use schedule::{
    Address, Decoder, Operation,
    decode::{DIVIDE, MOVE_TWO, MULTIPLY_ADD},
};

/// The class of an instruction, which decides its cost.
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
    /// `IT` with the number of conditional instructions after it.
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
    /// Its cost.
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
}

/// Decodes the instruction at `address`; `second` is ignored when it is a short one.
pub fn decode(address: u32, first: u16, second: u16) -> Option<Instruction> {
    let decoded = Decoder::new().decode(address, [first, second]).ok()?;
    let class = class(&decoded.operation, first);
    let mut instruction = Instruction::new(decoded.bytes, class, flow(&decoded.operation, first));
    if let (
        Class::Load,
        Operation::Load {
            writes, address, ..
        },
    ) = (class, decoded.operation)
    {
        instruction.loaded = writes;
        instruction.address = registers(address);
    }
    Some(instruction)
}

fn class(operation: &Operation, first: u16) -> Class {
    match *operation {
        Operation::Divide { .. } => Class::Divide,
        Operation::Load { words: 1, .. } if !is_list(first) => Class::Load,
        Operation::Store {
            words: 1, address, ..
        } if !is_list(first) => match address {
            Address::Indexed { .. } => Class::StoreIndexed,
            Address::Offset { .. } | Address::Absolute(_) => Class::Store,
        },
        Operation::Load { words, .. }
        | Operation::Store { words, .. }
        | Operation::FloatLoad { words, .. }
        | Operation::FloatStore { words, .. } => Class::Multiple(words),
        Operation::LoadExclusive { .. } | Operation::StoreExclusive { .. } => Class::Exclusive,
        Operation::Jump(_)
        | Operation::Call(_)
        | Operation::JumpOnZero { .. }
        | Operation::JumpRegister(_)
        | Operation::CallRegister(_)
        | Operation::JumpComputed => Class::Branch,
        Operation::TableJump { .. } => Class::TableBranch,
        Operation::IfThen(count) => Class::IfThen(count),
        Operation::Interrupts { .. }
        | Operation::ReadSpecial { .. }
        | Operation::WriteSpecial { .. }
        | Operation::Float {
            cycles: MOVE_TWO, ..
        } => Class::Special,
        Operation::Barrier => Class::Barrier,
        Operation::Float {
            cycles: MULTIPLY_ADD,
            ..
        } => Class::FloatMultiplyAdd,
        Operation::Float { cycles: DIVIDE, .. } => Class::FloatDivide,
        _ => Class::Plain,
    }
}

fn flow(operation: &Operation, first: u16) -> Flow {
    const MOV_PC_LR: u16 = 0x46f7;
    match *operation {
        Operation::Jump(to) | Operation::JumpOnZero { to, .. } => Flow::Jump(to),
        Operation::Call(to) => Flow::Call(to),
        Operation::CallRegister(_) => Flow::CallComputed,
        Operation::JumpRegister(14) => Flow::Return,
        Operation::JumpComputed if first == MOV_PC_LR => Flow::Return,
        Operation::JumpRegister(_) | Operation::JumpComputed | Operation::TableJump { .. } => {
            Flow::JumpComputed
        }
        Operation::Load {
            writes,
            words,
            address,
            ..
        } if writes & 0x8000 != 0 => match address {
            Address::Offset { base: 13, .. } => Flow::Return,
            _ if words > 1 => Flow::Return,
            _ => Flow::JumpComputed,
        },
        _ => Flow::Next,
    }
}

/// Whether a short instruction loads or stores a list of registers, be it of one.
const fn is_list(first: u16) -> bool {
    size(first) == 2 && matches!(first >> 12, 0b1011 | 0b1100)
}

/// The registers that an address is made of.
const fn registers(address: Address) -> u16 {
    match address {
        Address::Absolute(_) => 0,
        Address::Offset { base, .. } => 1 << base,
        Address::Indexed { base, index, .. } => 1 << base | 1 << index,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: u32 = 0x0800_1000;

    fn flow(first: u16, second: u16) -> Option<Flow> {
        decode(AT, first, second).map(|instruction| instruction.flow)
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
    fn loads_know_their_registers() {
        let load = decode(AT, 0x58d1, 0).unwrap(); // ldr r1, [r2, r3]
        assert_eq!((load.loaded, load.address), (1 << 1, 1 << 2 | 1 << 3));
        let load = decode(AT, 0xf8d5, 0x4008).unwrap(); // ldr.w r4, [r5, #8]
        assert_eq!((load.loaded, load.address), (1 << 4, 1 << 5));
        let load = decode(AT, 0x9802, 0).unwrap(); // ldr r0, [sp, #8]
        assert_eq!((load.loaded, load.address), (1, 1 << 13));
    }
}
