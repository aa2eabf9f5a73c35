//! A line that has been checked, and the requested actions of the machine.

use core::num::NonZeroU8;

use super::{Compensation, CycleWords};
use crate::{
    axis::Axes,
    gcode::{Flow, LineError, Modal, MotionMode, StoredPosition, ToolCommand},
    model::{Circle, Coolant, Laser, Probing, Spindle, Target, WorkCoordinates},
    units::{MicroDegrees, Nm},
};

/// The kind of a line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum LineKind {
    #[default]
    Program,
    /// The text after `$J=`.
    Jog,
}

/// A line without errors, ready to be committed. The default has no command, in the power-up modes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CheckedLine {
    pub(super) kind: LineKind,
    /// The modal state after the line, but for the end of a program.
    pub(super) modal: Modal,
    pub(super) action: Action,
    pub(super) flow: Flow,
    /// Axes that have a word, bit 0 = X.
    pub(super) axes: u8,
    /// The new state of the spindle, and its speed in rpm.
    pub(super) spindle: Option<(Spindle, f32)>,
    /// The new speed of a spindle that turns, and goes on turning, rpm.
    pub(super) speed: Option<f32>,
    /// Whether the line has an `S`.
    pub(super) has_speed: bool,
    /// The laser power of the line's moves.
    pub(super) power: Laser,
    /// Whether the state of the spindle, the coolant, the tool or the work offset changes.
    pub(super) changes_state: bool,
    /// The tool in the spindle after the line.
    pub(super) loaded_tool: u8,
    /// The command about it.
    pub(super) tool_command: ToolCommand,
    /// Whether that is another one, by `M6`.
    pub(super) changes_tool: bool,
    /// Whether the line wants the offset of a tool, and the tool table is empty.
    pub(super) lacks_tools: bool,
    /// Whether a `G53` move ends before the switch of an axis, nearer than its word says.
    pub(super) ends_before_switch: bool,
    /// `N`.
    pub(super) line: u32,
    /// The tool length offset after the line.
    pub(super) tool: Axes<Nm>,
    /// Target of the move, or the values that the action sets.
    pub(super) values: Axes<Nm>,
    /// The work position of the target, where the work coordinates are rotated.
    pub(super) work_target: Axes<Nm>,
    /// A target in Grbl's single precision, mm.
    pub(super) single_mm: Axes<f32>,
    pub(super) movement: Move,
    /// After the line's code, before its move.
    pub(super) compensation: Compensation,
}

/// The effect of a line beside its motion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Action {
    #[default]
    None,
    /// `G4`, ms.
    Dwell(u32),
    /// `G10 L2`, `G10 L20`: the origin is set to the values, and the system gets this rotation.
    SetOrigin(WorkCoordinates, MicroDegrees),
    /// `G10 L1`, `L10`, `L11`: the tool of a slot gets this diameter, and the values as its offset.
    SetTool {
        slot: u8,
        number: NonZeroU8,
        diameter: Nm,
    },
    /// `G38.n P`: the contact of the probing move gets this work coordinate.
    SetAtContact { axis: usize, value: Nm },
    /// `G28`, `G30`.
    GoTo(StoredPosition),
    /// `G28.1`, `G30.1`.
    Store(StoredPosition),
    /// `G92`, `G52`.
    SetOffset,
    /// `G92.1`.
    ClearOffset,
    /// `G92.2`.
    SuspendOffset,
    /// `G92.3`.
    RestoreOffset,
}

/// The move of a line's motion mode.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) enum Move {
    #[default]
    None,
    Straight,
    Arc(Circle),
    /// To the target at most: only the machine knows where the move has ended.
    Probe(Probing),
    /// The holes of a canned cycle.
    Cycle(CycleWords),
}

impl CheckedLine {
    /// The target of the axis words.
    #[must_use]
    pub fn target(&self) -> Target {
        Target {
            position: self.values,
            single_mm: self.single_mm,
        }
    }

    /// Whether everything before the line must be executed before it is committed.
    ///
    /// As in Grbl: where the work offset, a stored position, the tool, the spindle or the coolant changes,
    /// at a dwell, at a probing move, at a program pause and at a program end.
    #[must_use]
    pub fn waits_for_standstill(&self) -> bool {
        self.answers_when_done()
            || self.changes_state
            || match self.action {
                Action::None | Action::Dwell(_) | Action::SetAtContact { .. } | Action::GoTo(_) => {
                    false
                }
                Action::SetOrigin(..)
                | Action::SetTool { .. }
                | Action::Store(_)
                | Action::SetOffset
                | Action::ClearOffset
                | Action::SuspendOffset
                | Action::RestoreOffset => true,
            }
    }

