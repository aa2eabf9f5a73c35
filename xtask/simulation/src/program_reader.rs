//! From the lines of a program to its commands.
//!
//! The reader has its own interpreter and its own cutter compensation. Only the text of the program reaches the
//! reader, so that the motion can be compared with the program.

use leadscrew::{
    gcode::{
        LineError,
        interpreter::{CheckedLine, CompensatedMove, Interpreter, LineCommands},
    },
    model::Command,
    path::Compensator,
    protocol::{Line, Session},
    settings::{Settings, TOOL_CHANGE_IGNORED, assign},
};

/// Reads a program as the machine does.
pub struct ProgramReader {
    interpreter: Interpreter,
    settings: Settings,
    line: Line,
    compensator: Compensator,
    /// The move of the last line as it is programmed, where it is compensated.
    programmed: Option<CompensatedMove>,
    /// The tool for which the machine waits in the last line.
    changed_tool: Option<u8>,
    /// Something has moved the machine that only the machine knows the end of.
    is_lost: bool,
}

impl ProgramReader {
    /// For a machine at the origin that has nothing stored but these settings.
    pub fn new(settings: &Settings) -> Self {
        Self::with(Interpreter::new(), settings)
    }

    /// For a machine as it is now: with its tools and stored offsets.
    pub fn of(session: &Session) -> Self {
        Self::with(session.interpreter().clone(), session.settings())
    }

    fn with(interpreter: Interpreter, settings: &Settings) -> Self {
        Self {
            interpreter,
            settings: *settings,
            line: Line::new(),
            compensator: Compensator::new(),
            programmed: None,
            changed_tool: None,
            is_lost: false,
        }
    }

    /// Whether the path is unknown from here on: after homing, probing, or check mode.
    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// What reads the lines.
    pub fn interpreter(&self) -> &Interpreter {
        &self.interpreter
    }

    /// The settings, with what the program has changed of them.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The move of the last line as it is programmed, where the cutter goes beside it.
    pub fn programmed(&self) -> Option<&CompensatedMove> {
        self.programmed.as_ref()
    }

    /// The tool that the last line has the operator put in.
    pub fn changed_tool(&self) -> Option<u8> {
        self.changed_tool
    }

    /// The commands of the next line, with every hole of a drilling cycle and with the commands of a move that has
    /// waited for the line. A refused line has no commands.
    pub fn line(&mut self, line: &[u8]) -> Vec<Command> {
        self.programmed = None;
        self.changed_tool = None;
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
            self.check_jog(jog)
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
        self.compensator.drop_plan();
        let programmed = self.interpreter.compensated_move(&checked);
        let farthest = self.settings.farthest();
        let misfit = programmed.map(|one| self.compensator.plan(&one, &farthest));
        if misfit.is_some_and(|planned| planned.is_err()) {
            return Vec::new();
        }
        self.programmed = programmed;
        let waits = checked.changes_tool() && self.settings.tool_change != TOOL_CHANGE_IGNORED;
        self.changed_tool = waits.then(|| checked.loaded_tool());
        let mut outcome = LineCommands::default();
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
        self.compensated(&checked, commands)
    }

    /// The commands of a line behind cutter compensation, in the order in which the session sends them.
    fn compensated(&mut self, checked: &CheckedLine, mut commands: Vec<Command>) -> Vec<Command> {
        let compensator = &mut self.compensator;
        let is_compensated = checked.follows_contour() || compensator.has_plan();
        let is_over = !is_compensated || checked.stops_program() && !compensator.has_plan();
        let mut released = Vec::new();
        let mut release = |compensator: &mut Compensator| {
            while let Some(command) = compensator.front() {
                released.push(command);
                compensator.dequeue();
            }
        };
        if is_over && compensator.is_waiting() {
            compensator.release();
            release(compensator);
        }
        let is_on_offset_path = is_compensated || checked.stays_off_path();
        if is_compensated {
            for command in commands.drain(..) {
                compensator.push(&command, checked.path_control());
                release(compensator);
            }
        }
        if checked.ends_program() && is_on_offset_path {
            self.interpreter.set_position(compensator.end());
        }
        released.append(&mut commands);
        released
    }

    /// A jog begins where the cutter is.
    fn check_jog(&mut self, line: &[u8]) -> Result<CheckedLine, LineError> {
        let interpreter = &mut self.interpreter;
        if interpreter.is_off_path() && !interpreter.is_compensating() {
            let tool = self.compensator.end();
            interpreter.check_jog_off_path(line, &self.settings, tool, |_| false)
        } else {
            interpreter.check_jog(line, &self.settings)
        }
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
    fn a_compensated_line_has_the_commands_of_the_move_before_it() {
        let mut reader = ProgramReader::new(&Settings::default());
        let mut ends = |line: &str| -> Vec<[i64; 2]> {
            let commands = reader.line(line.as_bytes());
            let ends = commands.iter().filter_map(|command| match command {
                Command::Line { target, .. } | Command::Arc { target, .. } => {
                    Some([0, 1].map(|axis| target.position[axis].0 / 1_000_000))
                }
                _ => None,
            });
            ends.collect()
        };
        assert_eq!(ends("G41.1 D4 F100"), [[0; 2]; 0]);
        assert_eq!(ends("G1 X10"), [[0; 2]; 0]);
        // Inside of a corner, and around one.
        assert_eq!(ends("Y10"), [[8, 2]]);
        assert_eq!(ends("X-10"), [[8, 8]]);
        // The tool does not fit.
        assert_eq!(ends("G3 X-11 Y9 I0 J-1"), [[0; 2]; 0]);
        assert_eq!(ends("G1 Y20"), [[-10, 8], [-12, 10]]);
        assert_eq!(ends("G40 X-20"), [[-12, 20], [-20, 20]]);
        // A line that is shorter than its part that the corner before removes.
        for line in ["G41.1 D4", "X-30 Y20", "Y25"] {
            ends(line);
        }
        assert_eq!(ends("X-31"), [[0; 2]; 0]);
        assert_eq!(ends("G40"), [[-32, 25]]);
    }

    #[test]
    fn a_line_that_changes_the_tool_tells_which() {
        let mut reader = ProgramReader::new(&Settings::default());
        let tools = ["T3", "M6 G0 X1", "M6 T5", "M61 Q2", "X2"].map(|line| {
            reader.line(line.as_bytes());
            reader.changed_tool()
        });
        assert_eq!(tools, [None, Some(3), Some(5), None, None]);
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
