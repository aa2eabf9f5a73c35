//! Facts that the program on the board sends: a line of a name and a number for each.

use std::collections::BTreeMap;

use anyhow::{Context, Result};

/// The facts by their names.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub(super) struct Facts(BTreeMap<String, i64>);

/// Says that facts follow: what was said before is of faults.
pub(super) const BEGIN: &str = "facts";
/// Says that the program waits for bytes at its serial line.
pub(super) const READY: &str = "ready";
/// Says that there is no more.
pub(super) const END: &str = "end";

impl Facts {
    /// Reads the lines of a part of what the program sends.
    pub(super) fn read(&mut self, text: &str) -> Result<()> {
        for line in text.lines() {
            let fact = line.split_once(' ');
            let fact = fact.and_then(|(name, number)| Some((name, number.parse().ok()?)));
            let (name, number) = fact.with_context(|| format!("the program has sent {line:?}"))?;
            self.put(name, number);
        }
        Ok(())
    }

    /// Adds a fact, or replaces it.
    pub(super) fn put(&mut self, name: &str, number: i64) {
        self.0.insert(name.into(), number);
    }

    /// Adds a count.
    pub(super) fn count(&mut self, name: &str, count: usize) {
        self.put(name, i64::try_from(count).unwrap_or(i64::MAX));
    }

    /// Returns a fact.
    pub(super) fn get(&self, name: &str) -> Option<i64> {
        self.0.get(name).copied()
    }

    /// Takes a fact away.
    #[cfg(test)]
    pub(super) fn remove(&mut self, name: &str) {
        self.0.remove(name);
    }

    /// Whether the program has run in the emulator.
    pub(super) fn are_emulated(&self) -> bool {
        self.get("emulated") == Some(1)
    }

    /// Whether it has run on a virtual board.
    pub(super) fn are_virtual(&self) -> bool {
        self.get("virtual") == Some(1)
    }

    /// Whether this computer had the serial line.
    pub(super) fn have_port(&self) -> bool {
        self.get("port") == Some(1)
    }

    /// The number that no other chip has, in hexadecimal.
    pub(super) fn unique_number(&self) -> Option<String> {
        let words = ["uid.0", "uid.1", "uid.2"].map(|name| self.get(name));
        let [Some(low), Some(middle), Some(high)] = words else {
            return None;
        };
        Some(format!("{high:08X}{middle:08X}{low:08X}"))
    }
}

/// Takes the part up to a line, if that has come.
pub(super) fn take_until(text: &mut String, line: &str) -> Option<String> {
    let end = format!("{line}\n");
    let place = text
        .match_indices(&end)
        .map(|(place, _)| place)
        .find(|place| *place == 0 || text[..*place].ends_with('\n'))?;
    let after = text.split_off(place + end.len());
    let mut part = std::mem::replace(text, after);
    part.truncate(place);
    Some(part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_taken_when_its_last_line_has_come() {
        let mut text = String::from("crystal 1\nalready 2\nrea");
        assert_eq!(take_until(&mut text, READY), None);
        text += "dy\nserial.lost 0\n";
        let part = take_until(&mut text, READY).unwrap();
        assert_eq!(part, "crystal 1\nalready 2\n");
        assert_eq!(text, "serial.lost 0\n");
        let mut facts = Facts::default();
        facts.read(&part).unwrap();
        assert_eq!((facts.get("crystal"), facts.get("port")), (Some(1), None));
    }

    #[test]
    fn a_line_that_is_no_fact_is_refused() {
        for line in ["crystal", "crystal one", "panicked at src/main.rs:1"] {
            let error = Facts::default().read(line).unwrap_err().to_string();
            assert!(error.contains("has sent"), "{error}");
        }
    }
}
