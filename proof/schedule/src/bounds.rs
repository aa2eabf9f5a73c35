//! Loop bounds: stated in the source, or derived from constants.
//!
//! A loop of machine code belongs to the innermost loop of the source that holds the lines of all
//! its own instructions. The lines are compared at one level of inlining, the innermost level that
//! all instructions share: in the example the loop is that of `for`, whatever `next` and `body`
//! consist of.
//!
//! ```text
//! instructions of the loop    outer function     inlined     inlined
//!  cmp, beq                   turn (line 20)  ▸  next (…)
//!  ldr, adds                  turn (line 21)  ▸  body (…)  ▸ add (…)
//!                             └── shared ───┘
//! ```
//!
//! Where the shared level is in a library, the loop is a library's: the calling statement, or the
//! head of the calling loop, must state the bound.

use std::{
    collections::{BTreeMap, BTreeSet},
    rc::Rc,
};

use crate::{
    Address, Annotations, Block, Bound, Count, Flaw, Frame, Function, Image, Instruction, Loop,
    Operation, Rule, Runs, Total,
    annotations::{SourceLoop, Stated},
    busy_waits, counted_loops, loops,
    model::RETRY,
    value_analysis::States,
    values::Surroundings,
};

/// Gives the loops of `function` their lines and bounds.
pub(crate) fn find(
    around: Surroundings<'_>,
    annotations: &Annotations,
    function: &mut Function,
    states: &States,
) {
    let own: Vec<BTreeSet<usize>> = function
        .loops
        .iter()
        .map(|one| own_blocks(one, &function.loops))
        .collect();
    let sources: Vec<Option<Source>> = own
        .iter()
        .map(|own| Source::of(around.image, annotations, function, own))
        .collect();
    for (index, own) in own.iter().enumerate() {
        describe(around.image, function, index, own);
        let mut source = sources[index].as_ref();
        // Only the outer of two nested loops can be the one of the source.
        if let Some(found) = source
            && (0..index).any(|outer| {
                let is_around = function.loops[outer]
                    .blocks
                    .contains(&function.loops[index].head);
                is_around && sources[outer].as_ref() == Some(found)
            })
        {
            source = None;
        }
        let runs = counted_loops::runs(around, &function.blocks, states, &function.loops[index]);
        let one = &function.loops[index];
        let stated = source.and_then(Source::bound);
        // An earlier exit depends on another writer: only the counter bounds the loop.
        let is_external = busy_waits::depends_on_external_state(function, one);
        let counted = runs.filter(|runs| !runs.is_open);
        let counted = counted.map(|runs| Bound::new(Count::Number(runs.returns), "constants"));
        let exclusive = "an exclusive store that is tried again";
        let retries = is_retry(function, &function.loops[index]);
        let retries = retries.then(|| Bound::new(Count::Number(1), exclusive));
        let one = &mut function.loops[index];
        one.counted = runs;
        one.stated.clone_from(&stated);
        one.bound = match counted {
            Some(counted) if is_external || runs.is_some_and(Runs::is_exact) => Some(counted),
            counted => smaller(stated.or(retries), counted),
        };
        let blocks = &function.blocks;
        let in_run = |block: &usize| {
            source.is_some_and(|source| source.runs_at(around.image, one.head, *block, blocks))
        };
        let in_runs: BTreeSet<usize> = own.iter().copied().filter(in_run).collect();
        one.total = source.and_then(|source| source.total(in_runs));
        let wrong = wrong_numbers(around.image, function, index, is_external);
        function.flaws.extend(wrong);
        let one = &function.loops[index];
        if one.bound.is_none() && one.total.is_none() {
            let flaw = unbounded(around.image, function, index);
            function.flaws.push(flaw);
        }
    }
}

/// A loop without a bound.
fn unbounded(image: &Image, function: &Function, index: usize) -> Flaw {
    let one = &function.loops[index];
    let mut place = image.place(function.blocks[one.head].start());
    let is_new = |line: &&String| !place.frames.iter().any(|frame| frame.contains(*line));
    let others: Vec<String> = one.lines.iter().filter(is_new).cloned().collect();
    place.frames.extend(others);
    let what = "a loop has no bound";
    let remedy = "Give it a constant number of runs, or write `// wcet-bound: N` above it.";
    Flaw::new(Rule::UnboundedLoop, what, place, remedy)
}

