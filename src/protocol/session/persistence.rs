//! What a line changes in what outlives power.
//!
//! A change is made in a copy of what is stored, handed to the platform, and takes effect when it has
//! been stored; after a failure everything is as before. Of the tool table, which is large, there is no
//! copy: a tool is replaced at once, and the table is cleared when that has been stored. All of it at
//! standstill only: the flash stalls the processor. Read with Grbl 1.1 `settings.c`.
//!
//! An erase stalls it for long. It is done at Idle only, with spindle and laser off; until then a change that
//! needs it is in effect and waits. All that is stored is in RAM as well, so any number of changes can wait.

use core::num::NonZeroU8;

use super::{AfterCommands, LineStage, Ports, Progress, Session, Source, dispatch::answer};
use crate::{
    gcode::LineError,
    machine::Snapshot,
    model::{Spindle, State},
    protocol::{
        dialect::SenderDialect,
        report::{self, Feedback},
    },
    settings::{Change, Changes, Erasing, Settings, StoreError, Stored, StoredLine, ToolEntry},
};

/// Whether the memory of the settings has to be erased, as flash has and an EEPROM has not.
const NEEDS_ERASE: bool = !cfg!(feature = "eeprom");
/// `$13`.
const REPORT_INCHES: i64 = 13;

/// What follows when a change has been stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::protocol) enum AfterStore {
    /// The answer.
    Answer,
    /// The execution of the line that has been checked.
    Commit,
    /// The execution of the startup line that has been stored.
    Execute,
    /// The settings take effect; the answer.
    Configure,
    /// The offsets take effect; the answer.
    SetOrigins,
    /// Everything takes effect; a message, the answer and a reset.
    Restore,
}

/// What has become of the last change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum StoreState {
    /// Nothing: all is in effect.
    Idle,
    /// The platform is to store it.
    Requested(Change),
    /// The platform has stored it, or has failed to.
    Finished(Change, Result<(), StoreError>),
    /// It has waited, is in effect, and the platform is to store it.
    Postponed(Change),
    /// Stored, but a reset came before it took effect.
    Deferred,
}

/// What is stored, and the change in progress.
#[derive(Debug)]
pub(super) struct Persistence {
    /// What is stored, or is to be.
    pub(super) stored: Stored,
    /// What was stored before the change in progress.
    previous: Stored,
    /// The tool that was in the slot before the change in progress.
    previous_tool: Option<ToolEntry>,
    state: StoreState,
    /// What is in effect, and is to be stored when an erase is allowed.
    waiting: Changes,
    /// What is damaged where it is stored, until it is stored anew.
    pub(super) damaged: Changes,
    /// Something has begun to wait, or could not be stored, and the sender is to know it.
    feedback: Option<Feedback>,
}

impl Persistence {
    pub(super) fn new(stored: &Stored) -> Self {
        Self {
            stored: stored.clone(),
            previous: Stored::default(),
            previous_tool: None,
            state: StoreState::Idle,
            waiting: Changes::default(),
            damaged: Changes::default(),
            feedback: None,
        }
    }

    /// Returns what is in effect, and not stored yet.
    pub(super) const fn waiting(&self) -> Changes {
        self.waiting
    }

    /// Returns whether [`Session::store_postponed`] may have something to do.
    pub(super) const fn has_postponed(&self) -> bool {
        NEEDS_ERASE && (self.feedback.is_some() || !self.waiting.is_empty())
    }

    /// Returns the change that the platform is to store.
    pub(super) fn requested(&self) -> Option<Change> {
        match self.state {
            StoreState::Requested(change) | StoreState::Postponed(change) => Some(change),
            StoreState::Idle | StoreState::Finished(..) | StoreState::Deferred => None,
        }
    }

    /// Ends the requested change.
    #[inline(never)]
    pub(super) fn finish(&mut self, mut result: Result<(), StoreError>) {
        if let StoreState::Postponed(change) = self.state {
            self.finish_postponed(change, result);
        } else if let Some(change) = self.requested() {
            if NEEDS_ERASE && result == Err(StoreError::MustWait) {
                if self.waiting.is_empty() {
                    self.feedback = Some(Feedback::StoredLater);
                }
                self.waiting.insert(change);
                result = Ok(());
            }
            if result.is_ok() {
                self.damaged.mend(change);
            }
            self.state = StoreState::Finished(change, result);
        }
    }

    /// Ends a change that has waited; where it cannot be stored, it stays in effect until power is off.
    fn finish_postponed(&mut self, change: Change, result: Result<(), StoreError>) {
        self.state = StoreState::Idle;
        if result != Err(StoreError::MustWait) {
            self.waiting.remove(change);
        }
        if !matches!(result, Ok(()) | Err(StoreError::MustWait)) {
            self.feedback = Some(Feedback::NotStored);
        }
    }

    /// Has what is stored take effect again once the machine stands still, after a reset.
    pub(super) fn restore(&mut self) {
        if self.state == StoreState::Idle {
            self.state = StoreState::Deferred;
        }
    }

