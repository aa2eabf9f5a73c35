//! M codes of hosts and slicers.

use core::ops::RangeInclusive;

use super::{
    HostCommand, LineModes, Meaning,
    motion::write_millionths,
    parameters::{has, has_words, value},
};
use crate::{decimal::Decimal, gcode::LineError, settings::Settings, units::Nm};

/// What an M code asks for, `None` where it has been written in Grbl's words.
pub(super) fn m_code(
    number: u16,
    line: &[u8],
    context: &LineModes<'_>,
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
pub(super) fn fan(
    number: u16,
    line: &[u8],
    settings: &Settings,
    write: &mut impl FnMut(&[u8]),
) -> Result<Option<HostCommand>, LineError> {
    const MAX_FAN_SPEED: f32 = 255.0;
    let speed = match (number, value(line, b'S')?) {
        (107, _) => 0.0,
        (_, Some(speed)) => speed.to_f32(),
        (_, None) => MAX_FAN_SPEED,
    };
    if !(0.0..=MAX_FAN_SPEED).contains(&speed) {
        return Err(LineError::ValueOutOfRange);
    }
    match (settings.fan_output, speed > 0.0) {
        (1, false) => write(b"M5"),
        (1, true) => {
            write(b"M3S");
            let rpm = Nm::from_mm(settings.spindle_max_rpm * (speed / MAX_FAN_SPEED));
            write_millionths(rpm.0, write);
        }
        (2 | 3, false) => write(b"M9"),
        (2, true) => write(b"M8"),
        (3, true) => write(b"M7"),
        (_, false) => return Ok(Some(HostCommand::Nothing)),
        (_, true) => return Ok(Some(HostCommand::NotPresent(number))),
    }
    Ok(None)
}

/// The time of a pause: S in seconds before P in milliseconds.
pub(super) fn pause_ms(line: &[u8]) -> Result<Option<u32>, LineError> {
    let milliseconds = match (value(line, b'S')?, value(line, b'P')?) {
        (Some(seconds), _) => seconds.at_least_one(Decimal::to_thousandths),
        (None, Some(milliseconds)) => milliseconds.at_least_one(Decimal::trunc),
        (None, None) => return Ok(None),
    };
    let milliseconds = u32::try_from(milliseconds).map_err(|_| LineError::ValueOutOfRange)?;
    Ok((milliseconds != 0).then_some(milliseconds))
}

/// S in whole seconds.
pub(super) fn seconds<T: TryFrom<i64>>(line: &[u8]) -> Result<Option<T>, LineError> {
    value(line, b'S')?.map(whole).transpose()
}

/// A number without a fraction.
fn whole<T: TryFrom<i64>>(number: Decimal) -> Result<T, LineError> {
    if !number.is_whole() {
        return Err(LineError::NotInteger);
    }
    T::try_from(number.trunc()).map_err(|_| LineError::ValueOutOfRange)
}

/// S in whole per cent, within a range.
pub(super) fn percent(line: &[u8], range: RangeInclusive<u16>) -> Result<Option<u16>, LineError> {
    let Some(percent) = value(line, b'S')?.map(whole).transpose()? else {
        return Ok(None);
    };
    if range.contains(&percent) {
        Ok(Some(percent))
    } else {
        Err(LineError::ValueOutOfRange)
    }
}
