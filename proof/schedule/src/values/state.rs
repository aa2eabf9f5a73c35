//! The abstract state at one place of a function: registers, flags and the frame.

use std::{
    borrow::Cow,
    collections::{BTreeMap, BTreeSet},
};

use super::{ARGUMENTS, Base, Flags, Origins, Value, sorted::SortedMap};
use crate::{Address, Block, Image, Instruction, Operation, Region};

const STACK_POINTER: u8 = 13;
const PROGRAM_COUNTER: u8 = 15;
/// Bytes from an argument up to which its memory is described to the called function.
const DESCRIBED: i32 = 256;

/// Byte offsets from a pointer: from the first to before the second.
pub(crate) type Spans = Vec<(i32, i32)>;

/// Summaries of the functions that a function calls.
#[derive(Debug, Clone, Default)]
pub(crate) struct Callees {
    /// Functions that write to the part of their caller's frame that holds their arguments.
    pub(crate) write_arguments: BTreeSet<u32>,
    /// Bytes that each function writes through each of its arguments; a missing function may write
    /// anything.
    pub(crate) writes: BTreeMap<u32, [Spans; ARGUMENTS as usize]>,
    /// The memory that their results point into, where it is known.
    pub(crate) results: BTreeMap<u32, Region>,
    /// The memory that words at constant addresses point into, where it is known.
    pub(crate) statics: BTreeMap<u32, Region>,
}

/// The constant context of a state.
#[derive(Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    pub(crate) image: &'a Image,
    /// Without it nothing is known of what calls do.
    pub(crate) callees: Option<&'a Callees>,
    /// The lowest slot of the function's frame to which the function makes a pointer, in bytes from
    /// the stack pointer at its beginning: lower slots change only by the function's own stores.
    pub(crate) lowest_pointer: i32,
}

/// See the module.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct State {
    registers: [Value; 16],
    pub(super) flags: Flags,
    /// Words of the frame, by their distance from the stack pointer at the function's beginning.
    pub(super) slots: SortedMap<i32, Value>,
    /// The memory into which words at an offset from an argument point, by register and offset.
    pub(super) given: SortedMap<(u8, i32), Region>,
    /// After an `IT` with an unknown condition, this state holds where the condition does, and the
    /// other state where it does not.
    otherwise: Option<Box<Otherwise>>,
}

/// The condition that does not hold, and the state then.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Otherwise {
    condition: u8,
    state: State,
}

impl State {
    /// At the beginning of a function of which no call is known.
    pub(crate) fn at_entry() -> Self {
        let registers = std::array::from_fn(|register| {
            let register = register as u8;
            let (base, region) = match register {
                STACK_POINTER => (Base::Stack, Region::Sram),
                _ => (Base::Entry(register), Region::Unknown),
            };
            Value::From {
                base,
                offset: 0,
                region,
            }
        });
        Self {
            registers,
            flags: Flags::default(),
            slots: SortedMap::new(),
            given: SortedMap::new(),
            otherwise: None,
        }
    }

    /// At the beginning of a function that is called in this state.
    pub(crate) fn called(&self) -> Self {
        let mut state = Self::at_entry();
        for register in 0..ARGUMENTS {
            state.registers[usize::from(register)] = match self.get(register).abroad() {
                Value::In { region, .. } => Value::From {
                    base: Base::Entry(register),
                    offset: 0,
                    region,
                },
                known => known,
            };
        }
        if let Some(top) = self.get(STACK_POINTER).in_frame() {
            let arguments = self.slots.range(top..);
            state.slots = arguments
                .map(|(offset, value)| (offset - top, value.abroad()))
                .collect();
        }
        for register in 0..ARGUMENTS {
            for (offset, region) in self.pointee_regions(self.get(register)) {
                state.given.insert((register, offset), region);
            }
        }
        state
    }

    /// The memory into which words at an offset from a pointer point, by offset.
    fn pointee_regions(&self, pointer: Value) -> Vec<(i32, Region)> {
        let mut found = Vec::new();
        if let Some(start) = pointer.in_frame() {
            let slots = self.slots.range(start..start.saturating_add(DESCRIBED));
            found.extend(slots.map(|(slot, value)| (slot - start, value.region())));
        } else if let Some((register, start)) = pointer.argument_offset() {
            let end = start.saturating_add(DESCRIBED);
            let given = self.given.range((register, start)..(register, end));
            found.extend(given.map(|((_, offset), region)| (offset - start, region)));
        }
        found.retain(|&(_, region)| region != Region::Unknown);
        found
    }

    /// The join of two states: only what holds in both.
    pub(crate) fn join(&self, other: &Self) -> Self {
        let mut registers = self.registers;
        for (value, other) in registers.iter_mut().zip(other.registers) {
            *value = value.join(other);
        }
        Self {
            registers,
            flags: self.flags.join(other.flags),
            slots: self
                .slots
                .join(&other.slots, |value, other| Some(value.join(other))),
            given: self
                .given
                .join(&other.given, |one, other| (one == other).then_some(one)),
            otherwise: self.otherwise.clone(),
        }
    }

