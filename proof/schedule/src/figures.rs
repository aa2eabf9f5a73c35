//! The numbers of `schedule.toml` that no analysis gives, and who keeps each of them.
//!
//! Every number there has one `[[figure]]`, which states the claim and its evidence. A number
//! without one is a flaw, as is a `[[figure]]` of a number or a file that does not exist. A time written here would be
//! a copy that the code may leave behind: only the constants of the program count, as symbols of its file, unless
//! nothing in the code keeps the claim.

use std::{collections::BTreeMap, path::Path};

use toml::{Table, Value};

use crate::{
    Config, Flaw, KnownFigures,
    config::{Evidence, FigureConfig},
    system::misconfigured,
};

/// The tables whose numbers the proof counts on. The others say what it must show.
const TABLES: [&str; 5] = ["bounds", "calls", "limits", "substitution", "task"];
/// Keys of these tables that hold names or reasons, and no numbers.
const NAMES: [&str; 6] = [
    "excludes",
    "kind",
    "releases",
    "row",
    "undeadlined",
    "vectors",
];

/// All numbers with what is known of them, and a flaw for each that nothing is said of.
pub(crate) fn of(text: &str, config: &Config, root: &Path) -> (Vec<KnownFigures>, Vec<Flaw>) {
    let mut numbers = BTreeMap::new();
    // The text has been parsed before.
    for (name, value) in text.parse::<Table>().unwrap_or_default() {
        if TABLES.contains(&name.as_str()) {
            collect(&name, &value, &mut numbers);
        }
    }
    let mut flaws = Vec::new();
    for name in numbers.keys() {
        let said = config.figure.iter().filter(|one| one.covers(name)).count();
        if said != 1 {
            let what = format!(
                "{said} entries of `schedule.toml` say how far `{name}` is known, and not one"
            );
            let remedy = "Name it in one `[[figure]]`: what it claims, and who checks that.";
            flaws.push(misconfigured(what, remedy));
        }
    }
    for figure in &config.figure {
        let mut formulas = numbers.iter().filter(|(name, _)| figure.covers(name));
        if !matches!(figure.known, Evidence::Believed | Evidence::Promised)
            && let Some((name, formula)) = formulas.find(|(_, formula)| copies_time(formula))
        {
            let what = format!("`{name}` in `schedule.toml` copies a time: `{formula}`");
            let remedy = "Name the constant of the program (src/board/proof_constants.rs).";
            flaws.push(misconfigured(what, remedy));
        }
        for name in &figure.names {
            if !numbers.keys().any(|number| covers(name, number)) {
                let what =
                    format!("a `[[figure]]` of `schedule.toml` names `{name}`, which is no number");
                flaws.push(misconfigured(what, "Correct the name, or take it out."));
            }
        }
        for file in figure.by.iter().filter(|file| !root.join(file).is_file()) {
            let what =
                format!("a `[[figure]]` of `schedule.toml` names `{file}`, which is no file");
            let remedy = "Name the file that keeps or checks it.";
            flaws.push(misconfigured(what, remedy));
        }
    }
    let known = config.figure.iter().map(|figure| known(figure, &numbers));
    (known.collect(), flaws)
}

/// Adds the numbers of a value, each with its whole name.
fn collect(name: &str, value: &Value, numbers: &mut BTreeMap<String, String>) {
    match value {
        Value::Table(table) => {
            for (key, value) in table {
                if !NAMES.contains(&key.as_str()) {
                    collect(&format!("{name}.{key}"), value, numbers);
                }
            }
        }
        Value::String(formula) => {
            numbers.insert(name.to_owned(), formula.clone());
        }
        other => {
            numbers.insert(name.to_owned(), shown(other));
        }
    }
}

/// Whether a formula has a time other than one of a unit, `3.5ms`, or is a time and nothing else, `1ms`.
fn copies_time(formula: &str) -> bool {
    let words = formula.split(|it: char| !it.is_alphanumeric() && it != '.' && it != '_');
    let (times, others): (Vec<&str>, Vec<&str>) = words
        .filter(|word| word.ends_with(char::is_alphabetic) || word.contains('_'))
        .partition(|word| word.starts_with(|first: char| first.is_ascii_digit()));
    let is_unit = |time: &&str| time.trim_end_matches(char::is_alphabetic) == "1";
    !times.is_empty() && (others.is_empty() || !times.iter().all(is_unit))
}

