//! What a line changes in what outlives power.
//!
//! A change is made in a copy of what is stored, handed to the shell, and takes effect when it has
//! been stored; if it could not be, everything is as it was. All of it at rest only: the flash
//! stalls the processor. Read with Grbl 1.1 `settings.c`.

use heapless::spsc::Producer;

use super::{After, LineStage, Progress, Session, Source, dispatch::answer};
use crate::{
    gcode::LineError,
    machine::Snapshot,
    path::{Entry, Work},
    protocol::report::{self, Feedback},
    settings::{Change, Settings, Stored, StoredLine},
};

/// What follows when a change has been stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Then {
    /// The answer.
    Answer,
    /// The line that has been checked is carried out.
    Commit,
    /// So is the startup line that has been stored.
    Execute,
    /// The settings take effect, and the line is answered.
    Configure,
    /// Everything takes effect; a message, the answer and a reset.
    Restore,
}

impl Session {
    /// Stores a change at rest, and then goes on.
    pub(super) fn store(
        &mut self,
        machine: &Snapshot,
        change: Change,
        then: Then,
        make: impl FnOnce(&mut Stored),
    ) -> Progress {
        if !self.is_done(machine) {
            return self.rest();
        }
        self.before.clone_from(&self.stored);
        make(&mut self.stored);
        // The same again needs no room in the flash; a restoration is always done.
        if self.before == self.stored && then != Then::Restore {
            self.store_result = None;
        } else {
            self.change = Some(change);
        }
        self.stage = LineStage::Storing(then);
        Progress::Again
    }

    /// Stores a startup line that has been found right, and then executes it.
    pub(super) fn store_startup(
        &mut self,
        machine: &Snapshot,
        number: usize,
        start: usize,
    ) -> Progress {
        let text = self.line.text().unwrap_or_default();
        match StoredLine::from_slice(text.get(start..).unwrap_or_default()) {
            Ok(line) => self.store(machine, Change::Startup(number), Then::Execute, |stored| {
                if let Some(place) = stored.startup.get_mut(number) {
                    *place = line;
                }
            }),
            Err(_) => self.refuse(LineError::StoredLineTooLong),
        }
    }

    /// `$RST=`.
    pub(super) fn restore(&mut self, machine: &Snapshot, change: Change) -> Progress {
        self.store(machine, change, Then::Restore, |stored| {
            let new = Stored::new(stored.settings.step_rate);
            match change {
                Change::RestoreSettings => stored.settings = new.settings,
                Change::RestoreOrigins => stored.origins = new.origins,
                Change::RestoreAll => *stored = new,
                Change::Settings | Change::Origins | Change::Startup(_) | Change::BuildInfo => {}
            }
        })
    }

    /// Takes back a change that could not be stored.
    pub(super) fn take_store_result(&mut self) {
        if let Some(Err(_)) = self.store_result.take() {
            self.stored.clone_from(&self.before);
            if matches!(self.stage, LineStage::Storing(_)) {
                self.refuse(LineError::StorageWrite);
            }
        }
    }

    /// Goes on after a change has been stored.
    pub(super) fn go_on_stored(
        &mut self,
        machine: &Snapshot,
        then: Then,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        match then {
            Then::Answer => self.accept(),
            Then::Commit => self.commit(machine, entries),
            Then::Execute => {
                if let Source::NewStartup { is_stored, .. } = &mut self.source {
                    *is_stored = true;
                }
                self.interpret(machine, entries)
            }
            Then::Configure => {
                self.configure(machine, entries);
                self.stage = LineStage::Completing(After::Answer);
                Progress::Again
            }
            Then::Restore => {
                self.configure(machine, entries);
                self.interpreter.set_origins(&self.stored.origins);
                report::feedback(&mut self.message, Feedback::RestoringDefaults);
                answer(&mut self.message, Ok(()));
                self.stage = LineStage::Resetting;
                Progress::Again
            }
        }
    }

    /// Lets take effect what was stored when a reset came, once the machine is at rest.
    pub(super) fn take_stored(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) {
        if self.is_stored_due && self.is_done(machine) {
            self.is_stored_due = false;
            self.configure(machine, entries);
            self.interpreter.set_origins(&self.stored.origins);
        }
    }

    /// New settings: the machine takes them at standstill.
    fn configure(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) {
        let settings: Settings = self.stored.settings;
        // The steps stay where they are; with another resolution they are another position.
        let position = self.router.configure(&settings, machine.steps);
        if settings.steps_per_mm != self.before.settings.steps_per_mm {
            self.interpreter.set_position(position);
        }
        self.send_entry(Work::Configure(settings), entries);
    }
}
