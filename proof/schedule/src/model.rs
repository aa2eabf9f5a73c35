//! The costs of instructions: the cycle table, the waits of the buses, the flash.
//!
//! Cycles: Cortex-M4 technical reference manual (DDI 0439) table 3-1, its ranges at their upper
//! ends. Waits: what a bus adds to an access, RM0090 chapter 2. Flash: RM0090 chapter 3; without
//! prefetch a miss costs the wait states. Only effects that the manuals promise are credited: no
//! pipelined loads, no folded `IT`, no tail-chaining, and full price for instructions that an `IT`
//! skips.

use std::{collections::BTreeMap, str::FromStr};

use crate::{Address, Block, Instruction, Operation, Region};

/// Bytes of a line of the instruction cache.
pub(crate) const LINE_BYTES: u32 = 16;
/// Lines of the instruction cache, which replaces the one that was used least recently.
pub(crate) const CACHE_LINES: usize = 64;
/// Bytes that the processor may fetch beyond the executed instruction: three words.
const PREFETCH_BYTES: u32 = 12;
/// Wait of a peripheral bus, core cycles for each division of its clock: the access is synchronised,
/// and takes two of its cycles.
const WAITS_PER_DIVISION: u64 = 3;
/// Longest transfers that an interrupt waits for: that of a store in the write buffer, to a peripheral on the slow bus,
/// and that of a load after the store.
pub(crate) const OUTSTANDING_TRANSFER: u64 = 26;
/// What a processor that sleeps in `idle` takes to wake, core cycles: data sheet of the STM32F405 (DS8626),
/// wakeup timings of the low-power modes. It has no transfer under way then, so nothing is added for it.
const WAKE_FROM_SLEEP: u64 = 5;
const _: () = assert!(WAKE_FROM_SLEEP <= OUTSTANDING_TRANSFER);
/// What a preemption costs at most apart from the cache: an abandoned `LDM` or division that begins
/// again, ...
pub(crate) const RESTART: u64 = 17;
/// ... and an exclusive store that fails and is tried again, where there is one.
pub(crate) const RETRY: u64 = 20;

/// The clocks of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Clock {
    /// Clock of the core, Hz.
    pub hclk_hz: u64,
    /// Clock of the step timer, Hz.
    pub timer_hz: u64,
    /// Wait states of the flash.
    pub flash_wait_states: u64,
    /// Whether the flash prefetches: then lines may be served that never enter the cache.
    pub prefetch: bool,
    /// Division of the slow peripherals' clock.
    pub apb1_div: u64,
    /// Division of the fast peripherals' clock.
    pub apb2_div: u64,
    /// Wait of an access to SRAM or a port while DMA is active.
    pub dma_wait: u64,
}

impl FromStr for Clock {
    type Err = String;

    /// Reads the core's MHz, the wait states of the flash, and the divisions of both buses: `168/5/4/2`. The step
    /// timer counts half cycles of the core, flash is read without prefetch, and nothing but the processor is on
    /// the bus.
    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<u64>, _> = text.split('/').map(str::parse).collect();
        let Ok([mhz, flash_wait_states, apb1_div, apb2_div]) = numbers.as_deref() else {
            return Err(format!("{text:?} is no clock, as 168/5/4/2 is"));
        };
        let hclk_hz = mhz * 1_000_000;
        Ok(Self {
            hclk_hz,
            timer_hz: hclk_hz / 2,
            flash_wait_states: *flash_wait_states,
            prefetch: false,
            apb1_div: *apb1_div,
            apb2_div: *apb2_div,
            dma_wait: 0,
        })
    }
}

/// A model of the instruction cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cache {
    /// Every access hits.
    Warm,
    /// The cache is empty at first, and evicts nothing in one activation.
    Cold,
    /// Only the line in use hits.
    Uncached,
    /// As [`Cache::Uncached`], but a loop whose code fits it misses each line once for each entry.
    Loops,
    /// As [`Cache::Loops`], with the misses of the preempting tasks whose lines the code evicts.
    Shared,
}

