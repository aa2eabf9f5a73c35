//! The profile: instructions and cycles of each function.

mod entries;

use std::collections::BTreeMap;

pub use entries::{Amount, Calls, Site, Task};
use entries::{Call, Frame, Pending};

use crate::{
    decode::{Class, Flow},
    elf::Program,
    table::{self, Circumstances},
};

/// Addresses of peripherals, and of the processor's own registers.
const PERIPHERALS: [core::ops::Range<u32>; 2] =
    [0x4000_0000..0x6000_0000, 0xe000_0000..0xf000_0000];

/// See the module.
pub struct Profile {
    /// The program.
    pub program: Program,
    /// Instructions met.
    pub sites: Vec<Site>,
    /// The first is what runs outside handlers.
    pub tasks: Vec<Task>,
    /// Calls of each of [`Program::functions`].
    pub calls: Vec<Calls>,
    /// Everything executed.
    pub total: Amount,
    /// Changes of flow that no rule explains; 0 or the attribution is wrong.
    pub unexplained: u64,
    /// The first of them: from, to.
    pub first_unexplained: Option<(u32, u32)>,
    frames: Vec<Frame>,
    index: BTreeMap<u32, usize>,
}

impl Profile {
    /// Empty profile.
    pub fn new(program: Program) -> Self {
        let calls = vec![Calls::default(); program.functions.len()];
        Self {
            program,
            sites: Vec::new(),
            tasks: vec![Task::default()],
            calls,
            total: Amount::default(),
            unexplained: 0,
            first_unexplained: None,
            frames: vec![Frame::new(0, None, 0)],
            index: BTreeMap::new(),
        }
    }

    /// Enters the instruction `code` at `address`; returns its number.
    pub fn site(&mut self, address: u32, code: [u16; 2]) -> usize {
        if let Some(&known) = self.index.get(&address)
            && self.sites[known].code == code
        {
            return known;
        }
        let site = self.sites.len();
        self.sites.push(Site {
            address,
            code,
            by_task: Vec::new(),
            function: self.program.function_at(address),
            decoded: crate::decode::decode(address, code[0], code[1]),
            is_handler: address != 0 && self.program.handlers.contains(&address),
        });
        self.index.insert(address, site);
        site
    }

    /// The instruction `site` is about to be executed.
    pub fn execute(&mut self, site: usize) {
        let address = self.sites[site].address;
        if self.enters_handler(site) {
            self.leave_if_returning();
            self.enter(site);
        } else {
            self.resolve(address);
        }
        let instruction = self.sites[site].instruction();
        let Some(frame) = self.frames.last_mut() else {
            return;
        };
        let conditional = frame.governed > 0;
        frame.governed = match instruction.class {
            Class::IfThen(count) => count,
            _ => frame.governed.saturating_sub(1),
        };
        frame.pending = Some(Pending {
            site,
            conditional,
            how: Circumstances {
                taken: false,
                touched: false,
                follows_load: frame.loaded != 0 && frame.loaded & instruction.address == 0,
                follows_short: frame.short_end == address,
            },
        });
    }

    /// The instruction being executed reads or writes `address`.
    pub fn touch(&mut self, address: u32, store: bool) {
        let Some(frame) = self.frames.last_mut() else {
            return;
        };
        if let Some(pending) = &mut frame.pending {
            pending.how.touched = true;
        }
        if PERIPHERALS.iter().any(|range| range.contains(&address)) {
            let task = &mut self.tasks[frame.task];
            if store {
                task.peripheral_writes += 1;
            } else {
                task.peripheral_reads += 1;
            }
        }
    }

    /// Completes the profile when the program has ended.
    pub fn close(&mut self) {
        // An activation that the end cut off is in nobody's statistics.
        while self.frames.len() > 1 {
            self.settle(false);
            self.frames.pop();
        }
        self.settle(false);
        if let Some(thread) = self.frames.pop() {
            self.tasks[0].activations = 1;
            self.tasks[0].total = thread.spent;
            self.tasks[0].span_cycles = self.total.cycles;
        }
    }

    /// Whether `site` is reached by an exception: it is a handler's first, and nobody branched there.
    fn enters_handler(&self, site: usize) -> bool {
        let site = &self.sites[site];
        let pending = self.frames.last().and_then(|frame| frame.pending);
        site.is_handler
            && pending.is_none_or(|last| {
                let last = self.sites[last.site].instruction();
                last.flow != Flow::Jump(site.address) && last.flow != Flow::Call(site.address)
            })
    }

    /// A handler that has just executed its return and is followed by another handler has ended.
    fn leave_if_returning(&mut self) {
        if let Some(frame) = self.frames.last()
            && let Some(pending) = frame.pending
            && !pending.conditional
            && frame.task != 0
            && frame.calls.is_empty()
            && self.sites[pending.site].instruction().flow == Flow::Return
        {
            self.settle(true);
            self.leave();
        }
    }

