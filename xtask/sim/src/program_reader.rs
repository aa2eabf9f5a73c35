//! From the lines of a program to its commands.
//!
//! The lines go to an interpreter of their own, which nothing but its text reaches: what the motion has
//! made of a program can be compared with the program.

use leadscrew::{
    gcode::interpreter::{Interpreter, Outcome},
    model::Command,
    protocol::{Line, Session},
    settings::{Settings, assign},
};

/// Reads a program as the machine does.
pub(crate) struct ProgramReader {
    interpreter: Interpreter,
    settings: Settings,
    line: Line,
    /// Something has moved the machine that only the machine knows the end of.
    is_lost: bool,
}

impl ProgramReader {
    /// For a machine at the origin that has nothing stored but these settings.
    #[cfg(test)]
    pub(crate) fn new(settings: &Settings) -> Self {
        Self::with(Interpreter::new(), settings)
    }

    /// For a machine as it is now: with its tools and stored offsets.
    pub(crate) fn of(session: &Session) -> Self {
        Self::with(session.interpreter().clone(), session.settings())
    }

    fn with(interpreter: Interpreter, settings: &Settings) -> Self {
        Self {
            interpreter,
            settings: *settings,
            line: Line::new(),
            is_lost: false,
        }
    }

    /// Whether the path is unknown from here on: after homing, probing, or check mode.
    pub(crate) fn is_lost(&self) -> bool {
        self.is_lost
    }

    pub(crate) fn interpreter(&self) -> &Interpreter {
        &self.interpreter
    }

    pub(crate) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The commands of the next line, all of its holes if it drills. One that is refused has none.
    pub(crate) fn line(&mut self, line: &[u8]) -> Vec<Command> {
        self.line.clear();
        let bytes = line.iter().copied().chain([b'\n']);
        let text = if self.line.take_from(bytes) {
            self.line.text().unwrap_or_default().to_vec()
        } else {
            Vec::new()
        };
        if self.is_lost {
            return Vec::new();
        }
        let checked = if let Some(jog) = text.strip_prefix(b"$J=") {
            self.interpreter.check_jog(jog, &self.settings)
        } else if let Some(statement) = text.strip_prefix(b"$") {
            // A refused assignment changes nothing here either.
            let _ = assign(&mut self.settings, statement);
            self.is_lost = statement.starts_with(b"H") || statement == b"C";
            return Vec::new();
        } else {
            self.interpreter.check(&text, &self.settings)
        };
        let Ok(checked) = checked else {
            return Vec::new();
        };
        let mut outcome = Outcome::default();
        self.interpreter.commit(&checked, &mut outcome);
        let is_move = |command: &Command| matches!(command, Command::Line { .. });
        let drilling = outcome.commands.iter().position(is_move);
        let mut commands = outcome.commands.to_vec();
        if let Some(index) = drilling.filter(|_| checked.drills()) {
            let holes = std::iter::from_fn(|| self.interpreter.next_drilling_command());
            commands.splice(index..=index, holes.collect::<Vec<_>>());
        }
        let probes = |command: &Command| matches!(command, Command::Probe { .. });
        self.is_lost = commands.iter().any(probes);
        commands
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_drills_has_the_commands_of_its_holes() {
        let mut reader = ProgramReader::new(&Settings::default());
        reader.line(b"G0 Z10 F100");
        let commands = reader.line(b"M3 S500 G91 G81 X5 Z-3 R-8 L2");
        let lines = commands
            .iter()
            .filter(|command| matches!(command, Command::Line { .. }));
        // Over the hole, down to R, down, out.
        assert_eq!(lines.count(), 8);
        assert!(matches!(commands[0], Command::Spindle { .. }));
    }

    #[test]
    fn the_path_is_lost_where_only_the_machine_knows_its_end() {
        for text in ["$H", "G38.2 Z-5 F100", "$C"] {
            let mut reader = ProgramReader::new(&Settings::default());
            reader.line(b"G1 X1 F100");
            assert!(!reader.is_lost());
            reader.line(text.as_bytes());
            assert!(reader.is_lost(), "{text}");
            assert!(reader.line(b"G1 X1 F100").is_empty());
        }
    }
}
