//! The change of a tool, `M6`: the machine waits for cycle start, and then executes the rest of the line.
//!
//! The line is checked before anything happens, and again afterwards: the tool that it asks for is then
//! in the spindle, and the operator may have set other offsets.

use super::{AfterCommands, LineStage, Links, Progress, Session};
use crate::{
    gcode::{LineError, interpreter::Interrupted},
    machine::Snapshot,
    model::State,
    protocol::report,
    settings::TOOL_CHANGE_IGNORED,
    units::Nm,
};

/// The change of a tool for which the machine waits.
#[derive(Debug, Default)]
pub(super) struct ToolChange {
    /// The tool to be loaded.
    tool: u8,
    /// What the change interrupts.
    interrupted: Interrupted,
}

impl Session {
    /// Returns whether the machine has to wait for a tool before it executes the line.
    pub(super) fn needs_tool(&self, machine: &Snapshot) -> bool {
        self.line.checked.changes_tool()
            && machine.state != State::Check
            && self.settings().tool_change != TOOL_CHANGE_IGNORED
    }

    /// Begins the change of the tool for which the line asks; the machine stands still.
    pub(super) fn begin_tool_change(&mut self, links: &mut Links<'_, '_>) -> Progress {
        let from = self.interpreter.position();
        let settings = self.settings();
        let is_moved = settings.tool_change_travel && self.is_homed;
        let height = is_moved.then(|| Nm(0) - Nm::from_mm(settings.homing_pull_off_mm));
        let checked = &self.line.checked;
        let tool = checked.loaded_tool();
        let outcome = &mut self.line.outcome;
        let interrupted = self.interpreter.begin_tool_change(checked, height, outcome);
        if self.leaves_travel(links.machine, from) {
            return self.send_fault(links);
        }
        self.tool_change = ToolChange { tool, interrupted };
        let text = &mut self.reports.message;
        report::tool_change(text, tool, self.line.input.message());
        self.line.tilted = None;
        self.line.after_commands = Some(AfterCommands::ToolPause);
        self.send_commands(0, links)
    }

    /// Returns to the program, after cycle start.
    pub(super) fn continue_tool_change(&mut self, links: &mut Links<'_, '_>) -> Progress {
        let machine = links.machine;
        if !self.is_done(machine) || machine.state.is_suspended() {
            return Progress::Waiting;
        }
        if machine.state == State::Alarm {
            return self.refuse(LineError::Locked);
        }
        let ToolChange { tool, interrupted } = &self.tool_change;
        let outcome = &mut self.line.outcome;
        self.interpreter
            .return_from_tool_change(interrupted, *tool, outcome);
        self.reports.is_tool_due |= outcome.shows_tool;
        self.line.after_commands = Some(AfterCommands::ToolReturn);
        self.send_commands(0, links)
    }

    /// Ends the change: the line is dispatched again, for the rest of it.
    pub(super) fn end_tool_change(&mut self) -> Progress {
        self.interpreter
            .end_tool_change(&self.tool_change.interrupted);
        self.stage = LineStage::AwaitingStandstill;
        Progress::Again
    }
}