    fn enter(&mut self, site: usize) {
        let Site {
            address, function, ..
        } = self.sites[site];
        let task = self
            .tasks
            .iter()
            .position(|task| task.handler == address)
            .unwrap_or_else(|| {
                self.tasks.push(Task {
                    handler: address,
                    ..Task::default()
                });
                self.tasks.len() - 1
            });
        self.frames
            .push(Frame::new(task, function, self.total.cycles));
        self.spend(Amount {
            instructions: 0,
            cycles: table::EXCEPTION_ENTRY,
        });
    }

    /// Ends the activation on top.
    fn leave(&mut self) {
        self.spend(Amount {
            instructions: 0,
            cycles: table::EXCEPTION_EXIT,
        });
        let Some(frame) = self.frames.pop() else {
            return;
        };
        if let Some(function) = frame.function {
            self.calls[function].count += 1;
            self.calls[function].total.add(frame.spent);
        }
        let span = self.total.cycles - frame.begin_cycle;
        self.tasks[frame.task].record(frame.spent, span);
    }

    /// Execution goes on at `next`: completes what was pending, and ends handlers that returned.
    fn resolve(&mut self, next: u32) {
        while let Some(frame) = self.frames.last()
            && let Some(pending) = frame.pending
        {
            let site = &self.sites[pending.site];
            let instruction = site.instruction();
            let after = site.address + u32::from(instruction.size);
            let taken = next != after;
            let returns = taken
                && instruction.flow == Flow::Return
                && frame.task != 0
                && frame.calls.is_empty();
            self.settle(taken);
            if returns {
                self.leave();
                continue;
            }
            if taken {
                self.follow(pending.site, next);
            }
            return;
        }
    }

    /// Keeps the call stack of the activation on top: the branch at `site` went to `next`.
    fn follow(&mut self, site: usize, next: u32) {
        let Site {
            address, function, ..
        } = self.sites[site];
        let instruction = self.sites[site].instruction();
        let into = self.program.function_at(next);
        let begins = into.filter(|&into| self.program.functions[into].address == next);
        let Some(frame) = self.frames.last_mut() else {
            return;
        };
        let begin = frame.spent;
        match instruction.flow {
            Flow::Call(_) | Flow::CallComputed => frame.calls.push(Call {
                function: begins,
                return_address: address + u32::from(instruction.size),
                begin,
            }),
            Flow::Jump(_) | Flow::JumpComputed if begins.is_some() && into != function => {
                // A tail call returns where its caller would have.
                if let Some(return_address) = frame.calls.last().map(|call| call.return_address) {
                    frame.calls.push(Call {
                        function: begins,
                        return_address,
                        begin,
                    });
                }
            }
            Flow::Return | Flow::JumpComputed => self.unwind(site, next),
            Flow::Jump(target) if target == next => {}
            Flow::Jump(_) | Flow::Next => self.wonder(address, next),
        }
    }

    /// Ends the calls that return to `next`.
    fn unwind(&mut self, site: usize, next: u32) {
        let Site {
            address, function, ..
        } = self.sites[site];
        let is_return = self.sites[site].instruction().flow == Flow::Return;
        let within = !is_return && self.program.function_at(next) == function;
        let Some(frame) = self.frames.last_mut() else {
            return;
        };
        if within {
            return;
        }
        if !frame.calls.iter().any(|call| call.return_address == next) {
            if is_return && !frame.calls.is_empty() {
                self.wonder(address, next);
            }
            return;
        }
        let mut found = false;
        while let Some(call) = frame.calls.last() {
            let here = call.return_address == next;
            if found && !here {
                break;
            }
            found |= here;
            if let Some(function) = call.function {
                let calls = &mut self.calls[function];
                calls.count += 1;
                calls.total.add(Amount {
                    instructions: frame.spent.instructions - call.begin.instructions,
                    cycles: frame.spent.cycles - call.begin.cycles,
                });
            }
            frame.calls.pop();
        }
    }

    fn wonder(&mut self, from: u32, to: u32) {
        self.unexplained += 1;
        self.first_unexplained.get_or_insert((from, to));
    }

    /// Charges the pending instruction of the activation on top.
    fn settle(&mut self, taken: bool) {
        let Some(frame) = self.frames.last_mut() else {
            return;
        };
        let Some(pending) = frame.pending.take() else {
            return;
        };
        let site = &mut self.sites[pending.site];
        let instruction = site.instruction();
        let how = Circumstances {
            taken,
            ..pending.how
        };
        let loads = instruction.class == Class::Load && how.touched && !taken;
        frame.loaded = if loads { instruction.loaded } else { 0 };
        let short = instruction.size == 2 && !taken;
        frame.short_end = if short { site.address + 2 } else { 0 };
        let amount = Amount {
            instructions: 1,
            cycles: table::cycles(&instruction, how),
        };
        if site.by_task.len() <= frame.task {
            site.by_task.resize(frame.task + 1, Amount::default());
        }
        site.by_task[frame.task].add(amount);
        self.spend(amount);
    }

    fn spend(&mut self, amount: Amount) {
        if let Some(frame) = self.frames.last_mut() {
            frame.spent.add(amount);
        }
        self.total.add(amount);
    }
}

#[cfg(test)]
mod tests;
