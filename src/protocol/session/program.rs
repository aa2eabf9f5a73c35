//! Lines of G-code: of the sender, of a jog, of the startup lines.
//!
//! A line is checked completely, then executed: nothing of it goes to the machine before all of its
//! path is known to be inside the travel. Read with Grbl 1.1 `gcode.c`, `motion_control.c`, `jog.c`.

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
    model::{Command, State},
    path::{OutsideTravel, TiltedArc},
    protocol::{
        dialect::SenderDialect,
        report::{self, Feedback},
    },
    units::Nm,
};

impl Session {
    /// Refuses a line, and holds a program that moves the machine: the lines behind it count on this one. A jog, and
    /// a machine at rest, are not held.
    #[cold]
    #[inline(never)]
    pub(super) fn refuse_with_hold(&mut self, error: LineError, ports: &Ports<'_, '_>) -> Progress {
        let holds = !self.path.is_done(ports.machine) && !self.path.sync.is_jogging;
        if holds {
            self.request_hold(ports);
        }
        let progress = self.refuse(error);
        self.path.sync.follows_refused &= !holds;
        progress
    }

    /// Returns whether the line, which is refused with an error, is one of a program behind which others are held. A
    /// checked line is asked for again.
    pub(super) fn is_held_behind(&self, error: LineError) -> bool {
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
    #[inline(never)]
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
        ports
            .requests
            .accept_from_interpret(b'!', ports.received.oldest());
        self.path.sync.has_release_request = true;
    }

    /// Interprets the line as from this source.
    pub(super) fn interpret_as(&mut self, source: Source, ports: &mut Ports<'_, '_>) -> Progress {
        self.line.source = source;
        self.interpret(ports)
    }

