//! The abstract values of registers and stack slots: constants, distances, kinds of memory.
//!
//! The analysis assumes a memory-safe Rust program:
//!
//! * a pointer is made from another by adding to it, and stays in the memory of the other;
//! * small integers are not addresses;
//! * a slot of a function's frame changes only through pointers into the frame, each of which reaches
//!   the memory above it;
//! * a pointer that is replaced through a pointer kept in memory, or in a static by its address, is
//!   replaced by a pointer into the same kind of memory;
//! * an `enum` has one of its values, where a jump table would lead to a trap.
//!
//! `--replay` checks the outcome.

mod flags;
mod memory;
mod sorted;
mod state;
mod transfer;

pub(crate) use flags::Flags;
pub(crate) use memory::{sources, targets};
pub(crate) use state::{Callees, Spans, State, Surroundings};

use crate::Region;

/// Number of registers that hold arguments: R0 to R3.
pub(crate) const ARGUMENTS: u8 = 4;
/// Below it there is no memory that a program uses.
const FIRST_MEMORY: u32 = 0x0800_0000;
/// Aliases in which each word is a bit of the first megabyte of SRAM or of the peripherals: a store is a
/// read and a write that nothing comes between. ARMv7-M reference manual, B3.1.
const BIT_BAND_SRAM: u32 = 0x2200_0000;
const BIT_BAND_PERIPHERALS: u32 = 0x4200_0000;
/// Peripherals whose waits no manual tells: both USB controllers, camera, cryptography. RM0090 table 1.
const USB_HIGH_SPEED: u32 = 0x4004_0000;
const USB_FULL_SPEED: u32 = 0x5000_0000;
const CAMERA: u32 = 0x5004_0000;

impl Region {
    /// The region of an address.
    pub const fn of(address: u32) -> Self {
        match address {
            FIRST_MEMORY..0x0820_0000 => Self::Flash,
            0x1000_0000..0x1001_0000 => Self::Ccm,
            BIT_BAND_SRAM..0x2400_0000
            | USB_HIGH_SPEED..BIT_BAND_PERIPHERALS
            | BIT_BAND_PERIPHERALS..0x4400_0000
            | CAMERA..0xe000_0000 => Self::Uncosted,
            0x2000_0000..0x4000_0000 => Self::Sram,
            0x4000_0000..0x4001_0000 => Self::Apb1,
            0x4001_0000..0x4002_0000 => Self::Apb2,
            0x4002_0000..USB_FULL_SPEED => Self::Ahb,
            USB_FULL_SPEED..CAMERA => Self::Usb,
            0xe000_0000..0xe010_0000 => Self::Private,
            _ => Self::Unknown,
        }
    }

    fn join(self, other: Self) -> Self {
        if self == other { self } else { Self::Unknown }
    }
}

/// A value that is not known, but that others are a known distance from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Base {
    /// The stack pointer where the function begins.
    Stack,
    /// The value of this register where the function begins.
    Entry(u8),
    /// The last value that the instruction at this address wrote to this register.
    Written(u32, u8),
    /// The word at an offset from the value that this register has where the function begins, when it
    /// was loaded last.
    LoadedFrom(u8, i32),
}

/// An abstract value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Value {
    Constant(u32),
    /// `offset` bytes from `base`; if it is a pointer, then into `region`.
    From {
        base: Base,
        offset: i32,
        region: Region,
    },
    /// If it is a pointer, then into `region`, and made from one of `origins`.
    In {
        region: Region,
        origins: Origins,
    },
}

/// Where a pointer may be from, apart from constants and memory: the function's frame, and what
/// it was called with. A mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Origins(u8);

impl Origins {
    pub(crate) const NONE: Self = Self(0);
    pub(crate) const FRAME: Self = Self(1 << ARGUMENTS);
    pub(crate) const ALL: Self = Self((1 << (ARGUMENTS + 1)) - 1);

    pub(crate) const fn argument(register: u8) -> Self {
        if register < ARGUMENTS {
            Self(1 << register)
        } else {
            Self::NONE
        }
    }

