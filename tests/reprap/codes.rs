//! Codes with another meaning than in Grbl, and codes that Grbl does not have.

use leadscrew::model::{PathControl, State};

use crate::{
    machine::{STEPS_PER_MM, first, reprap, reprap_with, seconds, send_numbered, xy, xy_mm},
    support::{Machine, statistics},
};

#[test]
fn g0_goes_at_f() {
    let mut machine = reprap();
    // 1500 mm/min where nothing is set.
    let default = seconds(&mut machine, "G0 X50");
    assert!((2.0..2.3).contains(&default), "{default}");
    let slow = seconds(&mut machine, "G0 X0 F600");
    assert!((5.0..5.3).contains(&slow), "{slow}");
}

#[test]
fn speed_rises_to_the_new_f() {
    let mut machine = reprap();
    machine.ask("G1 F600");
    let fast = seconds(&mut machine, "G1 X50 F6000");
    assert!((0.6..0.9).contains(&fast), "{fast}");
}

#[test]
fn a_code_alone_does_nothing() {
    let mut machine = reprap();
    for line in [
        "G0", "G1", "G0 F1500", "G1 F1500", "G2", "G90", "M82", "M400", "G4", "G4 P0",
    ] {
        if line != "G2" {
            assert_eq!(machine.ask(line), ["ok"], "{line}");
        }
    }
    assert_eq!(xy_mm(&machine), [0, 0]);
}

#[test]
fn g4_p2000_is_g4_s2() {
    let mut machine = reprap();
    for line in ["G4 P2000", "G4 S2", "G4 S2 P9000", "g4 s2.0"] {
        let waited = seconds(&mut machine, line);
        assert!((1.99..2.02).contains(&waited), "{line}: {waited}");
    }
    assert!(seconds(&mut machine, "G4 P0") < 0.01);
}

#[test]
fn flags_and_numbers() {
    let mut machine = reprap();
    for (line, answer) in [
        (
            "G1 X",
            "Error:a letter must be followed by a number (error:2)",
        ),
        (
            "G1 X1.2.3",
            "Error:a word must begin with a letter (error:1)",
        ),
        (
            "G1 X\"1\"",
            "Error:a letter must be followed by a number (error:2)",
        ),
        (
            "M587 S\"net;(*",
            "Error:a letter must be followed by a number (error:2)",
        ),
        (
            "M221 S",
            "Error:a letter must be followed by a number (error:2)",
        ),
        ("G1 X1 !", "Error:a word must begin with a letter (error:1)"),
        ("M106 S256", ""),
        ("G29", "echo:Unknown command: \"G29\""),
        ("G30 X1", "echo:Unknown command: \"G30 X1\""),
        ("G6 A1", "echo:Unknown command: \"G6 A1\""),
        ("G150", "echo:Unknown command: \"G150\""),
        ("M42 P1 S1", "echo:Unknown command: \"M42 P1 S1\""),
        ("Mx", "echo:Unknown command: \"Mx\""),
    ] {
        if line == "M106 S256" {
            let error = first(&mut machine, line);
            assert_eq!(error, "Error:the value is outside its range (error:39)");
        } else {
            assert_eq!(first(&mut machine, line), answer, "{line}");
        }
    }
    assert_eq!(xy_mm(&machine), [0, 0]);
}

#[test]
fn a_code_that_stands_alone_drops_no_other() {
    let mut machine = reprap();
    let refused = "Error:two commands of one modal group (error:21)";
    for line in [
        "M105 G1 X5",
        "G1 X5M105",
        "G1 X5 M117 hello",
        "G28 G1 X5",
        "G28 G40",
        "G91 G28 Z0",
        "G92 G28",
        "G90 G92 X5",
        "G4 P10 G1 X5",
        "M400 M105",
        "M3 M105",
        "G1 X5 M0",
    ] {
        assert_eq!(machine.ask(line), [refused, "ok"], "{line}");
    }
    assert_eq!(xy_mm(&machine), [0, 0]);
    assert!(first(&mut machine, "M114").starts_with("X:0.000 Y:0.000 Z:0.000 "));
    // These change modes, or are text.
    for line in ["G21 G90 G17 G1 X5", "G91 G1 X1 M3 S5", "M117 G1 X9 M105"] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    assert_eq!(xy_mm(&machine), [6, 0]);
}

#[test]
fn f0_leaves_the_feed_as_it_is() {
    let mut machine = reprap();
    for line in ["G1 F0", "G1 X1 F0", "F0.0 X2", "G0 F1200", "G1 X5 F0"] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    let brisk = seconds(&mut machine, "G1 X25");
    assert!((1.0..1.2).contains(&brisk), "{brisk}");
}

