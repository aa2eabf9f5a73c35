//! Functions as graphs of blocks, from their first instruction on.
//!
//! A block ends where execution can go elsewhere or come from elsewhere, at calls, and where the
//! priority changes: the blocks of a critical section are its own.

mod blocks;
mod table;

use std::{
    cell::OnceCell,
    collections::{BTreeMap, BTreeSet, HashMap},
    ops::RangeInclusive,
};

use self::table::Sweep;
use crate::{Block, Decoder, Flaw, Image, Instruction, Operation, Rule, functions::PANIC_REMEDY};

/// A function's blocks before anything is known of values and loops.
pub(crate) struct Graph {
    pub(crate) blocks: Vec<Block>,
    pub(crate) flaws: Vec<Flaw>,
    pub(crate) returns: bool,
}

/// Graphs of all functions that a walk has come to.
pub(crate) struct Graphs<'a> {
    image: &'a Image,
    pub(crate) known: BTreeMap<u32, Graph>,
    /// Functions being walked, the caller before the called.
    open: Vec<u32>,
}

impl<'a> Graphs<'a> {
    /// The graphs of all functions of the image, and what they call.
    pub(crate) fn new(image: &'a Image) -> Self {
        let mut graphs = Self {
            image,
            known: BTreeMap::new(),
            open: Vec::new(),
        };
        for function in image.functions() {
            graphs.returns(function.address);
        }
        graphs
    }

    /// Whether the function at `address` ever returns; one that is being walked is taken to.
    fn returns(&mut self, address: u32) -> bool {
        if let Some(graph) = self.known.get(&address) {
            return graph.returns;
        }
        if self.open.contains(&address) {
            return true;
        }
        self.open.push(address);
        let mut walk = Walk::new(self, address);
        walk.run();
        let graph = walk.finish(address);
        self.open.pop();
        let returns = graph.returns;
        self.known.insert(address, graph);
        returns
    }

    /// The names of the functions in a cycle of calls, if `address` is among the functions being
    /// walked.
    fn cycle(&self, address: u32) -> Option<String> {
        let start = self.open.iter().position(|&open| open == address)?;
        let names = self.open[start..].iter().chain([&address]);
        let names: Vec<String> = names.map(|&open| self.image.name(open)).collect();
        Some(names.join(" -> "))
    }
}

/// Special registers by their numbers: the mask of all interrupts, the priority mask, the same
/// where a write can only raise it, and the mask of interrupts and faults.
pub(crate) const PRIMASK: u8 = 16;
pub(crate) const BASEPRI: u8 = 17;
pub(crate) const BASEPRI_MAX: u8 = 18;
pub(crate) const FAULTMASK: u8 = 19;

/// The stack pointers, and what chooses between them and takes privileges.
pub(crate) const MAIN_STACK: u8 = 8;
pub(crate) const PROCESS_STACK: u8 = 9;
pub(crate) const CONTROL: u8 = 20;

/// Whether interrupts are held back from this instruction on: all, or those of low priority.
pub fn raises(instruction: &Instruction) -> bool {
    matches!(
        instruction.operation,
        Operation::WriteSpecial {
            register: BASEPRI_MAX,
            ..
        } | Operation::Interrupts { off: true, .. }
    )
}

/// Whether interrupts are let in again by this instruction.
pub fn restores(instruction: &Instruction) -> bool {
    matches!(
        instruction.operation,
        Operation::WriteSpecial {
            register: PRIMASK | BASEPRI | FAULTMASK,
            ..
        } | Operation::Interrupts { off: false, .. }
    )
}

/// One function being walked.
struct Walk<'w, 'a> {
    graphs: &'w mut Graphs<'a>,
    start: u32,
    end: u32,
    instructions: BTreeMap<u32, Instruction>,
    leaders: BTreeSet<u32>,
    /// Where execution goes after those that end a block: address, and whether a branch is taken.
    successors: HashMap<u32, Vec<(u32, bool)>>,
    calls: HashMap<u32, u32>,
    ends: BTreeSet<u32>,
    traps: BTreeSet<u32>,
    flaws: Vec<Flaw>,
    work: Vec<(u32, Decoder)>,
    /// All of its code, once a jump table needs it; `None` if it cannot be decoded.
    sweep: OnceCell<Option<Sweep>>,
    /// From what makes a jump table's address to the jump.
    made: Vec<RangeInclusive<u32>>,
}

