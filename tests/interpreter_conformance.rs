//! The interpreter against what Grbl 1.1h answered, line by line.
//!
//! Reads the recordings in `../shared/conformance` (check mode: response, position and modal state
//! after each line) and says that it skipped where they are absent. Every difference must be one
//! of the named deviations; they are counted and printed.

#![cfg(not(target_os = "none"))]

use std::{
    collections::BTreeMap,
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use leadscrew::{
    axis::{AXES, Axes},
    gcode::{Distance, FeedMode, LineError, Motion, Probe, ToolLength, Units, WorkCoordinates},
    interpreter::{Interpreter, Message},
    planner::{Plane, Rotation, Spindle},
    settings::Settings,
    units::Nm,
};
use serde_json::Value;

/// The recordings, where the checkout has them beside it.
fn conformance() -> Option<PathBuf> {
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

/// A line as the line assembler hands it on, or `None` where it is too long for it.
fn assembled(line: &[u8]) -> Option<Vec<u8>> {
    const LONGEST: usize = 255;
    let mut text = Vec::new();
    let mut in_comment = false;
    for &byte in line {
        match byte {
            b')' if in_comment => in_comment = false,
            _ if in_comment => {}
            b'(' => in_comment = true,
            b';' => break,
            0..=b' ' | b'/' | b'?' | b'!' | b'~' | 0x80.. => {}
            _ => text.push(byte.to_ascii_uppercase()),
        }
    }
    (text.len() <= LONGEST).then_some(text)
}

/// Sends a line and gives its answer.
fn answer(machine: &mut Interpreter, line: &[u8]) -> (String, Option<Message>) {
    let Some(text) = assembled(line) else {
        return (LineError::LineOverflow.to_string(), None);
    };
    match machine.check(&text, &Settings::default()) {
        Ok(checked) => {
            let outcome = machine.commit(&checked);
            ("ok".to_owned(), outcome.message)
        }
        Err(error) => (error.to_string(), None),
    }
}

/// The modal state in Grbl's numbers, as the recordings have it.
fn modal_numbers(machine: &Interpreter) -> String {
    let modal = machine.modal();
    let motion = match modal.motion {
        Motion::Rapid => 0,
        Motion::Linear => 1,
        Motion::Arc(Rotation::Clockwise) => 2,
        Motion::Arc(Rotation::CounterClockwise) => 3,
        Motion::Cancelled => 80,
        Motion::Probe(Probe::Contact) => 140,
        Motion::Probe(Probe::TryContact) => 141,
        Motion::Probe(Probe::Release) => 142,
        Motion::Probe(Probe::TryRelease) => 143,
    };
    let plane = match modal.plane {
        Plane::Xy => 0,
        Plane::Zx => 1,
        Plane::Yz => 2,
    };
    let spindle = match modal.spindle {
        Spindle::Off => 0,
        Spindle::Clockwise => 16,
        Spindle::CounterClockwise => 32,
    };
    format!(
        "{motion}/{}/{}/{}/{plane}/{}/{}/0/{}/{spindle}",
        u8::from(modal.feed_mode == FeedMode::InverseTime),
        u8::from(modal.units == Units::Inches),
        u8::from(modal.distance == Distance::Incremental),
        u8::from(modal.tool_length == ToolLength::Dynamic),
        modal.coordinates.index(),
        u8::from(modal.coolant.flood) * 64,
    )
}

/// What Grbl showed after a line.
struct Expected {
    response: String,
    position: [f64; 3],
    feed: f64,
    speed: f64,
    tool: u8,
    modal: String,
}

fn is_close(ours: f64, theirs: f64) -> bool {
    (ours - theirs).abs() <= 0.002_f64.max(theirs.abs() * 1.0e-6)
}

/// What differs from Grbl, other than the tool number; empty where nothing does.
fn differences(machine: &Interpreter, response: &str, expected: &Expected) -> String {
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
struct Tally {
    rows: usize,
    deviations: BTreeMap<&'static str, usize>,
    unexplained: Vec<String>,
}

impl Tally {
    fn deviation(&mut self, name: &'static str) {
        *self.deviations.entry(name).or_default() += 1;
    }

    fn finish(self, what: &str) {
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

const TOOL_STAYS: &str = "D13: T stays until the next T word";
const NO_PROBE: &str = "G38 is refused with error 20 until the machine can probe";

/// The lines of a program, without the end of the last line.
fn program_lines(folder: &Path, category: &str, name: &str) -> Vec<Vec<u8>> {
    let programs = fs::read_dir(folder.join("programs").join(category)).unwrap();
    let path = programs
        .map(|entry| entry.unwrap().path())
        .find(|path| path.file_stem().unwrap().to_str().unwrap() == name)
        .unwrap_or_else(|| panic!("no program {category}/{name}"));
    let text = fs::read(path).unwrap();
    let mut lines: Vec<_> = text
        .split(|&byte| byte == b'\n')
        .map(<[u8]>::to_vec)
        .collect();
    if lines.last().is_some_and(Vec::is_empty) {
        lines.pop();
    }
    lines
}

fn row(text: &str) -> Expected {
    let fields: Vec<&str> = text.splitn(10, ',').collect();
    let number = |index: usize| fields[index].parse::<f64>().unwrap();
    Expected {
        response: fields[1].to_owned(),
        position: [number(2), number(3), number(4)],
        feed: number(5),
        speed: number(6),
        tool: number(7) as u8,
        modal: fields[8].to_owned(),
    }
}

/// Replays one program and compares it row by row.
fn replay(name: &str, lines: &[Vec<u8>], recording: &str, tally: &mut Tally) {
    let rows: Vec<&str> = recording.lines().skip(1).collect();
    assert_eq!(rows.len(), lines.len(), "{name}");
    let mut machine = Interpreter::new();
    let mut after_probe = false;
    for (number, (line, text)) in lines.iter().zip(rows).enumerate() {
        if line.trim_ascii_start().starts_with(b"$") {
            // Not G-code: for the protocol.
            continue;
        }
        let expected = row(text);
        let (response, message) = answer(&mut machine, line);
        tally.rows += 1;
        assert_eq!(
            message == Some(Message::ProgramEnd),
            text.contains("[MSG:Pgm End]"),
            "{name}:{}",
            number + 1
        );
        if machine.modal().tool != expected.tool && expected.tool == 0 {
            tally.deviation(TOOL_STAYS);
        }
        let differences = differences(&machine, &response, &expected);
        let is_probe = expected.modal.starts_with("14");
        after_probe |= is_probe;
        if differences.is_empty() {
            after_probe &= is_probe;
        } else if after_probe {
            tally.deviation(NO_PROBE);
            machine.set_position(Axes::from_fn(|axis| {
                Nm::from_mm_f64(*expected.position.get(axis).unwrap_or(&0.0))
            }));
        } else {
            let line = String::from_utf8_lossy(line);
            let place = format!("{name}:{} `{line}`:{differences}", number + 1);
            tally.unexplained.push(place);
        }
    }
}

#[test]
fn every_line_of_the_recorded_programs_is_answered_as_grbl_does() {
    let Some(folder) = conformance() else { return };
    let mut tally = Tally::default();
    let mut recordings = Vec::new();
    for category in fs::read_dir(folder.join("golden")).unwrap() {
        for entry in fs::read_dir(category.unwrap().path()).unwrap() {
            recordings.push(entry.unwrap().path());
        }
    }
    recordings.sort();
    for path in recordings {
        let file = path.file_name().unwrap().to_str().unwrap();
        let Some(name) = file.strip_suffix(".check.csv") else {
            continue;
        };
        let category = path.parent().unwrap().file_name().unwrap();
        let category = category.to_str().unwrap();
        let lines = program_lines(&folder, category, name);
        let recording = fs::read_to_string(&path).unwrap();
        replay(
            &format!("{category}/{name}"),
            &lines,
            &recording,
            &mut tally,
        );
    }
    tally.finish("programs");
}

const LONGER_LINES: &str = "D5: lines of up to 255 characters";
const NO_OVERFLOW: &str = "D6: a target beyond what an axis can count is error 33";
const RUNNING: &str = "recorded while the arc was still being executed";

/// The answer to `$G`.
fn modes(machine: &Interpreter) -> String {
    let modal = machine.modal();
    let plane = match modal.plane {
        Plane::Xy => "G17",
        Plane::Zx => "G18",
        Plane::Yz => "G19",
    };
    let spindle = match modal.spindle {
        Spindle::Off => "M5",
        Spindle::Clockwise => "M3",
        Spindle::CounterClockwise => "M4",
    };
    format!(
        "[GC:{} {} {plane} {} {} {} {spindle} {} T{} F{:.0} S{:.0}]",
        modal.motion.word(),
        modal.coordinates.word(),
        modal.units.word(),
        modal.distance.word(),
        modal.feed_mode.word(),
        if modal.coolant.flood { "M8" } else { "M9" },
        modal.tool,
        modal.feed,
        modal.speed_rpm,
    )
}

/// The answer to `$#`, but for the probe.
fn parameters(machine: &Interpreter) -> Vec<String> {
    let offsets = machine.offsets();
    let mut named: Vec<(&str, Axes<Nm>)> = WorkCoordinates::ALL
        .iter()
        .map(|&system| (system.word(), offsets.origin(system)))
        .collect();
    named.extend([("G28", offsets.g28), ("G30", offsets.g30)]);
    named.push(("G92", offsets.work));
    let mut lines: Vec<String> = named
        .iter()
        .map(|(name, position)| {
            let [x, y, z] = [0, 1, 2].map(|axis| position[axis].to_mm_f64() + 0.0);
            format!("[{name}:{x:.3},{y:.3},{z:.3}]")
        })
        .collect();
    lines.push(format!("[TLO:{:.3}]", offsets.tool_length.to_mm_f64()));
    lines
}

/// Sends one step of a case: our answer and what is to be compared of the recorded one. `None`
/// where it is not the interpreter's.
fn step_answer(
    machine: &mut Interpreter,
    line: &str,
    recorded: &[&str],
) -> Option<(String, String)> {
    match line {
        "$G" => Some((modes(machine), recorded[0].to_owned())),
        "$#" if recorded.len() > 10 => {
            Some((parameters(machine).concat(), recorded[..10].concat()))
        }
        _ if line.starts_with(['$', '?']) => None,
        _ => {
            let ours = answer(machine, line.as_bytes()).0;
            Some((ours, (*recorded.last().unwrap_or(&"nothing")).to_owned()))
        }
    }
}

/// Runs one case and says what differs.
fn run_case(case: &Value, tally: &mut Tally) {
    let mut machine = Interpreter::new();
    let id = case["id"].as_str().unwrap();
    let mut lines = String::new();
    let mut responses = (String::new(), String::new());
    for part in ["setup_result", "result"] {
        for step in case[part].as_array().unwrap() {
            let Some(line) = step["line"].as_str() else {
                continue;
            };
            let recorded = step["recv"].as_array().unwrap();
            let recorded: Vec<&str> = recorded.iter().map(|text| text.as_str().unwrap()).collect();
            let Some((ours, theirs)) = step_answer(&mut machine, line, &recorded) else {
                continue;
            };
            tally.rows += 1;
            let _ = write!(lines, " `{line}`");
            responses.0 += &ours;
            responses.1 += &theirs;
        }
    }
    let end = &case["final"];
    let number = |value: &Value| value.as_f64().unwrap();
    let modal = end["modal"].as_array().unwrap();
    let modal: Vec<String> = modal.iter().map(Value::to_string).collect();
    let expected = Expected {
        response: responses.1,
        position: [0, 1, 2].map(|axis| number(&end["parser_pos_mm"][axis])),
        feed: number(&end["F"]),
        speed: number(&end["S"]),
        tool: number(&end["T"]) as u8,
        modal: modal.join("/"),
    };
    let differences = differences(&machine, &responses.0, &expected);
    if machine.modal().tool != expected.tool {
        tally.deviation(TOOL_STAYS);
    }
    if differences.is_empty() {
        return;
    }
    match id {
        _ if expected.modal.starts_with("14") => tally.deviation(NO_PROBE),
        "e0540" | "e0546" => tally.deviation(LONGER_LINES),
        "e0544" if responses.0 == "error:2ok" => tally.deviation(LONGER_LINES),
        "e0028" if responses.0 == "error:33" => tally.deviation(NO_OVERFLOW),
        "e0350" if responses.0 == "okok" => tally.deviation(RUNNING),
        _ => tally.unexplained.push(format!("{id}{lines}:{differences}")),
    }
}

#[test]
fn every_recorded_error_case_is_answered_as_grbl_does() {
    let Some(folder) = conformance() else { return };
    let text = fs::read_to_string(folder.join("suites/grbl_error_cases.json")).unwrap();
    let cases: Value = serde_json::from_str(&text).unwrap();
    let mut tally = Tally::default();
    for case in cases.as_array().unwrap() {
        // Settings, jogging and locks are not the interpreter's.
        let category = case["category"].as_str().unwrap();
        if !matches!(category, "settings" | "jog" | "lock") {
            run_case(case, &mut tally);
        }
    }
    tally.finish("error cases");
}
