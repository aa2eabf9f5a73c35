//! Stores to registers that the proof rests on: clocks, flash, DMA, the processor's own.
//!
//! Only the stores that `schedule.toml` names may write to these registers, and the value stored to
//! the access control of the flash must agree with the clocks of `schedule.toml`. An alias of a bit
//! counts as the word that the bit is in. A store to a peripheral at an unknown address is refused,
//! since the target may be such a register; so is a volatile store at an unknown address. Other
//! stores that may go anywhere are taken for those of memory-safe Rust, which go to memory.

use std::collections::BTreeSet;

use crate::{
    Flaw, Frame, Function, Operation, Region, Rule, Store,
    graph::{CONTROL, MAIN_STACK, PROCESS_STACK},
    releases::SET_PENDING,
    system::{System, misconfigured},
};

/// Registers that the proof rests on. RM0090 table 1, ARMv7-M B3.
const PROTECTED: [(u32, u32, &str); 8] = [
    (0x4000_7000, 0x4000_7400, "the voltages of the core"),
    (0x4001_3800, 0x4001_3804, "the memory at address 0"),
    (0x4002_3800, 0x4002_3c00, "the clocks"),
    (0x4002_3c00, 0x4002_4000, "the flash"),
    (0x4002_6000, 0x4002_6800, "DMA"),
    (0x4002_8000, 0x4002_c000, "the DMA of Ethernet and graphics"),
    (0x4004_0000, 0x4008_0000, "the DMA of USB"),
    (0xe000_0000, 0xe010_0000, "the processor"),
];
/// The access control of the flash, and what of it the time of an instruction depends on: wait
/// states, prefetch, instruction cache. RM0090 3.9.1.
const FLASH_ACCESS: u32 = 0x4002_3c00;
const FLASH_ACCESS_TIMES: u32 = 0x30f;
const PREFETCH: u32 = 1 << 8;
const INSTRUCTION_CACHE: u32 = 1 << 9;
/// What runs before memory has its first values, and so before any task.
const PRE_INIT: &str = "__pre_init";
/// Enables and priorities of interrupts, which are compared with the tasks.
const INTERRUPT_REGISTERS: [(u32, u32); 3] = [
    (0xe000_e100, 0xe000_e120),
    (0xe000_e400, 0xe000_e4f0),
    (0xe000_ed18, 0xe000_ed24),
];
/// The first function, before there is a stack to speak of.
const RESET: &str = "Reset";
/// Aliases of the bits of peripherals: where they begin and end, and the aliased memory.
const BIT_BAND_ALIASES: std::ops::Range<u32> = 0x4200_0000..0x4400_0000;
const PERIPHERALS: u32 = 0x4000_0000;
const BYTES_PER_BIT_ALIAS: u32 = 32;

/// The registers with which the stores are compared.
pub(crate) struct Registers<'a> {
    pub(crate) system: &'a System<'a>,
}

