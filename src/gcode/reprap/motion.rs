//! Lines that move, wait or set the position, in Grbl's words.

use super::{
    HostCommand, LineCodes, LineModes, Meaning,
    parameters::{Parameter, Parameters, axes, has, value},
};
use crate::{
    axis::{AXES, LETTERS, LINEAR},
    decimal::Decimal,
    gcode::{Distance, LineError, MotionMode, Units},
    units::Nm,
};

/// Writes a line of motion without the words that have no meaning here, and with the driven axis in place of `E`.
pub(super) fn write_motion(
    line: &[u8],
    context: &LineModes<'_>,
    codes: &LineCodes,
    meaning: &mut Meaning,
    write: &mut impl FnMut(&[u8]),
) -> Result<(), LineError> {
    let is_laser = context.settings.laser;
    let kept = KeptWords::of(context, codes);
    let driven = context.driven.map(|(axis, _)| LETTERS[axis]);
    let extruder = &mut meaning.extruder;
    extruder.is_relative = codes.is_incremental.unwrap_or(extruder.is_relative);
    let mut extruded = None;
    for parameter in Parameters::new(line) {
        let parameter = parameter?;
        match parameter.letter {
            // As Marlin: the feed rate stays.
            b'F' if is_zero(&parameter) => {}
            b'E' if meaning.ends_at_switch => return Err(LineError::UnusedWords),
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
                Some(mode) if mode.is_zero() || meaning.ends_at_switch => {}
                Some(_) => return Err(LineError::Unsupported),
                None => return Err(LineError::BadNumber),
            },
            letter if Some(letter) == driven => meaning.missing_axis = Some(letter),
            letter if kept.has(letter) => write_word(&parameter, context, write),
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
pub(super) fn scaled(delta: Nm, percent: u16) -> Nm {
    if percent == 100 {
        return delta;
    }
    Nm::from_mm_f64(delta.to_mm_f64() * f64::from(percent) * 0.01)
}

/// Whether a line has a letter with a number.
pub(super) fn is_one(line: &[u8], letter: u8, number: i64) -> Result<bool, LineError> {
    let value = value(line, letter)?;
    Ok(value.is_some_and(|value| value.is_whole() && value.trunc() == number))
}

/// `G1 R1`: to the place of the last pause, with the words as offsets from it.
pub(super) fn write_return(
    line: &[u8],
    context: &LineModes<'_>,
    codes: &LineCodes,
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
pub(super) fn write_motors(
    line: &[u8],
    letters: [u8; LINEAR],
    context: &LineModes<'_>,
    codes: &LineCodes,
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
    for parameter in Parameters::new(line) {
        let letter = parameter?.letter;
        if !letters.contains(&letter) && !b"GFRSN".contains(&letter) {
            return Err(LineError::UnusedWords);
        }
    }
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
        if context.is_homed
            && let Some([lowest, highest]) = context.settings.travel(axis)
            && !(lowest..=highest).contains(&target)
        {
            return Err(LineError::InvalidTarget);
        }
        write_coordinate(axis, target, codes, context, write);
    }
    meaning.moves_motors = true;
    write_feed(line, write)
}

/// Writes the word of an axis, in the units of the line.
pub(super) fn write_coordinate(
    axis: usize,
    value: Nm,
    codes: &LineCodes,
    context: &LineModes<'_>,
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

/// Whether a word has the value 0.
fn is_zero(parameter: &Parameter<'_>) -> bool {
    parameter.value().is_some_and(Decimal::is_zero)
}

/// Writes the `F` and the units of a line.
pub(super) fn write_feed(line: &[u8], write: &mut impl FnMut(&[u8])) -> Result<(), LineError> {
    for parameter in Parameters::new(line) {
        let parameter = parameter?;
        let is_feed = parameter.letter == b'F' && !is_zero(&parameter);
        let is_unit = parameter.letter == b'G' && matches!(parameter.code(), Some(20 | 21));
        if is_feed || is_unit {
            write(&[parameter.letter]);
            write(parameter.number);
        }
    }
    Ok(())
}

/// Writes a word as it is, but `G0` as `G1`: a host's rapid is a move at its feed rate.
pub(super) fn write_word(
    parameter: &Parameter<'_>,
    context: &LineModes<'_>,
    write: &mut impl FnMut(&[u8]),
) {
    if parameter.letter == b'G' && parameter.code() == Some(0) && !context.settings.laser {
        return write(b"G1");
    }
    write(&[parameter.letter]);
    write(parameter.number);
}

/// The words of a line of motion that mean to Grbl what they mean here.
struct KeptWords {
    is_arc: bool,
    /// A line of the canned cycle that is the motion mode.
    is_cycle: bool,
    has_tolerances: bool,
}

impl KeptWords {
    fn of(context: &LineModes<'_>, codes: &LineCodes) -> Self {
        let is_modal = !codes.is_straight && !codes.is_arc;
        let is_modal_arc = matches!(context.modal.motion, MotionMode::Arc(_));
        Self {
            is_arc: codes.is_arc || is_modal && is_modal_arc,
            is_cycle: is_modal && matches!(context.modal.motion, MotionMode::Cycle(_)),
            has_tolerances: codes.has_tolerances,
        }
    }

    fn has(&self, letter: u8) -> bool {
        match letter {
            b'G' | b'F' | b'N' | b'S' | b'T' => true,
            b'I' | b'J' | b'K' => self.is_arc,
            b'L' => self.is_cycle,
            b'P' => self.is_arc || self.is_cycle || self.has_tolerances,
            b'Q' => self.is_cycle || self.has_tolerances,
            b'R' => self.is_arc || self.is_cycle,
            letter => LETTERS.iter().take(AXES).any(|axis| *axis == letter),
        }
    }
}

/// A length in the units of a line.
pub(super) fn length(value: Decimal, is_in_inches: Option<bool>, context: &LineModes<'_>) -> Nm {
    let is_modal = context.modal.units == Units::Inches;
    Nm(if is_in_inches.unwrap_or(is_modal) {
        value.inches_to_nm()
    } else {
        value.to_millionths()
    })
}

/// `G4`: S in seconds before P in milliseconds; neither waits for standstill.
pub(super) fn dwell(
    line: &[u8],
    write: &mut impl FnMut(&[u8]),
) -> Result<Option<HostCommand>, LineError> {
    let milliseconds = match (value(line, b'S')?, value(line, b'P')?) {
        (Some(seconds), _) => seconds.at_least_one(Decimal::to_thousandths),
        (None, Some(milliseconds)) => milliseconds.at_least_one(Decimal::trunc),
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
pub(super) fn set_position(
    line: &[u8],
    context: &LineModes<'_>,
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

/// Writes a number of millionths, of which as many count as Grbl's words may have.
pub(super) fn write_millionths(value: i64, write: &mut impl FnMut(&[u8])) {
    if value < 0 {
        write(b"-");
    }
    let mut remainder = value.unsigned_abs();
    let mut has_begun = false;
    for (place, one) in POWERS.into_iter().enumerate() {
        if place == POWERS.len() - 6 {
            write(b".");
        }
        let mut digit = b'0';
        while remainder >= one && digit < b'9' {
            remainder -= one;
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
