//! Instructions of the Cortex-M4F, as far as time, flow and constants need them.

/// Registers that a call does not keep: R0 to R3, R12 and LR.
pub(crate) const CALL_WRITES: u16 = 0x500f;

/// Where a load or store goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Address {
    /// To this address: relative to the program counter.
    Absolute(u32),
    /// To a register plus a constant.
    Offset {
        /// The register.
        base: u8,
        /// Bytes added before the access.
        offset: i32,
    },
    /// To a register plus another.
    Indexed {
        /// The register.
        base: u8,
        /// The other.
        index: u8,
        /// Bits by which that is shifted to the left.
        shift: u8,
    },
}

/// A register that an access moves on, and by how many bytes.
pub type Writeback = (u8, i32);

/// The effect of an instruction. Masks of registers have bit 0 = R0.
#[expect(missing_docs, reason = "the fields are named after what they are")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operation {
    /// A register becomes a constant.
    Constant { to: u8, value: u32 },
    /// The upper half of a register becomes a constant.
    ConstantTop { to: u8, value: u16 },
    /// A register becomes another.
    Copy { to: u8, from: u8 },
    /// `to = from + value`, with or without flags.
    Add { to: u8, from: u8, value: i32 },
    /// `to = left + right`; `right` is `None` when it is shifted.
    AddRegister { to: u8, left: u8, right: Option<u8> },
    /// `to = from | value`.
    Or { to: u8, from: u8, value: u32 },
    /// A comparison with a constant.
    Compare { left: u8, value: u32 },
    /// A comparison of two registers.
    CompareRegisters { left: u8, right: u8 },
    /// Any other operation of one cycle, with the written registers.
    Plain { writes: u16 },
    /// A multiplication; `added`: the register that is added to the product.
    Multiply { writes: u16, added: Option<u8> },
    /// `SDIV`, `UDIV`.
    Divide { writes: u16 },
    /// Loads of `words` registers, each of `bytes` bytes. `first`: the first register, when they are
    /// one or two.
    Load {
        writes: u16,
        first: Option<u8>,
        words: u8,
        bytes: u8,
        address: Address,
        writeback: Option<Writeback>,
    },
    /// Stores of `words` registers, each of `bytes` bytes. `source`: the first register, when they
    /// are one or two; `reads`: all of them.
    Store {
        words: u8,
        address: Address,
        writeback: Option<Writeback>,
        source: Option<u8>,
        reads: u16,
        bytes: u8,
    },
    /// `LDREX` and its kind.
    LoadExclusive { writes: u16, address: Address },
    /// `STREX` and its kind; `to` is 0 on success.
    StoreExclusive { to: u8, address: Address },
    /// `CLREX`.
    ClearExclusive,
    /// A jump to a constant address, if the condition holds.
    Jump(u32),
    /// A call of a constant address.
    Call(u32),
    /// `CBZ`, `CBNZ`: a jump, if a register is zero or is not.
    JumpOnZero {
        register: u8,
        to: u32,
        is_zero: bool,
    },
    /// `BX`: a jump to a register; to LR it is a return.
    JumpRegister(u8),
    /// `BLX`: a call of a register.
    CallRegister(u8),
    /// `MOV PC, Rm`, `ADD PC, Rm`.
    JumpComputed,
    /// `TBB`, `TBH`: a jump by a table, `entry_bytes` an entry.
    TableJump {
        base: u8,
        index: u8,
        entry_bytes: u8,
    },
    /// `IT`: so many instructions depend on a condition.
    IfThen(u8),
    /// `NOP` and hints that do not wait.
    Nothing,
    /// `WFI`, `WFE`: waits.
    Wait,
    /// `CPSID` and `CPSIE`: of `PRIMASK` (`i`), of `FAULTMASK` (`f`), or of both.
    Interrupts {
        off: bool,
        primask: bool,
        faultmask: bool,
    },
    /// `MRS`: reads a special register by its number.
    ReadSpecial { register: u8, to: u8 },
    /// `MSR`: writes a special register by its number (`SYSm`; 17 `BASEPRI`, 18 `BASEPRI_MAX`,
    /// 16 `PRIMASK`).
    WriteSpecial { register: u8, from: u8 },
    /// `DMB`, `DSB`, `ISB`.
    Barrier,
    /// `UDF`, `BKPT`.
    Trap,
    /// `SVC`.
    Supervisor,
    /// A floating-point operation of so many cycles, and the core registers that it writes.
    Float { cycles: u8, writes: u16 },
    /// `VLDR`, `VLDM`, `VPOP`.
    FloatLoad {
        words: u8,
        address: Address,
        writeback: Option<Writeback>,
    },
    /// `VSTR`, `VSTM`, `VPUSH`.
    FloatStore {
        words: u8,
        address: Address,
        writeback: Option<Writeback>,
    },
}

