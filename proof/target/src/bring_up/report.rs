//! The report: what was measured on which chip with which image, and a digest of all of it.

use std::{collections::BTreeMap, fmt::Write as _};

use anyhow::{Context, Result, ensure};
use firmware::boards::Board;
use serde::Serialize;
use serde_json::Value;

use super::{
    checks::{Check, Verdict},
    facts::Facts,
};

/// The name of the digest in a report, which is of everything but itself.
const DIGEST: &str = "sha256";

/// The report.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    /// Name of the board.
    board: String,
    /// Name of the chip.
    part: String,
    /// Whether it is an emulator or a model.
    is_emulated: bool,
    /// The number that no other chip has; none in the emulator.
    unique_number: Option<String>,
    /// Digest of the program.
    image_sha256: String,
    /// That of all checks.
    verdict: Verdict,
    /// The checks, in their order.
    checks: Vec<Check>,
    /// What was measured, by name.
    facts: Facts,
}

impl Report {
    pub(super) fn new(board: &Board, image: &[u8], facts: Facts, checks: Vec<Check>) -> Self {
        let has = |verdict| checks.iter().any(|check| check.verdict() == verdict);
        let is_open = |check: &Check| check.items.iter().any(|item| item.verdict == Verdict::Open);
        let verdict = if has(Verdict::Failed) {
            Verdict::Failed
        } else if checks.iter().any(is_open) {
            Verdict::Open
        } else {
            Verdict::Passed
        };
        Self {
            board: board.name.clone(),
            part: board.part.probe_rs.clone(),
            is_emulated: facts.are_emulated() || facts.are_virtual(),
            unique_number: facts.unique_number(),
            image_sha256: digest(image),
            verdict,
            checks,
            facts,
        }
    }

    pub(super) fn checks(&self) -> &[Check] {
        &self.checks
    }

    /// Failed if a part has failed, open if a part is, otherwise passed.
    pub(super) const fn verdict(&self) -> Verdict {
        self.verdict
    }

    pub(super) const fn is_emulated(&self) -> bool {
        self.is_emulated
    }

    /// The name of its files.
    pub(super) fn name(&self) -> String {
        let number = self.unique_number.as_deref();
        let number = number.filter(|_| !self.is_emulated).unwrap_or("emulated");
        format!("{}-{number}", self.board)
    }

    /// The result, in a sentence.
    pub(super) fn summary(&self) -> String {
        let count = |verdict| {
            let items = self.checks.iter().flat_map(|check| &check.items);
            items.filter(|item| item.verdict == verdict).count()
        };
        let counts = [Verdict::Passed, Verdict::Failed, Verdict::Open].map(count);
        let [passed, failed, open] = counts;
        format!("{passed} parts passed, {failed} failed, {open} open")
    }

    /// Returns the report with its digest.
    pub(super) fn json(&self) -> String {
        let mut report = serde_json::to_value(self).expect("names and numbers become JSON");
        report[DIGEST] = digest_of(&report).into();
        let text = serde_json::to_string_pretty(&report).expect("it is JSON already");
        text + "\n"
    }

    /// Returns the report as a page that needs nothing else.
    pub(super) fn page(&self) -> String {
        let title = format!("Bring-up of {}", self.board);
        let title = escaped(&title);
        let mut page = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n\
             <h1>{title}</h1>\n<p>{}.</p>\n",
            escaped(&self.summary())
        );
        if self.is_emulated {
            page += "<p>By a model: no chip has been measured.</p>\n";
        }
        for check in &self.checks {
            let verdict = check.verdict();
            let _ = write!(
                page,
                "<h2>{}: <span class=\"{1}\">{1}</span></h2>\n<table>\n<tr><th>part</th>\
                 <th>measured</th><th>must be</th><th>verdict</th></tr>\n",
                escaped(check.title),
                word(verdict)
            );
            for item in &check.items {
                let _ = writeln!(
                    page,
                    "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"{3}\">{3}</td></tr>",
                    escaped(&item.name),
                    escaped(&item.measured),
                    escaped(&item.expected),
                    word(item.verdict)
                );
            }
            page += "</table>\n";
        }
        let number = self.unique_number.as_deref().unwrap_or("none");
        let report = serde_json::to_value(self).expect("names and numbers become JSON");
        let _ = write!(
            page,
            "<h2>Of what</h2>\n<table>\n<tr><td>part</td><td>{}</td></tr>\n\
             <tr><td>unique number</td><td>{}</td></tr>\n\
             <tr><td>SHA-256 of the program</td><td>{}</td></tr>\n\
             <tr><td>SHA-256 of the report</td><td>{}</td></tr>\n</table>\n\
             </main>\n</body>\n</html>\n",
            escaped(&self.part),
            escaped(number),
            self.image_sha256,
            digest_of(&report)
        );
        page
    }
}