/// The smaller of two bounds; a name is compared where it has a value: [`Loop::most`].
fn smaller(stated: Option<Bound>, counted: Option<Bound>) -> Option<Bound> {
    match (stated, counted) {
        (Some(stated), Some(counted)) => match (&stated.count, &counted.count) {
            (Count::Number(number), Count::Number(runs)) if number >= runs => Some(counted),
            _ => Some(stated),
        },
        (stated, counted) => stated.or(counted),
    }
}

/// The numbers of comments that are too small.
fn wrong_numbers(image: &Image, function: &Function, index: usize, waits: bool) -> Vec<Flaw> {
    let one = &function.loops[index];
    let numbers = one.comments().filter_map(|stated| match stated.count {
        Count::Number(number) => Some((stated, number)),
        Count::Named(_) => None,
    });
    let wrong = numbers.filter_map(|it| wrong(image, function, one, it, waits));
    wrong.collect()
}

/// A stated bound of `number` runs that is smaller than their number: than those that every entry makes, or those of
/// a loop that waits, whose earlier end depends on another writer.
pub(crate) fn wrong(
    image: &Image,
    function: &Function,
    one: &Loop,
    (stated, number): (&Bound, u64),
    waits: bool,
) -> Option<Flaw> {
    let runs = one.counted?;
    let (runs_so, count) = match runs {
        _ if runs.is_exact() => ("runs", runs.least),
        Runs { is_open: true, .. } if runs.least == runs.returns => ("runs more than", runs.least),
        _ if waits => ("that waits may run", runs.returns),
        _ => ("runs at least", runs.least),
    };
    let origin = &stated.origin;
    (number < count).then(|| {
        let what = format!(
            "a loop {runs_so} {count} times, but {origin} says that it runs {number} times at most"
        );
        let remedy = format!("Correct the comment in {origin}.");
        image.flaw(
            Rule::WrongBound,
            function.blocks[one.head].start(),
            what,
            remedy,
        )
    })
}

/// The blocks of a loop that are in no inner loop.
pub(crate) fn own_blocks(one: &Loop, all: &[Loop]) -> BTreeSet<usize> {
    let mut own = one.blocks.clone();
    for inner in all {
        if inner.head != one.head && inner.blocks.is_subset(&one.blocks) {
            own.retain(|block| !inner.blocks.contains(block));
        }
    }
    own
}

/// Whether a loop only tries an exclusive store again that an interrupt made fail: whoever
/// interrupts pays for that. It loads exclusively each time, for the store would fail for ever, and takes no
/// longer than is paid.
fn is_retry(function: &Function, one: &Loop) -> bool {
    let mut blocks = one.blocks_of(function);
    let cycles: Option<u64> = { blocks.clone().flat_map(|block| &block.instructions) }
        .map(|instruction| match instruction.operation {
            Operation::LoadExclusive { .. } | Operation::StoreExclusive { .. } => Some(2),
            Operation::Load { words, .. } | Operation::Store { words, .. } => {
                Some(1 + u64::from(words))
            }
            Operation::Barrier => Some(4),
            // The back edge.
            Operation::Jump(_) | Operation::JumpOnZero { .. } => Some(3),
            Operation::Divide { .. }
            | Operation::Float { .. }
            | Operation::FloatLoad { .. }
            | Operation::FloatStore { .. }
            | Operation::ClearExclusive => None,
            _ => Some(1),
        })
        .sum();
    let is_short = cycles.is_some_and(|cycles| cycles <= RETRY);
    is_short && blocks.all(|block| block.call.is_none()) && stores_again(function, one)
}

/// Whether each back edge of a loop belongs to a failed exclusive store after an exclusive load.
fn stores_again(function: &Function, one: &Loop) -> bool {
    let loads = |block: &usize| {
        let mut instructions = function.blocks[*block].instructions.iter();
        instructions.any(|it| matches!(it.operation, Operation::LoadExclusive { .. }))
    };
    let loading: BTreeSet<usize> = one.blocks.iter().copied().filter(loads).collect();
    let mut loading = loading.iter();
    loading.any(|block| loops::is_on_every_path(function, one, &BTreeSet::from([*block])))
        && one.back.iter().all(|&back| {
            let instructions = &function.blocks[back].instructions;
            let mut result = None;
            let mut is_compared = false;
            for instruction in instructions {
                match instruction.operation {
                    Operation::StoreExclusive { to, .. } => result = Some(to),
                    Operation::JumpOnZero { register, .. } if Some(register) == result => {
                        return true;
                    }
                    Operation::Jump(_) => return is_compared && instruction.condition == 1,
                    Operation::Compare { left, value: 0 } => is_compared = Some(left) == result,
                    _ => is_compared &= !instruction.sets_flags,
                }
            }
            false
        })
}

