//! The measurement of each task, and its clock.

use serde::Serialize;

use super::{
    channels::Batch,
    distribution::Distribution,
    nesting::{Activation, Nesting},
};

/// The unit of the firmware's records.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clock {
    /// The unit of all reported times.
    pub(crate) unit: Unit,
    /// Counts of the firmware's clock in a unit.
    pub(crate) counts: u64,
    /// Units that an exception's entry and exit take outside of its record.
    pub(crate) entry_and_exit: u64,
    /// The highest further cost of a preemption: entry and exit outside of the record, an
    /// instruction that begins again, and lines lost from the instruction cache.
    pub(crate) preemption: u64,
}

/// A unit of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Unit {
    /// Cycles of the core.
    Cycles,
    /// Executed instructions, each of which takes a cycle at least.
    Instructions,
}

impl Clock {
    /// A chip's cycle counter.
    #[cfg(any(feature = "probe", test))]
    pub(crate) const CHIP: Self = Self {
        unit: Unit::Cycles,
        counts: 1,
        entry_and_exit: 24,
        // What begins and ends a task and writes its record: 100. The longest instruction, and a
        // failed exclusive access: 37. All 64 lines of the cache, at 5 wait states each.
        preemption: 100 + 37 + 64 * 5,
    };

    /// The emulator's virtual time, which goes on by [`Self::NS_PER_INSTRUCTION`] with each
    /// instruction.
    pub(crate) const EMULATOR: Self = Self {
        unit: Unit::Instructions,
        counts: Self::NS_PER_INSTRUCTION,
        entry_and_exit: 0,
        preemption: 100,
    };

    /// QEMU's option is the binary logarithm of it.
    pub(crate) const NS_PER_INSTRUCTION: u64 = 1 << Self::SHIFT;
    pub(crate) const SHIFT: u32 = 3;

    fn units(self, counts: impl Into<u64>) -> u64 {
        counts.into() / self.counts
    }
}

/// The measurement of one task.
#[derive(Debug, Clone, Default)]
pub(crate) struct Task {
    pub(crate) name: String,
    /// Activations since the start, recorded or not.
    pub(crate) activations: u32,
    /// Records that were read.
    pub(crate) recorded: u64,
    /// Most of them that were read at one time.
    pub(crate) most_at_once: usize,
    /// Fewest that were read when others had been dropped.
    pub(crate) fewest_with_drops: Option<usize>,
    /// From release to start, where the release is known.
    pub(crate) latency: Distribution,
    /// Time that the task took for itself, where every preemption is known.
    pub(crate) execution: Distribution,
    /// From release to end, where the release is known.
    pub(crate) response: Distribution,
    /// The longest execution, less what its preemptions may have cost.
    pub(crate) proven_execution: u64,
}

impl Task {
    /// Activations whose records were dropped.
    pub(crate) fn dropped(&self) -> u64 {
        u64::from(self.activations).saturating_sub(self.recorded)
    }

    /// Whether records were dropped only where the ring was full, so that no other time brought more;
    /// of a chip that stands still while they are read.
    pub(crate) fn drops_for_want_of_room(&self) -> bool {
        let fewest = self.fewest_with_drops;
        fewest.is_none_or(|fewest| fewest == self.most_at_once)
    }

    /// Counts records that were read at one time, and the activations by then.
    fn count(&mut self, records: usize, activations: u32) {
        let new = activations.wrapping_sub(self.activations);
        self.activations = activations;
        self.most_at_once = self.most_at_once.max(records);
        if new as usize > records {
            let fewest = self.fewest_with_drops.unwrap_or(records);
            self.fewest_with_drops = Some(fewest.min(records));
        }
    }

    fn add(&mut self, one: &Activation, clock: Clock) {
        self.recorded += 1;
        if let Some(latency) = one.latency {
            let latency = u64::from(latency);
            self.latency.add(clock.units(latency));
            self.response
                .add(clock.units(latency + one.end - one.start));
        }
        if let Some(execution) = one.execution {
            let execution = clock.units(execution);
            self.execution.add(execution);
            let allowed = u64::from(one.preemptions) * clock.preemption;
            let proven = execution.saturating_sub(allowed);
            self.proven_execution = self.proven_execution.max(proven);
        }
    }
}