#[test]
fn marks_of_programs_mean_nothing() {
    let mut machine = reprap();
    for line in ["%", "O1234", ":1234", " % "] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    send_numbered(&mut machine, 1, &["%", "G1 X1"]);
    let error = "Error:a word must begin with a letter (error:1)";
    assert_eq!(first(&mut machine, "% G1 X1"), error);
}

#[test]
fn comments_between_words() {
    let mut machine = reprap();
    for line in [
        "G1 (a) X1 (b)Y2;c",
        "g1x3 (x9) y4",
        "(a)G1 X5(b)",
        "\tG1\tX 6",
    ] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    assert_eq!(xy_mm(&machine), [6, 4]);
}

#[test]
fn lists_take_their_first() {
    let mut machine = reprap();
    assert_eq!(machine.ask("G1 X1:2:3 Y4:5"), ["ok"]);
    assert_eq!(xy_mm(&machine), [1, 4]);
}

#[test]
fn a_wifi_password_survives() {
    use leadscrew::gcode::reprap::{Parameters, unescaped};
    for (line, text) in [
        ("M587 P\"ABCxyz;\"\" 123\"", "ABCxyz;\" 123"),
        ("M587 P\"ABC'X'Y'Z;\"\" 123\"", "ABCxyz;\" 123"),
        ("M587 P\"it''s (*!~?\"", "it's (*!~?"),
    ] {
        let parameter = Parameters::new(line.as_bytes()).last();
        let escaped = parameter.and_then(Result::ok).and_then(|last| last.text);
        let read: Vec<u8> = unescaped(escaped.expect(line)).collect();
        assert_eq!(String::from_utf8_lossy(&read), text, "{line}");
    }
}

#[test]
fn each_letter_of_the_pages() {
    let mut machine = reprap();
    // Letters without a meaning are ignored, also in a line that is checked.
    send_numbered(
        &mut machine,
        1,
        &["G1 X1 H1 D2 Q3 L4 P5 S0 E1 T0", "G1 Y2 I K7"],
    );
    for axis in ["U", "V", "W"] {
        // Once for each job.
        let line = format!("G1 {axis}1");
        let expected = format!("echo:{axis}: no such axis");
        assert_eq!(first(&mut machine, &line), expected);
        assert_eq!(first(&mut machine, &line), "");
    }
    assert_eq!(xy_mm(&machine), [1, 2]);
}

#[test]
fn arcs_with_e() {
    let mut machine = reprap();
    let arc = "G2 X90.6 Y13.8 I5 J10 E22.4";
    // The centre is 5 and 10 mm from the start, and the end not on its circle.
    let off_the_circle = "Error:the target cannot be reached (error:33)";
    assert_eq!(first(&mut machine, arc), off_the_circle);
    assert_eq!(xy(&machine), [0, 0]);
    // Here it is, the radius being that of the start, 11.18 mm.
    for line in ["G1 X96.780340 Y3.8 F6000", arc] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    let position = first(&mut machine, "M114");
    assert!(
        position.starts_with("X:90.600 Y:13.800 Z:0.000 E:22.400 "),
        "{position}"
    );
    assert_eq!(
        machine.ask("G3 X96.780340 Y3.8 I11.180340 J0 E44.8"),
        ["ok"]
    );
    assert_eq!(xy_mm(&machine), [96, 3]);
    assert!(first(&mut machine, "M114").contains(" E:44.800 "));
}

