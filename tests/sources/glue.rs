//! Chip and simulator call the machine through the bodies of the tasks only: read from the sources.

use super::sources;

/// The bodies in `src/tasks.rs`, which both must call.
const BODIES: [&str; 7] = [
    "step",
    "serial_rx",
    "segment_start",
    "inputs",
    "prepare",
    "interpret",
    "report",
];

/// What the bodies alone call: methods of the motion, the session, the filter of the inputs, the
/// reader of the events and the segments.
const INTERNALS: [&str; 6] = [
    "run",
    "report",
    "latch",
    "sample",
    "advance",
    "start_segment",
];

/// Methods of the same names that are the platforms' own, with what they are called on.
const OWN: [(&str, &str); 5] = [
    ("tasks", "report"),
    ("serial", "run"),
    ("serial", "report"),
    ("self", "report"),
    ("simulator", "advance"),
];

/// The names of a source in their order, comments left out, each with the text between it and the name before, and its
/// line.
fn names(source: &str) -> Vec<(String, String, usize)> {
    let mut names = Vec::new();
    let mut between = String::new();
    for (number, line) in source.lines().enumerate() {
        let mut code = line.split("//").next().unwrap_or_default();
        while let Some(start) = code.find(|c: char| c.is_alphabetic() || c == '_') {
            between.extend(code[..start].chars().filter(|c| !c.is_whitespace()));
            let name = &code[start..];
            let end = name
                .find(|c: char| !c.is_alphanumeric() && c != '_')
                .unwrap_or(name.len());
            names.push((std::mem::take(&mut between), name[..end].into(), number + 1));
            code = &name[end..];
        }
        between.extend(code.chars().filter(|c| !c.is_whitespace()));
    }
    names
}

/// The uses in a source of what the bodies alone call, with their lines.
fn bypasses(source: &str) -> Vec<(String, usize)> {
    let names = names(source);
    let mut found = Vec::new();
    for (index, (between, name, line)) in names.iter().enumerate() {
        let receiver = index.checked_sub(1).map_or("", |before| &names[before].1);
        let is_member = between.ends_with('.') || between.ends_with("::");
        let is_own = OWN.contains(&(receiver, name));
        let is_internal = is_member && INTERNALS.contains(&name.as_str()) && !is_own;
        if is_internal || name == "realtime" {
            found.push((format!("{receiver}{between}{name}"), *line));
        }
    }
    found
}

#[test]
fn chip_and_simulator_call_the_bodies_of_the_tasks_and_nothing_in_them() {
    for platform in [&["src/app.rs", "src/board"][..], &["src/sim"]] {
        let sources = sources(platform);
        assert!(sources.len() > 5, "{platform:?} is not where it was");
        for (path, source) in &sources {
            let found = bypasses(source);
            assert!(found.is_empty(), "{path}: {found:?}");
        }
        for body in BODIES {
            let call = format!("tasks::{body}(");
            let is_called = sources.iter().any(|(_, source)| source.contains(&call));
            assert!(is_called, "{platform:?} does not call tasks::{body}");
        }
    }
}

#[test]
fn a_call_outside_the_tasks_is_found_however_it_is_written() {
    for (source, line) in [
        ("let prepared = self.motion.run(requests);\n", 1),
        ("\nlet run = Motion::run;\n", 2),
        ("session\n    .report(&snapshot);\n", 2),
        (
            "use leadscrew::{\n    protocol::{Session, realtime},\n};\n",
            2,
        ),
        ("let read = cx.local.events_out.advance();\n", 1),
        ("segments.start_segment(played)\n", 1),
        ("self.watch.latch(closed); // the levels\n", 1),
    ] {
        let found = bypasses(source);
        assert_eq!(found.len(), 1, "{source:?}: {found:?}");
        assert_eq!(found[0].1, line, "{source:?}");
    }
    for source in [
        "// motion.run()\n",
        "tasks::report(console, &snapshot, requests);\n",
        "let run = |serial: &mut SerialSession| serial.run(&snapshot);\n",
        "pub(crate) fn run(&mut self) {}\n",
        "self.simulator.advance(next)\n",
    ] {
        assert_eq!(bypasses(source), [], "{source:?}");
    }
}