/// Costs by the names of their classes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Model {
    table: BTreeMap<&'static str, u64>,
    /// Whether the flash prefetches.
    pub prefetch: bool,
}

impl Model {
    /// The table of the manuals.
    pub fn new(clock: &Clock) -> Self {
        let wait_states = clock.flash_wait_states;
        let miss = if clock.prefetch {
            2 * wait_states
        } else {
            wait_states
        };
        let table = BTreeMap::from([
            ("plain", 1),
            ("multiply", 1),
            ("divide", 12),
            ("load", 2),
            ("load_word", 1),
            ("store", 2),
            ("store_word", 1),
            ("exclusive", 2),
            ("refill", 3),
            ("table_jump", 2),
            ("special", 2),
            ("barrier", 4),
            ("float_1", 1),
            ("float_2", 2),
            ("float_4", 4),
            ("float_15", 15),
            ("float_load", 2),
            ("entry", 12),
            ("exit", 12),
            ("lazy_save", 18),
            ("sram", clock.dma_wait),
            ("ccm", 0),
            ("ahb", 1 + clock.dma_wait),
            ("apb1", WAITS_PER_DIVISION * clock.apb1_div),
            ("apb2", WAITS_PER_DIVISION * clock.apb2_div),
            // Until it has been measured: no manual tells it. Assumed is the wait of the slowest bus.
            (
                "usb",
                WAITS_PER_DIVISION * clock.apb1_div.max(clock.apb2_div),
            ),
            ("private", 1),
            ("flash_data", 2 * wait_states),
            ("flash_miss", miss),
        ]);
        Self {
            table,
            prefetch: clock.prefetch,
        }
    }

    /// The table with what was measured where that is more. The names that it does not have.
    pub fn calibrate(&mut self, measured: &BTreeMap<String, u64>) -> Vec<String> {
        let mut unknown = Vec::new();
        for (name, cycles) in measured {
            match self.table.get_mut(name.as_str()) {
                Some(cost) => *cost = (*cost).max(*cycles),
                None => unknown.push(name.clone()),
            }
        }
        unknown
    }

