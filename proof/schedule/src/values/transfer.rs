//! The transfer function: the effect of an instruction on a state.

use super::{
    Flags, Origins, Value,
    state::{State, Surroundings},
};
use crate::{Instruction, Operation, Region, instruction::CALL_WRITES};

impl State {
    pub(super) fn transfer(&mut self, around: Surroundings<'_>, instruction: &Instruction) {
        let at = instruction.address;
        let flags = self.arithmetic(at, instruction.operation);
        if let Some((address, bytes)) = instruction.operation.stored() {
            let to = self.address(address);
            self.store(around, to, bytes);
            self.keep(to, instruction.operation);
        }
        match instruction.operation {
            Operation::Load { address, .. } => {
                let from = self.address(address);
                self.load(around, at, from, instruction.operation);
            }
            Operation::Store { writeback, .. }
            | Operation::FloatStore { writeback, .. }
            | Operation::FloatLoad { writeback, .. } => self.write_back(writeback),
            Operation::LoadExclusive { writes, .. } => self.write_all(at, writes),
            Operation::StoreExclusive { to, .. } | Operation::ReadSpecial { to, .. } => {
                self.write(at, to, Region::Unknown);
            }
            Operation::Call(callee) => self.call(around, at, Some(callee)),
            Operation::CallRegister(_) => self.call(around, at, None),
            _ => {}
        }
        if instruction.sets_flags {
            self.flags = flags;
        }
    }

    /// Does arithmetic; the flags after it, if it sets them.
    fn arithmetic(&mut self, at: u32, operation: Operation) -> Flags {
        match operation {
            Operation::Constant { to, value } => {
                self.set(to, Value::Constant(value));
                Flags::result(self.get(to))
            }
            Operation::ConstantTop { to, value } => {
                match self.get(to) {
                    Value::Constant(low) => {
                        let whole = low & 0xffff | u32::from(value) << 16;
                        self.set(to, Value::Constant(whole));
                    }
                    _ => self.write(at, to, Region::Unknown),
                }
                Flags::default()
            }
            Operation::Copy { to, from } => {
                self.set(to, self.get(from));
                Flags::result(self.get(to))
            }
            Operation::Add { to, from, value } => {
                let before = self.get(from);
                self.set(to, before.add(value));
                Flags::add(before, value)
            }
            Operation::AddRegister { to, left, right } => {
                let right = right.map_or(Value::UNKNOWN, |right| self.get(right));
                let left = self.get(left);
                match left.sum(right) {
                    Value::In { region, origins } if origins == Origins::NONE => {
                        self.write(at, to, region);
                    }
                    known => self.set(to, known),
                }
                Flags::result(self.get(to))
            }
            Operation::Or { to, from, value } => {
                match self.get(from) {
                    Value::Constant(from) => self.set(to, Value::Constant(from | value)),
                    _ => self.write(at, to, Region::Unknown),
                }
                Flags::result(self.get(to))
            }
            Operation::Compare { left, value } => {
                Flags::compare(self.get(left), Value::Constant(value))
            }
            Operation::CompareRegisters { left, right } => {
                Flags::compare(self.get(left), self.get(right))
            }
            Operation::Multiply { writes, added } => {
                self.multiply(at, writes, added);
                Flags::default()
            }
            Operation::Plain { writes }
            | Operation::Divide { writes }
            | Operation::Float { writes, .. } => {
                self.write_all(at, writes);
                Flags::default()
            }
            _ => Flags::default(),
        }
    }

    fn multiply(&mut self, at: u32, writes: u16, added: Option<u8>) {
        // An index times a size, added to a pointer.
        let added = added.map_or(Value::UNKNOWN, |added| self.get(added).indexed());
        self.write_all(at, writes);
        let to = writes.trailing_zeros() as u8;
        if added.origins() != Origins::NONE {
            self.set(to, added);
        } else if added.region() != Region::Unknown {
            self.write(at, to, added.region());
        }
    }

    fn call(&mut self, around: Surroundings<'_>, at: u32, callee: Option<u32>) {
        let known = around.callees.zip(callee);
        let writes = known.and_then(|(callees, callee)| callees.writes.get(&callee));
        let keeps_arguments =
            known.is_some_and(|(callees, callee)| !callees.write_arguments.contains(&callee));
        match writes {
            Some(writes) if keeps_arguments => {
                for (register, spans) in (0..).zip(writes) {
                    self.forget_pointees(around, self.get(register), spans);
                }
                self.weaken(around);
            }
            _ => {
                self.slots.clear();
                self.given.clear();
            }
        }
        self.write_all(at, CALL_WRITES);
        let region = known.and_then(|(callees, callee)| callees.results.get(&callee));
        if let Some(&region) = region {
            self.write(at, 0, region);
        }
        self.flags = Flags::default();
    }
}