impl Operation {
    /// The address of a memory access, and its writeback.
    pub const fn access(&self) -> Option<(Address, Option<Writeback>)> {
        match *self {
            Self::Load {
                address, writeback, ..
            }
            | Self::Store {
                address, writeback, ..
            }
            | Self::FloatLoad {
                address, writeback, ..
            }
            | Self::FloatStore {
                address, writeback, ..
            } => Some((address, writeback)),
            Self::LoadExclusive { address, .. } | Self::StoreExclusive { address, .. } => {
                Some((address, None))
            }
            _ => None,
        }
    }

    /// The address of a store, and how many bytes it writes.
    pub fn stored(&self) -> Option<(Address, i32)> {
        match *self {
            Self::Store {
                address,
                words,
                bytes,
                ..
            } => Some((address, i32::from(words) * i32::from(bytes))),
            Self::FloatStore { address, words, .. } => Some((address, 4 * i32::from(words))),
            Self::StoreExclusive { address, .. } => Some((address, 4)),
            _ => None,
        }
    }

    /// The registers that an operation may write, including the registers that a call does not
    /// preserve.
    pub fn writes(&self) -> u16 {
        let moved =
            |writeback: Option<Writeback>| writeback.map_or(0, |(register, _)| 1 << register);
        match *self {
            Self::Constant { to, .. }
            | Self::ConstantTop { to, .. }
            | Self::Copy { to, .. }
            | Self::Add { to, .. }
            | Self::AddRegister { to, .. }
            | Self::Or { to, .. }
            | Self::ReadSpecial { to, .. }
            | Self::StoreExclusive { to, .. } => 1 << to,
            Self::Plain { writes }
            | Self::Multiply { writes, .. }
            | Self::Divide { writes }
            | Self::LoadExclusive { writes, .. }
            | Self::Float { writes, .. } => writes,
            Self::Load {
                writes, writeback, ..
            } => writes | moved(writeback),
            Self::Store { writeback, .. }
            | Self::FloatLoad { writeback, .. }
            | Self::FloatStore { writeback, .. } => moved(writeback),
            Self::Call(_) | Self::CallRegister(_) => CALL_WRITES,
            _ => 0,
        }
    }

    /// Whether it is one of the floating-point unit.
    pub const fn is_float(&self) -> bool {
        matches!(
            self,
            Self::Float { .. } | Self::FloatLoad { .. } | Self::FloatStore { .. }
        )
    }
}

/// One decoded instruction at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instruction {
    /// Where it is.
    pub address: u32,
    /// Its length, 2 or 4 bytes.
    pub bytes: u8,
    /// Its effect.
    pub operation: Operation,
    /// Its condition as encoded; 14: always.
    pub condition: u8,
    /// Whether an `IT` before it gives the condition.
    pub in_if_then: bool,
    /// Whether it writes the condition flags, all or some.
    pub sets_flags: bool,
}

impl Instruction {
    /// The address after its end.
    pub const fn end(&self) -> u32 {
        self.address + self.bytes as u32
    }

    /// Whether it depends on the flags.
    pub const fn is_conditional(&self) -> bool {
        self.condition != 14
    }

    /// Whether it returns to the caller, or from an exception.
    pub const fn is_return(&self) -> bool {
        match self.operation {
            Operation::JumpRegister(14) => true,
            Operation::Load {
                writes,
                address: Address::Offset { base: 13, .. },
                ..
            } => writes & 0x8000 != 0,
            _ => false,
        }
    }
}
