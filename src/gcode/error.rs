//! Why a line was refused, with Grbl's numbers.

use core::fmt;

/// The reason of an `error:N` answer. The discriminant is N.
///
/// Numbers up to 38 are Grbl 1.1's, those above are grblHAL's where its meaning fits, and from 200
/// on this firmware's own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum LineError {
    /// A word does not begin with a letter.
    ExpectedLetter = 1,
    /// A letter without a number, or a number that cannot be read.
    BadNumber = 2,
    /// A `$` statement that is not known.
    InvalidStatement = 3,
    /// A negative value where none is allowed.
    NegativeValue = 4,
    /// Homing is switched off.
    HomingDisabled = 5,
    /// `$0` below 3 µs.
    StepPulseTooShort = 6,
    /// Stored values could not be read.
    StorageRead = 7,
    /// The machine is not idle.
    NotIdle = 8,
    /// G-code is locked out by an alarm or a jog.
    Locked = 9,
    /// Soft limits without homing.
    SoftLimitsNeedHoming = 10,
    /// A line that is too long.
    LineOverflow = 11,
    /// A step rate above what the firmware can give.
    StepRateTooHigh = 12,
    /// The safety door is open.
    DoorOpen = 13,
    /// A start-up line or build text that is too long.
    StoredLineTooLong = 14,
    /// A jog beyond the travel of the machine.
    JogBeyondTravel = 15,
    /// A jog without `=` or with a command that cannot be jogged.
    InvalidJog = 16,
    /// Laser mode without a variable spindle output.
    LaserNeedsPwm = 17,
    /// A value that must be above 0.
    NotPositive = 19,
    /// A command or word that is not supported.
    Unsupported = 20,
    /// Two commands of one modal group.
    ModalGroupViolation = 21,
    /// No feed rate has been set.
    FeedUndefined = 22,
    /// A command number with a fraction that it does not have.
    NotInteger = 23,
    /// Two commands that both want the axis words.
    AxisCommandConflict = 24,
    /// A word that is given twice.
    RepeatedWord = 25,
    /// A command that needs axis words has none.
    NoAxisWords = 26,
    /// A line number above 10 000 000.
    LineNumberTooHigh = 27,
    /// A command lacks a value word.
    MissingWord = 28,
    /// A work coordinate system that does not exist.
    UnknownCoordinates = 29,
    /// `G53` without `G0` or `G1`.
    MachineCoordinatesMotion = 30,
    /// Axis words that no command uses.
    UnusedAxisWords = 31,
    /// An arc without an axis word of its plane.
    NoAxisWordsInPlane = 32,
    /// A target that cannot be reached.
    InvalidTarget = 33,
    /// An arc whose radius is too short for its end point.
    ArcRadius = 34,
    /// An arc without an offset in its plane.
    NoOffsetsInPlane = 35,
    /// A value word that no command uses.
    UnusedWords = 36,
    /// `G43.1` with other axis words than that of the tool axis.
    ToolLengthAxis = 37,
    /// A tool number above 255, or a tool that is not in the tool table.
    UnknownTool = 38,
    /// A value outside its range.
    ValueOutOfRange = 39,
    /// A line that has no place in the change of a tool.
    ToolChange = 40,
    /// A cycle that switches the spindle, and the spindle is off or turns the other way.
    SpindleOff = 41,
    /// A code that is not possible in this plane.
    NotInThisPlane = 42,
    /// `G43.2` with `H` and axis words.
    ToolLengthWords = 48,
    /// A setting outside its range.
    SettingOutOfRange = 52,
    /// A canned cycle with `R` below the bottom of the hole.
    RetractBelowBottom = 54,
    /// Cutter compensation, while it is on.
    CompensationOn = 90,
    /// A code that is not possible with cutter compensation.
    NotWithCompensation = 91,
    /// An entry, an arc or a corner into which the cutter does not fit.
    CutterDoesNotFit = 92,
    /// A line whose checksum is wrong, or a number without a checksum, or a checksum without a number.
    Checksum = 200,
    /// A line whose number does not follow that of the last line.
    LineNumber = 201,
    /// `G1 R1` without a pause before.
    NoPausePosition = 202,
    /// Homing while a limit switch of an axis to be homed is closed already.
    LimitsEngaged = 203,
    /// A change that could not be stored, and has not been made.
    StorageWrite = 204,
    /// An arc as the first move after cutter compensation.
    ArcAfterCompensation = 205,
    /// A tool more than the tool table holds.
    ToolTableFull = 206,
    /// More than waits for the next move along the compensated path.
    TooMuchWaits = 207,
    /// A canned cycle in `G93`.
    CycleNeedsFeedPerMinute = 208,
    /// Bytes of the line are lost, or came damaged.
    BytesLost = 210,
}

