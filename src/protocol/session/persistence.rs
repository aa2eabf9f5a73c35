//! What a line changes in what outlives power.
//!
//! A change is made in a copy of what is stored, handed to the platform, and takes effect when it has
//! been stored; after a failure everything is as before. Of the tool table, which is large, there is no
//! copy: a tool is replaced at once, and the table is cleared when that has been stored. All of it at
//! standstill only: the flash stalls the processor. Read with Grbl 1.1 `settings.c`.
//!
//! An erase stalls it for long. The erase is done at Idle only, with spindle and laser off; until then a change that
//! needs the erase is in effect and waits. All that is stored is in RAM as well, so any number of changes can wait.

use core::num::NonZeroU8;

use super::{AfterCommands, LineStage, Ports, Progress, Session, Source, dispatch::answer};
use crate::{
    machine::Snapshot,
    model::{Spindle, State},
    protocol::{
        dialect::SenderDialect,
        report::{self, Feedback},
        text::Text,
    },
    settings::{
        Change, Changes, Erasing, Origins, Settings, StoreError, Stored, StoredLine, ToolEntry,
        ToolTable,
    },
};

/// Whether the memory of the settings has to be erased, as flash has and an EEPROM has not.
const NEEDS_ERASE: bool = !cfg!(feature = "eeprom");

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
    /// Stored values take effect at the next standstill: a reset came in between, or a dialect wants them back.
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
    pub(super) waiting: Changes,
    /// Changes whose records are damaged, until they are stored anew.
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

    /// Returns whether [`Self::store_postponed`] may have something to do.
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

    /// Ends a change that has waited; a change that cannot be stored stays in effect until power is off.
    fn finish_postponed(&mut self, change: Change, result: Result<(), StoreError>) {
        self.state = StoreState::Idle;
        if result != Err(StoreError::MustWait) {
            self.waiting.remove(change);
        }
        if !matches!(result, Ok(()) | Err(StoreError::MustWait)) {
            self.feedback = Some(Feedback::NotStored);
        }
    }

    /// Begins to store a record. Nothing has to be written where nothing changes: that needs no room in the flash.
    pub(super) fn begin(&mut self, record: &NewRecord<'_>, tools: &mut ToolTable) {
        let has_changed = if let NewRecord::Tool(slot, entry) = record {
            self.previous_tool = tools.replace(*slot, *entry);
            self.previous_tool != *entry
        } else {
            self.previous.clone_from(&self.stored);
            record.write(&mut self.stored);
            // A restoration is always written.
            self.previous != self.stored || matches!(record, NewRecord::Defaults(_))
        };
        let change = record.change();
        if has_changed || self.damaged.contains(change) {
            self.state = StoreState::Requested(change);
        }
    }

    /// Clears the tool table where that has been stored, and reverts a change that could not be stored. Returns whether
    /// there is one.
    pub(super) fn end(&mut self, tools: &mut ToolTable) -> bool {
        let StoreState::Finished(change, result) = self.state else {
            return false;
        };
        self.state = StoreState::Idle;
        match change {
            _ if result.is_ok() && change.clears_tools() => tools.clear(),
            _ if result.is_ok() => {}
            Change::Tool(slot) => {
                tools.replace(slot, self.previous_tool);
            }
            _ => self.stored.clone_from(&self.previous),
        }
        result.is_err()
    }

    /// Has a change stored that has waited, if flash may be erased, and tells the sender what has to be told.
    pub(super) fn store_postponed(&mut self, erasing: Erasing, text: &mut Text) {
        if let Some(feedback) = self.feedback.take() {
            report::feedback(text, feedback);
        }
        if self.state == StoreState::Idle
            && erasing == Erasing::Allowed
            && let Some(change) = self.waiting.first()
        {
            self.state = StoreState::Postponed(change);
        }
    }

    /// Has what is stored take effect again once the machine stands still, after a reset.
    pub(super) fn restore(&mut self) {
        if self.state == StoreState::Idle {
            self.defer();
        }
    }

    /// Leaves what has been stored to take effect after a reset.
    pub(super) fn defer(&mut self) {
        self.state = StoreState::Deferred;
    }
}

