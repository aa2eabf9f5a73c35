//! Lines in the RepRap dialect: fields, and what their code asks for.
//!
//! What Grbl has, too, is written out in Grbl's words for the interpreter; the rest is an [`HostCommand`]. Read
//! with the G-code pages of the RepRap wiki and with Marlin 2.1.

use core::ops::RangeInclusive;

use super::{Distance, LineError, Modal, MotionMode, Units};
use crate::{
    axis::{AXES, Axes, LETTERS, LINEAR},
    decimal::Decimal,
    settings::Settings,
    units::Nm,
};

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

impl Extruder {
    /// At 0, with absolute words.
    pub const START: Self = Self {
        position: Nm(0),
        is_relative: false,
        flow_percent: 100,
    };
}

/// The modes in which a line is read.
#[derive(Debug)]
pub struct Context<'a> {
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

/// A field of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parameter<'a> {
    /// The letter, in upper case.
    pub letter: u8,
    /// The number as it is written, empty without one.
    pub number: &'a [u8],
    /// What is between the quotation marks, with all escapes, if it is a text.
    pub text: Option<&'a [u8]>,
}

/// The fields of a line, from left to right.
#[derive(Debug, Clone)]
pub struct Parameters<'a>(&'a [u8]);

impl<'a> Parameters<'a> {
    /// The fields of a line without number and checksum.
    #[must_use]
    pub const fn new(line: &'a [u8]) -> Self {
        Self(line)
    }

    /// Skips blanks and comments. A comment without an end takes the rest.
    fn skip(&mut self) {
        loop {
            self.0 = self.0.trim_ascii_start();
            match self.0 {
                [b';', ..] => self.0 = &[],
                [b'(', rest @ ..] => {
                    let end = rest.iter().position(|byte| *byte == b')');
                    self.0 = end.map_or(&[], |end| rest.get(end + 1..).unwrap_or_default());
                }
                _ => return,
            }
        }
    }

    fn take(&mut self, n: usize) -> &'a [u8] {
        let (taken, rest) = self.0.split_at_checked(n).unwrap_or((self.0, &[]));
        self.0 = rest;
        taken
    }

    fn take_number(&mut self) -> &'a [u8] {
        let is_part = |byte: &u8| matches!(byte, b'0'..=b'9' | b'.' | b'+' | b'-');
        let n = self.0.iter().take_while(|byte| is_part(byte)).count();
        self.take(n)
    }

    /// Takes a text, of which the quotation mark at the beginning has been taken.
    fn take_text(&mut self) -> Result<&'a [u8], LineError> {
        let mut bytes = self.0.iter().enumerate();
        while let Some((index, byte)) = bytes.next() {
            if *byte != b'"' {
                continue;
            }
            if self.0.get(index + 1) == Some(&b'"') {
                bytes.next();
                continue;
            }
            let text = self.take(index);
            self.take(1);
            return Ok(text);
        }
        Err(LineError::BadNumber)
    }
}

impl<'a> Iterator for Parameters<'a> {
    type Item = Result<Parameter<'a>, LineError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.skip();
        let letter = self.0.first()?.to_ascii_uppercase();
        if !letter.is_ascii_uppercase() {
            self.0 = &[];
            return Some(Err(LineError::ExpectedLetter));
        }
        self.take(1);
        self.skip();
        let mut field = Parameter {
            letter,
            number: &[],
            text: None,
        };
        if self.0.first() == Some(&b'"') {
            self.take(1);
            match self.take_text() {
                Ok(text) => field.text = Some(text),
                Err(error) => {
                    self.0 = &[];
                    return Some(Err(error));
                }
            }
        } else {
            field.number = self.take_number();
            // A list: the first of its numbers counts.
            while self.0.first() == Some(&b':') {
                self.take(1);
                self.take_number();
            }
        }
        Some(Ok(field))
    }
}

impl Parameter<'_> {
    /// The value, `None` for what is no number.
    #[must_use]
    pub fn value(&self) -> Option<Decimal> {
        let (number, rest) = Decimal::parse(self.number)?;
        rest.is_empty().then_some(number)
    }

    /// The number of a code, `None` for what is none.
    fn code(&self) -> Option<u16> {
        let is_whole = !self.number.is_empty() && self.number.iter().all(u8::is_ascii_digit);
        let value = if is_whole { self.value()? } else { return None };
        u16::try_from(value.trunc()).ok()
    }
}

