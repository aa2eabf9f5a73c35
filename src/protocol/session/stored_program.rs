//! The program that the firmware brings along: `$794`. Only where motors may be driven by phases.
//!
//! Cycle start at Idle begins it, as the switch of the experiment did, and it begins again at its end. A reset,
//! an alarm, or a line that is refused ends it, and a line of the sender does when it is at its end. Its own
//! lines are not answered.

use super::{LineStage, Ports, Progress, Session};
use crate::{
    gcode::LineError,
    machine::Snapshot,
    model::State,
    protocol::report::{self, Feedback},
};

/// `examples/pico.nc` without its `M0`: cycle start has been pressed.
const LINES: [&str; 6] = [
    "G21 G90 G17 F15000\n",
    "G3 X-400 Y400 I0 J400\n",
    "G3 X0 Y0 I0 J-400\n",
    "G2 X400 Y-400 I400 J0\n",
    "G2 X0 Y0 I-400 J0\n",
    "M2\n",
];

/// What goes on of the program.
#[derive(Debug, Default)]
pub(super) struct StoredProgram {
    is_running: bool,
    /// The line in execution is one of it.
    is_executing: bool,
    /// The line that comes next.
    next: usize,
}

impl StoredProgram {
    /// Returns whether the program goes on.
    pub(super) const fn is_running(&self) -> bool {
        self.is_running
    }

    /// Ends the program. Returns whether one of its lines is being executed, which nobody waits for.
    pub(super) fn stop(&mut self) -> bool {
        core::mem::take(self).is_executing
    }
}

impl Session {
    /// Begins the program at cycle start, where `$794` allows it and no line is being executed.
    pub(super) fn start_stored_program(&mut self, machine: &Snapshot) {
        let is_free = self.stage == LineStage::Reading && self.path.is_done(machine);
        if self.settings().runs_stored_program && is_free && !self.stored_program.is_running {
            self.stored_program.is_running = true;
        }
    }

    /// Executes the next line of the program.
    pub(super) fn execute_stored_line(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let program = &mut self.stored_program;
        let is_over = program.next == LINES.len() && ports.received.may_have_line();
        let may_run = matches!(ports.machine.state, State::Idle | State::Run);
        let next = program.next % LINES.len();
        let Some(line) = LINES.get(next).filter(|_| may_run && !is_over) else {
            program.stop();
            return Progress::Again;
        };
        program.next = next + 1;
        program.is_executing = true;
        self.line.prefix = crate::gcode::PlainPrefix::default();
        self.line.input.clear();
        if self.line.input.take_from(line.bytes()) {
            self.dispatch(ports)
        } else {
            self.refuse(LineError::LineOverflow)
        }
    }

    /// Ends a line of the program without an answer. Returns false for lines of others.
    pub(super) fn end_stored_line(&mut self, result: Result<(), LineError>) -> bool {
        let program = &mut self.stored_program;
        let is_executing = core::mem::take(&mut program.is_executing);
        if is_executing && result.is_err() {
            program.stop();
            report::feedback(&mut self.reports.message, Feedback::StoredProgramRefused);
        }
        is_executing
    }

    /// Reports an arc that could not follow `$790`, before an answer.
    pub(super) fn report_off_steps(&mut self) {
        if self.path.router.takes_off_steps() {
            report::feedback(&mut self.reports.message, Feedback::ArcOffSteps);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{string::String, vec::Vec};

    use super::LINES;

    #[test]
    fn the_stored_program_is_that_of_the_example() {
        let example = include_str!("../../../examples/pico.nc");
        let lines = example
            .lines()
            .filter(|line| !line.starts_with('(') && *line != "M0");
        let stored: String = LINES.concat();
        assert_eq!(
            stored.lines().collect::<Vec<_>>(),
            lines.collect::<Vec<_>>()
        );
    }
}