#[test]
fn arcs_path_control_and_cycles_keep_their_words() {
    // Two circles, as in Marlin.
    let steps = |line: &str| {
        let mut machine = reprap();
        assert_eq!(machine.ask(line), ["ok"], "{line}");
        statistics(&machine.edges).events
    };
    let once = steps("G2 X0 I5 F6000");
    assert!(steps("G2 X0 I5 F6000 P2").abs_diff(2 * once) < once / 10);
    let mut machine = reprap();
    for (line, tolerances) in [
        ("G64 P0.5", (500_000, 500_000)),
        ("G64 P0.5 Q0.1", (500_000, 100_000)),
        ("G1 G64 X1 P0.25 Q0", (250_000, 0)),
    ] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
        let path = machine.session().interpreter().modal().path;
        let expected = PathControl::Continuous {
            tolerance_nm: tolerances.0,
            merging_nm: tolerances.1,
        };
        assert_eq!(path, expected, "{line}");
    }
    // A clamp that R passes over: to drop the word would lead into it.
    for (line, z) in [
        ("G81 X1 Y1 Z-1 R1 F6000", 1),
        ("X2 R3", 3),
        ("X3", 3),
        ("Y2 R5 L2 E1", 5),
        ("G83 X1 Z-1 R6 Q0.5", 6),
        ("X2 Q1 R7", 7),
        ("G80", 7),
        ("G0 G40 Z2", 2),
    ] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
        let steps = machine.physical_steps()[2];
        assert_eq!(steps, z * STEPS_PER_MM, "{line}");
    }
    let before = xy_mm(&machine)[0];
    for line in ["G91 G99 G82 X1 Z-1 R0 P0 F6000", "X1 L3"] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    assert_eq!(xy_mm(&machine)[0], before + 4);
    assert!(seconds(&mut machine, "X1 P2") > 2.0);
    let mut steps = |line: &str| {
        let before = statistics(&machine.edges).events;
        assert_eq!(machine.ask(line), ["ok"], "{line}");
        statistics(&machine.edges).events - before
    };
    let one_peck = steps("G83 X1 Z-10 R0 Q10");
    let many_pecks = steps("X1 Q0.5");
    assert!(many_pecks > 3 * one_peck, "{many_pecks}, {one_peck}");
    assert_eq!(machine.ask("G90 G98 G80"), ["ok"]);
    let missing = "Error:the command lacks a value word (error:28)";
    let answer = machine.ask("G82 X1 Z-1 R2");
    assert_eq!(answer, ["[MSG:P is missing]", missing, "ok"]);
    // Also beside a code of Grbl's a G0 goes at F.
    machine.ask("G40 F600");
    let slow = seconds(&mut machine, "G0 G40 X-50");
    assert!(slow > 5.0, "{slow}");
}

#[test]
fn what_hosts_poll_is_answered_by_ok_alone() {
    let mut machine = reprap();
    for line in [
        "M21", "M24", "M27", "M31", "M108", "M155 S2", "M410", "M500", "M501", "M84", "M17", "T0",
        "M113", "M220", "M221", "M154", "M104", "M140 S0", "M109 S0",
    ] {
        machine.send(line);
        machine.send_for(b"\n", 2500);
        assert_eq!(machine.lines(), ["ok"], "{line}");
    }
    for code in 29..=32 {
        let unknown = format!("echo:Unknown command: \"G{code}\"");
        assert_eq!(first(&mut machine, &format!("G{code}")), unknown);
    }
}

#[test]
fn e_is_counted_where_it_drives_nothing() {
    let mut machine = reprap();
    let e = |machine: &mut Machine| {
        let position = first(machine, "M114");
        let (_, tail) = position.split_once(" E:").expect("an E");
        tail.split_once(' ').expect("a count").0.to_owned()
    };
    for (line, position) in [
        ("G1 E2.5", "2.500"),
        ("G1 X1 E1", "1.000"),
        ("M83", "1.000"),
        ("G1 E-0.000001", "1.000"),
        ("G2 X2 Y1 I1 J0 E0.25", "1.250"),
        ("G90", "1.250"),
        ("G1 E4", "4.000"),
        ("G91", "4.000"),
        ("G1 X0 E1", "5.000"),
        ("M82", "5.000"),
        ("G92 E0", "0.000"),
        ("G20", "0.000"),
        ("G1 E1", "25.400"),
        ("G21", "25.400"),
        ("M221 S50", "25.400"),
        ("G1 E30", "30.000"),
        // A refused line changes nothing.
        ("G2 X9 Y9 E90", "30.000"),
    ] {
        machine.ask(line);
        assert_eq!(e(&mut machine), position, "{line}");
    }
    assert_eq!(xy_mm(&machine), [2, 1]);
}

#[test]
fn g92_sets_the_logical_position() {
    let mut machine = reprap();
    send_numbered(&mut machine, 1, &["G1 X10 Y5", "G92 X1 E7", "G1 X2 Y6"]);
    assert_eq!(xy_mm(&machine), [11, 6]);
    send_numbered(&mut machine, 4, &["G92", "G1 X1 Y1"]);
    assert_eq!(xy_mm(&machine), [12, 7]);
}

