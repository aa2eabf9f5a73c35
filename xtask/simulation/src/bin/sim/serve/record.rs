//! What is kept of a machine that is served: its steps, its answers and its flash.

use std::path::Path;

use anyhow::{Error, Result};
use leadscrew::sim::{Edge, Flash, Simulator, StepStatistics};
use simulation::{
    figures::Figures,
    play::{Recorder, Replies},
};

use crate::power_up;

/// What is kept.
pub(super) struct Record<'a, R> {
    /// The file with what the machine stores, and how many changes of it are there.
    flash: Option<(&'a Path, u64)>,
    conversation: Replies,
    statistics: StepStatistics,
    recorder: &'a mut R,
    failure: Option<Error>,
}

impl<'a, R: Recorder> Record<'a, R> {
    /// Of a machine with this flash, which is kept in a file.
    pub(super) fn new(flash: &Flash, file: Option<&'a Path>, recorder: &'a mut R) -> Self {
        Self {
            flash: file.map(|path| (path, flash.operations())),
            conversation: Replies::default(),
            statistics: StepStatistics::new(),
            recorder,
            failure: None,
        }
    }

    /// The pins change.
    pub(super) fn edge(&mut self, edge: &Edge) {
        self.statistics.add(edge);
        if let Err(error) = self.recorder.edge(edge, &self.statistics) {
            self.failure.get_or_insert(error);
        }
    }

    /// Writes the flash where it has changed.
    ///
    /// # Errors
    /// It cannot be written, or a change of the pins could not.
    pub(super) fn keep(&mut self, flash: &Flash) -> Result<()> {
        if let Some(error) = self.failure.take() {
            return Err(error);
        }
        if let Some((path, stored)) = &mut self.flash
            && *stored != flash.operations()
        {
            *stored = flash.operations();
            power_up::save(path, flash)?;
        }
        Ok(())
    }

    /// The machine says something.
    pub(super) fn hear(&mut self, byte: u8) {
        self.conversation.push(byte);
    }

    /// Returns what was done.
    pub(super) fn finish(self, simulator: &Simulator) -> Figures {
        self.conversation.finish(simulator, &self.statistics)
    }
}
