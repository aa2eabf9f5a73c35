//! The table of settings: from it come `$$`, the checks of `$n=value`, and the documentation.
//!
//! The defaults are those of [`Settings::default`], read through the same rows.
//! Numbers, formats and refusals are Grbl 1.1's, with one deliberate difference: a value that the
//! machine could not work with (a resolution of 0, a byte above 255) is refused, not bent.

use super::{
    Settings,
    decimal::{self, Decimal},
};
use crate::{axis::AXES, units::StepsPerMm};

/// Largest value of a length, speed or acceleration.
pub(super) const LARGEST: f32 = 1.0e7;
/// Smallest value of what is divided by: the smallest that `$$` can show.
const SMALLEST: f32 = 0.001;

/// Why a setting is refused. Nothing has been changed then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SettingError {
    /// No number where one must be.
    BadNumber,
    /// No such setting, or text that does not belong there.
    BadStatement,
    /// A value below 0.
    Negative,
    /// A step pulse shorter than 3 µs.
    ShortPulse,
    /// Soft limits without homing.
    NeedsHoming,
    /// A value that the setting cannot have.
    OutOfRange,
    /// A resolution and a largest speed that together are more steps than can be made.
    StepRate,
}

/// One row: a setting, or one for each axis.
#[derive(Debug)]
pub struct Row {
    /// Its number; that of the X axis where there is one for each axis.
    pub number: u16,
    /// What it is.
    pub name: &'static str,
    /// The unit of its value, empty without.
    pub unit: &'static str,
    /// Type, range, and where it is stored.
    pub kind: Kind,
}

/// Type, range, and place of a setting.
#[derive(Debug)]
pub enum Kind {
    /// A whole number from 0 to 255, or a mask.
    Byte(fn(&mut Settings) -> &mut u8),
    /// A whole number from 0 to 255, stored wider.
    Word(fn(&mut Settings) -> &mut u16),
    /// On or off: 0 is off, everything else is on.
    Flag(fn(&mut Settings) -> &mut bool),
    /// A number in a range, both ends included.
    Number {
        /// Where it is stored.
        place: fn(&mut Settings) -> &mut f32,
        /// Smallest value.
        least: f32,
        /// Largest value.
        most: f32,
        /// Digits after the point in `$$`.
        decimals: usize,
    },
    /// A number for each axis, both ends of its range included.
    AxisNumber {
        /// Where they are stored.
        place: fn(&mut Settings) -> &mut [f32; AXES],
        /// Smallest value.
        least: f32,
        /// Whether it is the largest speed, which has to fit the resolution.
        is_rate: bool,
    },
    /// The resolution of each axis.
    AxisResolution(fn(&mut Settings) -> &mut [StepsPerMm; AXES]),
}

/// The value of a setting, as it is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// A whole number; 0 or 1 for off or on.
    Whole(u16),
    /// A number and its digits after the point.
    Number(f32, usize),
    /// A resolution, shown with 3 digits after the point.
    Resolution(StepsPerMm),
}

const fn row(number: u16, name: &'static str, unit: &'static str, kind: Kind) -> Row {
    Row {
        number,
        name,
        unit,
        kind,
    }
}

const fn number(place: fn(&mut Settings) -> &mut f32) -> Kind {
    Kind::Number {
        place,
        least: 0.0,
        most: LARGEST,
        decimals: 3,
    }
}

const fn coordinate(place: fn(&mut Settings) -> &mut f32) -> Kind {
    Kind::Number {
        place,
        least: -LARGEST,
        most: LARGEST,
        decimals: 3,
    }
}

const fn rpm(place: fn(&mut Settings) -> &mut f32) -> Kind {
    Kind::Number {
        place,
        least: 0.0,
        most: LARGEST,
        decimals: 0,
    }
}

const fn rate(place: fn(&mut Settings) -> &mut f32) -> Kind {
    Kind::Number {
        place,
        least: 1.0,
        most: LARGEST,
        decimals: 3,
    }
}

const fn axis_number(place: fn(&mut Settings) -> &mut [f32; AXES], least: f32) -> Kind {
    Kind::AxisNumber {
        place,
        least,
        is_rate: false,
    }
}

