//! Comments that bound loops, all made too small at once: which of them the proof refuses.

use std::fmt::Write as _;

use anyhow::{Error, Result};
use schedule::{Report, SourceFile};

use crate::project_copy::ProjectCopy;

/// Words of a comment before a number or a name.
const COMMENT_KEYS: [&str; 2] = ["wcet-bound: ", "wcet-total: "];

/// Analyses the program of a copy with each number and name in such comments set to 1, and says what is refused. The
/// code stays the same.
pub(super) fn set_to_one(copy: &ProjectCopy<'_>) -> Result<String> {
    let before = copy.analyse()?;
    let files = SourceFile::all(&copy.folder).map_err(Error::msg)?;
    let mut comments = Vec::new();
    for file in &files {
        let lines = (1..).zip(file.text.lines());
        let stated = lines.filter(|(_, line)| line.contains("// wcet-"));
        comments.extend(stated.map(|(number, _)| format!("{}:{number}", file.name)));
    }
    let texts = files.iter();
    let texts = texts.map(|file| (file.name.clone(), with_one(&file.text)));
    let after = copy.with(&texts.collect(), || copy.analyse())?;
    Ok(outcomes(&comments, &before, &after))
}

/// A text with 1 for each number and name in its comments.
fn with_one(text: &str) -> String {
    let mut changed = text.to_owned();
    for key in COMMENT_KEYS {
        let mut parts = changed.split(key);
        let mut new = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            let is_count = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
            new += key;
            new += "1";
            new += part.trim_start_matches(is_count);
        }
        changed = new;
    }
    changed
}

/// What became of each comment.
fn outcomes(comments: &[String], before: &Report, after: &Report) -> String {
    let names = |text: &str, place: &str| {
        let mut found = text.match_indices(place);
        found.any(|(at, _)| !text[at + place.len()..].starts_with(|it: char| it.is_ascii_digit()))
    };
    let is_refused = |place: &&String| after.flaws.iter().any(|flaw| names(&flaw.what, place));
    let is_believed = |place: &&String| before.believed.iter().any(|it| it.place == **place);
    let (refused, others): (Vec<_>, Vec<_>) = comments.iter().partition(is_refused);
    let (believed, unused): (Vec<_>, Vec<_>) = others.into_iter().partition(is_believed);
    let mut text = format!(
        "{} comments bound loops. Each number and name in them set to 1:\n\n| outcome | comments | |\n|---|---|---|\n",
        comments.len()
    );
    for (outcome, places) in [
        ("refused", refused),
        ("believed: the replay alone can tell", believed),
        ("bounds no loop of this firmware", unused),
    ] {
        let list: Vec<&str> = places.iter().map(|place| place.as_str()).collect();
        let _ = writeln!(text, "| {outcome} | {} | {} |", list.len(), list.join(", "));
    }
    text
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use schedule::{BelievedLoop, Flaw, Place, Rule};

    use super::*;

    #[test]
    fn each_number_and_name_becomes_one_and_the_rest_stays() {
        let text =
            "// wcet-bound: 32, wcet-total: a_1 per f: 7 words\nlet a = 32; // wcet-bound: 6\n";
        let one = "// wcet-bound: 1, wcet-total: 1 per f: 7 words\nlet a = 32; // wcet-bound: 1\n";
        assert_eq!(with_one(text), one);
    }

    #[test]
    fn a_comment_is_refused_or_believed_or_without_a_loop() {
        let comments = ["src/a.rs:1", "src/a.rs:11", "src/a.rs:12"].map(str::to_owned);
        let flaw = Flaw {
            rule: Rule::WrongBound,
            what: "a loop runs 5 times, but src/a.rs:11 says 1".into(),
            place: Place::default(),
            remedy: String::new(),
        };
        let believed = BelievedLoop {
            place: "src/a.rs:1".into(),
            count: "7".into(),
            reason: "so".into(),
        };
        let before = Report {
            believed: BTreeSet::from([believed]),
            ..Report::default()
        };
        let after = Report {
            flaws: vec![flaw],
            ..Report::default()
        };
        let text = outcomes(&comments, &before, &after);
        assert!(text.contains("| refused | 1 | src/a.rs:11 |"), "{text}");
        assert!(text.contains("tell | 1 | src/a.rs:1 |"), "{text}");
        assert!(text.ends_with("firmware | 1 | src/a.rs:12 |\n"), "{text}");
    }
}
