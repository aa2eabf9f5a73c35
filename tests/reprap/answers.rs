//! What hosts ask for, and refusals in their words.

use crate::machine::{STEPS_PER_MM, numbered, reprap, xy};

#[test]
fn a_host_is_greeted_once() {
    let mut machine = reprap();
    machine.send_for(b"\x18", 50);
    let version = env!("CARGO_PKG_VERSION");
    let name = format!("echo:Leadscrew {version} (RepRap); homing off");
    assert_eq!(machine.lines(), ["start", name.as_str()]);
}

#[test]
fn a_host_learns_temperature_position_and_firmware() {
    let mut machine = reprap();
    assert_eq!(machine.ask("M105"), ["ok T:0.0 /0.0"]);
    machine.ask("G1 X1 Y2 Z-3 F6000");
    let steps = |mm: i32| mm * STEPS_PER_MM;
    let position = format!(
        "X:1.000 Y:2.000 Z:-3.000 E:0.000 Count X:{} Y:{} Z:{}",
        steps(1),
        steps(2),
        steps(-3)
    );
    assert_eq!(machine.ask("M114"), [position.as_str(), "ok"]);
    assert_eq!(machine.ask("M114 R"), [position.as_str(), "ok"]);
    let firmware = machine.ask("M115");
    assert!(firmware[0].starts_with("FIRMWARE_NAME:Leadscrew "));
    // No empty address: the package may have none.
    let address = env!("CARGO_PKG_REPOSITORY");
    let has_address = firmware[0].contains(&format!(" SOURCE_CODE_URL:{address} "));
    assert_eq!(has_address, !address.is_empty());
    assert!(firmware[0].ends_with(" PROTOCOL_VERSION:1.0 MACHINE_TYPE:simulator EXTRUDER_COUNT:0"));
    assert_eq!(firmware.last().map(String::as_str), Some("ok"));
    for capability in ["EMERGENCY_PARSER:1", "BUSY_PROTOCOL:1", "SDCARD:0"] {
        assert!(
            firmware.contains(&format!("Cap:{capability}")),
            "{capability}"
        );
    }
    for other in ["repetier", "klipper", "teacup", "malyan"] {
        assert!(!firmware[0].to_lowercase().contains(other));
    }
}

#[test]
fn m114_tells_of_the_last_line_while_the_machine_still_moves() {
    let mut machine = reprap();
    machine.send_for(b"G1 X10 F600\nM114\nM400\n", 20);
    let answers = machine.lines();
    assert_eq!(answers.len(), 3, "{answers:?}");
    assert!(answers[1].starts_with("X:10.000 Y:0.000 Z:0.000 E:0.000 Count X:0 "));
    machine.run_to_standstill();
    // M400 ends with the motion.
    assert_eq!(machine.lines(), ["ok"]);
    assert_eq!(xy(&machine), [10 * STEPS_PER_MM, 0]);
}

#[test]
fn parts_that_are_not_there_are_reported_and_nobody_waits_for_them() {
    let mut machine = reprap();
    for (line, answer) in [
        ("M109 S200", Some("echo:M109: not present")),
        ("M104 S0", None),
        ("M140", None),
        ("M80", Some("echo:M80: not present")),
        ("T0", None),
        ("T1", Some("echo:T1 Invalid extruder")),
        ("M117 Done! (really", None),
        ("M118 E1 Hello", Some("echo:Hello")),
        ("M118 A1 action", Some("//action")),
        ("M118 Layer 3", Some("Layer 3")),
        // No host takes these for an answer of its own.
        ("M118 ok", Some("echo:ok")),
        ("M118 Resend: 3", Some("echo:Resend: 3")),
        ("M118 Start", Some("echo:Start")),
        ("M10000", Some("echo:Unknown command: \"M10000\"")),
        (
            "$780=9",
            Some("echo:error 52: the setting is outside its range"),
        ),
    ] {
        let mut answers = machine.ask(line);
        assert_eq!(answers.pop().as_deref(), Some("ok"), "{line}");
        assert_eq!(answers.pop().as_deref(), answer, "{line}");
        assert!(answers.is_empty(), "{line}");
    }
}

#[test]
fn the_ok_waits_for_room() {
    let mut machine = reprap();
    machine.ask("$797=0");
    let mut line = 0;
    let mut answered = 0;
    while answered == line {
        line += 1;
        let x = if line % 2 == 0 { 0 } else { 50 };
        let words = numbered(line, &format!("G1 X{x} F600"));
        machine.send(words);
        machine.send(b"\n");
        answered += machine
            .lines()
            .into_iter()
            .map(|line| i32::from(line == "ok"))
            .sum::<i32>();
        assert!(line < 200, "the queue never fills");
    }
    assert!(line > 10, "{line}");
    machine.run(12_000);
    let answers = machine.lines();
    assert_eq!(answers.iter().filter(|line| *line == "ok").count(), 1);
    assert!(answers.iter().any(|line| line == "echo:busy: processing"));
}