const fn axis_rate(place: fn(&mut Settings) -> &mut [f32; AXES]) -> Kind {
    Kind::AxisNumber {
        place,
        least: SMALLEST,
        is_rate: true,
    }
}

const MM: &str = "mm";
const MM_MIN: &str = "mm/min";

/// Every setting, in the order of the numbers.
#[rustfmt::skip]
pub static TABLE: [Row; 32] = [
    row(0, "step pulse", "µs", Kind::Byte(|s| &mut s.step_pulse_us)),
    row(1, "delay before idle steppers are released, 255 never", "ms", Kind::Byte(|s| &mut s.idle_delay_ms)),
    row(2, "inverted step outputs", "mask", Kind::Byte(|s| &mut s.step_invert)),
    row(3, "inverted directions", "mask", Kind::Byte(|s| &mut s.direction_invert)),
    row(4, "inverted enable output", "", Kind::Flag(|s| &mut s.enable_invert)),
    row(5, "inverted limit inputs", "", Kind::Flag(|s| &mut s.limit_invert)),
    row(6, "inverted probe input", "", Kind::Flag(|s| &mut s.probe_invert)),
    row(10, "status report: 1 machine position, 2 buffer state", "mask", Kind::Byte(|s| &mut s.report_mask)),
    row(11, "junction deviation", MM, number(|s| &mut s.junction_deviation_mm)),
    row(12, "arc tolerance", MM, number(|s| &mut s.arc_tolerance_mm)),
    row(13, "reports in inches", "", Kind::Flag(|s| &mut s.report_inches)),
    row(20, "soft limits", "", Kind::Flag(|s| &mut s.soft_limits)),
    row(21, "hard limits", "", Kind::Flag(|s| &mut s.hard_limits)),
    row(22, "homing cycle", "", Kind::Flag(|s| &mut s.homing)),
    row(23, "axes that home towards their negative end", "mask", Kind::Byte(|s| &mut s.homing_direction)),
    row(24, "homing speed to locate the switch", MM_MIN, number(|s| &mut s.homing_feed_mm_min)),
    row(25, "homing speed to search the switch", MM_MIN, number(|s| &mut s.homing_seek_mm_min)),
    row(26, "homing delay for the switch to settle", "ms", Kind::Word(|s| &mut s.homing_debounce_ms)),
    row(27, "homing distance from the switch", MM, number(|s| &mut s.homing_pull_off_mm)),
    row(30, "largest spindle speed", "rpm", rpm(|s| &mut s.spindle_max_rpm)),
    row(31, "smallest spindle speed", "rpm", rpm(|s| &mut s.spindle_min_rpm)),
    row(32, "laser mode", "", Kind::Flag(|s| &mut s.laser)),
    row(41, "parking when the safety door opens", "", Kind::Flag(|s| &mut s.parking)),
    row(56, "parking: slow pull-out", MM, number(|s| &mut s.parking_pull_out_mm)),
    row(57, "parking: speed of the pull-out", MM_MIN, rate(|s| &mut s.parking_pull_out_mm_min)),
    row(58, "parking: machine coordinate of Z", MM, coordinate(|s| &mut s.parking_target_mm)),
    row(59, "parking: speed to it", MM_MIN, rate(|s| &mut s.parking_mm_min)),
    row(100, "resolution", "step/mm", Kind::AxisResolution(|s| &mut s.steps_per_mm.0)),
    row(110, "largest speed", MM_MIN, axis_rate(|s| &mut s.max_rate_mm_min.0)),
    row(120, "acceleration", "mm/s²", axis_number(|s| &mut s.acceleration_mm_s2.0, SMALLEST)),
    row(130, "travel", MM, axis_number(|s| &mut s.max_travel_mm.0, 0.0)),
    row(800, "jerk, 0 for no limit", "mm/s³", axis_number(|s| &mut s.jerk_mm_s3.0, 0.0)),
];

