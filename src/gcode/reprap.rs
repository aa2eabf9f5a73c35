//! Lines in the RepRap dialect: fields, and what their code asks for.
//!
//! What Grbl has, too, is written out in Grbl's words for the interpreter; the rest is an [`HostCommand`]. Read
//! with the G-code pages of the RepRap wiki and with Marlin 2.1.

mod m_codes;
mod motion;
mod parameters;

use self::{
    m_codes::m_code,
    motion::{dwell, is_one, set_position, write_motion, write_motors, write_return, write_word},
    parameters::axes,
};
use super::{LineError, Modal, interpreter::is_program_mark};
use crate::{axis::Axes, settings::Settings, units::Nm};

pub use self::parameters::{Parameter, Parameters, unescaped, value};

/// What a line asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Meaning {
    /// What Grbl has no words for; `None` for what has been written in Grbl's words.
    pub command: Option<HostCommand>,
    /// `E` and its modes after the line.
    pub extruder: Extruder,
    /// Time after which a pause ends by itself, ms.
    pub pause_ms: Option<u32>,
    /// The line moves single motors: the machine is not homed any more.
    pub moves_motors: bool,
    /// The limit switches of the axes that move end the line.
    pub ends_at_switch: bool,
    /// The letter of an axis that is not there, whose word has been left out.
    pub missing_axis: Option<u8>,
}

/// What Grbl has no words for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostCommand {
    /// Nothing: the line is answered.
    Nothing,
    /// `G28`: axes to be homed, bit 0 = X; 0 for all.
    Home(u8),
    /// `M105`: temperatures.
    Temperature,
    /// `M114`: the position of the last line, or of now.
    Position {
        /// `R`.
        is_now: bool,
    },
    /// `M115`: what the firmware is and can.
    Firmware,
    /// `M118`: the text behind the code.
    Echo,
    /// `M119`: the limit switches.
    Endstops,
    /// `M154 S`: the interval of reports of the position, s; 0 for none.
    PositionInterval(u8),
    /// `M20`: the files on a card that is not there.
    Files,
    /// `M400`: standstill.
    Standstill,
    /// `M17`, `M18`, `M84`: whether the drivers are on.
    Drivers(bool),
    /// `M18 S`, `M84 S`: the time of standstill after which the drivers go off, s; 0 for never.
    DriversDelay(u16),
    /// `M220 S`: the feed override, %.
    FeedOverride(u8),
    /// `M92`: the resolution of the axes, which only a setting changes.
    Resolution {
        /// There is a word to change it.
        is_set: bool,
    },
    /// `M201`: the accelerations of the axes, mm/s²; the words lower them.
    Acceleration,
    /// `M203`: the speeds of the axes, mm/s; the words lower them.
    Speed,
    /// `M204`: the acceleration of all axes, mm/s²; the words lower it.
    CommonAcceleration,
    /// `M205`: the junction deviation, which only a setting changes.
    Junction {
        /// There is a word to change it.
        is_set: bool,
    },
    /// `M502`: the defaults, which only a `$` statement restores.
    Defaults,
    /// `M503`: the settings.
    Settings,
    /// `M112`.
    Kill,
    /// `M999`: ends the lock.
    Restart,
    /// A part that this machine does not have, of this M code.
    NotPresent(u16),
    /// `T1` and above.
    InvalidTool(u16),
    /// `M113 S`: the interval of the messages that a line is not done, s.
    BusyInterval(u8),
}

/// `E`: what is extruded, and how its words count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extruder {
    /// Its logical position.
    pub position: Nm,
    /// Words are counted from the position before: `M83`.
    pub is_relative: bool,
    /// What the axis makes of a word, %: `M221`.
    pub flow_percent: u16,
}

impl Default for Extruder {
    /// At 0, with absolute words.
    fn default() -> Self {
        Self {
            position: Nm(0),
            is_relative: false,
            flow_percent: 100,
        }
    }
}

/// The modes in which a line is read.
#[derive(Debug)]
pub struct LineModes<'a> {
    /// The settings.
    pub settings: &'a Settings,
    /// The modes of Grbl's words.
    pub modal: &'a Modal,
    /// `E` and its modes.
    pub extruder: Extruder,
    /// Work position of the axis that `E` drives, by its number.
    pub driven: Option<(usize, Nm)>,
    /// Where the program is, in machine coordinates.
    pub position: Axes<Nm>,
    /// Where the machine has paused last, in machine coordinates.
    pub paused_at: Option<Axes<Nm>>,
    /// Whether nothing moves.
    pub is_idle: bool,
    /// Whether the axes are where their coordinates say.
    pub is_homed: bool,
}