    pub(crate) fn get(&self, register: u8) -> Value {
        self.registers[usize::from(register)]
    }

    pub(crate) const fn flags(&self) -> Flags {
        self.flags
    }

    /// The address of an access, before anything is written back.
    pub(crate) fn address(&self, address: Address) -> Value {
        match address {
            Address::Absolute(address) => Value::Constant(address),
            Address::Offset { base, offset } => self.get(base).add(offset),
            Address::Indexed { base, index, shift } => {
                let (base, index) = (self.get(base), self.get(index));
                match (base.constant(), index.constant()) {
                    (Some(base), Some(index)) => {
                        Value::Constant(base.wrapping_add(index << (shift & 3)))
                    }
                    _ => base.indexed(),
                }
            }
        }
    }

    /// Follows `instruction`: if its condition is not known, in both states.
    pub(crate) fn step(&mut self, around: Surroundings<'_>, instruction: &Instruction) {
        if !instruction.in_if_then || matches!(instruction.operation, Operation::Jump(_)) {
            self.settle();
            if !matches!(instruction.operation, Operation::Jump(_)) {
                self.transfer(around, instruction);
            }
            return;
        }
        let condition = instruction.condition;
        let known = self.otherwise.as_ref().map(|other| other.condition);
        if known.is_some_and(|known| known | 1 != condition | 1) {
            self.settle();
        }
        if self.otherwise.is_none() {
            match self.flags.holds(condition) {
                Some(true) => return self.transfer(around, instruction),
                Some(false) => return,
                None => {
                    let state = self.clone();
                    self.otherwise = Some(Box::new(Otherwise { condition, state }));
                }
            }
        }
        self.branch(around, instruction);
    }

    /// Follows an instruction after an `IT` in the state in which it is executed.
    fn branch(&mut self, around: Surroundings<'_>, instruction: &Instruction) {
        let Some(mut other) = self.otherwise.take() else {
            return;
        };
        let is_here = other.condition == instruction.condition;
        if instruction.is_return() {
            // The next instruction follows only if this one did not return.
            if is_here {
                *self = other.state;
            }
            return;
        }
        if is_here {
            self.transfer(around, instruction);
        } else {
            other.state.transfer(around, instruction);
        }
        self.otherwise = Some(other);
        if instruction.sets_flags {
            self.settle();
        }
    }

    /// Executes a block.
    pub(crate) fn pass(&mut self, around: Surroundings<'_>, block: &Block) {
        for instruction in &block.instructions {
            self.step(around, instruction);
        }
        self.settle();
    }

    /// Joins the two states of an `IT`.
    pub(crate) fn settle(&mut self) {
        if let Some(other) = self.otherwise.take() {
            *self = self.join(&other.state);
        }
    }

    /// The state in which `instruction`, the next, is executed.
    pub(crate) fn before(&self, instruction: &Instruction) -> Cow<'_, Self> {
        match &self.otherwise {
            None => Cow::Borrowed(self),
            Some(other) if !instruction.in_if_then => Cow::Owned(self.join(&other.state)),
            Some(other) if other.condition == instruction.condition => Cow::Borrowed(self),
            Some(other) if other.condition ^ 1 == instruction.condition => {
                Cow::Borrowed(&other.state)
            }
            Some(other) => Cow::Owned(self.join(&other.state)),
        }
    }

    pub(super) fn set(&mut self, register: u8, value: Value) {
        // Wherever the stack pointer comes from, it points to the stack.
        let value = match value {
            Value::In { .. } if register == STACK_POINTER => {
                Value::of(Region::Sram, Origins::FRAME)
            }
            value => value,
        };
        if register != PROGRAM_COUNTER {
            self.registers[usize::from(register)] = value;
        }
    }

    /// `register` gets a value that is not known; if it is a pointer, then into `region`.
    pub(super) fn write(&mut self, at: u32, register: u8, region: Region) {
        self.write_as(Base::Written(at, register), register, region);
    }

    /// `register` gets the value that is called `base` from now on.
    pub(super) fn write_as(&mut self, base: Base, register: u8, region: Region) {
        // An older value with the same base is another value.
        let known = self.registers.iter_mut().chain(self.slots.values_mut());
        for value in known {
            match *value {
                Value::From {
                    base: other,
                    region,
                    ..
                } if other == base => *value = Value::of(region, Origins::NONE),
                _ => {}
            }
        }
        let value = if register == STACK_POINTER {
            Value::UNKNOWN
        } else {
            Value::From {
                base,
                offset: 0,
                region,
            }
        };
        self.set(register, value);
    }

    pub(super) fn write_all(&mut self, at: u32, registers: u16) {
        for register in (0..16).filter(|register| registers >> register & 1 == 1) {
            self.write(at, register, Region::Unknown);
        }
    }

    pub(super) fn write_back(&mut self, writeback: Option<(u8, i32)>) {
        if let Some((register, distance)) = writeback {
            self.set(register, self.get(register).add(distance));
        }
    }
}
