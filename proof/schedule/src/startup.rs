//! The order of initialisation, and the feeding of the watchdog wherever the processor may stay for long.
//!
//! Functions that are inlined are found by what the program file says of each instruction. The order is that of
//! effects: accesses to peripherals and calls, which the compiler keeps in the order of the source.
//!
//! A program with a watchdog needs both tables: a missing table is reported, as is a function that
//! `schedule.toml` names and the program lacks.

use std::{collections::BTreeSet, rc::Rc};

use crate::{
    Config, Flaw, Function, Image, Instruction, Loop, Operation, Program, Region, Rule, busy_waits,
    config::{Startup, Watchdog, is_named},
    loops,
    system::misconfigured,
};

/// `IWDG_KR`, which starts and feeds the watchdog: RM0090 21.4.1.
const IWDG_KR: u32 = 0x4000_3000;

/// An effect of the initialisation.
struct Effect<'a> {
    block: usize,
    address: u32,
    /// Its callee.
    called: Option<u32>,
    instruction: &'a Instruction,
}

/// The flaws of the order of the initialisation, and of the watchdog.
pub(crate) fn flaws(program: &Program<'_>, config: &Config) -> Vec<Flaw> {
    let startup = config.startup.iter();
    let startup = startup.flat_map(|startup| of_startup(program, startup));
    let watchdog = config.watchdog.iter();
    let watchdog = watchdog.flat_map(|watchdog| of_watchdog(program, watchdog));
    let mut flaws: Vec<_> = startup.chain(watchdog).collect();
    flaws.extend(missing(program, config));
    flaws.extend(missing_functions(program, config));
    flaws
}

/// The tables that a program with a watchdog needs and the file lacks.
fn missing(program: &Program<'_>, config: &Config) -> Vec<Flaw> {
    let functions = program.functions().values();
    let mut stores = functions.flat_map(|function| &function.stores);
    if !stores.any(|store| store.to == Some(IWDG_KR)) {
        return Vec::new();
    }
    let tables = [
        ("startup", config.startup.is_some()),
        ("watchdog", config.watchdog.is_some()),
    ];
    let missing = tables.iter().filter(|(_, is_there)| !is_there);
    let flaws = missing.map(|(table, _)| {
        let what =
            format!("the program has a watchdog, and `schedule.toml` has no table [{table}]");
        let remedy = "Say in which order it starts, and where the watchdog is fed.";
        misconfigured(what, remedy)
    });
    flaws.collect()
}

/// Functions that the two tables name for every program, and this one lacks.
fn missing_functions(program: &Program<'_>, config: &Config) -> Vec<Flaw> {
    let before = config
        .startup
        .iter()
        .flat_map(|startup| &startup.before)
        .map(|name| ("`before` of [startup]", name));
    let unfed = config
        .watchdog
        .iter()
        .flat_map(|watchdog| &watchdog.unfed)
        .filter(|unfed| unfed.only.is_none())
        .map(|unfed| ("a `[[watchdog.unfed]]`", &unfed.function));
    let mut named = before.chain(unfed).peekable();
    if named.peek().is_none() {
        return Vec::new();
    }
    let names = names(program);
    let missing = named.filter(|(_, name)| !names.iter().any(|full| is_named(full, name)));
    let flaws = missing.map(|(list, name)| {
        let what = format!("{list} names `{name}`, which is no function of the program");
        let remedy = "Correct the name, take it out, or say which programs have it.";
        misconfigured(what, remedy)
    });
    flaws.collect()
}

/// The names of all functions of a program, also of those that are inlined.
fn names(program: &Program<'_>) -> BTreeSet<Rc<str>> {
    let mut names = BTreeSet::new();
    for function in program.functions().values() {
        names.insert(function.name.as_str().into());
        for instruction in function.instructions() {
            let frames = program.image.frames(instruction.address);
            names.extend(frames.iter().map(|frame| Rc::clone(&frame.function)));
        }
    }
    names
}

fn of_startup(program: &Program<'_>, startup: &Startup) -> Vec<Flaw> {
    let image = program.image;
    let mut functions = program.functions().values();
    let Some(function) = functions.find(|it| is_named(&it.name, &startup.function)) else {
        let what = format!("there is no function `{}`", startup.function);
        return vec![misconfigured(what, "Name it as the program does.")];
    };
    let order = Order {
        program,
        image,
        function,
        effects: effects(function),
    };
    let pairs = startup.order.iter().zip(startup.order.iter().skip(1));
    let mut flaws: Vec<_> = pairs
        .filter_map(|(one, other)| order.pair(one, other))
        .collect();
    flaws.extend(order.before(&startup.safe, &startup.before));
    flaws
}