impl<'w, 'a> Walk<'w, 'a> {
    fn new(graphs: &'w mut Graphs<'a>, address: u32) -> Self {
        let extent = graphs.image.function(address);
        let (start, end) =
            extent.map_or((address, address), |extent| (extent.address, extent.end()));
        Self {
            graphs,
            start,
            end,
            instructions: BTreeMap::new(),
            leaders: BTreeSet::from([address]),
            successors: HashMap::new(),
            calls: HashMap::new(),
            ends: BTreeSet::new(),
            traps: BTreeSet::new(),
            flaws: Vec::new(),
            work: vec![(address, Decoder::new())],
            sweep: OnceCell::new(),
            made: Vec::new(),
        }
    }

    fn flaw(&mut self, rule: Rule, address: u32, what: String, remedy: &str) {
        self.flaws
            .push(self.graphs.image.flaw(rule, address, what, remedy));
    }

    fn run(&mut self) {
        while let Some((mut address, mut decoder)) = self.work.pop() {
            while !self.instructions.contains_key(&address) {
                let Some(instruction) = self.decode(address, &mut decoder) else {
                    break;
                };
                self.instructions.insert(address, instruction);
                if self.follow(&instruction, &decoder) {
                    break;
                }
                address = instruction.end();
            }
        }
        self.check_tables();
    }

    fn decode(&mut self, address: u32, decoder: &mut Decoder) -> Option<Instruction> {
        const OUTSIDE: &str = "Let the function end in a return or in an endless loop; \
            `unreachable_unchecked` leaves no end.";
        if !(self.start..self.end).contains(&address) || self.graphs.image.is_data(address) {
            let what =
                format!("execution would run off the code of this function at {address:#010x}");
            let from = self.instructions.keys().next_back().copied();
            let from = from.unwrap_or(address);
            self.flaw(Rule::ForbiddenInstruction, from, what, OUTSIDE);
            return None;
        }
        let code = self.graphs.image.code(address)?;
        match decoder.decode(address, code) {
            Ok(instruction) => Some(instruction),
            Err(unknown) => {
                let remedy =
                    "Teach the decoder this instruction, or keep the compiler from using it.";
                let what = unknown.to_string();
                self.flaw(Rule::UnknownInstruction, address, what, remedy);
                self.traps.insert(address);
                None
            }
        }
    }

    /// Notes where execution goes after `instruction`; whether that is not simply the next one.
    fn follow(&mut self, instruction: &Instruction, decoder: &Decoder) -> bool {
        let address = instruction.address;
        let next = instruction.end();
        let mut successors = Vec::new();
        match instruction.operation {
            Operation::Jump(to) if self.is_inside(to) => successors.push((to, true)),
            Operation::Jump(to) => self.leave(address, to),
            Operation::JumpOnZero { to, .. } => successors.extend([(to, true), (next, false)]),
            Operation::Call(to) => {
                self.calls.insert(address, to);
                if self.enter(address, to) || instruction.is_conditional() {
                    successors.push((next, false));
                } else {
                    self.traps.insert(address);
                }
            }
            Operation::CallRegister(_) => {
                self.indirect(address, "calls a function whose address is computed");
                successors.push((next, false));
            }
            Operation::TableJump {
                base, entry_bytes, ..
            } => {
                let targets = self.table(instruction, base, entry_bytes);
                successors.extend(targets.into_iter().map(|to| (to, true)));
            }
            _ if instruction.is_return() => {
                self.ends.insert(address);
            }
            Operation::JumpRegister(_) | Operation::JumpComputed => {
                self.indirect(address, "jumps to an address that is computed");
                self.traps.insert(address);
            }
            Operation::Load { writes, .. } if writes & 0x8000 != 0 => {
                self.indirect(address, "jumps to an address that is loaded");
                self.traps.insert(address);
            }
            Operation::Trap => self.trap(address),
            _ => {
                self.forbid(instruction);
                self.split(instruction);
                return false;
            }
        }
        if instruction.is_conditional() && !successors.contains(&(next, false)) {
            successors.push((next, false));
        }
        for &(to, _) in &successors {
            self.leaders.insert(to);
            // The conditions of an `IT` hold for the next instruction.
            let decoder = if to == next {
                decoder.clone()
            } else {
                Decoder::new()
            };
            self.work.push((to, decoder));
        }
        self.successors.insert(address, successors);
        true
    }