    /// The table: cycles by the names of the classes.
    pub const fn classes(&self) -> &BTreeMap<&'static str, u64> {
        &self.table
    }

    /// The cost of a class; there is one of each name that this crate uses.
    fn of(&self, class: &str) -> u64 {
        self.table.get(class).copied().unwrap_or_default()
    }

    /// The cost of a miss of the instruction cache.
    pub fn miss(&self) -> u64 {
        self.of("flash_miss")
    }

    /// The cost of a taken branch.
    pub fn refill(&self) -> u64 {
        self.of("refill")
    }

    /// Entry into an exception and return from it, apart from the cache.
    pub fn entry_and_exit(&self) -> u64 {
        self.of("entry") + self.of("exit")
    }

    /// Entry into an exception alone.
    pub fn entry(&self) -> u64 {
        self.of("entry")
    }

    /// Cycles for lazy stacking of floating-point registers by a preemption: saved and restored.
    pub fn lazy_save(&self) -> u64 {
        2 * self.of("lazy_save")
    }

    /// The waits that a region adds to each access.
    pub fn wait(&self, region: Region) -> u64 {
        match region {
            Region::Flash => self.of("flash_data"),
            Region::Sram => self.of("sram"),
            Region::Ccm => self.of("ccm"),
            Region::Ahb => self.of("ahb"),
            Region::Apb1 => self.of("apb1"),
            Region::Apb2 => self.of("apb2"),
            Region::Usb => self.of("usb"),
            Region::Private => self.of("private"),
            Region::Uncosted | Region::Unknown => self
                .of("apb1")
                .max(self.of("apb2"))
                .max(self.of("usb"))
                .max(self.of("flash_data")),
        }
    }

    /// Cycles of an instruction that does not branch, without misses of the instruction cache.
    pub fn cycles(&self, instruction: &Instruction, region: Region) -> u64 {
        let several = |first: u64, each: u64, words: u8| {
            let wait = self.wait(region);
            if words <= 1 {
                first + wait + (accesses(instruction) - 1) * (each + wait)
            } else {
                1 + u64::from(words) * (each + wait)
            }
        };
        match instruction.operation {
            Operation::Multiply { .. } => self.of("multiply"),
            Operation::Divide { .. } => self.of("divide"),
            Operation::Load { words, .. } => several(self.of("load"), self.of("load_word"), words),
            Operation::Store { words, .. } => {
                several(self.of("store"), self.of("store_word"), words)
            }
            Operation::FloatLoad { words, .. } => {
                several(self.of("float_load"), self.of("load_word"), words)
            }
            Operation::FloatStore { words, .. } => {
                several(self.of("float_load"), self.of("store_word"), words)
            }
            Operation::LoadExclusive { .. } | Operation::StoreExclusive { .. } => {
                self.of("exclusive") + self.wait(region)
            }
            Operation::TableJump { .. } => self.of("table_jump") + self.wait(Region::Flash),
            Operation::Interrupts { .. }
            | Operation::ReadSpecial { .. }
            | Operation::WriteSpecial { .. } => self.of("special"),
            Operation::Barrier => self.of("barrier"),
            Operation::Float { cycles, .. } => self.float(cycles),
            Operation::Constant { .. }
            | Operation::ConstantTop { .. }
            | Operation::Copy { .. }
            | Operation::Add { .. }
            | Operation::AddRegister { .. }
            | Operation::Or { .. }
            | Operation::Compare { .. }
            | Operation::CompareRegisters { .. }
            | Operation::Plain { .. }
            | Operation::ClearExclusive
            | Operation::Jump(_)
            | Operation::Call(_)
            | Operation::JumpOnZero { .. }
            | Operation::JumpRegister(_)
            | Operation::CallRegister(_)
            | Operation::JumpComputed
            | Operation::IfThen(_)
            | Operation::Nothing
            | Operation::Wait
            | Operation::Trap
            | Operation::Supervisor => self.of("plain"),
        }
    }

    /// A floating-point operation that the decoder gives so many cycles.
    fn float(&self, cycles: u8) -> u64 {
        let class = match cycles {
            0 | 1 => "float_1",
            2 => "float_2",
            3 | 4 => "float_4",
            _ => "float_15",
        };
        self.of(class).max(u64::from(cycles))
    }

    /// The least that an instruction may take: pipelined, without waits.
    pub fn least(instruction: &Instruction) -> u64 {
        match instruction.operation {
            Operation::Load { words, .. }
            | Operation::Store { words, .. }
            | Operation::FloatLoad { words, .. }
            | Operation::FloatStore { words, .. } => u64::from(words.max(1)),
            Operation::IfThen(_) | Operation::Nothing => 0,
            _ => 1,
        }
    }
}

/// Returns the number of accesses by a load or store of one register: an unaligned access is split,
/// and each part counts. Nothing is known of the register that the address is made from: it is
/// taken for such a multiple, which the replay checks.
pub(crate) fn accesses(instruction: &Instruction) -> u64 {
    let (Operation::Load {
        words: 1,
        bytes,
        address,
        ..
    }
    | Operation::Store {
        words: 1,
        bytes,
        address,
        ..
    }) = instruction.operation
    else {
        return 1;
    };
    match address {
        Address::Absolute(address) => accesses_at(bytes, address),
        Address::Offset { offset, .. } => accesses_at(bytes, offset.cast_unsigned()),
        // Words are indexed by multiples of their length; halves also as pairs of bytes.
        Address::Indexed { shift: 0, .. } if bytes == 2 => 2,
        Address::Indexed { .. } => 1,
    }
}

/// Accesses to so many bytes at an address.
pub(crate) const fn accesses_at(bytes: u8, address: u32) -> u64 {
    match (bytes, address % 4) {
        (4, 2) | (2, 1 | 3) => 2,
        (4, 1 | 3) => 3,
        _ => 1,
    }
}

/// The lines of a block, with the lines that may be fetched beyond its end.
pub fn lines(block: &Block) -> std::ops::RangeInclusive<u32> {
    let begin = block.instructions.first().map_or(0, |first| first.address);
    let end = block
        .instructions
        .last()
        .map_or(begin + 2, Instruction::end);
    begin / LINE_BYTES..=(end - 1 + PREFETCH_BYTES) / LINE_BYTES
}