/// Copies a text without its escapes: `""` is a quotation mark, `'` makes the next letter small, `''` is
/// an apostrophe.
pub fn unescaped(text: &[u8]) -> impl Iterator<Item = u8> {
    let mut bytes = text.iter().copied();
    core::iter::from_fn(move || match bytes.next()? {
        b'"' => bytes.next(),
        b'\'' => bytes.next().map(|byte| byte.to_ascii_lowercase()),
        byte => Some(byte),
    })
}

/// Reads a line without number and checksum, and writes what Grbl has words for.
///
/// # Errors
/// 1, 2 for a line that cannot be read; 20 for a code that is not known; 39 for a value out of range.
pub fn read(
    line: &[u8],
    context: &Context<'_>,
    mut write: impl FnMut(&[u8]),
) -> Result<Meaning, LineError> {
    let mut meaning = Meaning {
        command: None,
        extruder: context.extruder,
        pause_ms: None,
        moves_motors: false,
        missing_axis: None,
    };
    let codes = match Codes::read(line)? {
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
        HostLine::Motion => write_motion(line, context, &codes, &mut meaning, &mut write)?,
        HostLine::Grbl => {
            for parameter in Parameters::new(line) {
                let parameter = parameter?;
                write(&[parameter.letter]);
                write(parameter.number);
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
struct Codes {
    kind: HostLine,
    /// `G90` or `G91`.
    is_incremental: Option<bool>,
    /// `G20` or `G21`.
    is_in_inches: Option<bool>,
    /// `G2` or `G3`, and `G0` or `G1`.
    is_arc: bool,
    is_straight: bool,
}

impl Codes {
    /// Reads the codes, or the command of which the rest of the line is the text.
    fn read(line: &[u8]) -> Result<Result<Self, HostCommand>, LineError> {
        let mut codes = Self {
            kind: HostLine::Motion,
            is_incremental: None,
            is_in_inches: None,
            is_arc: false,
            is_straight: false,
        };
        let mut tool = None;
        let mut has_code = false;
        for parameter in Parameters::new(line) {
            let parameter = parameter?;
            match (parameter.letter, parameter.code()) {
                (b'M', Some(117)) => return Ok(Err(HostCommand::Nothing)),
                (b'M', Some(118)) => return Ok(Err(HostCommand::Echo)),
                (b'G', number) => codes.g_code(number)?,
                (b'M', Some(2..=9 | 30 | 48..=53 | 61)) => codes.kind = HostLine::Grbl,
                (b'M', Some(number)) if !has_code => codes.kind = HostLine::Host(number),
                (b'M', _) => return Err(LineError::Unsupported),
                (b'T', number) => tool = Some(number),
                _ => {}
            }
            has_code |= matches!(parameter.letter, b'G' | b'M');
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
            Some(17..=19 | 53..=59 | 61 | 64 | 93 | 94) => {}
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

/// Writes a line of motion: without words that have no meaning here, and with `E` as the axis that it
/// drives.
fn write_motion(
    line: &[u8],
    context: &Context<'_>,
    codes: &Codes,
    meaning: &mut Meaning,
    write: &mut impl FnMut(&[u8]),
) -> Result<(), LineError> {
    let is_laser = context.settings.laser;
    let is_modal_arc = matches!(context.modal.motion, MotionMode::Arc(_));
    let is_arc = codes.is_arc || is_modal_arc && !codes.is_straight;
    let driven = context.driven.map(|(axis, _)| LETTERS[axis]);
    let extruder = &mut meaning.extruder;
    extruder.is_relative = codes.is_incremental.unwrap_or(extruder.is_relative);
    let mut extruded = None;
    for parameter in Parameters::new(line) {
        let parameter = parameter?;
        match parameter.letter {
            b'G' if parameter.code() == Some(0) && !is_laser => write(b"G1"),
            b'E' => {
                let value = parameter.value().ok_or(LineError::BadNumber)?;
                let nm = length(value, codes.is_in_inches, context);
                extruded = Some(if extruder.is_relative {
                    extruder.position + nm
                } else {
                    nm
                });
            }
            b'S' if !is_laser => match parameter.value() {
                Some(mode) if mode.is_zero() => {}
                Some(_) => return Err(LineError::Unsupported),
                None => return Err(LineError::BadNumber),
            },
            letter if Some(letter) == driven => meaning.missing_axis = Some(letter),
            letter if is_motion_word(letter, is_arc) => {
                write(&[letter]);
                write(parameter.number);
            }
            letter @ (b'A'..=b'C' | b'U'..=b'W') => meaning.missing_axis = Some(letter),
            _ => {}
        }
    }
    if let Some(target) = extruded {
        let delta = scaled(target - extruder.position, extruder.flow_percent);
        extruder.position = target;
        if let Some((axis, work)) = context.driven
            && delta != Nm(0)
        {
            let is_incremental = context.modal.distance == Distance::Incremental;
            let word = if codes.is_incremental.unwrap_or(is_incremental) {
                delta
            } else {
                work + delta
            };
            write(&[LETTERS[axis]]);
            write_millionths(word.0, write);
        }
    }
    Ok(())
}

/// What the axis makes of an extruded length.
fn scaled(delta: Nm, percent: u16) -> Nm {
    if percent == 100 {
        return delta;
    }
    Nm::from_mm_f64(delta.to_mm_f64() * f64::from(percent) * 0.01)
}

/// Whether a line has a letter with a number.
fn is_one(line: &[u8], letter: u8, number: i64) -> Result<bool, LineError> {
    let value = value(line, letter)?;
    Ok(value.is_some_and(|value| value.is_whole() && value.trunc() == number))
}

/// `G1 R1`: to the place of the last pause, with the words as offsets from it.
fn write_return(
    line: &[u8],
    context: &Context<'_>,
    codes: &Codes,
    write: &mut impl FnMut(&[u8]),
) -> Result<(), LineError> {
    let paused_at = context.paused_at.ok_or(LineError::NoPausePosition)?;
    write(b"G53G1");
    for (axis, place) in paused_at.iter().enumerate().take(LINEAR) {
        let offset = value(line, LETTERS[axis])?;
        let offset = offset.map_or(Nm(0), |offset| length(offset, codes.is_in_inches, context));
        write_coordinate(axis, *place + offset, codes, context, write);
    }
    write_feed(line, write)
}

/// `G6`, `G0 S2`: motors to positions, or by them with `R`; the machine is not homed any more.
fn write_motors(
    line: &[u8],
    letters: [u8; LINEAR],
    context: &Context<'_>,
    codes: &Codes,
    meaning: &mut Meaning,
    write: &mut impl FnMut(&[u8]),
) -> Result<(), LineError> {
    if !context.settings.moves_motors {
        return Err(LineError::Unsupported);
    }
    if !context.is_idle {
        return Err(LineError::NotIdle);
    }
    let is_relative = has(line, b'R');
    write(b"G53G1");
    for (axis, letter) in letters.into_iter().enumerate() {
        let Some(number) = value(line, letter)? else {
            continue;
        };
        let given = length(number, codes.is_in_inches, context);
        let target = if is_relative {
            context.position[axis] + given
        } else {
            given
        };
        let lowest = -Nm::from_mm_f64(f64::from(context.settings.max_travel_mm[axis])).0;
        if context.is_homed && !(lowest..=0).contains(&target.0) {
            return Err(LineError::InvalidTarget);
        }
        write_coordinate(axis, target, codes, context, write);
    }
    meaning.moves_motors = true;
    write_feed(line, write)
}

/// Writes the word of an axis, in the units of the line.
fn write_coordinate(
    axis: usize,
    value: Nm,
    codes: &Codes,
    context: &Context<'_>,
    write: &mut impl FnMut(&[u8]),
) {
    let is_modal = context.modal.units == Units::Inches;
    let is_in_inches = codes.is_in_inches.unwrap_or(is_modal);
    write(&[LETTERS[axis]]);
    let value = if is_in_inches {
        Nm::from_mm_f64(value.to_mm_f64() / 25.4)
    } else {
        value
    };
    write_millionths(value.0, write);
}

/// Writes the `F` and the units of a line.
fn write_feed(line: &[u8], write: &mut impl FnMut(&[u8])) -> Result<(), LineError> {
    for parameter in Parameters::new(line) {
        let parameter = parameter?;
        let is_unit = parameter.letter == b'G' && matches!(parameter.code(), Some(20 | 21));
        if parameter.letter == b'F' || is_unit {
            write(&[parameter.letter]);
            write(parameter.number);
        }
    }
    Ok(())
}

/// Whether a word of a line of motion means to Grbl what it means here.
fn is_motion_word(letter: u8, is_arc: bool) -> bool {
    match letter {
        b'G' | b'F' | b'S' | b'T' => true,
        b'I' | b'J' | b'K' | b'R' => is_arc,
        letter => LETTERS.iter().take(AXES).any(|axis| *axis == letter),
    }
}

/// A length in the units of a line.
fn length(value: Decimal, is_in_inches: Option<bool>, context: &Context<'_>) -> Nm {
    let is_modal = context.modal.units == Units::Inches;
    Nm(if is_in_inches.unwrap_or(is_modal) {
        value.inches_to_nm()
    } else {
        value.to_millionths()
    })
}

/// `G4`: S in seconds before P in milliseconds; neither waits for standstill.
fn dwell(line: &[u8], write: &mut impl FnMut(&[u8])) -> Result<Option<HostCommand>, LineError> {
    let milliseconds = match (value(line, b'S')?, value(line, b'P')?) {
        (Some(seconds), _) => seconds.to_thousandths(),
        (None, Some(milliseconds)) => milliseconds.trunc(),
        (None, None) => 0,
    };
    if milliseconds == 0 {
        return Ok(Some(HostCommand::Standstill));
    }
    write(b"G4P");
    write_millionths(milliseconds.saturating_mul(1000), write);
    Ok(None)
}

/// `G92`: the logical position; without words all of it is 0.
fn set_position(
    line: &[u8],
    context: &Context<'_>,
    meaning: &mut Meaning,
    write: &mut impl FnMut(&[u8]),
) -> Result<Option<HostCommand>, LineError> {
    let axes = axes(line);
    let extruded = value(line, b'E')?;
    if let Some(extruded) = extruded {
        meaning.extruder.position = length(extruded, None, context);
    } else if axes == 0 {
        meaning.extruder.position = Nm(0);
        write(b"G92X0Y0Z0");
        return Ok(None);
    }
    if axes == 0 {
        return Ok(Some(HostCommand::Nothing));
    }
    for parameter in Parameters::new(line) {
        let parameter = parameter?;
        if matches!(parameter.letter, b'G' | b'X' | b'Y' | b'Z') {
            write(&[parameter.letter]);
            write(parameter.number);
        }
    }
    Ok(None)
}

/// What an M code asks for, `None` where it has been written in Grbl's words.
fn m_code(
    number: u16,
    line: &[u8],
    context: &Context<'_>,
    meaning: &mut Meaning,
    write: &mut impl FnMut(&[u8]),
) -> Result<Option<HostCommand>, LineError> {
    Ok(Some(match number {
        0 | 1 | 25 | 226 => {
            meaning.pause_ms = pause_ms(line)?;
            write(b"M0");
            return Ok(None);
        }
        17 => HostCommand::Drivers(true),
        18 | 84 => match seconds(line)? {
            Some(seconds) => HostCommand::DriversDelay(seconds),
            None => HostCommand::Drivers(false),
        },
        20 => HostCommand::Files,
        21 | 24 | 27 | 31 | 108 | 155 | 410 | 500 | 501 => HostCommand::Nothing,
        80 | 81 | 280 => HostCommand::NotPresent(number),
        82 | 83 => {
            meaning.extruder.is_relative = number == 83;
            HostCommand::Nothing
        }
        92 => HostCommand::Resolution {
            is_set: has_words(line),
        },
        104 | 109 | 140 | 190 => match value(line, b'S')? {
            Some(degrees) if !degrees.is_zero() => HostCommand::NotPresent(number),
            Some(_) | None => HostCommand::Nothing,
        },
        105 => HostCommand::Temperature,
        106 | 107 => return fan(number, line, context.settings, write),
        112 => HostCommand::Kill,
        113 => match seconds(line)? {
            Some(seconds) => HostCommand::BusyInterval(seconds),
            None => HostCommand::Nothing,
        },
        114 => HostCommand::Position {
            is_now: has(line, b'R'),
        },
        115 => HostCommand::Firmware,
        119 => HostCommand::Endstops,
        154 => HostCommand::PositionInterval(seconds(line)?.unwrap_or_default()),
        201 => HostCommand::Acceleration,
        203 => HostCommand::Speed,
        204 => HostCommand::CommonAcceleration,
        205 => HostCommand::Junction {
            is_set: has_words(line),
        },
        220 => match percent(line, 10..=200)? {
            Some(percent) => HostCommand::FeedOverride(percent as u8),
            None => HostCommand::Nothing,
        },
        221 => {
            let before = meaning.extruder.flow_percent;
            meaning.extruder.flow_percent = percent(line, 10..=1000)?.unwrap_or(before);
            HostCommand::Nothing
        }
        400 => HostCommand::Standstill,
        502 => HostCommand::Defaults,
        503 => HostCommand::Settings,
        999 => HostCommand::Restart,
        _ => return Err(LineError::Unsupported),
    }))
}

/// `M106`, `M107`: the output of `$783`, with S of 255.
fn fan(
    number: u16,
    line: &[u8],
    settings: &Settings,
    write: &mut impl FnMut(&[u8]),
) -> Result<Option<HostCommand>, LineError> {
    const FULL: i64 = 255;
    let speed = match (number, value(line, b'S')?) {
        (107, _) => 0,
        (_, Some(speed)) => speed.trunc(),
        (_, None) => FULL,
    };
    if !(0..=FULL).contains(&speed) {
        return Err(LineError::ValueOutOfRange);
    }
    match (settings.fan_output, speed) {
        (1, 0) => write(b"M5"),
        (1, _) => {
            write(b"M3S");
            let share = speed as f32 / FULL as f32;
            let rpm = Nm::from_mm(settings.spindle_max_rpm * share);
            write_millionths(rpm.0, write);
        }
        (2 | 3, 0) => write(b"M9"),
        (2, _) => write(b"M8"),
        (3, _) => write(b"M7"),
        (_, 0) => return Ok(Some(HostCommand::Nothing)),
        (_, _) => return Ok(Some(HostCommand::NotPresent(number))),
    }
    Ok(None)
}

/// The time of a pause: S in seconds before P in milliseconds.
fn pause_ms(line: &[u8]) -> Result<Option<u32>, LineError> {
    let milliseconds = match (value(line, b'S')?, value(line, b'P')?) {
        (Some(seconds), _) => seconds.to_thousandths(),
        (None, Some(milliseconds)) => milliseconds.trunc(),
        (None, None) => return Ok(None),
    };
    let milliseconds = u32::try_from(milliseconds).map_err(|_| LineError::ValueOutOfRange)?;
    Ok((milliseconds != 0).then_some(milliseconds))
}

/// S in whole seconds.
fn seconds<T: TryFrom<i64>>(line: &[u8]) -> Result<Option<T>, LineError> {
    let Some(seconds) = value(line, b'S')? else {
        return Ok(None);
    };
    let seconds = T::try_from(seconds.trunc()).map_err(|_| LineError::ValueOutOfRange)?;
    Ok(Some(seconds))
}

/// S in per cent, brought into a range.
fn percent(line: &[u8], range: RangeInclusive<i64>) -> Result<Option<u16>, LineError> {
    let percent = value(line, b'S')?;
    Ok(percent.map(|percent| percent.trunc().clamp(*range.start(), *range.end()) as u16))
}

/// The axes among X, Y and Z that a line has, bit 0 = X.
fn axes(line: &[u8]) -> u8 {
    let mut axes = 0;
    for (axis, letter) in LETTERS.iter().enumerate().take(LINEAR) {
        axes |= u8::from(has(line, *letter)) << axis;
    }
    axes
}

/// The value of a letter, `None` without it.
///
/// # Errors
/// 1, 2 for a line that cannot be read.
pub fn value(line: &[u8], letter: u8) -> Result<Option<Decimal>, LineError> {
    for parameter in Parameters::new(line) {
        let parameter = parameter?;
        if parameter.letter == letter {
            return parameter.value().map(Some).ok_or(LineError::BadNumber);
        }
    }
    Ok(None)
}

/// Whether a line has more than its code.
fn has_words(line: &[u8]) -> bool {
    Parameters::new(line).count() > 1
}

/// Whether a line has a letter, with or without a number.
fn has(line: &[u8], letter: u8) -> bool {
    Parameters::new(line)
        .any(|parameter| parameter.is_ok_and(|parameter| parameter.letter == letter))
}

/// Writes a number of millionths, of which as many count as Grbl's words may have.
fn write_millionths(value: i64, write: &mut impl FnMut(&[u8])) {
    if value < 0 {
        write(b"-");
    }
    let mut rest = value.unsigned_abs();
    let mut has_begun = false;
    for (place, one) in POWERS.into_iter().enumerate() {
        if place == POWERS.len() - 6 {
            write(b".");
        }
        let mut digit = b'0';
        while rest >= one && digit < b'9' {
            rest -= one;
            digit += 1;
        }
        has_begun |= digit != b'0' || place + 7 >= POWERS.len();
        if has_begun {
            write(&[digit]);
        }
    }
}

/// The values of digits, down from those of the largest coordinate.
const POWERS: [u64; 16] = {
    let mut powers = [1; 16];
    let mut place = 15;
    while place > 0 {
        powers[place - 1] = powers[place] * 10;
        place -= 1;
    }
    powers
};
