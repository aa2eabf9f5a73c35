//! What becomes of a line: refused, told, or done.
//!
//! A line has no effect before everything it needs is there; then it goes to the machine as
//! entries, and is answered. Read with Grbl 1.1 `protocol.c` and `system.c`.

use heapless::spsc::Producer;

use super::{LineStage, Progress, Session, Source, Then};
use crate::{
    gcode::LineError,
    machine::Snapshot,
    model::{Levels, State},
    motion::BLOCKS,
    path::Entry,
    protocol::{
        dollar::{Condition, Described, Dollar},
        listing, report,
        text::{ReportUnit, Text},
    },
    settings::{self, Change, Settings, StoredLine},
};

/// `$13`.
const REPORT_INCHES: i64 = 13;

/// An answer of many lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum List {
    /// `$$`.
    Settings,
    /// `$$` before the first welcome.
    FirstSettings,
    /// `$+`.
    AllSettings,
    /// `$#`.
    Parameters,
    /// `$I`.
    BuildInfo,
    /// `$N`.
    StartupLines,
    /// `$E…`.
    Described(Described),
}

/// Writes the answer to a line.
pub(super) fn answer(text: &mut Text, result: Result<(), LineError>) {
    match result {
        Ok(()) => report::ok(text),
        Err(error) => report::error(text, error),
    }
}

impl Session {
    /// Judges the line: an error, a list, or something to do.
    pub(super) fn judge(
        &mut self,
        machine: &Snapshot,
        received_bytes: usize,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if self.source != Source::Line {
            // It was judged before, and has waited.
            return self.interpret(machine, entries);
        }
        match self.line.text() {
            Err(_) => self.refuse(LineError::LineOverflow),
            Ok([]) => self.accept(),
            Ok([b'$', ..]) => self.obey(machine, received_bytes, entries),
            Ok(_) if machine.state == State::Alarm => self.refuse(LineError::Locked),
            Ok(_) if self.condition(machine) == Condition::Jog => self.refuse(LineError::Locked),
            Ok(_) => self.interpret(machine, entries),
        }
    }

    /// A `$` statement.
    fn obey(
        &mut self,
        machine: &Snapshot,
        received_bytes: usize,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        let statement = self
            .line
            .text()
            .unwrap_or_default()
            .get(1..)
            .unwrap_or_default();
        let is_door_open = machine.inputs.has(Levels::DOOR);
        let condition = self.condition(machine);
        let read = Dollar::read(statement, condition, &self.stored.settings, is_door_open);
        match read {
            Err(error) => self.refuse(error),
            Ok(Dollar::Help) => self.tell(listing::help),
            Ok(Dollar::Modes) => {
                let modal = *self.interpreter.modal();
                let unit = ReportUnit::of(&self.stored.settings);
                self.tell(|text| listing::modes(text, &modal, unit))
            }
            Ok(Dollar::Settings) => self.list(List::Settings, 0, received_bytes),
            Ok(Dollar::AllSettings) => self.list(List::AllSettings, 0, received_bytes),
            Ok(Dollar::Parameters) => self.list(List::Parameters, 0, received_bytes),
            Ok(Dollar::BuildInfo) => self.list(List::BuildInfo, 0, received_bytes),
            Ok(Dollar::StartupLines) => self.list(List::StartupLines, 0, received_bytes),
            Ok(Dollar::Describe(what)) => self.list(List::Described(what), 0, received_bytes),
            Ok(Dollar::Unlock) => self.unlock(machine, entries),
            Ok(Dollar::Check) => self.begin_check(entries),
            Ok(Dollar::EndCheck) => self.end_check(),
            Ok(Dollar::Home(mask)) => self.home(machine, mask, entries),
            Ok(Dollar::Sleep) => self.sleep(machine, entries),
            Ok(Dollar::Jog(_)) => {
                self.source = Source::Jog;
                self.interpret(machine, entries)
            }
            Ok(Dollar::StoreStartup(number, line)) if line.len() <= settings::STORED_LINE => {
                let start = self.line.text().map_or(0, <[u8]>::len) - line.len();
                self.source = Source::NewStartup {
                    number,
                    start,
                    is_stored: false,
                };
                self.interpret(machine, entries)
            }
            Ok(Dollar::StoreStartup(..)) => self.refuse(LineError::StoredLineTooLong),
            Ok(Dollar::StoreBuildInfo(text)) => match StoredLine::from_slice(text) {
                Ok(text) => self.store(machine, Change::BuildInfo, Then::Answer, |stored| {
                    stored.build_info = text;
                }),
                Err(_) => self.refuse(LineError::StoredLineTooLong),
            },
            Ok(Dollar::Restore(change)) => self.restore(machine, change),
            Ok(Dollar::Assign(assignment)) => {
                let mut changed = self.stored.settings;
                let assigned = settings::assign(&mut changed, assignment);
                let number = settings::numbered(assignment).map_or(0, |(number, _)| number);
                match assigned {
                    Err(error) => self.refuse(error.into()),
                    Ok(()) => self.store_settings(machine, number, changed),
                }
            }
        }
    }

