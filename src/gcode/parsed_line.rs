//! One line: its words gathered by modal group and letter.
//!
//! Finds every error that does not depend on the modes of earlier lines, in Grbl's order: word by
//! word from the left. The modes of the line replace those before it, in a copy.

use super::{
    ArcDistance, CodeNumber, CompensationMode, Cycle, Distance, FeedMode, Flow, LineError, Modal,
    MotionMode, PlainPrefix, ProbeMode, RetractMode, ToolLength, Units, Word, WordReader, Words,
};
use crate::{
    axis::{AXES, Axes, LETTERS},
    decimal::Decimal,
    model::{OverrideSwitches, PathControl, Plane, Rotation, Spindle, WorkCoordinates},
    units::Nm,
};

/// The words of one line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParsedLine {
    /// The modal state before the line, with the line's modes, `S` and `T`, but without its `F`.
    pub modal: Modal,
    /// The command of modal group 0.
    pub non_modal: NonModal,
    /// The command that the axis words belong to.
    pub axis_command: AxisCommand,
    /// The flow of the program after the line.
    pub flow: Flow,
    /// Letters of the value words, without the axes.
    pub words: Words,
    /// Axes that have a word, bit 0 = X.
    pub axes: u8,
    /// Values of the axis words, 0 without.
    pub coordinates: Axes<Decimal>,
    /// `I`, `J`, `K`.
    pub offsets: [Decimal; 3],
    /// `D`.
    pub d: Decimal,
    /// `H`.
    pub h: Decimal,
    /// `P`.
    pub p: Decimal,
    /// `Q`.
    pub q: Decimal,
    /// `R`.
    pub radius: Decimal,
    /// `F`, in the units of the line.
    pub feed: f32,
    /// `L`.
    pub l: Decimal,
    /// `N`.
    pub line: u32,
    /// The override that `M50` or `M51` switches by its `P`.
    pub switched: Option<SwitchedOverride>,
    /// The command about the tool in the spindle.
    pub tool_command: ToolCommand,
    groups: u32,
}

/// The override that a line switches by its `P`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SwitchedOverride {
    /// `M50`: of feeds.
    Feed,
    /// `M51`: of the spindle speed.
    Spindle,
    /// `M53`: of an input that this machine does not have. A feed hold cannot be switched off.
    FeedStop,
}

/// A command about the tool in the spindle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ToolCommand {
    /// No command.
    #[default]
    None,
    /// `M6`: the selected tool is to be loaded.
    Change,
    /// `M61`: the tool `Q` is in the spindle.
    Set,
}

/// A command of modal group 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum NonModal {
    /// No command.
    #[default]
    None,
    /// `G4`.
    Dwell,
    /// `G10`.
    SetCoordinates,
    /// `G28`, `G30`.
    GoTo(StoredPosition),
    /// `G28.1`, `G30.1`.
    Store(StoredPosition),
    /// `G53`.
    MachineCoordinates,
    /// `G92`.
    SetOffset,
    /// `G52`.
    SetLocalOffset,
    /// `G92.1`.
    ClearOffset,
    /// `G92.2`.
    SuspendOffset,
    /// `G92.3`.
    RestoreOffset,
}

/// A stored position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoredPosition {
    /// Of `G28`.
    G28,
    /// Of `G30`.
    G30,
}

/// The command that the axis words belong to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum AxisCommand {
    /// No command.
    #[default]
    None,
    /// `G10`, `G28`, `G30`, `G92`.
    NonModal,
    /// The motion mode.
    Motion,
    /// `G43.1`, `G43.2`, `G49`.
    ToolLength,
}

/// Modal groups, each the bit of a line that has a command of the group.
#[derive(Clone, Copy)]
#[repr(u32)]
enum ModalGroup {
    NonModal = 1 << 0,
    Motion = 1 << 1,
    Plane = 1 << 2,
    Distance = 1 << 3,
    ArcDistance = 1 << 4,
    FeedMode = 1 << 5,
    Units = 1 << 6,
    CutterCompensation = 1 << 7,
    ToolLength = 1 << 8,
    Coordinates = 1 << 9,
    Control = 1 << 10,
    Flow = 1 << 11,
    Spindle = 1 << 12,
    Coolant = 1 << 13,
    /// `G80`, which may stand beside a motion mode.
    CycleCancel = 1 << 14,
    Scaling = 1 << 15,
    SpindleMode = 1 << 16,
    Retract = 1 << 17,
    Overrides = 1 << 18,
    ToolChange = 1 << 19,
}

impl ParsedLine {
    /// A line without words, in the modal state before it.
    #[must_use]
    pub const fn new(modal: &Modal) -> Self {
        Self {
            modal: *modal,
            non_modal: NonModal::None,
            axis_command: AxisCommand::None,
            flow: Flow::Run,
            words: Words::NONE,
            axes: 0,
            coordinates: Axes([Decimal::ZERO; AXES]),
            offsets: [Decimal::ZERO; 3],
            d: Decimal::ZERO,
            h: Decimal::ZERO,
            p: Decimal::ZERO,
            q: Decimal::ZERO,
            radius: Decimal::ZERO,
            feed: 0.0,
            l: Decimal::ZERO,
            line: 0,
            switched: None,
            tool_command: ToolCommand::None,
            groups: 0,
        }
    }