    /// Leaves what has been stored to take effect after a reset.
    pub(super) fn defer(&mut self) {
        self.state = StoreState::Deferred;
    }
}

impl Session {
    /// Stores a change at standstill, and then continues.
    pub(super) fn store(
        &mut self,
        machine: &Snapshot,
        change: Change,
        then: AfterStore,
        make: impl FnOnce(&mut Stored),
    ) -> Progress {
        if !self.path.is_done(machine) {
            return self.await_standstill();
        }
        let persistence = &mut self.persistence;
        persistence.previous.clone_from(&persistence.stored);
        make(&mut persistence.stored);
        let has_changed = persistence.previous != persistence.stored;
        // An unchanged record needs no room in the flash; a restoration is always written.
        if has_changed || then == AfterStore::Restore || persistence.damaged.contains(change) {
            persistence.state = StoreState::Requested(change);
        }
        self.stage = LineStage::Storing(then);
        Progress::Again
    }

    /// Stores a startup line that has been checked, and then executes it.
    pub(super) fn store_startup(
        &mut self,
        machine: &Snapshot,
        number: usize,
        start: usize,
    ) -> Progress {
        let text = self.line.input.text().unwrap_or_default();
        let Ok(line) = StoredLine::from_slice(text.get(start..).unwrap_or_default()) else {
            return self.refuse(LineError::StoredLineTooLong);
        };
        let change = Change::Startup(number);
        self.store(machine, change, AfterStore::Execute, |stored| {
            if let Some(stored) = stored.startup.get_mut(number) {
                *stored = line;
            }
        })
    }

    /// Stores the text of `$I=`.
    pub(super) fn store_build_info(
        &mut self,
        machine: &Snapshot,
        text: Option<StoredLine>,
    ) -> Progress {
        let Some(text) = text else {
            return self.refuse(LineError::StoredLineTooLong);
        };
        self.store(machine, Change::BuildInfo, AfterStore::Answer, |stored| {
            stored.build_info = text;
        })
    }

    /// Stores settings of which the one with this number has been assigned.
    pub(super) fn store_setting(
        &mut self,
        machine: &Snapshot,
        number: i64,
        settings: Settings,
    ) -> Progress {
        if number == REPORT_INCHES {
            // The next report shows the offset in the new unit.
            self.reports.cadence.offset_changed();
        }
        self.store(machine, Change::Settings, AfterStore::Configure, |stored| {
            stored.settings = settings;
        })
    }

    /// Stores the offset or the position that the line sets, and then executes the line.
    #[inline(never)]
    pub(super) fn store_new_origins(&mut self, machine: &Snapshot) -> Progress {
        match self.interpreter.origins_after(&self.line.checked) {
            Some(origins) => self.store(machine, Change::Origins, AfterStore::Commit, |stored| {
                stored.origins = origins;
            }),
            None => self.accept(),
        }
    }

    /// Stores the offset that the line wants set at the contact of its probing move, and then ends the line.
    #[inline(never)]
    pub(super) fn store_contact(&mut self, machine: &Snapshot) -> Progress {
        let contact = self.settings().position_of(machine.probed.steps);
        let checked = &self.line.checked;
        match self.interpreter.origins_after_contact(checked, &contact) {
            Some(origins) => {
                self.store(machine, Change::Origins, AfterStore::SetOrigins, |stored| {
                    stored.origins = origins;
                })
            }
            None => self.accept(),
        }
    }

    /// Stores the tool that the line sets, and then executes the line.
    #[inline(never)]
    pub(super) fn store_new_tool(&mut self, machine: &Snapshot) -> Progress {
        match self.line.checked.new_tool() {
            Some((slot, entry)) => self.store_tool(machine, slot, Some(entry), AfterStore::Commit),
            None => self.accept(),
        }
    }

    /// Stores the tool of a slot of the tool table, or that there is none, and then continues.
    fn store_tool(
        &mut self,
        machine: &Snapshot,
        slot: usize,
        entry: Option<ToolEntry>,
        then: AfterStore,
    ) -> Progress {
        if !self.path.is_done(machine) {
            return self.await_standstill();
        }
        let previous = self.interpreter.tools_mut().replace(slot, entry);
        if previous != entry || self.persistence.damaged.contains(Change::Tool(slot)) {
            self.persistence.previous_tool = previous;
            self.persistence.state = StoreState::Requested(Change::Tool(slot));
        }
        self.stage = LineStage::Storing(then);
        Progress::Again
    }

    /// Executes `$TTn=` with this number of bytes behind the `=`; without any, the tool is removed.
    #[inline(never)]
    pub(super) fn set_tool(
        &mut self,
        machine: &Snapshot,
        number: NonZeroU8,
        length: usize,
    ) -> Progress {
        let text = self.line.input.text().unwrap_or_default();
        let words = text.get(text.len() - length..).unwrap_or_default();
        let tools = self.interpreter.tools();
        if words.is_empty() {
            return match tools.slot_with(number) {
                Some(slot) => self.store_tool(machine, slot, None, AfterStore::Answer),
                None => self.accept(),
            };
        }
        let settings = &self.persistence.stored.settings;
        match self.interpreter.read_tool(number, words, settings) {
            Ok((slot, entry)) => self.store_tool(machine, slot, Some(entry), AfterStore::Answer),
            Err(error) => self.refuse(error),
        }
    }

