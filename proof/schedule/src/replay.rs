//! Follows an execution of the program and checks the claims of the analysis.
//!
//! An emulator that executes the program reports every instruction and every access to memory. A task
//! begins when its handler is reached other than by a branch, and ends with its exception return;
//! preempting tasks are not charged to it. For each analysed task, every step must be an edge of the
//! static graph, no loop may exceed its bound, every access must go to its predicted region, and the
//! stack must not exceed its computed depth. Costs are from the same table as the bounds, so that the
//! two can be compared.

mod activation;
mod cache;
mod graph;
mod plan;
mod summary;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use activation::{Activation, Excess, Sections};
use cache::Cache;
use graph::{Graph, Site};
pub use plan::{Kind, Plan, Root, STAND_INS};
pub use summary::{Held, Runs, Summary, Violation};

use crate::{Instruction, Operation, Region, model};

/// A contradiction, once however often it is met.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Contradiction {
    /// From one instruction to another.
    Step(u32, u32),
    /// From an instruction into code that is not analysed.
    Left(u32, u32),
    /// The head of a loop.
    Bound(usize),
    Total(usize),
    Region(u32, Region),
    Stack(u32),
    /// An access at no multiple of its length takes more accesses than are charged.
    Alignment(u32),
    /// A run of a task that is of none of its kinds.
    Kind(usize),
    /// A function is called too often in one activation.
    Called(u32),
}

/// See the module.
pub struct Checker {
    plan: Plan,
    graph: Graph,
    cache: Cache,
    /// By task.
    activations: Vec<Activation>,
    /// Tasks that have begun and not ended; each has preempted the one before.
    running: Vec<usize>,
    /// The access that may yet show where an instruction of unknown region goes.
    unsettled: bool,
    /// The cycles of all other code, and its sections.
    elsewhere: u64,
    sections: Sections,
    held: BTreeMap<u32, u64>,
    found: BTreeMap<Contradiction, u64>,
    summary: Summary,
}

impl Checker {
    /// Prepares for following an execution.
    ///
    /// # Errors
    ///
    /// Says what is wrong with the plan: a bound without value, a handler that is not analysed.
    pub fn new(plan: Plan) -> Result<Self, String> {
        if plan.kinds().count() > 64 {
            return Err("more than 64 kinds of tasks".into());
        }
        let graph = Graph::new(&plan)?;
        let runs = plan.kinds().map(|kind| Runs {
            name: kind.name.clone(),
            ..Runs::default()
        });
        let summary = Summary {
            tasks: runs.collect(),
            ..Summary::default()
        };
        Ok(Self {
            activations: plan.roots.iter().map(|_| Activation::default()).collect(),
            graph,
            plan,
            cache: Cache::new(),
            running: Vec::new(),
            unsettled: false,
            elsewhere: 0,
            sections: Sections::default(),
            held: BTreeMap::new(),
            found: BTreeMap::new(),
            summary,
        })
    }

    /// The number of the instruction at `address`; `decode` is asked when nobody analysed it.
    pub fn site(&mut self, address: u32, decode: impl FnOnce() -> Option<Instruction>) -> usize {
        match self.graph.find(address) {
            Some(number) => number,
            None => self.graph.add_foreign(address, decode(), &self.plan.model),
        }
    }

    /// The instruction with this number is about to be executed.
    pub fn execute(&mut self, number: usize) {
        self.summary.instructions += 1;
        let address = self.graph.sites[number].address;
        self.end_returned(address);
        if let Some(task) = self.graph.sites[number].handler
            && !self.is_running(task)
        {
            self.begin(task);
        }
        let site = &self.graph.sites[number];
        let mut is_hit = self.cache.fetch(address);
        if (site.end.wrapping_sub(1)) >> 4 != address >> 4 {
            is_hit &= self.cache.fetch(site.end - 1);
        }
        match self.running.last() {
            Some(&task) => self.advance(task, number, is_hit),
            None => self.pass_elsewhere(number),
        }
    }

    /// The instruction with this number, executed last, reads or writes `address`.
    pub fn touch(&mut self, number: usize, address: u32) {
        let site = &self.graph.sites[number];
        let is_first = std::mem::take(&mut self.unsettled);
        let region = Region::of(address);
        let saved = if is_first && site.region == Region::Unknown {
            let instruction = site.instruction.as_ref();
            instruction.map_or(0, |instruction| {
                let real = self.plan.model.cycles(instruction, region);
                site.cycles.saturating_sub(real)
            })
        } else {
            0
        };
        let Some(&task) = self.running.last() else {
            self.elsewhere -= saved;
            return;
        };
        let activation = &mut self.activations[task];
        activation.spent.cycles -= saved;
        self.summary.accesses += 1;
        if site.region == Region::Unknown {
            self.summary.unpredicted += 1;
        } else if site.region != region {
            note(&mut self.found, Contradiction::Region(site.address, region));
        }
        if is_first && !is_aligned(site, address) {
            note(&mut self.found, Contradiction::Alignment(site.address));
        }
        if is_first && !activation.is_on_stack(site, address) {
            note(&mut self.found, Contradiction::Stack(site.address));
        }
    }

