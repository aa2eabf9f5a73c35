//! Settings from the command line and from files: `$110=5000`, and what machines list.

mod combine;
mod dump;
mod refused;

pub use combine::{Combined, Refused, combine, last_of_each};
pub use dump::{Dump, Entry};
pub use refused::name;

use std::{fs, path::Path};

use anyhow::{Context, Error, Result, anyhow, bail};
use common::ui;
use leadscrew::settings::{Settings, StepRate, assign};

use crate::proven;

use self::dump::Line;

/// Changes one setting as `$n=value` says; nothing when it is refused.
pub fn apply(settings: &mut Settings, assignment: &str) -> Result<()> {
    let entry = entry(assignment)?;
    assign(settings, entry.statement().as_bytes())
        .map_err(|error| anyhow!(refused::reason(settings, &[&entry], &entry, error)))
}

/// Reads one setting from the command line.
fn entry(assignment: &str) -> Result<Entry> {
    match Line::read(assignment) {
        Line::Setting(number, value) => Ok(Entry {
            number,
            value,
            line: None,
        }),
        Line::Other(name) => bail!("there is no setting {name} (in {assignment:?})"),
        Line::Unreadable(reason) if reason.starts_with("there") => {
            bail!("{reason} (in {assignment:?})")
        }
        Line::Nothing | Line::Unreadable(_) => bail!(
            "{assignment:?} is no setting: write it as '$110=5000' (the quotes keep the shell out)"
        ),
    }
}

/// Grbl's defaults with some changes, and the changes.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The settings.
    pub settings: Settings,
    /// What made them so: `110=5000`, in an order in which a machine accepts each.
    pub statements: Vec<String>,
}

impl Loaded {
    /// Grbl's defaults, for a firmware with a proven step rate.
    pub fn new(step_rate: StepRate) -> Self {
        Self {
            settings: Settings::new(step_rate),
            statements: Vec::new(),
        }
    }

    /// Changes one setting.
    pub fn apply(&mut self, assignment: &str) -> Result<()> {
        apply(&mut self.settings, assignment)?;
        let text = assignment.split_whitespace().collect::<String>();
        self.statements.push(text.trim_start_matches('$').into());
        Ok(())
    }
}

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
    let combined = combine(&Settings::new(step_rate), &dump.entries);
    let combined = check(file, &dump, combined)?;
    Ok(Loaded {
        settings: combined.settings,
        statements: combined.order.iter().map(Entry::statement).collect(),
    })
}

/// Reads a file with settings.
pub fn read(path: &Path) -> Result<Dump> {
    let name = path.display();
    let text = fs::read(path).with_context(|| format!("cannot read the settings {name}"))?;
    Ok(Dump::read(&decoded(&text)))
}

/// The text of a file, which is UTF-16 where PowerShell has written it.
fn decoded(bytes: &[u8]) -> String {
    let Some(units) = bytes.strip_prefix(b"\xff\xfe") else {
        return String::from_utf8_lossy(bytes).into();
    };
    let (units, _) = units.as_chunks();
    let units: Vec<_> = units.iter().map(|unit| u16::from_le_bytes(*unit)).collect();
    String::from_utf16_lossy(&units)
}

/// Fails where a line cannot be read or a setting is refused, with all of them.
pub fn check(
    file: Option<&Path>,
    dump: &Dump,
    combined: Result<Combined, Vec<Refused>>,
) -> Result<Combined> {
    let refused = match combined {
        Ok(combined) if dump.unreadable.is_empty() => return Ok(combined),
        Ok(_) => Vec::new(),
        Err(refused) => refused,
    };
    let unreadable = dump
        .unreadable
        .iter()
        .map(|(line, reason)| (Some(*line), reason));
    let refused = refused
        .iter()
        .map(|refused| (refused.entry.line, &refused.reason));
    Err(all(file, unreadable.chain(refused).collect()))
}

/// The error that tells everything that is wrong with some settings.
fn all(file: Option<&Path>, mut reasons: Vec<(Option<usize>, &String)>) -> Error {
    // Those of the command line have no line and come last.
    reasons.sort_by_key(|(line, _)| line.unwrap_or(usize::MAX));
    let tell = |(line, reason): &(Option<usize>, &String)| match line {
        Some(line) => format!("line {line}: {reason}"),
        None => (*reason).clone(),
    };
    let told: Vec<_> = reasons.iter().map(tell).collect();
    let title = match (file, &reasons[..]) {
        (None, [(_, reason)]) | (_, [(None, reason)]) => return anyhow!("{reason}"),
        (Some(path), [_]) => format!("{}: a line is refused", path.display()),
        (Some(path), all) => format!("{}: {} lines are refused", path.display(), all.len()),
        (None, all) => format!("{} settings are refused", all.len()),
    };
    anyhow!(told.join("\n")).context(title)
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
