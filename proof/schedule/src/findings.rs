//! Flaws of the code: of tasks with deadlines, sections, stacks.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Block, Extent, Flaw, Function, Instruction, Operation, Place, Report, Rule, Section, Stack,
    busy_waits, config,
    graph::BASEPRI,
    library_flaws,
    sections::{Held, UNKNOWN_CEILING},
    stack::{self, Depths, FLOAT_FRAME_BYTES, FRAME_BYTES},
    system::{Row, System},
    totals,
};

/// Flaws of the code that a row may run.
pub(crate) fn of_row(system: &System<'_>, row: &Row, named: &BTreeMap<String, u64>) -> Vec<Flaw> {
    let wcets = system.wcets(row, named);
    let reached = wcets.reach(row.root);
    let all = system.program.functions();
    let mut flaws = library_flaws::flaws(system.program, &reached);
    flaws.extend(exempt_calls(system, &reached));
    let functions = system.program.functions_at(&reached);
    flaws.extend(never_back(system, functions.flat_map(|it| &it.blocks)));
    flaws.extend(float_above(system, row, &reached));
    for function in system.program.functions_at(&reached) {
        flaws.extend(busy_waits::flaws(system.image, all, function, |_| true));
    }
    flaws.extend(totals::flaws(system, row, &wcets, &reached));
    flaws
}

/// For each function the lowest priority that may run it; 0 for initialisation and idle.
pub(crate) fn contexts(system: &System<'_>) -> BTreeMap<u32, u8> {
    let mut contexts: BTreeMap<u32, u8> = BTreeMap::new();
    for row in &system.rows {
        for address in system.program.reach(row.root) {
            let context = contexts.entry(address).or_insert(u8::MAX);
            *context = row.task.priority.min(*context);
        }
    }
    for root in ["main", "Reset"]
        .iter()
        .filter_map(|name| system.image.symbol(name))
    {
        for address in system.program.reach(root) {
            contexts.insert(address, 0);
        }
    }
    contexts
}

/// Sections for the report, and what is wrong with them.
pub(crate) fn of_sections(
    system: &System<'_>,
    held: &[Held],
    contexts: &BTreeMap<u32, u8>,
) -> (Vec<Section>, Vec<Flaw>) {
    let limit = system.config.limits.critical_section_cycles;
    let (mut sections, mut flaws) = (Vec::new(), Vec::new());
    for section in held {
        let name = system.image.name(section.function);
        let exempt = system.config.exemption(&name).map(str::to_owned);
        let frames = system.image.frames(section.address);
        let own = frames.iter().find(|frame| frame.file.starts_with("src/"));
        let place = own.or(frames.first()).map_or(name, ToString::to_string);
        let is_relevant = system.rows.iter().any(|row| {
            let level = row.task.priority;
            row.times.is_some() && section.ceiling.is_none_or(|ceiling| ceiling >= level)
        });
        if exempt.is_none() && (is_relevant || section.escapes) {
            let wrong = match (section.ceiling, section.cycles) {
                (Some(UNKNOWN_CEILING), _) => {
                    Some("begins with a priority that is not known: it may hold up all".to_owned())
                }
                (_, None) => Some("has no bound".to_owned()),
                _ if section.escapes => Some("is not over when its function returns".to_owned()),
                (None, Some(cycles)) if cycles > limit => {
                    Some(format!("lasts {cycles} cycles, more than {limit}"))
                }
                _ => None,
            };
            flaws.extend(of_section(system, section, wrong));
        }
        sections.push(Section {
            place,
            ceiling: section.ceiling,
            priority: contexts.get(&section.function).copied().unwrap_or(0),
            cycles: section.cycles.unwrap_or(0),
            exempt,
        });
    }
    sections.sort_by(|one, other| {
        other
            .cycles
            .cmp(&one.cycles)
            .then(one.place.cmp(&other.place))
    });
    (sections, flaws)
}

