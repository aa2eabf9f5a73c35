//! The result of a replay.

use serde::{Deserialize, Serialize};

use super::activation::Activation;
use crate::Model;

/// Everything that was found.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Summary {
    /// Each kind of run of each task that was followed.
    pub tasks: Vec<Runs>,
    /// Instructions executed, in whatever code.
    pub instructions: u64,
    /// Accesses to memory by the tasks.
    pub accesses: u64,
    /// Accesses whose region was not predicted.
    pub unpredicted: u64,
    /// Sections in which tasks are held up, in whatever code.
    pub sections: Vec<Held>,
    /// Where the execution contradicts the analysis; empty: nowhere.
    pub violations: Vec<Violation>,
}

/// The runs of one kind of one task; costs are without preemptions, with entry and exit of the
/// exception.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Runs {
    /// Its name.
    pub name: String,
    /// How often it has run to its end.
    pub activations: u64,
    /// How many of these were preempted.
    pub preempted: u64,
    /// Most cycles with every instruction in the cache.
    pub warm_max: u64,
    /// Sum of these over all runs.
    pub warm_sum: u64,
    /// Most cycles with the cache as it was, of the runs that were not preempted.
    pub cached_max: u64,
    /// Most cycles as if there were no cache.
    pub uncached_max: u64,
    /// Most instructions.
    pub instructions_max: u64,
    /// Deepest stack without the exception's frame, bytes.
    pub stack_max: u64,
    /// Blocks of the functions that it can reach.
    pub blocks: usize,
    /// How many of these blocks the task has executed.
    pub executed: usize,
    /// Where the others begin: `function (file:line)`.
    pub never: Vec<String>,
}

/// The longest run of a section in which tasks are held up.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Held {
    /// Where it begins.
    pub address: u32,
    /// The same as `function (file:line)`.
    pub place: String,
    /// Cycles with every instruction in the cache.
    pub cycles: u64,
}

/// A contradiction.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Violation {
    /// What, in one sentence.
    pub what: String,
    /// Where: `function (file:line)`, innermost first.
    pub place: Vec<String>,
    /// How often.
    pub count: u64,
}

impl Runs {
    /// Adds a run that has ended.
    pub(super) fn record(&mut self, activation: &Activation, model: &Model) {
        let spent = activation.spent;
        let float = if activation.uses_float {
            model.lazy_save()
        } else {
            0
        };
        let warm = spent.cycles + model.refill() + model.entry_and_exit() + float;
        self.activations += 1;
        self.warm_sum += warm;
        self.warm_max = self.warm_max.max(warm);
        self.uncached_max = self
            .uncached_max
            .max(warm + model.miss() * (spent.fetched + 1));
        self.instructions_max = self.instructions_max.max(spent.instructions);
        self.stack_max = self.stack_max.max(activation.deepest.max(0) as u64);
        if activation.preemptions > 0 {
            self.preempted += 1;
        } else {
            self.cached_max = self
                .cached_max
                .max(warm + model.miss() * (spent.missed + 1));
        }
    }
}