/// Writes down where a loop is, whose own blocks are `own`.
fn describe(image: &Image, function: &mut Function, index: usize, own: &BTreeSet<usize>) {
    let lines = lines(image, function, own);
    let within = within(image, function, own);
    let one = &mut function.loops[index];
    (one.lines, one.within) = (lines, within);
}

/// The function of the source that a loop is in: of the project, where one of its functions holds all of the
/// loop's own instructions.
fn within(image: &Image, function: &Function, own: &BTreeSet<usize>) -> String {
    let chains = own_chains(image, function, own);
    let shared = shared(&chains);
    let frames = chains.first().map_or(&[][..], |chain| &chain[..shared]);
    source_function(frames.iter().rev()).unwrap_or_else(|| function.name.clone())
}

/// The first function of the project among some frames, without the closures in it.
pub(crate) fn source_function<'a>(mut frames: impl Iterator<Item = &'a Frame>) -> Option<String> {
    let own = frames.find(|frame| frame.file.starts_with("src/"))?;
    Some(without_closures(&own.function).0.to_owned())
}

/// All lines of the instructions of `own`.
fn lines(image: &Image, function: &Function, own: &BTreeSet<usize>) -> BTreeSet<String> {
    let instructions = instructions(function, own);
    let mut seen: BTreeMap<Rc<str>, BTreeSet<u32>> = BTreeMap::new();
    for instruction in instructions {
        for frame in image.frames(instruction.address).iter() {
            let lines = seen.entry(Rc::clone(&frame.file)).or_default();
            lines.insert(frame.line);
        }
    }
    seen.iter()
        .flat_map(|(file, lines)| lines.iter().map(move |line| format!("{file}:{line}")))
        .collect()
}

/// A loop of the source, called from one place.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Source {
    file: Rc<str>,
    found: SourceLoop,
    /// Functions and lines through which it is inlined, the outermost first.
    path: Vec<Frame>,
}

impl Source {
    fn of(
        image: &Image,
        annotations: &Annotations,
        function: &Function,
        own: &BTreeSet<usize>,
    ) -> Option<Self> {
        let chains = own_chains(image, function, own);
        let shared = shared(&chains);
        let mut from_library = false;
        for level in (0..shared).rev() {
            let frames: Vec<&Frame> = chains.iter().map(|chain| &chain[level]).collect();
            let file = &frames[0].file;
            let Some(loops) = annotations.loops(file) else {
                from_library = true;
                continue;
            };
            let (_, closures) = without_closures(&frames[0].function);
            let holds = |found: &&SourceLoop| {
                found.closures == closures
                    && frames.iter().all(|frame| found.whole.contains(&frame.line))
            };
            let innermost = loops
                .iter()
                .filter(holds)
                .min_by_key(|found| found.whole.clone().count());
            let source = innermost.map(|found| Self {
                file: Rc::clone(file),
                found: found.clone(),
                path: chains[0][..level].to_vec(),
            });
            if from_library {
                return source.filter(|source| {
                    let header = &source.found.header;
                    frames.iter().all(|frame| header.contains(&frame.line))
                });
            }
            if let Some(source) = source {
                // A loop that was unrolled may still contain a loop of a library.
                let all = self::chains(image, instructions(function, own));
                return Some(source).filter(|source| source.is_headed(&all, level));
            }
        }
        None
    }

    /// Whether one of the instructions is of the loop's header.
    fn is_headed(&self, chains: &[Vec<Frame>], level: usize) -> bool {
        let is_header =
            |frame: &Frame| frame.file == self.file && self.found.header.contains(&frame.line);
        !self.found.has_condition
            || chains
                .iter()
                .any(|chain| chain.get(level).is_some_and(is_header))
    }

