//! What becomes of a line: refused, told, or done.
//!
//! A line has no effect before everything it needs is there; then it goes to the machine as
//! entries, and is answered. Read with Grbl 1.1 `protocol.c` and `motion_control.c`.

use heapless::spsc::Producer;

use super::{List, Progress, Session, Stage, is_held};
use crate::{
    gcode::LineError,
    interpreter::Message,
    machine::{Snapshot, State},
    planner::{BLOCKS, Command, Entry, Work},
    protocol::{
        dollar::{Condition, Dollar},
        report::{self, Feedback},
        text::{ReportUnit, Text},
    },
    settings::{self, Settings},
};

impl Session {
    /// Judges the line: an error, a list, or something to do.
    pub(super) fn judge(
        &mut self,
        machine: &Snapshot,
        received_bytes: usize,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        match self.line.text() {
            Err(_) => self.refuse(LineError::LineOverflow),
            Ok([]) => self.accept(),
            Ok([b'$', statement @ ..]) => {
                match Dollar::read(statement, self.condition(machine), &self.settings) {
                    Err(error) => self.refuse(error),
                    Ok(Dollar::Assign(assignment)) => {
                        let mut changed = self.settings;
                        match settings::assign(&mut changed, assignment) {
                            Err(error) => self.refuse(error.into()),
                            Ok(()) => self.configure(machine, changed, entries),
                        }
                    }
                    Ok(Dollar::Unlock) => self.unlock(machine, entries),
                    Ok(Dollar::Settings) => self.list(List::Settings, 0),
                    Ok(Dollar::Parameters) => self.list(List::Parameters, 0),
                    Ok(Dollar::Help) => self.tell(report::help),
                    Ok(Dollar::StartupLines) => self.tell(report::startup_lines),
                    Ok(Dollar::Modes) => {
                        let modal = *self.interpreter.modal();
                        let unit = ReportUnit::of(&self.settings);
                        self.tell(|text| report::modes(text, &modal, unit))
                    }
                    Ok(Dollar::BuildInfo) => {
                        self.tell(|text| report::build_info(text, BLOCKS, received_bytes))
                    }
                }
            }
            Ok(_) if machine.state == State::Alarm => self.refuse(LineError::Locked),
            Ok(_) => self.interpret(machine, entries),
        }
    }

    /// What `$` statements may ask of the machine now.
    fn condition(&self, machine: &Snapshot) -> Condition {
        match machine.state {
            State::Alarm => Condition::Alarm,
            State::Idle if machine.finished == self.entered => Condition::Idle,
            State::Idle
            | State::Run
            | State::HoldSlowing
            | State::HoldComplete
            | State::Jog
            | State::Home
            | State::Check
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRetracting
            | State::DoorRestoring
            | State::Sleep => Condition::Busy,
        }
    }

    /// A line of G-code.
    fn interpret(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) -> Progress {
        if !self.is_position_known {
            return self.rest();
        }
        let Ok(line) = self.line.text() else {
            return self.refuse(LineError::LineOverflow);
        };
        let checked = &mut self.checked;
        if let Err(error) = self.interpreter.check_into(line, &self.settings, checked) {
            return self.refuse(error);
        }
        if self.checked.waits_for_rest() && !self.is_done(machine) {
            return self.rest();
        }
        let offset = self.interpreter.work_offset();
        let coordinates = self.interpreter.modal().coordinates;
        self.interpreter
            .commit_into(&self.checked, &mut self.outcome);
        self.answers_when_done = self.checked.answers_when_done();
        if offset != self.interpreter.work_offset()
            || coordinates != self.interpreter.modal().coordinates
            || self.outcome.message == Some(Message::ProgramEnd)
        {
            self.cadence.offset_changed();
        }
        self.stage = Stage::Entering(0);
        self.enter(machine, 0, entries)
    }