/// Reads a line without number and checksum, and writes what Grbl has words for.
///
/// # Errors
/// 1, 2 for an unreadable line; 20 for an unknown code; 21 for a code beside one that stands alone; 36 for an `E` in a
/// move up to a switch; 39 for a value out of range.
pub fn read(
    line: &[u8],
    context: &LineModes<'_>,
    mut write: impl FnMut(&[u8]),
) -> Result<Meaning, LineError> {
    let mut meaning = Meaning {
        command: None,
        extruder: context.extruder,
        pause_ms: None,
        moves_motors: false,
        ends_at_switch: false,
        missing_axis: None,
    };
    if is_program_mark(line.trim_ascii()) {
        write(line.trim_ascii());
        return Ok(meaning);
    }
    let codes = match LineCodes::read(line)? {
        Ok(codes) => codes,
        Err(text) => {
            meaning.command = Some(text);
            return Ok(meaning);
        }
    };
    match codes.kind {
        HostLine::Host(number) => {
            meaning.command = m_code(number, line, context, &mut meaning, &mut write)?;
        }
        HostLine::Tool(number) => {
            meaning.command = Some(match number {
                0 => HostCommand::Nothing,
                number => HostCommand::InvalidTool(number),
            });
        }
        HostLine::Home => meaning.command = Some(HostCommand::Home(axes(line))),
        HostLine::Dwell => meaning.command = dwell(line, &mut write)?,
        HostLine::SetPosition => {
            meaning.command = set_position(line, context, &mut meaning, &mut write)?;
        }
        HostLine::Motors => write_motors(line, *b"ABC", context, &codes, &mut meaning, &mut write)?,
        HostLine::Motion if codes.is_straight && is_one(line, b'R', 1)? => {
            write_return(line, context, &codes, &mut write)?;
        }
        HostLine::Motion
            if codes.is_straight && !context.settings.laser && is_one(line, b'S', 2)? =>
        {
            write_motors(line, *b"XYZ", context, &codes, &mut meaning, &mut write)?;
        }
        HostLine::Motion if codes.is_straight && is_one(line, b'S', 1)? => {
            meaning.ends_at_switch = !context.settings.laser;
            write_motion(line, context, &codes, &mut meaning, &mut write)?;
        }
        HostLine::Motion => write_motion(line, context, &codes, &mut meaning, &mut write)?,
        HostLine::Grbl => {
            for parameter in Parameters::new(line) {
                let parameter = parameter?;
                write_word(&parameter, context, &mut write);
            }
            meaning.extruder.is_relative =
                codes.is_incremental.unwrap_or(context.extruder.is_relative);
        }
    }
    Ok(meaning)
}

/// What the codes of a line are about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HostLine {
    /// An M code that Grbl does not have, or that means something else there.
    Host(u16),
    /// A tool alone.
    Tool(u16),
    /// `G28`.
    Home,
    /// `G4`.
    Dwell,
    /// `G6`.
    Motors,
    /// `G92`.
    SetPosition,
    /// `G0` to `G3`, words without a code, and modes.
    Motion,
    /// What Grbl reads as it is.
    Grbl,
}

/// The codes of a line.
#[derive(Debug)]
struct LineCodes {
    kind: HostLine,
    /// `G90` or `G91`.
    is_incremental: Option<bool>,
    /// `G20` or `G21`.
    is_in_inches: Option<bool>,
    /// `G2` or `G3`, and `G0` or `G1`.
    is_arc: bool,
    is_straight: bool,
    /// `G64`.
    has_tolerances: bool,
}

impl LineCodes {
    /// Reads the codes, or the command of which the rest of the line is the text.
    fn read(line: &[u8]) -> Result<Result<Self, HostCommand>, LineError> {
        let mut codes = Self {
            kind: HostLine::Motion,
            is_incremental: None,
            is_in_inches: None,
            is_arc: false,
            is_straight: false,
            has_tolerances: false,
        };
        let mut tool = None;
        let mut has_code = false;
        let mut stands_alone = false;
        for parameter in Parameters::new(line) {
            let parameter = parameter?;
            if !matches!(parameter.letter, b'G' | b'M') {
                if parameter.letter == b'T' {
                    tool = Some(parameter.code());
                }
                continue;
            }
            let code = (parameter.letter, parameter.code());
            stands_alone |= match code {
                (b'G', number) => matches!(number, Some(4 | 6 | 28 | 92)),
                (_, number) => !matches!(number, None | Some(2..=9 | 30 | 48..=53 | 61)),
            };
            if has_code && stands_alone {
                return Err(LineError::ModalGroupViolation);
            }
            has_code = true;
            match code {
                (b'G', number) => codes.g_code(number)?,
                (_, Some(117)) => return Ok(Err(HostCommand::Nothing)),
                (_, Some(118)) => return Ok(Err(HostCommand::Echo)),
                (_, Some(number)) if stands_alone => codes.kind = HostLine::Host(number),
                (_, Some(_)) => codes.kind = HostLine::Grbl,
                (_, None) => return Err(LineError::Unsupported),
            }
        }
        if let (Some(number), false) = (tool, has_code) {
            codes.kind = HostLine::Tool(number.ok_or(LineError::BadNumber)?);
        }
        Ok(Ok(codes))
    }

    fn g_code(&mut self, number: Option<u16>) -> Result<(), LineError> {
        match number {
            Some(2 | 3) => self.is_arc = true,
            Some(20 | 21) => self.is_in_inches = Some(number == Some(20)),
            Some(90 | 91) => self.is_incremental = Some(number == Some(91)),
            Some(0 | 1) => self.is_straight = true,
            Some(64) => self.has_tolerances = true,
            Some(17..=19 | 53..=59 | 61 | 93 | 94) => {}
            Some(4) => self.kind = HostLine::Dwell,
            Some(6) => self.kind = HostLine::Motors,
            Some(28) => self.kind = HostLine::Home,
            Some(92) => self.kind = HostLine::SetPosition,
            Some(29..=32) => return Err(LineError::Unsupported),
            Some(_) | None => self.kind = HostLine::Grbl,
        }
        Ok(())
    }
}
