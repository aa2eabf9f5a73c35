//! Functions as graphs of blocks.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::{
    Annotations, Flaw, Image, Instruction, bounds, calls::Calls, functions, graph::Graphs,
    walks::reachable,
};

/// A part of the address space with its own access time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Region {
    /// Flash, through the data cache of the accelerator.
    Flash,
    /// SRAM 1 and 2.
    Sram,
    /// Core-coupled memory.
    Ccm,
    /// Ports and other peripherals on the fast buses.
    Ahb,
    /// Timers 2-7, UARTs 2-5 and others.
    Apb1,
    /// Timers 1 and 8, USART 1, EXTI and others.
    Apb2,
    /// The full-speed core of USB.
    Usb,
    /// The processor's own: NVIC, SysTick, DWT.
    Private,
    /// Memory without a cost in the model: bit-band aliases, the high-speed core of USB, external memory.
    Uncosted,
    /// Not known: charged as the slowest.
    Unknown,
}

/// An edge from one block to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Edge {
    /// Index of the block it leads to.
    pub to: usize,
    /// Whether a branch is taken: the pipeline is refilled.
    pub is_taken: bool,
}

/// Instructions that are executed one after another.
#[derive(Debug, Clone)]
pub struct Block {
    /// Never empty.
    pub instructions: Vec<Instruction>,
    /// Where execution goes on.
    pub successors: Vec<Edge>,
    /// The function called by the last instruction (a call, or a jump out of the function).
    pub call: Option<u32>,
    /// The function may end here.
    pub ends: bool,
    /// Execution does not come out of it: a trap, or a call that does not return.
    pub traps: bool,
}

/// A store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Store {
    /// The instruction.
    pub at: u32,
    /// Where it goes, when that is constant.
    pub to: Option<u32>,
    /// The memory that it goes to.
    pub region: Region,
    /// Bytes that it writes.
    pub bytes: u32,
    /// The stored value, when it is one constant.
    pub value: Option<u32>,
}

/// A number, or the name of one that `schedule.toml` defines.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(untagged)]
pub enum Count {
    /// The number.
    Number(u64),
    /// The name.
    Named(String),
}

/// How often a loop runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bound {
    /// Most runs of the body for each entry into the loop.
    pub count: Count,
    /// Where it is from: `file:line` of the comment, or how it was found.
    pub origin: String,
    /// Why it holds, as the comment says.
    pub reason: Option<String>,
}

/// How often the analysis finds a loop to be run again for each entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Runs {
    /// Returns to its head that every entry makes: in none of the runs before could it end.
    pub least: u64,
    /// Returns that were followed: the most there are, ...
    pub returns: u64,
    /// ... unless more may come.
    pub is_open: bool,
}

/// A comment `// wcet-total: N` on a line: the loop that owns the line runs its body at most N
/// times in one activation of the task, whatever loops are around it. When it is a name, all loops
/// that give the name run so often together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Total {
    /// Most runs of the body for each activation.
    pub bound: Bound,
    /// The function of whose calls one makes so many runs; without it, one entry of the loop does.
    pub per: Option<String>,
    /// Blocks that are executed in a run of the body only, and so no more often: what the body
    /// stores is in them. Not those of inner loops.
    pub in_runs: BTreeSet<usize>,
}

/// A loop of a function.
#[derive(Debug, Clone, Default)]
pub struct Loop {
    /// Index of the block where it is entered.
    pub head: usize,
    /// Indices of all its blocks, those of inner loops too.
    pub blocks: BTreeSet<usize>,
    /// Blocks from which it is entered again.
    pub back: BTreeSet<usize>,
    /// How often it runs, when that is known.
    pub bound: Option<Bound>,
    /// How often its counter lets it run.
    pub counted: Option<Runs>,
    /// The bound that a comment states, used or not.
    pub stated: Option<Bound>,
    /// How often it runs in all, when that is said.
    pub total: Option<Total>,
    /// Its own lines, `file:line`: for messages.
    pub lines: BTreeSet<String>,
    /// The function of the source that it is in, of the project if possible.
    pub within: String,
}