/// The number and the value of the setting that stands at a place in the list of all, counted
/// from 0; `None` after the last.
#[must_use]
pub fn listed(settings: &Settings, place: usize) -> Option<(u16, Value)> {
    let (row, axis) = at(place, |_| true)?;
    Some((row.number_of(axis), row.value(settings, axis)?))
}

/// As [`listed`], but of those settings alone that Grbl 1.1 has too.
#[must_use]
pub fn listed_of_grbl(settings: &Settings, place: usize) -> Option<(u16, Value)> {
    let (row, axis) = at(place, Row::is_of_grbl)?;
    Some((row.number_of(axis), row.value(settings, axis)?))
}

/// The row, and the axis, at a place in the list of all settings that are counted.
pub(super) fn at(place: usize, counts: impl Fn(&Row) -> bool) -> Option<(&'static Row, usize)> {
    let mut left = place;
    // wcet-bound: 32
    for row in &TABLE {
        if counts(row) {
            let rows = row.axes();
            if left < rows {
                return Some((row, left));
            }
            left -= rows;
        }
    }
    None
}

/// Reads a number and the `=` after it; gives its whole part, and what follows.
///
/// # Errors
/// `BadNumber` without a number, `BadStatement` without the `=`.
pub fn numbered(statement: &[u8]) -> Result<(i64, &[u8]), SettingError> {
    let (number, rest) = decimal::read(statement).ok_or(SettingError::BadNumber)?;
    match rest.split_first() {
        Some((b'=', text)) => Ok((number.whole(), text)),
        _ => Err(SettingError::BadStatement),
    }
}

/// Changes a setting, from the text between the `$` and the end of the line: `110=5000`.
///
/// # Errors
/// Every [`SettingError`]; the settings are unchanged then.
pub fn assign(settings: &mut Settings, statement: &[u8]) -> Result<(), SettingError> {
    let (number, text) = numbered(statement)?;
    change(settings, number, text)
}

/// Changes the setting with a number to the value in a text.
///
/// # Errors
/// Every [`SettingError`]; the settings are unchanged then.
pub fn set(settings: &mut Settings, number: u16, text: &[u8]) -> Result<(), SettingError> {
    change(settings, i64::from(number), text)
}

fn change(settings: &mut Settings, number: i64, text: &[u8]) -> Result<(), SettingError> {
    let (value, rest) = decimal::read(text).ok_or(SettingError::BadNumber)?;
    if !rest.is_empty() {
        return Err(SettingError::BadStatement);
    }
    let number = u16::try_from(number).map_err(|_| SettingError::BadStatement)?;
    let found = find(number);
    let takes_negative = |row: &Row| matches!(row.kind, Kind::Number { least, .. } if least < 0.0);
    if value.is_negative() && !found.is_some_and(|(row, _)| takes_negative(row)) {
        return Err(SettingError::Negative);
    }
    let mut changed = *settings;
    let (row, axis) = found.ok_or(SettingError::BadStatement)?;
    row.store(&mut changed, axis, value)?;
    if changed.step_pulse_us < 3 {
        return Err(SettingError::ShortPulse);
    }
    if number == 22 && !changed.homing {
        changed.soft_limits = false;
    }
    if changed.soft_limits && !changed.homing {
        return Err(SettingError::NeedsHoming);
    }
    if matches!(
        row.kind,
        Kind::AxisResolution(_) | Kind::AxisNumber { is_rate: true, .. }
    ) {
        check_step_rate(&changed, axis)?;
    }
    *settings = changed;
    Ok(())
}

/// An axis must not be asked for more steps than can be made.
fn check_step_rate(settings: &Settings, axis: usize) -> Result<(), SettingError> {
    let missing = SettingError::BadStatement;
    let resolution = settings.steps_per_mm.0.get(axis).ok_or(missing)?;
    let mm_min = settings.max_rate_mm_min.0.get(axis).ok_or(missing)?;
    if resolution.to_f32() * (mm_min / 60.0) > settings.greatest_step_rate_hz() {
        Err(SettingError::StepRate)
    } else {
        Ok(())
    }
}

