//! The analysed functions, laid out for following an execution instruction by instruction.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::Plan;
use crate::{
    Address, Bound, Count, Function, Instruction, Model, Operation, Region, raises, restores,
};

/// The effect of an instruction on the sections in which tasks are held up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Gate {
    None,
    /// Holds tasks up.
    Closes,
    /// Restores what was before.
    Opens,
}

/// One instruction.
pub(super) struct Site {
    pub(super) address: u32,
    /// The address after its end.
    pub(super) end: u32,
    /// Index of [`Graph::nodes`]; `None`: not of an analysed function.
    pub(super) node: Option<usize>,
    /// Number of the next instruction of its block; `None` at the block's end.
    pub(super) next: Option<usize>,
    /// `None`: the decoder does not know it, and it is not of an analysed function.
    pub(super) instruction: Option<Instruction>,
    /// Where it is predicted to read or write.
    pub(super) region: Region,
    /// Cycles of the instruction with a cache miss.
    pub(super) cycles: u64,
    pub(super) is_return: bool,
    pub(super) is_conditional: bool,
    pub(super) is_float: bool,
    pub(super) gate: Gate,
    /// Bytes that it adds to the stack's depth.
    pub(super) deeper: i32,
    /// The accessed address, relative to the stack pointer, where the address is made from the
    /// stack pointer.
    pub(super) on_stack: Option<i32>,
    /// The task whose handler it begins.
    pub(super) handler: Option<usize>,
    /// Kinds of runs in which the function that it begins is not called, bit 0 the first.
    pub(super) excludes: u64,
    /// Most calls, in one activation, of the function that begins here.
    pub(super) limit: Option<u64>,
    /// The loop that it is in a run of, at the beginning of a block: as often as its total says.
    pub(super) in_run: Option<usize>,
    /// Tasks that have executed it, bit 0 the first.
    pub(super) tasks: u64,
}

/// An edge out of a block.
pub(super) struct Step {
    /// Number of the instruction it leads to.
    pub(super) to: usize,
    /// Loops that the step enters, and loops that the step repeats.
    pub(super) enters: Vec<usize>,
    pub(super) again: Vec<usize>,
}

/// One block.
pub(super) struct Node {
    /// The function that its last instruction calls or jumps to.
    pub(super) call: Option<u32>,
    pub(super) steps: Vec<Step>,
    /// When it begins a function: the loops that begin there.
    pub(super) begins: Vec<usize>,
}

/// A loop and how often it may run.
pub(super) struct FollowedLoop {
    pub(super) head: u32,
    /// Most runs for each entry, and for each activation.
    pub(super) bound: Option<(u64, String)>,
    pub(super) total: Option<(u64, String)>,
    /// The first loop whose total has the same name, or this one: together they may run so often.
    pub(super) budget: usize,
    /// The name of its total, if it has one.
    name: Option<String>,
    /// Whether it tries a `STREX` again: once more for each preemption.
    pub(super) retries: bool,
}

/// See the module.
pub(super) struct Graph {
    /// The instructions of analysed functions first, then what else is executed.
    pub(super) sites: Vec<Site>,
    pub(super) nodes: Vec<Node>,
    pub(super) loops: Vec<FollowedLoop>,
    index: HashMap<u32, usize>,
}

impl Graph {
    /// Lays out the functions of a plan.
    pub(super) fn new(plan: &Plan) -> Result<Self, String> {
        let mut graph = Self {
            sites: Vec::new(),
            nodes: Vec::new(),
            loops: Vec::new(),
            index: HashMap::new(),
        };
        for function in plan.functions.values() {
            graph.add_sites(function, &plan.model)?;
        }
        let mut first_node = 0;
        for function in plan.functions.values() {
            graph.add_steps(function, first_node, &plan.named)?;
            first_node += function.blocks.len();
        }
        for (task, root) in plan.roots.iter().enumerate() {
            for entry in root.callers.iter().chain([&root.handler]) {
                let site = graph.find(*entry).ok_or_else(|| {
                    format!(
                        "the handler of {} is not in an analysed function",
                        root.name
                    )
                })?;
                graph.sites[site].handler = Some(task);
            }
        }
        for (address, most) in &plan.limited {
            if let Some(site) = graph.find(*address) {
                graph.sites[site].limit = Some(*most);
            }
        }
        for (number, kind) in plan.kinds().enumerate() {
            for address in &kind.excluded {
                if let Some(site) = graph.find(*address) {
                    graph.sites[site].excludes |= 1 << number;
                }
            }
        }
        Ok(graph)
    }

    /// The number of the instruction at an address.
    pub(super) fn find(&self, address: u32) -> Option<usize> {
        self.index.get(&address).copied()
    }

    /// Enters an instruction that is not of an analysed function.
    pub(super) fn add_foreign(
        &mut self,
        address: u32,
        site: Option<Instruction>,
        model: &Model,
    ) -> usize {
        let number = self.sites.len();
        let made = match site {
            Some(instruction) => Site::new(&instruction, Region::Unknown, model),
            None => Site::undecoded(address),
        };
        self.sites.push(made);
        self.index.insert(address, number);
        number
    }

    fn add_sites(&mut self, function: &Function, model: &Model) -> Result<(), String> {
        for block in &function.blocks {
            let node = self.nodes.len();
            self.nodes.push(Node {
                call: block.call,
                steps: Vec::new(),
                begins: Vec::new(),
            });
            let count = block.instructions.len();
            for (position, instruction) in block.instructions.iter().enumerate() {
                let number = self.sites.len();
                let region = function.regions.get(&instruction.address);
                let mut site = Site::new(
                    instruction,
                    region.copied().unwrap_or(Region::Unknown),
                    model,
                );
                site.node = Some(node);
                site.next = (position + 1 < count).then_some(number + 1);
                self.sites.push(site);
                if self.index.insert(instruction.address, number).is_some() {
                    return Err(format!(
                        "{:#010x} in {} belongs to two functions",
                        instruction.address, function.name
                    ));
                }
            }
        }
        Ok(())
    }

