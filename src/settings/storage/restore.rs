//! Stored values back into settings, whatever firmware has stored them.
//!
//! Each value is checked as one that the user types: a setting cannot get, by way of the flash, a
//! value that `$n=` would refuse.

use crate::{
    settings::{
        Settings,
        table::{self, Kind, SettingError},
    },
    units::StepsPerMm,
};

/// A stored value, of the type that it had when it was stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Raw {
    Whole(u16),
    Number(f32),
    Millionths(u64),
}

/// Changes the setting with a number to a stored value, exactly.
///
/// # Errors
/// [`SettingError::BadStatement`] for a setting that there is not, [`SettingError::OutOfRange`] or
/// [`SettingError::ShortPulse`] for a value that it cannot have; nothing is changed then.
pub(super) fn restore(
    settings: &mut Settings,
    number: u16,
    value: Raw,
) -> Result<(), SettingError> {
    let missing = SettingError::BadStatement;
    let (row, axis) = table::find(number).ok_or(missing)?;
    match row.kind {
        Kind::Byte(place) => {
            let byte = value.byte()?;
            let before = core::mem::replace(place(settings), byte);
            if settings.step_pulse_us < 3 {
                *place(settings) = before;
                return Err(SettingError::ShortPulse);
            }
        }
        Kind::Word(place) => *place(settings) = value.byte()?.into(),
        Kind::Flag(place) => *place(settings) = value.byte()? != 0,
        Kind::Number {
            place, least, most, ..
        } => {
            *place(settings) = table::in_range(value.number(), least, most)?;
        }
        Kind::AxisNumber { place, least, .. } => {
            let number = table::in_range(value.number(), least, table::LARGEST)?;
            *place(settings).get_mut(axis).ok_or(missing)? = number;
        }
        Kind::AxisResolution(place) => {
            let resolution = table::resolution(value.millionths())?;
            *place(settings).get_mut(axis).ok_or(missing)? = resolution;
        }
    }
    Ok(())
}

impl Raw {
    fn byte(self) -> Result<u8, SettingError> {
        let whole = match self {
            Self::Whole(whole) => Some(u64::from(whole)),
            Self::Number(number) => ((0.0..256.0).contains(&number)).then_some(number as u64),
            Self::Millionths(millionths) => Some(millionths / 1_000_000),
        };
        whole
            .and_then(|whole| u8::try_from(whole).ok())
            .ok_or(SettingError::OutOfRange)
    }

    fn number(self) -> f32 {
        match self {
            Self::Whole(whole) => whole.into(),
            Self::Number(number) => number,
            Self::Millionths(millionths) => (millionths as f64 / 1.0e6) as f32,
        }
    }

    fn millionths(self) -> u64 {
        /// One above the largest resolution, steps/mm.
        const BEYOND: f32 = StepsPerMm::MAX as f32 / 1.0e6 + 1.0;
        match self {
            Self::Whole(whole) => u64::from(whole) * 1_000_000,
            Self::Number(number) if (0.0..BEYOND).contains(&number) => {
                libm::round(f64::from(number) * 1.0e6) as u64
            }
            Self::Number(_) => 0,
            Self::Millionths(millionths) => millionths,
        }
    }
}
