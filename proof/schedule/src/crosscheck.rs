//! Whether the binary is what the source says: vectors, priorities, ceilings.
//!
//! A task's handler must be in its own vector and in the vectors that `schedule.toml` gives the
//! task, and in no other; the priority that is written for the vector must be the task's; sections
//! must have the ceilings of resources. A vector that belongs to no task must not interrupt
//! anything.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    AppTask, Flaw, Function, Place, Rule,
    registers::is_by,
    sections::{Held, UNKNOWN_CEILING},
    system::System,
};

/// The first vector that is not the processor's own.
pub(crate) const FIRST_INTERRUPT: usize = 16;
/// Vectors of the processor after which the machine goes on: NMI, SVC, the debug monitor, `PendSV`,
/// `SysTick`. Faults end everything.
const SYSTEM: [(usize, &str); 5] = [
    (2, "NonMaskableInt"),
    (11, "SVCall"),
    (12, "DebugMonitor"),
    (14, "PendSV"),
    (15, "SysTick"),
];
/// Registers of the interrupt controller: enables, priorities. ARMv7-M reference manual B3.4.
const ENABLES: std::ops::Range<u32> = 0xe000_e100..0xe000_e120;
const PRIORITIES: std::ops::Range<u32> = 0xe000_e400..0xe000_e4f0;
/// The priorities of the processor's own vectors, from the fourth on: B3.2.
const SYSTEM_PRIORITIES: std::ops::Range<u32> = 0xe000_ed18..0xe000_ed24;
const FIRST_SYSTEM: usize = 4;

/// The compared program, application and configuration, and the sections of the program.
pub(crate) struct Crosscheck<'a> {
    pub(crate) system: &'a System<'a>,
    pub(crate) sections: &'a [Held],
}

/// The vector whose priority a register holds, if it is such a register.
fn slot_of_priority(address: u32) -> Option<usize> {
    if PRIORITIES.contains(&address) {
        return Some(FIRST_INTERRUPT + (address - PRIORITIES.start) as usize);
    }
    let is_system = SYSTEM_PRIORITIES.contains(&address);
    is_system.then(|| FIRST_SYSTEM + (address - SYSTEM_PRIORITIES.start) as usize)
}

