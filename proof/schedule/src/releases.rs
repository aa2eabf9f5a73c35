//! What releases the tasks: the vectors that each pends, the flags that hardware sets, and the registers that say how
//! often hardware does so.
//!
//! All of it is read from the machine code: a task with a deadline pends no vector that `schedule.toml` does not name,
//! no handler pends its own vector on every path, each handler reads the flag that released it and clears it, and
//! registers such as the period of a timer get the values that `schedule.toml` names, and no others.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    AppTask, Config, Flaw, Function, Image, Place, Rule, Store,
    config::{ControlConfig, FlagConfig},
    crosscheck::FIRST_INTERRUPT,
    registers::word_of_alias,
    system::{System, misconfigured},
};

/// The registers that pend vectors, a bit each, and the one to which the number is written: ARMv7-M B3.4.
pub(crate) const SET_PENDING: std::ops::Range<u32> = 0xe000_e200..0xe000_e240;
const SOFTWARE_TRIGGER: u32 = 0xe000_ef00;
/// The register that pends exceptions of the processor, and the bits that pend `PendSV` and `SysTick`: ARMv7-M B3.2.4.
const INTERRUPT_CONTROL: u32 = 0xe000_ed04;
const PENDED_EXCEPTIONS: [(u32, usize); 2] = [(1 << 28, 14), (1 << 26, 15)];
/// Peripherals are so many bytes apart.
const PERIPHERAL_BYTES: u32 = 0x400;

/// What the releases are read from.
pub(crate) struct Releases<'a> {
    pub(crate) system: &'a System<'a>,
}

/// The tasks that each task releases, by their names.
pub(crate) type Graph = BTreeMap<String, BTreeSet<String>>;

