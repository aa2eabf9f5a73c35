//! Settings as they are written: `$110=5000`, and what machines list.

mod combine;
mod dump;
#[cfg(feature = "os")]
mod load;
mod refused;

pub use combine::{Combined, Refused, combine, last_of_each};
pub use dump::{Dump, Entry};
#[cfg(feature = "os")]
pub use load::{load, load_for, named_set, read};
pub use refused::name;

use std::path::Path;

use anyhow::{Error, Result, anyhow, bail};
use leadscrew::settings::{Settings, StepRate, assign};

use self::dump::Line;

/// Changes one setting as `$n=value` says; nothing when it is refused.
pub fn apply(settings: &mut Settings, assignment: &str) -> Result<()> {
    let entry = entry(assignment)?;
    assign(settings, entry.statement().as_bytes())
        .map_err(|error| anyhow!(refused::reason(settings, &[&entry], &entry, error)))
}

/// Reads one setting from the command line.
pub fn entry(assignment: &str) -> Result<Entry> {
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

    /// Grbl's defaults, changed to what a list says, which is in a file where that is named.
    ///
    /// # Errors
    /// Every line that cannot be read, and every setting that is refused.
    pub fn of_dump(step_rate: StepRate, file: Option<&Path>, dump: &Dump) -> Result<Self> {
        let combined = combine(&Settings::new(step_rate), &dump.entries);
        let combined = check(file, dump, combined)?;
        Ok(Self {
            settings: combined.settings,
            statements: combined.order.iter().map(Entry::statement).collect(),
        })
    }

    /// Changes one setting.
    pub fn apply(&mut self, assignment: &str) -> Result<()> {
        apply(&mut self.settings, assignment)?;
        let text = assignment.split_whitespace().collect::<String>();
        self.statements.push(text.trim_start_matches('$').into());
        Ok(())
    }
}

/// The text of a file, which is UTF-16 where PowerShell has written it.
pub fn decoded(bytes: &[u8]) -> String {
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
    let with_line = |(line, reason): &(Option<usize>, &String)| match line {
        Some(line) => format!("line {line}: {reason}"),
        None => (*reason).clone(),
    };
    let reports: Vec<_> = reasons.iter().map(with_line).collect();
    let title = match (file, &reasons[..]) {
        (None, [(_, reason)]) | (_, [(None, reason)]) => return anyhow!("{reason}"),
        (Some(path), [_]) => format!("{}: a line is refused", path.display()),
        (Some(path), all) => format!("{}: {} lines are refused", path.display(), all.len()),
        (None, all) => format!("{} settings are refused", all.len()),
    };
    anyhow!(reports.join("\n")).context(title)
}
