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

use super::{AfterCommands, LineExecution, Ports, Source};
use crate::{
    gcode::{
        LineError, PlainPrefix,
        interpreter::{CheckedLine, Interrupted},
    },
    machine::Snapshot,
    model::State,
    protocol::{dialect::NextStep, line::Line, report, text::Text},
    settings::Settings,
};

/// The change of a tool for which the machine waits.
#[derive(Debug)]
pub(super) struct ToolChange {
    /// The tool to be loaded.
    tool: u8,
    /// What the change interrupts.
    pub(super) interrupted: Interrupted,
    /// The operator's lines are executed.
    is_manual: bool,
    /// [`crate::model::ToolChangeSpan::changes`] as seen last.
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

    /// Returns whether a line has no place in the change: jogs alone move the machine.
    pub(super) fn refuses(&self, line: &LineExecution) -> bool {
        self.is_manual && line.source != Source::Jog && line.checked.is_program()
    }

    /// Begins the change for which the line asks; the machine stands still. The line has the commands for that.
    pub(super) fn begin(
        &mut self,
        line: &mut LineExecution,
        machine: &Snapshot,
        settings: &Settings,
    ) {
        let is_moved = settings.tool_change_travel && line.interpreter.is_homed();
        let height = is_moved.then(|| settings.top());
        self.tool = line.checked.loaded_tool();
        self.changes = machine.tool_marks.changes;
        let interpreter = &mut line.interpreter;
        self.interrupted = interpreter.begin_tool_change(&line.checked, height, &mut line.outcome);
        line.follow_own_commands(AfterCommands::ToolPause);
    }

    /// Says for which tool the machine waits. The rest of the line has no message.
    pub(super) fn report(&self, line: &mut LineExecution, text: &mut Text) {
        report::tool_change(text, self.tool, line.input.message());
        line.input.clear_comment();
    }

    /// Returns to the program. The line has the commands for that.
    pub(super) fn return_to_program(&self, line: &mut LineExecution) {
        let interpreter = &mut line.interpreter;
        interpreter.return_from_tool_change(&self.interrupted, self.tool, &mut line.outcome);
        line.follow_own_commands(AfterCommands::ToolReturn);
    }

    /// Begins to execute the operator's lines, where they have begun. Returns whether that is so.
    pub(super) fn begin_manual(&mut self, line: &LineExecution, ports: &Ports<'_, '_>) -> bool {
        let marks = &ports.machine.tool_marks;
        if mem::replace(&mut self.changes, marks.changes) == marks.changes {
            return false;
        }
        self.is_manual = true;
        self.kept = ports.received.waiting_before(marks.begin);
        self.source = line.source;
        self.line.copy_from(&line.input);
        true
    }

    /// Ends the operator's lines: the line that changes the tool is the present one again.
    pub(super) fn end_manual(&mut self, line: &mut LineExecution) {
        if mem::take(&mut self.is_manual) {
            line.source = self.source;
            line.prefix = PlainPrefix::default();
            line.checked = CheckedLine::default();
            line.input.copy_from(&self.line);
        }
    }

    /// Takes the next line of the operator; after the last one before cycle start, ends them.
    pub(super) fn take_line(
        &mut self,
        line: &mut LineExecution,
        ports: &mut Ports<'_, '_>,
    ) -> NextStep {
        let (machine, kept) = (ports.machine, self.kept);
        // Everything else comes back to `Tool`.
        let is_over = machine.state == State::Idle;
        let received = &mut *ports.received;
        let end = if is_over {
            received.waiting_before(machine.tool_marks.end)
        } else {
            received.len()
        };
        if !received.has_line_end(kept, end) {
            if is_over {
                self.end_manual(line);
            }
            return NextStep::Wait;
        }
        line.prefix = PlainPrefix::default();
        received.take_behind(kept, |byte| line.input.take_from(core::iter::once(byte)));
        if kept != 0 {
            ports.requests.spread_losses(|| received.written());
        }
        let end = received.oldest().wrapping_add(kept);
        if ports.requests.take_losses_before(end) {
            NextStep::Answer(Err(LineError::BytesLost))
        } else {
            NextStep::Execute
        }
    }
}
