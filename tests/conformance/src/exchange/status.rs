//! Status reports, and how far two of them may differ.

use std::{ops::Deref, str::FromStr};

use grbl_client::NoReport;
pub(super) use grbl_client::numbers;

/// A status report, and its numbers in mm.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Report(grbl_client::Report);

impl FromStr for Report {
    type Err = NoReport;

    fn from_str(text: &str) -> Result<Self, NoReport> {
        text.parse().map(Self)
    }
}

impl Deref for Report {
    type Target = grbl_client::Report;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl Report {
    /// Machine or work position, mm.
    pub(super) fn position_mm(&self) -> Option<Vec<f64>> {
        let position = self.machine_position().or_else(|| self.work_position());
        let scale = self.mm_per_unit();
        Some(position?.into_iter().map(|at| at * scale).collect())
    }

    /// Reports in inches have four decimals.
    pub(super) fn mm_per_unit(&self) -> f64 {
        let text = self.field("MPos").or_else(|| self.field("WPos"));
        if text.is_some_and(|text| decimals(text) == 4) {
            25.4
        } else {
            1.0
        }
    }

    /// Half of the last digit of its positions, and a little, mm.
    pub(super) fn rounding_mm(&self) -> f64 {
        if self.mm_per_unit() > 1.0 {
            0.000_051 * 25.4
        } else {
            0.000_51
        }
    }

    /// Speed along the path, mm/min.
    pub(super) fn feed_mm_min(&self) -> f64 {
        self.feed().unwrap_or(0.0) * self.mm_per_unit()
    }

    /// Spindle speed, rpm.
    pub(super) fn speed_rpm(&self) -> f64 {
        self.spindle_speed().unwrap_or(0.0)
    }

    /// The names of its fields.
    pub(super) fn names(&self) -> Vec<&str> {
        self.fields.iter().map(|(name, _)| name.as_str()).collect()
    }

    /// Those names without the fields that only every so many reports have.
    pub(super) fn lasting_names(&self) -> Vec<&str> {
        let mut names = self.names();
        names.retain(|name| !["WCO", "Ov", "A"].contains(name));
        names
    }
}

/// Whether two positions, as printed, are the same but for the last digit of numbers that lie
/// half-way between two digits: `exact` has them in the same unit.
pub(crate) fn is_tie(ours: &str, theirs: &str, exact: &[f64]) -> bool {
    let (ours, theirs): (Vec<_>, Vec<_>) = (ours.split(',').collect(), theirs.split(',').collect());
    let is_tie = |text: &str, exact: f64| {
        let scaled = exact.abs() * 10_f64.powf(decimals(text) as f64);
        (scaled.fract() - 0.5).abs() < 1e-3
    };
    ours.len() == theirs.len()
        && ours.len() == exact.len()
        && ours
            .iter()
            .zip(&theirs)
            .zip(exact)
            .all(|((our, their), exact)| {
                our == their || (is_rounded_otherwise(our, their) && is_tie(our, *exact))
            })
}

/// Digits after the first point.
fn decimals(text: &str) -> usize {
    let first = text.split(',').next().unwrap_or_default();
    first.split_once('.').map_or(0, |(_, digits)| digits.len())
}

/// Whether two texts are the same but for the last digit of numbers, which may be one apart.
pub(crate) fn is_rounded_otherwise(ours: &str, theirs: &str) -> bool {
    let is_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let split = |text: &str| -> Vec<String> {
        let mut parts = vec![String::new()];
        let mut in_number = false;
        for c in text.chars() {
            if is_number(c) != in_number {
                parts.push(String::new());
                in_number = !in_number;
            }
            if let Some(last) = parts.last_mut() {
                last.push(c);
            }
        }
        parts
    };
    let (ours, theirs) = (split(ours), split(theirs));
    ours.len() == theirs.len()
        && ours.iter().zip(&theirs).all(|(our, their)| {
            our == their
                || match (our.parse::<f64>(), their.parse::<f64>()) {
                    (Ok(a), Ok(b)) => {
                        let digits = decimals(our);
                        let unit = 0.1_f64.powf(digits as f64);
                        digits > 0 && digits == decimals(their) && (a - b).abs() < unit * 1.5
                    }
                    _ => false,
                }
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_parsed_into_fields() {
        let report: Report = "<Hold:1|MPos:1.000,-2.500,0.000|FS:500,100|Ov:100,50,100|A:S>"
            .parse()
            .unwrap();
        assert_eq!(report.state, "Hold:1");
        assert_eq!(report.position_mm(), Some(vec![1.0, -2.5, 0.0]));
        assert_eq!((report.feed_mm_min(), report.speed_rpm()), (500.0, 100.0));
        assert_eq!(report.names(), ["MPos", "FS", "Ov", "A"]);
        assert_eq!(report.lasting_names(), ["MPos", "FS"]);
        let inches: Report = "<Idle|WPos:1.0000,0.0000,0.0000|FS:0.0,0>".parse().unwrap();
        assert_eq!(inches.position_mm(), Some(vec![25.4, 0.0, 0.0]));
        assert!("<Idle|what>".parse::<Report>().is_err());
        assert!("ok".parse::<Report>().is_err());
    }

    #[test]
    fn only_numbers_exactly_between_are_ties() {
        assert!(is_tie("1.988,2.000", "1.987,2.000", &[1.9875, 2.0]));
        assert!(!is_tie("1.988,2.000", "1.987,2.000", &[1.9878, 2.0]));
        assert!(!is_tie("1.988,2.000", "1.986,2.000", &[1.9875, 2.0]));
    }

    #[test]
    fn one_unit_of_the_last_digit_is_a_rounding() {
        assert!(is_rounded_otherwise(
            "[PRB:1.988,0.000:1]",
            "[PRB:1.987,0.000:1]"
        ));
        assert!(!is_rounded_otherwise("[PRB:1.988:1]", "[PRB:1.986:1]"));
        assert!(!is_rounded_otherwise("error:9", "error:8"));
        assert!(!is_rounded_otherwise("$1=25", "$1=26"));
    }
}
