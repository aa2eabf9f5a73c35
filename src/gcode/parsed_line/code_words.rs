//! The codes of `G` and `M` words: what each sets in its line, and its modal group.

use super::{
    AxisCommand, ModalGroup, NonModal, ParsedLine, StoredPosition, SwitchedOverride, ToolCommand,
};
use crate::{
    gcode::{
        ArcDistance, CodeNumber, CompensationMode, Cycle, Distance, FeedMode, Flow, LineError,
        MotionMode, ProbeMode, RetractMode, ToolLength, Units,
    },
    model::{OverrideSwitches, PathControl, Plane, Rotation, Spindle, WorkCoordinates},
};

impl ParsedLine {
    pub(super) fn g_word(&mut self, code: CodeNumber) -> Result<(), LineError> {
        let group = match code.whole {
            0..=3 | 38 | 73 | 74 | 81..=86 | 88 | 89 => self.motion_word(code)?,
            80 => self.cancel_word(code)?,
            4 | 10 | 28 | 30 | 52 | 53 | 92 => self.non_modal_word(code)?,
            40..=42 => self.compensation_word(code)?,
            43 | 49 => self.tool_length_word(code)?,
            54..=59 => {
                self.modal.coordinates = WorkCoordinates::of_code(code.whole, code.hundredths)
                    .ok_or(LineError::NotInteger)?;
                ModalGroup::Coordinates
            }
            90 | 91 if code.hundredths == 10 => {
                self.modal.arc_distance = match code.whole {
                    90 => ArcDistance::Absolute,
                    _ => ArcDistance::Incremental,
                };
                ModalGroup::ArcDistance
            }
            61 if code.hundredths == 10 => {
                self.modal.path = PathControl::ExactStop;
                ModalGroup::Control
            }
            61 | 90 | 91 if !code.is_whole() => return Err(LineError::Unsupported),
            _ => {
                let group = self.mode_word(code.whole)?;
                if !code.is_whole() {
                    return Err(LineError::NotInteger);
                }
                group
            }
        };
        self.insert_group(group)
    }

    /// Modal group 1.
    fn motion_word(&mut self, code: CodeNumber) -> Result<ModalGroup, LineError> {
        // The axis words of `G28` and `G30` are theirs: `G0` and `G1` are only the mode after them.
        let is_mode_only = code.whole <= 1 && matches!(self.non_modal, NonModal::GoTo(_));
        let is_with_g49 = self.axis_command == AxisCommand::ToolLength
            && self.modal.tool_length == ToolLength::None;
        if self.axis_command == AxisCommand::None || is_with_g49 {
            self.axis_command = AxisCommand::Motion;
        } else if !is_mode_only {
            return Err(LineError::AxisCommandConflict);
        }
        self.modal.motion = match (code.whole, code.hundredths) {
            (38, 20) => MotionMode::Probe(ProbeMode::Contact),
            (38, 30) => MotionMode::Probe(ProbeMode::TryContact),
            (38, 40) => MotionMode::Probe(ProbeMode::Release),
            (38, 50) => MotionMode::Probe(ProbeMode::TryRelease),
            (38, _) => return Err(LineError::Unsupported),
            (_, 1..) => return Err(LineError::NotInteger),
            (0, 0) => MotionMode::Rapid,
            (1, 0) => MotionMode::Linear,
            (2, 0) => MotionMode::Arc(Rotation::Clockwise),
            (3, 0) => MotionMode::Arc(Rotation::CounterClockwise),
            (whole, _) => MotionMode::Cycle(Cycle::of_code(whole).ok_or(LineError::Unsupported)?),
        };
        if code.whole > 3 && self.has_group(ModalGroup::CycleCancel) {
            return Err(LineError::ModalGroupViolation);
        }
        Ok(ModalGroup::Motion)
    }

    /// `G80`: no motion mode, unless the line has one.
    fn cancel_word(&mut self, code: CodeNumber) -> Result<ModalGroup, LineError> {
        if !code.is_whole() {
            return Err(LineError::NotInteger);
        }
        if !self.has_group(ModalGroup::Motion) {
            self.modal.motion = MotionMode::Cancelled;
        } else if matches!(
            self.modal.motion,
            MotionMode::Probe(_) | MotionMode::Cycle(_)
        ) {
            return Err(LineError::ModalGroupViolation);
        }
        Ok(ModalGroup::CycleCancel)
    }

    /// Modal group 0.
    fn non_modal_word(&mut self, code: CodeNumber) -> Result<ModalGroup, LineError> {
        let uses_axes = matches!(code.whole, 10 | 28 | 30 | 52 | 92) && code.is_whole();
        if uses_axes {
            let is_with_mode = matches!(code.whole, 28 | 30)
                && self.axis_command == AxisCommand::Motion
                && matches!(self.modal.motion, MotionMode::Rapid | MotionMode::Linear);
            if self.axis_command != AxisCommand::None && !is_with_mode {
                return Err(LineError::AxisCommandConflict);
            }
            self.axis_command = AxisCommand::NonModal;
        }
        self.non_modal = match (code.whole, code.hundredths) {
            (28, 0) => NonModal::GoTo(StoredPosition::G28),
            (28, 10) => NonModal::Store(StoredPosition::G28),
            (30, 0) => NonModal::GoTo(StoredPosition::G30),
            (30, 10) => NonModal::Store(StoredPosition::G30),
            (92, 0) => NonModal::SetOffset,
            (92, 10) => NonModal::ClearOffset,
            (92, 20) => NonModal::SuspendOffset,
            (92, 30) => NonModal::RestoreOffset,
            (28 | 30 | 92, _) => return Err(LineError::Unsupported),
            (_, 1..) => return Err(LineError::NotInteger),
            (4, 0) => NonModal::Dwell,
            (10, 0) => NonModal::SetCoordinates,
            (52, 0) => NonModal::SetLocalOffset,
            (53, 0) => NonModal::MachineCoordinates,
            _ => return Err(LineError::Unsupported),
        };
        Ok(ModalGroup::NonModal)
    }