    /// Adds the edges and the loops of a function whose blocks are the nodes from `first` on.
    fn add_steps(
        &mut self,
        function: &Function,
        first: usize,
        named: &BTreeMap<String, u64>,
    ) -> Result<(), String> {
        let first_loop = self.loops.len();
        for looped in &function.loops {
            let blocks = looped.total.iter().flat_map(|total| &total.in_runs);
            for block in blocks.map(|block| &function.blocks[*block]) {
                if let Some(site) = self.find(block.start()) {
                    self.sites[site].in_run = Some(self.loops.len());
                }
            }
            let mut looped = FollowedLoop::new(function, looped, named)?;
            let has_name =
                |other: &FollowedLoop| looped.name.is_some() && other.name == looped.name;
            let first = self.loops.iter().position(has_name);
            looped.budget = first.unwrap_or(self.loops.len());
            self.loops.push(looped);
        }
        let headed = |block: usize| {
            let loops = function.loops.iter().enumerate();
            loops.filter(move |(_, looped)| looped.head == block)
        };
        for (index, block) in function.blocks.iter().enumerate() {
            let mut steps = Vec::new();
            for edge in &block.successors {
                let to = function.blocks[edge.to].start();
                let part = |inside: bool| {
                    headed(edge.to)
                        .filter(|(_, looped)| looped.blocks.contains(&index) == inside)
                        .map(|(looped, _)| first_loop + looped)
                        .collect()
                };
                steps.push(Step {
                    to: self.find(to).ok_or("a block that is nowhere")?,
                    enters: part(false),
                    again: part(true),
                });
            }
            self.nodes[first + index].steps = steps;
        }
        if let Some(node) = self.nodes.get_mut(first) {
            node.begins = headed(0).map(|(looped, _)| first_loop + looped).collect();
        }
        Ok(())
    }
}

impl Site {
    fn new(instruction: &Instruction, region: Region, model: &Model) -> Self {
        let (deeper, on_stack) = stack_effect(&instruction.operation);
        Self {
            end: instruction.end(),
            instruction: Some(*instruction),
            region,
            cycles: model.cycles(instruction, region),
            is_return: instruction.is_return(),
            is_conditional: instruction.is_conditional(),
            is_float: instruction.operation.is_float(),
            gate: gate(instruction),
            deeper,
            on_stack,
            ..Self::undecoded(instruction.address)
        }
    }

    /// An instruction that the decoder does not know.
    fn undecoded(address: u32) -> Self {
        Self {
            address,
            end: address,
            node: None,
            next: None,
            instruction: None,
            region: Region::Unknown,
            cycles: 1,
            is_return: false,
            is_conditional: false,
            is_float: false,
            gate: Gate::None,
            deeper: 0,
            on_stack: None,
            handler: None,
            excludes: 0,
            limit: None,
            in_run: None,
            tasks: 0,
        }
    }
}

impl FollowedLoop {
    fn new(
        function: &Function,
        looped: &crate::Loop,
        named: &BTreeMap<String, u64>,
    ) -> Result<Self, String> {
        let unknown = |bound: &Bound| {
            let (count, name) = (&bound.count, &function.name);
            format!("the bound {count:?} of a loop in {name} has no value")
        };
        let known = |bound: &Bound, number: Option<u64>| -> Result<_, String> {
            Ok((number.ok_or_else(|| unknown(bound))?, bound.origin.clone()))
        };
        let bound = looped.bound.as_ref();
        let bound = bound.map(|it| known(it, looped.most(named, &BTreeSet::new())));
        let total = looped.total.as_ref().map(|total| &total.bound);
        let total = total.map(|it| known(it, it.count.value(named)));
        let mut instructions = looped.blocks.iter().flat_map(|block| {
            let block = &function.blocks[*block];
            block.instructions.iter()
        });
        Ok(Self {
            head: function.blocks[looped.head].start(),
            bound: bound.transpose()?,
            total: total.transpose()?,
            budget: usize::MAX,
            name: looped
                .total
                .as_ref()
                .and_then(|total| match &total.bound.count {
                    Count::Named(name) => Some(name.clone()),
                    Count::Number(_) => None,
                }),
            retries: instructions
                .any(|one| matches!(one.operation, Operation::StoreExclusive { .. })),
        })
    }
}

fn gate(instruction: &Instruction) -> Gate {
    if raises(instruction) {
        Gate::Closes
    } else if restores(instruction) {
        Gate::Opens
    } else {
        Gate::None
    }
}

/// By how much the stack gets deeper, and where on it an access goes.
fn stack_effect(operation: &Operation) -> (i32, Option<i32>) {
    const STACK_POINTER: u8 = 13;
    if let Operation::Add {
        to: STACK_POINTER,
        from: STACK_POINTER,
        value,
    } = *operation
    {
        return (-value, None);
    }
    let Some((address, writeback)) = operation.access() else {
        return (0, None);
    };
    let deeper = match writeback {
        Some((STACK_POINTER, bytes)) => -bytes,
        _ => 0,
    };
    match address {
        Address::Offset {
            base: STACK_POINTER,
            offset,
        } => (deeper, Some(offset)),
        _ => (deeper, None),
    }
}