/// The effects of a function, by their places.
fn effects(function: &Function) -> Vec<Effect<'_>> {
    let blocks = function.blocks.iter().enumerate();
    let all = blocks.flat_map(|(index, block)| {
        let last = block.instructions.last().map(|last| last.address);
        block.instructions.iter().map(move |instruction| Effect {
            block: index,
            address: instruction.address,
            called: block.call.filter(|_| Some(instruction.address) == last),
            instruction,
        })
    });
    all.filter(|it| it.called.is_some() || is_access(function, it.instruction))
        .collect()
}

/// Whether an instruction reads or writes a peripheral.
fn is_access(function: &Function, instruction: &Instruction) -> bool {
    let region = function.regions.get(&instruction.address);
    instruction.operation.access().is_some()
        && matches!(
            region,
            Some(Region::Ahb | Region::Apb1 | Region::Apb2 | Region::Uncosted)
        )
}

/// The order of a function's effects.
struct Order<'a> {
    program: &'a Program<'a>,
    image: &'a Image,
    function: &'a Function,
    effects: Vec<Effect<'a>>,
}

impl Order<'_> {
    /// Whether an effect is one of a function, inlined or called.
    fn is_of(&self, effect: &Effect<'_>, name: &str) -> bool {
        let frames = self.image.frames(effect.address);
        frames.iter().any(|frame| is_named(&frame.function, name))
            || effect
                .called
                .is_some_and(|called| is_named(&self.image.name(called), name))
    }

    /// The flaw of two functions of which the first must have ended before the second begins.
    fn pair(&self, one: &str, other: &str) -> Option<Flaw> {
        let of = |name: &str| -> Vec<usize> {
            let all = self.effects.iter().enumerate();
            all.filter(|(_, effect)| self.is_of(effect, name))
                .map(|(index, _)| index)
                .collect()
        };
        let (ones, others) = (of(one), of(other));
        for (name, found) in [(one, &ones), (other, &others)] {
            if found.is_empty() {
                let what = format!("`{name}` does nothing in `{}`", self.function.name);
                return Some(self.flaw(self.function.address, what));
            }
        }
        let early = others.iter().find(|&&other| {
            let avoided = |index: usize| ones.contains(&index);
            self.is_reached(None, other, avoided) || {
                ones.iter()
                    .any(|&one| self.is_reached(Some(other), one, |_| false))
            }
        })?;
        let what = format!("`{other}` may begin before `{one}` is over");
        Some(self.flaw(self.effects[*early].address, what))
    }

    /// What comes before a function is over, and is none of what may.
    fn before(&self, safe: &str, allowed: &[String]) -> Option<Flaw> {
        let safes: Vec<usize> = (0..self.effects.len())
            .filter(|&index| self.is_of(&self.effects[index], safe))
            .collect();
        let early = self.effects.iter().enumerate().find(|(index, effect)| {
            let is_allowed = safes.contains(index)
                || allowed.iter().any(|name| self.is_of(effect, name))
                || effect.called.is_some_and(|called| self.is_harmless(called));
            !is_allowed
                && safes
                    .iter()
                    .any(|&safe| self.is_reached(Some(*index), safe, |_| false))
        });
        early.map(|(_, effect)| {
            let what = format!("something is done before `{safe}` is over");
            self.flaw(effect.address, what)
        })
    }

    /// Whether a called function and what it calls access memory only.
    fn is_harmless(&self, called: u32) -> bool {
        let mut functions = self.program.reached(called);
        !functions.any(|function| function.instructions().any(|it| is_access(function, it)))
    }

    /// Whether a path leads to an effect from another, or from the beginning, and avoids some.
    fn is_reached(
        &self,
        from: Option<usize>,
        to: usize,
        is_avoided: impl Fn(usize) -> bool,
    ) -> bool {
        // They are in the order of their places.
        let of_block = |block: usize, after: u32| {
            let before = |it: &Effect<'_>| (it.block, it.address) <= (block, after);
            let first = self.effects.partition_point(before);
            let after_it = self.effects.iter().enumerate().skip(first);
            after_it.take_while(move |(_, it)| it.block == block)
        };
        let begin = from.map_or((0, 0), |from| {
            (self.effects[from].block, self.effects[from].address)
        });
        let judge = |block: usize, after: u32| {
            let mut passed = of_block(block, after).map(|(index, _)| index);
            let found = passed.find(|&index| index == to || is_avoided(index));
            found.map(|index| index == to)
        };
        let (block, after) = begin;
        let mut next = self.function.blocks[block].next();
        let leads = |from| self.function.leads(from, |block| judge(block, 0));
        judge(block, after).unwrap_or_else(|| next.any(leads))
    }

    fn flaw(&self, address: u32, what: String) -> Flaw {
        let remedy = "Keep the order that `[startup]` of schedule.toml gives, with its reason.";
        self.image.flaw(Rule::Startup, address, what, remedy)
    }
}