/// A function.
#[derive(Debug, Clone, Default)]
pub struct Function {
    /// Where it begins.
    pub address: u32,
    /// Its demangled name.
    pub name: String,
    /// The first is where it begins.
    pub blocks: Vec<Block>,
    /// The region of each access, by the address of its instruction.
    pub regions: BTreeMap<u32, Region>,
    /// The address of each access where that is constant, by the address of its instruction.
    pub addresses: BTreeMap<u32, u32>,
    /// Constants that are written to special registers, by the address of the instruction.
    pub specials: BTreeMap<u32, u32>,
    /// Restored masks: the address of an instruction that writes a special register, and of the
    /// earlier instruction that read the written value from the same register.
    pub saved: BTreeMap<u32, u32>,
    /// Its stores.
    pub stores: Vec<Store>,
    /// Its loops, the outer before the inner.
    pub loops: Vec<Loop>,
    /// The flaws that make a bound impossible.
    pub flaws: Vec<Flaw>,
    /// Whether it ever returns.
    pub returns: bool,
}

impl Count {
    /// Its value; `None`: its name has none.
    pub(crate) fn value(&self, named: &BTreeMap<String, u64>) -> Option<u64> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Named(name) => named.get(name).copied(),
        }
    }
}

impl Runs {
    /// Whether every entry makes so many returns, and no more.
    pub(crate) const fn is_exact(self) -> bool {
        !self.is_open && self.least == self.returns
    }
}

impl Bound {
    /// A bound without a reason.
    pub(crate) fn new(count: Count, origin: &str) -> Self {
        Self {
            count,
            origin: origin.to_owned(),
            reason: None,
        }
    }

    /// Whether a comment states it.
    pub(crate) fn is_stated(&self) -> bool {
        self.origin.contains(".rs:")
    }
}

impl Block {
    /// The address of its first instruction.
    pub fn start(&self) -> u32 {
        self.instructions.first().map_or(0, |first| first.address)
    }

    /// The address after its end.
    pub fn end(&self) -> u32 {
        self.instructions.last().map_or(0, Instruction::end)
    }
}

/// All functions of an image.
pub struct Program<'a> {
    /// The instruction from which it was decoded.
    pub image: &'a Image,
    functions: BTreeMap<u32, Function>,
    /// Functions that never return because they panic.
    panics: BTreeSet<u32>,
}

impl<'a> Program<'a> {
    /// Analyses all functions of `image`.
    pub fn new(image: &'a Image, annotations: &Annotations) -> Self {
        let graphs = Graphs::new(image).known;
        let panics = functions::panics(image, &graphs);
        let calls = Calls::new(image, &graphs);
        let functions = graphs
            .into_iter()
            .map(|(address, graph)| {
                let mut function = functions::build(image, address, graph, &panics);
                if let Some(states) = calls.states(address) {
                    let around = calls.around(image, address);
                    functions::describe(around, &mut function, states);
                    bounds::find(around, annotations, &mut function, states);
                }
                (address, function)
            })
            .collect();
        Self {
            image,
            functions,
            panics,
        }
    }

    /// The function that begins at `address`.
    pub fn function(&self, address: u32) -> Option<&Function> {
        self.functions.get(&address)
    }

    /// All functions by their addresses.
    pub const fn functions(&self) -> &BTreeMap<u32, Function> {
        &self.functions
    }

    /// Whether the function at `address` never returns because it panics.
    pub fn is_panic(&self, address: u32) -> bool {
        self.panics.contains(&address)
    }

    /// The functions that the one at `root` calls, directly or not, and itself. What a panic calls
    /// is left out: that a panic can be reached is a flaw of its own.
    pub fn reach(&self, root: u32) -> BTreeSet<u32> {
        let called = |at: u32| {
            let blocks = self.function(at).into_iter().flat_map(|it| &it.blocks);
            let calls = blocks.filter_map(|block| block.call);
            calls.filter(|call| !self.is_panic(*call) && self.functions.contains_key(call))
        };
        reachable(
            Some(root).filter(|root| self.functions.contains_key(root)),
            called,
        )
    }

    /// The same functions themselves.
    pub(crate) fn reached(&self, root: u32) -> impl Iterator<Item = &Function> {
        let reached = self.reach(root).into_iter();
        reached.filter_map(|address| self.function(address))
    }

    /// The functions that begin at some addresses.
    pub(crate) fn functions_at(
        &self,
        addresses: &BTreeSet<u32>,
    ) -> impl Iterator<Item = &Function> {
        addresses
            .iter()
            .filter_map(|address| self.function(*address))
    }
}