    /// Whether the answer is withheld until the line's commands have been executed.
    #[must_use]
    pub fn answers_when_done(&self) -> bool {
        self.flow != Flow::Run
            || matches!(self.action, Action::Dwell(_))
            || match self.movement {
                Move::Probe(_) => true,
                // The spindle turns as before when the answer comes.
                Move::Cycle(words) => words.cycle.needs_spindle(),
                Move::None | Move::Straight | Move::Arc(_) => false,
            }
    }

    /// Whether another tool has to be put into the spindle, before anything else of the line.
    #[must_use]
    pub fn changes_tool(&self) -> bool {
        self.changes_tool
    }

    /// The tool in the spindle after the line.
    #[must_use]
    pub fn loaded_tool(&self) -> u8 {
        self.loaded_tool
    }

    /// Whether the line belongs into a program alone, not into the change of a tool: it moves the
    /// machine otherwise than to probe, stops the program, starts the spindle or changes the tool.
    #[must_use]
    pub fn is_program(&self) -> bool {
        let moves = matches!(
            self.movement,
            Move::Straight | Move::Arc(_) | Move::Cycle(_)
        ) || matches!(self.action, Action::GoTo(_));
        let starts = matches!(
            self.spindle,
            Some((Spindle::Clockwise | Spindle::CounterClockwise, _))
        );
        moves
            || starts
            || self.speed.is_some()
            || self.flow != Flow::Run
            || self.tool_command != ToolCommand::None
    }

    /// Whether the line asks for a machine that is not locked: it belongs into a program, probes, or
    /// switches coolant on.
    #[must_use]
    pub fn needs_unlocked(&self) -> bool {
        let is_off = self.modal.coolant == Coolant::default();
        self.is_program() || self.probing().is_some() || !is_off
    }

    /// Whether the program pauses or ends with the line.
    #[must_use]
    pub fn stops_program(&self) -> bool {
        self.flow != Flow::Run
    }

    /// Whether the program pauses with the line.
    #[must_use]
    pub fn pauses_program(&self) -> bool {
        self.flow == Flow::Pause
    }

    /// Whether the program ends with the line.
    #[must_use]
    pub fn ends_program(&self) -> bool {
        self.flow == Flow::End
    }

    /// Whether the line changes what [`super::Interpreter::origins_after`] returns.
    #[must_use]
    pub fn sets_origins(&self) -> bool {
        matches!(self.action, Action::SetOrigin(..) | Action::Store(_))
    }

    /// The contact that ends a probing move.
    #[must_use]
    pub fn probing(&self) -> Option<Probing> {
        match self.movement {
            Move::Probe(probing) => Some(probing),
            Move::None | Move::Straight | Move::Arc(_) | Move::Cycle(_) => None,
        }
    }

    /// Has the limit switches of the axes that move end the straight move of the line.
    ///
    /// # Errors
    /// 91 with cutter compensation.
    pub fn end_at_switch(&mut self) -> Result<(), LineError> {
        if self.compensation.is_on() {
            return Err(LineError::NotWithCompensation);
        }
        if self.movement == Move::Straight {
            self.movement = Move::Probe(Probing::LimitSwitch);
        }
        Ok(())
    }

    /// Whether the line drills: its last move stands for those that
    /// [`super::Interpreter::next_drilling_command`] returns.
    #[must_use]
    pub fn drills(&self) -> bool {
        matches!(self.movement, Move::Cycle(_))
    }

    /// Whether a move of a program's line is at a feed rate.
    pub(super) fn feeds(&self) -> bool {
        let is_feed = match self.movement {
            Move::Straight => self.modal.motion != MotionMode::Rapid,
            Move::Arc(_) | Move::Cycle(_) => true,
            Move::None | Move::Probe(_) => false,
        };
        is_feed && self.kind == LineKind::Program
    }

    /// Whether the line moves the machine.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.movement != Move::None || matches!(self.action, Action::GoTo(_))
    }
}