/// The flaws of a section. One cause, one message: a single flaw of its code says why it has no bound, and of many
/// flaws the section is the cause.
fn of_section(system: &System<'_>, section: &Held, wrong: Option<String>) -> Vec<Flaw> {
    let mut flaws = Vec::from_iter(entered_from_above(system, section));
    let inner = of_code_of_section(system, section);
    let (wrong, inner) = match &*inner {
        [] => (wrong, inner),
        [_] => (wrong.filter(|_| section.cycles.is_some()), inner),
        [first, ..] => {
            let wrong = wrong.map_or(String::new(), |wrong| format!("{wrong}, and "));
            let what = format!("{wrong}has {} flaws, as: {}", inner.len(), first.what);
            (Some(what), Vec::new())
        }
    };
    flaws.extend(wrong.map(|wrong| {
        let what = format!("a section with interrupts held back {wrong}");
        let remedy = "Do less in it; or share through atomics, or lock an RTIC resource.";
        system.flaw(Rule::CriticalSection, section.address, what, remedy)
    }));
    flaws.extend(inner);
    flaws
}

/// Reports writes of `BASEPRI` in what runs above priority 1 that neither raise it nor restore a value that was read
/// from it: they would end a lock of a task that has been preempted. Nothing restores the register behind a handler.
pub(crate) fn lowered_masks(system: &System<'_>) -> Vec<Flaw> {
    let above = system.rows.iter().filter(|row| row.task.priority > 1);
    let reached: BTreeSet<u32> = above
        .flat_map(|row| system.program.reach(row.root))
        .collect();
    let functions = system.program.functions_at(&reached);
    let lowers = |function: &Function, instruction: &Instruction| {
        let is_write = matches!(
            instruction.operation,
            Operation::WriteSpecial {
                register: BASEPRI,
                ..
            }
        );
        is_write && !function.saved.contains_key(&instruction.address)
    };
    let written = functions.flat_map(|function| {
        let all = function.instructions();
        all.filter(|instruction| lowers(function, instruction))
    });
    let flaw = |instruction: &Instruction| {
        let what = "`BASEPRI` is written with a value that was not read from it: a lock of a preempted task would end";
        let remedy = "Lock an RTIC resource, which restores what was there.";
        system.flaw(Rule::CriticalSection, instruction.address, what, remedy)
    };
    written.map(flaw).collect()
}

/// Reports code of a section whose time is unknown: waiting instructions, calls of pointers,
/// undecoded instructions, wrong bounds and bounds of busy waits. A panic ends the machine.
fn of_code_of_section(system: &System<'_>, section: &Held) -> Vec<Flaw> {
    let Some(own) = system.program.function(section.function) else {
        return Vec::new();
    };
    let is_own = |address: u32| {
        let mut blocks = section.blocks.iter().map(|block| &own.blocks[*block]);
        // An undecoded instruction follows a block without another end.
        let is_after_trap = |block: &Block| block.traps && address == block.end();
        blocks.any(|block| (block.start()..block.end()).contains(&address) || is_after_trap(block))
    };
    let is_of_time = |flaw: &Flaw| {
        let is_of_rule = matches!(
            flaw.rule,
            Rule::IndirectCall
                | Rule::ForbiddenInstruction
                | Rule::UnknownInstruction
                | Rule::IrreducibleLoop
                | Rule::WrongBound
        );
        let at = flaw.place.address;
        let is_called = |it: &Extent| section.reached.contains(&it.address);
        is_of_rule && (is_own(at) || system.image.function(at).is_some_and(is_called))
    };
    let mut functions = section.reached.clone();
    functions.insert(section.function);
    let mut flaws = library_flaws::flaws(system.program, &functions);
    flaws.retain(is_of_time);
    let all = system.program.functions();
    for function in section.reached.iter().filter_map(|at| all.get(at)) {
        flaws.extend(busy_waits::flaws(system.image, all, function, |_| true));
    }
    let blocks = section.blocks.iter().map(|block| &own.blocks[*block]);
    let called = section.reached.iter().filter_map(|at| all.get(at));
    let blocks = blocks.chain(called.flat_map(|function| &function.blocks));
    flaws.extend(never_back(system, blocks));
    let is_in_section = |block: usize| section.blocks.contains(&block);
    flaws.extend(busy_waits::flaws(system.image, all, own, is_in_section));
    for flaw in &mut flaws {
        let place = system.image.place(section.address);
        let begin = place.frames.first().map_or("", String::as_str);
        flaw.what = format!(
            "{}, and holds up tasks with deadlines: in the section that begins at {begin}",
            flaw.what
        );
    }
    flaws
}

