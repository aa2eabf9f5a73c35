//! Settings from the command line and from files: `$110=5000`.

use std::{fs, path::Path};

use anyhow::{Context, Result, anyhow, bail};
use leadscrew::settings::{Setting, SettingError, Settings, StepRate, assign};

use crate::proven;

/// Changes one setting as `$n=value` says; nothing when it is refused.
pub fn apply(settings: &mut Settings, assignment: &str) -> Result<()> {
    let text: String = assignment.split_whitespace().collect();
    let Some((number, value)) = text.strip_prefix('$').and_then(|text| text.split_once('=')) else {
        bail!(
            "{assignment:?} is no setting: write it as '$110=5000' (the quotes keep the shell out)"
        );
    };
    let setting = number.parse().ok().and_then(Setting::with_number);
    let setting =
        setting.with_context(|| format!("there is no setting ${number} (in {assignment:?})"))?;
    assign(settings, &text.as_bytes()[1..]).map_err(|error| {
        let (name, unit) = (setting.row.name, setting.row.unit);
        let letter = setting.letter().map_or(String::new(), |letter| {
            format!(" of {}", char::from(letter))
        });
        let unit = if unit.is_empty() {
            String::new()
        } else {
            format!(", {unit}")
        };
        let reason = reason(error);
        anyhow!("${number}={value}: {reason} (${number} is {name}{letter}{unit})")
    })
}

fn reason(error: SettingError) -> &'static str {
    match error {
        SettingError::BadNumber => "this is no number",
        SettingError::BadStatement => "this cannot be read",
        SettingError::Negative => "a value below 0 makes no sense",
        SettingError::ShortPulse => "step pulses have at least 3 µs",
        SettingError::NeedsHoming => "soft limits need homing, so set $22=1 first",
        SettingError::OutOfRange => "this is outside the range of the setting",
        SettingError::StepRate => {
            "this makes more steps per second than are proven, or than the step pulse leaves room for"
        }
    }
}

/// Grbl's defaults with some changes, and the changes.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The settings.
    pub settings: Settings,
    /// What made them so: `110=5000`, in order.
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

/// Grbl's defaults, changed by a file of `$n=value` lines and by single assignments, for a firmware
/// with a proven step rate.
///
/// In the file, empty lines and comments (`;`, `#`, or in parentheses) are allowed; what `$$`
/// prints can be used as it is.
pub fn load_for(
    step_rate: StepRate,
    file: Option<&Path>,
    assignments: &[String],
) -> Result<Loaded> {
    let mut loaded = Loaded::new(step_rate);
    if let Some(path) = file {
        let name = path.display();
        let text = fs::read(path).with_context(|| format!("cannot read the settings {name}"))?;
        let text = String::from_utf8_lossy(&text);
        for (number, line) in (1..).zip(text.lines()) {
            let line = line
                .split([';', '#', '('])
                .next()
                .unwrap_or_default()
                .trim();
            if !line.is_empty() {
                loaded
                    .apply(line)
                    .with_context(|| format!("line {number} of {name}"))?;
            }
        }
    }
    for assignment in assignments {
        loaded.apply(assignment)?;
    }
    Ok(loaded)
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
mod tests {
    use std::{env, process};

    use super::*;

    #[test]
    fn assignments_change_settings() {
        let mut settings = Settings::default();
        apply(&mut settings, "$110=5000").unwrap();
        apply(&mut settings, " $ 121 = 12.5 ").unwrap();
        assert_eq!(settings.max_rate_mm_min[0], 5000.0);
        assert_eq!(settings.acceleration_mm_s2[1], 12.5);
    }

    #[test]
    fn a_refused_assignment_says_why_and_changes_nothing() {
        let mut settings = Settings::default();
        for (text, part) in [
            ("110=5", "is no setting"),
            ("", "is no setting"),
            ("$110", "is no setting"),
            ("$x=1", "there is no setting $x"),
            ("$7=1", "there is no setting $7"),
            ("$300=1", "there is no setting $300"),
            ("$110=fast", "largest speed of X, mm/min"),
            ("$100=0", "outside the range"),
            ("$0=1", "at least 3 µs"),
            ("$111=-5", "below 0"),
            ("$20=1", "$22=1"),
        ] {
            let error = apply(&mut settings, text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        assert_eq!(settings, Settings::default());
    }

    #[test]
    fn a_file_is_what_the_machine_lists() {
        let path = env::temp_dir().join(format!("leadscrew-settings-{}", process::id()));
        fs::write(
            &path,
            "; mine\n$0=10\r\n\n$110=3000.000 (x max rate)\nok?\n",
        )
        .unwrap();
        let error = load(Some(&path), &[]).unwrap_err();
        assert!(error.to_string().starts_with("line 5 of"), "{error}");
        fs::write(&path, "$110=3000.000 (x max rate)\n").unwrap();
        let loaded = load(Some(&path), &["$111=4000".into()]).unwrap();
        assert_eq!(loaded.statements, ["110=3000.000", "111=4000"]);
        assert_eq!(loaded.settings.max_rate_mm_min.0[..2], [3000.0, 4000.0]);
        fs::remove_file(&path).unwrap();
        assert!(load(Some(&path), &[]).is_err());
    }

    #[test]
    fn every_set_of_settings_is_valid() {
        for (name, _) in SETS {
            named_set(name).unwrap();
        }
        assert_eq!(named_set("fast").unwrap().max_rate_mm_min[0], 5000.0);
        assert!(named_set("slow").is_err());
    }
}
