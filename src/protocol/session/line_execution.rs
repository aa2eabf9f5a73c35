//! The line in execution: what it asks for, and what of it has been sent.

use crate::{
    axis::Axes,
    gcode::{
        PlainPrefix,
        interpreter::{Checked, Interpreter, Message, Outcome},
    },
    machine::Snapshot,
    model::{Command, PathControl, State},
    path::{TiltedArc, is_outside, leaves_travel},
    protocol::{
        line::Line,
        report::{self, Feedback},
        text::Text,
    },
    settings::Settings,
    units::Nm,
};

use super::stage::AfterCommands;

/// The origin of the line in execution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// The sender.
    Line,
    /// The sender, after `$J=`.
    Jog,
    /// The sender, after `$Nn=`: to be stored as startup line `number`, from byte `start` on, and
    /// then executed.
    NewStartup {
        number: usize,
        start: usize,
        is_stored: bool,
    },
    /// This startup line. Afterwards the `ok` of `$H` is due, or nothing.
    Startup { number: usize, is_homed: bool },
}

/// The line in execution.
#[derive(Debug)]
pub(super) struct LineExecution {
    pub(super) source: Source,
    /// What follows the commands of the line.
    pub(super) after_commands: Option<AfterCommands>,
    /// The result of the last check.
    pub(super) checked: Checked,
    /// The plain words that the line begins with.
    pub(super) prefix: PlainPrefix,
    /// The line as received.
    pub(super) input: Line,
    /// The commands of the line.
    pub(super) outcome: Outcome,
    /// Whether these are compensated.
    pub(super) is_compensated: bool,
    /// The arc of which chords are being sent.
    pub(super) tilted: Option<TiltedArc>,
    /// The command in whose place those of the holes are sent, of a line that drills.
    pub(super) drilling: Option<usize>,
}

impl LineExecution {
    /// No line.
    pub(super) fn new() -> Self {
        Self {
            source: Source::Line,
            after_commands: None,
            checked: Checked::default(),
            prefix: PlainPrefix::default(),
            input: Line::new(),
            outcome: Outcome::default(),
            is_compensated: false,
            tilted: None,
            drilling: None,
        }
    }

    /// Returns the message of the line, or nothing. A pause has any comment for one.
    pub(super) fn operator_text(&self, is_pause: bool) -> &[u8] {
        match (self.source == Source::Line, is_pause) {
            (false, _) => &[],
            (true, true) => self.input.comment_text(),
            (true, false) => self.input.message(),
        }
    }

    /// Returns whether the line in execution ends the program.
    pub(super) fn ends_program(&self) -> bool {
        let is_code = match self.source {
            Source::Line => !self.input.text().unwrap_or_default().starts_with(b"$"),
            Source::Startup { .. } | Source::NewStartup { .. } => true,
            Source::Jog => false,
        };
        is_code && self.checked.ends_program()
    }

    /// Says what the line has to tell before its answer.
    pub(super) fn write_outcome(&self, text: &mut Text, settings: &Settings) {
        let outcome = &self.outcome;
        match outcome.message {
            Some(Message::EmptyToolTable) => report::feedback(text, Feedback::EmptyToolTable),
            Some(Message::LongDwell { seconds }) => report::long_dwell(text, seconds),
            Some(Message::ProgramEnd) | None => {}
        }
        if outcome.lacks_speed && !settings.laser && !settings.spindle_relay {
            report::feedback(text, Feedback::NoSpindleSpeed);
        }
        if outcome.ends_before_switch {
            report::feedback(text, Feedback::EndsBeforeSwitch);
        }
    }

    /// Returns the path control of the line in execution: jogs keep to their path.
    pub(super) fn path_control(&self, interpreter: &Interpreter) -> PathControl {
        if self.source == Source::Jog || self.drilling.is_some() {
            PathControl::ExactPath
        } else {
            interpreter.modal().path
        }
    }

    /// Replaces a tilted arc by its next chord.
    pub(super) fn take_chord(&mut self, number: usize) {
        if let Some(arc) = &mut self.tilted
            && let Some(command @ (Command::Arc { .. } | Command::Line { .. })) =
                self.outcome.commands.get_mut(number)
            && let Some(chord) = arc.next_chord()
        {
            *command = chord;
        }
    }

    /// Returns whether another chord follows in the place of a command.
    pub(super) fn has_chord(&self, number: usize) -> bool {
        self.tilted.as_ref().is_some_and(TiltedArc::has_more)
            && matches!(
                self.outcome.commands.get(number),
                Some(Command::Arc { .. } | Command::Line { .. })
            )
    }

    /// Replaces a command by the next one of a line that drills. Returns false after the last.
    pub(super) fn take_drilling_command(
        &mut self,
        number: usize,
        interpreter: &mut Interpreter,
    ) -> bool {
        let next = interpreter.next_drilling_command();
        match (next, self.outcome.commands.get_mut(number)) {
            (Some(next), Some(command)) => {
                *command = next;
                true
            }
            (_, _) => false,
        }
    }

    /// Returns whether some move of the line leaves the travel of the machine, where that is an error.
    pub(super) fn leaves_travel(
        &self,
        machine: &Snapshot,
        from: Axes<Nm>,
        interpreter: &Interpreter,
        settings: &Settings,
    ) -> bool {
        // A jog has been checked before.
        if !settings.soft_limits || self.source == Source::Jog {
            return false;
        }
        let is_checking = machine.state == State::Check;
        let mut corners = interpreter.drilling_corners();
        if self.checked.drills() && corners.any(|corner| is_outside(settings, &corner)) {
            return true;
        }
        let mut from = from;
        self.outcome.commands.iter().any(|command| {
            // Check mode ends a probing move before it has begun.
            let is_skipped = is_checking && matches!(command, Command::Probe { .. });
            let leaves = !is_skipped && leaves_travel(settings, &from, command);
            if let Some(target) = command.moved_to() {
                from = target.position;
            }
            leaves
        })
    }
}
