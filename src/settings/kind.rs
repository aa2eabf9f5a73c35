//! Kinds of settings: types and ranges of their values.
//!
//! A value comes from a user's text or from a stored record. Both go through the same conversion
//! and the same range, so that the flash cannot give a setting a value that `$n=` would refuse.
//! Data types and formats are those that grblHAL publishes ("report extensions").

use core::ops::RangeInclusive;

use super::{SettingError, Settings};
use crate::{axis::Axes, decimal::Decimal, units::StepsPerMm};

/// Largest value of a length, speed or acceleration.
const LARGEST: f32 = 1.0e7;
/// Smallest value of a divisor: the smallest that `$$` can show.
const SMALLEST: f32 = 0.001;

impl Settings {
    /// Speeds and accelerations that an axis may be set to.
    pub(crate) const AXIS_LIMITS: RangeInclusive<f32> = SMALLEST..=LARGEST;
}

/// The field of [`Settings`] that holds a value.
type Field<T> = fn(&mut Settings) -> &mut T;

/// Type and range of a setting, and its field.
#[derive(Debug)]
pub enum Kind {
    /// On or off.
    Flag(Field<bool>),
    /// On or off, where grblHAL has a bit for each axis: on with any of them.
    AnyBit(Field<bool>),
    /// A sum of bits, with the names of the bits.
    Bits(Field<u8>, &'static str),
    /// A sum of bits, one for each axis.
    AxisMask(Field<u8>),
    /// A whole number up to 255.
    Byte {
        /// The field.
        field: Field<u8>,
        /// Smallest value.
        least: u8,
        /// The refusal of a smaller value.
        too_small: SettingError,
    },
    /// A number.
    Number(Field<f32>, ValueRange),
    /// A number for each axis.
    AxisNumber(Field<Axes<f32>>, ValueRange),
    /// The resolution of each axis.
    AxisResolution(Field<Axes<StepsPerMm>>),
}

/// Range of a number, both ends included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueRange {
    /// Smallest value.
    pub least: f32,
    /// Largest value.
    pub most: f32,
    /// Digits after the point in answers.
    pub decimals: usize,
}

impl ValueRange {
    const fn from(least: f32) -> Self {
        Self {
            least,
            most: LARGEST,
            decimals: 3,
        }
    }
}

/// A value as typed by a user, as stored, or as shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// A whole number; 0 or 1 for off or on.
    Whole(u16),
    /// A number in single precision.
    Number(f32),
    /// A number in millionths.
    Millionths(i64),
}

/// Type of a value, with grblHAL's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum DataType {
    /// 0 or 1.
    Boolean = 0,
    /// A sum of named bits.
    Bits = 1,
    /// A sum of bits, one for each axis.
    AxisMask = 4,
    /// A whole number.
    Integer = 5,
    /// A decimal number.
    Decimal = 6,
}

pub(super) const fn byte(field: Field<u8>) -> Kind {
    byte_from(field, 0, SettingError::OutOfRange)
}

pub(super) const fn byte_from(field: Field<u8>, least: u8, too_small: SettingError) -> Kind {
    Kind::Byte {
        field,
        least,
        too_small,
    }
}

pub(super) const fn number(field: Field<f32>) -> Kind {
    Kind::Number(field, ValueRange::from(0.0))
}

pub(super) const fn coordinate(field: Field<f32>) -> Kind {
    Kind::Number(field, ValueRange::from(-LARGEST))
}

pub(super) const fn rate(field: Field<f32>) -> Kind {
    Kind::Number(field, ValueRange::from(1.0))
}

pub(super) const fn rpm(field: Field<f32>) -> Kind {
    let range = ValueRange::from(0.0);
    Kind::Number(
        field,
        ValueRange {
            decimals: 0,
            ..range
        },
    )
}

/// Up to a second, whole.
pub(super) const fn milliseconds(field: Field<f32>) -> Kind {
    Kind::Number(
        field,
        ValueRange {
            least: 0.0,
            most: 1000.0,
            decimals: 0,
        },
    )
}

