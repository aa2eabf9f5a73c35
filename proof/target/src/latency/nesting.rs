//! Which activation preempted which: from records to the time that each task took for itself.
//!
//! There is one stack, so activations are nested or disjoint, never crossed. What a task took is its
//! duration less that of the activations inside, with the exception's entry and exit of each. Where
//! a dropped record may have been inside, the execution time is reported as unknown.

use std::{cmp::Reverse, mem};

use super::channels::{Batch, Record};

/// One activation, on a clock that does not wrap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Activation {
    /// Index of its task.
    pub(super) task: usize,
    pub(super) start: u64,
    pub(super) end: u64,
    /// From its release to its start, where that is known.
    pub(super) latency: Option<u32>,
    /// The time of the activation itself; `None` when a dropped record may have been inside.
    pub(super) execution: Option<u64>,
    /// Activations directly inside.
    pub(super) preemptions: u32,
}

/// A time in which records of a task were dropped.
#[derive(Debug, Clone, Copy)]
struct Gap {
    task: usize,
    from: u64,
    to: u64,
}

/// Puts batches together. Tasks come in the order of their priorities, the highest first.
pub(super) struct Nesting {
    /// Time that entry and exit of an exception take outside its record.
    entry_and_exit: u64,
    /// The clock at the last batch, and whether there has been one.
    now: Option<u64>,
    /// Of each task, the number that its next record has when none is dropped, and the end of its
    /// last one.
    next: Vec<(u32, u64)>,
    gaps: Vec<Gap>,
    /// Activations of the last batch but one, which may be inside of later ones.
    reported: Vec<Activation>,
    /// Activations of the last batch, whose insides may be read with the next.
    held: Vec<Activation>,
    /// When the last activation ended that is not remembered any more.
    horizon: u64,
}

impl Nesting {
    pub(super) fn new(tasks: usize, entry_and_exit: u64) -> Self {
        Self {
            entry_and_exit,
            now: None,
            next: vec![(0, 0); tasks],
            gaps: Vec::new(),
            reported: Vec::new(),
            held: Vec::new(),
            horizon: 0,
        }
    }

    /// Takes a batch, and returns the activations that are settled by it.
    pub(super) fn push(&mut self, batch: &Batch) -> Vec<Activation> {
        let now = match self.now {
            Some(before) => before + u64::from(batch.now.wrapping_sub(before as u32)),
            // Room for what was recorded before.
            None => (1 << 32) + u64::from(batch.now),
        };
        self.now = Some(now);
        let mut new = Vec::new();
        for (task, (records, activations)) in batch.tasks.iter().enumerate() {
            for record in records {
                let activation = placed(task, record, now);
                self.note_gap(task, record.number, activation.start);
                self.next[task] = (record.number.wrapping_add(1), activation.end);
                new.push(activation);
            }
            if self.next[task].0 != *activations {
                let from = self.next[task].1;
                self.gaps.push(Gap {
                    task,
                    from,
                    to: now,
                });
            }
        }
        let settled = self.settle(&new);
        let forgotten = mem::replace(&mut self.reported, mem::replace(&mut self.held, new));
        let ends = forgotten.iter().map(|old| old.end);
        self.horizon = ends.fold(self.horizon, u64::max);
        self.gaps.retain(|gap| gap.to >= self.horizon);
        settled
    }

    /// Returns the remaining activations after the last batch.
    pub(super) fn settle_all(&mut self) -> Vec<Activation> {
        self.settle(&[])
    }

    fn note_gap(&mut self, task: usize, number: u32, to: u64) {
        let (next, from) = self.next[task];
        if next != number {
            self.gaps.push(Gap { task, from, to });
        }
    }

    /// The held activations with what is inside of them.
    fn settle(&self, new: &[Activation]) -> Vec<Activation> {
        let held = self.reported.len()..self.reported.len() + self.held.len();
        let mut all: Vec<_> = self.reported.iter().chain(&self.held).chain(new).collect();
        let places = held.map(|index| (all[index].task, all[index].start));
        let mut wanted: Vec<_> = places.collect();
        wanted.sort_unstable();
        all.sort_by_key(|one| (one.start, Reverse(one.end), Reverse(one.task)));
        let mut inside = vec![(0, 0); all.len()];
        let mut open: Vec<usize> = Vec::new();
        for (index, one) in all.iter().enumerate() {
            while open.pop_if(|outer| all[*outer].end <= one.start).is_some() {}
            if let Some(&outer) = open.last() {
                inside[outer].0 += one.end - one.start + self.entry_and_exit;
                inside[outer].1 += 1;
            }
            open.push(index);
        }
        let settled = all.iter().zip(inside);
        let settled = settled.filter(|(one, _)| {
            let place = (one.task, one.start);
            wanted.binary_search(&place).is_ok()
        });
        settled
            .map(|(&&one, (nested, preemptions))| Activation {
                execution: self
                    .is_certain(&one)
                    .then(|| (one.end - one.start).saturating_sub(nested)),
                preemptions,
                ..one
            })
            .collect()
    }

    /// Whether every activation inside has been read.
    fn is_certain(&self, one: &Activation) -> bool {
        let may_hide = |gap: &Gap| gap.task < one.task && gap.from < one.end && one.start < gap.to;
        one.start >= self.horizon && !self.gaps.iter().any(may_hide)
    }
}

/// A record on the clock that does not wrap: less than one wrap before `now`.
fn placed(task: usize, record: &Record, now: u64) -> Activation {
    let start = now - u64::from((now as u32).wrapping_sub(record.start));
    Activation {
        task,
        start,
        end: start + u64::from(record.duration),
        latency: record.latency,
        execution: None,
        preemptions: 0,
    }
}

#[cfg(test)]
mod tests;
