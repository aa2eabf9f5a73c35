//! `$` statements: what one asks for, and whether the machine's state allows it.
//!
//! Pure: `session` does what is asked. Read with Grbl 1.1 `system.c`, whose order of checks gives
//! each wrong statement its number.

use crate::{
    gcode::LineError,
    settings::{SettingError, Settings},
};

/// What the machine does, as far as `$` statements are concerned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Condition {
    /// Nothing is being executed and nothing is waiting to be.
    Idle,
    /// Something is being executed, or held.
    Busy,
    /// Locked by an alarm.
    Alarm,
}

/// A `$` statement that is allowed now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dollar<'a> {
    /// `$`.
    Help,
    /// `$$`.
    Settings,
    /// `$G`.
    Modes,
    /// `$#`.
    Parameters,
    /// `$I`.
    BuildInfo,
    /// `$N`.
    StartupLines,
    /// `$X`.
    Unlock,
    /// `$n=value`: everything after the `$`.
    Assign(&'a [u8]),
}

impl<'a> Dollar<'a> {
    /// Reads the text after the `$`.
    ///
    /// # Errors
    /// `InvalidStatement`, `NotIdle` or `HomingDisabled`.
    pub fn read(
        statement: &'a [u8],
        condition: Condition,
        settings: &Settings,
    ) -> Result<Self, LineError> {
        match statement {
            [] => Ok(Self::Help),
            [b'G'] => Ok(Self::Modes),
            [b'X'] => Ok(Self::Unlock),
            [b'$'] if condition == Condition::Busy => Err(LineError::NotIdle),
            [b'$'] => Ok(Self::Settings),
            [b'J', ..] | [b'C'] if condition != Condition::Idle => Err(LineError::NotIdle),
            [b'$' | b'G' | b'X' | b'C' | b'J', ..] => refuse(),
            _ if condition == Condition::Busy => Err(LineError::NotIdle),
            [b'#'] => Ok(Self::Parameters),
            [b'I'] => Ok(Self::BuildInfo),
            [b'N'] => Ok(Self::StartupLines),
            [b'N', ..] if condition != Condition::Idle => Err(LineError::NotIdle),
            [b'H', rest @ ..] if rest.is_empty() || !settings.homing => {
                Err(LineError::HomingDisabled)
            }
            [b'#' | b'H' | b'I' | b'N' | b'R' | b'S', ..] => refuse(),
            _ => Ok(Self::Assign(statement)),
        }
    }
}

/// The answer to statements that are wrong and to those that this firmware does not have:
/// `$C`, `$J=`, `$SLP`, `$RST=`, `$Nn=` and `$I=`. One that is added gets a variant of [`Dollar`]
/// and an arm before the one that leads here.
fn refuse<'a>() -> Result<Dollar<'a>, LineError> {
    Err(LineError::InvalidStatement)
}

impl From<SettingError> for LineError {
    fn from(error: SettingError) -> Self {
        match error {
            SettingError::BadNumber => Self::BadNumber,
            SettingError::BadStatement => Self::InvalidStatement,
            SettingError::Negative => Self::NegativeValue,
            SettingError::ShortPulse => Self::StepPulseTooShort,
            SettingError::NeedsHoming => Self::SoftLimitsNeedHoming,
            SettingError::OutOfRange => Self::SettingOutOfRange,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(statement: &str, condition: Condition) -> u8 {
        let settings = Settings::default();
        Dollar::read(statement.as_bytes(), condition, &settings)
            .map_or_else(LineError::number, |_| 0)
    }

    #[test]
    fn statements_are_allowed_where_grbl_allows_them() {
        // Statement, then the error number when idle, busy and locked; 0 is none.
        for (statement, idle, busy, alarm) in [
            ("", 0, 0, 0),
            ("$", 0, 8, 0),
            ("G", 0, 0, 0),
            ("X", 0, 0, 0),
            ("#", 0, 8, 0),
            ("I", 0, 8, 0),
            ("N", 0, 8, 0),
            ("0=10", 0, 8, 0),
            ("L", 0, 8, 0),
            ("H", 5, 8, 5),
            ("HX", 5, 8, 5),
            ("$1", 3, 3, 3),
            ("GG", 3, 3, 3),
            ("X1", 3, 3, 3),
            ("#1", 3, 8, 3),
            ("IX", 3, 8, 3),
            ("N0", 3, 8, 8),
            ("S", 3, 8, 3),
            ("SLPX", 3, 8, 3),
            ("RST=", 3, 8, 3),
            ("RST=$$", 3, 8, 3),
            ("C1", 3, 3, 3),
        ] {
            assert_eq!(number(statement, Condition::Idle), idle, "${statement}");
            assert_eq!(number(statement, Condition::Busy), busy, "${statement}");
            assert_eq!(number(statement, Condition::Alarm), alarm, "${statement}");
        }
    }

    #[test]
    fn what_the_firmware_does_not_have_is_refused_after_the_check_of_the_state() {
        for (statement, busy, alarm) in [
            ("C", 8, 8),
            ("J=X1F100", 8, 8),
            ("N0=G21", 8, 8),
            ("SLP", 8, 3),
            ("RST=$", 8, 3),
            ("I=TEXT", 8, 3),
        ] {
            assert_eq!(number(statement, Condition::Idle), 3, "${statement}");
            assert_eq!(number(statement, Condition::Busy), busy, "${statement}");
            assert_eq!(number(statement, Condition::Alarm), alarm, "${statement}");
        }
    }

    #[test]
    fn with_homing_switched_on_there_is_no_homing_of_one_axis() {
        let settings = Settings {
            homing: true,
            ..Settings::default()
        };
        let read = |text: &'static [u8]| Dollar::read(text, Condition::Alarm, &settings);
        assert_eq!(read(b"H"), Err(LineError::HomingDisabled));
        assert_eq!(read(b"H1"), Err(LineError::InvalidStatement));
    }
}