impl Releases<'_> {
    /// The graph, and all that is wrong.
    pub(crate) fn flaws(&self) -> (Graph, Vec<Flaw>) {
        let mut graph = Graph::new();
        let mut flaws = Vec::new();
        for task in self
            .system
            .app
            .tasks
            .iter()
            .filter(|task| task.priority > 0)
        {
            let released = graph.entry(task.name.clone()).or_default();
            let has_deadline = { self.system.config.task.get(&task.name) }
                .is_some_and(|config| config.undeadlined.is_none());
            for handler in self.handlers(task) {
                for (store, other) in self.pended(handler) {
                    let is_new = released.insert(other.name.clone());
                    if is_new && has_deadline && !self.is_allowed(task, other) {
                        flaws.push(undeclared(task, other, self.system.image.place(store.at)));
                    }
                }
                if has_deadline && self.always_pends(handler, task) {
                    flaws.push(endless(task));
                }
            }
        }
        let flags = self.system.config.flag.iter();
        flaws.extend(flags.filter_map(|flag| self.uncleared(flag)));
        let controls = self.system.config.control.iter();
        flaws.extend(controls.flat_map(|control| self.of_control(control)));
        (graph, flaws)
    }

    fn handlers(&self, task: &AppTask) -> BTreeSet<u32> {
        handlers(self.system.image, self.system.config, task)
    }

    /// Whether `schedule.toml` says that a task may release another.
    fn is_allowed(&self, task: &AppTask, other: &AppTask) -> bool {
        let config = self.system.config.task.get(&task.name);
        config.is_some_and(|config| config.releases.contains(&other.name))
    }

    /// The stores of a handler, and of what it calls, that pend a task.
    fn pended(&self, handler: u32) -> Vec<(&Store, &AppTask)> {
        let reached = self.system.program.reached(handler);
        let functions = reached.filter(|it| self.system.config.exemption(&it.name).is_none());
        let stores = functions.flat_map(|function| &function.stores);
        let pended = stores.flat_map(|store| {
            let slots = slots(store);
            let tasks = self
                .system
                .app
                .tasks
                .iter()
                .filter(|task| task.priority > 0);
            let tasks = tasks.filter(move |task| {
                let vectors = self.system.image.vectors();
                let handlers = self.handlers(task);
                let mut slots = slots.iter();
                slots.any(|slot| {
                    vectors
                        .get(*slot)
                        .is_some_and(|it| handlers.contains(&(it & !1)))
                })
            });
            tasks.map(move |task| (store, task))
        });
        pended.collect()
    }

    /// Whether each run of a handler pends a vector of its own task.
    fn always_pends(&self, handler: u32, task: &AppTask) -> bool {
        let own = self.pended(handler);
        let own = own.into_iter().filter(|(_, other)| other.name == task.name);
        let stores: BTreeSet<u32> = own.map(|(store, _)| store.at).collect();
        !stores.is_empty() && self.passes(handler, &stores)
    }

    /// Whether every way through a function, and what it calls, executes one of some instructions.
    fn passes(&self, address: u32, instructions: &BTreeSet<u32>) -> bool {
        let Some(function) = self.system.program.function(address) else {
            return false;
        };
        let judge = |block: usize| {
            let block = &function.blocks[block];
            let mut own = block.instructions.iter().filter(|it| !it.is_conditional());
            let calls = || block.call.is_some_and(|it| self.passes(it, instructions));
            let is_passed =
                block.traps || own.any(|it| instructions.contains(&it.address)) || calls();
            if is_passed {
                Some(false)
            } else {
                block.ends.then_some(true)
            }
        };
        !function.leads(0, judge)
    }

    /// A handler that does not read the flag which released it, or does not clear it.
    fn uncleared(&self, flag: &FlagConfig) -> Option<Flaw> {
        let handler = self.system.image.symbol(&flag.vector)?;
        // Another board may have another peripheral, and the same handler for its vector.
        if Some(handler) == self.system.image.symbol("DefaultHandler")
            || !self.is_used(flag.register)
        {
            return None;
        }
        let functions: Vec<&Function> = self.system.program.reached(handler).collect();
        let accesses = |register: u32| {
            let all = functions.iter().flat_map(|function| &function.addresses);
            let of_register = all.filter(move |(_, to)| **to == register);
            of_register.map(|(at, _)| *at).collect::<BTreeSet<u32>>()
        };
        let clears = if flag.is_read {
            !accesses(flag.clears).is_empty()
        } else {
            let mut stores = functions.iter().flat_map(|function| &function.stores);
            stores.any(|store| store.to == Some(flag.clears))
        };
        let is_read = self.passes(handler, &accesses(flag.register));
        let what = match (is_read, clears) {
            (true, true) => return None,
            (false, _) => format!(
                "a run of `{}` may end without a read of {:#010x}, the flag that releases it",
                flag.vector, flag.register
            ),
            (true, false) => format!(
                "`{}` does not clear the flag that releases it, by {:#010x}: it would run for ever",
                flag.vector, flag.clears
            ),
        };
        let remedy = "Read the flag in each run, and clear it.";
        Some(self.system.flaw(Rule::Release, handler, what, remedy))
    }

    /// Whether the program uses the peripheral that has a register.
    fn is_used(&self, register: u32) -> bool {
        let first = register & !(PERIPHERAL_BYTES - 1);
        let functions = self.system.program.functions().values();
        let mut accessed = functions.flat_map(|function| function.addresses.values());
        accessed.any(|to| (first..first + PERIPHERAL_BYTES).contains(to))
    }

    /// Stores to a register other than those of the values that it may have.
    fn of_control(&self, control: &ControlConfig) -> Vec<Flaw> {
        let values: Result<Vec<u32>, String> = { control.values.iter() }
            .map(|formula| Ok(self.system.config.constant(formula)? as u32))
            .collect();
        let values = match values {
            Ok(values) => values,
            Err(error) => return vec![misconfigured(error, "Correct the formula.")],
        };
        let registers = control.registers.iter();
        let flaws = registers.flat_map(|register| self.of_register(control, *register, &values));
        flaws.collect()
    }

    fn of_register(&self, control: &ControlConfig, register: u32, values: &[u32]) -> Vec<Flaw> {
        let functions = self.system.program.functions().values();
        let stores = functions.flat_map(|it| it.stores.iter().map(move |store| (it, store)));
        let own: Vec<_> = stores.filter(|(_, store)| is_to(store, register)).collect();
        // Without a mask the value is claimed: that of a reset is another.
        if own.is_empty() && control.mask.is_none() && self.is_used(register) {
            let what = format!("nothing is written to {register:#010x}: {}", control.reason);
            let remedy = "Write the value that `schedule.toml` names.";
            return vec![misconfigured(what, remedy)];
        }
        let mask = control.mask.unwrap_or(u32::MAX);
        let flaws = own.into_iter().filter_map(|(function, store)| {
            let bytes = u32::MAX >> (32 - 8 * store.bytes.clamp(1, 4));
            let whole = store.value.filter(|_| store.to == Some(register));
            let value = whole.map(|value| value & bytes & mask);
            if value.is_some_and(|value| values.contains(&value)) {
                return None;
            }
            let what = wrong_value(control, register, value, values, function);
            let remedy = "Write what the `[[control]]` in `schedule.toml` names, as a constant.";
            Some(self.system.flaw(Rule::Release, store.at, what, remedy))
        });
        flaws.collect()
    }
}

