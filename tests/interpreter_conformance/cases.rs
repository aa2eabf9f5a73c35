//! Single lines: Grbl's errors one by one.

use std::{fmt::Write as _, fs};

use leadscrew::interpreter::Interpreter;
use serde_json::Value;

use crate::{
    compare::{Expected, TOOL_STAYS, Tally, conformance, differences},
    machine::{answer, modes, parameters},
};

const LONGER_LINES: &str = "D5: lines of up to 255 characters";
const NO_OVERFLOW: &str = "D6: a target beyond what an axis can count is error 33";
const NO_MACHINE: &str = "the move was not begun: the probe was in the wrong state";
const RUNNING: &str = "recorded while the arc was still being executed";

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
        "e0540" | "e0546" => tally.deviation(LONGER_LINES),
        "e0544" if responses.0 == "error:2ok" => tally.deviation(LONGER_LINES),
        "e0028" if responses.0 == "error:33" => tally.deviation(NO_OVERFLOW),
        "e0480" => tally.deviation(NO_MACHINE),
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
