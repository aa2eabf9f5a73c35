//! The comparison itself: recordings of our own machine, changed by hand.

use serde_json::{Value, json};

use super::*;
use crate::{conformance::deviation::Deviation, session};

/// A move, two reports in it and one after it, with times.
fn moved() -> Value {
    session::recorded(
        r#"{"id": "moved", "settings_set": "fast", "transcript": [{"boot": true},
            {"line": "G1 X20 F1000", "t": 0.0, "nowait": 1, "after": 0.2},
            {"rt": "3f", "t": 0.2}, {"rt": "3f", "t": 0.22}, {"idle": 5, "t": 0.24},
            {"rt": "3f", "t": 1.4}, {"line": "M3 S500", "t": 1.5}, {"line": "G99", "t": 1.6},
            {"wait": 0.2, "t": 1.7}]}"#,
    )
}

/// Lines without times.
fn lines(lines: &[&str]) -> Value {
    let steps: Vec<_> = lines.iter().map(|line| json!({"line": line})).collect();
    let session = json!({"id": "lines", "settings_set": "fast", "result": steps});
    session::recorded(&session.to_string())
}

fn differences(recording: &Value) -> Vec<Difference> {
    let exchange = Exchange::read("transcripts", recording).unwrap();
    exchange.replay().unwrap()
}

/// What is different, and by which deviation.
fn found(recording: &Value) -> Vec<(&'static str, Option<Deviation>)> {
    let differences = differences(recording);
    differences
        .iter()
        .map(|found| (found.what, found.by_design))
        .collect()
}

/// The recording with one text replaced by another.
fn changed(recording: &Value, from: &str, to: &str) -> Value {
    let text = recording.to_string();
    assert!(text.contains(from), "{text} has no {from}");
    serde_json::from_str(&text.replacen(from, to, 1)).unwrap()
}

#[test]
fn a_machine_agrees_with_itself() {
    assert_eq!(differences(&moved()), []);
    assert_eq!(differences(&lines(&["G1X1F100", "G99", "$G", "?"])), []);
}

#[test]
fn another_answer_is_found() {
    assert_eq!(
        found(&changed(&moved(), "error:20", "error:21")),
        [("line", None)]
    );
    let recording = lines(&["G99", "G0X1"]);
    let accepted = changed(&recording, "error:20", "ok");
    assert_eq!(found(&accepted), [("line", None)]);
}

#[test]
fn a_missing_and_a_surplus_line_are_found() {
    let mut recording = moved();
    recording["transcript"][7]["recv"] = json!([]);
    recording["transcript"][7]["recv_t"] = json!([]);
    assert_eq!(found(&recording), [("line", None)]);
    let recording = changed(&moved(), "\"ok\"", "\"[MSG:Check Door]\",\"ok\"");
    assert!(found(&recording).contains(&("line", None)));
}

#[test]
fn a_line_at_another_time_is_found() {
    let mut recording = moved();
    recording["transcript"][6]["recv_t"][0] = json!(1.58);
    assert_eq!(found(&recording), [("time", None)]);
    recording["transcript"][6]["recv_t"][0] = json!(1.53);
    assert_eq!(found(&recording), []);
}

#[test]
fn positions_at_rest_are_exact_and_in_motion_nearly() {
    let at_rest = changed(&moved(), "<Idle|MPos:20.000", "<Idle|MPos:20.013");
    assert_eq!(found(&at_rest), [("report", None)]);
    let text = moved()["transcript"][2]["recv"][0].to_string();
    let x: f64 = text.split(['"', ':', ',']).nth(2).unwrap().parse().unwrap();
    let moving = |by: f64| {
        changed(
            &moved(),
            &format!("MPos:{x:.3}"),
            &format!("MPos:{:.3}", x + by),
        )
    };
    // 1000 mm/min for 30 ms are 0.5 mm.
    assert_eq!(found(&moving(0.4)), []);
    assert_eq!(found(&moving(0.7)), [("report", None)]);
}

