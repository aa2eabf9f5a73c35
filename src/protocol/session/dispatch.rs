//! Dispatch of a line by its kind: `$` statements, lists, G-code; and the answers.
//!
//! A line has no effect before everything it needs is there; then it goes to the machine as
//! entries, and is answered. Read with Grbl 1.1 `protocol.c` and `system.c`.

use super::{
    AfterCommands, LineStage, Ports, Progress, Session, Source,
    persistence::{AfterStore, NewRecord},
};
use crate::{
    axis::{AXES, LINEAR},
    gcode::LineError,
    machine::Snapshot,
    model::{Bootloader, Levels, State},
    path::Work,
    protocol::{
        dialect::SenderDialect,
        dollar::{Condition, Dollar, List},
        listing::{self, FaultCounts, ListContents},
        report::{self, Feedback},
        text::{ReportUnit, Text},
    },
    settings::{self, Settings, StoredLine},
};

/// The axes that are homed unless others are named, beside the axes that home by marks.
const LINEAR_AXES: u8 = (1 << LINEAR) - 1;

/// `$13`.
const REPORT_INCHES: i64 = 13;

/// Writes the answer to a line.
pub(super) fn answer(text: &mut Text, result: Result<(), LineError>) {
    match result {
        Ok(()) => report::ok(text),
        Err(error) => report::error(text, error),
    }
}

impl Session {
    /// Refuses the line, or begins to execute it.
    pub(super) fn dispatch(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        if self.line.source != Source::Line {
            // The line has been dispatched before, and has waited.
            return self.interpret(ports);
        }
        let condition = self.path.condition(ports.machine);
        match self.line.input.text() {
            Err(_) => self.refuse(LineError::LineOverflow),
            Ok([]) => {
                if self.waits_for_message(false) {
                    return self.await_standstill();
                }
                self.queue_message(false, ports.machine);
                self.accept()
            }
            Ok([b'$', ..]) if !self.is_refusing(ports.machine) => {
                self.execute_statement(condition, ports)
            }
            Ok([b'$', ..]) => self.refuse(LineError::Locked),
            Ok(_) if condition == Condition::Alarm && self.host.rules().executes_when_locked => {
                self.interpret(ports)
            }
            Ok(_) if matches!(condition, Condition::Alarm | Condition::Jog) => {
                self.refuse(LineError::Locked)
            }
            Ok(_) if self.path.sync.follows_refused && condition != Condition::Check => {
                self.hold_after_refusal(ports)
            }
            Ok(_) => self.interpret(ports),
        }
    }

    /// Dispatches a line again that needs standstill. Moves that are held back are sent; a move without
    /// a step is done at once.
    pub(super) fn dispatch_at_standstill(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        self.path.flush(ports.entries);
        if !self.path.is_done(ports.machine) {
            Progress::Waiting
        } else if self.line.source == Source::Line
            && let Some(step) = self.read_in_dialect(ports)
        {
            self.take_step(step, ports)
        } else {
            self.dispatch(ports)
        }
    }

    /// Executes a `$` statement.
    fn execute_statement(&mut self, condition: Condition, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        let text = self.line.input.text().unwrap_or_default();
        let mut settings = self.persistence.stored.settings;
        let is_door_open = machine.inputs.has(Levels::DOOR);
        let statement = text.get(1..).unwrap_or_default();
        let statement = Dollar::read(statement, condition, &settings, is_door_open);
        if let Ok(Dollar::Jog(_) | Dollar::Home(_) | Dollar::Unlock) = statement {
            // The operator has taken over from the program.
            self.path.sync.follows_refused = false;
        }
        match statement {
            Err(error) => self.refuse(error),
            Ok(Dollar::Help) => {
                listing::help(&mut self.reports.message);
                self.accept()
            }
            Ok(Dollar::Modes) => self.report_modes(),
            Ok(Dollar::List(list)) => self.list(list, 0, ports.received.capacity()),
            Ok(Dollar::Unlock) => self.unlock(ports),
            Ok(Dollar::Check) if self.tool_change.is_manual() => self.refuse(LineError::ToolChange),
            Ok(Dollar::Check) => self.begin_check(ports),
            Ok(Dollar::EndCheck) => self.end_check(),
            Ok(Dollar::Home(mask)) => self.home(mask, ports),
            Ok(Dollar::Sleep) => self.sleep(None, ports),
            Ok(Dollar::Boot(bootloader)) => self.boot(bootloader, ports),
            Ok(Dollar::Jog(_)) => {
                self.line.source = Source::Jog;
                self.interpret(ports)
            }
            Ok(Dollar::StoreStartup(number, line)) => {
                self.line.source = Source::NewStartup {
                    number,
                    start: text.len() - line.len(),
                    is_stored: false,
                };
                self.interpret(ports)
            }
            Ok(Dollar::StoreBuildInfo(text)) => {
                let text = StoredLine::from_slice(text).unwrap_or_default();
                self.store(
                    machine,
                    Some(NewRecord::BuildInfo(text)),
                    AfterStore::Answer,
                )
            }
            Ok(Dollar::SetTool(number, words)) => self.set_tool(machine, number, words.len()),
            Ok(Dollar::Restore(change)) => self.store(
                machine,
                Some(NewRecord::Defaults(change)),
                AfterStore::Restore,
            ),
            Ok(Dollar::Assign(assignment)) => {
                let number = settings::numbered(assignment).map_or(0, |(number, _)| number);
                match settings::assign(&mut settings, assignment) {
                    Ok(()) => self.store_settings(machine, number, &settings),
                    Err(error) => self.refuse(error.into()),
                }
            }
        }
    }

