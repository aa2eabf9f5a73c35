//! Lines to commands: units, offsets, planes, arcs, program flow.
//!
//! Owns the modal state, the offsets and the programmed position. A line is taken in two phases:
//! [`Interpreter::check`] finds every error and changes nothing, [`Interpreter::commit`] cannot
//! fail. Between them the caller waits for what the line needs: room, or standstill. Read with
//! NIST RS274NGC 3 (order of execution: table 8) and Grbl 1.1's errors.
//!
//! # Cost
//! [`Interpreter`] is laid out in the order of its fields: those that each line needs come first.

mod arc;
mod check;
mod checked;
mod commit;
mod compensation;
mod cycle;
mod drilling;
mod home;
mod offsets;
mod plain;
mod power;
mod reach;
mod targets;
mod tool_change;
mod tools;

pub(in crate::gcode) use check::is_program_mark;
use checked::{Action, LineKind, Move};
use compensation::Compensation;
use drilling::{CycleWords, Drilling};
use home::Home;
use offsets::Frame;

pub use checked::CheckedLine;
pub use compensation::CompensatedMove;
pub use offsets::Offsets;
pub use tool_change::Interrupted;

use heapless::Vec;

use super::{FeedMode, LineError, Modal, PlainPrefix, StoredPosition, Units};
use crate::{
    axis::Axes,
    model::{Command, Coolant, Spindle},
    settings::{Origins, Settings, ToolTable},
    units::Nm,
};

/// Most commands of one line: spindle, coolant, overrides, laser power, two moves (or a dwell and a
/// move), and at program end spindle and coolant again.
pub const COMMANDS: usize = 8;

/// The state that G-code lines change.
#[derive(Debug, Clone, PartialEq)]
#[repr(C)]
pub struct Interpreter {
    modal: Modal,
    /// The work coordinates in effect.
    frame: Frame,
    position: Axes<Nm>,
    /// The position in Grbl's single precision, mm, by which arcs are checked.
    single_mm: Axes<f32>,
    /// The work position under rotation: exact, so that incremental moves do not drift.
    work_position: Axes<Nm>,
    /// The tool in the spindle, 0 for none.
    loaded_tool: u8,
    /// A spindle, not a laser, has run in this program.
    has_run_spindle: bool,
    /// It has not been switched on since the tool was changed.
    lacks_spindle: bool,
    /// The program has had no `S`, nor has that been reported.
    wants_speed: bool,
    /// That a `G53` move of the program ends before a switch has been reported.
    has_reported_switch: bool,
    /// Plain lines are executed in the modes in effect: [`Self::execute_plain`].
    has_plain_modes: bool,
    /// `M1` is a program pause.
    stops_optionally: bool,
    offsets: Offsets,
    /// The words of the canned cycle that is the motion mode.
    cycle: CycleWords,
    /// The holes of the last line: not all commands of them may have been taken.
    drilling: Option<Drilling>,
    compensation: Compensation,
    tools: ToolTable,
    home: Home,
}

/// The commands and messages of a committed line.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LineCommands {
    /// The commands to execute, in order.
    pub commands: Vec<Command, COMMANDS>,
    /// The message before the line's `ok`, after the commands have been executed.
    pub message: Option<Message>,
    /// Whether the next status report shows the work offset, changed or not.
    pub shows_offset: bool,
    /// Whether the next status report shows the tool in the spindle.
    pub shows_tool: bool,
    /// Whether the line feeds with a spindle at speed 0, the first one of a program that has given no speed.
    pub lacks_speed: bool,
    /// Whether a `G53` move ends before a switch, the first one of a program.
    pub ends_before_switch: bool,
}

/// A message of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Message {
    /// `[MSG:Pgm End]`.
    ProgramEnd,
    /// `[MSG:Tool table is empty: tool length 0]`, as soon as the line is executed.
    EmptyToolTable,
    /// `[MSG:Dwell of 789 s]`, as soon as the line is executed.
    LongDwell {
        /// The dwell, s.
        seconds: u32,
    },
}

