//! Cutter radius compensation as far as the lines decide it: codes, cutter, what is refused meanwhile.
//!
//! The moves stay those of the program here. What the cutter does beside them is found out behind the
//! interpreter, in `path/compensation.rs`. Read with LinuxCNC 2.9 "G40", "G41" and "G42".

use super::{Action, CheckedLine, Interpreter, LineKind, Move};
use crate::{
    axis::Axes,
    gcode::{
        AxisCommand, CompensationMode, Flow, LineError, MotionMode, NonModal, ParsedLine,
        ToolCommand, Word, Words, tool_number,
    },
    model::{Circle, Cutter, Laser, PathControl, Plane, Side},
    settings::{Settings, ToolEntry},
    units::Nm,
};

/// Compensation after a line.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Compensation {
    cutter: Cutter,
    stage: CompensationStage,
    /// The cutter is beside the programmed path. Without compensation a straight move ends that.
    is_off_path: bool,
}

/// How far compensation has come.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum CompensationStage {
    #[default]
    Off,
    /// It is on: the next move in the plane is the entry.
    Entering,
    /// The entry has been made.
    Following,
}

/// A move of the program that is compensated: one in the plane of compensation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompensatedMove {
    /// The cutter.
    pub cutter: Cutter,
    /// Whether the cutter is still on the programmed path.
    pub is_entry: bool,
    /// The programmed start.
    pub from: Axes<Nm>,
    /// The programmed end.
    pub to: Axes<Nm>,
    /// The programmed circle of an arc.
    pub circle: Option<Circle>,
    /// Whether it is a rapid.
    pub is_rapid: bool,
}

impl Compensation {
    /// Whether compensation is on.
    pub(super) const fn is_on(&self) -> bool {
        match self.stage {
            CompensationStage::Off => false,
            CompensationStage::Entering | CompensationStage::Following => true,
        }
    }

    /// Whether moves are those of the program.
    pub(super) const fn is_without_effect(&self) -> bool {
        !self.is_on() && !self.is_off_path
    }

    /// Goes on by a move of the program.
    pub(super) fn advance(&mut self, is_in_plane: bool) {
        if self.stage == CompensationStage::Following {
            return;
        }
        self.is_off_path =
            self.stage == CompensationStage::Entering && is_in_plane && self.cutter.radius_mm > 0.0;
        if self.is_off_path {
            self.stage = CompensationStage::Following;
        }
    }
}

/// Checks what may not stand beside compensation, and `G40` to `G42.1`: sets the compensation of the line.
///
/// # Errors
/// 23, 28, 33, 38, 42, 90 and 91.
#[inline(never)]
pub(super) fn set(
    state: &Interpreter,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &mut CheckedLine,
) -> Result<(), LineError> {
    let before = &state.compensation;
    let is_other_plane = parsed.modal.plane != state.modal.plane;
    if before.is_on() && (is_other_plane || parsed.tool_command == ToolCommand::Change) {
        return Err(LineError::NotWithCompensation);
    }
    if parsed.begins_compensation() {
        if before.is_on() {
            return Err(LineError::CompensationOn);
        }
        let is_rotated = !state.frame.rotation.is_none();
        match parsed.modal.plane {
            Plane::Xy => {}
            Plane::Zx if !is_rotated => {}
            Plane::Zx | Plane::Yz => return Err(LineError::NotInThisPlane),
        }
        checked.compensation = Compensation {
            cutter: cutter(state, parsed, unused, checked)?,
            stage: CompensationStage::Entering,
            is_off_path: before.is_off_path,
        };
    } else if parsed.has_compensation() {
        checked.compensation.stage = CompensationStage::Off;
    }
    let is_refused = checked.kind == LineKind::Jog || is_refused(parsed);
    if checked.compensation.is_on() && is_refused {
        Err(LineError::NotWithCompensation)
    } else {
        Ok(())
    }
}

