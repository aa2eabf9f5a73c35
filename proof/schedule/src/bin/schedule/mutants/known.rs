//! Faults that proofs of earlier versions accepted: `proof/schedule/faults.toml`.

use std::{collections::BTreeMap, fmt::Write as _, fs};

use anyhow::{Context, Result, ensure};
use common::{cargo, ui};
use serde::Deserialize;

use crate::project_copy::{ProjectCopy, Texts};

const TABLE: &str = "proof/schedule/faults.toml";
/// What is found where Cargo refuses a copy.
const UNBUILT: &str = "does not build";

/// The file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    fault: Vec<KnownFault>,
}

/// A fault.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KnownFault {
    class: String,
    name: String,
    file: String,
    old: String,
    new: String,
    /// Further replacements: file, old, new.
    #[serde(default)]
    more: Vec<[String; 3]>,
    /// A part of what is said of it.
    found: String,
    /// Faults of one image are in one copy.
    image: Option<String>,
}

impl KnownFault {
    /// Its replacements: file, old, new.
    fn replacements(&self) -> impl Iterator<Item = [&String; 3]> {
        let more = self.more.iter().map(|[file, old, new]| [file, old, new]);
        [[&self.file, &self.old, &self.new]].into_iter().chain(more)
    }
}

/// Puts all faults into copies; returns the table by classes, and whether all were refused.
pub(super) fn try_all(copy: &ProjectCopy<'_>) -> Result<(String, bool)> {
    let text = fs::read_to_string(cargo::root().join(TABLE))?;
    let table: Table = toml::from_str(&text).with_context(|| TABLE.to_owned())?;
    let mut images: Vec<Vec<&KnownFault>> = Vec::new();
    for fault in &table.fault {
        let same =
            |image: &&mut Vec<&KnownFault>| fault.image.is_some() && image[0].image == fault.image;
        match images.iter_mut().find(same) {
            Some(image) => image.push(fault),
            None => images.push(vec![fault]),
        }
    }
    let mut classes: BTreeMap<&str, (usize, Vec<&str>)> = BTreeMap::new();
    for image in &images {
        let said = said_of(copy, image)?;
        for fault in image {
            let (refused, accepted) = classes.entry(&fault.class).or_default();
            let flaw = said.iter().find(|flaw| flaw.contains(&fault.found));
            if let Some(flaw) = flaw {
                *refused += 1;
                ui::status("Refused", &format!("{}: {flaw}", fault.name));
            } else {
                accepted.push(&fault.name);
                let said = said.first().map_or("nothing", |it| it.as_str());
                ui::status(
                    "Accepted",
                    &format!("{}; the proof says {said}", fault.name),
                );
            }
        }
    }
    let is_whole = classes.values().all(|(_, accepted)| accepted.is_empty());
    Ok((shown(&classes), is_whole))
}

/// What the build and the proof say of a copy with some faults.
fn said_of(copy: &ProjectCopy<'_>, faults: &[&KnownFault]) -> Result<Vec<String>> {
    let mut texts = Texts::new();
    for fault in faults {
        for [file, old, new] in fault.replacements() {
            let text = copy.text(&texts, file)?;
            let found = text.matches(old.as_str()).count();
            ensure!(
                found == 1,
                "{}: {file} has {found} times what it replaces",
                fault.name
            );
            texts.insert(file.clone(), text.replacen(old.as_str(), new, 1));
        }
    }
    copy.with(&texts, || {
        if !copy.build()? {
            return Ok(vec![UNBUILT.to_owned()]);
        }
        Ok(match copy.analyse() {
            Ok(report) => report.flaws.into_iter().map(|flaw| flaw.what).collect(),
            Err(error) => vec![error.to_string()],
        })
    })
}

/// The table by classes.
fn shown(classes: &BTreeMap<&str, (usize, Vec<&str>)>) -> String {
    let mut text = String::from("| class | refused | accepted |\n|---|---|---|\n");
    for (class, (refused, accepted)) in classes {
        let all = refused + accepted.len();
        let accepted = if accepted.is_empty() {
            "-".to_owned()
        } else {
            accepted.join(", ")
        };
        // Writing to a string never fails.
        let _ = writeln!(text, "| {class} | {refused} of {all} | {accepted} |");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fault_replaces_what_its_file_has_once() {
        let text = fs::read_to_string(cargo::root().join(TABLE)).unwrap();
        let table: Table = toml::from_str(&text).unwrap();
        for fault in &table.fault {
            for [file, old, _] in fault.replacements() {
                let text = fs::read_to_string(cargo::root().join(file)).expect(file);
                assert_eq!(
                    text.matches(old.as_str()).count(),
                    1,
                    "{}: {file}",
                    fault.name
                );
            }
        }
    }

    #[test]
    fn the_table_names_what_was_accepted() {
        let classes = BTreeMap::from([("chips", (2, vec![])), ("memory", (1, vec!["a fault"]))]);
        let rows = "| chips | 2 of 2 | - |\n| memory | 1 of 2 | a fault |\n";
        assert!(shown(&classes).ends_with(rows));
    }
}
