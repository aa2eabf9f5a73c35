//! One line: its words gathered by modal group and letter.
//!
//! Finds every error that does not depend on the modes of earlier lines, in Grbl's order: word by
//! word from the left. The modes of the line replace those before it, in a copy.

mod code_words;

use super::{
    CodeNumber, CompensationMode, FEEDS_MM_MIN, FeedMode, Flow, LineError, Modal, MotionMode,
    PlainPrefix, ToolLength, Units, Word, WordReader, Words,
};
use crate::{
    axis::{AXES, Axes, LETTERS},
    decimal::Decimal,
    model::PathControl,
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
            // Q is unknown in other lines: this error comes before errors of the words after it.
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
        result?;
        let is_not_peck = self.has_path_tolerance() || self.tool_command == ToolCommand::Set;
        if is_not_peck && self.q.is_negative() {
            // A peck has to be more than 0, which is an error of its own.
            return Err(LineError::NegativeValue);
        }
        Ok(())
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
        let is_motion = self.has_target() || is_drilled_by_r;
        if is_motion && self.axis_command == AxisCommand::None {
            self.axis_command = AxisCommand::Motion;
        }
        // `G80` may stand beside a motion mode only where nothing moves.
        let has_both =
            self.has_group(ModalGroup::CycleCancel) && self.has_group(ModalGroup::Motion);
        if has_both && self.has_target() {
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

    /// `L` of `G10`, without its fraction; [`u8::MAX`], which is none, for what eight bits cannot hold.
    #[must_use]
    pub fn subcode(&self) -> u8 {
        u8::try_from(self.l.trunc()).unwrap_or(u8::MAX)
    }

    /// A length in the units of the line.
    #[must_use]
    pub fn length(&self, number: Decimal) -> Nm {
        Nm(match self.modal.units {
            Units::Millimetres => number.to_millionths(),
            Units::Inches => number.inches_to_nm(),
        })
    }

    /// A length in nm where 0 has a meaning of its own: no other length may be rounded to 0.
    ///
    /// # Errors
    /// [`LineError::ValueOutOfRange`] for a length that would become 0.
    pub fn exact_length(&self, number: Decimal) -> Result<Nm, LineError> {
        let length = self.length(number);
        if length == Nm(0) && !number.is_zero() {
            return Err(LineError::ValueOutOfRange);
        }
        Ok(length)
    }

    /// `P` as a dwell, in ms.
    ///
    /// # Errors
    /// [`LineError::ValueOutOfRange`] for one that is too long.
    pub fn dwell_ms(&self) -> Result<u32, LineError> {
        let milliseconds = self.p.at_least_one(Decimal::to_thousandths);
        u32::try_from(milliseconds).map_err(|_| LineError::ValueOutOfRange)
    }

    /// Whether the line says where a move goes: by axis words, or by the centre of a full circle, which ends where it
    /// begins.
    #[must_use]
    pub fn has_target(&self) -> bool {
        let is_circle = matches!(self.modal.motion, MotionMode::Arc(_))
            && self.non_modal == NonModal::None
            && self.words.contains(Word::IJK);
        self.axes != 0 || is_circle
    }

    /// Whether an axis has a word.
    #[must_use]
    pub const fn has_axis(&self, axis: usize) -> bool {
        self.axes >> axis & 1 != 0
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
            b'S' => self.modal.speed_rpm = speed(number)?,
            b'T' => self.modal.tool = tool_number(number)?,
            _ => return Err(LineError::Unsupported),
        }
        self.insert_word(Word::new(letter))?;
        if matches!(letter, b'F' | b'H' | b'N' | b'P' | b'S' | b'T') && number.is_negative() {
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

/// Returns the speed of an `S`: as far as a feed goes, every whole number is one in single precision.
fn speed(number: Decimal) -> Result<f32, LineError> {
    let rpm = number.to_f32();
    if rpm > *FEEDS_MM_MIN.end() {
        return Err(LineError::ValueOutOfRange);
    }
    Ok(rpm)
}

/// Returns the number of a tool; 0 for a negative one, which is an error elsewhere.
///
/// # Errors
/// [`LineError::NotInteger`] and [`LineError::UnknownTool`].
pub(super) fn tool_number(number: Decimal) -> Result<u8, LineError> {
    if number.is_negative() {
        return Ok(0);
    }
    if !number.is_whole() {
        return Err(LineError::NotInteger);
    }
    u8::try_from(number.trunc()).map_err(|_| LineError::UnknownTool)
}