/// The row of a setting, and the axis.
pub(super) fn find(number: u16) -> Option<(&'static Row, usize)> {
    // wcet-bound: 32
    TABLE.iter().find_map(|row| {
        let axis = usize::from(number.checked_sub(row.number)?);
        (axis < row.axes()).then_some((row, axis))
    })
}

impl Row {
    /// Whether Grbl 1.1 has it too.
    #[must_use]
    pub const fn is_of_grbl(&self) -> bool {
        !matches!(self.number, 33..=99 | 800..)
    }

    /// The number of the setting for an axis.
    pub(super) const fn number_of(&self, axis: usize) -> u16 {
        self.number.saturating_add(axis as u16)
    }

    /// How many settings the row stands for: 1, or one for each axis.
    #[must_use]
    pub const fn axes(&self) -> usize {
        match self.kind {
            Kind::AxisNumber { .. } | Kind::AxisResolution(_) => AXES,
            Kind::Byte(_) | Kind::Word(_) | Kind::Flag(_) | Kind::Number { .. } => 1,
        }
    }

    /// The value, for an axis where there is one for each; `None` for an axis that is not there.
    #[must_use]
    pub fn value(&self, settings: &Settings, axis: usize) -> Option<Value> {
        // One accessor for reading and writing: reading is done on a copy.
        let mut copy = *settings;
        Some(match self.kind {
            Kind::Byte(place) => Value::Whole(u16::from(*place(&mut copy))),
            Kind::Word(place) => Value::Whole(*place(&mut copy)),
            Kind::Flag(place) => Value::Whole(u16::from(*place(&mut copy))),
            Kind::Number {
                place, decimals, ..
            } => Value::Number(*place(&mut copy), decimals),
            Kind::AxisNumber { place, .. } => Value::Number(*place(&mut copy).get(axis)?, 3),
            Kind::AxisResolution(place) => Value::Resolution(*place(&mut copy).get(axis)?),
        })
    }

    /// Stores a value.
    fn store(
        &self,
        settings: &mut Settings,
        axis: usize,
        value: Decimal,
    ) -> Result<(), SettingError> {
        let missing = SettingError::BadStatement;
        match self.kind {
            Kind::Byte(place) => *place(settings) = byte(value)?,
            Kind::Word(place) => *place(settings) = u16::from(byte(value)?),
            Kind::Flag(place) => *place(settings) = byte(value)? != 0,
            Kind::Number {
                place, least, most, ..
            } => *place(settings) = within(value, least, most)?,
            Kind::AxisNumber { place, least, .. } => {
                *place(settings).get_mut(axis).ok_or(missing)? = within(value, least, LARGEST)?;
            }
            Kind::AxisResolution(place) => {
                let resolution = resolution(value.magnitude_millionths())?;
                *place(settings).get_mut(axis).ok_or(missing)? = resolution;
            }
        }
        Ok(())
    }
}

fn byte(value: Decimal) -> Result<u8, SettingError> {
    u8::try_from(value.whole()).map_err(|_| SettingError::OutOfRange)
}

fn within(value: Decimal, least: f32, most: f32) -> Result<f32, SettingError> {
    in_range(value.to_f32(), least, most)
}

/// A resolution that the machine can work with.
pub(super) fn resolution(millionths: u64) -> Result<StepsPerMm, SettingError> {
    StepsPerMm::from_millionths(millionths)
        .filter(|resolution| resolution.millionths() >= 1000)
        .ok_or(SettingError::OutOfRange)
}

