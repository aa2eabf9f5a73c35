//! Settings from the command line and from files.

use std::{fs, path::Path};

use anyhow::{Context, Result};
use common::ui;
use leadscrew::settings::{Settings, StepRate};

use super::{Dump, Loaded, apply, decoded, entry};
use crate::proven;

/// As [`load_for`], for the step rate that the committed report proves.
pub fn load(file: Option<&Path>, assignments: &[String]) -> Result<Loaded> {
    load_for(proven::committed(), file, assignments)
}

/// Grbl's defaults, changed by a file with settings and by single assignments, which count where
/// the file says something else, for a firmware with a proven step rate.
///
/// Any list of settings that a machine has printed can be used as it is, see [`Dump`].
///
/// # Errors
/// Every line that cannot be read, and every setting that is refused.
pub fn load_for(
    step_rate: StepRate,
    file: Option<&Path>,
    assignments: &[String],
) -> Result<Loaded> {
    let mut dump = file.map(read).transpose()?.unwrap_or_default();
    for assignment in assignments {
        dump.entries.push(entry(assignment)?);
    }
    if let (Some(path), Some(names)) = (file, dump.left_out()) {
        ui::warning(&format!("{}: left out {names}", path.display()));
    }
    Loaded::of_dump(step_rate, file, &dump)
}

/// Reads a file with settings.
pub fn read(path: &Path) -> Result<Dump> {
    let name = path.display();
    let text = fs::read(path).with_context(|| format!("cannot read the settings {name}"))?;
    Ok(Dump::read(&decoded(&text)))
}

/// The sets of settings that recordings name; everything else is Grbl's default.
const SETS: [(&str, &[&str]); 2] = [
    ("grbl_default", &[]),
    (
        "fast",
        &[
            "$100=80",
            "$101=80",
            "$102=80",
            "$110=5000",
            "$111=5000",
            "$112=5000",
            "$120=500",
            "$121=500",
            "$122=500",
        ],
    ),
];

/// Grbl's defaults with a named set of changes.
pub fn named_set(name: &str) -> Result<Settings> {
    let (_, changes) = SETS
        .iter()
        .find(|(known, _)| *known == name)
        .with_context(|| format!("there is no set of settings called {name:?}"))?;
    let mut values = Settings::new(proven::committed());
    apply(&mut values, "$10=1")?;
    for change in *changes {
        apply(&mut values, change)?;
    }
    Ok(values)
}

#[cfg(test)]
mod tests;
