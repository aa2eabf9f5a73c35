//! A machine that is not homed: lines before `G28` in files, and lines that wait for homing.

use leadscrew::model::State;

use crate::machine::{STEPS_PER_MM, machine_with, reprap, reprap_with, xy};

/// Not homed; it homes where it stands, at the upper end of 100 mm.
const FRAME: [&str; 5] = ["22=1", "788=7", "130=100", "131=100", "132=100"];

const LOCKED_MESSAGE: &str =
    "Error:Printer stopped due to errors. G28 homes the machine; M999 to go on";

/// How files begin, up to the first move.
const STARTS: [(&str, &[&str]); 7] = [
    (
        "Cura, its generic printer",
        &[
            "M140 S60",
            "M105",
            "M190 S60",
            "M104 S200",
            "M105",
            "M109 S200",
            "M82",
            "G21",
            "G90",
            "M82",
            "M107",
            "G28 X0 Y0",
            "G28 Z0",
            "G1 Z15.0 F9000",
            "G92 E0",
            "G1 F200 E3",
            "G92 E0",
            "G1 F9000",
            "M117 Printing...",
        ],
    ),
    (
        "Cura, an Ender 3",
        &[
            "M82",
            "M201 X500.00 Y500.00 Z100.00 E5000.00",
            "M203 X500.00 Y500.00 Z10.00 E50.00",
            "M204 P500.00 R1000.00 T500.00",
            "M205 X8.00 Y8.00 Z0.40 E5.00",
            "M220 S100",
            "M221 S100",
            "G28",
            "G92 E0",
            "G1 Z2.0 F3000",
        ],
    ),
    (
        "PrusaSlicer with limits",
        &[
            "M201 X9000 Y9000 Z500 E10000",
            "M203 X500 Y500 Z12 E120",
            "M204 P2000 R1500 T2000",
            "M205 X10.00 Y10.00 Z0.20 E2.50",
            "M205 S0 T0",
            "M107",
            "M115 U3.13.2",
            "G90",
            "M83",
            "M104 S215",
            "M140 S60",
            "M190 S60",
            "M109 S215",
            "G28 W",
            "G80",
            "G1 Z0.2 F720",
            "G1 Y-3 F1000",
            "G92 E0",
            "M221 S95",
        ],
    ),
    (
        "Simplify3D",
        &[
            "G90",
            "M82",
            "M106 S0",
            "M140 S60",
            "M190 S60",
            "M104 S200 T0",
            "M109 S200 T0",
            "G28",
            "G92 E0",
            "G1 E-1.0000 F1800",
        ],
    ),
    (
        "Slic3r, no code before the head moves",
        &["M107", "M190 S60", "M104 S200", "G28", "G1 Z5 F5000"],
    ),
    (
        "a plotter",
        &[
            "G21",
            "G90",
            "G0 F3000",
            "M18",
            "M17",
            "G4 P100",
            "M400",
            "G92",
            "G28",
            "G1 X50 Y50",
        ],
    ),
    (
        "a laser",
        &[
            "G00 G17 G40 G21 G54",
            "G90",
            "M5",
            "M9",
            "G1 F1200",
            "G28",
            "G0 X10 Y10",
        ],
    ),
];

#[test]
fn files_run_from_their_first_line_though_nothing_is_homed() {
    for (name, lines) in STARTS {
        let mut machine = reprap_with(&FRAME);
        assert_eq!(machine.state(), State::Alarm, "{name}");
        for line in lines {
            let mut answer = machine.ask(line);
            let last = answer.pop().unwrap_or_default();
            assert!(last.starts_with("ok"), "{name}, {line}: {answer:?}");
            for message in answer {
                let is_harmless = message.starts_with("echo:") && !message.contains("Unknown")
                    || message.starts_with("FIRMWARE_NAME")
                    || message.starts_with("Cap:");
                assert!(is_harmless, "{name}, {line}: {message}");
            }
        }
        assert_eq!(machine.state(), State::Idle, "{name}");
    }
}

