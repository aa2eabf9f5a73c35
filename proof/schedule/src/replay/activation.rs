//! One run of a task, from its exception's entry to its return.

use std::collections::BTreeMap;

use super::graph::{Gate, Graph, Site};

/// The cost of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Spent {
    pub(super) instructions: u64,
    /// Cycles with every instruction in the cache.
    pub(super) cycles: u64,
    /// Lines that were not in the cache.
    pub(super) missed: u64,
    /// Lines that were fetched, as if there were no cache.
    pub(super) fetched: u64,
}

/// A call that has not returned.
pub(super) struct Call {
    /// Number of the calling instruction.
    pub(super) site: usize,
    /// Depth of the stack before it.
    depth: i32,
}

/// A section in which tasks are held up.
struct OpenSection {
    address: u32,
    /// Cycles spent before it.
    cycles: u64,
}

/// Time spent with tasks held up, in whatever code.
#[derive(Default)]
pub(super) struct Sections(Vec<OpenSection>);

impl Sections {
    /// Adds an instruction that takes the cycles after `before`. If a section ends there, its length counts in the
    /// longest of its address.
    pub(super) fn pass(&mut self, site: &Site, before: u64, longest: &mut BTreeMap<u32, u64>) {
        let address = site.address;
        match site.gate {
            Gate::None => {}
            Gate::Closes => {
                // One that was left without its end, as an initialisation may.
                self.0.retain(|open| open.address != address);
                let cycles = before;
                self.0.push(OpenSection { address, cycles });
            }
            Gate::Opens => {
                if let Some(open) = self.0.pop() {
                    let longest = longest.entry(open.address).or_default();
                    *longest = (before + site.cycles - open.cycles).max(*longest);
                }
            }
        }
    }
}

/// See the module.
#[derive(Default)]
pub(super) struct Activation {
    pub(super) spent: Spent,
    /// The instruction executed last.
    pub(super) previous: Option<usize>,
    pub(super) calls: Vec<Call>,
    /// Kinds of runs to which the activation does not belong, bit 0 the first.
    pub(super) excluded: u64,
    /// Times that another task came in between.
    pub(super) preemptions: u64,
    pub(super) uses_float: bool,
    /// The line fetched last, as if there were no cache.
    pub(super) line: Option<u32>,
    pub(super) sections: Sections,
    /// Runs of each loop since it was entered, and those of its budget in all; cycles when its head
    /// was met last.
    runs: Vec<u64>,
    totals: Vec<u64>,
    met: Vec<u64>,
    /// Calls of functions and executions of blocks that may not be often, by their address.
    counted: BTreeMap<u32, u64>,
    /// Bytes on the stack, now and at most.
    depth: i32,
    pub(super) deepest: i32,
    /// The depth is not known for certain.
    is_vague: bool,
    /// Where the stack was at the beginning, as soon as an access tells.
    base: Option<u32>,
}

/// Something has been done more often than it may: runs of a loop for one entry, or in all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Excess {
    Bound(usize),
    Total(usize),
    /// Calls of the function there.
    Calls(u32),
}

impl Activation {
    /// Begins anew.
    pub(super) fn begin(&mut self, loops: usize) {
        let cleared = |numbers: &mut Vec<u64>| {
            let mut cleared = std::mem::take(numbers);
            cleared.clear();
            cleared.resize(loops, 0);
            cleared
        };
        *self = Self {
            runs: cleared(&mut self.runs),
            totals: cleared(&mut self.totals),
            met: cleared(&mut self.met),
            ..Self::default()
        };
    }

    /// A call is made.
    pub(super) fn call(&mut self, site: usize) {
        let depth = self.depth;
        self.calls.push(Call { site, depth });
    }

    /// The innermost call has returned.
    pub(super) fn come_back(&mut self) {
        if let Some(call) = self.calls.pop() {
            self.depth = call.depth;
        }
    }

    /// A function is called.
    pub(super) fn count_call(&mut self, first: &Site) -> Option<Excess> {
        let most = first.limit?;
        let count = self.counted.entry(first.address).or_default();
        *count += 1;
        (*count > most).then_some(Excess::Calls(first.address))
    }

    /// A block begins that is in each run of a loop and nowhere else.
    pub(super) fn count_run(
        &mut self,
        number: usize,
        looped: usize,
        graph: &Graph,
    ) -> Option<Excess> {
        let count = self.counted.entry(graph.sites[number].address).or_default();
        *count += 1;
        let (total, _) = graph.loops[looped].total.as_ref()?;
        (*count > *total).then_some(Excess::Total(looped))
    }

    /// Loops are entered.
    pub(super) fn enter(&mut self, loops: &[usize]) {
        for &looped in loops {
            self.runs[looped] = 0;
            self.met[looped] = self.spent.cycles;
        }
    }

    /// Loops are run again.
    pub(super) fn run_again(&mut self, loops: &[usize], graph: &Graph) -> Option<Excess> {
        let mut excess = None;
        for &number in loops {
            let looped = &graph.loops[number];
            let begun = std::mem::replace(&mut self.met[number], self.spent.cycles);
            self.runs[number] += 1;
            self.totals[looped.budget] += 1;
            if let Some((total, _)) = looped.total
                && self.totals[looped.budget] > total
            {
                excess = Some(Excess::Total(number));
            }
            if let Some((bound, _)) = looped.bound
                && self.runs[number] > bound
            {
                // The preempting task pays for the retry.
                if looped.retries && self.runs[number] <= bound + self.preemptions {
                    self.spent.cycles = begun;
                    self.met[number] = begun;
                } else {
                    excess = Some(Excess::Bound(number));
                }
            }
        }
        excess
    }

    /// Keeps the depth of the stack: `site` is executed. A conditional instruction counts when an
    /// access shows that it was not skipped; without an access nobody can tell.
    pub(super) fn deepen(&mut self, site: &Site) {
        if !site.is_conditional {
            self.depth += site.deeper;
            self.deepest = self.deepest.max(self.depth);
        } else if site.deeper != 0 && site.on_stack.is_none() {
            self.is_vague = true;
        }
    }

    /// Whether the first access of `site`, to `address`, is where the stack is said to be.
    pub(super) fn is_on_stack(&mut self, site: &Site, address: u32) -> bool {
        let Some(offset) = site.on_stack else {
            return true;
        };
        // An unconditional instruction has changed the depth already.
        let before = if site.is_conditional {
            self.depth
        } else {
            self.depth - site.deeper
        };
        if site.is_conditional {
            self.depth += site.deeper;
            self.deepest = self.deepest.max(self.depth);
        }
        let base = address.wrapping_add_signed(before - offset);
        self.is_vague || *self.base.get_or_insert(base) == base
    }

    /// Counts the lines that an instruction is fetched from; whether the flow came from elsewhere.
    pub(super) fn fetch(&mut self, site: &Site, is_jump: bool) {
        if is_jump {
            self.line = None;
        }
        let (first, last) = (site.address >> 4, (site.end - 1) >> 4);
        for line in first..=last {
            if self.line != Some(line) {
                self.line = Some(line);
                self.spent.fetched += 1;
            }
        }
    }
}
