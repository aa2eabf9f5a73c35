//! What a setting is, for programs that let a user change it: `$ES`.
//!
//! Data types and the order of the fields are those that grblHAL publishes ("report extensions").

use super::table::{Kind, LARGEST, Row, at};
use crate::{axis::LETTERS, units::StepsPerMm};

/// A group of settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Group {
    /// Outputs, inputs and reports.
    General = 1,
    /// Homing.
    Homing = 2,
    /// The spindle, or the laser.
    Spindle = 3,
    /// Limits of the travel.
    Limits = 4,
    /// Parking.
    Parking = 5,
    /// The axes.
    Axes = 6,
}

/// Every group and its name.
pub const GROUPS: [(Group, &str); 6] = [
    (Group::General, "General"),
    (Group::Homing, "Homing"),
    (Group::Spindle, "Spindle"),
    (Group::Limits, "Limits"),
    (Group::Parking, "Parking"),
    (Group::Axes, "Axes"),
];

/// Type of a setting's value, with grblHAL's numbers.
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

/// One setting, described.
#[derive(Debug, Clone, Copy)]
pub struct Description {
    /// Its number.
    pub number: u16,
    /// Where it belongs.
    pub group: Group,
    /// The axis that it is of.
    pub axis: Option<u8>,
    /// What it is.
    pub name: &'static str,
    /// Unit of its value, empty without.
    pub unit: &'static str,
    /// Type of its value.
    pub data_type: DataType,
    /// Places of a number, or the names of the bits.
    pub format: &'static str,
    /// Smallest and largest value, and their decimals; `None` where the type says it all.
    pub range: Option<(f32, f32, usize)>,
}

/// The description of the setting at a place in the list of all, counted from 0; `None` after the
/// last.
#[must_use]
pub fn described(place: usize) -> Option<Description> {
    let (row, axis) = at(place, |_| true)?;
    let (data_type, format, range) = value_type(row);
    Some(Description {
        number: row.number_of(axis),
        group: group(row.number),
        axis: (row.axes() > 1)
            .then(|| LETTERS.get(axis).copied())
            .flatten(),
        name: row.name,
        unit: if row.unit == "mask" { "" } else { row.unit },
        data_type,
        format,
        range,
    })
}

const fn group(number: u16) -> Group {
    match number {
        20 | 21 => Group::Limits,
        22..=27 => Group::Homing,
        30..=32 => Group::Spindle,
        41 | 56..=59 => Group::Parking,
        100.. => Group::Axes,
        _ => Group::General,
    }
}

type ValueType = (DataType, &'static str, Option<(f32, f32, usize)>);

fn value_type(row: &Row) -> ValueType {
    const THOUSANDTHS: &str = "#######0.000";
    match row.kind {
        Kind::Flag(_) => (DataType::Boolean, "", None),
        Kind::Byte(_) if row.number == 10 => {
            (DataType::Bits, "Machine position,Buffer state", None)
        }
        Kind::Byte(_) if row.unit == "mask" => (DataType::AxisMask, "", None),
        Kind::Byte(_) if row.number == 0 => (DataType::Integer, "##0", Some((3.0, 255.0, 0))),
        Kind::Byte(_) | Kind::Word(_) => (DataType::Integer, "##0", Some((0.0, 255.0, 0))),
        Kind::Number {
            most, decimals: 0, ..
        } => (DataType::Decimal, "#######0", Some((0.0, most, 0))),
        Kind::Number { least, most, .. } => {
            (DataType::Decimal, THOUSANDTHS, Some((least, most, 3)))
        }
        Kind::AxisNumber { least, .. } => {
            (DataType::Decimal, THOUSANDTHS, Some((least, LARGEST, 3)))
        }
        Kind::AxisResolution(_) => {
            let most = StepsPerMm::MAX as f32 * 1.0e-6;
            (DataType::Decimal, THOUSANDTHS, Some((0.001, most, 3)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Settings, listed};

    #[test]
    fn every_setting_is_described_in_the_order_of_the_list() {
        let settings = Settings::default();
        for place in 0.. {
            let (listed, described) = (listed(&settings, place), described(place));
            assert_eq!(listed.map(|l| l.0), described.map(|d| d.number));
            let Some(description) = described else { break };
            assert!(GROUPS.iter().any(|(group, _)| *group == description.group));
            for text in [description.name, description.unit, description.format] {
                assert!(!text.contains(['|', '[', ']']), "{text}");
                assert!(!text.contains("ok") && !text.contains("error"), "{text}");
            }
        }
    }
}
