//! Files and single assignments together.

use std::{env, path::PathBuf, process};

use anyhow::Error;

use super::{super::Entry, *};

/// A file that goes when it is dropped.
struct File(PathBuf);

impl File {
    fn new(name: &str, text: &str) -> Self {
        let path = env::temp_dir().join(format!("leadscrew-{name}-{}", process::id()));
        fs::write(&path, text).unwrap();
        Self(path)
    }
}

impl Drop for File {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// An error as the user reads it.
fn report(error: &Error) -> String {
    format!("{error:#}")
}

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
        ("$110=fast", "largest speed of X"),
        ("$100=0", "0.001 to 100 000 step/mm"),
        ("$0=1", "3 to 255 µs"),
        ("$111=-5", "0.001 to 10 000 000 mm/min"),
        ("$20=1", "$22=1"),
    ] {
        let error = apply(&mut settings, text).unwrap_err().to_string();
        assert!(error.contains(part), "{text}: {error}");
        let loaded = load(None, &[text.into()]).unwrap_err().to_string();
        assert_eq!(loaded, error, "{text}");
    }
    assert_eq!(settings, Settings::default());
}

#[test]
fn every_refused_line_is_reported() {
    let text = "; mine\n$0=10\r\n\n$110=0,5\nok?\n$20=1\n$14=7\n";
    let file = File::new("refused.settings", text);
    let error = load(Some(&file.0), &["$100=0".into()]).unwrap_err();
    let report = report(&error);
    assert!(
        report.contains(": 4 lines are refused: line 4: $110=0,5: "),
        "{report}"
    );
    for part in [
        "\nline 5: \"ok?\" is no setting",
        "\nline 6: $20=1: ",
        "\n$100=0: ",
    ] {
        assert!(report.contains(part), "{report}");
    }
    assert!(!report.contains("$14"), "{report}");
}

#[test]
fn the_command_line_counts_where_the_file_says_something_else() {
    let file = File::new(
        "overridden.settings",
        "$110=30000.000 (x max rate)\n$10=511\n$20=1\n",
    );
    assert!(load(Some(&file.0), &[]).is_err());
    let set = ["$20=0", "$10=1", "$110=3000", "$111=4000"].map(String::from);
    let loaded = load(Some(&file.0), &set).unwrap();
    assert_eq!(loaded.statements, ["20=0", "10=1", "110=3000", "111=4000"]);
    assert_eq!(loaded.settings.max_rate_mm_min.0[..2], [3000.0, 4000.0]);
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let error = load(Some(Path::new("no.settings")), &[]).unwrap_err();
    assert!(error.to_string().contains("no.settings"), "{error}");
}

#[test]
fn a_file_in_utf_16_is_read_as_one_in_utf_8() {
    let text = "\u{feff}$1=30\r\n$2=5\r\n";
    let utf_16: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    for bytes in [&utf_16[..], text.as_bytes()] {
        let statements: Vec<_> = Dump::read(&decoded(bytes))
            .entries
            .iter()
            .map(Entry::statement)
            .collect();
        assert_eq!(statements, ["1=30", "2=5"]);
    }
}

#[test]
fn every_set_of_settings_is_valid() {
    for (name, _) in SETS {
        named_set(name).unwrap();
    }
    assert_eq!(named_set("fast").unwrap().max_rate_mm_min[0], 5000.0);
    assert!(named_set("slow").is_err());
}
