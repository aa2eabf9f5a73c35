//! How deep the stack grows.
//!
//! Within a function the stack pointer moves by constants only; what a call adds is the depth of
//! the function called. Tasks of one priority never preempt one another, so the deepest stack is
//! the depth of the main program plus, for each priority, the depth of the deepest task with its
//! exception frame.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Block, Function, Instruction, Operation, value_analysis::data_flow, wcet::Functions};

/// Frame of an exception with and without the registers of the floating-point unit, and what aligns
/// it. ARMv7-M reference manual B1.5.7.
pub(crate) const FRAME_BYTES: u64 = 32 + 4;
pub(crate) const FLOAT_FRAME_BYTES: u64 = 104 + 4;

const SP: u8 = 13;

/// The value of a register, as far as the stack needs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Value {
    /// So many bytes above the stack pointer at the function's begin.
    Stack(i64),
    Constant(u32),
    Unknown,
}

type Registers = [Value; 16];

/// Computes depths.
pub(crate) struct Depths<'a> {
    functions: &'a Functions,
    is_ignored: &'a dyn Fn(u32) -> bool,
    /// The possible callees of a function's pointers.
    pointers: &'a BTreeMap<u32, BTreeSet<u32>>,
    /// Blocks of functions whose calls do not count.
    left_out: BTreeSet<(u32, usize)>,
    known: BTreeMap<u32, Result<u64, u32>>,
}

impl<'a> Depths<'a> {
    /// `is_ignored`: functions whose calls do not count, panics. `pointers`: the possible callees
    /// of each function that calls through pointers.
    pub(crate) fn new(
        functions: &'a Functions,
        is_ignored: &'a dyn Fn(u32) -> bool,
        pointers: &'a BTreeMap<u32, BTreeSet<u32>>,
    ) -> Self {
        Self {
            functions,
            is_ignored,
            pointers,
            left_out: BTreeSet::new(),
            known: BTreeMap::new(),
        }
    }

    /// The depths without the callees of a function before interrupts are enabled, where none of
    /// these callees can enable interrupts: no task is on top of them.
    pub(crate) fn under_tasks(mut self, function: &Function) -> Self {
        let opens = |block: &Block| (block.instructions.iter()).any(|it| lets_in(function, it));
        let from = (0..function.blocks.len()).filter(|at| opens(&function.blocks[*at]));
        let beyond = function.reach(from, |_| false);
        if beyond.is_empty() {
            return self;
        }
        for (at, block) in function.blocks.iter().enumerate() {
            let is_quiet = |call| self.is_quiet(call, &mut BTreeSet::new());
            if !beyond.contains(&at) && block.call.is_some_and(is_quiet) {
                self.left_out.insert((function.address, at));
            }
        }
        self.known.clear();
        self
    }

    /// Whether a function, with all that it calls, can let no interrupt in.
    fn is_quiet(&self, address: u32, seen: &mut BTreeSet<u32>) -> bool {
        if !seen.insert(address) || (self.is_ignored)(address) {
            return true;
        }
        let Some(function) = self.functions.get(&address) else {
            return false;
        };
        if function.blocks.is_empty() {
            return false;
        }
        if function.instructions().any(|it| lets_in(function, it)) {
            return false;
        }
        let mut called: BTreeSet<u32> = function.blocks.iter().filter_map(|it| it.call).collect();
        for block in &function.blocks {
            for (at, instruction) in block.instructions.iter().enumerate() {
                let Some(register) = pointer(&instruction.operation) else {
                    continue;
                };
                if let Some(address) = constant(register, &block.instructions[..at]) {
                    called.insert(address & !1);
                } else if let Some(pointed) = self.pointers.get(&address) {
                    called.extend(pointed);
                } else {
                    return false;
                }
            }
        }
        called.into_iter().all(|call| self.is_quiet(call, seen))
    }

