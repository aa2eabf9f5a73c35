//! Lines of G-code: of the sender, of a jog, of the startup lines.
//!
//! A line is checked completely, then executed: nothing of it goes to the machine before all of its
//! path is known to be inside the travel. Read with Grbl 1.1 `gcode.c`, `motion_control.c`, `jog.c`.

use core::mem::take;

use super::{
    AfterCommands, LineStage, Ports, Progress, Session, Source,
    persistence::{AfterStore, NewRecord},
};
use crate::{
    axis::Axes,
    gcode::{
        LineError,
        interpreter::{CheckedLine, Message},
    },
    machine::Snapshot,
    model::State,
    path::OutsideTravel,
    protocol::{
        dialect::{NextStep, SenderDialect},
        report::{self, Feedback},
    },
    units::Nm,
};

impl Session {
    /// Refuses a line, and holds a program that moves the machine: later lines count on the refused line. A jog, and a
    /// machine at rest, are not held.
    #[cold]
    pub(super) fn refuse_with_hold(&mut self, error: LineError, ports: &Ports<'_, '_>) -> Progress {
        // The line that the loss of the link has cut off is dropped: nobody waits behind it.
        let is_torn = error == LineError::BytesLost && take(&mut self.is_line_torn);
        let holds = !self.path.is_done(ports.machine) && !self.path.sync.is_jogging && !is_torn;
        if holds {
            self.request_hold(ports);
        }
        let progress = self.refuse(error);
        self.path.sync.follows_refused &= !holds;
        progress
    }

    /// Returns whether the line, which is refused with an error, is one of a program behind which others are held. A
    /// checked line is asked for again.
    pub(super) fn holds_following(&self, error: LineError) -> bool {
        let text = self.line.input.text().unwrap_or_default();
        let is_asked_for = matches!(error, LineError::Checksum | LineError::LineNumber);
        self.settings().holds_after_refusal
            && self.line.source == Source::Line
            && !self.host.rules().answers_when_stopped
            && !self.tool_change.is_manual()
            && !text.starts_with(b"$")
            && !is_asked_for
    }

    /// Holds the machine before the line, which follows a refused one: all that has been accepted is done first.
    #[cold]
    pub(super) fn hold_after_refusal(&mut self, ports: &Ports<'_, '_>) -> Progress {
        if self.path.is_done(ports.machine) {
            self.path.sync.follows_refused = false;
            report::feedback(&mut self.reports.message, Feedback::LineRefused);
            self.request_hold(ports);
        }
        self.await_standstill()
    }

    /// Requests a hold behind the bytes that have been taken.
    pub(super) fn request_hold(&mut self, ports: &Ports<'_, '_>) {
        let received = ports.received.oldest();
        ports.requests.accept_from_interpret(b'!', received);
        self.path.sync.has_release_request = true;
    }

    /// Checks what the line asks for against the state in which the machine is.
    fn check_state(&self, machine: &Snapshot) -> Result<(), LineError> {
        let checked = &self.line.checked;
        if self.tool_change.refuses(&self.line) {
            return Err(LineError::ToolChange);
        }
        if machine.state == State::Alarm && checked.needs_unlocked() {
            return Err(LineError::Locked);
        }
        Ok(())
    }

    /// Checks the line, and then executes it or leaves it for later.
    pub(super) fn interpret(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        if !self.path.sync.is_position_known {
            self.line.checked = CheckedLine::default();
            return self.await_standstill();
        }
        let is_stopping = machine.overrides.optional_stop;
        self.line.interpreter.set_optional_stop(is_stopping);
        let stored = &self.persistence.stored;
        let checked = self.line.check(stored, &self.cutter_path);
        let ends_at_switch = self.line.source == Source::Line && self.host.rules().ends_at_switch;
        let checked = match checked {
            Ok(()) if ends_at_switch => self.line.checked.end_at_switch(),
            checked => checked,
        };
        let is_possible = checked.and_then(|()| self.check_state(machine));
        let settings = &self.persistence.stored.settings;
        let plan = |()| (self.cutter_path).plan(&self.line, settings);
        if let Err(error) = is_possible.and_then(plan) {
            if self.is_hinted() {
                (self.line).write_hint(error, settings, &mut self.reports.message);
            }
            return self.refuse(error);
        }
        let waits = self.line.checked.waits_for_standstill()
            && !self.cutter_path.waits_after_move(&self.line.checked);
        if waits && !self.path.is_done(machine)
            || self.waits_for_message(self.line.checked.pauses_program())
        {
            return self.await_standstill();
        }
        if let Some(record) = self.line.new_startup() {
            return self.store(machine, Some(record), AfterStore::Execute);
        }
        self.execute(ports)
    }

    /// Returns whether the sender is told what a refused line lacks.
    fn is_hinted(&self) -> bool {
        #[cfg(arc_machine)]
        if self.stored_program.is_running() {
            return false;
        }
        self.line.source == Source::Line
    }

    /// Executes the line that has been checked, after the work that must come first: the change of a tool, or the
    /// flash.
    fn execute(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        if (self.line).needs_tool(machine, &self.persistence.stored.settings) {
            return self.begin_tool_change(ports);
        }
        if self.line.lacks_spindle(machine) {
            if !self.path.is_done(machine) {
                return self.await_standstill();
            }
            self.line.pause_without_spindle();
            report::feedback(&mut self.reports.message, Feedback::SpindleOff);
            return self.send_commands(0, ports);
        }
        if self.line.checked.sets_tool() {
            let tool = self.line.checked.new_tool();
            let record = tool.map(|(slot, entry)| NewRecord::Tool(slot, Some(entry)));
            return self.store(machine, record, AfterStore::Commit);
        }
        if self.line.checked.sets_origins() {
            return self.store_new_origins(machine);
        }
        self.commit(ports)
    }

