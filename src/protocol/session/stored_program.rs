//! The program that the firmware brings along: `$794`. Only where motors may be driven by phases.
//!
//! Cycle start at Idle begins it, as the switch of the experiment did, and it begins again at its end. A reset, an
//! alarm, or a refused line ends the program; a line of the sender ends the program when the program is at its end. Its
//! own lines are not answered.

use super::Ports;
use crate::{
    gcode::LineError,
    model::State,
    protocol::{
        Line, Text,
        dialect::NextStep,
        report::{self, Feedback},
    },
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
    /// Begins at cycle start, where nothing else is done.
    pub(super) fn start(&mut self) {
        self.is_running = true;
    }

    /// Returns whether the program goes on.
    pub(super) const fn is_running(&self) -> bool {
        self.is_running
    }

    /// Ends the program. Returns whether one of its lines is being executed, which nobody waits for.
    pub(super) fn stop(&mut self) -> bool {
        core::mem::take(self).is_executing
    }

    /// Takes the next line of the program, or ends it.
    pub(super) fn take_line(&mut self, line: &mut Line, ports: &Ports<'_, '_>) -> Option<NextStep> {
        let is_over = self.next == LINES.len() && ports.received.may_have_line();
        let may_run = matches!(ports.machine.state, State::Idle | State::Run);
        let next = self.next % LINES.len();
        let Some(text) = LINES.get(next).filter(|_| may_run && !is_over) else {
            self.stop();
            return None;
        };
        self.next = next + 1;
        self.is_executing = true;
        line.clear();
        Some(if line.take_from(text.bytes()) {
            NextStep::Execute
        } else {
            NextStep::Answer(Err(LineError::LineOverflow))
        })
    }

    /// Ends a line of the program without an answer. Returns false for lines of others.
    pub(super) fn end_line(&mut self, result: Result<(), LineError>, text: &mut Text) -> bool {
        let is_executing = core::mem::take(&mut self.is_executing);
        if is_executing && result.is_err() {
            self.stop();
            report::feedback(text, Feedback::StoredProgramRefused);
        }
        is_executing
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
