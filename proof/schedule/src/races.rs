//! Parts of statics that tasks of two priorities write without a lock that keeps the more urgent one out.
//!
//! RTIC and the borrow checker rule that out for safe code; here it is read from the machine code, for the stores whose
//! addresses are constants. What is written by exclusive stores alone is read and written in one step. A store that is
//! reached through a call within a section counts as in the section.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    App, Config, Flaw, Function, Operation, Program, Rule, Store,
    config::SharedStatic,
    registers::is_inlined,
    sections::{Held, UNKNOWN_CEILING},
};

/// Where statics are.
const STATIC_ADDRESSES: std::ops::Range<u32> = 0x2000_0000..0x2010_0000;
/// More urgent than any task.
const ALL_PRIORITIES: u8 = u8::MAX;

/// A store that a task executes.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Write {
    priority: u8,
    /// The most urgent priority that it keeps out.
    kept_out: u8,
    task: String,
    at: u32,
}

/// The bytes that are written so and that `schedule.toml` does not name.
pub(crate) fn flaws(
    program: &Program<'_>,
    app: &App,
    config: &Config,
    sections: &[Held],
) -> Vec<Flaw> {
    let mut bytes: BTreeMap<u32, BTreeSet<Write>> = BTreeMap::new();
    for task in &app.tasks {
        let root = if task.priority == 0 {
            let functions = program.functions().values();
            let name = format!("::{}", task.name);
            { functions }
                .find(|it| it.name.ends_with(&name))
                .map(|it| it.address)
        } else {
            program.image.symbol(&task.vector)
        };
        let Some(root) = root else { continue };
        for (function, kept_out) in reach(program, sections, root, task.priority) {
            if config.exemption(&function.name).is_some() {
                continue;
            }
            let stores = function.stores.iter();
            for (store, to) in stores.filter_map(|store| Some((store, store.to?))) {
                if STATIC_ADDRESSES.contains(&to) && !is_exclusive(function, store) {
                    let write = Write {
                        priority: task.priority,
                        kept_out: kept_out.max(ceiling(sections, function, store.at)),
                        task: task.name.clone(),
                        at: store.at,
                    };
                    for byte in to..to + store.bytes {
                        bytes.entry(byte).or_default().insert(write.clone());
                    }
                }
            }
        }
    }
    let mut seen = BTreeSet::new();
    let races = bytes.iter().filter_map(|(byte, writes)| {
        let (low, high) = race(writes)?;
        let is_named = config
            .shared
            .iter()
            .any(|shared| names(program, shared, writes));
        let is_new = seen.insert((low.at, high.at));
        (!is_named && is_new).then(|| refused(program, *byte, low, high))
    });
    races.collect()
}

/// The functions that a task executes, each with the most urgent priority that is kept out wherever it is called.
fn reach<'a>(
    program: &'a Program<'_>,
    sections: &[Held],
    root: u32,
    priority: u8,
) -> Vec<(&'a Function, u8)> {
    let mut least: BTreeMap<u32, u8> = BTreeMap::from([(root, priority)]);
    let mut work = vec![root];
    while let Some(address) = work.pop() {
        let kept_out = least[&address];
        let Some(function) = program.function(address) else {
            continue;
        };
        for (block, called) in { function.blocks.iter() }.filter_map(|it| Some((it, it.call?))) {
            let inner = kept_out.max(ceiling(sections, function, block.last()));
            let known = least.get(&called).copied().unwrap_or(ALL_PRIORITIES);
            let is_lower = inner < known || !least.contains_key(&called);
            if is_lower && !program.is_panic(called) {
                least.insert(called, inner);
                work.push(called);
            }
        }
    }
    let functions = least.into_iter();
    let functions =
        functions.filter_map(|(address, kept)| Some((program.function(address)?, kept)));
    functions.collect()
}

/// The most urgent priority that sections keep out where an instruction is; 0: none.
fn ceiling(sections: &[Held], function: &Function, at: u32) -> u8 {
    let holds = |section: &&Held| {
        let mut blocks = section
            .blocks
            .iter()
            .filter_map(|it| function.blocks.get(*it));
        section.function == function.address
            && section.address != at
            && blocks.any(|block| (block.start()..block.end()).contains(&at))
    };
    let around = sections.iter().filter(holds);
    // A section whose level is not known keeps nobody out for certain.
    let known = around.filter(|section| section.ceiling != Some(UNKNOWN_CEILING));
    let ceilings = known.map(|section| section.ceiling.unwrap_or(ALL_PRIORITIES));
    ceilings.max().unwrap_or(0)
}

fn is_exclusive(function: &Function, store: &Store) -> bool {
    let own = function.instructions().find(|it| it.address == store.at);
    own.is_some_and(|it| matches!(it.operation, Operation::StoreExclusive { .. }))
}

/// Two writes of which the second may come in the middle of what the first belongs to.
fn race(writes: &BTreeSet<Write>) -> Option<(&Write, &Write)> {
    let mut lower = writes.iter();
    lower.find_map(|low| {
        let high = writes.iter().find(|high| high.priority > low.kept_out)?;
        Some((low, high))
    })
}

/// Whether all writes are of the functions or files that `schedule.toml` names.
fn names(program: &Program<'_>, shared: &SharedStatic, writes: &BTreeSet<Write>) -> bool {
    writes
        .iter()
        .all(|write| is_inlined(&shared.by, &program.image.frames(write.at)))
}

fn refused(program: &Program<'_>, byte: u32, low: &Write, high: &Write) -> Flaw {
    let place = program.image.place(high.at);
    let other = program.image.place(low.at);
    let what = format!(
        "`{}` and the less urgent `{}` both write {byte:#010x}, and no lock keeps `{}` out ({})",
        high.task,
        low.task,
        high.task,
        other
            .frames
            .iter()
            .find(|it| it.contains("(src/"))
            .unwrap_or(&other.frames[0])
    );
    let remedy = "Give it one writer, or lock it; or say in `schedule.toml`, in a `[[shared]]`, why both may.";
    Flaw::new(Rule::Race, what, place, remedy)
}