    /// A jog without words: in the modes before it, but along a line and at a feed per minute.
    #[must_use]
    pub const fn jog(modal: &Modal) -> Self {
        let mut parsed = Self::new(modal);
        parsed.modal.motion = MotionMode::Linear;
        parsed.modal.feed_mode = FeedMode::PerMinute;
        parsed
    }

    /// Whether a jog may have the line's commands: units, distance mode and `G53`.
    #[must_use]
    pub const fn is_joggable(&self) -> bool {
        let allowed =
            ModalGroup::NonModal as u32 | ModalGroup::Distance as u32 | ModalGroup::Units as u32;
        self.groups & !allowed == 0
            && matches!(
                self.non_modal,
                NonModal::None | NonModal::MachineCoordinates
            )
    }

    /// Adds the plain words that a line begins with.
    pub fn add_plain(&mut self, prefix: &PlainPrefix) {
        let words = prefix.words;
        if words.contains(Word::new(b'G')) {
            self.modal.motion = prefix.motion;
            self.axis_command = AxisCommand::Motion;
            self.groups |= ModalGroup::Motion as u32;
        }
        if words.contains(Word::F) {
            self.feed = prefix.feed;
            self.words.insert(Word::F);
        }
        if words.contains(Word::N) {
            self.line = prefix.line;
            self.words.insert(Word::N);
        }
        for axis in 0..AXES {
            if words.contains(Word::axis(axis)) {
                self.coordinates[axis] = prefix.coordinates[axis].into();
                self.axes |= 1 << axis;
            }
        }
    }

    /// Adds the words of a line: upper case, without blanks and comments. After an error the parsed
    /// line is incomplete.
    ///
    /// # Errors
    /// Errors of the line whatever the state: numbers 1, 2, 4, 20, 21, 23, 24, 25, 28, 38, 48.
    pub fn read(&mut self, line: &[u8]) -> Result<(), LineError> {
        let result = self.read_words(line);
        if self.words.contains(Word::Q)
            && !self.has_path_tolerance()
            && self.tool_command != ToolCommand::Set
            && !matches!(self.modal.motion, MotionMode::Cycle(_))
        {
            // Q is unknown in other lines, so that this error comes before those behind it.
            return Err(LineError::Unsupported);
        }
        if self.words.contains(Word::H) && !self.has_tool_number() {
            // So is H.
            return Err(LineError::Unsupported);
        }
        if self.words.contains(Word::D) && !self.begins_compensation() {
            // And D.
            return Err(LineError::Unsupported);
        }
        result
    }

    /// Whether the line has a `G64`.
    #[must_use]
    pub const fn has_path_tolerance(&self) -> bool {
        self.has_group(ModalGroup::Control)
            && matches!(self.modal.path, PathControl::Continuous { .. })
    }

    /// Whether the line has a command about the tool length offset.
    #[must_use]
    pub const fn has_tool_length(&self) -> bool {
        self.has_group(ModalGroup::ToolLength)
    }

    /// Whether the line has a `G43` or `G43.2`, to which an `H` belongs.
    const fn has_tool_number(&self) -> bool {
        self.has_tool_length()
            && matches!(
                self.modal.tool_length,
                ToolLength::OfTool | ToolLength::Added
            )
    }

    /// Whether the line has a code of cutter compensation.
    #[must_use]
    pub const fn has_compensation(&self) -> bool {
        self.has_group(ModalGroup::CutterCompensation)
    }

    /// Whether the line begins cutter compensation.
    #[must_use]
    pub fn begins_compensation(&self) -> bool {
        self.has_compensation() && self.modal.compensation != CompensationMode::Off
    }

    /// Whether the line has the code of a work coordinate system.
    #[must_use]
    pub const fn has_coordinates(&self) -> bool {
        self.has_group(ModalGroup::Coordinates)
    }

    const fn has_group(&self, group: ModalGroup) -> bool {
        self.groups & group as u32 != 0
    }

    fn read_words(&mut self, line: &[u8]) -> Result<(), LineError> {
        for word in WordReader::new(line.iter().copied()) {
            let (letter, number) = word?;
            match letter {
                b'G' => self.g_word(CodeNumber::of(number))?,
                b'M' => self.m_word(CodeNumber::of(number))?,
                _ => self.value_word(letter, number)?,
            }
        }
        if self.has_tool_length() && self.modal.tool_length == ToolLength::Added {
            self.find_tool_length_words()?;
        }
        let is_drilled_by_r = matches!(self.modal.motion, MotionMode::Cycle(_))
            && self.non_modal == NonModal::None
            && self.words.contains(Word::R);
        let is_motion = self.axes != 0 || is_drilled_by_r;
        if is_motion && self.axis_command == AxisCommand::None {
            self.axis_command = AxisCommand::Motion;
        }
        // `G80` may stand beside a motion mode only where nothing moves.
        let has_both =
            self.has_group(ModalGroup::CycleCancel) && self.has_group(ModalGroup::Motion);
        if has_both && self.axes != 0 {
            return Err(LineError::ModalGroupViolation);
        }
        Ok(())
    }

