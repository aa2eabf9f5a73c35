//! Flaws in library code, reported at the calls of the project.
//!
//! A loop of the compiler's 64-bit division says little to the author of the division. So a flaw in a
//! function without a line of the project is propagated to its callers, up to a call in the
//! project's code. Well-known functions of libraries get a description of their own.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Flaw, Place, Program, Rule, walks::reachable};

/// Where the project's own sources are.
const OWN: &str = "src/";

/// Why library code cannot be bounded.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Cause {
    /// 64-bit numbers are divided.
    Division,
    /// Memory is copied or filled, with a length that is not constant.
    Copy,
    /// `core::fmt`.
    Formatting,
    /// Something else, as the flaw says.
    Other(Rule, String, String),
}

impl Cause {
    /// The cause of a flaw in the function called `name`.
    fn of(name: &str, flaw: &Flaw) -> Self {
        let is_named = |parts: &[&str]| parts.iter().any(|part| name.contains(part));
        if is_named(&["ldivmod", "div_rem", "udivmod"]) {
            Self::Division
        } else if is_named(&["memcpy", "memmove", "memset", "memclr", "builtins::mem"]) {
            Self::Copy
        } else {
            Self::Other(flaw.rule, flaw.what.clone(), flaw.remedy.clone()).within(name)
        }
    }

    /// The same, seen by a caller of the function called `name`.
    fn within(self, name: &str) -> Self {
        if name.contains("core::fmt::") {
            Self::Formatting
        } else {
            self
        }
    }

    /// The flaw of a call of the function called `name`.
    fn flaw(self, name: &str, place: Place) -> Flaw {
        let (rule, what, remedy) = match self {
            Self::Division => (
                Rule::UnboundedLoop,
                format!("a division of 64 bits (`{name}`): its loops have no bound"),
                "Divide 32-bit numbers, shift, or multiply by the reciprocal.".to_owned(),
            ),
            Self::Copy => (
                Rule::UnboundedLoop,
                format!("a copy or filling of variable or great length (`{name}`): its loops have no bound"),
                "Copy a small, fixed number of words, or lend it instead of moving it.".to_owned(),
            ),
            Self::Formatting => (
                Rule::IndirectCall,
                format!("formatting by `core::fmt` (`{name}`): it calls through tables of functions"),
                "Write the digits in a loop of fixed length, or format in a task without a deadline."
                    .to_owned(),
            ),
            Self::Other(rule, what, remedy) => (rule, format!("{what} (in `{name}`)"), remedy),
        };
        Flaw::new(rule, what, place, remedy)
    }
}

/// The flaws of some functions, those of library code at the project's calls.
pub(crate) fn flaws(program: &Program<'_>, functions: &BTreeSet<u32>) -> Vec<Flaw> {
    let mut found = Vec::new();
    let mut propagated: BTreeMap<u32, BTreeSet<Cause>> = BTreeMap::new();
    for function in program.functions_at(functions) {
        for flaw in &function.flaws {
            if is_own(program, flaw.place.address) {
                found.push(trimmed(flaw));
            } else {
                let causes = propagated.entry(function.address).or_default();
                causes.insert(Cause::of(&function.name, flaw));
            }
        }
    }
    let calls = calls(program, functions);
    let (own, foreign): (Vec<_>, Vec<_>) = calls
        .into_iter()
        .partition(|call| is_own(program, call.site));
    propagate(program, &foreign, &mut propagated);
    for call in &own {
        for cause in propagated.get(&call.to).into_iter().flatten() {
            let name = program.image.name(call.to);
            found.push(cause.clone().flaw(&name, program.image.place(call.site)));
        }
    }
    // Flaws that no call of the project reaches keep their place.
    let called = |at: u32| {
        let calls = foreign.iter().filter(move |call| call.from == at);
        calls.map(|call| call.to)
    };
    let attributed = reachable(own.iter().map(|call| call.to), called);
    for function in program.functions_at(&(functions - &attributed)) {
        let flaws = function.flaws.iter();
        let foreign = flaws.filter(|flaw| !is_own(program, flaw.place.address));
        found.extend(foreign.cloned());
    }
    found
}

/// A call of one function by another.
struct Call {
    /// The function that calls.
    from: u32,
    /// The function that is called.
    to: u32,
    /// The instruction.
    site: u32,
}

fn calls(program: &Program<'_>, functions: &BTreeSet<u32>) -> Vec<Call> {
    let calls = program.functions_at(functions).flat_map(|function| {
        function.blocks.iter().filter_map(|block| {
            let to = block.call.filter(|to| functions.contains(to))?;
            Some(Call {
                from: function.address,
                to,
                site: block.instructions.last()?.address,
            })
        })
    });
    calls.collect()
}

/// Propagates the causes of each function to its callers in library code.
fn propagate(
    program: &Program<'_>,
    calls: &[Call],
    propagated: &mut BTreeMap<u32, BTreeSet<Cause>>,
) {
    loop {
        let mut is_new = false;
        for call in calls {
            let name = program.image.name(call.from);
            let causes = propagated.get(&call.to).cloned().unwrap_or_default();
            let causes = causes.into_iter().map(|cause| cause.within(&name));
            let known = propagated.entry(call.from).or_default();
            for cause in causes {
                is_new |= known.insert(cause);
            }
        }
        if !is_new {
            return;
        }
    }
}

fn is_own(program: &Program<'_>, address: u32) -> bool {
    let frames = program.image.frames(address);
    frames.iter().any(|frame| frame.file.starts_with(OWN))
}

/// Without the lines of libraries that a loop consists of: no comment can be written there.
fn trimmed(flaw: &Flaw) -> Flaw {
    let mut flaw = flaw.clone();
    let is_line = |frame: &String| !frame.ends_with(')');
    flaw.place
        .frames
        .retain(|frame| !is_line(frame) || frame.starts_with(OWN));
    flaw
}