    /// Checks what the line asks for against the state in which the machine is.
    fn check_state(&self, machine: &Snapshot) -> Result<(), LineError> {
        let checked = &self.line.checked;
        if self.is_refused_in_tool_change() {
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
        self.interpreter
            .set_optional_stop(machine.overrides.optional_stop);
        let checked = match self.line.source {
            Source::Jog => {
                let cutter = self.is_only_beside_path().then(|| self.compensator.end());
                let settings = &self.persistence.stored.settings;
                (self.line).check_jog(&mut self.interpreter, settings, cutter)
            }
            Source::Line | Source::NewStartup { .. } | Source::Startup { .. } => {
                (self.line).check(&mut self.interpreter, &self.persistence.stored)
            }
        };
        let ends_at_switch = self.line.source == Source::Line && self.host.rules().ends_at_switch;
        let checked = match checked {
            Ok(()) if ends_at_switch => self.line.checked.end_at_switch(),
            checked => checked,
        };
        let is_possible = checked.and_then(|()| self.check_state(machine));
        if let Err(error) = is_possible.and_then(|()| self.plan_compensated()) {
            if self.is_hinted() {
                let settings = &self.persistence.stored.settings;
                let message = &mut self.reports.message;
                (self.line).write_hint(error, &self.interpreter, settings, message);
            }
            return self.refuse(error);
        }
        let waits = self.line.checked.waits_for_standstill() && !self.waits_behind_move();
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

    /// Executes the line that has been checked, after what must come before it: the change of a tool, or
    /// the flash.
    fn execute(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        if self.needs_tool(machine) {
            return self.begin_tool_change(ports);
        }
        if self.interpreter.lacks_spindle(&self.line.checked) && machine.state != State::Check {
            return self.pause_without_spindle(ports);
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

    /// Puts the line into effect that has been checked.
    pub(super) fn commit(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let from = self.start_of_move();
        let line = &mut self.line;
        self.interpreter.commit(&line.checked, &mut line.outcome);
        if ports.machine.state == State::Alarm {
            // A locked machine passes no time; nothing moves for which to wait.
            let is_dwell = |command: &Command| matches!(command, Command::Dwell { .. });
            let commands = &mut self.line.outcome.commands;
            commands.retain(|command| !is_dwell(command));
        }
        self.send(from, ports)
    }

    /// Sends the commands of a line that began at a position, unless it leaves the travel.
    fn send(&mut self, from: Axes<Nm>, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        let is_checking = machine.state == State::Check;
        let ends_program = self.line.outcome.message == Some(Message::ProgramEnd);
        if self.line.outcome.shows_offset && !(is_checking && ends_program) {
            self.reports.cadence.offset_changed();
        }
        let waits = self.waits_behind_move();
        let is_compensated = self.line.checked.follows_contour() || self.compensator.has_plan();
        self.line.is_compensated = is_compensated;
        if !is_compensated && self.leaves_travel(machine, from) {
            self.probing.start = from;
            return self.send_fault(ports);
        }
        let settings = &self.persistence.stored.settings;
        let mut commands = self.line.outcome.commands.iter();
        self.line.tilted = commands.find_map(|command| TiltedArc::of(command, &from, settings));
        let is_move = |command: &Command| matches!(command, Command::Line { .. });
        let drilling = self.line.outcome.commands.iter().position(is_move);
        self.line.drilling = drilling.filter(|_| self.line.checked.drills());
        self.queue_message(self.line.checked.pauses_program(), machine);
        let settings = &self.persistence.stored.settings;
        self.line.write_outcome(&mut self.reports.message, settings);
        self.reports.is_tool_due |= self.line.outcome.shows_tool && !is_checking;
        if is_checking && !is_compensated {
            self.line.outcome.commands.clear();
        }
        self.line.after_commands = if ends_program {
            Some(AfterCommands::Message(Feedback::ProgramEnd))
        } else if is_checking {
            None
        } else if self.line.checked.probing().is_some() {
            self.probing.has_ended = false;
            self.probing.start = from;
            Some(AfterCommands::Probe)
        } else {
            // Outputs that switch at standstill have switched when the answer comes.
            let mut commands = self.line.outcome.commands.iter();
            let switches = !self.line.checked.moves()
                && commands.any(|command| !matches!(command, Command::Speed(_)));
            // A startup line is stored when its motion is over.
            let is_stored = matches!(self.line.source, Source::NewStartup { .. });
            let is_switched = switches || self.line.checked.answers_when_done();
            (is_stored || is_switched && !waits).then_some(AfterCommands::Answer)
        };
        if is_compensated || self.compensator.is_waiting() || self.line.checked.stays_beside_path()
        {
            self.send_compensated(0, ports)
        } else {
            self.send_commands(0, ports)
        }
    }

    /// Returns whether some move of the line leaves the travel of the machine, where that is an error.
    pub(super) fn leaves_travel(&self, machine: &Snapshot, from: Axes<Nm>) -> bool {
        let settings = &self.persistence.stored.settings;
        (self.line).leaves_travel(machine, from, &self.interpreter, settings)
    }

    /// Returns where the line that [`Alarm::SoftLimit`] has stopped leaves the travel, and whether it does so in a
    /// compensated move, which lines before it may have asked for. For tools that show the reason.
    ///
    /// [`Alarm::SoftLimit`]: crate::model::Alarm::SoftLimit
    #[must_use]
    pub fn outside_travel(&self) -> Option<(OutsideTravel, bool)> {
        if !matches!(self.stage, LineStage::Faulting | LineStage::Faulted) {
            return None;
        }
        let settings = self.settings();
        if let Some(outside) = self.compensator.outside(settings) {
            return Some((outside, true));
        }
        let from = self.probing.start;
        let outside = self.line.outside_travel(from, &self.interpreter, settings);
        Some((outside?, false))
    }

    /// Returns whether the line has a message for which there is no room.
    #[inline]
    pub(super) fn waits_for_message(&self, is_pause: bool) -> bool {
        self.operator_messages.is_full() && !self.line.operator_text(is_pause).is_empty()
    }

    /// Keeps the message of the line, if it has one, until the entries that have been sent are finished.
    #[inline]
    pub(super) fn queue_message(&mut self, is_pause: bool, machine: &Snapshot) {
        if !self.line.input.comment().is_empty() {
            self.queue_comment(is_pause, machine);
        }
    }

    #[cold]
    #[inline(never)]
    fn queue_comment(&mut self, is_pause: bool, machine: &Snapshot) {
        let text = self.line.operator_text(is_pause);
        if text.is_empty() {
            return;
        }
        // A move that is held back may still be joined with others, or be changed by the next one.
        let is_held_back = self.path.blender.has_pending() || self.compensator.is_waiting();
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
