//! `$` statements: their meaning, and whether the machine's state allows them.
//!
//! Pure: `session` executes them. Read with Grbl 1.1 `system.c`, whose order of checks gives
//! each wrong statement its number.

use core::num::NonZeroU8;

use crate::{
    axis::{AXES, LETTERS},
    gcode::LineError,
    model::Bootloader,
    settings::{self, Change, STARTUP_LINES, STORED_LINE, SettingError, Settings},
};

/// The state of the machine, as far as `$` statements are concerned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Condition {
    /// Nothing is being executed and nothing is waiting to be.
    Idle,
    /// Something is being executed.
    Run,
    /// Jogging.
    Jog,
    /// Checking a program.
    Check,
    /// Locked by an alarm.
    Alarm,
}

/// A `$` statement that is allowed now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dollar<'a> {
    /// `$`.
    Help,
    /// A statement whose answer is a list.
    List(List),
    /// `$G`.
    Modes,
    /// `$I=text`.
    StoreBuildInfo(&'a [u8]),
    /// `$Nn=line`: the number and the line, which must be executed first.
    StoreStartup(usize, &'a [u8]),
    /// `$X`.
    Unlock,
    /// `$C`, where it begins check mode.
    Check,
    /// `$C`, where it ends check mode.
    EndCheck,
    /// `$H` (0) or `$HX` and so on (bit 0 = X).
    Home(u8),
    /// `$J=line`.
    Jog(&'a [u8]),
    /// `$SLP`.
    Sleep,
    /// `$DFU`, `$UF2`.
    Boot(Bootloader),
    /// `$RST=$`, `$RST=#`, `$RST=*`.
    Restore(Change),
    /// `$TTn=words`: the number of a tool, and its words, none to remove it.
    SetTool(NonZeroU8, &'a [u8]),
    /// `$n=value`: everything after the `$`.
    Assign(&'a [u8]),
}

/// An answer of many lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum List {
    /// `$$`.
    Settings,
    /// `$+`: also the settings that Grbl does not have.
    AllSettings,
    /// `$#`.
    Parameters,
    /// `$TT`: the tool table.
    Tools,
    /// `$I`.
    BuildInfo,
    /// `$I+`: also what is beyond Grbl.
    ExtendedBuildInfo,
    /// `$N`.
    StartupLines,
    /// `$ES`, `$EG`, `$EE`, `$EA`: descriptions for programs.
    Described(Described),
}

/// What is described for programs, in grblHAL's format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Described {
    /// `$ES`: the settings.
    Settings,
    /// `$EG`: their groups.
    Groups,
    /// `$EE`: the errors.
    Errors,
    /// `$EA`: the alarms.
    Alarms,
}

impl<'a> Dollar<'a> {
    /// Reads the text after the `$`. `is_door_open` is the state of the door's contact.
    ///
    /// # Errors
    /// Those of Grbl, in its order; 3 for a startup line that does not exist.
    pub fn read(
        statement: &'a [u8],
        condition: Condition,
        settings: &Settings,
        is_door_open: bool,
    ) -> Result<Self, LineError> {
        let described = match statement {
            [b'E', b'S'] => Some(Described::Settings),
            [b'E', b'G'] => Some(Described::Groups),
            [b'E', b'E'] => Some(Described::Errors),
            [b'E', b'A'] => Some(Described::Alarms),
            _ => None,
        };
        let is_idle = condition == Condition::Idle;
        match statement {
            [] => Ok(Self::Help),
            [b'J', ..] if !is_idle && condition != Condition::Jog => Err(LineError::NotIdle),
            [b'J', b'=', line @ ..] => Ok(Self::Jog(line)),
            [b'J' | b'$' | b'G' | b'C' | b'X', _, ..] | [b'J'] => Err(LineError::InvalidStatement),
            [b'$' | b'+'] if condition == Condition::Run => Err(LineError::NotIdle),
            _ if described.is_some() && condition == Condition::Run => Err(LineError::NotIdle),
            [b'$'] => Ok(Self::List(List::Settings)),
            [b'+'] => Ok(Self::List(List::AllSettings)),
            [b'G'] => Ok(Self::Modes),
            [b'C'] if condition == Condition::Check => Ok(Self::EndCheck),
            [b'C'] if is_idle => Ok(Self::Check),
            [b'C'] => Err(LineError::NotIdle),
            [b'X'] if condition == Condition::Alarm && is_door_open => Err(LineError::DoorOpen),
            [b'X'] => Ok(Self::Unlock),
            _ => match described {
                Some(described) => Ok(Self::List(List::Described(described))),
                None if is_idle || condition == Condition::Alarm => {
                    Self::read_when_idle(statement, condition, settings, is_door_open)
                }
                None => Err(LineError::NotIdle),
            },
        }
    }

    /// Reads the statements that need an idle machine.
    fn read_when_idle(
        statement: &'a [u8],
        condition: Condition,
        settings: &Settings,
        is_door_open: bool,
    ) -> Result<Self, LineError> {
        match statement {
            [b'#'] => Ok(Self::List(List::Parameters)),
            [b'H', ..] if !settings.is_homing_on() => Err(LineError::HomingDisabled),
            [b'H', ..] if is_door_open => Err(LineError::DoorOpen),
            [b'H'] => Ok(Self::Home(0)),
            [b'H', letter] => axis_mask(*letter).map(Self::Home),
            [b'S', b'L', b'P'] => Ok(Self::Sleep),
            [b'D', b'F', b'U'] => Ok(Self::Boot(Bootloader::Dfu)),
            [b'U', b'F', b'2'] => Ok(Self::Boot(Bootloader::Uf2)),
            [b'I'] => Ok(Self::List(List::BuildInfo)),
            [b'I', b'+'] => Ok(Self::List(List::ExtendedBuildInfo)),
            [b'I', b'=', text @ ..] if !text.iter().any(|byte| *byte > 0x7f) => {
                fitting(text).map(Self::StoreBuildInfo)
            }
            [b'R', b'S', b'T', b'=', what] => match what {
                b'$' => Ok(Self::Restore(Change::RestoreSettings)),
                b'#' => Ok(Self::Restore(Change::RestoreOrigins)),
                b'*' => Ok(Self::Restore(Change::RestoreAll)),
                _ => Err(LineError::InvalidStatement),
            },
            [b'T', b'T'] => Ok(Self::List(List::Tools)),
            [b'T', b'T', text @ ..] => tool(text),
            [b'N'] => Ok(Self::List(List::StartupLines)),
            [b'N', ..] if condition != Condition::Idle => Err(LineError::NotIdle),
            [b'N', text @ ..] => startup(text),
            [b'#' | b'H' | b'S' | b'I' | b'R', ..] => Err(LineError::InvalidStatement),
            _ => Ok(Self::Assign(statement)),
        }
    }
}

/// Returns the bit of an axis, if the machine has it.
fn axis_mask(letter: u8) -> Result<u8, LineError> {
    let axis = LETTERS.iter().take(AXES).position(|&known| known == letter);
    axis.map(|axis| 1 << axis)
        .ok_or(LineError::InvalidStatement)
}

/// Returns a text to be stored, unless it is too long.
fn fitting(text: &[u8]) -> Result<&[u8], LineError> {
    let is_fitting = text.len() <= STORED_LINE;
    is_fitting
        .then_some(text)
        .ok_or(LineError::StoredLineTooLong)
}

/// Returns the number and the text of a startup line, if the number exists.
fn startup(statement: &[u8]) -> Result<Dollar<'_>, LineError> {
    let (number, line) = settings::numbered(statement)?;
    match usize::try_from(number) {
        Ok(number) if number < STARTUP_LINES => Ok(Dollar::StoreStartup(number, fitting(line)?)),
        _ => Err(LineError::InvalidStatement),
    }
}

/// Returns the number and the words of a tool.
fn tool(statement: &[u8]) -> Result<Dollar<'_>, LineError> {
    let (number, words) = settings::numbered(statement)?;
    let number = u8::try_from(number).ok().and_then(NonZeroU8::new);
    number
        .map(|number| Dollar::SetTool(number, words))
        .ok_or(LineError::UnknownTool)
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
            SettingError::StepRate => Self::StepRateTooHigh,
        }
    }
}