/// A measurement that goes on.
pub(crate) struct Measurement {
    clock: Clock,
    nesting: Nesting,
    tasks: Vec<Task>,
}

impl Measurement {
    /// Of these tasks, the one with the highest priority first.
    pub(super) fn new<'a>(names: impl Iterator<Item = &'a str>, clock: Clock) -> Self {
        let tasks: Vec<_> = names
            .map(|name| Task {
                name: name.into(),
                ..Task::default()
            })
            .collect();
        Self {
            clock,
            nesting: Nesting::new(tasks.len(), clock.entry_and_exit * clock.counts),
            tasks,
        }
    }

    /// Takes what was read at one time.
    pub(super) fn push(&mut self, batch: &Batch) {
        for (task, (records, activations)) in self.tasks.iter_mut().zip(&batch.tasks) {
            task.count(records.len(), *activations);
        }
        let settled = self.nesting.push(batch);
        self.add(&settled);
    }

    /// The tasks as far as they are settled.
    pub(super) fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    /// The tasks when the last batch has been read.
    pub(super) fn finish(mut self) -> Vec<Task> {
        let settled = self.nesting.settle_all();
        self.add(&settled);
        self.tasks
    }

    fn add(&mut self, settled: &[Activation]) {
        for one in settled {
            self.tasks[one.task].add(one, self.clock);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{super::channels::Record, *};

    fn record(number: u32, start: u32, duration: u32, latency: Option<u32>) -> Record {
        Record {
            start,
            duration,
            latency,
            number,
        }
    }

    /// A step that preempts a `prepare`, and a step that does not.
    fn batch(scale: u32) -> Batch {
        let step = |number, start| record(number, start * scale, 60 * scale, Some(30 * scale));
        let prepare = record(0, 100 * scale, 1000 * scale, None);
        Batch {
            now: 5000 * scale,
            tasks: vec![(vec![step(0, 200), step(1, 2000)], 3), (vec![prepare], 1)],
        }
    }

    fn measure(clock: Clock, scale: u32) -> Vec<Task> {
        let mut measurement = Measurement::new(["step", "prepare"].into_iter(), clock);
        measurement.push(&batch(scale));
        measurement.finish()
    }

    #[test]
    fn a_record_that_was_dropped_though_there_was_room_is_noticed() {
        let mut task = Task::default();
        for (records, activations, is_right) in
            [(2, 2, true), (3, 9, true), (3, 12, true), (2, 15, false)]
        {
            task.count(records, activations);
            assert_eq!(task.drops_for_want_of_room(), is_right, "{activations}");
        }
    }

    #[test]
    fn latency_execution_and_response_are_distinguished() {
        let tasks = measure(Clock::CHIP, 1);
        let [step, prepare] = tasks.as_slice() else {
            panic!("{tasks:?}");
        };
        assert_eq!((step.recorded, step.activations, step.dropped()), (2, 3, 1));
        assert_eq!(step.latency.summary().max, 30);
        assert_eq!(step.response.summary().max, 90);
        assert_eq!(step.execution.summary().max, 60);
        assert_eq!(prepare.latency.summary().count, 0);
        assert_eq!(prepare.execution.summary().max, 1000 - 60 - 24);
        let proven = 1000 - 60 - 24 - Clock::CHIP.preemption;
        assert_eq!(prepare.proven_execution, proven);
    }

    #[test]
    fn the_emulators_time_is_reported_in_instructions() {
        let tasks = measure(Clock::EMULATOR, Clock::NS_PER_INSTRUCTION as u32);
        assert_eq!(tasks[0].execution.summary().max, 60);
        assert_eq!(tasks[1].execution.summary().max, 1000 - 60);
    }
}