/// What a refused line lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hint {
    /// The word of a canned cycle, by its letter.
    MissingWord(u8),
    /// `G90.1`: its arc is one if `I`, `J` and `K` are absolute.
    AbsoluteCentre,
}

impl Interpreter {
    /// The power-up state: at the origin, all offsets zero.
    #[must_use]
    pub fn new() -> Self {
        Self {
            modal: Modal::default(),
            offsets: Offsets::default(),
            frame: Frame::MACHINE,
            position: Axes::all(Nm(0)),
            single_mm: Axes::all(0.0),
            loaded_tool: 0,
            has_run_spindle: false,
            lacks_spindle: false,
            wants_speed: true,
            has_reported_switch: false,
            has_plain_modes: true,
            stops_optionally: false,
            work_position: Axes::all(Nm(0)),
            tools: ToolTable::new(),
            cycle: CycleWords::default(),
            drilling: None,
            compensation: Compensation::default(),
            home: Home::NONE,
        }
    }

    /// Checks a line: upper case, without blanks and comments. Nothing changes.
    ///
    /// # Errors
    /// The first that Grbl would find. A target or offset that an axis cannot count
    /// ([`Settings::farthest`]) is [`LineError::InvalidTarget`].
    pub fn check(&self, line: &[u8], settings: &Settings) -> Result<CheckedLine, LineError> {
        self.check_after(&PlainPrefix::default(), line, settings)
    }