impl Registers<'_> {
    /// All stores that are refused.
    pub(crate) fn flaws(&self) -> Vec<Flaw> {
        let functions = self.system.program.functions().values();
        let all = functions.flat_map(|function| {
            let stores = function.stores.iter();
            stores.filter_map(|store| self.flaw(function, store))
        });
        all.chain(self.specials())
            .chain(self.uncosted())
            .chain(self.unlimited())
            .collect()
    }

    /// Entries of `schedule.toml` that would let anybody store anywhere.
    fn unlimited(&self) -> impl Iterator<Item = Flaw> {
        let entries = self.system.config.register.iter();
        let entries = entries.filter(|it| {
            // Anybody may pend vectors: `releases` says of each task which.
            let is_anybody = it.by.iter().any(String::is_empty);
            is_anybody && !(SET_PENDING.start <= it.from && it.to <= SET_PENDING.end)
                || Region::of(it.from) != Region::of(it.to.saturating_sub(1))
                || Region::of(it.from) == Region::Unknown
        });
        entries.map(|it| {
            let what = format!(
                "a `[[register]]` of `schedule.toml` allows stores to {:#010x} and on for anybody, or in more \
                 than one region",
                it.from
            );
            misconfigured(what, "Name who stores, and one region.")
        })
    }

    /// Writes of the processor's registers that choose the stack and take privileges: the depth of the stack and
    /// the masks of interrupts rest on them. What is exempt has to see to them itself.
    fn specials(&self) -> Vec<Flaw> {
        let functions = self.system.program.functions().values();
        let counted = functions.filter(|it| self.system.config.exemption(&it.name).is_none());
        let instructions =
            counted.flat_map(|function| function.instructions().map(move |it| (function, it)));
        let flaws = instructions.filter_map(|(function, instruction)| {
            let name = match instruction.operation {
                Operation::WriteSpecial { register, .. } => match register {
                    MAIN_STACK => "the stack pointer",
                    PROCESS_STACK => "another stack pointer",
                    CONTROL => "CONTROL",
                    _ => return None,
                },
                _ => return None,
            };
            (function.name != RESET).then(|| {
                let what =
                    format!("a write of {name}: the depth of the stack and the locks rest on it");
                let remedy = "Leave it out: all tasks run privileged, on the main stack.";
                self.system
                    .flaw(Rule::Register, instruction.address, what, remedy)
            })
        });
        flaws.collect()
    }

    fn flaw(&self, function: &Function, store: &Store) -> Option<Flaw> {
        let (what, remedy) = match store.to {
            Some(to) => self.to_known(function, store, to)?,
            None => self.to_computed(store)?,
        };
        Some(self.system.flaw(Rule::Register, store.at, what, remedy))
    }

    /// The flaw of a store to a constant address, and its remedy.
    fn to_known(&self, function: &Function, store: &Store, to: u32) -> Option<(String, String)> {
        let (from, end) = match word_of_alias(to) {
            word if word != to => (word, word + 4),
            _ => (to, to.saturating_add(store.bytes)),
        };
        let (.., name) = PROTECTED.iter().find(|it| from < it.1 && it.0 < end)?;
        let is_within = |first: u32, last: u32| first <= from && end <= last;
        let is_byte = store.bytes == 1 && store.value.is_some();
        let is_enable = from < INTERRUPT_REGISTERS[0].1 && store.value.is_some();
        if (is_byte || is_enable) && INTERRUPT_REGISTERS.iter().any(|it| is_within(it.0, it.1)) {
            return None;
        }
        if from == FLASH_ACCESS && !BIT_BAND_ALIASES.contains(&to) {
            return self.flash_access(function, store);
        }
        let frames = self.system.image.frames(store.at);
        let mut allowed = self.system.config.register.iter();
        if allowed.any(|it| is_within(it.from, it.to) && is_by(&it.by, function, &frames)) {
            return None;
        }
        Some((
            format!("a store to {from:#010x}, a register of {name} that the proof rests on"),
            "Leave it out; or say in `schedule.toml`, in a `[[register]]`, who may do it and why it \
             changes no time."
                .to_owned(),
        ))
    }

    /// The same for the access control of the flash. What is not known must be followed by what is.
    fn flash_access(&self, function: &Function, store: &Store) -> Option<(String, String)> {
        let prefetch = if self.system.clock.prefetch {
            PREFETCH
        } else {
            0
        };
        let expected = self.system.clock.flash_wait_states as u32 | prefetch | INSTRUCTION_CACHE;
        let remedy = format!(
            "Write a constant of which the bits {FLASH_ACCESS_TIMES:#x} are {expected:#x}, as the \
             clock in `schedule.toml` says."
        );
        let frames = self.system.image.frames(store.at);
        let mut allowed = self.system.config.register.iter();
        let is_allowed = allowed.any(|it| {
            it.from <= FLASH_ACCESS && FLASH_ACCESS < it.to && is_by(&it.by, function, &frames)
        });
        // `clocks::start` comes behind it: the order of `[startup]`.
        if is_allowed && function.name == PRE_INIT {
            return None;
        }
        let Some(value) = store.value else {
            let what = "something that is not known is written to the access control of the flash";
            let is_harmless = is_allowed && is_overwritten(function, store);
            return (!is_harmless).then(|| (what.to_owned(), remedy));
        };
        let found = value & FLASH_ACCESS_TIMES;
        (found != expected).then(|| {
            let what = format!(
                "the access control of the flash becomes {found:#x}, and not {expected:#x}: wait \
                 states, prefetch, instruction cache"
            );
            (what, remedy)
        })
    }

    /// The flaw of a store to an unknown address.
    fn to_computed(&self, store: &Store) -> Option<(String, String)> {
        let frames = self.system.image.frames(store.at);
        let is_suspect = match store.region {
            Region::Ahb | Region::Apb1 | Region::Apb2 | Region::Private => true,
            Region::Unknown => frames.iter().any(is_volatile),
            Region::Flash | Region::Sram | Region::Ccm | Region::Usb | Region::Uncosted => false,
        };
        let mut allowed = self.system.config.register.iter().filter(|it| it.computed);
        let is_allowed = allowed.any(|it| {
            let is_there = store.region == Region::Unknown || Region::of(it.from) == store.region;
            is_there && is_inlined(&it.by, &frames)
        });
        (is_suspect && !is_allowed).then(|| {
            let what = match store.region {
                Region::Private => "a store to a register of the processor at a computed address",
                _ => "a store to a register at a computed address",
            };
            (
                what.to_owned(),
                "Write to a constant address; or say in `schedule.toml`, in a `[[register]]`, who may \
                 do it and why it stays clear of what the proof rests on."
                    .to_owned(),
            )
        })
    }

    /// Accesses whose time is not known, outside of what is exempt.
    fn uncosted(&self) -> Vec<Flaw> {
        let functions = self.system.program.functions().values();
        let counted = functions.filter(|it| self.system.config.exemption(&it.name).is_none());
        let accesses: BTreeSet<u32> = counted
            .flat_map(|function| &function.regions)
            .filter(|(_, region)| **region == Region::Uncosted)
            .map(|(at, _)| *at)
            .collect();
        let flaws = accesses.into_iter().map(|at| {
            let what = "an access to an alias of a bit, to the high-speed core of USB or to external memory: the model has no time for it";
            let remedy = "Read and write the whole word at its own address, or use a register that sets bits.";
            self.system.flaw(Rule::UncostedAccess, at, what, remedy)
        });
        flaws.collect()
    }
}