    fn is_inside(&self, address: u32) -> bool {
        (self.start..self.end).contains(&address)
    }

    /// A call of `to`; whether it returns.
    fn enter(&mut self, address: u32, to: u32) -> bool {
        if let Some(cycle) = self.graphs.cycle(to) {
            let what = format!("a function calls itself: {cycle}");
            let remedy = "Write it as a loop with a bound.";
            self.flaw(Rule::Recursion, address, what, remedy);
        }
        self.graphs.returns(to)
    }

    /// A jump out of the function: a call whose return is this function's.
    fn leave(&mut self, address: u32, to: u32) {
        self.calls.insert(address, to);
        if self.enter(address, to) {
            self.ends.insert(address);
        } else {
            self.traps.insert(address);
        }
    }

    fn indirect(&mut self, address: u32, what: &str) {
        let remedy =
            "Use generics or a `match` instead of `dyn`, function pointers and `core::fmt`.";
        let what = format!("this function {what}");
        self.flaw(Rule::IndirectCall, address, what, remedy);
    }

    fn trap(&mut self, address: u32) {
        self.traps.insert(address);
        let frames = self.graphs.image.frames(address);
        let is_panic = frames
            .iter()
            .any(|frame| frame.function.contains("panicking") || frame.file.contains("panicking"));
        if is_panic {
            let what = "a panic can be reached".to_owned();
            self.flaw(Rule::ReachablePanic, address, what, PANIC_REMEDY);
        } else {
            let what = "a trap (`UDF` or `BKPT`) can be reached".to_owned();
            let remedy = "Make the case impossible for the compiler to see, or handle it.";
            self.flaw(Rule::ReachableTrap, address, what, remedy);
        }
    }

    fn forbid(&mut self, instruction: &Instruction) {
        let what = match instruction.operation {
            Operation::Wait => "the processor waits for an event or interrupt (`WFI`, `WFE`)",
            Operation::Supervisor => "a supervisor call (`SVC`)",
            _ => return,
        };
        let remedy = "Leave it to `idle`: a task with a deadline must not do this.";
        let address = instruction.address;
        self.flaw(Rule::ForbiddenInstruction, address, what.to_owned(), remedy);
    }

    /// Begins blocks where the priority changes.
    fn split(&mut self, instruction: &Instruction) {
        if raises(instruction) {
            self.leaders.insert(instruction.address);
        }
        if raises(instruction) || restores(instruction) {
            self.leaders.insert(instruction.end());
        }
    }

    /// The targets of a jump by a table whose address is in a register.
    fn table(&mut self, jump: &Instruction, base: u8, entry_bytes: u8) -> BTreeSet<u32> {
        let image = self.graphs.image;
        let (start, end) = (self.start, self.end);
        let sweep = self.sweep.get_or_init(|| Sweep::new(image, start, end));
        let found = sweep.as_ref().and_then(|sweep| {
            let table = sweep.table(jump.address, base)?;
            let targets = sweep.targets(image, &table, jump.end(), entry_bytes)?;
            Some((table, targets))
        });
        let Some((table, targets)) = found else {
            self.unknown_table(jump.address);
            return BTreeSet::new();
        };
        self.made
            .extend(table.maker.map(|maker| maker..=jump.address));
        targets
    }

    fn unknown_table(&mut self, address: u32) {
        self.indirect(address, "jumps by a table whose length is not known");
        self.traps.insert(address);
    }

    /// Makes sure that nobody comes to a jump by a table but past what makes the table's address.
    fn check_tables(&mut self) {
        for made in std::mem::take(&mut self.made) {
            let enters = |(from, successors): (&u32, &Vec<(u32, bool)>)| {
                let past = |&(to, _): &(u32, bool)| made.contains(&to) && to != *made.start();
                !made.contains(from) && successors.iter().any(past)
            };
            if self.successors.iter().any(enters) {
                self.unknown_table(*made.end());
            }
        }
    }
}
