//! A program on the firmware's interpreter alone: the modes, offsets and the position before each line.

use leadscrew::{
    axis::{AXES, LETTERS, X, Y},
    gcode::{
        MotionMode,
        interpreter::{Interpreter, LineCommands},
    },
    model::Command,
    protocol::Line,
    settings::{Settings, TOOL_CHANGE_IGNORED, assign},
};

/// What a line does.
#[derive(Debug, PartialEq)]
pub(crate) enum Effect {
    /// Commands to the machine.
    Commands(Vec<Command>),
    /// Nothing: it is refused.
    Refused,
    /// Something of which only the machine knows where these axes end: homing, probing, a jog.
    Lost([bool; AXES]),
}

/// An interpreter that reads lines.
#[derive(Debug, Clone)]
pub(crate) struct Replay {
    pub(crate) interpreter: Interpreter,
    settings: Settings,
}

impl Replay {
    pub(crate) fn new(interpreter: Interpreter, settings: Settings) -> Self {
        Self {
            interpreter,
            settings,
        }
    }

    /// Reads a line.
    pub(crate) fn read(&mut self, line: &[u8]) -> Effect {
        let mut received = Line::new();
        if !received.take_from(line.iter().copied().chain([b'\n'])) {
            return Effect::Refused;
        }
        let Ok(text) = received.text() else {
            return Effect::Refused;
        };
        if let Some(statement) = text.strip_prefix(b"$") {
            if statement.starts_with(b"H") || statement.starts_with(b"J") {
                return Effect::Lost([true; AXES]);
            }
            // A refused assignment changes nothing here either.
            let _ = assign(&mut self.settings, statement);
            return Effect::Commands(Vec::new());
        }
        let Ok(checked) = self.interpreter.check(text, &self.settings) else {
            return Effect::Refused;
        };
        let was_compensated = self.interpreter.is_off_path();
        let mut outcome = LineCommands::default();
        if checked.changes_tool() && self.settings.tool_change != TOOL_CHANGE_IGNORED {
            let tool = checked.loaded_tool();
            let interrupted = self
                .interpreter
                .begin_tool_change(&checked, None, &mut outcome);
            self.interpreter
                .return_from_tool_change(&interrupted, tool, &mut outcome);
            self.interpreter.end_tool_change(&interrupted);
        }
        // After a change of the tool, the rest of the line.
        let Ok(checked) = self.interpreter.check(text, &self.settings) else {
            return Effect::Refused;
        };
        self.interpreter.commit(&checked, &mut outcome);
        let mut commands = outcome.commands.to_vec();
        while let Some(command) = self.interpreter.next_drilling_command() {
            commands.push(command);
        }
        if was_compensated && checked.ends_program() {
            return Effect::Lost([true; AXES]);
        }
        if checked.probing().is_some() {
            return Effect::Lost(probed_axes(text));
        }
        Effect::Commands(commands)
    }

    /// Whether a job may be continued here: outside of compensated contours and of cycles.
    pub(crate) fn may_begin(&self) -> bool {
        let interpreter = &self.interpreter;
        !interpreter.is_compensating()
            && !interpreter.is_off_path()
            && !matches!(interpreter.modal().motion, MotionMode::Cycle(_))
    }
}

/// The axes that a probing move may move: the others stay where they are. X and Y belong together, as the
/// work coordinates may be rotated.
fn probed_axes(text: &[u8]) -> [bool; AXES] {
    let mut probed: [bool; AXES] = std::array::from_fn(|axis| text.contains(&LETTERS[axis]));
    let is_in_plane = probed[X] || probed[Y];
    (probed[X], probed[Y]) = (is_in_plane, is_in_plane);
    probed
}