/// Up to 20 s, as grblHAL's delays.
pub(super) const fn seconds(field: Field<f32>) -> Kind {
    let range = ValueRange::from(0.0);
    Kind::Number(
        field,
        ValueRange {
            most: 20.0,
            ..range
        },
    )
}

/// From what a spindle's converter takes to what a laser's supply takes at most, Hz.
pub(super) const fn pwm_frequency(field: Field<f32>) -> Kind {
    Kind::Number(
        field,
        ValueRange {
            least: 100.0,
            most: 20_000.0,
            decimals: 0,
        },
    )
}

pub(super) const fn axis_number(field: Field<Axes<f32>>) -> Kind {
    Kind::AxisNumber(field, ValueRange::from(0.0))
}

/// Up to 10 mm, or degrees: a drive with more is broken.
pub(super) const fn axis_backlash(field: Field<Axes<f32>>) -> Kind {
    let range = ValueRange::from(0.0);
    Kind::AxisNumber(
        field,
        ValueRange {
            most: 10.0,
            ..range
        },
    )
}

pub(super) const fn axis_divisor(field: Field<Axes<f32>>) -> Kind {
    Kind::AxisNumber(field, ValueRange::from(SMALLEST))
}

impl Kind {
    /// Returns whether each axis has a setting of its own.
    pub(super) const fn is_per_axis(&self) -> bool {
        match self {
            Self::AxisNumber(..) | Self::AxisResolution(_) => true,
            Self::Flag(_)
            | Self::AnyBit(_)
            | Self::Bits(..)
            | Self::AxisMask(_)
            | Self::Byte { .. }
            | Self::Number(..) => false,
        }
    }

    /// Returns the type of the values.
    #[must_use]
    pub const fn data_type(&self) -> DataType {
        match self {
            Self::Flag(_) | Self::AnyBit(_) => DataType::Boolean,
            Self::Bits(..) => DataType::Bits,
            Self::AxisMask(_) => DataType::AxisMask,
            Self::Byte { .. } => DataType::Integer,
            Self::Number(..) | Self::AxisNumber(..) | Self::AxisResolution(_) => DataType::Decimal,
        }
    }

    /// Returns the range of the values; `None` for types without one.
    #[must_use]
    pub fn range(&self) -> Option<ValueRange> {
        match self {
            Self::Flag(_) | Self::AnyBit(_) | Self::Bits(..) | Self::AxisMask(_) => None,
            Self::Byte { least, .. } => Some(ValueRange {
                least: f32::from(*least),
                most: 255.0,
                decimals: 0,
            }),
            Self::Number(_, range) | Self::AxisNumber(_, range) => Some(*range),
            Self::AxisResolution(_) => Some(ValueRange {
                least: SMALLEST,
                most: StepsPerMm::MAX as f32 * 1.0e-6,
                decimals: 3,
            }),
        }
    }

    /// Returns the number of digits after the point in answers.
    #[must_use]
    pub fn decimals(&self) -> usize {
        self.range().map_or(0, |range| range.decimals)
    }