/// A `$` statement as users write it, for the documents.
#[derive(Debug)]
pub struct Statement {
    /// What is written, with names for what varies.
    pub form: &'static str,
    /// One example, without the `$`.
    pub example: &'static str,
    /// A state in which it is allowed.
    pub condition: Condition,
    /// How the answer to `$` shows it. A statement that Grbl does not have stays out of the answer: senders compare it.
    pub help: Option<&'static str>,
    /// What it does.
    pub text: &'static str,
}

/// Declares every statement: its variant, its form, an example, a state, the help, and what it does.
macro_rules! statements {
    ($($pattern:pat => $form:literal, $example:literal, $condition:ident, $help:expr, $text:literal;)*) => {
        /// Every `$` statement.
        pub const STATEMENTS: &[Statement] = &[$(Statement {
            form: $form,
            example: $example,
            condition: Condition::$condition,
            help: $help,
            text: $text,
        }),*];

        /// The example of a statement.
        #[cfg(test)]
        fn example_of(statement: &Dollar<'_>) -> &'static str {
            match statement {
                $($pattern => $example,)*
            }
        }
    };
}

statements! {
    Dollar::Help => "$", "", Idle, None, "lists the statements that Grbl has";
    Dollar::List(List::Settings) => "$$", "$", Idle, Some("$$"), "lists the settings of Grbl with their values";
    Dollar::List(List::AllSettings) => "$+", "+", Idle, None, "the same, and the settings that Grbl does not have";
    Dollar::Assign(_) => "$n=value", "0=10", Idle, Some("$x=val"), "sets and stores a setting";
    Dollar::List(List::Parameters) => "$#", "#", Idle, Some("$#"),
        "lists the origins of the coordinate systems, `G28`, `G30`, `G92`, the tool length and the last probe contact";
    Dollar::Modes => "$G", "G", Idle, Some("$G"), "shows the modes in effect, tool, feed and spindle speed";
    Dollar::List(List::BuildInfo) => "$I", "I", Idle, Some("$I"), "shows version, text and options of the firmware";
    Dollar::List(List::ExtendedBuildInfo) => "$I+", "I+", Idle, None,
        "the same, with what is beyond Grbl and the causes of restarts";
    Dollar::StoreBuildInfo(_) => "$I=text", "I=TEXT", Idle, None, "stores the text that `$I` shows";
    Dollar::List(List::StartupLines) => "$N", "N", Idle, Some("$N"), "lists the two startup lines";
    Dollar::StoreStartup(..) => "$Nn=line", "N0=G21", Idle, Some("$Nx=line"),
        "executes a line, and stores it to be executed at each start";
    Dollar::Jog(_) => "$J=line", "J=X1F100", Idle, Some("$J=line"), "jogs: a move that can be cancelled";
    Dollar::Check => "$C", "C", Idle, Some("$C"), "checks programs from now on and moves nothing; again, ends that with a reset";
    Dollar::EndCheck => "$C", "C", Check, None, "ends that, with a reset";
    Dollar::Unlock => "$X", "X", Alarm, Some("$X"), "ends the lock of an alarm; otherwise compensation, `G41` and `G42`";
    Dollar::Home(_) => "$H, $HX", "H", Idle, Some("$H"), "homes all axes, or one";
    Dollar::Sleep => "$SLP", "SLP", Idle, Some("$SLP"), "switches everything off until a reset";
    Dollar::Boot(Bootloader::Dfu) => "$DFU", "DFU", Idle, None,
        "switches everything off, and starts the chip's own bootloader, which takes firmware over USB";
    Dollar::Boot(Bootloader::Uf2) => "$UF2", "UF2", Idle, None,
        "the same with a bootloader that shows a drive for UF2 files";
    Dollar::Restore(_) => "$RST=$, $RST=#, $RST=*", "RST=$", Idle, None,
        "restores the defaults: of the settings, of origins and positions, of everything";
    Dollar::List(List::Tools) => "$TT", "TT", Idle, None, "lists the tool table";
    Dollar::SetTool(..) => "$TTn=words", "TT1=Z5", Idle, None,
        "sets the lengths (`X` `Y` `Z`) and the diameter (`D`) of a tool; without words, removes it";
    Dollar::List(List::Described(Described::Settings)) => "$ES", "ES", Idle, None, "describes the settings, for programs";
    Dollar::List(List::Described(Described::Groups)) => "$EG", "EG", Idle, None, "describes the groups of settings";
    Dollar::List(List::Described(Described::Errors)) => "$EE", "EE", Idle, None, "describes the errors";
    Dollar::List(List::Described(Described::Alarms)) => "$EA", "EA", Idle, None, "describes the alarms";
}

#[cfg(test)]
mod tests {
    use std::{string::String, vec::Vec};

    use super::*;
    use crate::protocol::{listing, text::Text};

    const STATES: [Condition; 5] = [
        Condition::Idle,
        Condition::Run,
        Condition::Jog,
        Condition::Check,
        Condition::Alarm,
    ];

    fn number(statement: &str, condition: Condition) -> u8 {
        let settings = Settings::default();
        Dollar::read(statement.as_bytes(), condition, &settings, false)
            .map_or_else(LineError::number, |_| 0)
    }

    #[test]
    fn statements_are_allowed_where_grbl_allows_them() {
        // Statement, then the error number when idle, running, jogging, checking and locked.
        for (statement, numbers) in [
            ("", [0, 0, 0, 0, 0]),
            ("$", [0, 8, 0, 0, 0]),
            ("+", [0, 8, 0, 0, 0]),
            ("ES", [0, 8, 0, 0, 0]),
            ("EX", [0, 8, 8, 8, 0]),
            ("G", [0, 0, 0, 0, 0]),
            ("X", [0, 0, 0, 0, 0]),
            ("C", [0, 8, 8, 0, 8]),
            ("J=X1F100", [0, 8, 0, 8, 8]),
            ("J", [3, 8, 3, 8, 8]),
            ("JX1", [3, 8, 3, 8, 8]),
            ("#", [0, 8, 8, 8, 0]),
            ("TT", [0, 8, 8, 8, 0]),
            ("TT1=Z5", [0, 8, 8, 8, 0]),
            ("TT1", [3, 8, 8, 8, 3]),
            ("TTX=Z5", [2, 8, 8, 8, 2]),
            ("TT0=Z5", [38, 8, 8, 8, 38]),
            ("TT256=", [38, 8, 8, 8, 38]),
            ("I", [0, 8, 8, 8, 0]),
            ("I+", [0, 8, 8, 8, 0]),
            ("I=TEXT", [0, 8, 8, 8, 0]),
            ("N", [0, 8, 8, 8, 0]),
            ("N0=G21", [0, 8, 8, 8, 8]),
            ("N0.5=G21", [3, 8, 8, 8, 8]),
            ("N2=G21", [3, 8, 8, 8, 8]),
            ("N-1=G21", [3, 8, 8, 8, 8]),
            ("NX=G21", [2, 8, 8, 8, 8]),
            ("N0", [3, 8, 8, 8, 8]),
            ("SLP", [0, 8, 8, 8, 0]),
            ("DFU", [0, 8, 8, 8, 0]),
            ("UF2", [0, 8, 8, 8, 0]),
            ("RST=$", [0, 8, 8, 8, 0]),
            ("0=10", [0, 8, 8, 8, 0]),
            ("L", [0, 8, 8, 8, 0]),
            ("H", [5, 8, 8, 8, 5]),
            ("HX", [5, 8, 8, 8, 5]),
            ("$1", [3, 3, 3, 3, 3]),
            ("GG", [3, 3, 3, 3, 3]),
            ("X1", [3, 3, 3, 3, 3]),
            ("C1", [3, 3, 3, 3, 3]),
            ("#1", [3, 8, 8, 8, 3]),
            ("IX", [3, 8, 8, 8, 3]),
            ("S", [3, 8, 8, 8, 3]),
            ("SLPX", [3, 8, 8, 8, 3]),
            ("RST=", [3, 8, 8, 8, 3]),
            ("RST=X", [3, 8, 8, 8, 3]),
            ("RST=$$", [3, 8, 8, 8, 3]),
        ] {
            for (state, expected) in STATES.into_iter().zip(numbers) {
                assert_eq!(number(statement, state), expected, "${statement} {state:?}");
            }
        }
    }

    #[test]
    fn every_statement_is_read_from_its_words_and_shown_in_the_help() {
        let settings = Settings {
            homing: 1,
            ..Settings::default()
        };
        let mut help = Text::new();
        listing::help(&mut help);
        let help = String::from_utf8(help.as_bytes().to_vec()).unwrap();
        let help = help.trim_end().trim_matches(['[', ']']);
        let (_, shown) = help.split_once(':').unwrap();
        let mut shown: Vec<&str> = shown
            .split(' ')
            .filter(|word| word.starts_with('$'))
            .collect();
        for statement in STATEMENTS {
            let text = statement.example;
            let read = Dollar::read(text.as_bytes(), statement.condition, &settings, false);
            let read = read.map(|statement| example_of(&statement));
            assert_eq!(read, Ok(text), "add the words ${text} to `Dollar::read`");
            if let Some(help) = statement.help {
                assert!(shown.contains(&help), "add {help} to `listing::help`");
                shown.retain(|word| *word != help);
            }
        }
        assert!(shown.is_empty(), "add {shown:?} to `statements!` above");
    }

    #[test]
    fn homing_needs_to_be_switched_on_a_closed_door_and_an_axis() {
        let settings = Settings {
            homing: 1,
            ..Settings::default()
        };
        let read =
            |text: &'static [u8], door| Dollar::read(text, Condition::Alarm, &settings, door);
        assert_eq!(read(b"H", false), Ok(Dollar::Home(0)));
        assert_eq!(read(b"HZ", false), Ok(Dollar::Home(4)));
        assert_eq!(read(b"H1", false), Err(LineError::InvalidStatement));
        assert_eq!(read(b"HXY", false), Err(LineError::InvalidStatement));
        assert_eq!(read(b"H1", true), Err(LineError::DoorOpen));
        assert_eq!(read(b"X", true), Err(LineError::DoorOpen));
    }
}
