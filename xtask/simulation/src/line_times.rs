//! When the lines of a job are answered and carried out, as the virtual machine has it.

use serde::{Deserialize, Serialize};

/// The times of the lines of a job, s from its first line.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LineTimes {
    /// When each line is answered.
    pub(crate) answered_s: Vec<f64>,
    /// When so many lines have been answered, 0 and up: the first one, counted from 0, that may not be carried out yet.
    pub(crate) undone: Vec<u32>,
    /// When lines begin to move the machine, and the lines, counted from 0.
    pub(crate) begun: Vec<(f64, usize)>,
    /// How long the job takes, without pauses of the operator.
    pub total_s: f64,
    /// The first line that probes, counted from 0. Its contact is unknown, so that all times are estimates: of probing
    /// moves without contact.
    pub probing: Option<usize>,
}

impl LineTimes {
    /// When a line begins to move the machine, counted from 0, or the first one after it that does, s.
    pub fn begin_s(&self, line: usize) -> f64 {
        let first = self.begun.partition_point(|(_, begun)| *begun < line);
        let first = self.begun.get(first);
        first.map_or(self.total_s, |(begin_s, _)| *begin_s)
    }

    /// The time of the virtual machine when so many lines have been answered, and so long ago, s.
    pub(crate) fn time_s(&self, answered: usize, since_s: f64) -> f64 {
        let at = |lines: usize| match lines.checked_sub(1) {
            None => 0.0,
            Some(index) => self.answered_s.get(index).copied().unwrap_or(self.total_s),
        };
        // The next answer is late where an override or a hold makes it so.
        (at(answered) + since_s).min(at(answered + 1))
    }

    /// The line that the virtual machine carries out at a time, s, counted from 0.
    pub(crate) fn line_at(&self, time_s: f64) -> usize {
        let begun = self
            .begun
            .partition_point(|(begin_s, _)| *begin_s <= time_s);
        self.begun[..begun].last().map_or(0, |(_, line)| *line)
    }

    /// The first line, counted from 0, that a machine may not have carried out when it had answered so many.
    pub fn first_undone(&self, answered: usize) -> usize {
        let last = self.undone.len().saturating_sub(1);
        let undone = self.undone.get(answered.min(last)).copied();
        undone.unwrap_or_default() as usize
    }

    /// The same with times of a tenth of a millisecond, which are short as text.
    #[must_use]
    pub fn rounded(mut self) -> Self {
        let begun = self.begun.iter_mut().map(|(begin_s, _)| begin_s);
        for time_s in self.answered_s.iter_mut().chain(begun) {
            *time_s = (*time_s * 1e4).round() / 1e4;
        }
        self
    }
}