/// Whether a line has a code that is refused while compensation is on.
fn is_refused(parsed: &ParsedLine) -> bool {
    let is_other_motion = parsed.axis_command == AxisCommand::Motion
        && matches!(
            parsed.modal.motion,
            MotionMode::Probe(_) | MotionMode::Cycle(_)
        );
    parsed.has_tool_length()
        || parsed.has_coordinates()
        || is_other_motion
        || match parsed.non_modal {
            NonModal::None | NonModal::Dwell | NonModal::SetCoordinates => false,
            NonModal::GoTo(_)
            | NonModal::Store(_)
            | NonModal::MachineCoordinates
            | NonModal::SetOffset
            | NonModal::SetLocalOffset
            | NonModal::ClearOffset
            | NonModal::SuspendOffset
            | NonModal::RestoreOffset => true,
        }
}

/// Returns the cutter of `G41` to `G42.1`; a negative diameter is one on the other side.
fn cutter(
    state: &Interpreter,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &CheckedLine,
) -> Result<Cutter, LineError> {
    let has_diameter = unused.contains(Word::D);
    unused.remove(Word::D);
    let mode = parsed.modal.compensation;
    let diameter = if !mode.is_dynamic() {
        diameter_of_tool(state, parsed, checked)?
    } else if has_diameter {
        parsed.exact_length(parsed.d)?
    } else {
        return Err(LineError::MissingWord);
    };
    if diameter.0.unsigned_abs() > ToolEntry::LONGEST.0.unsigned_abs() {
        return Err(LineError::InvalidTarget);
    }
    let side = match mode {
        CompensationMode::Left | CompensationMode::LeftDynamic | CompensationMode::Off => {
            Side::Left
        }
        CompensationMode::Right | CompensationMode::RightDynamic => Side::Right,
    };
    Ok(Cutter {
        side: if diameter < Nm(0) { side.other() } else { side },
        radius_mm: 0.5 * libm::fabs(diameter.to_mm_f64()),
        plane: parsed.modal.plane,
    })
}

/// Returns the diameter of the tool `D`; without it, or with `D0`, of the tool in the spindle.
fn diameter_of_tool(
    state: &Interpreter,
    parsed: &ParsedLine,
    checked: &CheckedLine,
) -> Result<Nm, LineError> {
    if parsed.d.is_negative() {
        return Err(LineError::NegativeValue);
    }
    let number = match tool_number(parsed.d)? {
        0 => checked.loaded_tool,
        number => number,
    };
    if number == 0 {
        return Ok(Nm(0));
    }
    let entry = state.tools.get(number).ok_or(LineError::UnknownTool)?;
    Ok(entry.diameter)
}

/// Checks what depends on the whole line: `G10` of the work coordinate system in use, an arc as the first
/// move after compensation.
///
/// # Errors
/// 91 and 205.
pub(super) fn check_line(checked: &CheckedLine) -> Result<(), LineError> {
    let compensation = &checked.compensation;
    let sets_active = matches!(
        checked.action,
        Action::SetOrigin(system, _) if system == checked.modal.coordinates
    );
    if compensation.is_on() && sets_active {
        return Err(LineError::NotWithCompensation);
    }
    let is_left_off_path =
        compensation.is_off_path && compensation.stage != CompensationStage::Following;
    if is_left_off_path && matches!(checked.movement, Move::Arc(_)) {
        return Err(LineError::ArcAfterCompensation);
    }
    Ok(())
}

impl CheckedLine {
    /// Whether the line moves in the plane, from a position.
    pub(super) fn moves_in_plane(&self, from: &Axes<Nm>) -> bool {
        let (first, second, _) = self.modal.plane.axes();
        match self.movement {
            Move::Straight => {
                self.values[first] != from[first] || self.values[second] != from[second]
            }
            Move::Arc(_) => true,
            Move::None | Move::Probe(_) | Move::Cycle(_) => false,
        }
    }

    /// Whether the moves of the line are compensated.
    #[must_use]
    pub fn is_compensated(&self) -> bool {
        self.compensation.is_on() && self.compensation.cutter.radius_mm > 0.0
    }