/// What is to be stored.
#[derive(Debug)]
pub(super) enum NewRecord<'a> {
    Settings(&'a Settings),
    Origins(&'a Origins),
    Startup(usize, StoredLine),
    BuildInfo(StoredLine),
    /// The tool in a slot of the tool table, or that there is none.
    Tool(usize, Option<ToolEntry>),
    /// What a change restores: `$RST=`.
    Defaults(Change),
}

impl NewRecord<'_> {
    fn change(&self) -> Change {
        match self {
            Self::Settings(_) => Change::Settings,
            Self::Origins(_) => Change::Origins,
            Self::Startup(number, _) => Change::Startup(*number),
            Self::BuildInfo(_) => Change::BuildInfo,
            Self::Tool(slot, _) => Change::Tool(*slot),
            Self::Defaults(change) => *change,
        }
    }

    /// Writes the record, unless it is one of the tool table.
    fn write(&self, stored: &mut Stored) {
        let new = Stored::new(stored.settings.step_rate);
        match self {
            Self::Settings(settings) => stored.settings = **settings,
            Self::Origins(origins) => stored.origins = **origins,
            Self::Startup(number, line) => {
                if let Some(stored) = stored.startup.get_mut(*number) {
                    stored.clone_from(line);
                }
            }
            Self::BuildInfo(text) => stored.build_info.clone_from(text),
            Self::Defaults(Change::RestoreSettings) => stored.settings = new.settings,
            Self::Defaults(Change::RestoreOrigins) => stored.origins = new.origins,
            Self::Defaults(Change::RestoreAll) => *stored = new,
            Self::Tool(..)
            | Self::Defaults(
                Change::Settings
                | Change::Origins
                | Change::Startup(_)
                | Change::BuildInfo
                | Change::Tool(_),
            ) => {}
        }
    }
}

impl Session {
    /// Stores a record at standstill, and then continues; without one, ends the line.
    pub(super) fn store(
        &mut self,
        machine: &Snapshot,
        record: Option<NewRecord<'_>>,
        then: AfterStore,
    ) -> Progress {
        let Some(record) = record else {
            return self.accept();
        };
        if !self.path.is_done(machine) {
            return self.await_standstill();
        }
        (self.persistence).begin(&record, self.line.interpreter.tools_mut());
        self.enter(LineStage::Storing(then))
    }

    /// Stores the offset or the position that the line sets, and then executes the line.
    pub(super) fn store_new_origins(&mut self, machine: &Snapshot) -> Progress {
        let origins = self.line.interpreter.origins_after(&self.line.checked);
        let record = origins.as_ref().map(NewRecord::Origins);
        self.store(machine, record, AfterStore::Commit)
    }

    /// Stores the offset that the line wants set at the contact of its probing move, and then ends the line.
    pub(super) fn store_contact(&mut self, machine: &Snapshot) -> Progress {
        let contact = self.settings().position_of(machine.probed.steps);
        let checked = &self.line.checked;
        let origins = self
            .line
            .interpreter
            .origins_after_contact(checked, &contact);
        let record = origins.as_ref().map(NewRecord::Origins);
        self.store(machine, record, AfterStore::SetOrigins)
    }

    /// Executes `$TTn=` with this number of bytes behind the `=`; without any, the tool is removed.
    pub(super) fn set_tool(
        &mut self,
        machine: &Snapshot,
        number: NonZeroU8,
        length: usize,
    ) -> Progress {
        let text = self.line.input.text().unwrap_or_default();
        let words = text.get(text.len() - length..).unwrap_or_default();
        let settings = &self.persistence.stored.settings;
        match self.line.interpreter.read_tool(number, words, settings) {
            Ok(tool) => {
                let record = tool.map(|(slot, entry)| NewRecord::Tool(slot, entry));
                self.store(machine, record, AfterStore::Answer)
            }
            Err(error) => self.refuse(error),
        }
    }

    /// Returns whether flash may be erased now: at Idle only, with spindle and laser off. A spindle that is on at
    /// speed 0 may turn all the same, by a relay.
    #[must_use]
    pub fn erasing(&self, machine: &Snapshot) -> Erasing {
        let is_idle = machine.state == State::Idle && self.path.is_done(machine);
        let is_on = !self.settings().laser && self.line.interpreter.modal().spindle != Spindle::Off;
        if is_idle && !is_on && machine.spindle == Spindle::Off {
            Erasing::Allowed
        } else {
            Erasing::Postponed
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
                self.enter(LineStage::Completing(AfterCommands::Answer))
            }
            AfterStore::SetOrigins => {
                (self.line.interpreter).set_origins(&self.persistence.stored.origins);
                self.reports.cadence.offset_changed();
                self.accept()
            }
            AfterStore::Restore => {
                self.configure(ports);
                (self.line.interpreter).set_origins(&self.persistence.stored.origins);
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
            (self.line.interpreter).set_origins(&self.persistence.stored.origins);
        }
    }

    /// Sends new settings, which the machine adopts at standstill.
    pub(super) fn configure(&mut self, ports: &mut Ports<'_, '_>) {
        let stored = &self.persistence.stored.settings;
        let settings = self.host.settings_in_effect(stored);
        (self.path).configure(&settings, ports.machine, &mut self.line, ports.entries);
    }

    /// Answers `ok`, and resets.
    pub(super) fn answer_and_reset(&mut self) -> Progress {
        answer(&mut self.reports.message, Ok(()));
        self.enter(LineStage::Resetting)
    }
}