const STYLE: &str = include_str!("style.css");

const fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Passed => "passed",
        Verdict::Failed => "failed",
        Verdict::Open => "open",
    }
}

/// A text that HTML does not take for something else.
fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    text.replace('"', "&quot;")
}

/// Checks whether a report has the digest of its other entries.
pub(super) fn verify(text: &[u8]) -> Result<()> {
    let mut report: Value = serde_json::from_slice(text).context("the report is no JSON")?;
    let entries = report.as_object_mut().context("the report is no object")?;
    let written = entries.remove(DIGEST);
    let written = written.context("the report has no digest")?;
    ensure!(
        written == digest_of(&report),
        "the report is not as it was written: its digest is of something else"
    );
    Ok(())
}

/// Returns the digest of JSON without blanks, with names in their order.
fn digest_of(report: &Value) -> String {
    digest(sorted(report).to_string().as_bytes())
}

/// Sorts names, which the library does or does not, by what else is compiled.
fn sorted(value: &Value) -> Value {
    match value {
        Value::Object(entries) => {
            let entries: BTreeMap<_, _> = entries.iter().collect();
            let entries = entries.into_iter();
            Value::Object(
                entries
                    .map(|(name, it)| (name.clone(), sorted(it)))
                    .collect(),
            )
        }
        Value::Array(items) => Value::Array(items.iter().map(sorted).collect()),
        other => other.clone(),
    }
}

fn digest(bytes: &[u8]) -> String {
    let digest = hmac_sha256::Hash::hash(bytes);
    digest.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(image: &[u8], uid: i64) -> Report {
        let board = firmware::boards::named("nucleo-f446re").unwrap();
        let mut facts = Facts::default();
        for (name, number) in [("uid.0", uid), ("uid.1", 2), ("uid.2", 3), ("port", 1)] {
            facts.put(name, number);
        }
        Report::new(&board, image, facts, Vec::new())
    }

    fn digest_in(report: &Report) -> String {
        let json: Value = serde_json::from_str(&report.json()).unwrap();
        json[DIGEST].as_str().unwrap().to_owned()
    }

    #[test]
    fn the_digest_is_of_contents_chip_and_image() {
        let digests = [
            report(b"image", 1),
            report(b"other image", 1),
            report(b"image", 4),
        ];
        let [first, image, chip] = digests.map(|report| digest_in(&report));
        assert!(first != image && first != chip && image != chip);
        assert_eq!(first, digest_in(&report(b"image", 1)));
        assert_eq!(
            digest(b"abc"),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
    }

    #[test]
    fn a_report_that_was_changed_is_not_verified() {
        let report = report(b"image", 1);
        let text = report.json();
        assert!(verify(text.as_bytes()).is_ok(), "{text}");
        assert!(report.page().contains(&digest_in(&report)));
        for (from, to) in [
            ("\"port\": 1", "\"port\": 0"),
            ("nucleo-f446re", "nucleo-f446ze"),
            ("\"sha256\": \"", "\"sha256\": \"0"),
            ("\"sha256\"", "\"sha\""),
        ] {
            assert!(text.contains(from), "{from}");
            assert!(verify(text.replace(from, to).as_bytes()).is_err(), "{from}");
        }
        assert_eq!(report.name(), "nucleo-f446re-000000030000000200000001");
    }
}