    /// Stores settings of which the one with this number has been assigned.
    fn store_settings(&mut self, machine: &Snapshot, number: i64, settings: &Settings) -> Progress {
        if number == REPORT_INCHES {
            // The next report shows the offset in the new unit.
            self.reports.cadence.offset_changed();
        }
        let record = NewRecord::Settings(settings);
        self.store(machine, Some(record), AfterStore::Configure)
    }

    /// Writes the next line of a list, and the answer after the last.
    pub(super) fn list(&mut self, list: List, line: usize, received_bytes: usize) -> Progress {
        let lists = ListContents {
            stored: &self.persistence.stored,
            offsets: self.line.interpreter.offsets(),
            tools: self.line.interpreter.tools(),
            probed: &self.probing.reported,
            faults: FaultCounts {
                waiting_changes: self.persistence.waiting.count(),
                ..self.faults
            },
            damaged: self.persistence.damaged,
            reset_cause: self.power_up.reset_cause,
            received_bytes,
        };
        if lists.write(&mut self.reports.message, list, line) {
            self.enter(LineStage::Listing(list, line + 1))
        } else {
            self.accept()
        }
    }

    /// Answers `$G`.
    fn report_modes(&mut self) -> Progress {
        let unit = ReportUnit::of(self.settings());
        let (modal, text) = (self.line.interpreter.modal(), &mut self.reports.message);
        listing::modes(text, modal, self.tool_change.is_manual(), unit);
        self.accept()
    }

    /// Leaves the line until everything before it has been done: its checks are then up to date.
    pub(super) fn await_standstill(&mut self) -> Progress {
        self.stage = LineStage::AwaitingStandstill;
        // Moves that are held back are sent at once: the machine would stop before them otherwise.
        if self.path.blender.has_pending() {
            Progress::Again
        } else {
            Progress::Waiting
        }
    }

    /// Answers the line with `ok`.
    pub(super) fn accept(&mut self) -> Progress {
        self.end_line(Ok(()))
    }

    /// Answers the line with an error.
    pub(super) fn refuse(&mut self, error: LineError) -> Progress {
        self.end_line(Err(error))
    }

    /// Answers the line, and continues with the next.
    pub(super) fn end_line(&mut self, result: Result<(), LineError>) -> Progress {
        #[cfg(arc_machine)]
        {
            let text = &mut self.reports.message;
            if self.path.router.takes_off_steps() {
                report::feedback(text, Feedback::ArcOffSteps);
            }
            if self.stored_program.end_line(result, text) {
                return self.begin_line();
            }
        }
        if let Err(error) = result {
            self.path.sync.follows_refused |= self.holds_following(error);
        }
        let Source::Startup { number, .. } = self.line.source else {
            let settings = &self.persistence.stored.settings;
            let (reports, interpreter) = (&mut self.reports, &mut self.line.interpreter);
            if !(self.host).end_line(result, &self.lines, settings, interpreter, reports) {
                answer(&mut reports.message, result);
            }
            return self.begin_line();
        };
        if let Some(line) = self.persistence.stored.startup.get(number) {
            report::startup(&mut self.reports.message, line);
        }
        answer(&mut self.reports.message, result);
        self.enter(LineStage::StartingUp(number + 1))
    }

    /// Enters a stage, to go on with it at once.
    pub(super) fn enter(&mut self, stage: LineStage) -> Progress {
        self.stage = stage;
        Progress::Again
    }