impl LineError {
    /// Every error, in the order of the numbers.
    pub const ALL: [Self; 57] = [
        Self::ExpectedLetter,
        Self::BadNumber,
        Self::InvalidStatement,
        Self::NegativeValue,
        Self::HomingDisabled,
        Self::StepPulseTooShort,
        Self::StorageRead,
        Self::NotIdle,
        Self::Locked,
        Self::SoftLimitsNeedHoming,
        Self::LineOverflow,
        Self::StepRateTooHigh,
        Self::DoorOpen,
        Self::StoredLineTooLong,
        Self::JogBeyondTravel,
        Self::InvalidJog,
        Self::LaserNeedsPwm,
        Self::NotPositive,
        Self::Unsupported,
        Self::ModalGroupViolation,
        Self::FeedUndefined,
        Self::NotInteger,
        Self::AxisCommandConflict,
        Self::RepeatedWord,
        Self::NoAxisWords,
        Self::LineNumberTooHigh,
        Self::MissingWord,
        Self::UnknownCoordinates,
        Self::MachineCoordinatesMotion,
        Self::UnusedAxisWords,
        Self::NoAxisWordsInPlane,
        Self::InvalidTarget,
        Self::ArcRadius,
        Self::NoOffsetsInPlane,
        Self::UnusedWords,
        Self::ToolLengthAxis,
        Self::UnknownTool,
        Self::ValueOutOfRange,
        Self::ToolChange,
        Self::SpindleOff,
        Self::NotInThisPlane,
        Self::ToolLengthWords,
        Self::SettingOutOfRange,
        Self::RetractBelowBottom,
        Self::CompensationOn,
        Self::NotWithCompensation,
        Self::CutterDoesNotFit,
        Self::Checksum,
        Self::LineNumber,
        Self::NoPausePosition,
        Self::LimitsEngaged,
        Self::StorageWrite,
        Self::ArcAfterCompensation,
        Self::ToolTableFull,
        Self::TooMuchWaits,
        Self::CycleNeedsFeedPerMinute,
        Self::BytesLost,
    ];

