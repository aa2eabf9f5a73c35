//! The change of a tool, `M6`: the machine waits for cycle start, and then executes the rest of the line.
//!
//! The line is checked before anything happens, and again afterwards: the tool that it asks for is then
//! in the spindle, and the operator may have set other offsets.
//!
//! After 0xA3 the operator's lines are executed, while the bytes of the program that have been received
//! before it are kept where they are, in the receive queue: lines are taken from behind them. Where the
//! operator's lines begin and end is told by the marks that the receiver has set at 0xA3 and at cycle
//! start.

use core::mem;

use super::{AfterCommands, LineStage, Ports, Progress, Session, Source};
use crate::{
    gcode::{
        LineError, PlainPrefix,
        interpreter::{CheckedLine, Interrupted},
    },
    machine::Snapshot,
    model::State,
    protocol::{
        line::Line,
        report::{self, Feedback},
    },
    settings::TOOL_CHANGE_IGNORED,
};

/// The change of a tool for which the machine waits.
#[derive(Debug)]
pub(super) struct ToolChange {
    /// The tool to be loaded.
    tool: u8,
    /// What the change interrupts.
    interrupted: Interrupted,
    /// The operator's lines are executed.
    is_manual: bool,
    /// [`crate::model::ToolMarks::changes`] as seen last.
    changes: u8,
    /// Bytes of the program that are kept in the receive queue.
    kept: usize,
    /// The line with the `M6`, while others are executed.
    source: Source,
    line: Line,
}

impl ToolChange {
    /// No change.
    pub(super) fn new() -> Self {
        Self {
            tool: 0,
            interrupted: Interrupted::default(),
            is_manual: false,
            changes: 0,
            kept: 0,
            source: Source::Line,
            line: Line::new(),
        }
    }

    /// Returns whether the operator's lines are executed.
    pub(super) const fn is_manual(&self) -> bool {
        self.is_manual
    }
}

impl Session {
    /// Returns whether the machine has to wait for a tool before it executes the line.
    pub(super) fn needs_tool(&self, machine: &Snapshot) -> bool {
        self.line.checked.changes_tool()
            && machine.state != State::Check
            && self.settings().tool_change != TOOL_CHANGE_IGNORED
    }

    /// Returns whether a line has no place in a change of the tool: jogs alone move the machine.
    pub(super) fn is_refused_in_tool_change(&self) -> bool {
        let is_jog = self.line.source == Source::Jog;
        self.tool_change.is_manual && !is_jog && self.line.checked.is_program()
    }

    /// Begins the change of the tool for which the line asks; the machine stands still.
    pub(super) fn begin_tool_change(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let from = self.interpreter.position();
        let settings = self.settings();
        let is_moved = settings.tool_change_travel && self.interpreter.is_homed();
        let height = is_moved.then(|| settings.top());
        let checked = &self.line.checked;
        let change = &mut self.tool_change;
        change.tool = checked.loaded_tool();
        change.changes = ports.machine.tool_marks.changes;
        let outcome = &mut self.line.outcome;
        change.interrupted = self.interpreter.begin_tool_change(checked, height, outcome);
        if self.leaves_travel(ports.machine, from) {
            self.probing.start = from;
            return self.send_fault(ports);
        }
        let text = &mut self.reports.message;
        report::tool_change(text, self.tool_change.tool, self.line.input.message());
        // The rest of the line has none.
        self.line.input.clear_comment();
        self.send_own_commands(AfterCommands::ToolPause, ports)
    }

    /// Waits for cycle start, then returns to the program; or begins with the operator's lines.
    pub(super) fn continue_tool_change(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        if !self.path.is_done(machine) || machine.state.is_suspended() {
            return Progress::Waiting;
        }
        if self.tool_change.changes != machine.tool_marks.changes {
            return self.begin_manual(ports);
        }
        if machine.state == State::Alarm {
            return self.refuse(LineError::Locked);
        }
        let change = &self.tool_change;
        let outcome = &mut self.line.outcome;
        self.interpreter
            .return_from_tool_change(&change.interrupted, change.tool, outcome);
        self.reports.is_tool_due |= outcome.shows_tool;
        self.send_own_commands(AfterCommands::ToolReturn, ports)
    }

    /// Ends the change: the line is dispatched again, for the rest of it.
    pub(super) fn end_tool_change(&mut self) -> Progress {
        self.interpreter
            .end_tool_change(&self.tool_change.interrupted);
        self.dispatch_again()
    }

    /// Has the line dispatched again.
    pub(super) fn dispatch_again(&mut self) -> Progress {
        self.stage = LineStage::AwaitingStandstill;
        Progress::Again
    }

    /// Pauses before a feed move after a change of the tool, as nobody has switched the spindle on.
    pub(super) fn pause_without_spindle(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        if !self.path.is_done(ports.machine) {
            return self.await_standstill();
        }
        self.interpreter
            .pause_without_spindle(&mut self.line.outcome);
        report::feedback(&mut self.reports.message, Feedback::SpindleOff);
        self.send_own_commands(AfterCommands::Again, ports)
    }

    /// Sends commands that are not those of the line, of which an earlier one may have ended within a cycle
    /// or a tilted arc.
    fn send_own_commands(
        &mut self,
        after_commands: AfterCommands,
        ports: &mut Ports<'_, '_>,
    ) -> Progress {
        self.line.tilted = None;
        self.line.drilling = None;
        self.line.after_commands = Some(after_commands);
        self.send_commands(0, ports)
    }

    /// Begins to execute the operator's lines.
    fn begin_manual(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let marks = &ports.machine.tool_marks;
        let change = &mut self.tool_change;
        change.changes = marks.changes;
        change.is_manual = true;
        change.kept = ports.received.waiting_before(marks.begin);
        change.source = self.line.source;
        change.line.copy_from(&self.line.input);
        self.begin_line()
    }

    /// Ends the operator's lines: the line that changes the tool is the present one again.
    pub(super) fn end_manual(&mut self) {
        let change = &mut self.tool_change;
        if mem::take(&mut change.is_manual) {
            self.line.source = change.source;
            self.line.prefix = PlainPrefix::default();
            self.line.checked = CheckedLine::default();
            self.line.input.copy_from(&change.line);
        }
    }

    /// Executes the next line of the operator; after the last one before cycle start, continues the
    /// change.
    pub(super) fn read_manual_line(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        let kept = self.tool_change.kept;
        // Everything else comes back to `Tool`.
        let is_over = machine.state == State::Idle;
        let end = if is_over {
            ports.received.waiting_before(machine.tool_marks.end)
        } else {
            ports.received.len()
        };
        if ports.received.has_line_end(kept, end) {
            self.line.prefix = PlainPrefix::default();
            let line = &mut self.line.input;
            let take = |byte| line.take_from(core::iter::once(byte));
            ports.received.take_behind(kept, take);
            if kept != 0 {
                let received = &*ports.received;
                ports.requests.spread_losses(|| received.written());
            }
            let end = ports.received.oldest().wrapping_add(kept);
            if ports.requests.take_losses_before(end) {
                return self.refuse(LineError::BytesLost);
            }
            return self.dispatch(ports);
        }
        if !is_over {
            return Progress::Waiting;
        }
        self.end_manual();
        self.stage = LineStage::Completing(AfterCommands::ToolPause);
        Progress::Again
    }
}
