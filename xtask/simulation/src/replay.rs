//! A program on the firmware's interpreter alone: the modes, offsets and the position before each line.

use leadscrew::{
    axis::{AXES, Axes, LETTERS, X, Y},
    gcode::{
        LineError, MotionMode,
        interpreter::{Interpreter, LineCommands},
    },
    model::Command,
    path::OutsideTravel,
    protocol::Line,
    settings::{Settings, TOOL_CHANGE_IGNORED, assign},
    units::Nm,
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
    /// How far from the end of a probing move the contact is, in each of its axes; `None` where that is not known.
    contact: Option<Nm>,
}

impl Replay {
    pub(crate) fn new(interpreter: Interpreter, settings: Settings) -> Self {
        Self {
            interpreter,
            settings,
            contact: None,
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
                return self.lose([true; AXES]);
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
            return self.lose([true; AXES]);
        }
        if checked.probing().is_some() {
            let lost = self.lose(probed_axes(text));
            let contact = self.interpreter.position();
            let origins = self.interpreter.origins_after_contact(&checked, &contact);
            if let Some(origins) = origins.filter(|_| self.contact.is_some()) {
                self.interpreter.set_origins(&origins);
            }
            return lost;
        }
        Effect::Commands(commands)
    }

    /// Only the machine knows where these axes are.
    fn lose(&mut self, axes: [bool; AXES]) -> Effect {
        let distance = self.contact.unwrap_or_default();
        let position = self.interpreter.position();
        let contact = |axis: usize| position[axis] + Nm(distance.0 * i64::from(axes[axis]));
        self.interpreter.set_position(Axes::from_fn(contact));
        Effect::Lost(axes)
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

/// A program of which each probing move makes contact at two places: what differs depends on the contact.
pub(crate) struct TwoContacts([Replay; 2]);

impl TwoContacts {
    /// A program that an interpreter begins.
    pub(crate) fn new(interpreter: &Interpreter, settings: Settings) -> Self {
        Self([0, 7_123_457].map(|distance_nm| Replay {
            contact: Some(Nm(distance_nm)),
            ..Replay::new(interpreter.clone(), settings)
        }))
    }

    /// The settings before the next line.
    pub(crate) fn settings(&self) -> &Settings {
        &self.0[0].settings
    }

    /// Reads a line.
    pub(crate) fn read(&mut self, line: &[u8]) -> ReadLine {
        let interpreter = &self.0[0].interpreter;
        let (first, second, _) = interpreter.modal().plane.axes();
        let (from, before) = (interpreter.position(), self.unknown());
        let [effect, other] = self.0.each_mut().map(|reader| reader.read(line));
        let after = self.unknown();
        let mut read = ReadLine {
            outside: None,
            decides: (effect == Effect::Refused) != (other == Effect::Refused),
            decides_arc: before[first] || before[second],
        };
        let mut known = *self.settings();
        if let Effect::Commands(commands) = &effect
            && known.soft_limits
        {
            // The end of a straight move is all that soft limits look at.
            let is_straight = matches!(commands[..], [Command::Line { .. }]);
            for axis in (0..AXES).filter(|axis| after[*axis] || !is_straight && before[*axis]) {
                known.max_travel_mm[axis] = 0.0;
            }
            let mut from = from;
            read.outside = commands.iter().find_map(|command| {
                let outside = OutsideTravel::on_path(&known, &from, command);
                from = command.moved_to().map_or(from, |target| target.position);
                outside
            });
        }
        read
    }

    /// The axes of which the position depends on a contact.
    fn unknown(&self) -> [bool; AXES] {
        let position = |reader: &Replay| reader.interpreter.position();
        let [one, other] = self.0.each_ref().map(position);
        std::array::from_fn(|axis| one[axis] != other[axis])
    }
}

/// A line of such a program.
pub(crate) struct ReadLine {
    /// Where it leaves the travel, whatever the contacts are.
    pub(crate) outside: Option<OutsideTravel>,
    /// A contact decides that it is refused.
    decides: bool,
    /// A contact decides where an arc would begin.
    decides_arc: bool,
}

impl ReadLine {
    /// Whether a contact decides that the line is refused with an error.
    pub(crate) fn decides_refusal(&self, number: u16) -> bool {
        let mut of_arcs = [LineError::InvalidTarget, LineError::ArcRadius].into_iter();
        let is_of_arc = of_arcs.any(|error| u16::from(error.number()) == number);
        self.decides || self.decides_arc && is_of_arc
    }
}