/// Reports a section that is entered by a task with a priority above the section's ceiling: such a
/// task can be preempted in the section by another task that enters the section.
fn entered_from_above(system: &System<'_>, section: &Held) -> Option<Flaw> {
    let ceiling = section.ceiling.filter(|it| *it != UNKNOWN_CEILING)?;
    let above = system.rows.iter().find(|row| {
        row.task.priority > ceiling && system.program.reach(row.root).contains(&section.function)
    })?;
    let what = format!(
        "a section that holds up tasks up to priority {ceiling} is entered by `{}` of priority {}",
        above.task.name, above.task.priority
    );
    let remedy =
        "Lock the resource in each task that is to use it, so that RTIC knows its ceiling.";
    Some(system.flaw(Rule::CriticalSection, section.address, what, remedy))
}

/// Calls of what is exempt, by the code that a row may run: their time would not count.
fn exempt_calls(system: &System<'_>, reached: &BTreeSet<u32>) -> Vec<Flaw> {
    let functions = system.program.functions_at(reached);
    let blocks = functions.flat_map(|function| &function.blocks);
    // A call that never returns ends the task, and the machine.
    let calls = blocks.filter(|block| !block.traps).filter_map(|block| {
        let at = block.instructions.last()?.address;
        Some((at, system.image.name(block.call?)))
    });
    let exempt = calls.filter(|(_, name)| system.config.exemption(name).is_some());
    let flaws = exempt.map(|(at, name)| {
        let what = format!("a task with a deadline calls `{name}`, whose time is exempt");
        let remedy = "Call it from a task without a deadline; or take its `[[exempt]]` out of `schedule.toml`.";
        system.flaw(Rule::Exemption, at, what, remedy)
    });
    flaws.collect()
}

/// Calls of what never comes back, in some blocks: a panic, which has a flaw of its own, or what is exempt ends the
/// machine; anything else would keep the processor for ever.
fn never_back<'a>(system: &System<'_>, blocks: impl Iterator<Item = &'a Block>) -> Vec<Flaw> {
    let calls = blocks.filter(|block| block.traps).filter_map(|block| {
        let call = block.call.filter(|call| !system.program.is_panic(*call))?;
        Some((block.instructions.last()?.address, system.image.name(call)))
    });
    let endless = calls.filter(|(_, name)| system.config.exemption(name).is_none());
    let flaws = endless.map(|(at, name)| {
        let what = format!("`{name}` never returns");
        let remedy = "Let it end; or say in `schedule.toml`, in an `[[exempt]]`, why the machine stops then.";
        system.flaw(Rule::UnboundedLoop, at, what, remedy)
    });
    flaws.collect()
}

/// Floating point in a row that is too urgent for it.
fn float_above(system: &System<'_>, row: &Row, reached: &BTreeSet<u32>) -> Option<Flaw> {
    let most = system.config.limits.float_priority?;
    if row.task.priority <= most {
        return None;
    }
    let functions = system.program.functions_at(reached);
    let mut instructions = functions.flat_map(Function::instructions);
    let first = instructions.find(|it| it.operation.is_float())?;
    let what = format!(
        "`{}` uses floating point, and its priority is above {most}: registers would be saved for it",
        row.name
    );
    let remedy = "Compute with integers there, or leave it to a task of a lower priority.";
    Some(system.flaw(Rule::FloatingPoint, first.address, what, remedy))
}