/// The word that an address is an alias of a bit of; other addresses as they are.
pub(crate) fn word_of_alias(address: u32) -> u32 {
    if BIT_BAND_ALIASES.contains(&address) {
        PERIPHERALS + (((address - BIT_BAND_ALIASES.start) / BYTES_PER_BIT_ALIAS) & !3)
    } else {
        address
    }
}

/// Whether an instruction with these frames is of one of some functions or files, or inlined there.
pub(crate) fn is_inlined(by: &[String], frames: &[Frame]) -> bool {
    frames.iter().any(|frame| {
        let is_in = |by: &String| frame.function.contains(&**by) || frame.file.contains(&**by);
        by.iter().any(is_in)
    })
}

/// The same, where assembly may have no frames.
pub(crate) fn is_by(by: &[String], function: &Function, frames: &[Frame]) -> bool {
    by.contains(&function.name) || is_inlined(by, frames)
}

fn is_volatile(frame: &Frame) -> bool {
    frame.function.contains("write_volatile")
}

/// Whether what a store writes is overwritten with a constant before the function returns.
fn is_overwritten(function: &Function, store: &Store) -> bool {
    let known = function.stores.iter();
    let known: BTreeSet<u32> = known
        .filter(|it| it.to == store.to && it.value.is_some())
        .map(|it| it.at)
        .collect();
    let has = |block: usize, after: u32| {
        let mut instructions = function.blocks[block].instructions.iter();
        instructions.any(|it| it.address > after && known.contains(&it.address))
    };
    let holds = |block: &usize| {
        let mut instructions = function.blocks[*block].instructions.iter();
        instructions.any(|it| it.address == store.at)
    };
    let mut blocks = 0..function.blocks.len();
    let Some(first) = blocks.find(holds) else {
        return false;
    };
    let judge = |block: usize| {
        let is_known = block != first && has(block, 0);
        if is_known {
            Some(false)
        } else {
            function.blocks[block].ends.then_some(true)
        }
    };
    has(first, store.at) || !function.leads(first, judge)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn an_unknown_value_must_be_overwritten_on_every_path() {
        // 0: unknown; 1 or 2; 3: the end.
        let shape: &[(u32, &[usize])] = &[(2, &[1, 2]), (2, &[3]), (2, &[3]), (2, &[])];
        let mut function = testing::function(shape);
        let at = |function: &Function, block: usize| function.blocks[block].instructions[0].address;
        let unknown = testing::store(at(&function, 0), FLASH_ACCESS, None);
        let known = |function: &Function, block| {
            testing::store(at(function, block), FLASH_ACCESS, Some(0x205))
        };
        function.stores = vec![unknown, known(&function, 1)];
        assert!(!is_overwritten(&function, &unknown));
        function.stores.push(known(&function, 2));
        assert!(is_overwritten(&function, &unknown));
        function.stores = vec![unknown, known(&function, 3)];
        assert!(is_overwritten(&function, &unknown));
    }
}
