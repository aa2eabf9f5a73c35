//! The comparison itself: recordings of our own machine, changed by hand.

use serde_json::{Value, json};

use super::*;
use crate::deviation::Deviation;
use simulation::session;

/// A session with what is received in it.
fn recorded(json: &str) -> Value {
    session::recorded(json).unwrap()
}

/// A move with two reports during the motion and one after the end, with times.
fn moved() -> Value {
    recorded(
        r#"{"id": "moved", "settings_set": "fast", "transcript": [{"boot": true},
            {"line": "G1 X20 F1000", "t": 0.0, "nowait": 1, "after": 0.2},
            {"rt": "3f", "t": 0.2}, {"rt": "3f", "t": 0.22}, {"idle": 5, "t": 0.24},
            {"rt": "3f", "t": 1.4}, {"line": "M3 S500", "t": 1.5}, {"line": "G33", "t": 1.6},
            {"wait": 0.2, "t": 1.7}]}"#,
    )
}

/// Lines without times.
fn lines(lines: &[&str]) -> Value {
    let steps: Vec<_> = lines.iter().map(|line| json!({"line": line})).collect();
    let session = json!({"id": "lines", "settings_set": "fast", "result": steps});
    recorded(&session.to_string())
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
    assert_eq!(differences(&lines(&["G1X1F100", "G33", "$G", "?"])), []);
}

#[test]
fn another_answer_is_found() {
    assert_eq!(
        found(&changed(&moved(), "error:20", "error:21")),
        [("line", None)]
    );
    let recording = lines(&["G33", "G0X1"]);
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
    let without_rate = |line: &str| {
        let mut recording = lines(&[line, "$G"]);
        let received = recording["result"][0]["recv"].as_array_mut().unwrap();
        received.retain(|text| !text.as_str().unwrap().contains("Step rate"));
        recording
    };
    let info = found(&without_rate("$I"));
    assert_eq!(info, [("line", Some(Deviation::BuildInfo))]);
    assert_eq!(found(&without_rate("$N")), []);
    let refused = changed(&lines(&["$110=0"]), "error:52", "ok");
    assert_eq!(found(&refused), [("line", Some(Deviation::SettingRanges))]);
}

/// A hold that takes effect so much later in the recording.
fn held_later(steps: i64) -> Value {
    let mut recording = recorded(
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
    let mut off_path = held_later(160);
    off_path["final"]["mpos_steps"][1] = json!(40);
    assert!(!is_excused(&off_path), "{:?}", differences(&off_path));
}

#[test]
fn a_line_after_another_speed_may_be_answered_sooner() {
    let answered = |speed: &str| {
        let mut recording = recorded(&format!(
            r#"{{"id": "speed", "settings_set": "fast", "transcript": [{{"boot": true}},
            {{"line": "M3 S1000", "t": 0.0}}, {{"line": "G1 X5 F1000", "t": 0.1}},
            {{"line": "{speed}", "t": 0.2}}, {{"idle": 9, "t": 0.3}}]}}"#
        ));
        let time_s = &mut recording["transcript"][3]["recv_t"][0];
        *time_s = json!(time_s.as_f64().unwrap() + 0.2);
        found(&recording)
    };
    assert_eq!(answered("S500"), [("time", Some(Deviation::SpeedInMotion))]);
    assert_eq!(answered("M5")[0], ("time", None));
}

#[test]
fn motion_may_wait_for_a_spindle_that_was_stopped_in_a_hold() {
    let recording = recorded(
        r#"{"id": "stopped", "settings_set": "fast", "transcript": [{"boot": true},
            {"line": "M3 S1000", "t": 0.0},
            {"line": "G1 X50 F1000", "t": 0.1, "nowait": 1, "after": 0.3},
            {"rt": "21", "t": 0.4, "after": 0.3}, {"rt": "9e", "t": 0.7, "after": 0.1},
            {"rt": "3f", "t": 0.8}, {"rt": "7e", "t": 0.9, "after": 0.3}, {"rt": "3f", "t": 1.2},
            {"idle": 9, "t": 1.3}]}"#,
    );
    let late = Some(Deviation::SpindleTime);
    let run = |by: &str| changed(&recording, "Run|MPos:", by);
    assert_eq!(found(&run("Run|MPos:1")), [("report", late)]);
    assert_eq!(found(&run("Jog|MPos:")), [("report", None)]);
    let held = changed(&recording, "Hold:0|MPos:", "Hold:0|MPos:1");
    assert_eq!(found(&held)[0], ("report", None));
}