/// Fills in the stacks; what is wrong with them.
pub(crate) fn of_stacks(system: &System<'_>, report: &mut Report) -> Vec<Flaw> {
    let is_panic = |address: u32| system.program.is_panic(address);
    let pointers = pointers(system);
    let mut depths = Depths::new(system.program.functions(), &is_panic, &pointers);
    let mut flaws = Vec::new();
    let main = system.image.symbol("Reset").unwrap_or(0);
    let mut floats = system.program.reached(main).any(stack::uses_float);
    let mut levels = BTreeMap::from([(0, ("initialisation, idle".to_owned(), 0))]);
    let mut depth = |root: u32, name: &str| {
        depths.depth(root).unwrap_or_else(|address| {
            let what = format!("the depth of the stack of `{name}` is not known");
            let remedy = "Call functions by name, or say in `schedule.toml` what pointers call.";
            flaws.push(system.flaw(Rule::StackOverflow, address, what, remedy));
            0
        })
    };
    let alone = depth(main, "Reset");
    let under_tasks = initialisation(system).map(|it| {
        let depths = Depths::new(system.program.functions(), &is_panic, &pointers);
        depths.under_tasks(it).depth(main).unwrap_or(alone)
    });
    levels.entry(0).or_default().1 = under_tasks.unwrap_or(alone);
    let priorities: BTreeSet<u8> = system.rows.iter().map(|row| row.task.priority).collect();
    for priority in priorities {
        let frame = if floats {
            FLOAT_FRAME_BYTES
        } else {
            FRAME_BYTES
        };
        for row in system
            .rows
            .iter()
            .filter(|row| row.task.priority == priority)
        {
            let bytes = frame + depth(row.root, &row.task.name);
            let level: &mut (String, u64) = levels.entry(priority).or_default();
            if bytes > level.1 {
                *level = (row.task.name.clone(), bytes);
            }
            floats |= system.uses_float(row);
            for task in report.tasks.iter_mut().filter(|task| task.name == row.name) {
                task.stack_bytes = bytes;
            }
        }
    }
    let levels = levels.into_iter().rev();
    let levels = levels.map(|(priority, (task, bytes))| Stack {
        priority,
        task,
        bytes,
    });
    report.stack = levels.collect();
    let together: u64 = report.stack.iter().map(|stack| stack.bytes).sum();
    report.stack_worst_bytes = together.max(alone);
    report.stack_available_bytes = available(system);
    flaws.extend(overflow(report));
    flaws
}

/// The initialisation of RTIC, with interrupts off until its end.
fn initialisation<'a>(system: &'a System<'_>) -> Option<&'a Function> {
    let mut functions = system.program.functions().values();
    functions.find(|it| config::is_named(&it.name, "main::__rtic_init_resources"))
}

fn overflow(report: &Report) -> Option<Flaw> {
    let (worst, available) = (report.stack_worst_bytes, report.stack_available_bytes);
    (worst > available).then(|| {
        let what = format!("the stacks may take {worst} bytes, there are {available}");
        let remedy = "Make statics smaller, or keep less on the stack.";
        Flaw::new(Rule::StackOverflow, what, Place::default(), remedy)
    })
}

/// The callees of pointers by function, from `schedule.toml`.
pub(crate) fn pointers(system: &System<'_>) -> BTreeMap<u32, BTreeSet<u32>> {
    let functions = system.program.functions();
    let mut pointers = BTreeMap::new();
    for pointer in &system.config.pointer {
        let is_called = |name: &str| {
            let mut calls = pointer.calls.iter();
            calls.any(|call| name.starts_with(call.as_str()) || config::is_named(name, call))
        };
        let called = functions
            .values()
            .filter(|function| is_called(&function.name));
        let called: BTreeSet<u32> = called.map(|function| function.address).collect();
        let callers = functions
            .values()
            .filter(|it| config::is_named(&it.name, &pointer.function));
        pointers.extend(callers.map(|caller| (caller.address, called.clone())));
    }
    pointers
}

/// RAM between the guard above the statics and the top.
fn available(system: &System<'_>) -> u64 {
    let guard = system.config.program.stack_guard_bytes;
    let top = system.image.vectors().first().copied().unwrap_or(0);
    let statics_end = u64::from(system.image.symbol("__sheap").unwrap_or(0));
    let guarded = statics_end.next_multiple_of(guard.max(1)) + guard;
    u64::from(top).saturating_sub(guarded)
}
