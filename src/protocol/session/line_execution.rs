//! The line in execution: its text, the result of its check, and its commands.

use crate::{
    axis::{AXES, Axes},
    gcode::{
        LineError, PlainPrefix,
        interpreter::{CheckedLine, Hint, Interpreter, LineCommands, Message},
    },
    machine::Snapshot,
    model::{Alarm, Command, FeedRate, Levels, PathControl, Probing, Spindle, State},
    path::{OutsideTravel, TiltedArc, Work, is_axis_outside, is_outside, leaves_travel},
    protocol::{
        line::Line,
        report::{self, Feedback},
        text::Text,
    },
    settings::{Origins, Settings, Stored, StoredLine, TOOL_CHANGE_IGNORED},
    units::Nm,
};

use super::{CutterPath, persistence::NewRecord, stage::AfterCommands};

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

/// The line in execution, and what executes it.
#[derive(Debug)]
#[repr(C)]
pub(super) struct LineExecution {
    pub(super) interpreter: Interpreter,
    pub(super) source: Source,
    /// What follows the commands of the line.
    pub(super) after_commands: Option<AfterCommands>,
    /// The result of the last check.
    pub(super) checked: CheckedLine,
    /// The plain words that the line begins with.
    pub(super) prefix: PlainPrefix,
    /// The line as received.
    pub(super) input: Line,
    /// The commands of the line.
    pub(super) outcome: LineCommands,
    /// Whether these are compensated.
    pub(super) is_compensated: bool,
    /// The arc of which chords are being sent.
    pub(super) tilted: Option<TiltedArc>,
    /// The command in whose place those of the holes are sent, of a line that drills.
    pub(super) drilling: Option<usize>,
}

