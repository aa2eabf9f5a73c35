//! Lists of settings as machines, senders and people leave them, in `dumps/`: each is loaded, or
//! refused with everything that is wrong.

use std::{
    fs,
    path::{Path, PathBuf},
};

use common::cargo;
use leadscrew::settings::{Settings, StepRate, assign};
use serde_json::Value;
use simulation::settings::{self, Dump, Loaded};

const RATE: StepRate = StepRate::Proven(200_000);

fn path(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dumps");
    folder.join(name)
}

/// Loads a file, and makes sure that a new machine accepts the same in the order that is found.
fn loaded(name: &str, assignments: &[&str]) -> Loaded {
    let assignments: Vec<_> = assignments.iter().map(|text| (*text).into()).collect();
    let loaded = settings::load_for(RATE, Some(&path(name)), &assignments);
    let loaded = loaded.unwrap_or_else(|error| panic!("{error:#}"));
    let mut machine = Settings::new(RATE);
    for statement in &loaded.statements {
        let answer = assign(&mut machine, statement.as_bytes());
        assert_eq!(answer, Ok(()), "{name}: ${statement}");
    }
    assert_eq!(machine, loaded.settings, "{name}");
    loaded
}

fn refused(name: &str, assignments: &[&str]) -> String {
    let assignments: Vec<_> = assignments.iter().map(|text| (*text).into()).collect();
    let error = settings::load_for(RATE, Some(&path(name)), &assignments).unwrap_err();
    let file = path(name).display().to_string();
    format!("{error:#}").replace(&file, name)
}

#[test]
fn the_list_of_this_firmware_is_loaded_whole() {
    let loaded = loaded("leadscrew.txt", &[]);
    assert_eq!(loaded.statements.len(), 42);
    assert!(loaded.settings.soft_limits && loaded.settings.parking);
    assert_eq!(loaded.settings.jerk_mm_s3.0[..3], [9000.0, 9000.0, 4000.0]);
}

#[test]
fn the_defaults_of_grbl_change_nothing() {
    let loaded = loaded("grbl-defaults.txt", &[]);
    assert_eq!(loaded.settings, Settings::new(RATE));
    assert_eq!(loaded.statements.len(), 34);
}

#[test]
fn names_in_parentheses_of_grbl_0_9_are_skipped() {
    let settings = loaded("grbl-0.9.txt", &[]).settings;
    assert_eq!(settings.direction_invert, 5);
    assert!(settings.is_homing_on() && !settings.soft_limits);
    assert_eq!(settings.steps_per_mm[1].millionths(), 188_947_000);
}

#[test]
fn a_log_of_a_terminal_is_read_for_what_came() {
    let settings = loaded("laser-log.txt", &[]).settings;
    assert!(settings.laser && settings.soft_limits && settings.is_homing_on());
    assert_eq!(settings.max_rate_mm_min[0], 12_000.0);
}

#[test]
fn soft_limits_may_stand_before_homing_and_speeds_before_resolutions() {
    let settings = loaded("router-edited.txt", &[]).settings;
    assert!(settings.soft_limits && settings.is_homing_on() && settings.report_inches);
    assert_eq!(settings.step_pulse_us, 5);
    assert_eq!(settings.max_rate_mm_min.0[..3], [8000.0, 8000.0, 3000.0]);
}

#[test]
fn numbers_of_grblhal_that_are_unknown_are_reported_in_one_line() {
    let loaded = loaded("grblhal.txt", &[]);
    assert_eq!(loaded.settings.steps_per_mm[2].millionths(), 640_000_000);
    assert!(loaded.settings.enable_invert && loaded.settings.soft_limits);
    let dump = settings::read(&path("grblhal.txt")).unwrap();
    assert_eq!(dump.entries.len(), loaded.statements.len());
    assert_eq!(dump.entries.len() + dump.others.len(), 99);
    let report = dump.left_out().unwrap();
    let count = format!(
        "{} settings that this machine does not have: ",
        dump.others.len()
    );
    assert!(
        report.starts_with(&count) && !report.contains('\n'),
        "{report}"
    );
    assert!(report.contains("$300-$305, $307, "), "{report}");
}

