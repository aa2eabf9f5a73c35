//! What the numbers of errors and alarms mean.
//!
//! The tables are those of Leadscrew: up to 38 and 10 they are Grbl's, above as grblHAL has them where the meaning
//! fits. Other firmware has numbers of its own, which have no text here.

use leadscrew::{gcode::LineError, model::Alarm};

/// What is wrong with a line that has `error:N`, on one line.
#[must_use]
pub fn error(number: u16) -> Option<&'static str> {
    let mut errors = LineError::ALL.into_iter();
    let error = errors.find(|error| u16::from(error.number()) == number)?;
    Some(error.text())
}

/// Why a machine is locked that says `ALARM:N`, on one line. What is no number has no meaning.
#[must_use]
pub fn alarm(number: &str) -> Option<&'static str> {
    let number: u8 = number.parse().ok()?;
    let mut alarms = Alarm::ALL.into_iter();
    Some(alarms.find(|alarm| alarm.number() == number)?.text())
}

/// A meaning behind what has it: after a comma, or nothing where there is none.
#[must_use]
pub fn after_comma(meaning: Option<&str>) -> String {
    meaning.map_or_else(String::new, |text| format!(", {text}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_numbers_have_a_meaning_and_others_none() {
        assert!(error(12).is_some_and(|text| text.contains("step rate")));
        assert_eq!(error(999), None);
        assert!(alarm("1").is_some_and(|text| text.contains("limit switch")));
        assert_eq!((alarm("99"), alarm("Hard limit")), (None, None));
        assert_eq!(after_comma(Some("why")), ", why");
        assert_eq!(after_comma(None), "");
    }
}
