//! Whole programs: in check mode row by row, and executed to their end.

use std::{
    fs,
    path::{Path, PathBuf},
};

use leadscrew::{
    axis::AXES,
    interpreter::{Interpreter, Message},
};
use serde_json::Value;

use crate::{
    compare::{Expected, TOOL_STAYS, Tally, conformance, differences},
    machine::{answer, modes, parameters},
};

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
        if !differences.is_empty() {
            let line = String::from_utf8_lossy(line);
            let place = format!("{name}:{} `{line}`:{differences}", number + 1);
            tally.unexplained.push(place);
        }
    }
}

/// Category, name and path of every recording with a given ending, in order.
fn recordings(folder: &Path, ending: &str) -> Vec<(String, String, PathBuf)> {
    let mut recordings = Vec::new();
    for category in fs::read_dir(folder.join("golden")).unwrap() {
        let category = category.unwrap();
        for entry in fs::read_dir(category.path()).unwrap() {
            let entry = entry.unwrap();
            if let Some(name) = entry.file_name().to_str().unwrap().strip_suffix(ending) {
                let category = category.file_name().into_string().unwrap();
                recordings.push((category, name.to_owned(), entry.path()));
            }
        }
    }
    recordings.sort();
    recordings
}

#[test]
fn every_line_of_the_recorded_programs_is_answered_as_grbl_does() {
    let Some(folder) = conformance() else { return };
    let mut tally = Tally::default();
    for (category, name, path) in recordings(&folder, ".check.csv") {
        let lines = program_lines(&folder, &category, &name);
        let recording = fs::read_to_string(path).unwrap();
        replay(
            &format!("{category}/{name}"),
            &lines,
            &recording,
            &mut tally,
        );
    }
    tally.finish("programs in check mode");
}

/// Runs a program and compares answers, final modes, offsets and position with an executed run.
fn replay_run(name: &str, lines: &[Vec<u8>], run: &Value, tally: &mut Tally) {
    let mut machine = Interpreter::new();
    let recorded = run["responses"].as_array().unwrap();
    let mut recorded = recorded.iter().flat_map(|group| {
        let count = group[1].as_u64().unwrap() as usize;
        std::iter::repeat_n(group[0].as_str().unwrap(), count)
    });
    for line in lines {
        let theirs = recorded.next().unwrap();
        let ours = if line.trim_ascii_start().starts_with(b"$") {
            theirs.to_owned()
        } else {
            answer(&mut machine, line).0
        };
        tally.rows += 1;
        if ours != theirs {
            let line = String::from_utf8_lossy(line);
            let place = format!("{name} `{line}`: {ours}, not {theirs}");
            tally.unexplained.push(place);
        }
    }
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let modes = modes(&machine);
    if run["final_GC"][0] != modes.as_str() {
        tally
            .unexplained
            .push(format!("{name}: {modes}, not {}", run["final_GC"][0]));
    }
    let theirs: Vec<String> = run["final_params"].as_array().unwrap()[..10]
        .iter()
        .map(text)
        .collect();
    if theirs != parameters(&machine) {
        tally.unexplained.push(format!("{name}: not {theirs:?}"));
    }
    for axis in 0..AXES {
        let ours = machine.position()[axis].to_mm_f64();
        let theirs = run["final_mpos_mm"][axis].as_f64().unwrap();
        // Half a step, and what a report rounds away.
        if (ours - theirs).abs() > 0.5 / 80.0 + 0.001 {
            tally
                .unexplained
                .push(format!("{name}: axis {axis} at {ours}, not {theirs}"));
        }
    }
}

#[test]
fn executed_programs_end_as_grbl_ended_them() {
    let Some(folder) = conformance() else { return };
    let mut tally = Tally::default();
    for (category, name, path) in recordings(&folder, ".grbl.json") {
        if category == "probing" {
            continue;
        }
        let lines = program_lines(&folder, &category, &name);
        let recording: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
        for (settings, run) in recording["runs"].as_object().unwrap() {
            if run["complete"] == true {
                replay_run(
                    &format!("{category}/{name}/{settings}"),
                    &lines,
                    run,
                    &mut tally,
                );
            }
        }
    }
    tally.finish("executed programs");
}