    /// What was found; `frames` tells where an address is: `function (file:line)`, innermost first.
    pub fn summary(&self, frames: impl Fn(u32) -> Vec<String>) -> Summary {
        let mut summary = self.summary.clone();
        let kinds = self.plan.roots.iter().enumerate();
        let kinds = kinds.flat_map(|(task, root)| root.kinds.iter().map(move |kind| (task, kind)));
        for ((task, kind), runs) in kinds.zip(&mut summary.tasks) {
            self.cover(task, kind, runs, &frames);
        }
        summary.sections = self
            .held
            .iter()
            .map(|(&address, &cycles)| Held {
                address,
                place: own_frame(frames(address)),
                cycles,
            })
            .collect();
        summary.violations = self
            .found
            .iter()
            .map(|(contradiction, &count)| {
                let (address, what) = self.describe(*contradiction);
                Violation {
                    what,
                    place: frames(address),
                    count,
                }
            })
            .collect();
        summary
    }

    fn is_running(&self, task: usize) -> bool {
        self.running.contains(&task)
    }

    /// Ends the tasks that have returned, now that execution goes on at `next`.
    fn end_returned(&mut self, next: u32) {
        while let Some(&task) = self.running.last() {
            let activation = &self.activations[task];
            let Some(previous) = activation.previous else {
                return;
            };
            let site = &self.graph.sites[previous];
            let is_skipped = site.is_conditional && next == site.end;
            if !site.is_return || !activation.calls.is_empty() || is_skipped {
                return;
            }
            self.end(task);
        }
    }

    fn begin(&mut self, task: usize) {
        if let Some(&below) = self.running.last() {
            self.activations[below].preemptions += 1;
        }
        self.activations[task].begin(self.graph.loops.len());
        self.running.push(task);
    }

    fn end(&mut self, task: usize) {
        self.running.pop();
        let activation = &self.activations[task];
        let first: usize = self.plan.roots[..task]
            .iter()
            .map(|root| root.kinds.len())
            .sum();
        let mut is_of_any = false;
        for (kind, _) in (first..).zip(&self.plan.roots[task].kinds) {
            if activation.excluded >> kind & 1 == 0 {
                self.summary.tasks[kind].record(activation, &self.plan.model);
                is_of_any = true;
            }
        }
        if !is_of_any {
            note(&mut self.found, Contradiction::Kind(task));
        }
    }

    /// A task executes an instruction.
    fn advance(&mut self, task: usize, number: usize, is_hit: bool) {
        let is_jump = self.follow(task, number);
        let activation = &mut self.activations[task];
        let site = &mut self.graph.sites[number];
        site.tasks |= 1 << task;
        activation.excluded |= site.excludes;
        let begun = activation.spent.cycles;
        activation.sections.pass(site, begun, &mut self.held);
        let site = &self.graph.sites[number];
        if let Some(looped) = site.in_run {
            let excess = activation.count_run(number, looped, &self.graph);
            note_excess(&mut self.found, excess);
        }
        activation.fetch(site, is_jump);
        activation.deepen(site);
        activation.uses_float |= site.is_float;
        activation.spent.instructions += 1;
        activation.spent.cycles += site.cycles;
        activation.spent.missed += u64::from(!is_hit);
        activation.previous = Some(number);
        self.unsettled = true;
    }

    /// Checks the step of a task to its next instruction; whether it is a jump.
    fn follow(&mut self, task: usize, number: usize) -> bool {
        let activation = &mut self.activations[task];
        let to = &self.graph.sites[number];
        let Some(from) = activation.previous else {
            if let Some(node) = to.node {
                activation.enter(&self.graph.nodes[node].begins);
            }
            return true;
        };
        let site = &self.graph.sites[from];
        if site.next == Some(number) {
            return false;
        }
        let is_jump = to.address != site.end;
        if is_jump {
            activation.spent.cycles += self.plan.model.refill();
        }
        match step(activation, &self.graph, from, number) {
            Ok(excess) => note_excess(&mut self.found, excess),
            Err(()) if site.node.is_none() => {}
            Err(()) if to.node.is_none() => {
                note(
                    &mut self.found,
                    Contradiction::Left(site.address, to.address),
                );
            }
            Err(()) => note(
                &mut self.found,
                Contradiction::Step(site.address, to.address),
            ),
        }
        is_jump
    }

    /// Code that no task executes matters only for the time for which it holds tasks up.
    fn pass_elsewhere(&mut self, number: usize) {
        let site = &self.graph.sites[number];
        let begun = self.elsewhere;
        self.sections.pass(site, begun, &mut self.held);
        self.elsewhere += site.cycles;
        self.unsettled = true;
    }