    pub(crate) const fn contains(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Value {
    pub(crate) const UNKNOWN: Self = Self::of(Region::Unknown, Origins::NONE);

    pub(crate) const fn of(region: Region, origins: Origins) -> Self {
        Self::In { region, origins }
    }

    /// The pointers from which the value may be made.
    pub(crate) const fn origins(self) -> Origins {
        match self {
            Self::Constant(_) => Origins::NONE,
            Self::In { origins, .. } => origins,
            Self::From { base, .. } => match base {
                Base::Stack => Origins::FRAME,
                Base::Entry(register) => Origins::argument(register),
                Base::Written(..) | Base::LoadedFrom(..) => Origins::NONE,
            },
        }
    }

    /// The memory that it points into.
    pub(crate) const fn region(self) -> Region {
        match self {
            Self::Constant(address) => Region::of(address),
            Self::From { region, .. } | Self::In { region, .. } => region,
        }
    }

    pub(crate) const fn constant(self) -> Option<u32> {
        match self {
            Self::Constant(value) => Some(value),
            Self::From { .. } | Self::In { .. } => None,
        }
    }

    /// The argument register to which the address is relative, and the offset.
    pub(crate) const fn argument_offset(self) -> Option<(u8, i32)> {
        match self {
            Self::From {
                base: Base::Entry(register),
                offset,
                ..
            } if register < ARGUMENTS => Some((register, offset)),
            _ => None,
        }
    }

    /// Whether the value was loaded from this offset of an argument.
    pub(crate) fn is_loaded_from_argument(self, register: u8, distance: i32) -> bool {
        let place = Base::LoadedFrom(register, distance);
        matches!(self, Self::From { base, offset: 0, .. } if base == place)
    }

    /// Where it is in the function's frame, in bytes from the stack pointer at its beginning.
    pub(crate) const fn in_frame(self) -> Option<i32> {
        match self {
            Self::From {
                base: Base::Stack,
                offset,
                ..
            } => Some(offset),
            _ => None,
        }
    }

    const fn is_no_address(self) -> bool {
        matches!(self, Self::Constant(0..FIRST_MEMORY))
    }

    /// The join of both values.
    pub(crate) fn join(self, other: Self) -> Self {
        if self == other {
            return self;
        }
        let region = if self.is_no_address() {
            other.region()
        } else if other.is_no_address() {
            self.region()
        } else {
            self.region().join(other.region())
        };
        match (self, other) {
            (
                Self::From { base, offset, .. },
                Self::From {
                    base: b, offset: o, ..
                },
            ) if (base, offset) == (b, o) => Self::From {
                base,
                offset,
                region,
            },
            _ => Self::of(region, self.origins().and(other.origins())),
        }
    }

    pub(crate) fn add(self, distance: i32) -> Self {
        match self {
            Self::Constant(value) => Self::Constant(value.wrapping_add_signed(distance)),
            Self::From {
                base,
                offset,
                region,
            } => Self::From {
                base,
                offset: offset.wrapping_add(distance),
                region,
            },
            Self::In { .. } => self,
        }
    }

    /// The sum of a pointer and an index, whichever is which.
    fn sum(self, other: Self) -> Self {
        let region = match (self.region(), other.region()) {
            (region, Region::Unknown) | (Region::Unknown, region) => region,
            _ => Region::Unknown,
        };
        match (self, other) {
            (Self::Constant(index), value) | (value, Self::Constant(index))
                if value.region() == region =>
            {
                value.add(index.cast_signed())
            }
            _ => Self::of(region, self.origins().and(other.origins())),
        }
    }

    /// Somewhere in the memory that this points into.
    fn indexed(self) -> Self {
        Self::of(self.region(), self.origins())
    }

    /// Without its base: outside the function it has no meaning.
    pub(crate) fn abroad(self) -> Self {
        match self {
            Self::Constant(_) => self,
            Self::From { region, .. } | Self::In { region, .. } => Self::of(region, Origins::NONE),
        }
    }
}