#[test]
fn g28_homes_and_counts_from_the_negative_end() {
    let mut machine = reprap();
    assert_eq!(first(&mut machine, "G28"), "echo:homing is off, $22");
    let mut machine = reprap_with(&["22=1", "788=7", "130=100", "131=200", "132=50"]);
    assert_eq!(machine.state(), State::Alarm);
    let locked = "Error:Printer stopped due to errors. G28 homes the machine; M999 to go on";
    assert_eq!(first(&mut machine, "G1 X1"), locked);
    assert_eq!(machine.ask("G28 X0 Y0"), ["ok"]);
    assert!(first(&mut machine, "M114").starts_with("X:100.000 Y:200.000 Z:0.000"));
    assert_eq!(machine.ask("G28"), ["ok"]);
    assert!(first(&mut machine, "M114").starts_with("X:100.000 Y:200.000 Z:50.000"));
    assert_eq!(machine.ask("G1 X90 F6000"), ["ok"]);
    assert_eq!(xy_mm(&machine), [-10, 0]);
}

#[test]
fn back_to_the_pause_and_5_mm_above() {
    let mut machine = reprap();
    assert_eq!(
        first(&mut machine, "G1 R1 Z5"),
        "Error:no pause position (error:202)"
    );
    machine.send_for(b"G1 X10 Y20 F6000\nM0\nG92 X0 Y0\nG91\nG1 X30 Y-5\n", 2000);
    assert_eq!(machine.state(), State::HoldComplete);
    machine.send(b"M108\n");
    machine.run_to_standstill();
    machine.lines();
    assert_eq!(xy_mm(&machine), [40, 15]);
    assert_eq!(machine.ask("G1 R1 Z5 F6000"), ["ok"]);
    assert_eq!(xy_mm(&machine), [10, 20]);
    assert_eq!(machine.physical_steps()[2], 5 * STEPS_PER_MM);
    // The modes are as before.
    assert_eq!(machine.ask("G1 X1"), ["ok"]);
    assert_eq!(xy_mm(&machine), [11, 20]);
}

#[test]
fn g6_only_where_allowed_idle_and_in_range() {
    let mut machine = reprap_with(&["784=1", "22=1", "788=7", "130=100", "131=100", "132=100"]);
    machine.ask("G28");
    assert_eq!(machine.ask("G6 A-45 F6000"), ["ok"]);
    assert_eq!(xy_mm(&machine), [-45, 0]);
    // Not homed any more: nobody knows where the travel ends.
    assert_eq!(machine.ask("G6 B20 C10 R F6000"), ["ok"]);
    assert_eq!(xy_mm(&machine), [-45, 20]);
    machine.ask("G28");
    let refused = "Error:the target cannot be reached (error:33)";
    assert_eq!(first(&mut machine, "G6 A1"), refused);
    assert_eq!(first(&mut machine, "G6 A-101 B-1"), refused);
    let unused = "Error:no command uses one of the value words (error:36)";
    for line in ["G6 X5", "G6 A-5 X5", "G6 A-5 E1", "G0 S2 X-5 A5"] {
        assert_eq!(first(&mut machine, line), unused, "{line}");
    }
    assert_eq!(xy_mm(&machine), [-45, 20]);
}

#[test]
fn g6_waits_until_the_machine_stands_still() {
    let mut machine = reprap_with(&["784=1"]);
    machine.send_for(b"G1 X10 F600\nG6 A45 F6000\nG6 B20 R F6000\n", 500);
    assert_eq!(machine.lines(), ["ok"]);
    machine.run_to_standstill();
    assert_eq!(machine.lines(), ["ok", "ok"]);
    assert_eq!(xy_mm(&machine), [45, 20]);
    // A reset ends the wait.
    machine.send_for(b"G1 X100 F600\nG6 A0 F6000\n", 500);
    machine.answers_to("\x18");
    machine.ask("M999");
    assert_eq!(machine.ask("G6 B10 F6000"), ["ok"]);
    assert_eq!(xy_mm(&machine)[1], 10);
}

#[test]
fn s2_needs_784() {
    let mut machine = reprap();
    let unknown = "echo:Unknown command: \"G1 S2 X5\"";
    assert_eq!(first(&mut machine, "G1 S2 X5"), unknown);
    let mut machine = reprap_with(&["784=1"]);
    assert_eq!(machine.ask("G1 S2 X5 F6000"), ["ok"]);
    assert_eq!(xy_mm(&machine), [5, 0]);
    assert_eq!(machine.ask("G20"), ["ok"]);
    assert_eq!(machine.ask("G1 S2 Y1"), ["ok"]);
    assert_eq!(xy(&machine)[1], (25.4 * f64::from(STEPS_PER_MM)) as i32);
}