    /// Returns the format that grblHAL has for the values: digits before and after the point, or
    /// the names of the bits.
    #[must_use]
    pub fn format(&self) -> &'static str {
        match (self, self.range()) {
            (Self::Bits(_, names), _) => names,
            (Self::Byte { .. }, _) => "##0",
            (_, Some(ValueRange { decimals: 0, .. })) => "#######0",
            (_, Some(_)) => "#######0.000",
            (_, None) => "",
        }
    }

    /// Returns whether a value below 0 is in the range.
    pub(super) fn has_negative(&self) -> bool {
        self.range().is_some_and(|range| range.least < 0.0)
    }

    /// Returns the value; that of an axis, where each axis has one.
    pub(super) fn value(&self, settings: &Settings, axis: usize) -> Value {
        // One accessor reads and writes: it reads from a copy.
        let mut copy = *settings;
        match self {
            Self::Flag(field) | Self::AnyBit(field) => Value::Whole(u16::from(*field(&mut copy))),
            Self::Bits(field, _) | Self::AxisMask(field) | Self::Byte { field, .. } => {
                Value::Whole(u16::from(*field(&mut copy)))
            }
            Self::Number(field, _) => Value::Number(*field(&mut copy)),
            Self::AxisNumber(field, _) => Value::Number(field(&mut copy)[axis]),
            Self::AxisResolution(field) => {
                let resolution = field(&mut copy)[axis];
                Value::Millionths(resolution.millionths().cast_signed())
            }
        }
    }

    /// Changes the value.
    pub(super) fn assign(
        &self,
        settings: &mut Settings,
        axis: usize,
        value: Value,
    ) -> Result<(), SettingError> {
        match self {
            Self::Flag(field) => {
                *field(settings) = match value.byte()? {
                    flag @ 0..=1 => flag == 1,
                    _ => return Err(SettingError::OutOfRange),
                }
            }
            Self::AnyBit(field) => *field(settings) = value.byte()? != 0,
            Self::Bits(field, _) | Self::AxisMask(field) => *field(settings) = value.byte()?,
            Self::Byte {
                field,
                least,
                too_small,
            } => {
                let byte = value.byte()?;
                if byte < *least {
                    return Err(*too_small);
                }
                *field(settings) = byte;
            }
            Self::Number(field, range) => *field(settings) = value.number(*range)?,
            Self::AxisNumber(field, range) => field(settings)[axis] = value.number(*range)?,
            Self::AxisResolution(field) => field(settings)[axis] = value.resolution()?,
        }
        Ok(())
    }
}

impl Value {
    /// A number that a user has typed for a setting of some kind: none of its digits is left out.
    ///
    /// # Errors
    /// [`SettingError::OutOfRange`]: a fraction where the setting is whole, or a number so near to 0 that it would
    /// count as 0, which may mean "off".
    pub(super) fn typed(number: Decimal, kind: &Kind) -> Result<Self, SettingError> {
        let millionths = number.to_millionths();
        let is_whole = kind.decimals() == 0;
        if is_whole && !number.is_whole() || millionths == 0 && !number.is_zero() {
            return Err(SettingError::OutOfRange);
        }
        Ok(match kind {
            Kind::Number(..) | Kind::AxisNumber(..) => Self::Number(number.to_f64() as f32),
            Kind::Flag(_)
            | Kind::AnyBit(_)
            | Kind::Bits(..)
            | Kind::AxisMask(_)
            | Kind::Byte { .. }
            | Kind::AxisResolution(_) => Self::Millionths(millionths),
        })
    }

    fn byte(self) -> Result<u8, SettingError> {
        let whole = match self {
            Self::Whole(whole) => Some(i64::from(whole)),
            Self::Number(number) => ((0.0..256.0).contains(&number)).then_some(number as i64),
            Self::Millionths(millionths) => Some(millionths / 1_000_000),
        };
        whole
            .and_then(|whole| u8::try_from(whole).ok())
            .ok_or(SettingError::OutOfRange)
    }

    fn number(self, range: ValueRange) -> Result<f32, SettingError> {
        let number = match self {
            Self::Whole(whole) => whole.into(),
            Self::Number(number) => number,
            Self::Millionths(millionths) => (millionths as f64 / 1.0e6) as f32,
        };
        if number >= range.least && number <= range.most {
            Ok(number)
        } else {
            Err(SettingError::OutOfRange)
        }
    }

    fn resolution(self) -> Result<StepsPerMm, SettingError> {
        /// Above the largest resolution, steps/mm.
        const TOO_LARGE: f32 = StepsPerMm::MAX as f32 / 1.0e6 + 1.0;
        /// [`SMALLEST`], millionths.
        const LEAST: u64 = 1000;
        let millionths = match self {
            Self::Whole(whole) => u64::from(whole) * 1_000_000,
            Self::Number(number) if (0.0..TOO_LARGE).contains(&number) => {
                libm::round(f64::from(number) * 1.0e6) as u64
            }
            Self::Number(_) => 0,
            Self::Millionths(millionths) => u64::try_from(millionths).unwrap_or(0),
        };
        StepsPerMm::from_millionths(millionths)
            .filter(|resolution| resolution.millionths() >= LEAST)
            .ok_or(SettingError::OutOfRange)
    }
}