    /// Begins to receive a line.
    pub(super) fn begin_line(&mut self) -> Progress {
        self.line.input.clear();
        self.line.source = Source::Line;
        self.enter(if self.tool_change.is_manual() {
            LineStage::ReadingManual
        } else {
            LineStage::Reading
        })
    }

    /// Ends the lock of an alarm, once the machine stands still, and compensation in any state.
    pub(super) fn unlock(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        if ports.machine.state != State::Alarm {
            let interpreter = &self.line.interpreter;
            if interpreter.is_compensating() || interpreter.is_off_path() {
                if !self.path.is_done(ports.machine) {
                    return self.await_standstill();
                }
                self.cutter_path.cancel(&self.path, &mut self.line);
            }
            return self.accept();
        }
        if ports.machine.failed_self_test {
            return self.refuse(LineError::Locked);
        }
        if !self.path.is_done(ports.machine) {
            return self.await_standstill();
        }
        self.cutter_path.cancel(&self.path, &mut self.line);
        self.path.send_work(Work::Unlock, ports.entries);
        let message = AfterCommands::Message(Feedback::Unlocked);
        self.enter(LineStage::Completing(message))
    }

    /// Homes the axes of a mask, 0 for all.
    pub(super) fn home(&mut self, mask: u8, ports: &mut Ports<'_, '_>) -> Progress {
        if self.line.interpreter.is_compensating() {
            return self.refuse(LineError::NotWithCompensation);
        }
        if ports.machine.failed_self_test {
            return self.refuse(LineError::Locked);
        }
        if !self.path.is_done(ports.machine) {
            return self.await_standstill();
        }
        let all = (1 << AXES) - 1;
        let switches = if mask == 0 { all } else { mask.into() };
        let switches = switches & !u16::from(self.settings().homing_marks);
        if ports.machine.inputs.has(Levels(switches)) {
            report::feedback(&mut self.reports.message, Feedback::CheckLimits);
            return self.refuse(LineError::LimitsEngaged);
        }
        self.path.send_work(Work::Home(mask), ports.entries);
        self.enter(LineStage::Completing(AfterCommands::Home { mask }))
    }

    /// Ends homing. A failure has been reported as an alarm, and ends with a reset.
    pub(super) fn end_homing(&mut self, machine: &Snapshot, mask: u8) -> Progress {
        let rules = self.host.rules();
        if machine.state == State::Alarm && rules.answers_when_stopped {
            return self.refuse(LineError::Locked);
        }
        if machine.state == State::Alarm {
            return self.answer_and_reset();
        }
        self.path.adopt_position(machine, &mut self.line);
        let settings = &self.persistence.stored.settings;
        let all = LINEAR_AXES | settings.homing_marks;
        let axes = if mask == 0 { all } else { mask };
        self.line.interpreter.set_homed(axes, settings);
        if mask != 0 || rules.answers_when_stopped {
            return self.accept();
        }
        self.line.source = Source::Startup {
            number: 0,
            is_homed: true,
        };
        self.enter(LineStage::StartingUp(0))
    }

    /// Begins check mode: programs are checked and not executed.
    pub(super) fn begin_check(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        self.cutter_path.cancel(&self.path, &mut self.line);
        self.tool_before_check = Some(self.line.interpreter.loaded_tool());
        self.path.send_work(Work::Check, ports.entries);
        let message = AfterCommands::Message(Feedback::CheckEnabled);
        self.enter(LineStage::Completing(message))
    }

    /// Ends check mode, with a reset.
    pub(super) fn end_check(&mut self) -> Progress {
        report::feedback(&mut self.reports.message, Feedback::CheckDisabled);
        self.answer_and_reset()
    }

    /// Hands over to a bootloader; the statement does not exist where the board has no such bootloader.
    fn boot(&mut self, bootloader: Bootloader, ports: &mut Ports<'_, '_>) -> Progress {
        if self.power_up.bootloaders.has(bootloader) {
            self.sleep(Some(bootloader), ports)
        } else {
            self.refuse(LineError::InvalidStatement)
        }
    }

    /// Switches everything off until a reset, or until a bootloader begins. The notice of the machine follows the answer.
    fn sleep(&mut self, until: Option<Bootloader>, ports: &mut Ports<'_, '_>) -> Progress {
        if !self.path.is_done(ports.machine) {
            return self.await_standstill();
        }
        self.cutter_path.cancel(&self.path, &mut self.line);
        self.path.send_work(Work::Sleep, ports.entries);
        answer(&mut self.reports.message, Ok(()));
        self.enter(LineStage::Asleep(until))
    }
}