    /// Sends the commands of a line from the given one on to the machine.
    pub(super) fn enter(
        &mut self,
        machine: &Snapshot,
        first: usize,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        let mut next = first;
        // wcet-bound: 8
        while let Some(command) = self.outcome.commands.get(next) {
            if !entries.ready() {
                self.stage = Stage::Entering(next);
                return Progress::Waiting;
            }
            if matches!(command, Command::Spindle { .. } | Command::Coolant(_)) {
                self.cadence.overrides_changed();
            }
            if let Some(work) = self.router.work(command) {
                self.send_entry(work, entries);
            }
            next += 1;
        }
        if self.answers_when_done {
            let feedback = self.outcome.message.map(|message| match message {
                Message::ProgramEnd => Feedback::ProgramEnd,
            });
            self.stage = Stage::Completing(feedback);
            self.complete(machine, feedback)
        } else {
            self.accept()
        }
    }

    /// Answers a line that everything has been done for, with a message before it.
    pub(super) fn complete(&mut self, machine: &Snapshot, feedback: Option<Feedback>) -> Progress {
        if !self.is_done(machine) || is_held(machine) {
            return Progress::Waiting;
        }
        if let Some(feedback) = feedback {
            report::feedback(&mut self.message, feedback);
        }
        self.accept()
    }

    /// New settings: the machine takes them at standstill.
    fn configure(
        &mut self,
        machine: &Snapshot,
        changed: Settings,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if !self.is_done(machine) {
            return self.rest();
        }
        // The steps stay where they are; with another resolution they are another position.
        let position = self.router.configure(&changed, machine.steps);
        if changed.steps_per_mm != self.settings.steps_per_mm {
            self.interpreter.set_position(position);
        }
        self.settings = changed;
        self.send_entry(Work::Configure(changed), entries);
        self.stage = Stage::Completing(None);
        Progress::Again
    }

    /// Takes the lock of an alarm off, once the machine has come to rest.
    fn unlock(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) -> Progress {
        if machine.state != State::Alarm {
            return self.accept();
        }
        if !self.is_done(machine) {
            return self.rest();
        }
        self.send_entry(Work::Unlock, entries);
        self.stage = Stage::Completing(Some(Feedback::Unlocked));
        Progress::Again
    }

    /// Writes the next line of a list, and the answer after the last.
    pub(super) fn list(&mut self, list: List, line: usize) -> Progress {
        let unit = ReportUnit::of(&self.settings);
        let offsets = self.interpreter.offsets();
        let has_line = match list {
            List::Settings => report::setting(&mut self.message, &self.settings, line),
            List::Parameters => report::parameters(&mut self.message, offsets, line, unit),
        };
        if has_line {
            self.stage = Stage::Listing(list, line + 1);
            Progress::Again
        } else {
            self.accept()
        }
    }

    /// Leaves the line for when everything before it has been done. What it is judged by is then
    /// never out of date.
    fn rest(&mut self) -> Progress {
        self.stage = Stage::Resting;
        Progress::Waiting
    }

    /// Answers with a text and `ok`.
    fn tell(&mut self, write: impl FnOnce(&mut Text)) -> Progress {
        write(&mut self.message);
        self.accept()
    }

    fn accept(&mut self) -> Progress {
        report::ok(&mut self.message);
        self.begin_line()
    }

    fn refuse(&mut self, error: LineError) -> Progress {
        report::error(&mut self.message, error);
        self.begin_line()
    }

    fn begin_line(&mut self) -> Progress {
        self.line.clear();
        self.stage = Stage::Reading;
        Progress::Again
    }

    /// The caller has made sure of room; after standstill the queue is empty.
    fn send_entry(&mut self, work: Work, entries: &mut Producer<'_, Entry>) {
        let epoch = self.epoch.wrapping_add(self.cuts);
        if entries.enqueue(Entry { epoch, work }).is_ok() {
            self.entered = self.entered.wrapping_add(1);
        }
    }
}