/// A number between two others, both included.
pub(super) fn in_range(number: f32, least: f32, most: f32) -> Result<f32, SettingError> {
    if number >= least && number <= most {
        Ok(number)
    } else {
        Err(SettingError::OutOfRange)
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    fn assigned(statements: &[&str]) -> Result<Settings, SettingError> {
        let mut settings = Settings::default();
        for statement in statements {
            assign(&mut settings, statement.as_bytes())?;
        }
        Ok(settings)
    }

    #[test]
    fn the_list_has_every_number_once_and_in_order() {
        let settings = Settings::default();
        let numbers: Vec<_> = (0..).map_while(|place| listed(&settings, place)).collect();
        assert_eq!(numbers.len(), 27 + 5 * AXES);
        assert!(numbers.is_sorted_by(|a, b| a.0 < b.0));
        for (number, value) in numbers {
            let (row, axis) = find(number).unwrap();
            assert_eq!(row.value(&settings, axis), Some(value), "${number}");
            assert!(!row.name.is_empty());
        }
    }

    #[test]
    fn what_is_no_setting_is_refused_with_grbls_reason() {
        use SettingError::*;
        for (statement, error) in [
            ("0=abc", BadNumber),
            ("0=", BadNumber),
            ("100==10", BadNumber),
            ("L", BadNumber),
            ("%", BadNumber),
            ("300=abc", BadNumber),
            ("100", BadStatement),
            ("100=10X", BadStatement),
            ("0=1.2.3", BadStatement),
            ("7=1", BadStatement),
            ("99=1", BadStatement),
            ("107=1", BadStatement),
            ("136=1", BadStatement),
            ("255=1", BadStatement),
            ("799=1", BadStatement),
            ("806=1", BadStatement),
            ("800=-1", Negative),
            ("1000=1", BadStatement),
            ("-1=5", BadStatement),
            ("3=-1", Negative),
            ("7=-1", Negative),
            ("100=-1", Negative),
            ("30=-5", Negative),
            ("0=-1", Negative),
            ("0=2", ShortPulse),
            ("20=1", NeedsHoming),
        ] {
            assert_eq!(assigned(&[statement]), Err(error), "${statement}");
        }
    }

    #[test]
    fn what_the_machine_could_not_work_with_is_refused() {
        for statement in [
            "100=0",
            "110=0",
            "120=0",
            "1=256",
            "26=300",
            "4=256",
            "0=256",
            "100=100001",
            "110=99999999999999999999",
            "11=99999999999999999999",
        ] {
            let refused = assigned(&[statement]);
            assert_eq!(refused, Err(SettingError::OutOfRange), "${statement}");
        }
    }

    #[test]
    fn values_are_stored_as_grbl_stores_them() {
        let settings = assigned(&[
            "0=3",
            "1=255",
            "2=7",
            "4=2",
            "10=3.9",
            "11=0",
            "12=0",
            "25=0",
            "27=0",
            "32=1",
            "100=250.5",
            "101=100.0001",
            "111=0.5",
            "130=0",
            "26=+255",
            "801=10000.5",
            "12.7=0.25",
        ])
        .unwrap();
        assert_eq!(settings.step_pulse_us, 3);
        assert_eq!(settings.step_invert, 7);
        assert!(settings.enable_invert && settings.laser);
        assert_eq!(settings.report_mask, 3);
        assert_eq!(settings.arc_tolerance_mm, 0.25);
        assert_eq!(settings.steps_per_mm.0[0].millionths(), 250_500_000);
        assert_eq!(settings.steps_per_mm.0[1].millionths(), 100_000_100);
        assert_eq!(settings.max_rate_mm_min.0[1], 0.5);
        assert_eq!(settings.homing_debounce_ms, 255);
        assert_eq!(settings.jerk_mm_s3.0[..2], [0.0, 10_000.5]);
    }

    #[test]
    fn soft_limits_end_with_homing() {
        assert!(assigned(&["22=1", "20=1"]).unwrap().soft_limits);
        assert!(!assigned(&["22=1", "20=1", "22=0"]).unwrap().soft_limits);
        assert!(assigned(&["22=1", "20=1", "22=1"]).unwrap().soft_limits);
    }

    proptest! {
        #[test]
        fn a_refused_statement_changes_nothing(
            first in "[0-9]{1,3}=[0-9]{1,4}",
            statement in "[-+.0-9=A-Z]{0,3}[0-9]{0,3}=?[-+.0-9]{0,6}[0-9A-Z]{0,3}",
        ) {
            let mut settings = Settings::default();
            let _ = assign(&mut settings, first.as_bytes());
            let before = settings;
            if assign(&mut settings, statement.as_bytes()).is_err() {
                prop_assert_eq!(settings, before);
            }
        }
    }
}