#[test]
fn another_speed_state_or_field_is_found() {
    let slower = changed(&moved(), "|FS:1000,0", "|FS:900,0");
    assert_eq!(found(&slower), [("report", None)]);
    let nearly = changed(&moved(), "|FS:1000,0", "|FS:995,0");
    assert_eq!(found(&nearly), []);
    let state = changed(&moved(), "<Run|", "<Jog|");
    assert_eq!(found(&state), [("report", None)]);
    let field = changed(&moved(), "|Ov:100,100,100", "|Ov:100,100,90");
    assert_eq!(found(&field), [("report", None)]);
    let pin = changed(&moved(), "|WCO:0", "|Pn:X|WCO:0");
    assert_eq!(found(&pin), [("report", None)]);
}

#[test]
fn another_end_is_found() {
    for (from, to) in [
        ("\"mpos_steps\":[1600,", "\"mpos_steps\":[1599,"),
        ("\"parser_pos_mm\":[20.0,", "\"parser_pos_mm\":[20.1,"),
        ("\"modal\":[1,", "\"modal\":[0,"),
        ("\"F\":1000.0", "\"F\":1001.0"),
        ("\"state\":0", "\"state\":1"),
    ] {
        assert_eq!(found(&changed(&moved(), from, to)), [("end", None)], "{to}");
    }
}

#[test]
fn another_output_is_found() {
    let mut recording = moved();
    let events = recording["aux_events"].as_array_mut().unwrap();
    for event in events.iter_mut() {
        if event[1] == "coolant_flood" {
            *event = json!([0.5, "coolant_flood", 1]);
        }
    }
    assert_eq!(found(&recording), [("output", None)]);
}

#[test]
fn another_greeting_is_found() {
    let mut other = moved();
    other["transcript"][0]["recv"][1] = json!("Grbl 1.1f");
    assert_eq!(found(&other), [("power-up", None)]);
}

#[test]
fn a_deviation_explains_only_its_own_kind() {
    let tool = changed(&lines(&["T3", "S100", "$G"]), " T3 ", " T0 ");
    assert_eq!(found(&tool)[0], ("line", Some(Deviation::ToolIsModal)));
    let tool = changed(&lines(&["T3", "S100", "$G"]), " T3 ", " T4 ");
    assert_eq!(found(&tool)[0], ("line", None));
    let refused = changed(&lines(&["$110=0"]), "error:52", "ok");
    assert_eq!(found(&refused), [("line", Some(Deviation::SettingRanges))]);
}

/// A hold that takes effect so much later in the recording.
fn held_later(steps: i64) -> Value {
    let mut recording = session::recorded(
        r#"{"id": "held", "settings_set": "fast", "transcript": [{"boot": true},
            {"line": "G1 X50 F3000", "t": 0.0, "nowait": 1, "after": 0.3},
            {"rt": "21", "t": 0.3, "after": 0.3}, {"rt": "3f", "t": 0.6}]}"#,
    );
    let at = recording["final"]["mpos_steps"][0].as_i64().unwrap();
    recording["final"]["mpos_steps"][0] = json!(at + steps);
    let mm = |steps: i64| format!("MPos:{:.3},", steps as f64 / 80.0);
    changed(&recording, &mm(at), &mm(at + steps))
}

#[test]
fn a_hold_may_act_sooner_but_not_anywhere() {
    let is_excused = |recording: &Value| {
        let found = found(recording);
        assert!(!found.is_empty());
        found
            .iter()
            .all(|(_, by)| *by == Some(Deviation::ShortStops))
    };
    // 50 mm/s for 40 ms.
    assert!(is_excused(&held_later(160)));
    assert!(!is_excused(&held_later(800)));
    // Beside the path.
    let mut beside = held_later(160);
    beside["final"]["mpos_steps"][1] = json!(40);
    assert!(!is_excused(&beside), "{:?}", differences(&beside));
}