/// Whether a store goes to a register, to a part of it, or to the alias of a bit of it.
fn is_to(store: &Store, register: u32) -> bool {
    store
        .to
        .is_some_and(|to| word_of_alias(to) & !3 == register)
}

/// The handlers of a task, also those of other vectors that call the task's.
pub(crate) fn handlers(image: &Image, config: &Config, task: &AppTask) -> BTreeSet<u32> {
    let more = config.task.get(&task.name);
    let more = more.map_or(&[][..], |config| config.vectors.as_slice());
    let default = image.symbol("DefaultHandler");
    let all = [&task.vector].into_iter().chain(more);
    all.filter_map(|vector| image.symbol(vector))
        .filter(|handler| Some(*handler) != default)
        .collect()
}

/// The slots of the vector table that a store pends: all that it may, where its value is not known.
fn slots(store: &Store) -> BTreeSet<usize> {
    let Some(to) = store.to else {
        return BTreeSet::new();
    };
    let bits = store.value.unwrap_or(u32::MAX);
    if SET_PENDING.contains(&to) {
        let first = FIRST_INTERRUPT + ((to - SET_PENDING.start) * 8) as usize;
        let set = (0..32).filter(|bit| bits >> bit & 1 != 0);
        return set.map(|bit| first + bit).collect();
    }
    if to == SOFTWARE_TRIGGER {
        return match store.value {
            Some(number) => BTreeSet::from([FIRST_INTERRUPT + number as usize]),
            None => (FIRST_INTERRUPT..FIRST_INTERRUPT + 240).collect(),
        };
    }
    let exceptions = PENDED_EXCEPTIONS.into_iter();
    let pended = exceptions.filter(|(bit, _)| to == INTERRUPT_CONTROL && bits & bit != 0);
    pended.map(|(_, slot)| slot).collect()
}

fn undeclared(task: &AppTask, other: &AppTask, place: Place) -> Flaw {
    let what = format!(
        "`{}` may release `{}`, and `schedule.toml` does not say so",
        task.name, other.name
    );
    let remedy = format!(
        "Leave it out; or add `{}` to the `releases` of `task.{}`, and see that its period and rate still hold.",
        other.name, task.name
    );
    Flaw::new(Rule::Release, what, place, remedy)
}

fn endless(task: &AppTask) -> Flaw {
    let what = format!(
        "each run of `{}` releases the next: what is less urgent never runs",
        task.name
    );
    let remedy = "Release it only while there is something to do.";
    Flaw::new(Rule::Release, what, task.place(), remedy)
}

/// The sentence on a value that a register must not have.
fn wrong_value(
    control: &ControlConfig,
    register: u32,
    value: Option<u32>,
    values: &[u32],
    function: &Function,
) -> String {
    let allowed: Vec<String> = values.iter().map(|value| format!("{value:#x}")).collect();
    let value = value.map_or("something unknown".to_owned(), |value| {
        format!("{value:#x}")
    });
    let masked = control.mask.map(|mask| format!(" in the bits {mask:#x}"));
    format!(
        "`{}` writes {value} to {register:#010x}{}, and not {}: {}",
        function.name,
        masked.unwrap_or_default(),
        allowed.join(" or "),
        control.reason
    )
}