    /// Bytes of a function's frame, with the frames of its callees.
    ///
    /// # Errors
    ///
    /// The instruction where the stack cannot be followed.
    pub(crate) fn depth(&mut self, address: u32) -> Result<u64, u32> {
        if let Some(known) = self.known.get(&address) {
            return *known;
        }
        self.known.insert(address, Err(address));
        let functions = self.functions;
        let depth = functions
            .get(&address)
            .map_or(Err(address), |it| self.follow(it));
        self.known.insert(address, depth);
        depth
    }

    /// The depth of a call in a block, as far as it counts.
    fn counted(&mut self, function: &Function, block: usize, call: u32) -> Result<u64, u32> {
        if self.left_out.contains(&(function.address, block)) {
            return Ok(0);
        }
        self.depth(call)
    }

    fn follow(&mut self, function: &Function) -> Result<u64, u32> {
        if function.blocks.is_empty() {
            // The callee was not decoded.
            return Err(function.address);
        }
        let mut entry = [Value::Unknown; 16];
        entry[usize::from(SP)] = Value::Stack(0);
        let (mut deepest, mut rounds, mut unknown) = (0, 0, None);
        let after = |index: usize, registers: Registers| {
            rounds += 1;
            let passed = if rounds > 64 * function.blocks.len() {
                Err(function.blocks[index].start())
            } else {
                self.pass(function, index, registers, &mut deepest)
            };
            passed.map_err(|at| *unknown.get_or_insert(at)).ok()
        };
        data_flow(&function.blocks, entry, after, join);
        unknown.map_or(Ok(deepest.max(0) as u64), Err)
    }

    /// Executes a block; otherwise the address where the depth is not known.
    fn pass(
        &mut self,
        function: &Function,
        index: usize,
        mut registers: Registers,
        deepest: &mut i64,
    ) -> Result<Registers, u32> {
        let block = &function.blocks[index];
        for instruction in &block.instructions {
            step(instruction, &mut registers);
            let Value::Stack(sp) = registers[usize::from(SP)] else {
                return Err(instruction.address);
            };
            *deepest = (*deepest).max(-sp);
            if let Some(pointer) = pointer(&instruction.operation) {
                let value = registers[usize::from(pointer & 15)];
                let called = if let Value::Constant(address) = value {
                    BTreeSet::from([address & !1])
                } else {
                    let known = self.pointers.get(&function.address);
                    known.ok_or(instruction.address)?.clone()
                };
                for callee in called {
                    *deepest = (*deepest).max(self.depth(callee)?.cast_signed() - sp);
                }
                clobber(&mut registers);
            }
        }
        if let (Some(call), Value::Stack(sp)) = (block.call, registers[usize::from(SP)])
            && !(self.is_ignored)(call)
        {
            let callee = self.counted(function, index, call)?;
            *deepest = (*deepest).max(callee.cast_signed() - sp);
            clobber(&mut registers);
        }
        Ok(registers)
    }
}

/// Whether an instruction lets interrupts in that were kept out. A write restores the mask, and so
/// enables nothing, unless a constant is known to be written.
fn lets_in(function: &Function, instruction: &Instruction) -> bool {
    const PRIMASK: u8 = 16;
    match instruction.operation {
        Operation::Interrupts { off, primask, .. } => primask && !off,
        Operation::WriteSpecial { register, .. } if register == PRIMASK => {
            let written = function.specials.get(&instruction.address);
            written.is_some_and(|value| value & 1 == 0)
        }
        _ => false,
    }
}

/// The register that holds where an instruction goes, when it is no return.
pub(crate) const fn pointer(operation: &Operation) -> Option<u8> {
    match *operation {
        Operation::CallRegister(register) => Some(register),
        Operation::JumpRegister(register) if register != 14 => Some(register),
        _ => None,
    }
}

/// The registers after a call.
fn clobber(registers: &mut Registers) {
    for register in [0, 1, 2, 3, 12, 14] {
        registers[register] = Value::Unknown;
    }
}

