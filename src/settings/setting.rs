//! One setting: reading, assigning and restoring its value.

use super::{
    Row, SettingError, Settings, Value,
    table::{DefinedBy, TABLE},
};
use crate::axis::{AXES, LETTERS};

/// One setting: a row and, where each axis has a setting, an axis.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// The row.
    pub row: &'static Row,
    axis: usize,
}

impl Setting {
    /// Returns every setting, in the order of the numbers.
    pub fn all() -> impl Iterator<Item = Self> {
        TABLE
            .iter()
            .flat_map(|row| (0..row.settings(AXES)).map(move |axis| Self { row, axis }))
    }

    /// Returns the setting that has a number.
    #[must_use]
    pub fn with_number(number: u16) -> Option<Self> {
        Self::all().find(|setting| setting.number() == number)
    }

    /// Returns the number.
    #[must_use]
    pub const fn number(&self) -> u16 {
        self.row.number + self.axis as u16
    }

    /// Returns the letter of the axis, where each axis has a setting of its own.
    #[must_use]
    pub const fn letter(&self) -> Option<u8> {
        if self.row.kind.is_per_axis() {
            Some(LETTERS[self.axis])
        } else {
            None
        }
    }

    /// Returns whether Grbl 1.1 has the setting: then `$$` lists it.
    #[must_use]
    pub fn is_of_grbl(&self) -> bool {
        self.row.defined_by == DefinedBy::Grbl
    }

    /// Returns the value.
    #[must_use]
    pub fn value(&self, settings: &Settings) -> Value {
        self.row.kind.value(settings, self.axis)
    }

    /// Changes the value to a typed value, and adjusts the settings that depend on it.
    ///
    /// # Errors
    /// Every [`SettingError`]; the settings are unchanged then.
    pub(super) fn assign(&self, settings: &mut Settings, value: Value) -> Result<(), SettingError> {
        let mut changed = *settings;
        self.restore(&mut changed, value)?;
        (self.row.adjust)(&mut changed, self.axis);
        (self.row.check)(&changed, self.axis)?;
        *settings = changed;
        Ok(())
    }

    /// Changes the value to a stored one. The rules between settings do not count, as other
    /// settings may not be restored yet.
    ///
    /// # Errors
    /// [`SettingError::OutOfRange`] or [`SettingError::ShortPulse`]; the settings are unchanged
    /// then.
    pub(super) fn restore(
        &self,
        settings: &mut Settings,
        value: Value,
    ) -> Result<(), SettingError> {
        self.row.kind.assign(settings, self.axis, value)
    }
}

/// Applies the rules between settings after every value has been restored.
pub(super) fn adjust_all(settings: &mut Settings) {
    for row in TABLE {
        (row.adjust)(settings, 0);
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;
    use crate::settings::{DataType, SettingGroup};

    /// A value other than the default.
    fn other_value(setting: &Setting, settings: &Settings) -> Value {
        match setting.value(settings) {
            Value::Whole(whole) if setting.row.kind.data_type() == DataType::Boolean => {
                Value::Whole(1 - whole)
            }
            Value::Whole(whole) => Value::Whole(whole + 4),
            Value::Number(number) => Value::Number(number + 1.0),
            Value::Millionths(millionths) => Value::Millionths(millionths + 1),
        }
    }

    #[test]
    fn every_setting_has_a_field_of_its_own() {
        let defaults = Settings::default();
        for setting in Setting::all() {
            let mut settings = defaults;
            let value = other_value(&setting, &defaults);
            setting.restore(&mut settings, value).unwrap();
            let changed: Vec<_> = Setting::all()
                .filter(|other| other.value(&settings) != other.value(&defaults))
                .map(|other| other.number())
                .collect();
            let number = setting.number();
            assert_eq!(
                changed,
                [number],
                "${number} changes these settings: give each row of TABLE a field of its own"
            );
            assert_eq!(setting.value(&settings), value, "${number}");
        }
    }

    #[test]
    fn numbers_find_their_settings_in_the_order_of_the_list() {
        let numbers: Vec<_> = Setting::all().map(|setting| setting.number()).collect();
        assert!(numbers.is_sorted_by(|a, b| a < b));
        for number in 0..=u16::MAX {
            let found = Setting::with_number(number).map(|setting| setting.number());
            assert_eq!(found, numbers.contains(&number).then_some(number));
        }
    }

    #[test]
    fn names_units_and_formats_are_texts_that_senders_can_read() {
        for setting in Setting::all() {
            let row = setting.row;
            assert!(
                SettingGroup::ALL.contains(&row.group),
                "add {:?} to ALL",
                row.group
            );
            assert!(!row.name.is_empty());
            for text in [row.name, row.unit, row.kind.format()] {
                assert!(!text.contains(['|', '[', ']']), "{text}");
                assert!(!text.contains("ok") && !text.contains("error"), "{text}");
            }
        }
    }

    #[test]
    fn every_default_is_a_value_that_the_setting_can_have() {
        let defaults = Settings::default();
        for setting in Setting::all() {
            let mut settings = defaults;
            let value = setting.value(&defaults);
            setting.assign(&mut settings, value).unwrap();
            assert_eq!(settings, defaults, "${}", setting.number());
        }
    }
}