    /// The number after `error:`.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// What is wrong, on one line.
    #[expect(clippy::too_many_lines, reason = "each error has its line")]
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::ExpectedLetter => "a word must begin with a letter",
            Self::BadNumber => "a letter must be followed by a number",
            Self::InvalidStatement => "this $ statement is not known",
            Self::NegativeValue => "the value must not be negative",
            Self::HomingDisabled => "homing is switched off ($22)",
            Self::StepPulseTooShort => "the step pulse must be at least 3 µs",
            Self::StorageRead => "stored values could not be read and were set to defaults",
            Self::NotIdle => "only possible while the machine is idle",
            Self::Locked => "locked by an alarm or a jog",
            Self::SoftLimitsNeedHoming => "soft limits need homing ($22)",
            Self::LineOverflow => "the line is too long",
            Self::StepRateTooHigh => {
                "the step rate exceeds what is proven, or what the step pulse leaves room for"
            }
            Self::DoorOpen => "the safety door is open",
            Self::StoredLineTooLong => "the line is too long to be stored",
            Self::JogBeyondTravel => "the jog would leave the travel of the machine",
            Self::InvalidJog => "not a valid jog command",
            Self::LaserNeedsPwm => "laser mode needs a variable spindle output",
            Self::NotPositive => "the value must be above 0",
            Self::Unsupported => "this command or word is not supported",
            Self::ModalGroupViolation => "two commands of one modal group",
            Self::FeedUndefined => "the feed rate is not set",
            Self::NotInteger => "this number must be whole",
            Self::AxisCommandConflict => "two commands want the axis words",
            Self::RepeatedWord => "a word is given twice",
            Self::NoAxisWords => "the command needs axis words",
            Self::LineNumberTooHigh => "the line number exceeds 10000000",
            Self::MissingWord => "the command lacks a value word",
            Self::UnknownCoordinates => "this work coordinate system does not exist",
            Self::MachineCoordinatesMotion => "G53 needs G0 or G1",
            Self::UnusedAxisWords => "no command uses the axis words",
            Self::NoAxisWordsInPlane => "the arc needs an axis word of its plane",
            Self::InvalidTarget => "the target cannot be reached",
            Self::ArcRadius => "the radius is too short for the end point",
            Self::NoOffsetsInPlane => "the arc needs an offset in its plane or a radius",
            Self::UnusedWords => "no command uses one of the value words",
            Self::ToolLengthAxis => "G43.1 needs the word of the tool axis and no other",
            Self::UnknownTool => "the tool number exceeds 255, or the tool is not in the table",
            Self::ValueOutOfRange => "the value is outside its range",
            Self::ToolChange => "not during a tool change",
            Self::ToolLengthWords => "G43.2 needs H or axis words, not both",
            Self::NotInThisPlane => "not possible in this plane",
            Self::SpindleOff => {
                "the cycle needs a spindle that turns: by M3 for G84, by M4 for G74"
            }
            Self::SettingOutOfRange => "the setting is outside its range",
            Self::RetractBelowBottom => "R is below the bottom of the hole",
            Self::CompensationOn => "cutter compensation is on already",
            Self::NotWithCompensation => "not possible while cutter compensation is on (G40)",
            Self::CutterDoesNotFit => {
                "the cutter does not fit: entry too short, arc too small, or corner too narrow"
            }
            Self::Checksum => "the checksum is wrong, or the line has not both it and a number",
            Self::LineNumber => "the line number is not the next one",
            Self::NoPausePosition => "no pause position",
            Self::LimitsEngaged => "a limit switch of an axis to be homed is closed",
            Self::StorageWrite => "the change could not be stored and has not been made",
            Self::ArcAfterCompensation => "the move after G40 must be straight",
            Self::ToolTableFull => "the tool table is full",
            Self::TooMuchWaits => "too much waits for the next move in the plane of compensation",
            Self::CycleNeedsFeedPerMinute => "canned cycles need G94",
            Self::BytesLost => "bytes of the line were lost or damaged on their way",
        }
    }
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error:{}", self.number())
    }
}

impl core::error::Error for LineError {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn errors_print_their_number_of_the_documented_list() {
        for (error, number) in [
            (LineError::ExpectedLetter, 1),
            (LineError::BadNumber, 2),
            (LineError::LaserNeedsPwm, 17),
            (LineError::Unsupported, 20),
            (LineError::ModalGroupViolation, 21),
            (LineError::FeedUndefined, 22),
            (LineError::NotInteger, 23),
            (LineError::AxisCommandConflict, 24),
            (LineError::RepeatedWord, 25),
            (LineError::NoAxisWords, 26),
            (LineError::LineNumberTooHigh, 27),
            (LineError::MissingWord, 28),
            (LineError::UnknownCoordinates, 29),
            (LineError::MachineCoordinatesMotion, 30),
            (LineError::UnusedAxisWords, 31),
            (LineError::NoAxisWordsInPlane, 32),
            (LineError::InvalidTarget, 33),
            (LineError::ArcRadius, 34),
            (LineError::NoOffsetsInPlane, 35),
            (LineError::UnusedWords, 36),
            (LineError::ToolLengthAxis, 37),
            (LineError::UnknownTool, 38),
        ] {
            assert_eq!(error.number(), number);
            assert_eq!(error.to_string(), std::format!("error:{number}"));
            assert!(!error.text().contains('\n'));
        }
    }
}
