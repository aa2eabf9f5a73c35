//! Settings of a file beside those of a machine.

use leadscrew::settings::{DataType, Setting};
use owo_colors::OwoColorize;
use simulation::settings::{self, Dump, Entry};

/// Two settings that differ.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Difference {
    /// The number.
    pub(crate) number: u16,
    /// One value, as it is written; `-` without.
    pub(crate) left: String,
    /// The other value.
    pub(crate) right: String,
}

/// A file and a machine.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Comparison {
    /// Settings of the file that the machine has otherwise, or does not have.
    pub(crate) differences: Vec<Difference>,
    /// Names of the settings that the file does not have.
    others: Vec<String>,
}

impl Comparison {
    /// The settings that the file does not have, to read; none without any.
    pub(crate) fn only_on_the_machine(&self) -> Option<String> {
        (!self.others.is_empty()).then(|| Dump::in_ranges(&self.others).join(", "))
    }
}

/// Compares the settings of a file with those of a machine, in the order of the numbers.
pub(crate) fn compare(file: &[Entry], machine: &[Entry]) -> Comparison {
    let mut differences: Vec<_> = file
        .iter()
        .filter_map(|entry| {
            let other = value(machine, entry.number);
            let is_equal = other.is_some_and(|other| is_equal(entry, other));
            (!is_equal).then(|| Difference {
                number: entry.number,
                left: entry.value.clone(),
                right: other.unwrap_or("-").into(),
            })
        })
        .collect();
    differences.sort_by_key(|difference| difference.number);
    let others = machine
        .iter()
        .filter(|entry| value(file, entry.number).is_none());
    Comparison {
        differences,
        others: others.map(|entry| format!("${}", entry.number)).collect(),
    }
}

/// The value of the setting with a number.
pub(crate) fn value(entries: &[Entry], number: u16) -> Option<&str> {
    let found = entries.iter().find(|entry| entry.number == number);
    found.map(|entry| entry.value.as_str())
}

/// Whether a machine that shows `shown` has the value of `entry`: it shows a number of decimals.
pub(crate) fn is_equal(entry: &Entry, shown: &str) -> bool {
    let number = |text: &str| text.parse::<f64>().ok();
    let (Some(wanted), Some(has)) = (number(&entry.value), number(shown)) else {
        return entry.value == shown;
    };
    if entry.setting().row.kind.data_type() == DataType::Boolean {
        // Everything but 0 is on.
        return (wanted as i64 == 0) == (has as i64 == 0);
    }
    let decimals = shown
        .split_once('.')
        .map_or(0, |(_, decimals)| decimals.len());
    let shown_step = (0..decimals).fold(1.0, |step, _| step / 10.0);
    // Settings have single precision, and are rounded to what is shown.
    let step = f64::max(shown_step, has.abs() * 1e-7);
    (wanted - has).abs() <= 0.501 * step
}

/// A table of differences.
pub(crate) fn table(left: &str, right: &str, differences: &[Difference]) -> String {
    let rows: Vec<[String; 4]> = differences
        .iter()
        .map(|difference| {
            let setting = Setting::with_number(difference.number);
            let name = setting.as_ref().map_or_else(String::new, settings::name);
            let number = format!("${}", difference.number);
            [
                number,
                name,
                difference.left.clone(),
                difference.right.clone(),
            ]
        })
        .collect();
    let head = ["", "setting", left, right].map(String::from);
    let width = |column: usize| {
        let cells = rows
            .iter()
            .chain([&head])
            .map(|row| row[column].chars().count());
        cells.max().unwrap_or_default()
    };
    let widths = [0, 1, 2, 3].map(width);
    let line = |[number, name, left, right]: &[String; 4]| {
        format!(
            "{number:>0$}  {name:<1$}  {left:>2$}  {right:>3$}",
            widths[0], widths[1], widths[2], widths[3]
        )
    };
    let head = line(&head).dimmed().to_string();
    let lines: Vec<_> = [head].into_iter().chain(rows.iter().map(line)).collect();
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(text: &str) -> Vec<Entry> {
        Dump::read(&text.replace(' ', "\n")).entries
    }

    fn difference(number: u16, left: &str, right: &str) -> Difference {
        Difference {
            number,
            left: left.into(),
            right: right.into(),
        }
    }

    #[test]
    fn values_are_equal_as_numbers_within_what_is_shown() {
        for (file, machine, is_same) in [
            ("$100=250", "$100=250.000", true),
            ("$100=250.00000", "$100=250.000", true),
            ("$100=188.9474", "$100=188.947", true),
            ("$100=188.949", "$100=188.947", false),
            ("$30=1000.000", "$30=1000", true),
            ("$110=9999999", "$110=9999999.000", true),
            ("$3=5", "$3=4", false),
            ("$13=7", "$13=1", true),
            ("$13=0", "$13=1", false),
            ("$11=abc", "$11=0.010", false),
        ] {
            let comparison = compare(&entries(file), &entries(machine));
            assert_eq!(
                comparison.differences.is_empty(),
                is_same,
                "{file} {machine}"
            );
        }
    }

    #[test]
    fn what_only_one_side_has_is_reported() {
        let comparison = compare(
            &entries("$800=5 $0=10 $1=25"),
            &entries("$0=5 $1=25 $2=0 $3=0 $4=0 $10=1"),
        );
        let expected = [difference(0, "10", "5"), difference(800, "5", "-")];
        assert_eq!(comparison.differences, expected);
        assert_eq!(comparison.only_on_the_machine().unwrap(), "$2-$4, $10");
        let same = compare(&entries("$0=10"), &entries("$0=10"));
        assert_eq!(same.only_on_the_machine(), None);
    }

    #[test]
    fn a_table_has_number_name_and_both_values() {
        let differences = [difference(0, "10", "5"), difference(110, "5000", "500.000")];
        let table = table("file", "machine", &differences);
        let plain = anstream::adapter::strip_str(&table).to_string();
        let lines: Vec<_> = plain.lines().collect();
        assert_eq!(
            lines,
            [
                "      setting             file  machine",
                "  $0  step pulse            10        5",
                "$110  largest speed of X  5000  500.000",
            ]
        );
    }
}