    /// Returns the path control after the line.
    #[must_use]
    pub const fn path_control(&self) -> PathControl {
        self.modal.path
    }

    /// Whether the line is one of a compensated contour, after the entry.
    #[must_use]
    pub fn follows_contour(&self) -> bool {
        self.compensation.stage == CompensationStage::Following
    }

    /// Whether the cutter stays beside the programmed path, where compensation has left it.
    #[must_use]
    pub fn stays_off_path(&self) -> bool {
        self.compensation.is_off_path && !self.moves()
    }

    /// Whether the line's commands may wait behind a move, and the line be answered before that.
    #[must_use]
    pub fn may_wait(&self) -> bool {
        let is_small = match self.action {
            Action::None | Action::Dwell(_) => true,
            Action::SetOrigin(..)
            | Action::SetTool { .. }
            | Action::SetAtContact { .. }
            | Action::GoTo(_)
            | Action::Store(_)
            | Action::SetOffset
            | Action::ClearOffset
            | Action::SuspendOffset
            | Action::RestoreOffset => false,
        };
        is_small
            && self.follows_contour()
            && self.flow == Flow::Run
            && self.tool_command == ToolCommand::None
    }
}

impl Interpreter {
    /// Returns the move that a line which was checked makes in the plane of compensation.
    #[must_use]
    pub fn compensated_move(&self, checked: &CheckedLine) -> Option<CompensatedMove> {
        if !checked.is_compensated() || !checked.moves_in_plane(&self.position) {
            return None;
        }
        let circle = match checked.movement {
            Move::Arc(circle) => Some(circle),
            Move::None | Move::Straight | Move::Probe(_) | Move::Cycle(_) => None,
        };
        Some(CompensatedMove {
            cutter: checked.compensation.cutter,
            is_entry: checked.compensation.stage == CompensationStage::Entering,
            from: self.position,
            to: checked.values,
            circle,
            is_rapid: checked.modal.motion == MotionMode::Rapid,
        })
    }

    /// Returns the number of commands of a line that was checked before its move.
    #[must_use]
    pub fn commands_before_move(&self, checked: &CheckedLine) -> usize {
        let (before, after) = (&self.modal, &checked.modal);
        usize::from(checked.spindle.is_some() || checked.speed.is_some())
            + usize::from(before.coolant != after.coolant)
            + usize::from(before.overrides != after.overrides)
            + usize::from(matches!(checked.action, Action::Dwell(_)))
            + usize::from(checked.moves() && checked.power != Laser::None)
    }

    /// Whether cutter compensation is on.
    #[must_use]
    pub const fn is_compensating(&self) -> bool {
        self.compensation.is_on()
    }

    /// Whether the cutter is beside the programmed path.
    #[must_use]
    pub const fn is_off_path(&self) -> bool {
        self.compensation.is_off_path
    }

    /// Checks a jog that begins where the cutter is, beside the programmed path: compensation ends there,
    /// unless the jog is refused or its target is. Then nothing changes.
    ///
    /// # Errors
    /// As [`Self::check_jog`].
    pub fn check_jog_off_path(
        &mut self,
        line: &[u8],
        settings: &Settings,
        cutter: Axes<Nm>,
        is_refused: impl FnOnce(&Axes<Nm>) -> bool,
    ) -> Result<CheckedLine, LineError> {
        let (compensation, position) = (self.compensation, self.position);
        self.cancel_compensation();
        self.set_position(cutter);
        let checked = self.check_jog(line, settings);
        let target = checked.as_ref().map(|checked| checked.target().position);
        if target.map_or(true, |target| is_refused(&target)) {
            self.compensation = compensation;
            self.set_position(position);
            self.update_plain_modes();
        }
        checked
    }

    /// Ends cutter compensation where the cutter is.
    pub fn cancel_compensation(&mut self) {
        self.modal.compensation = CompensationMode::Off;
        self.compensation = Compensation::default();
        self.update_plain_modes();
    }
}