    /// Modal group 7.
    fn compensation_word(&mut self, code: CodeNumber) -> Result<ModalGroup, LineError> {
        self.modal.compensation = match (code.whole, code.hundredths) {
            (40, 0) => CompensationMode::Off,
            (40, _) => return Err(LineError::NotInteger),
            (41, 0) => CompensationMode::Left,
            (41, 10) => CompensationMode::LeftDynamic,
            (42, 0) => CompensationMode::Right,
            (42, 10) => CompensationMode::RightDynamic,
            _ => return Err(LineError::Unsupported),
        };
        Ok(ModalGroup::CutterCompensation)
    }

    /// Modal group 8. The fraction of `G49` does not count.
    fn tool_length_word(&mut self, code: CodeNumber) -> Result<ModalGroup, LineError> {
        let by_tool = match (code.whole, code.hundredths) {
            (43, 0) => Some(ToolLength::OfTool),
            (43, 20) => Some(ToolLength::Added),
            _ => None,
        };
        if let Some(tool_length) = by_tool {
            // Without axis words, or with those that `G43.2` may have after all words are known.
            self.modal.tool_length = tool_length;
            return Ok(ModalGroup::ToolLength);
        }
        // `G49` needs no axis words: a motion mode beside it has them.
        let is_with_motion = code.whole == 49 && self.has_group(ModalGroup::Motion);
        if self.axis_command == AxisCommand::None {
            self.axis_command = AxisCommand::ToolLength;
        } else if !is_with_motion {
            return Err(LineError::AxisCommandConflict);
        }
        self.modal.tool_length = match (code.whole, code.hundredths) {
            (49, _) => ToolLength::None,
            (_, 10) => ToolLength::Dynamic,
            _ => return Err(LineError::Unsupported),
        };
        Ok(ModalGroup::ToolLength)
    }

    /// The modes of whole numbers, which do not depend on other words of the line.
    fn mode_word(&mut self, whole: u8) -> Result<ModalGroup, LineError> {
        let modal = &mut self.modal;
        Ok(match whole {
            17..=19 => {
                modal.plane = match whole {
                    17 => Plane::Xy,
                    18 => Plane::Zx,
                    _ => Plane::Yz,
                };
                ModalGroup::Plane
            }
            20 => {
                modal.units = Units::Inches;
                ModalGroup::Units
            }
            21 => {
                modal.units = Units::Millimetres;
                ModalGroup::Units
            }
            50 => ModalGroup::Scaling,
            97 => ModalGroup::SpindleMode,
            98 => {
                modal.retract = RetractMode::InitialLevel;
                ModalGroup::Retract
            }
            99 => {
                modal.retract = RetractMode::ReferencePlane;
                ModalGroup::Retract
            }
            61 => {
                modal.path = PathControl::ExactPath;
                ModalGroup::Control
            }
            64 => {
                modal.path = PathControl::Continuous {
                    tolerance_nm: 0,
                    merging_nm: 0,
                };
                ModalGroup::Control
            }
            90 => {
                modal.distance = Distance::Absolute;
                ModalGroup::Distance
            }
            91 => {
                modal.distance = Distance::Incremental;
                ModalGroup::Distance
            }
            93 => {
                modal.feed_mode = FeedMode::InverseTime;
                ModalGroup::FeedMode
            }
            94 => {
                modal.feed_mode = FeedMode::PerMinute;
                ModalGroup::FeedMode
            }
            _ => return Err(LineError::Unsupported),
        })
    }

    pub(super) fn m_word(&mut self, code: CodeNumber) -> Result<(), LineError> {
        if !code.is_whole() {
            return Err(LineError::NotInteger);
        }
        let group = match code.whole {
            0 => {
                self.flow = Flow::Pause;
                ModalGroup::Flow
            }
            1 => {
                self.flow = Flow::OptionalPause;
                ModalGroup::Flow
            }
            2 | 30 => {
                self.flow = Flow::End;
                ModalGroup::Flow
            }
            3..=5 => {
                self.modal.spindle = match code.whole {
                    3 => Spindle::Clockwise,
                    4 => Spindle::CounterClockwise,
                    _ => Spindle::Off,
                };
                ModalGroup::Spindle
            }
            7 => {
                self.modal.coolant.mist = true;
                ModalGroup::Coolant
            }
            8 => {
                self.modal.coolant.flood = true;
                ModalGroup::Coolant
            }
            9 => {
                self.modal.coolant.flood = false;
                self.modal.coolant.mist = false;
                ModalGroup::Coolant
            }
            48 | 49 => {
                self.modal.overrides = match code.whole {
                    48 => OverrideSwitches::ALL,
                    _ => OverrideSwitches::NONE,
                };
                ModalGroup::Overrides
            }
            50 | 51 | 53 => {
                self.switched = Some(match code.whole {
                    50 => SwitchedOverride::Feed,
                    51 => SwitchedOverride::Spindle,
                    _ => SwitchedOverride::FeedStop,
                });
                ModalGroup::Overrides
            }
            _ => self.tool_word(code.whole)?,
        };
        self.insert_group(group)
    }

    /// M words of tools.
    fn tool_word(&mut self, whole: u8) -> Result<ModalGroup, LineError> {
        self.tool_command = match whole {
            6 => ToolCommand::Change,
            61 => ToolCommand::Set,
            _ => return Err(LineError::Unsupported),
        };
        Ok(ModalGroup::ToolChange)
    }
}
