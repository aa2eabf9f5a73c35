//! A change of the tool: what happens before the machine waits for it, and after.

use super::{CheckedLine, Compensation, CycleWords, Interpreter, LineCommands};
use crate::{
    axis::{Axes, Z},
    gcode::{Modal, StoredPosition},
    model::{Command, Coolant, FeedRate, PathControl, Spindle},
    units::Nm,
};

/// What a change of the tool interrupts: the modes and the position to which the program returns.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Interrupted {
    modal: Modal,
    cycle: CycleWords,
    compensation: Compensation,
    position: Axes<Nm>,
}

impl Interpreter {
    /// Begins the change of the tool for which a line asks, at standstill: spindle and coolant off; with
    /// a height, Z goes there, or stays above it, and then the machine to the position of `G30`.
    pub fn begin_tool_change(
        &mut self,
        checked: &CheckedLine,
        height: Option<Nm>,
        outcome: &mut LineCommands,
    ) -> Interrupted {
        let interrupted = Interrupted {
            modal: self.modal,
            cycle: self.cycle,
            compensation: self.compensation,
            position: self.position,
        };
        outcome.clear();
        self.modal.tool = checked.modal.tool;
        self.modal.path = PathControl::ExactPath;
        if self.modal.spindle != Spindle::Off {
            self.modal.spindle = Spindle::Off;
            outcome.add(Command::Spindle {
                spindle: Spindle::Off,
                rpm: 0.0,
            });
        }
        self.switch_coolant(Coolant::OFF, outcome);
        if let Some(height) = height {
            let g30 = self.stored(StoredPosition::G30);
            self.travel(&g30, height.max(self.position[Z]), outcome);
        }
        outcome.add(Command::ToolPause);
        interrupted
    }

    /// Returns to where the change began: in the plane at the higher Z of both places, so that the tool
    /// goes down last. Coolant is as before, the spindle off. The tool is in the spindle.
    pub fn return_from_tool_change(
        &mut self,
        interrupted: &Interrupted,
        tool: u8,
        outcome: &mut LineCommands,
    ) {
        outcome.clear();
        outcome.shows_tool = self.loaded_tool != tool;
        self.loaded_tool = tool;
        self.modal.path = PathControl::ExactPath;
        let target = interrupted.position;
        self.travel(&target, target[Z].max(self.position[Z]), outcome);
        self.switch_coolant(interrupted.modal.coolant, outcome);
    }

    /// Ends the change, after the return: the modes are those before, whatever the operator's lines have
    /// made of them, but for the spindle. Offsets stay as the operator has set them.
    pub fn end_tool_change(&mut self, interrupted: &Interrupted) {
        self.modal = Modal {
            tool: self.loaded_tool,
            tool_length: self.modal.tool_length,
            spindle: self.modal.spindle,
            coolant: self.modal.coolant,
            ..interrupted.modal
        };
        self.cycle = interrupted.cycle;
        self.compensation = interrupted.compensation;
        self.lacks_spindle = self.has_run_spindle;
        self.update_frame();
        self.update_plain_modes();
    }

    fn switch_coolant(&mut self, coolant: Coolant, outcome: &mut LineCommands) {
        if self.modal.coolant != coolant {
            self.modal.coolant = coolant;
            outcome.add(Command::Coolant(coolant));
        }
    }

    /// Rapids to a position: Z to a height, the other axes, Z.
    fn travel(&mut self, target: &Axes<Nm>, height: Nm, outcome: &mut LineCommands) {
        if self.position == *target {
            return;
        }
        let at_height = |position: &Axes<Nm>| {
            let mut position = *position;
            position[Z] = height;
            position
        };
        for position in [at_height(&self.position), at_height(target), *target] {
            if position != self.position {
                outcome.add(Command::Line {
                    target: position.into(),
                    feed_rate: FeedRate::Rapid,
                    line: 0,
                });
                self.set_position(position);
            }
        }
    }
}