#[test]
fn a_sum_of_bits_that_only_grblhal_has_is_refused_or_replaced() {
    let text = fs::read_to_string(path("grblhal.txt")).unwrap();
    let dump = Dump::read(&text.replace("$10=255", "$10=511"));
    let combined = settings::combine(&Settings::new(RATE), &dump.entries);
    let error = settings::check(Some(Path::new("grblhal")), &dump, combined).unwrap_err();
    let report = format!("{error:#}");
    assert!(
        report.contains("line 13: $10=511: 0 to 255 is allowed"),
        "{report}"
    );
    assert_eq!(loaded("grblhal.txt", &["$10=1"]).settings.report_mask, 1);
}

#[test]
fn fluidncs_named_settings_are_left_out() {
    let settings = loaded("fluidnc.txt", &[]).settings;
    assert!(settings.soft_limits);
    assert_eq!(settings.max_rate_mm_min[2], 1200.0);
    let report = settings::read(&path("fluidnc.txt")).unwrap().left_out();
    assert_eq!(
        report.as_deref(),
        Some("4 settings that this machine does not have: $Sta/SSID, $Message/Level, $N0, $N1")
    );
}

#[test]
fn all_that_is_refused_is_reported_with_its_line_and_its_limits() {
    assert_eq!(
        refused("too-fast.txt", &[]),
        "too-fast.txt: 5 lines are refused: \
         line 5: $20=1: soft limits need homing, which is off; $22=1 would do (soft limits)\n\
         line 6: $26=300: 0 to 255 ms is allowed (homing delay for the switch to settle)\n\
         line 7: $100=250,000: a number has no comma: 250.000 or 250000 (resolution of X)\n\
         line 10: $110=20000.000: 83 333 steps/s; $0=10 leaves room for 59 659 (14 318 mm/min), \
         $0=4 would do (largest speed of X)\n\
         line 11: $111=20000.000: 83 333 steps/s; $0=10 leaves room for 59 659 (14 318 mm/min), \
         $0=4 would do (largest speed of Y)"
    );
    let repaired = loaded("too-fast.txt", &["$0=4", "$20=0", "$26=255", "$100=250"]);
    assert_eq!(repaired.settings.max_rate_mm_min.0[..2], [20_000.0; 2]);
}

/// The lists that a recorded machine has answered, each once.
fn lists(recording: &Value, found: &mut Vec<String>) {
    match recording {
        Value::Object(fields) => {
            for value in fields.values() {
                lists(value, found);
            }
        }
        Value::Array(values) => {
            let lines = values.iter().filter_map(Value::as_str);
            let text = lines.fold(String::new(), |text, line| text + line + "\n");
            let is_list = text.contains("$0=") && text.contains("\n$132=");
            if is_list && !found.contains(&text) {
                found.push(text);
            }
            for value in values {
                lists(value, found);
            }
        }
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}

#[test]
fn every_list_that_grbl_was_recorded_to_answer_is_loaded() {
    let folder = cargo::root().join("../shared/conformance/suites");
    let mut found = Vec::new();
    for name in ["grbl_transcripts.json", "grbl_error_cases.json"] {
        let Ok(text) = fs::read_to_string(folder.join(name)) else {
            println!("skipped: there is no ../shared/conformance/suites/{name}");
            return;
        };
        let recording = serde_json::from_str(&text).expect("recordings are JSON");
        lists(&recording, &mut found);
    }
    assert!(
        found.len() >= 3,
        "{} lists are in the recordings",
        found.len()
    );
    for text in found {
        let dump = Dump::read(&text);
        assert_eq!((dump.entries.len(), dump.left_out()), (34, None), "{text}");
        let combined = settings::combine(&Settings::new(RATE), &dump.entries);
        let combined = settings::check(None, &dump, combined).unwrap();
        assert_eq!(combined.settings.max_travel_mm[0], 200.0, "{text}");
    }
}