impl LineExecution {
    /// No line, with offsets that are stored.
    pub(super) fn new(origins: &Origins) -> Self {
        let mut interpreter = Interpreter::new();
        interpreter.set_origins(origins);
        Self {
            interpreter,
            source: Source::Line,
            after_commands: None,
            checked: CheckedLine::default(),
            prefix: PlainPrefix::default(),
            input: Line::new(),
            outcome: LineCommands::default(),
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

    /// Returns whether the machine has to wait for a tool before it executes the line.
    pub(super) fn needs_tool(&self, machine: &Snapshot, settings: &Settings) -> bool {
        self.checked.changes_tool()
            && machine.state != State::Check
            && settings.tool_change != TOOL_CHANGE_IGNORED
    }

    /// Returns whether the line needs a spindle that nobody has switched on after a change of the tool.
    pub(super) fn lacks_spindle(&self, machine: &Snapshot) -> bool {
        self.interpreter.lacks_spindle(&self.checked) && machine.state != State::Check
    }

    /// Pauses before the line, which is dispatched again then.
    pub(super) fn pause_without_spindle(&mut self) {
        self.interpreter.pause_without_spindle(&mut self.outcome);
        self.follow_own_commands(AfterCommands::Again);
    }

    /// Notes what follows commands of the session's own. An earlier line may have ended within a cycle or a tilted arc.
    pub(super) fn follow_own_commands(&mut self, after_commands: AfterCommands) {
        self.tilted = None;
        self.drilling = None;
        self.after_commands = Some(after_commands);
    }

    /// Puts the line into effect that has been checked.
    pub(super) fn commit(&mut self, machine: &Snapshot) {
        self.interpreter.commit(&self.checked, &mut self.outcome);
        if machine.state == State::Alarm {
            // A locked machine passes no time; nothing moves for which to wait.
            let is_dwell = |command: &Command| matches!(command, Command::Dwell { .. });
            self.outcome.commands.retain(|command| !is_dwell(command));
        }
    }

    /// Finds what is made of the commands, which begin at a position, while they are sent: chords and holes.
    pub(super) fn find_parts(&mut self, from: &Axes<Nm>, settings: &Settings) {
        let mut commands = self.outcome.commands.iter();
        self.tilted = commands.find_map(|command| TiltedArc::of(command, from, settings));
        let is_move = |command: &Command| matches!(command, Command::Line { .. });
        let drilling = self.outcome.commands.iter().position(is_move);
        self.drilling = drilling.filter(|_| self.checked.drills());
    }

    /// Returns what follows the commands, some of which may wait behind a move.
    pub(super) fn end_of_commands(
        &self,
        machine: &Snapshot,
        cutter_path: &CutterPath,
    ) -> Option<AfterCommands> {
        let checked = &self.checked;
        if self.outcome.message == Some(Message::ProgramEnd) {
            Some(AfterCommands::Message(Feedback::ProgramEnd))
        } else if machine.state == State::Check {
            None
        } else if checked.probing().is_some() {
            Some(AfterCommands::Probe)
        } else {
            // Outputs that switch at standstill have switched when the answer comes.
            let mut commands = self.outcome.commands.iter();
            let switches =
                !checked.moves() && commands.any(|command| !matches!(command, Command::Speed(_)));
            // A startup line is stored when its motion is over.
            let is_stored = matches!(self.source, Source::NewStartup { .. });
            let is_switched = switches || checked.answers_when_done();
            let waits = cutter_path.waits_after_move(checked);
            (is_stored || is_switched && !waits).then_some(AfterCommands::Answer)
        }
    }

    /// Returns the startup line that is to be stored before it is executed.
    pub(super) fn new_startup(&self) -> Option<NewRecord<'static>> {
        match self.source {
            Source::NewStartup {
                number,
                start,
                is_stored: false,
            } => {
                let text = self.input.text().unwrap_or_default();
                let line = StoredLine::from_slice(text.get(start..).unwrap_or_default());
                // Too long a line has been refused before.
                Some(NewRecord::Startup(number, line.unwrap_or_default()))
            }
            _ => None,
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
    pub(super) fn path_control(&self) -> PathControl {
        if self.source == Source::Jog || self.drilling.is_some() {
            PathControl::ExactPath
        } else {
            self.interpreter.modal().path
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
    pub(super) fn take_drilling_command(&mut self, number: usize) -> bool {
        let next = self.interpreter.next_drilling_command();
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
        settings: &Settings,
    ) -> bool {
        // A jog has been checked before.
        if !settings.soft_limits || self.source == Source::Jog {
            return false;
        }
        let is_checking = machine.state == State::Check;
        let mut corners = self.interpreter.drilling_corners();
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

    /// Checks the line.
    ///
    /// # Errors
    /// As [`Interpreter::check_after`] and [`Self::check_jog`].
    pub(super) fn check(
        &mut self,
        stored: &Stored,
        cutter_path: &CutterPath,
    ) -> Result<(), LineError> {
        let text = self.input.text().unwrap_or_default();
        let line = match self.source {
            Source::Line => text,
            Source::Jog => {
                let cutter = cutter_path.cutter(&self.interpreter);
                return self.check_jog(&stored.settings, cutter);
            }
            Source::NewStartup { start, .. } => text.get(start..).unwrap_or_default(),
            Source::Startup { number, .. } => match stored.startup.get(number) {
                Some(line) => line.as_slice(),
                None => &[],
            },
        };
        let none = PlainPrefix::default();
        let is_read = self.source == Source::Line;
        let prefix = if is_read { &self.prefix } else { &none };
        self.checked = self
            .interpreter
            .check_after(prefix, line, &stored.settings)?;
        Ok(())
    }

    /// Reports what a refused line lacks, where that can be said.
    #[cold]
    pub(super) fn write_hint(&self, error: LineError, settings: &Settings, message: &mut Text) {
        let text = self.input.text().unwrap_or_default();
        let hint = self.interpreter.hint(&self.prefix, text, settings, error);
        match hint {
            Some(Hint::MissingWord(letter)) => report::missing_word(message, letter),
            Some(Hint::AbsoluteCentre) => report::absolute_centre(message),
            None => {}
        }
    }

    /// Checks a jog. After `G40` the jog begins where the cutter is, if in another place, unless the jog is refused.
    ///
    /// # Errors
    /// As [`Interpreter::check_jog`], and 15 for a
    /// target beyond soft limits.
    fn check_jog(
        &mut self,
        settings: &Settings,
        cutter: Option<Axes<Nm>>,
    ) -> Result<(), LineError> {
        let line = self.input.text().unwrap_or_default();
        let line = line.get(3..).unwrap_or_default();
        let shortened = if settings.shortens_jogs {
            self.interpreter.homed_axes()
        } else {
            0
        };
        let is_axis_beyond = |axis: usize, target: &Axes<Nm>| {
            shortened >> axis & 1 == 0 && is_axis_outside(settings, axis, target[axis])
        };
        let is_beyond = |target: &Axes<Nm>| {
            settings.soft_limits && (0..AXES).any(|axis| is_axis_beyond(axis, target))
        };
        let checked = if let Some(cutter) = cutter {
            self.interpreter
                .check_jog_off_path(line, settings, cutter, is_beyond)
        } else {
            self.interpreter.check_jog(line, settings)
        };
        self.checked = checked?;
        if is_beyond(&self.checked.target().position) {
            return Err(LineError::JogBeyondTravel);
        }
        Ok(())
    }

    /// Returns where the line, which begins at a position, leaves the travel.
    #[cold]
    pub(super) fn outside_travel(
        &self,
        from: Axes<Nm>,
        settings: &Settings,
    ) -> Option<OutsideTravel> {
        let mut corners = self.interpreter.drilling_corners();
        let mut from = from;
        let mut commands = self.outcome.commands.iter();
        let drills = self.checked.drills();
        let of_hole = corners.find_map(|corner| OutsideTravel::at(settings, &corner));
        of_hole.filter(|_| drills).or_else(|| {
            commands.find_map(|command| {
                let start = from;
                if let Some(target) = command.moved_to() {
                    from = target.position;
                }
                OutsideTravel::on_path(settings, &start, command)
            })
        })
    }

    /// Returns the work that switches the power of a laser at constant power, for a move without a step: no block
    /// carries it.
    pub(super) fn power_without_steps(
        &mut self,
        feed_rate: FeedRate,
        laser_rpm: Option<f32>,
    ) -> Option<Work> {
        let rpm = laser_rpm.filter(|_| !matches!(feed_rate, FeedRate::Jog(_)))?;
        let after_commands = &mut self.after_commands;
        *after_commands = after_commands.or(Some(AfterCommands::Answer));
        Some(Work::Spindle(Spindle::Clockwise, rpm))
    }

    /// Returns the work that replaces a move without a step.
    pub(super) fn work_without_steps(
        &mut self,
        machine: &Snapshot,
        number: usize,
        laser_rpm: Option<f32>,
    ) -> Option<Work> {
        let probing = match self.outcome.commands.get(number)? {
            Command::Line { feed_rate, .. } | Command::Arc { feed_rate, .. } => {
                let feed_rate = *feed_rate;
                return self.power_without_steps(feed_rate, laser_rpm);
            }
            Command::Probe { probing, .. } => *probing,
            _ => return None,
        };
        // The probe cannot change in a move of length 0.
        match probing {
            Probing::Probe { is_away, .. } if machine.inputs.has(Levels::PROBE) != is_away => {
                Some(Work::Fault(Alarm::ProbeState))
            }
            Probing::Probe { may_miss, .. } => {
                self.after_commands = Some(AfterCommands::Miss);
                (!may_miss).then_some(Work::Fault(Alarm::ProbeContact))
            }
            Probing::LimitSwitch => {
                self.after_commands = Some(AfterCommands::Answer);
                None
            }
        }
    }
}