    /// Keeps settings of which the one with this number has been assigned.
    fn store_settings(&mut self, machine: &Snapshot, number: i64, changed: Settings) -> Progress {
        if number == REPORT_INCHES {
            // Whoever reads reports is told the offset in the new unit.
            self.cadence.offset_changed();
        }
        self.store(machine, Change::Settings, Then::Configure, |stored| {
            stored.settings = changed;
        })
    }

    /// What `$` statements may ask of the machine now.
    fn condition(&self, machine: &Snapshot) -> Condition {
        let is_done = machine.finished == self.entered && !self.path.has_pending();
        match machine.state {
            State::Alarm => Condition::Alarm,
            State::Check => Condition::Check,
            State::Jog => Condition::Jog,
            State::Idle if is_done => Condition::Idle,
            State::Idle | State::Run if self.is_jogging && !is_done => Condition::Jog,
            State::Idle
            | State::Run
            | State::HoldSlowing
            | State::HoldComplete
            | State::Home
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRetracting
            | State::DoorRestoring
            | State::Sleep => Condition::Run,
        }
    }

    /// Writes the next line of a list, and the answer after the last.
    pub(super) fn list(&mut self, list: List, line: usize, received_bytes: usize) -> Progress {
        let text = &mut self.message;
        let settings = &self.stored.settings;
        let has_line = match list {
            List::Settings | List::FirstSettings => listing::setting(text, settings, line),
            List::AllSettings => listing::any_setting(text, settings, line),
            List::Parameters => {
                let offsets = self.interpreter.offsets();
                listing::parameter(text, offsets, &self.probed, line, settings)
            }
            List::BuildInfo => {
                match line {
                    0 => listing::version(text, &self.stored.build_info),
                    1 => listing::options(text, BLOCKS, received_bytes),
                    2 => listing::step_rate(text, settings.step_rate),
                    _ => {}
                }
                line < 3
            }
            List::StartupLines => listing::startup_line(text, &self.stored.startup, line),
            List::Described(what) => listing::description(text, what, line),
        };
        if has_line {
            self.stage = LineStage::Listing(list, line + 1);
            Progress::Again
        } else if list == List::FirstSettings {
            self.stage = LineStage::Welcoming;
            Progress::Again
        } else {
            self.accept()
        }
    }

    /// Leaves the line for when everything before it has been done. What it is judged by is then
    /// never out of date.
    pub(super) fn rest(&mut self) -> Progress {
        self.stage = LineStage::Resting;
        // What is held back is sent on at once: the machine would stop before it otherwise.
        if self.path.has_pending() {
            Progress::Again
        } else {
            Progress::Waiting
        }
    }

    /// Answers with a text and `ok`.
    fn tell(&mut self, write: impl FnOnce(&mut Text)) -> Progress {
        write(&mut self.message);
        self.accept()
    }

    pub(super) fn accept(&mut self) -> Progress {
        self.end_line(Ok(()))
    }

    pub(super) fn refuse(&mut self, error: LineError) -> Progress {
        self.end_line(Err(error))
    }

    /// Answers the line, and goes on to the next.
    fn end_line(&mut self, result: Result<(), LineError>) -> Progress {
        let Source::Startup { number, is_homed } = self.source else {
            answer(&mut self.message, result);
            return self.begin_line();
        };
        if let Some(line) = self.stored.startup.get(number) {
            report::startup(&mut self.message, line);
        }
        answer(&mut self.message, result);
        self.source = Source::Startup { number, is_homed };
        self.stage = LineStage::StartingUp(number + 1);
        Progress::Again
    }

    pub(super) fn begin_line(&mut self) -> Progress {
        self.line.clear();
        self.source = Source::Line;
        self.stage = LineStage::Reading;
        Progress::Again
    }
}