    /// Restores defaults, `$RST=`.
    pub(super) fn restore(&mut self, machine: &Snapshot, change: Change) -> Progress {
        self.store(machine, change, AfterStore::Restore, |stored| {
            let new = Stored::new(stored.settings.step_rate);
            match change {
                Change::RestoreSettings => stored.settings = new.settings,
                Change::RestoreOrigins => stored.origins = new.origins,
                Change::RestoreAll => *stored = new,
                Change::Settings
                | Change::Origins
                | Change::Startup(_)
                | Change::BuildInfo
                | Change::Tool(_) => {}
            }
        })
    }

    /// Returns whether flash may be erased now: at Idle only, with spindle and laser off. A spindle that is on at
    /// speed 0 may turn all the same, by a relay.
    #[inline(never)]
    #[must_use]
    pub fn erasing(&self, machine: &Snapshot) -> Erasing {
        let is_idle = machine.state == State::Idle && self.path.is_done(machine);
        let is_on = !self.settings().laser && self.interpreter.modal().spindle != Spindle::Off;
        if is_idle && !is_on && machine.spindle == Spindle::Off {
            Erasing::Allowed
        } else {
            Erasing::Postponed
        }
    }

    /// Stores a change that has waited, if it may be stored now, and tells the sender what has to be told.
    #[inline(never)]
    pub(super) fn store_postponed(&mut self, machine: &Snapshot) {
        if let Some(feedback) = self.persistence.feedback.take() {
            report::feedback(&mut self.reports.message, feedback);
        }
        if self.persistence.state == StoreState::Idle
            && self.erasing(machine) == Erasing::Allowed
            && let Some(change) = self.persistence.waiting.first()
        {
            self.persistence.state = StoreState::Postponed(change);
        }
    }

    /// Clears the tool table where that has been stored, and reverts a change that could not be stored.
    pub(super) fn end_store(&mut self) {
        let StoreState::Finished(change, result) = self.persistence.state else {
            return;
        };
        let persistence = &mut self.persistence;
        persistence.state = StoreState::Idle;
        if result.is_ok() {
            if change.clears_tools() {
                self.interpreter.tools_mut().clear();
            }
        } else {
            if let Change::Tool(slot) = change {
                let tools = self.interpreter.tools_mut();
                tools.replace(slot, persistence.previous_tool);
            } else {
                persistence.stored.clone_from(&persistence.previous);
            }
            if matches!(self.stage, LineStage::Storing(_)) {
                self.refuse(LineError::StorageWrite);
            }
        }
    }

    /// Continues after a change has been stored.
    pub(super) fn continue_stored(
        &mut self,
        then: AfterStore,
        ports: &mut Ports<'_, '_>,
    ) -> Progress {
        match then {
            AfterStore::Answer => self.accept(),
            AfterStore::Commit => self.commit(ports),
            AfterStore::Execute => {
                if let Source::NewStartup { is_stored, .. } = &mut self.line.source {
                    *is_stored = true;
                }
                self.interpret(ports)
            }
            AfterStore::Configure => {
                self.configure(ports);
                self.stage = LineStage::Completing(AfterCommands::Answer);
                Progress::Again
            }
            AfterStore::SetOrigins => {
                self.interpreter
                    .set_origins(&self.persistence.stored.origins);
                self.reports.cadence.offset_changed();
                self.accept()
            }
            AfterStore::Restore => {
                self.configure(ports);
                self.interpreter
                    .set_origins(&self.persistence.stored.origins);
                report::feedback(&mut self.reports.message, Feedback::RestoringDefaults);
                self.answer_and_reset()
            }
        }
    }

    /// Puts into effect what was stored when a reset came, once the machine stands still.
    pub(super) fn apply_stored(&mut self, ports: &mut Ports<'_, '_>) {
        if self.persistence.state == StoreState::Deferred && self.path.is_done(ports.machine) {
            self.persistence.state = StoreState::Idle;
            self.configure(ports);
            self.interpreter
                .set_origins(&self.persistence.stored.origins);
        }
    }

    /// Sends new settings, which the machine adopts at standstill.
    pub(super) fn configure(&mut self, ports: &mut Ports<'_, '_>) {
        let stored = &self.persistence.stored.settings;
        let settings = self.host.settings_in_effect(stored);
        (self.path).configure(
            &settings,
            ports.machine,
            &mut self.interpreter,
            ports.entries,
        );
    }

    /// Answers `ok`, and resets.
    pub(super) fn answer_and_reset(&mut self) -> Progress {
        answer(&mut self.reports.message, Ok(()));
        self.stage = LineStage::Resetting;
        Progress::Again
    }
}