#[test]
fn what_moves_or_switches_on_waits_for_g28() {
    let mut machine = reprap_with(&[&FRAME[..], &["783=2"]].concat());
    for line in [
        "G1 X1",
        "G0 Y-1",
        "X1",
        "G2 X2 Y0 I1 J0 F100",
        "G28.1 X0",
        "G38.2 Z-1 F100",
        "G53 G0 X1",
        "G30.1",
        "G81 X1 Z-1 R1 F100",
        "M3 S100",
        "M4 S1",
        "M8",
        "M106 S1",
        "M0",
        "M6 T1",
    ] {
        let answer = machine.ask(line);
        let is_refused = answer == [LOCKED_MESSAGE, "ok"];
        let is_no_motion = line.ends_with('1') && line.starts_with("G30") || line == "G28.1 X0";
        assert!(is_refused || is_no_motion, "{line}: {answer:?}");
    }
    assert_eq!(machine.state(), State::Alarm);
    assert_eq!(xy(&machine), [0, 0]);
    assert!(!machine.outputs().coolant.flood);
    // The modes of the lines before count behind it.
    assert_eq!(machine.ask("G91"), ["ok"]);
    assert_eq!(machine.ask("G20"), ["ok"]);
    assert_eq!(machine.ask("G1 F100"), ["ok"]);
    assert_eq!(machine.ask("G28"), ["ok"]);
    assert_eq!(machine.ask("G1 X-1"), ["ok"]);
    let inch = (25.4 * f64::from(STEPS_PER_MM)).round() as i32;
    assert_eq!(xy(&machine), [-inch, 0]);
}

#[test]
fn after_another_alarm_only_m999_goes_on() {
    let mut machine = reprap_with(&FRAME);
    machine.send_for(b"M112\n", 1000);
    machine.lines();
    let killed = "Error:Printer halted. kill() called!";
    for line in ["G21", "G90", "G1 F100", "G92 X0", "M5"] {
        assert_eq!(machine.ask(line), [killed, "ok"], "{line}");
    }
}

#[test]
fn a_restart_tells_what_ends_the_lock_where_there_is_one() {
    let mut machine = reprap_with(&FRAME);
    let version = env!("CARGO_PKG_VERSION");
    let name = format!("echo:Leadscrew {version} (RepRap); homing on");
    let locked = "echo:G28 homes the machine; M999 to go on";
    machine.send_for(b"\x18", 50);
    assert_eq!(machine.lines(), ["start", name.as_str(), locked]);
    assert_eq!(machine.ask("M999"), ["ok", "start", name.as_str()]);
    machine.run(50);
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(machine.ask("G1 X-1 F6000"), ["ok"]);
    // Nothing homes a machine without homing.
    let mut machine = reprap();
    machine.send_for(b"G1 X50 F600\n", 500);
    machine.lines();
    machine.send_for(b"\x18", 500);
    let lines = machine.lines();
    assert_eq!(lines[2..], ["echo:M999 to go on"], "{lines:?}");
    let locked = "Error:Printer stopped due to errors. M999 to go on";
    assert_eq!(machine.ask("G1 X1"), [locked, "ok"]);
}

#[test]
fn grbls_dialect_refuses_every_line_before_homing() {
    let all: Vec<&str> = ["780=0"].iter().chain(&FRAME).copied().collect();
    let mut machine = machine_with(&all);
    for line in ["G21", "G90", "G1 F100"] {
        assert_eq!(machine.ask(line), ["error:9"], "{line}");
    }
}

#[test]
fn the_next_report_tells_the_work_offset_of_homing() {
    let mut machine = reprap_with(&FRAME);
    for turn in 0..5 {
        let report = machine.report();
        assert_eq!(report.field("WCO").is_some(), turn == 0, "{report:?}");
    }
    machine.ask("G28");
    let report = machine.report();
    let offset = report.field("WCO").expect("it is told");
    assert!(offset.starts_with("-100.000,-100.000,-100.000"), "{offset}");
}