/// A value as it stands in the file.
fn shown(value: &Value) -> String {
    match value {
        Value::String(text) => format!("\"{text}\""),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => format!("{number:?}"),
        Value::Boolean(value) => value.to_string(),
        Value::Datetime(time) => time.to_string(),
        Value::Array(values) => {
            let values: Vec<_> = values.iter().map(shown).collect();
            format!("[{}]", values.join(", "))
        }
        Value::Table(_) => String::new(),
    }
}

fn known(figure: &FigureConfig, numbers: &BTreeMap<String, String>) -> KnownFigures {
    let named = numbers.iter().filter(|(name, _)| figure.covers(name));
    KnownFigures {
        formulas: named
            .map(|(name, formula)| (name.clone(), formula.clone()))
            .collect(),
        claim: figure.claim.clone(),
        known: figure.known.words().to_owned(),
        by: figure.by.clone(),
    }
}

impl FigureConfig {
    fn covers(&self, number: &str) -> bool {
        self.names.iter().any(|name| covers(name, number))
    }
}

/// Whether a name is that of a number, or of a table that the number is in.
fn covers(name: &str, number: &str) -> bool {
    let suffix = number.strip_prefix(name);
    suffix.is_some_and(|suffix| suffix.is_empty() || suffix.starts_with('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with one task of two numbers.
    fn figures(entries: &str) -> (Vec<KnownFigures>, Vec<String>) {
        let text = format!(
            "{entries}
            [require]
            axes = 3
            step_rate_hz = {{}}
            jitter_us = 1.0
            step_wcet_cycles = 1
            [limits]
            critical_section_cycles = 200
            icache_lines = 64
            stack_guard_bytes = 0
            [table]
            step_task = \"a\"
            step_rate_hz = 1
            baud = 1
            [task.a]
            vectors = [\"b\"]
            period = \"2us\"
            deadline = 7
            "
        );
        let config = Config::parse(&text).unwrap();
        let (known, flaws) = of(&text, &config, Path::new(env!("CARGO_MANIFEST_DIR")));
        (known, flaws.into_iter().map(|flaw| flaw.what).collect())
    }

    fn entry(names: &str, by: &str) -> String {
        format!(
            "[[figure]]\nnames = {names}\nclaim = \"c\"\nknown = \"believed\"\nby = [\"{by}\"]\n"
        )
    }

    #[test]
    fn every_number_has_one_entry() {
        let limits = entry("[\"limits\"]", "Cargo.toml");
        let (known, flaws) = figures(&(limits.clone() + &entry("[\"task.a\"]", "Cargo.toml")));
        assert_eq!(flaws, [""; 0]);
        let formulas = [("task.a.deadline", "7"), ("task.a.period", "2us")];
        let formulas = formulas.map(|(name, formula)| (name.to_owned(), formula.to_owned()));
        assert_eq!(known[1].formulas, BTreeMap::from(formulas));
        let (_, flaws) = figures(&(limits.clone() + &entry("[\"task.a.period\"]", "Cargo.toml")));
        assert_eq!(flaws.len(), 1);
        assert!(flaws[0].contains("0 entries") && flaws[0].contains("`task.a.deadline`"));
        let twice = entry("[\"task\", \"task.a.period\"]", "Cargo.toml");
        let twice = limits + &twice + &entry("[\"task.a.period\"]", "Cargo.toml");
        let (_, flaws) = figures(&twice);
        assert_eq!(flaws.len(), 1);
        assert!(flaws[0].contains("2 entries") && flaws[0].contains("`task.a.period`"));
    }

    #[test]
    fn an_entry_names_numbers_and_files_that_exist() {
        let (_, flaws) = figures(&entry(
            "[\"limits\", \"task\", \"task.a.per\"]",
            "Cargo.tom",
        ));
        assert_eq!(flaws.len(), 2);
        assert!(flaws[0].contains("`task.a.per`, which is no number"));
        assert!(flaws[1].contains("`Cargo.tom`, which is no file"));
    }

    #[test]
    fn what_the_code_keeps_is_no_copy_of_a_time() {
        for (formula, copies) in [
            ("TICKS * 1ticks - 16 * spacing", false),
            ("1s / (SAMPLES * 1us)", false),
            ("3.5ms - 16 * spacing", true),
            ("128ticks", true),
            ("1ms", true),
            ("78 + 12 * (axes - 3)", false),
            ("max(1s / rate, 250us)", true),
        ] {
            assert_eq!(copies_time(formula), copies, "{formula}");
        }
        let entries = entry("[\"task.a\", \"limits\"]", "Cargo.toml");
        let entries = entries.replace("believed", "random");
        let (_, flaws) = figures(&entries);
        assert_eq!(
            flaws,
            ["`task.a.period` in `schedule.toml` copies a time: `2us`"]
        );
    }
}