/// The value of a register after consecutive instructions, if it is a constant and nothing is called.
pub(crate) fn constant<'i>(
    register: u8,
    instructions: impl IntoIterator<Item = &'i Instruction>,
) -> Option<u32> {
    let mut registers = [Value::Unknown; 16];
    for instruction in instructions {
        step(instruction, &mut registers);
        if let Operation::Call(_) | Operation::CallRegister(_) = instruction.operation {
            clobber(&mut registers);
        }
    }
    match registers[usize::from(register & 15)] {
        Value::Constant(value) => Some(value),
        _ => None,
    }
}

/// The join of two states; of two depths the greater.
fn join(one: &Registers, other: &Registers) -> Registers {
    let mut joined = *one;
    for (value, other) in joined.iter_mut().zip(other) {
        *value = match (*value, *other) {
            (one, other) if one == other => one,
            (Value::Stack(one), Value::Stack(other)) => Value::Stack(one.min(other)),
            _ => Value::Unknown,
        };
    }
    joined
}

/// The registers after an instruction.
fn step(instruction: &Instruction, registers: &mut Registers) {
    let before = *registers;
    let at = |register: u8| before[usize::from(register & 15)];
    let mut writes = 0_u16;
    let mut set = None;
    let add = |value: Value, to: i64| match value {
        Value::Stack(offset) => Value::Stack(offset + to),
        Value::Constant(constant) => Value::Constant(constant.wrapping_add(to as u32)),
        Value::Unknown => Value::Unknown,
    };
    match instruction.operation {
        Operation::Constant { to, value } => set = Some((to, Value::Constant(value))),
        Operation::ConstantTop { to, value } => {
            set = Some(match at(to) {
                Value::Constant(low) => {
                    let value = low & 0xffff | u32::from(value) << 16;
                    (to, Value::Constant(value))
                }
                _ => (to, Value::Unknown),
            });
        }
        Operation::Copy { to, from } => set = Some((to, at(from))),
        Operation::Add { to, from, value } => set = Some((to, add(at(from), value.into()))),
        Operation::AddRegister { to, left, right } => {
            let sum = match (at(left), right.map(at)) {
                (value, Some(Value::Constant(constant)))
                | (Value::Constant(constant), Some(value)) => {
                    add(value, i64::from(constant.cast_signed()))
                }
                _ => Value::Unknown,
            };
            set = Some((to, sum));
        }
        Operation::Or { to, .. }
        | Operation::ReadSpecial { to, .. }
        | Operation::StoreExclusive { to, .. } => writes = 1 << to,
        Operation::Plain { writes: to }
        | Operation::Multiply { writes: to, .. }
        | Operation::Divide { writes: to }
        | Operation::Float { writes: to, .. }
        | Operation::LoadExclusive { writes: to, .. }
        | Operation::Load { writes: to, .. } => writes = to,
        _ => {}
    }
    for register in (0..15).filter(|register| writes >> register & 1 != 0) {
        registers[register] = Value::Unknown;
    }
    if let Some((register, value)) = set {
        registers[usize::from(register & 15)] = value;
    }
    if let Some((register, by)) = instruction.operation.access().and_then(|access| access.1) {
        registers[usize::from(register & 15)] = add(at(register), by.into());
    }
    if instruction.is_conditional() && !instruction.is_jump() {
        // A return that does not happen changes nothing.
        *registers = if instruction.is_return() {
            before
        } else {
            join(&before, registers)
        };
    }
}

impl Instruction {
    const fn is_jump(&self) -> bool {
        matches!(
            self.operation,
            Operation::Jump(_) | Operation::JumpOnZero { .. }
        )
    }
}

