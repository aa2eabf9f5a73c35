//! Answers of Grbl 1.1h that are in the repository: the files of `tests/conformance/`, one for each topic.
//!
//! A line is a statement, `->`, and what Grbl sends in answer, its lines between `|`. A statement begins at
//! power-up; behind two spaces it follows the one before. `0x18` is a byte that is no part of a line.
//! `@ $22=1` is what is stored at power-up from there on, `# ` begins a remark.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use common::cargo;
use serde_json::{Value, json};

use crate::{exchange::Exchange, golden::sorted};

/// Grbl's output at power-up, and the lines after it when Grbl is locked.
const WELCOME: [&str; 2] = ["", "Grbl 1.1h ['$' for help]"];
const LOCKED_MESSAGE: &str = "[MSG:'$H'|'$X' to unlock]";

/// Reads the topics, or those asked for.
///
/// # Errors
/// A file cannot be read, or a line of it has another form.
pub(super) fn load(topics: &[String]) -> Result<Vec<Exchange>> {
    let mut exchanges = Vec::new();
    let paths = sorted(&cargo::root().join("tests/conformance"))?;
    let is_text = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "txt");
    for path in paths.into_iter().filter(is_text) {
        let topic = path.file_stem().unwrap_or_default().to_string_lossy();
        if topics.is_empty() || topics.iter().any(|name| *name == topic) {
            exchanges.extend(read_file(&topic, &path)?);
        }
    }
    Ok(exchanges)
}

fn read_file(topic: &str, path: &Path) -> Result<Vec<Exchange>> {
    let text = fs::read_to_string(path);
    let text = text.with_context(|| format!("cannot read {}", path.display()))?;
    read(topic, &text).with_context(|| format!("{} has another form", path.display()))
}

/// An exchange while its lines are read.
struct Begun {
    /// The number of its first line.
    number: usize,
    settings: Vec<String>,
    steps: Vec<Value>,
}

impl Begun {
    fn finish(self, topic: &str) -> Result<Exchange> {
        let is_locked = self.settings.iter().any(|setting| setting == "$22=1");
        let boot = WELCOME
            .into_iter()
            .chain(is_locked.then_some(LOCKED_MESSAGE));
        let recorded = json!({
            "id": format!("{topic}.txt:{}", self.number),
            "settings_set": "fast",
            "extra_settings": self.settings,
            "boot": boot.collect::<Vec<_>>(),
            "result": self.steps,
        });
        Exchange::read(topic, &recorded)
    }
}

fn read(topic: &str, text: &str) -> Result<Vec<Exchange>> {
    let mut begun: Vec<Begun> = Vec::new();
    let mut settings = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        if line.starts_with("# ") {
            continue;
        }
        if let Some(stored) = line.strip_prefix('@') {
            settings = stored.split_whitespace().map(str::to_owned).collect();
            continue;
        }
        let (line, follows) = line
            .strip_prefix("  ")
            .map_or((line, false), |line| (line, true));
        let step = step(line).with_context(|| format!("line {number} has no `->`"))?;
        if follows {
            let before = begun.last_mut();
            let before = before.with_context(|| format!("line {number} follows no other"))?;
            before.steps.push(step);
        } else {
            begun.push(Begun {
                number,
                settings: settings.clone(),
                steps: vec![step],
            });
        }
    }
    ensure!(!begun.is_empty(), "there is no statement");
    begun.into_iter().map(|begun| begun.finish(topic)).collect()
}

/// A statement and its answer, as recorded exchanges have them.
fn step(line: &str) -> Option<Value> {
    let (sent, answer) = line.rsplit_once("->")?;
    let sent = sent.strip_suffix(' ').unwrap_or(sent);
    let answers: Vec<&str> = if answer.trim().is_empty() {
        Vec::new()
    } else {
        answer.split(" | ").map(str::trim).collect()
    };
    Some(match sent.strip_prefix("0x") {
        Some(byte) => json!({"rt": byte, "recv": answers}),
        None => json!({"line": sent, "recv": answers}),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::Verdict;

    /// The verdicts of each exchange in a text.
    fn verdicts(text: &str) -> Vec<Verdict> {
        let exchanges = read("topic", text).unwrap();
        let verdict = |exchange: &Exchange| Verdict::of(&exchange.replay().unwrap());
        exchanges.iter().map(verdict).collect()
    }

    #[test]
    fn each_answer_is_compared_from_power_up_on() {
        let text = "# A remark.\nG1 X2 -> error:22\nG1 X2 F100 -> ok\n  X3 -> ok\n-> ok\n";
        assert_eq!(verdicts(text), [Verdict::Agrees; 3]);
        let wrong = text.replace("error:22", "error:20");
        let found = verdicts(&wrong);
        assert_eq!(found[0], Verdict::Differs);
        assert_eq!(found[1..], [Verdict::Agrees; 2]);
        let wrong = text.replace("X3 -> ok", "X3 -> error:22");
        assert_eq!(verdicts(&wrong)[1], Verdict::Differs);
        assert_eq!(
            verdicts(&text.replace("-> ok\n  X3", "->\n  X3"))[1],
            Verdict::Differs
        );
    }

    #[test]
    fn what_is_stored_and_bytes_are_played() {
        let text =
            "@ $22=1\nG0 X1 -> error:9\n  $X -> [MSG:Caution: Unlocked] | ok\n@\nG0 X1 -> ok\n";
        assert_eq!(verdicts(text), [Verdict::Agrees; 2]);
        assert_eq!(verdicts(&text.replace("@ $22=1", "@"))[0], Verdict::Differs);
        let text = "M3 -> ok\n  0x18 -> | Grbl 1.1h ['$' for help]\n";
        assert_eq!(verdicts(text), [Verdict::Agrees]);
        assert_eq!(verdicts(&text.replace("1.1h", "1.1f")), [Verdict::Differs]);
    }

    #[test]
    fn a_line_of_another_form_is_named() {
        for (text, part) in [
            ("G0\n", "line 1 has no"),
            ("  G0 -> ok\n", "follows no other"),
            ("# nothing\n", "no statement"),
        ] {
            let error = format!("{:#}", read("topic", text).unwrap_err());
            assert!(error.contains(part), "{error}");
        }
    }
}