    /// `G43.2`: adds the offset of a tool, or what the axis words say.
    fn find_tool_length_words(&mut self) -> Result<(), LineError> {
        match (self.words.contains(Word::H), self.axes != 0) {
            (true, true) => return Err(LineError::ToolLengthWords),
            (false, false) => return Err(LineError::MissingWord),
            (true, false) => {}
            (false, true) if self.axis_command == AxisCommand::None => {
                self.axis_command = AxisCommand::ToolLength;
            }
            (false, true) => return Err(LineError::AxisCommandConflict),
        }
        Ok(())
    }

    /// `L` of `G10`: Grbl keeps it in eight bits, so `L258` is `L2`.
    #[must_use]
    pub fn subcode(&self) -> u8 {
        self.l.trunc() as u8
    }

    /// A length in the units of the line.
    #[must_use]
    pub fn length(&self, number: Decimal) -> Nm {
        Nm(match self.modal.units {
            Units::Millimetres => number.to_millionths(),
            Units::Inches => number.inches_to_nm(),
        })
    }

    /// Whether an axis has a word.
    #[must_use]
    pub const fn has_axis(&self, axis: usize) -> bool {
        self.axes >> axis & 1 != 0
    }

    fn g_word(&mut self, code: CodeNumber) -> Result<(), LineError> {
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
        let is_beside_g49 = self.axis_command == AxisCommand::ToolLength
            && self.modal.tool_length == ToolLength::None;
        if self.axis_command == AxisCommand::None || is_beside_g49 {
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
            let is_beside_mode = matches!(code.whole, 28 | 30)
                && self.axis_command == AxisCommand::Motion
                && matches!(self.modal.motion, MotionMode::Rapid | MotionMode::Linear);
            if self.axis_command != AxisCommand::None && !is_beside_mode {
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
        let is_beside_motion = code.whole == 49 && self.has_group(ModalGroup::Motion);
        if self.axis_command == AxisCommand::None {
            self.axis_command = AxisCommand::ToolLength;
        } else if !is_beside_motion {
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

    fn m_word(&mut self, code: CodeNumber) -> Result<(), LineError> {
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

    fn value_word(&mut self, letter: u8, number: Decimal) -> Result<(), LineError> {
        match letter {
            b'X' | b'Y' | b'Z' | b'A' | b'B' | b'C' => return self.axis_word(letter, number),
            b'D' => self.d = number,
            b'F' => self.feed = number.to_f32(),
            b'H' => self.h = number,
            b'I' => self.offsets[0] = number,
            b'J' => self.offsets[1] = number,
            b'K' => self.offsets[2] = number,
            b'L' => self.l = number,
            b'N' => self.line = u32::try_from(number.trunc()).unwrap_or(u32::MAX),
            b'P' => self.p = number,
            b'Q' => self.q = number,
            b'R' => self.radius = number,
            b'S' => self.modal.speed_rpm = number.to_f32(),
            b'T' => self.modal.tool = tool_number(number)?,
            _ => return Err(LineError::Unsupported),
        }
        self.insert_word(Word::new(letter))?;
        if matches!(letter, b'F' | b'H' | b'N' | b'P' | b'Q' | b'S' | b'T') && number.is_negative()
        {
            return Err(LineError::NegativeValue);
        }
        Ok(())
    }

    fn axis_word(&mut self, letter: u8, number: Decimal) -> Result<(), LineError> {
        let axis = LETTERS.iter().position(|&known| known == letter);
        let coordinate = axis.and_then(|axis| self.coordinates.0.get_mut(axis));
        let (Some(axis), Some(coordinate)) = (axis, coordinate) else {
            return Err(LineError::Unsupported);
        };
        let bit = 1 << axis;
        if self.axes & bit != 0 {
            return Err(LineError::RepeatedWord);
        }
        self.axes |= bit;
        *coordinate = number;
        Ok(())
    }

    /// Adds a value word, which must be the first of its letter.
    fn insert_word(&mut self, word: Word) -> Result<(), LineError> {
        if self.words.contains(word) {
            return Err(LineError::RepeatedWord);
        }
        self.words.insert(word);
        Ok(())
    }

    /// Adds a command, which must be the first of its group.
    fn insert_group(&mut self, group: ModalGroup) -> Result<(), LineError> {
        if self.has_group(group) {
            return Err(LineError::ModalGroupViolation);
        }
        self.groups |= group as u32;
        Ok(())
    }
}

/// Returns the number of a tool, without its fraction; 0 for a negative one, which is an error elsewhere.
///
/// # Errors
/// [`LineError::UnknownTool`].
pub(super) fn tool_number(number: Decimal) -> Result<u8, LineError> {
    match u8::try_from(number.trunc()) {
        Ok(u8::MAX) if !number.is_whole() => Err(LineError::UnknownTool),
        Ok(tool) => Ok(tool),
        Err(_) if number.is_negative() => Ok(0),
        Err(_) => Err(LineError::UnknownTool),
    }
}
