//! Recordings, differences and their tally.

use std::{
    collections::BTreeMap,
    fmt::Write as _,
    path::{Path, PathBuf},
};

use leadscrew::{axis::AXES, interpreter::Interpreter};

use crate::machine::modal_numbers;

/// The recordings, where the checkout has them beside it.
pub(crate) fn conformance() -> Option<PathBuf> {
    if AXES > 3 {
        println!("skipped: the recordings are of a machine with three axes");
        return None;
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/conformance");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no recordings in {}", folder.display());
    None
}

/// What Grbl showed after a line.
pub(crate) struct Expected {
    pub(crate) response: String,
    pub(crate) position: [f64; 3],
    pub(crate) feed: f64,
    pub(crate) speed: f64,
    pub(crate) tool: u8,
    pub(crate) modal: String,
}

pub(crate) fn is_close(ours: f64, theirs: f64) -> bool {
    (ours - theirs).abs() <= 0.002_f64.max(theirs.abs() * 1.0e-6)
}

/// What differs from Grbl, other than the tool number; empty where nothing does.
pub(crate) fn differences(machine: &Interpreter, response: &str, expected: &Expected) -> String {
    let mut text = String::new();
    if response != expected.response {
        let _ = write!(text, " {response}, not {}", expected.response);
    }
    for (axis, &theirs) in expected.position.iter().enumerate() {
        let ours = machine.position()[axis].to_mm_f64();
        if !is_close(ours, theirs) {
            let _ = write!(text, " axis {axis} at {ours}, not {theirs}");
        }
    }
    let modal = machine.modal();
    for (letter, ours, theirs) in [
        ('F', modal.feed, expected.feed),
        ('S', modal.speed_rpm, expected.speed),
    ] {
        if !is_close(f64::from(ours), theirs) {
            let _ = write!(text, " {letter}{ours}, not {theirs}");
        }
    }
    let ours = modal_numbers(machine);
    if ours != expected.modal {
        let _ = write!(text, " modes {ours}, not {}", expected.modal);
    }
    text
}

/// Rows compared, differences by name, and those without.
#[derive(Default)]
pub(crate) struct Tally {
    pub(crate) rows: usize,
    deviations: BTreeMap<&'static str, usize>,
    pub(crate) unexplained: Vec<String>,
}

impl Tally {
    pub(crate) fn deviation(&mut self, name: &'static str) {
        *self.deviations.entry(name).or_default() += 1;
    }

    pub(crate) fn finish(self, what: &str) {
        println!("{what}: {} lines compared", self.rows);
        for (name, count) in &self.deviations {
            println!("  {count:6} {name}");
        }
        let shown = self.unexplained.iter().take(30);
        let shown: Vec<&str> = shown.map(String::as_str).collect();
        assert!(
            self.unexplained.is_empty(),
            "{} lines differ:\n{}",
            self.unexplained.len(),
            shown.join("\n")
        );
    }
}

pub(crate) const TOOL_STAYS: &str = "D13: T stays until the next T word";
