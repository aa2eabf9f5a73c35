//! `$n=value`: a setting's number and its new value as text.

use super::{Setting, Settings, Value};
use crate::decimal::Decimal;

/// The reason for which a value is refused. The settings are unchanged then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SettingError {
    /// There is no number where one is required.
    BadNumber,
    /// There is no such setting, or there is text after the value.
    BadStatement,
    /// A value below 0.
    Negative,
    /// A step pulse shorter than 3 µs.
    ShortPulse,
    /// Soft limits without homing.
    NeedsHoming,
    /// A value outside the range of the setting.
    OutOfRange,
    /// A resolution and a largest speed that together exceed the step rate.
    StepRate,
}

/// Reads a number and the `=` after it. Returns the number and the text after the
/// `=`.
///
/// # Errors
/// `BadNumber` without a number, `BadStatement` without the `=` and for a number with a fraction.
pub fn numbered(statement: &[u8]) -> Result<(i64, &[u8]), SettingError> {
    let (number, tail) = Decimal::parse(statement).ok_or(SettingError::BadNumber)?;
    match tail.split_first() {
        Some((b'=', text)) if number.is_whole() => Ok((number.trunc(), text)),
        _ => Err(SettingError::BadStatement),
    }
}

/// Changes a setting, from the text between the `$` and the end of the line: `110=5000`.
///
/// # Errors
/// Every [`SettingError`]; the settings are unchanged then.
pub fn assign(settings: &mut Settings, statement: &[u8]) -> Result<(), SettingError> {
    let (number, text) = numbered(statement)?;
    let (value, tail) = Decimal::parse(text).ok_or(SettingError::BadNumber)?;
    if !tail.is_empty() {
        return Err(SettingError::BadStatement);
    }
    let number = u16::try_from(number).map_err(|_| SettingError::BadStatement)?;
    let setting = Setting::with_number(number);
    // Also for a value so little below 0 that it rounds to 0.
    let is_negative = text.starts_with(b"-") && text.iter().any(|byte| matches!(byte, b'1'..=b'9'));
    if is_negative && !setting.is_some_and(|setting| setting.row.kind.has_negative()) {
        return Err(SettingError::Negative);
    }
    let setting = setting.ok_or(SettingError::BadStatement)?;
    let value = Value::typed(value, &setting.row.kind)?;
    setting.assign(settings, value)
}

#[cfg(test)]
mod tests {
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
    fn a_statement_without_a_setting_is_refused_with_grbls_reason() {
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
            ("12.7=0.25", BadStatement),
            ("99=1", BadStatement),
            ("107=1", BadStatement),
            ("136=1", BadStatement),
            ("255=1", BadStatement),
            ("806=1", BadStatement),
            ("800=-1", Negative),
            ("1000=1", BadStatement),
            ("-1=5", BadStatement),
            ("3=-1", Negative),
            ("7=-1", Negative),
            ("100=-1", Negative),
            ("30=-5", Negative),
            ("0=-1", Negative),
            ("11=-0.00000001", Negative),
            ("11=-.00000000000001", Negative),
            ("0=2", ShortPulse),
            ("20=1", NeedsHoming),
        ] {
            assert_eq!(assigned(&[statement]), Err(error), "${statement}");
        }
    }

    #[test]
    fn a_value_that_the_machine_cannot_work_with_is_refused() {
        for statement in [
            "100=0",
            "110=0",
            "120=0",
            "1=256",
            "26=300",
            "4=256",
            "13=2",
            "10=3.9",
            "24=0",
            "25=0.999",
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
            "10=3.0",
            "11=-0.0",
            "12=0",
            "27=0",
            "32=1",
            "100=250.5",
            "101=100.0001",
            "111=0.5",
            "130=0",
            "26=+255",
            "801=10000.5",
            "12=0.25",
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
        #![proptest_config(crate::cases(64))]

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