impl Crosscheck<'_> {
    /// All contradictions.
    pub(crate) fn flaws(&self) -> Vec<Flaw> {
        let mut flaws = Vec::new();
        let written = self.priorities();
        let mut known: BTreeSet<usize> = BTreeSet::new();
        for task in self
            .system
            .app
            .tasks
            .iter()
            .filter(|task| task.priority > 0)
        {
            let slots = self.task_slots(task, &mut flaws);
            for slot in &slots {
                flaws.extend(Self::priority(task, *slot, &written));
            }
            known.extend(slots);
        }
        flaws.extend(self.unowned_vectors(&known));
        flaws.extend(self.ceilings());
        flaws.extend(self.idle());
        flaws.extend(self.exempt_handlers(&known));
        flaws
    }

    /// The slots of the vector table that hold a handler.
    fn slots(&self, handler: u32) -> BTreeSet<usize> {
        let vectors = self.system.image.vectors().iter().enumerate().skip(1);
        let slots = vectors.filter(|(_, vector)| **vector & !1 == handler);
        slots.map(|(slot, _)| slot).collect()
    }

    /// The slots of a task: its own, and the slots of vectors whose handlers call the task.
    fn task_slots(&self, task: &AppTask, flaws: &mut Vec<Flaw>) -> BTreeSet<usize> {
        let more = self.system.config.task.get(&task.name);
        let more = more.map_or(&[][..], |config| config.vectors.as_slice());
        let mut slots = BTreeSet::new();
        let default = self.system.image.symbol("DefaultHandler");
        // Another board may have its own vectors besides.
        let is_used = |vector: &&String| {
            let handler = self.system.image.symbol(vector);
            handler.is_some() && handler != default
        };
        let more: Vec<&String> = more.iter().filter(is_used).collect();
        for vector in [&task.vector].into_iter().chain(more.iter().copied()) {
            let found = self
                .system
                .image
                .symbol(vector)
                .map(|handler| self.slots(handler));
            if let Some(found) = found.filter(|found| !found.is_empty()) {
                slots.extend(found);
            } else {
                let name = &task.name;
                let what = format!("no vector of the binary holds `{vector}` of the task `{name}`");
                let remedy = "Build the ELF from this source, or correct the name of the vector.";
                flaws.push(Flaw::new(Rule::Mismatch, what, task.place(), remedy));
            }
        }
        if slots.len() > 1 + more.len() {
            let what = format!(
                "the handler of `{}` is in {} vectors",
                task.name,
                slots.len()
            );
            let remedy = "Name the vectors that call it in `schedule.toml`.";
            flaws.push(Flaw::new(Rule::Mismatch, what, task.place(), remedy));
        }
        slots
    }

    /// The priorities that the program writes, by slot.
    fn priorities(&self) -> BTreeMap<usize, BTreeSet<Option<u32>>> {
        let mut written: BTreeMap<usize, BTreeSet<Option<u32>>> = BTreeMap::new();
        let functions = self.system.program.functions().values();
        for store in functions.flat_map(|function| &function.stores) {
            let Some(slot) = store.to.and_then(slot_of_priority) else {
                continue;
            };
            // Registers of priorities are bytes.
            let value = store.value.filter(|_| store.bytes == 1);
            written.entry(slot).or_default().insert(value);
        }
        written
    }

    fn priority(
        task: &AppTask,
        slot: usize,
        written: &BTreeMap<usize, BTreeSet<Option<u32>>>,
    ) -> Option<Flaw> {
        let expected = u32::from(16_u8.saturating_sub(task.priority)) << 4;
        let found = written.get(&slot);
        if found.is_some_and(|found| found.iter().all(|value| *value == Some(expected))) {
            return None;
        }
        let found = found.map_or("nothing".to_owned(), |found| {
            let values = found.iter().map(|value| match value {
                Some(value) => format!("{value:#04x}"),
                None => "something unknown".to_owned(),
            });
            values.collect::<Vec<_>>().join(" and ")
        });
        let what = format!(
            "the binary writes {found} as priority of vector {slot}, the source of `{}` says {} \
             ({expected:#04x})",
            task.name, task.priority,
        );
        let remedy = "Build the ELF from this source; a priority must be written as a constant.";
        Some(Flaw::new(Rule::Mismatch, what, task.place(), remedy))
    }

    /// Vectors that may interrupt and belong to no task.
    fn unowned_vectors(&self, known: &BTreeSet<usize>) -> Vec<Flaw> {
        let default = self.system.image.symbol("DefaultHandler");
        let mut flaws = Vec::new();
        for (slot, vector) in self.system.image.vectors().iter().enumerate().skip(1) {
            let handler = vector & !1;
            let system = SYSTEM.iter().find(|(number, _)| *number == slot);
            let is_task = known.contains(&slot) || (slot < FIRST_INTERRUPT && system.is_none());
            if is_task || handler == 0 || Some(handler) == default {
                continue;
            }
            let name = system.map_or_else(
                || self.system.image.name(handler),
                |(_, name)| (*name).to_owned(),
            );
            if self.system.config.exemption(&name).is_none() {
                let what = format!("vector {slot} (`{name}`) belongs to no task");
                let remedy = "Make it a task, or say in `schedule.toml` to which task it belongs.";
                flaws.push(Flaw::new(Rule::Mismatch, what, Place::default(), remedy));
            }
        }
        let functions = self.system.program.functions().values();
        let stores = functions.flat_map(|function| {
            let stores = function.stores.iter();
            stores.filter_map(move |it| Some((function, it.at, it.to?, it.value)))
        });
        for (function, at, address, value) in stores.filter(|store| ENABLES.contains(&store.2)) {
            let first = FIRST_INTERRUPT + ((address - ENABLES.start) * 8) as usize;
            // An unknown value may have all bits.
            let bits = value.unwrap_or(u32::MAX);
            for bit in (0..32).filter(|bit| bits >> bit & 1 != 0) {
                let Some(handler) = self.system.image.vectors().get(first + bit) else {
                    continue;
                };
                let handler = handler & !1;
                // The time of what is exempt counts nowhere: only who is named may let it run.
                let is_exempt = self
                    .system
                    .config
                    .exemption(&self.system.image.name(handler))
                    .is_some()
                    && self.may_store(function, at, address);
                if !known.contains(&(first + bit)) && !is_exempt {
                    let what = format!("vector {} is enabled and belongs to no task", first + bit);
                    let remedy = "Make it a task, or leave it disabled; write a constant. Who enables what is \
                        exempt needs a `[[register]]` in `schedule.toml`.";
                    flaws.push(self.system.flaw(Rule::Mismatch, at, what, remedy));
                }
            }
        }
        flaws
    }

    /// Handlers of tasks that are exempt: their locks and their time would count nowhere.
    fn exempt_handlers(&self, known: &BTreeSet<usize>) -> Vec<Flaw> {
        let vectors = known
            .iter()
            .filter_map(|slot| self.system.image.vectors().get(*slot));
        let handlers: BTreeSet<String> =
            vectors.map(|it| self.system.image.name(it & !1)).collect();
        let tasks = self
            .system
            .app
            .tasks
            .iter()
            .map(|task| format!("::{}", task.name));
        let tasks: Vec<String> = tasks.collect();
        let exempt = self
            .system
            .config
            .exempt
            .iter()
            .map(|exempt| &exempt.function);
        let wrong = exempt.filter(|name| {
            handlers.contains(*name) || tasks.iter().any(|task| name.ends_with(task))
        });
        let flaws = wrong.map(|name| {
            let what = format!("`{name}`, the handler of a task, is exempt");
            let remedy = "Take it out of `[[exempt]]`: what a task does counts.";
            Flaw::new(Rule::Mismatch, what, Place::default(), remedy)
        });
        flaws.collect()
    }

    /// Whether `schedule.toml` lets an instruction store to a register.
    fn may_store(&self, function: &Function, at: u32, address: u32) -> bool {
        let frames = self.system.image.frames(at);
        let mut allowed = self.system.config.register.iter();
        allowed.any(|it| (it.from..it.to).contains(&address) && is_by(&it.by, function, &frames))
    }

    /// That `idle` is in `main`: what is exempt there is so until interrupts are on.
    fn idle(&self) -> Option<Flaw> {
        let mut functions = self.system.program.functions().values();
        let is_own_function = functions.any(|function| function.name.ends_with("::idle"));
        let idle = self
            .system
            .app
            .tasks
            .iter()
            .find(|task| task.name == "idle")?;
        (!is_own_function && self.system.config.exemption("main").is_some()).then(|| {
            let what = "the code of `idle` is in `main`, which is exempt".to_owned();
            let remedy = "Keep it apart: write `#[inline(never)]` at `idle`.";
            Flaw::new(Rule::Mismatch, what, idle.place(), remedy)
        })
    }

    /// Sections with a ceiling that no resource has.
    fn ceilings(&self) -> Vec<Flaw> {
        let ceilings: BTreeSet<u8> = self.system.app.ceilings().into_values().collect();
        let strange = self.sections.iter().filter(|section| {
            let is_strange = section
                .ceiling
                .is_some_and(|ceiling| ceiling != UNKNOWN_CEILING && !ceilings.contains(&ceiling));
            is_strange
                && self
                    .system
                    .config
                    .exemption(&self.system.image.name(section.function))
                    .is_none()
        });
        let flaws = strange.map(|section| {
            let ceiling = section.ceiling.unwrap_or(0);
            let what = format!(
                "a section holds up tasks up to priority {ceiling}, which is no resource's ceiling"
            );
            let remedy = "Build the ELF from this source; lock resources with RTIC only.";
            self.system
                .flaw(Rule::Mismatch, section.address, what, remedy)
        });
        flaws.collect()
    }
}