#[test]
fn an_offset_set_after_a_probe_is_where_the_axes_stand() {
    let recording = recorded(
        r#"{"id": "probed", "settings_set": "fast", "switches": [[2, -1, -400, "PROBE"]],
            "transcript": [{"boot": true}, {"line": "G38.2 Z-10 F600", "t": 0.0},
            {"line": "G92 Z0", "t": 1.0}, {"rt": "3f", "t": 1.1}, {"line": "$#", "t": 1.2}]}"#,
    );
    let elsewhere = |steps: i64| {
        let at = recording["final"]["mpos_steps"][2].as_i64().unwrap();
        let mm = |steps: i64| format!("0.000,{:.3}", steps as f64 / 80.0);
        let text = recording.to_string().replace(&mm(at), &mm(at + steps));
        let mut other: Value = serde_json::from_str(&text).unwrap();
        other["final"]["mpos_steps"][2] = json!(at + steps);
        other["final"]["parser_pos_mm"][2] = json!((at + steps) as f64 / 80.0);
        found(&other)
    };
    assert!(elsewhere(-30).len() >= 5);
    for (what, by) in elsewhere(-30) {
        assert_eq!(by, Some(Deviation::ShortStops), "{what}");
    }
    assert!(elsewhere(-300).contains(&("line", None)));
    assert!(elsewhere(-300).contains(&("report", None)));
}

#[test]
fn where_homing_has_failed_grbl_counts_otherwise() {
    let recording = recorded(
        r#"{"id": "lost", "settings_set": "fast", "extra_settings": ["$22=1", "$25=2000"],
            "transcript": [{"boot": true}, {"line": "$H", "t": 0.0, "nowait": 1, "after": 0.3},
            {"pin": ["ZLIM", 0], "t": 0.3, "after": 2.0}, {"rt": "3f", "t": 3.0}]}"#,
    );
    assert!(recording.to_string().contains("ALARM:8"));
    let at = recording["final"]["mpos_steps"][2].as_i64().unwrap();
    let shown = format!("0.000,{:.3}", at as f64 / 80.0);
    let mut other = changed(&recording, &shown, "0.000,-1.000");
    other["final"]["mpos_steps"][2] = json!(-80);
    other["final"]["parser_pos_mm"][2] = json!(-1.0);
    let expected = Some(Deviation::HomingMotion);
    assert_eq!(
        found(&other),
        [("end", expected), ("end", expected), ("report", expected)]
    );
}

#[test]
fn a_full_look_ahead_withholds_answers_and_nothing_less_does() {
    let late = |moves: usize| {
        let mut steps = vec![json!({"boot": true})];
        for number in 0..moves {
            let line = format!("G1 X{number} F600");
            let time_s = number as f64 * 0.01;
            steps.push(json!({"line": line, "t": time_s, "nowait": 1, "after": 0.0}));
        }
        steps.push(json!({"idle": 9, "t": 0.5}));
        let session = json!({"id": "full", "settings_set": "fast", "transcript": steps});
        let mut recording = recorded(&session.to_string());
        let steps = recording["transcript"].as_array_mut().unwrap();
        let mut times = steps.iter_mut().filter_map(|step| step.get_mut("recv_t"));
        *times
            .next_back()
            .unwrap()
            .as_array_mut()
            .unwrap()
            .last_mut()
            .unwrap() = json!(0.7);
        found(&recording)
    };
    assert_eq!(late(18), [("time", Some(Deviation::Buffers))]);
    assert_eq!(late(5), [("time", None)]);
}

#[test]
fn what_follows_another_state_is_excused_from_there_on() {
    let homed = recorded(
        r#"{"id": "homed", "settings_set": "fast", "extra_settings": ["$22=1", "$25=2000"],
            "switches": [[0, 1, 800, "XLIM"]],
            "transcript": [{"boot": true}, {"rt": "3f", "t": 0.0}, {"line": "$HX", "t": 0.1},
            {"rt": "3f", "t": 5.0}]}"#,
    );
    let mut other = homed.clone();
    other["transcript"][2]["recv"] = json!(["error:3"]);
    other["transcript"][2]["recv_t"] = json!([0.11]);
    let home = "<Home|MPos:0.000,0.000,0.000|FS:0,0|Ov:100,100,100>";
    other["transcript"][3]["recv"] = json!([home]);
    let causes: Vec<_> = found(&other).into_iter().map(|(_, by)| by).collect();
    assert_eq!(causes[0], Some(Deviation::SingleAxisHoming));
    assert!(causes.iter().all(Option::is_some), "{causes:?}");
    other["transcript"][1]["recv"] = json!([home]);
    assert!(found(&other).contains(&("report", None)));
}