    /// Begins the change of the tool for which the line asks; the machine stands still.
    pub(super) fn begin_tool_change(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let (line, settings) = (&mut self.line, &self.persistence.stored.settings);
        let from = line.interpreter.position();
        self.tool_change.begin(line, ports.machine, settings);
        if line.leaves_travel(ports.machine, from, settings) {
            self.probing.start = from;
            return self.send_fault(ports);
        }
        self.tool_change.report(line, &mut self.reports.message);
        self.send_commands(0, ports)
    }

    /// Waits for cycle start, then returns to the program; or begins with the operator's lines.
    pub(super) fn continue_tool_change(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        if !self.path.is_done(machine) || machine.state.is_suspended() {
            return Progress::Waiting;
        }
        if self.tool_change.begin_manual(&self.line, ports) {
            return self.begin_line();
        }
        if machine.state == State::Alarm {
            return self.refuse(LineError::Locked);
        }
        self.tool_change.return_to_program(&mut self.line);
        self.reports.is_tool_due |= self.line.outcome.shows_tool;
        self.send_commands(0, ports)
    }

    /// Executes the next line of the operator; after the last one before cycle start, continues the change.
    pub(super) fn read_manual_line(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        match self.tool_change.take_line(&mut self.line, ports) {
            NextStep::Wait if self.tool_change.is_manual() => Progress::Waiting,
            NextStep::Wait => self.enter(LineStage::Completing(AfterCommands::ToolPause)),
            step => self.take_step(step, ports),
        }
    }

    /// Puts the line into effect that has been checked.
    pub(super) fn commit(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let cutter = self.cutter_path.cutter(&self.line.interpreter);
        let from = cutter.unwrap_or_else(|| self.line.interpreter.position());
        self.line.commit(ports.machine);
        self.send(from, ports)
    }

    /// Sends the commands of a line that began at a position, unless it leaves the travel.
    fn send(&mut self, from: Axes<Nm>, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        let is_checking = machine.state == State::Check;
        let (line, settings) = (&mut self.line, &self.persistence.stored.settings);
        let ends_program = line.outcome.message == Some(Message::ProgramEnd);
        if line.outcome.shows_offset && !(is_checking && ends_program) {
            self.reports.cadence.offset_changed();
        }
        line.is_compensated =
            line.checked.follows_contour() || self.cutter_path.compensator.has_plan();
        if !line.is_compensated && line.leaves_travel(machine, from, settings) {
            self.probing.start = from;
            return self.send_fault(ports);
        }
        line.find_parts(&from, settings);
        self.queue_message(self.line.checked.pauses_program(), machine);
        let (line, settings) = (&mut self.line, &self.persistence.stored.settings);
        line.write_outcome(&mut self.reports.message, settings);
        line.after_commands = line.end_of_commands(machine, &self.cutter_path);
        if line.after_commands == Some(AfterCommands::Probe) {
            self.probing.has_ended = false;
            self.probing.start = from;
        }
        self.reports.is_tool_due |= line.outcome.shows_tool && !is_checking;
        if is_checking && !line.is_compensated {
            line.outcome.commands.clear();
        }
        let is_off_path = line.is_compensated || line.checked.stays_off_path();
        if is_off_path || self.cutter_path.is_waiting() {
            self.send_compensated(0, ports)
        } else {
            self.send_commands(0, ports)
        }
    }

    /// Returns where the line that [`Alarm::SoftLimit`] has stopped leaves the travel, and whether this is in a
    /// compensated move, which earlier lines may have asked for. For tools that show the reason.
    ///
    /// [`Alarm::SoftLimit`]: crate::model::Alarm::SoftLimit
    #[must_use]
    pub fn outside_travel(&self) -> Option<(OutsideTravel, bool)> {
        if !matches!(self.stage, LineStage::Faulting | LineStage::Faulted) {
            return None;
        }
        let settings = self.settings();
        if let Some(outside) = self.cutter_path.compensator.outside(settings) {
            return Some((outside, true));
        }
        let from = self.probing.start;
        let outside = self.line.outside_travel(from, settings);
        Some((outside?, false))
    }

    /// Returns whether the line has a message for which there is no room.
    pub(super) fn waits_for_message(&self, is_pause: bool) -> bool {
        self.operator_messages.is_full() && !self.line.operator_text(is_pause).is_empty()
    }

    /// Keeps the message of the line, if any, until the entries that have been sent are finished.
    pub(super) fn queue_message(&mut self, is_pause: bool, machine: &Snapshot) {
        if !self.line.input.comment().is_empty() {
            self.queue_comment(is_pause, machine);
        }
    }

    #[cold]
    fn queue_comment(&mut self, is_pause: bool, machine: &Snapshot) {
        let text = self.line.operator_text(is_pause);
        if text.is_empty() {
            return;
        }
        // A move that is held back may still be joined with others, or be changed by the next one.
        let is_held_back = self.path.blender.has_pending() || self.cutter_path.is_waiting();
        let has_passed = self.path.is_done(machine) && !is_held_back;
        if machine.state == State::Check || has_passed {
            report::operator_message(&mut self.reports.message, text);
        } else {
            let entered = self.path.sync.entered;
            let due = entered.wrapping_add(u32::from(is_held_back));
            self.operator_messages.push(text, due);
        }
    }
}