/// Whether a function uses the floating-point unit.
pub(crate) fn uses_float(function: &Function) -> bool {
    function.instructions().any(|it| it.operation.is_float())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Address, testing};

    fn push(words: u8) -> Operation {
        let bytes = -4 * i32::from(words);
        Operation::Store {
            words,
            address: Address::Offset {
                base: SP,
                offset: bytes,
            },
            writeback: Some((SP, bytes)),
            source: None,
            bytes: 4,
            reads: 0,
        }
    }

    fn functions() -> Functions {
        let shape: &[(u32, &[usize])] = &[(2, &[1, 2]), (1, &[3]), (1, &[3]), (1, &[])];
        let mut outer = testing::function(shape);
        let instructions = &mut outer.blocks[0].instructions;
        instructions[0].operation = push(4);
        instructions[1].operation = Operation::Add {
            to: SP,
            from: SP,
            value: -64,
        };
        outer.blocks[1].call = Some(0x0900_0000);
        let mut inner = testing::function(&[(1, &[])]);
        inner.blocks[0].instructions[0].operation = push(8);
        inner.address = 0x0900_0000;
        Functions::from([(outer.address, outer), (inner.address, inner)])
    }

    #[test]
    fn depths_of_calls_add_up() {
        let (functions, none) = (functions(), BTreeMap::new());
        let mut depths = Depths::new(&functions, &|_| false, &none);
        assert_eq!(depths.depth(0x0900_0000), Ok(32));
        assert_eq!(depths.depth(0x0800_0000), Ok(16 + 64 + 32));
    }

    #[test]
    fn what_moves_the_stack_by_an_unknown_number_is_reported() {
        let (mut functions, none) = (functions(), BTreeMap::new());
        let inner = functions.get_mut(&0x0900_0000).unwrap();
        inner.blocks[0].instructions[0].operation = Operation::Plain { writes: 1 << SP };
        let mut depths = Depths::new(&functions, &|_| false, &none);
        assert_eq!(depths.depth(0x0800_0000), Err(0x0800_0000));
    }

    #[test]
    fn recursion_has_no_depth() {
        let (mut functions, none) = (functions(), BTreeMap::new());
        functions.get_mut(&0x0900_0000).unwrap().blocks[0].call = Some(0x0800_0000);
        assert!(
            Depths::new(&functions, &|_| false, &none)
                .depth(0x0800_0000)
                .is_err()
        );
    }

    #[test]
    fn a_pointer_costs_the_deepest_of_what_it_may_point_to() {
        let mut functions = functions();
        let outer = functions.get_mut(&0x0800_0000).unwrap();
        outer.blocks[1].call = None;
        outer.blocks[1].instructions[0].operation = Operation::CallRegister(3);
        let none = BTreeMap::new();
        assert!(
            Depths::new(&functions, &|_| false, &none)
                .depth(0x0800_0000)
                .is_err()
        );
        let pointers = BTreeMap::from([(0x0800_0000, BTreeSet::from([0x0900_0000]))]);
        let mut depths = Depths::new(&functions, &|_| false, &pointers);
        assert_eq!(depths.depth(0x0800_0000), Ok(16 + 64 + 32));
    }

    #[test]
    fn what_is_called_before_interrupts_are_let_in_is_under_no_task() {
        let (mut functions, none) = (functions(), BTreeMap::new());
        let opening = |functions: &mut Functions, at: u32, block: usize| {
            let function = functions.get_mut(&at).unwrap();
            function.blocks[block].instructions[0].operation = Operation::Interrupts {
                off: false,
                primask: true,
                faultmask: false,
            };
        };
        let depth = |functions: &Functions| {
            let depths = Depths::new(functions, &|_| false, &none);
            let outer = &functions[&0x0800_0000];
            depths.under_tasks(outer).depth(0x0800_0000)
        };
        assert_eq!(depth(&functions), Ok(16 + 64 + 32));
        // Behind the call.
        opening(&mut functions, 0x0800_0000, 3);
        assert_eq!(depth(&functions), Ok(16 + 64));
        // A callee may enable interrupts too.
        let mut both = functions.clone();
        both.get_mut(&0x0900_0000).unwrap().blocks[0].call = Some(0x0a00_0000);
        let mut last = testing::function(&[(1, &[])]);
        last.address = 0x0a00_0000;
        both.insert(last.address, last);
        assert_eq!(depth(&both), Ok(16 + 64));
        opening(&mut both, 0x0a00_0000, 0);
        assert_eq!(depth(&both), Ok(16 + 64 + 32));
        // Before the call.
        opening(&mut functions, 0x0800_0000, 1);
        assert_eq!(depth(&functions), Ok(16 + 64 + 32));
    }
}