    fn stated(&self, stated: &Stated) -> Bound {
        Bound {
            count: stated.count.clone(),
            origin: format!("{}:{}", self.file, stated.line),
            reason: stated.reason.clone(),
        }
    }

    fn bound(&self) -> Option<Bound> {
        Some(self.stated(self.found.bound.as_ref()?))
    }

    /// Whether a run of the body has begun wherever a block is executed: that of a `loop` begins at
    /// once, others where something is stored that the body says. Stores are never executed in
    /// advance, unlike most else; those to the stack may be the compiler's own.
    fn runs_at(&self, image: &Image, head: usize, block: usize, blocks: &[Block]) -> bool {
        let stores = |instruction: &&Instruction| match instruction.operation {
            Operation::Store { address, .. } | Operation::FloatStore { address, .. } => {
                !matches!(address, Address::Offset { base: 13, .. })
            }
            _ => false,
        };
        let is_of_body = |chain: &Vec<Frame>| {
            chain.get(self.path.len()).is_some_and(|frame| {
                let line = &frame.line;
                let is_here = frame.file == self.file && self.found.whole.contains(line);
                is_here && !self.found.header.contains(line)
            })
        };
        let stores = blocks[block].instructions.iter().filter(stores);
        let begins_at_once = block == head && !self.found.has_condition;
        begins_at_once || chains(image, stores).iter().any(is_of_body)
    }

    fn total(&self, in_runs: BTreeSet<usize>) -> Option<Total> {
        let total = self.found.total.as_ref()?;
        Some(Total {
            bound: self.stated(total),
            per: total.per.clone(),
            in_runs,
        })
    }
}

/// Whether the compiler moves such instructions about: constants, copies, what is kept on the
/// stack. Their lines say little of the loop that they are in.
fn moves(instruction: &Instruction) -> bool {
    match instruction.operation {
        Operation::Constant { .. }
        | Operation::ConstantTop { .. }
        | Operation::Copy { .. }
        | Operation::Nothing
        | Operation::IfThen(_)
        | Operation::Jump(_) => true,
        Operation::Load { address, .. } | Operation::Store { address, .. } => {
            matches!(
                address,
                Address::Offset { base: 13, .. } | Address::Absolute(_)
            )
        }
        _ => false,
    }
}

/// The frames of instructions, the outermost first; without those that have no line.
fn chains<'a>(
    image: &Image,
    instructions: impl Iterator<Item = &'a Instruction>,
) -> Vec<Vec<Frame>> {
    instructions
        .map(|instruction| {
            let frames = image.frames(instruction.address);
            frames.iter().rev().cloned().collect::<Vec<Frame>>()
        })
        .filter(|chain| !chain.is_empty() && chain.iter().all(|frame| frame.line != 0))
        .collect()
}

/// The instructions of some blocks.
fn instructions<'a>(
    function: &'a Function,
    own: &'a BTreeSet<usize>,
) -> impl Iterator<Item = &'a Instruction> {
    own.iter()
        .flat_map(|&block| &function.blocks[block].instructions)
}

/// The frames of the instructions of a loop; without those that only move a value, if there are others.
fn own_chains(image: &Image, function: &Function, own: &BTreeSet<usize>) -> Vec<Vec<Frame>> {
    let others = instructions(function, own).filter(|one| !moves(one));
    let chains = chains(image, others);
    if chains.is_empty() {
        self::chains(image, instructions(function, own))
    } else {
        chains
    }
}

/// How many levels of inlining all chains share: the same functions, called in the same lines.
fn shared(chains: &[Vec<Frame>]) -> usize {
    let Some((first, others)) = chains.split_first() else {
        return 0;
    };
    let is_shared = |level: usize| {
        others.iter().all(|chain| {
            let same_call = level == 0 || chain.get(level - 1) == first.get(level - 1);
            same_call
                && chain.get(level).map(|frame| &frame.function) == Some(&first[level].function)
        })
    };
    (0..first.len())
        .take_while(|&level| is_shared(level))
        .count()
}

/// The function that closures are in, and how many they are.
fn without_closures(name: &str) -> (&str, usize) {
    match name.strip_suffix("::{{closure}}") {
        Some(outer) => {
            let (name, count) = without_closures(outer);
            (name, count + 1)
        }
        None => (name, 0),
    }
}
