//! The entries of the profile: instructions, tasks, calls.

use std::collections::BTreeMap;

use crate::{
    decode::{Class, Flow, Instruction},
    table::Circumstances,
};

/// Instructions and cycles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Amount {
    /// Instructions executed; those their condition skips count too.
    pub instructions: u64,
    /// Modelled cycles.
    pub cycles: u64,
}

impl Amount {
    pub(crate) fn add(&mut self, other: Self) {
        self.instructions += other.instructions;
        self.cycles += other.cycles;
    }
}

/// An instruction in memory.
pub struct Site {
    /// Where it is.
    pub address: u32,
    /// Its 16-bit halves; the second is 0 when it is a short one.
    pub code: [u16; 2],
    /// Its cost, by task: index of [`Profile::tasks`].
    pub by_task: Vec<Amount>,
    /// The function it belongs to: index of [`Program::functions`].
    pub function: Option<usize>,
    /// `None` when the decoder does not know the instruction, which then counts as one cycle.
    pub decoded: Option<Instruction>,
    pub(super) is_handler: bool,
}

impl Site {
    pub(super) fn instruction(&self) -> Instruction {
        self.decoded.unwrap_or(Instruction {
            size: crate::decode::size(self.code[0]),
            class: Class::Plain,
            flow: Flow::Next,
            loaded: 0,
            address: 0,
        })
    }
}

/// Smallest, largest and all costs of a task's activations.
#[derive(Default)]
pub struct Task {
    /// Entry of its handler; 0 for what runs outside handlers.
    pub handler: u32,
    /// Completed runs.
    pub activations: u64,
    /// Of the completed runs, exception entry and exit included, preemption excluded.
    pub total: Amount,
    /// From the first to the last cycle, preemption included.
    pub span_cycles: u64,
    /// Cheapest run, instructions and cycles separately.
    pub min: Option<Amount>,
    /// Dearest run, instructions and cycles separately.
    pub max: Amount,
    /// Longest span, cycles.
    pub max_span_cycles: u64,
    /// Reads of peripherals.
    pub peripheral_reads: u64,
    /// Writes of peripherals.
    pub peripheral_writes: u64,
    /// Number of runs by their cycles.
    pub histogram: BTreeMap<u64, u64>,
}

impl Task {
    /// Adds a completed run.
    pub(super) fn record(&mut self, spent: Amount, span_cycles: u64) {
        self.activations += 1;
        self.total.add(spent);
        self.span_cycles += span_cycles;
        self.max_span_cycles = self.max_span_cycles.max(span_cycles);
        let min = self.min.get_or_insert(spent);
        min.instructions = min.instructions.min(spent.instructions);
        min.cycles = min.cycles.min(spent.cycles);
        self.max.instructions = self.max.instructions.max(spent.instructions);
        self.max.cycles = self.max.cycles.max(spent.cycles);
        *self.histogram.entry(spent.cycles).or_default() += 1;
    }
}

/// The cost of a function's calls, callees included, preemption excluded.
#[derive(Debug, Clone, Copy, Default)]
pub struct Calls {
    /// Completed calls.
    pub count: u64,
    /// Their cost; a recursive function's inner calls count again.
    pub total: Amount,
}

/// A call that has not returned yet.
pub(super) struct Call {
    pub(super) function: Option<usize>,
    pub(super) return_address: u32,
    pub(super) begin: Amount,
}

/// The instruction executed last: the next instruction shows its outcome.
#[derive(Clone, Copy)]
pub(super) struct Pending {
    pub(super) site: usize,
    pub(super) conditional: bool,
    pub(super) how: Circumstances,
}

/// An activation of a task.
pub(super) struct Frame {
    pub(super) task: usize,
    pub(super) function: Option<usize>,
    pub(super) begin_cycle: u64,
    pub(super) spent: Amount,
    pub(super) calls: Vec<Call>,
    pub(super) pending: Option<Pending>,
    /// Registers loaded by the last instruction.
    pub(super) loaded: u16,
    /// Where the last instruction ended, if it was a short one.
    pub(super) short_end: u32,
    /// Instructions that the last `IT` still governs.
    pub(super) governed: u8,
}

impl Frame {
    pub(super) fn new(task: usize, function: Option<usize>, begin_cycle: u64) -> Self {
        Self {
            task,
            function,
            begin_cycle,
            spent: Amount::default(),
            calls: Vec::new(),
            pending: None,
            loaded: 0,
            short_end: 0,
            governed: 0,
        }
    }
}