/// Lines of `next` to be fetched when execution falls through from `before`: all but the line in
/// use and the line fetched ahead.
pub(crate) fn new_lines(before: &Block, next: &Block) -> u64 {
    let end = before.instructions.last().map_or(0, Instruction::end);
    let used = (end.saturating_sub(1)) / LINE_BYTES
        ..=(end.saturating_sub(1) + PREFETCH_BYTES) / LINE_BYTES;
    lines(next).filter(|line| !used.contains(line)).count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{CLOCK, plain};

    fn with(operation: Operation) -> Instruction {
        Instruction {
            operation,
            ..plain(0x0800_0000)
        }
    }

    fn load(words: u8) -> Instruction {
        with(Operation::Load {
            writes: 1,
            first: None,
            words,
            bytes: 4,
            address: Address::Indexed {
                base: 0,
                index: 1,
                shift: 0,
            },
            writeback: None,
        })
    }

    #[test]
    fn costs_are_those_of_the_manual() {
        let model = Model::new(&CLOCK);
        assert_eq!(model.cycles(&load(1), Region::Sram), 2);
        assert_eq!(model.cycles(&load(4), Region::Sram), 5);
        assert_eq!(model.cycles(&load(1), Region::Apb1), 14);
        assert_eq!(model.cycles(&load(1), Region::Apb2), 8);
        assert_eq!(model.cycles(&load(1), Region::Unknown), 14);
        assert_eq!(model.cycles(&load(1), Region::Flash), 12);
        let divide = with(Operation::Divide { writes: 1 });
        assert_eq!(model.cycles(&divide, Region::Unknown), 12);
        assert_eq!((model.miss(), model.refill()), (5, 3));
    }

    #[test]
    fn what_is_at_no_multiple_of_its_length_costs_several_accesses() {
        let model = Model::new(&CLOCK);
        let cycles = |bytes, address, region| {
            let load = Operation::Load {
                writes: 1,
                first: None,
                words: 1,
                bytes,
                address,
                writeback: None,
            };
            model.cycles(&with(load), region)
        };
        let at = |offset| Address::Offset { base: 4, offset };
        let of_index = |shift| Address::Indexed {
            base: 4,
            index: 1,
            shift,
        };
        assert_eq!(cycles(4, at(8), Region::Sram), 2);
        assert_eq!(cycles(4, at(114), Region::Sram), 3);
        assert_eq!(cycles(4, at(-3), Region::Sram), 4);
        assert_eq!(cycles(2, at(501), Region::Sram), 3);
        assert_eq!(cycles(1, at(501), Region::Sram), 2);
        assert_eq!(cycles(2, at(501), Region::Flash), 2 + 10 + 11);
        assert_eq!(cycles(2, of_index(0), Region::Sram), 3);
        assert_eq!(cycles(2, of_index(1), Region::Sram), 2);
    }

    #[test]
    fn a_measured_cost_counts_only_when_it_is_higher() {
        let mut model = Model::new(&CLOCK);
        let measured = [("divide", 9), ("refill", 4), ("nonsense", 1)];
        let measured = measured.map(|(name, cycles)| (name.to_owned(), cycles));
        assert_eq!(model.calibrate(&measured.into()), ["nonsense"]);
        let divide = with(Operation::Divide { writes: 1 });
        assert_eq!(model.cycles(&divide, Region::Unknown), 12);
        assert_eq!(model.refill(), 4);
    }

    #[test]
    fn a_block_that_is_fallen_into_shares_its_first_line() {
        let block = |begin: u32, count: u32| Block {
            instructions: (0..count).map(|index| plain(begin + 2 * index)).collect(),
            successors: Vec::new(),
            call: None,
            ends: false,
            traps: false,
        };
        let (first, second) = (block(0x100, 4), block(0x108, 16));
        assert_eq!(lines(&first), 0x10..=0x11);
        assert_eq!(lines(&second), 0x10..=0x13);
        assert_eq!(new_lines(&first, &second), 2);
    }
}