    /// Checks a line as [`Self::check`] does, of which [`Self::execute_plain`] has read the plain words.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn check_after(
        &self,
        prefix: &PlainPrefix,
        line: &[u8],
        settings: &Settings,
    ) -> Result<CheckedLine, LineError> {
        check::check(self, prefix, line, LineKind::Program, settings)
    }

    /// Returns what is missing in a line that [`Self::check_after`] has refused, if known.
    #[must_use]
    pub fn hint(
        &self,
        prefix: &PlainPrefix,
        line: &[u8],
        settings: &Settings,
        error: LineError,
    ) -> Option<Hint> {
        check::hint(self, prefix, line, settings, error)
    }

    /// Checks the text after `$J=`, as [`Self::check`] does with a line: a move along a line at its
    /// own feed, which changes nothing but the position.
    ///
    /// # Errors
    /// The first that Grbl would find; [`LineError::NoAxisWords`] for a jog without axis words.
    pub fn check_jog(&self, line: &[u8], settings: &Settings) -> Result<CheckedLine, LineError> {
        let prefix = PlainPrefix::default();
        check::check(self, &prefix, line, LineKind::Jog, settings)
    }

    /// The stored offsets and positions after a line that was checked; `None` where the line stores
    /// none.
    #[must_use]
    pub fn origins_after(&self, checked: &CheckedLine) -> Option<Origins> {
        let mut origins = self.offsets.origins;
        match checked.action {
            Action::None
            | Action::Dwell(_)
            | Action::SetAtContact { .. }
            | Action::GoTo(_)
            | Action::SetTool { .. }
            | Action::SetOffset
            | Action::ClearOffset
            | Action::SuspendOffset
            | Action::RestoreOffset => return None,
            Action::SetOrigin(system, rotation) => {
                origins.coordinates[system] = checked.values;
                origins.rotations[system] = rotation;
            }
            Action::Store(StoredPosition::G28) => origins.g28 = self.position,
            Action::Store(StoredPosition::G30) => origins.g30 = self.position,
        }
        Some(origins)
    }

    /// Returns the offsets and stored positions after the contact of a line that has been committed and probes
    /// with a `P`, by the machine position of the contact.
    #[must_use]
    pub fn origins_after_contact(
        &self,
        checked: &CheckedLine,
        contact: &Axes<Nm>,
    ) -> Option<Origins> {
        let Action::SetAtContact { axis, value } = checked.action else {
            return None;
        };
        let mut origins = self.offsets.origins;
        let origin = &mut origins.coordinates[self.modal.coordinates];
        *origin = targets::origin_with(origin, &self.frame, contact, (axis, value));
        Some(origins)
    }

    /// Executes a line that was checked against the present state. `outcome` is then that of the line.
    pub fn commit(&mut self, checked: &CheckedLine, outcome: &mut LineCommands) {
        commit::commit(self, checked, outcome);
    }

    /// Takes the next command of a line that drills; `None` after the last.
    pub fn next_drilling_command(&mut self) -> Option<Command> {
        let command = self.drilling.as_mut()?.next_command(&self.frame);
        if command.is_none() {
            self.drilling = None;
        }
        command
    }

    /// Machine positions between which all moves of a line that drills lie, before the first is taken.
    pub fn drilling_corners(&self) -> impl Iterator<Item = Axes<Nm>> {
        let corners = self.drilling.as_ref().map(Drilling::corners);
        corners
            .into_iter()
            .flatten()
            .map(|corner| self.frame.machine(&corner))
    }

    /// Back to the power-up modes; the position, the tool in the spindle, `G54` to `G59.3`, `G28` and
    /// `G30` stay.
    pub fn reset(&mut self) {
        self.modal = Modal::default();
        self.offsets = Offsets {
            origins: self.offsets.origins,
            remembered_work: self.offsets.remembered_work,
            ..Offsets::default()
        };
        self.compensation = Compensation::default();
        self.forget_program();
        self.update_frame();
        self.update_plain_modes();
    }

    /// The programmed position, in the machine frame.
    #[must_use]
    pub fn position(&self) -> Axes<Nm> {
        self.position
    }

    /// Replaces the stored offsets and positions.
    pub fn set_origins(&mut self, origins: &Origins) {
        self.offsets.origins = *origins;
        self.update_frame();
        self.update_plain_modes();
    }

    /// Finds out whether plain lines are executed in the modes in effect.
    fn update_plain_modes(&mut self) {
        let modal = &self.modal;
        self.has_plain_modes = modal.units == Units::Millimetres
            && modal.feed_units == Units::Millimetres
            && modal.feed_mode == FeedMode::PerMinute
            && self.frame.rotation.is_none()
            && !self.lacks_spindle
            && !self.lacks_speed()
            && self.compensation.is_without_effect();
    }

    /// Forgets what has been done with the spindle, and what has been reported: the program is over.
    fn forget_program(&mut self) {
        self.wants_speed = true;
        self.has_reported_switch = false;
        self.has_run_spindle = false;
        self.lacks_spindle = false;
    }

    /// Whether the spindle should run in the move of a line that was checked: it has before, and has not
    /// been switched on since the tool was changed.
    #[must_use]
    pub fn lacks_spindle(&self, checked: &CheckedLine) -> bool {
        self.lacks_spindle && checked.feeds() && checked.modal.spindle == Spindle::Off
    }

    /// Whether the spindle is on at speed 0 in a program that has given no speed, which has not been reported.
    fn lacks_speed(&self) -> bool {
        let modal = &self.modal;
        self.wants_speed && modal.spindle != Spindle::Off && modal.speed_rpm <= 0.0
    }

    /// Pauses because the spindle does not run, but once.
    pub fn pause_without_spindle(&mut self, outcome: &mut LineCommands) {
        self.lacks_spindle = false;
        self.update_plain_modes();
        outcome.clear();
        outcome.add(Command::Pause);
    }

    /// Puts the offsets and the work coordinate system into effect.
    fn update_frame(&mut self) {
        let offsets = &self.offsets;
        let frame = Frame::of(
            &offsets.origins,
            self.modal.coordinates,
            &offsets.work,
            &offsets.tool,
            &self.frame.rotation,
        );
        if frame != self.frame {
            self.frame = frame;
            self.update_work_position();
        }
    }

    /// Computes the work position of the present position, where it cannot be had from offsets alone.
    fn update_work_position(&mut self) {
        if !self.frame.rotation.is_none() {
            self.work_position = self.frame.work_position(&self.position);
        }
    }

    /// The tool in the spindle, 0 for none.
    #[must_use]
    pub fn loaded_tool(&self) -> u8 {
        self.loaded_tool
    }

    /// Replaces the tool in the spindle.
    pub fn set_loaded_tool(&mut self, tool: u8) {
        self.loaded_tool = tool;
    }

    /// Makes `M1` a program pause, or nothing.
    pub fn set_optional_stop(&mut self, is_on: bool) {
        self.stops_optionally = is_on;
    }

    /// Makes the present position of the axes of a mask, bit 0 = X, a work position, as `G92` does.
    pub fn place(&mut self, axes: u8, work: &Axes<Nm>) {
        let present = self.work_position();
        let before = self.offsets.work;
        self.offsets.work = Axes::from_fn(|axis| {
            if axes >> axis & 1 != 0 {
                before[axis] + present[axis] - work[axis]
            } else {
                before[axis]
            }
        });
        self.update_frame();
        self.update_plain_modes();
    }

    /// Sets the feed rate where none is set, mm/min.
    pub fn set_default_feed(&mut self, feed_mm_min: f32) {
        if self.modal.feed == 0.0 {
            self.modal.feed = feed_mm_min;
        }
    }

    /// The spindle has been switched off; the other modes stay.
    pub fn switch_spindle_off(&mut self) {
        self.modal.spindle = Spindle::Off;
    }

    /// Spindle and coolant have been switched off; the other modes stay.
    pub fn switch_off(&mut self) {
        self.switch_spindle_off();
        self.modal.coolant = Coolant::default();
    }

    /// Replaces the coolant's state, which has been switched by an override.
    pub fn set_coolant(&mut self, coolant: Coolant) {
        self.modal.coolant = coolant;
    }

    /// Makes the target of a line the programmed position.
    fn set_target(&mut self, checked: &CheckedLine) {
        self.position = checked.values;
        self.single_mm = checked.single_mm;
        self.work_position = checked.work_target;
    }

    /// Replaces the programmed position.
    pub fn set_position(&mut self, position: Axes<Nm>) {
        self.position = position;
        self.single_mm = position.map(Nm::to_mm);
        self.update_work_position();
    }

    /// Makes a work position the programmed position.
    fn set_work_position(&mut self, work: Axes<Nm>) {
        self.position = self.frame.machine(&work);
        self.single_mm = self.position.map(Nm::to_mm);
        self.work_position = work;
    }

    /// The programmed position, in the work coordinates in effect.
    fn work_position(&self) -> Axes<Nm> {
        if self.frame.rotation.is_none() {
            self.frame.work_position(&self.position)
        } else {
            self.work_position
        }
    }

    /// Machine position minus work position, at a machine position: under rotation it depends on the
    /// place.
    #[must_use]
    pub fn work_offset(&self, machine: &Axes<Nm>) -> Axes<Nm> {
        let work = self.frame.work_position(machine);
        machine.zip(work, |machine, work| machine - work)
    }

    /// Whether the work coordinates are rotated.
    #[must_use]
    pub fn is_rotated(&self) -> bool {
        !self.frame.rotation.is_none()
    }

    /// The modal state.
    #[must_use]
    pub fn modal(&self) -> &Modal {
        &self.modal
    }

    /// The tool table.
    #[must_use]
    pub const fn tools(&self) -> &ToolTable {
        &self.tools
    }

    /// The tool table, to be changed: the tool length offset in effect stays.
    pub const fn tools_mut(&mut self) -> &mut ToolTable {
        &mut self.tools
    }

    /// The offsets and stored positions.
    #[must_use]
    pub fn offsets(&self) -> &Offsets {
        &self.offsets
    }
}

impl Default for Interpreter {
    fn default() -> Self {
        Self::new()
    }
}