/// Loops that may last, in which the watchdog is not fed.
fn of_watchdog(program: &Program<'_>, watchdog: &Watchdog) -> Vec<Flaw> {
    let mut flaws = Vec::new();
    let mut fed = 0;
    for function in program.functions().values() {
        for one in function.loops.iter().filter(|one| may_last(function, one)) {
            let is_fed = feeds(function, one, watchdog);
            fed += u32::from(is_fed);
            let head = function.blocks[one.head].start();
            if !is_fed && !is_excused(program.image, watchdog, head, &function.name) {
                let what = "a loop may last, and does not feed the watchdog";
                let remedy =
                    "Feed it in each run; or count the runs; or say in `[watchdog]` why not.";
                flaws.push(program.image.flaw(Rule::Watchdog, head, what, remedy));
            }
        }
    }
    if fed == 0 {
        let what = "no loop feeds the watchdog";
        let remedy = "Feed it where nothing else has to be done.";
        flaws.push(Flaw::new(
            Rule::Watchdog,
            what,
            crate::Place::default(),
            remedy,
        ));
    }
    flaws
}

/// Whether the watchdog is fed in each iteration of a loop.
pub(crate) fn feeds(function: &Function, one: &Loop, watchdog: &Watchdog) -> bool {
    let feeds: BTreeSet<u32> = function
        .stores
        .iter()
        .filter(|store| store.to == Some(watchdog.key) && store.value == Some(watchdog.feed))
        .map(|store| store.at)
        .collect();
    one.blocks.iter().any(|&block| {
        let mut own = function.blocks[block].instructions.iter();
        own.any(|it| feeds.contains(&it.address))
            && loops::is_on_every_path(function, one, &BTreeSet::from([block]))
    })
}

/// Whether a loop may last: it has no end, or reads a peripheral and no counter ends it.
fn may_last(function: &Function, one: &Loop) -> bool {
    let has_end = one.blocks.iter().any(|&block| {
        let block = &function.blocks[block];
        let mut edges = block.successors.iter();
        block.ends || block.traps || edges.any(|edge| !one.blocks.contains(&edge.to))
    });
    let sleeps = one.blocks.iter().any(|&block| {
        let mut own = function.blocks[block].instructions.iter();
        own.any(|it| it.operation == Operation::Wait)
    });
    !has_end || sleeps || busy_waits::polls(function, one)
}

fn is_excused(image: &Image, watchdog: &Watchdog, head: u32, name: &str) -> bool {
    let frames = image.frames(head);
    watchdog.unfed.iter().any(|excuse| {
        is_named(name, &excuse.function)
            || frames
                .iter()
                .any(|frame| is_named(&frame.function, &excuse.function))
    })
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use super::*;

    /// The text of all source files in a folder.
    fn sources(folder: &Path) -> String {
        let entries = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path());
        let texts = entries.map(|path| {
            if path.is_dir() {
                sources(&path)
            } else {
                fs::read_to_string(&path).unwrap()
            }
        });
        texts.collect()
    }

    #[test]
    fn functions_that_only_some_programs_have_are_in_the_source() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let file = fs::read_to_string(root.join("schedule.toml")).unwrap();
        let config = Config::parse(&file).unwrap();
        let watchdog = config.watchdog.unwrap();
        let unfed = watchdog.unfed.iter().filter(|unfed| unfed.only.is_some());
        // The clocks are those of a library.
        let names = unfed.map(|unfed| &unfed.function);
        let names: Vec<_> = names.filter(|name| !name.starts_with("Rcc>")).collect();
        assert!(!names.is_empty());
        let sources = sources(&root.join("src"));
        for name in names {
            let last = name.rsplit("::").next().unwrap();
            assert!(sources.contains(&format!("fn {last}(")), "{name}");
        }
    }
}