    /// Counts the blocks that a task has executed, among the blocks that such a run can reach.
    fn cover(
        &self,
        task: usize,
        kind: &Kind,
        runs: &mut Runs,
        frames: &impl Fn(u32) -> Vec<String>,
    ) {
        let functions = self.plan.roots[task].reach.iter();
        let functions = functions.filter(|address| !kind.excluded.contains(address));
        let functions = functions.filter_map(|address| self.plan.functions.get(address));
        let blocks = functions.flat_map(|function| &function.blocks);
        for block in blocks.filter(|block| !block.traps) {
            let start = block.start();
            let is_executed = |site: &Site| site.tasks >> task & 1 == 1;
            let site = self.graph.find(start).map(|site| &self.graph.sites[site]);
            runs.blocks += 1;
            if site.is_some_and(is_executed) {
                runs.executed += 1;
            } else {
                runs.never
                    .push(format!("{start:#010x} {}", frames(start).join(" < ")));
            }
        }
    }

    /// Where a contradiction is, and what it is.
    fn describe(&self, contradiction: Contradiction) -> (u32, String) {
        let excess = |number: usize, limit: &Option<(u64, String)>, often: &str| {
            let (bound, origin) = limit.clone().unwrap_or_default();
            let head = self.graph.loops[number].head;
            let what = format!("a loop runs more than {bound} times {often} ({origin})");
            (head, what)
        };
        match contradiction {
            Contradiction::Step(from, to) => (
                from,
                format!(
                    "{from:#010x} is followed by {to:#010x}, which the static graph does not know"
                ),
            ),
            Contradiction::Left(from, to) => (
                from,
                format!("{from:#010x} leads to {to:#010x}, which is not analysed"),
            ),
            Contradiction::Bound(number) => {
                excess(number, &self.graph.loops[number].bound, "for one entry")
            }
            Contradiction::Total(number) => {
                excess(number, &self.graph.loops[number].total, "in one activation")
            }
            Contradiction::Region(at, region) => {
                let site = self
                    .graph
                    .find(at)
                    .map(|site| self.graph.sites[site].region);
                let predicted = site.unwrap_or(Region::Unknown);
                (
                    at,
                    format!(
                        "{at:#010x} was predicted to access {predicted:?} and accesses {region:?}"
                    ),
                )
            }
            Contradiction::Kind(task) => {
                let root = &self.plan.roots[task];
                let what = format!("a run of {} is of none of its kinds", root.name);
                (root.handler, what)
            }
            Contradiction::Called(function) => {
                let most = self.plan.limited.get(&function).unwrap_or(&0);
                let what = format!("a function is called more than {most} times in one activation");
                (function, what)
            }
            Contradiction::Alignment(at) => (
                at,
                format!(
                    "{at:#010x} accesses memory at no multiple of its length, and is not charged for it"
                ),
            ),
            Contradiction::Stack(at) => (
                at,
                format!("the stack is not as deep at {at:#010x} as the analysis counts"),
            ),
        }
    }
}

/// Whether an access is at a multiple of its length, or is charged for that it is not.
fn is_aligned(site: &Site, address: u32) -> bool {
    site.instruction.is_none_or(|instruction| {
        let bytes = match instruction.operation {
            Operation::Load { bytes, .. } | Operation::Store { bytes, .. } => bytes,
            _ => 1,
        };
        model::accesses_at(bytes, address) <= model::accesses(&instruction)
    })
}

/// Follows a step between blocks; returns the loops that exceed their bounds by the step, or an
/// error where the graph has no such edge.
fn step(
    activation: &mut Activation,
    graph: &Graph,
    from: usize,
    to: usize,
) -> Result<Option<Excess>, ()> {
    let (site, target) = (&graph.sites[from], &graph.sites[to]);
    let node = &graph.nodes[site.node.ok_or(())?];
    let is_call = |instruction: &Instruction| matches!(instruction.operation, Operation::Call(_));
    if site.next.is_some() {
        return Err(());
    }
    let mut steps = &node.steps;
    if site.is_return
        && let Some(call) = activation.calls.last()
        && graph.sites[call.site].end == target.address
    {
        let caller = graph.sites[call.site].node.ok_or(())?;
        steps = &graph.nodes[caller].steps;
        activation.come_back();
    } else if node.call == Some(target.address) {
        if site.instruction.as_ref().is_some_and(is_call) {
            activation.call(from);
        }
        if let Some(node) = target.node {
            activation.enter(&graph.nodes[node].begins);
        }
        return Ok(activation.count_call(target));
    }
    let step = steps.iter().find(|step| step.to == to).ok_or(())?;
    activation.enter(&step.enters);
    Ok(activation.run_again(&step.again, graph))
}

fn note_excess(found: &mut BTreeMap<Contradiction, u64>, excess: Option<Excess>) {
    match excess {
        None => {}
        Some(Excess::Bound(looped)) => note(found, Contradiction::Bound(looped)),
        Some(Excess::Total(looped)) => note(found, Contradiction::Total(looped)),
        Some(Excess::Calls(function)) => note(found, Contradiction::Called(function)),
    }
}

/// The innermost frame that is the project's own, as the report names places.
fn own_frame(frames: Vec<String>) -> String {
    let own = frames.iter().position(|frame| frame.contains("(src/"));
    frames.into_iter().nth(own.unwrap_or(0)).unwrap_or_default()
}

fn note(found: &mut BTreeMap<Contradiction, u64>, contradiction: Contradiction) {
    *found.entry(contradiction).or_default() += 1;
}
