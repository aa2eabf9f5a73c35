//! Tools: which one is in the spindle, and who is told.

use leadscrew::{
    model::{Coolant, Spindle, State},
    path::Work,
};

use super::bench::{Bench, WELCOME};

/// Returns the tool of the next status report, if it has one.
fn reported_tool(bench: &mut Bench) -> Option<String> {
    bench.report().field("T").map(str::to_owned)
}

#[test]
fn a_new_tool_is_reported_once() {
    let mut bench = Bench::new();
    let mut reports = |line: &str| {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
        [reported_tool(&mut bench), reported_tool(&mut bench)]
    };
    assert_eq!(reports("T3"), [None, None]);
    assert_eq!(reports("M61Q3"), [Some("3".into()), None]);
    assert_eq!(reports("M61Q3"), [None, None]);
    assert_eq!(reports("M61Q255"), [Some("255".into()), None]);
}

#[test]
fn a_program_that_is_only_checked_changes_no_tool() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("M61Q3"), ["ok"]);
    assert_eq!(reported_tool(&mut bench), Some("3".into()));
    assert_eq!(bench.ask("$C"), ["[MSG:Enabled]", "ok"]);
    assert_eq!(bench.ask("M61Q4"), ["ok"]);
    assert_eq!(reported_tool(&mut bench), None);
    assert_eq!(bench.ask("$C")[2..], WELCOME);
    assert_eq!(bench.ask("M61Q3"), ["ok"]);
    assert_eq!(reported_tool(&mut bench), None);
}

/// Sends a line that changes the tool, and returns what comes before the machine waits.
fn change(bench: &mut Bench, line: &str) -> Vec<String> {
    let lines = bench.ask(line);
    assert_eq!(
        bench.machine.state,
        State::HoldComplete,
        "{line}: {lines:?}"
    );
    lines
}

#[test]
fn a_change_of_the_tool_waits_for_cycle_start_with_everything_off() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("M3S500M8"), ["ok"]);
    bench.works();
    let lines = change(&mut bench, "T2 M6 (MSG, 6 mm, two flutes)");
    assert_eq!(lines, ["[MSG:Tool change: T2 6 mm, two flutes]"]);
    let is_off = |bench: &Bench| bench.machine.spindle == Spindle::Off;
    assert!(is_off(&bench) && bench.machine.coolant == Coolant::OFF);
    assert_eq!(reported_tool(&mut bench), None);
    assert!(bench.answer("G1F100\n").is_empty());
    assert_eq!(bench.answer("~"), ["ok", "ok"]);
    assert_eq!(reported_tool(&mut bench), Some("2".into()));
    assert!(is_off(&bench) && bench.machine.coolant.flood);
    assert_eq!(
        bench.ask("$G")[0],
        "[GC:G1 G54 G17 G21 G90 G94 M5 M8 T2 F100 S500]"
    );
    // The tool is in the spindle now.
    bench.works();
    assert_eq!(bench.ask("M6"), ["ok"]);
    assert_eq!(bench.ask("T2M6"), ["ok"]);
    assert!(bench.works().is_empty());
}

#[test]
fn the_remainder_of_a_line_follows_the_change_of_the_tool() {
    let mut bench = Bench::new();
    change(&mut bench, "G91 T3 M6 M3 S900 G43.1 Z2 M8");
    assert_eq!(bench.machine.spindle, Spindle::Off);
    assert_eq!(bench.answer("~"), ["ok"]);
    assert_eq!(
        (bench.machine.spindle, bench.machine.spindle_rpm),
        (Spindle::Clockwise, 900.0)
    );
    assert_eq!(bench.ask("$#")[9], "[TLO:2.000]");
    assert!(bench.ask("$G")[0].contains("G91 G94 M3 M8 T3 "));
}

#[test]
fn a_line_with_an_error_changes_no_tool() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("T3M6G1X1"), ["error:22"]);
    assert_eq!(bench.ask("T3M6M61Q3"), ["error:21"]);
    assert_eq!(bench.ask("$J=M6X1F100"), ["error:16"]);
    assert_eq!(bench.machine.state, State::Idle);
    assert_eq!(reported_tool(&mut bench), None);
    assert!(bench.ask("$G")[0].contains(" T0 "));
}

#[test]
fn a_reset_leaves_the_tool_that_is_in_the_spindle() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("M61Q1"), ["ok"]);
    assert_eq!(reported_tool(&mut bench), Some("1".into()));
    change(&mut bench, "T2M6");
    assert_eq!(bench.answer("\x18"), ["ok", WELCOME[0], WELCOME[1]]);
    assert_eq!(reported_tool(&mut bench), None);
    assert_eq!(bench.ask("T1M6"), ["ok"]);
    change(&mut bench, "T2M6");
    assert_eq!(bench.answer("~"), ["ok"]);
    assert_eq!(bench.answer("\x18"), WELCOME);
    assert_eq!(bench.ask("T2M6"), ["ok"]);
}

#[test]
fn m6_does_not_wait_where_programs_are_checked_or_the_setting_says_so() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$341=1"), ["error:52"]);
    assert_eq!(bench.ask("$341=4"), ["ok"]);
    assert_eq!(bench.ask("M3S500"), ["ok"]);
    assert_eq!(bench.ask("T2M6"), ["ok"]);
    assert_eq!(bench.machine.spindle, Spindle::Clockwise);
    assert_eq!(reported_tool(&mut bench), Some("2".into()));
    assert_eq!(bench.ask("M5"), ["ok"]);
    assert_eq!(bench.ask("$341=0"), ["ok"]);
    assert_eq!(bench.ask("$C"), ["[MSG:Enabled]", "ok"]);
    assert_eq!(bench.answer("T3M6\nG1X1F100\nT2M6\n"), ["ok", "ok", "ok"]);
}

#[test]
fn a_homed_machine_goes_to_the_position_of_g30_for_a_change_and_comes_back() {
    let mut bench = Bench::set(&["22=1", "27=1", "789=1"]);
    let jog = |bench: &mut Bench, target: &str| {
        assert_eq!(bench.ask(&format!("$J=G53{target}F100")), ["ok"]);
    };
    jog(&mut bench, "X-50Y-60Z-10");
    assert_eq!(bench.ask("G30.1"), ["ok"]);
    jog(&mut bench, "X-20Y-30Z-40");
    // Not homed.
    change(&mut bench, "T1M6");
    assert_eq!(bench.report().xyz(), Some("-20.000,-30.000,-40.000"));
    assert_eq!(bench.answer("~"), ["ok"]);
    assert_eq!(bench.ask("$H").last().unwrap(), "ok");
    jog(&mut bench, "X-20Y-30Z-40");
    bench.works();
    assert_eq!(bench.ask("G20 G91 G64 P1"), ["ok"]);
    change(&mut bench, "T2M6");
    let moves = |bench: &mut Bench| -> Vec<[i64; 3]> {
        let mm = |delta: i64| (delta >> 32) / 250;
        let moved = |work: &Work| match work {
            Work::Move(block) => Some([0, 1, 2].map(|axis| mm(block.delta[axis]))),
            _ => None,
        };
        bench.works().iter().filter_map(moved).collect()
    };
    assert_eq!(moves(&mut bench), [[0, 0, 39], [-30, -30, 0], [0, 0, -9]]);
    assert_eq!(bench.report().xyz(), Some("-50.000,-60.000,-10.000"));
    assert_eq!(bench.answer("~"), ["ok"]);
    assert_eq!(moves(&mut bench), [[30, 30, 0], [0, 0, -30]]);
    assert_eq!(bench.report().xyz(), Some("-20.000,-30.000,-40.000"));
    assert!(bench.ask("$G")[0].starts_with("[GC:G0 G54 G17 G20 G91 G94 G64 "));
}

/// Hands over bytes in one go, and returns the lines that are sent.
fn send(bench: &mut Bench, bytes: &[u8]) -> Vec<String> {
    bench.receive(bytes);
    bench.serve()
}

#[test]
fn the_operators_lines_are_executed_before_what_was_received_of_the_program() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("G0X3Y4Z-5"), ["ok"]);
    change(&mut bench, "T2M6");
    // The program goes on in the middle of a line.
    assert!(send(&mut bench, b"G91\nG0X1\nG0 X").is_empty());
    assert!(send(&mut bench, b"\xa3").is_empty());
    assert_eq!(bench.machine.state, State::Tool);
    let report = bench.report();
    assert_eq!(
        (&*report.state, report.xyz()),
        ("Tool", Some("3.000,4.000,-5.000"))
    );
    assert_eq!(bench.ask("$J=G90X50Y60Z-1F100"), ["ok"]);
    assert_eq!(
        send(&mut bench, b"\xa3$J=G91Z2F100\n\xa3G43.1Z-7\n"),
        ["ok", "ok"]
    );
    assert_eq!(bench.report().xyz(), Some("50.000,60.000,1.000"));
    let modes = bench.ask("$G");
    assert_eq!(modes[0], "[GC:G0 G54 G17 G21 G90 G94 M6 M5 M9 T2 F0 S0]");
    assert_eq!(bench.ask("G20G91G55G38.3Z-1F5")[1], "ok");
    bench.works();
    assert_eq!(send(&mut bench, b"~10\nG0Y1\n"), ["ok"; 5]);
    let moves = bench.works();
    assert_eq!(moves.len(), 5, "{moves:?}");
    assert_eq!(reported_tool(&mut bench), Some("2".into()));
    assert_eq!(bench.report().xyz(), Some("14.000,5.000,-5.000"));
    assert_eq!(bench.ask("$#")[9], "[TLO:-7.000]");
    assert_eq!(
        bench.ask("$G")[0],
        "[GC:G0 G54 G17 G21 G91 G94 M5 M9 T2 F0 S0]"
    );
}

#[test]
fn what_is_sent_between_0xa3_and_cycle_start_is_of_the_operator_however_late_it_is_read() {
    for lines in [
        &b"$J=X9F100\nG43.1Z1\n"[..],
        b"$J=X9F100\nG43.1Z1\n(",
        b"\n\n$J=X9F100\nG43.1Z1\n",
    ] {
        let mut bench = Bench::new();
        change(&mut bench, "T2M6");
        bench.withholds = true;
        let mut bytes = b"G0X1\nG0".to_vec();
        bytes.push(0xa3);
        bytes.extend(lines);
        bytes.extend(b"~");
        bytes.extend(if lines.ends_with(b"(") {
            &b")X7\n$#\n"[..]
        } else {
            b"X7\n$#\n"
        });
        bench.receive(&bytes);
        bench.withholds = false;
        let output = bench.serve();
        let expected = String::from_utf8_lossy(lines).matches('\n').count() + 4;
        if lines.ends_with(b"(") {
            // A line in two halves on both sides of cycle start is one of the program.
            assert_eq!(super::bench::answers(&output).len(), expected);
        } else {
            assert_eq!(
                super::bench::answers(&output),
                vec!["ok"; expected],
                "{output:?}"
            );
            assert_eq!(bench.machine.steps.0[0], 7 * 250);
        }
        assert!(output.contains(&"[TLO:1.000]".to_owned()), "{output:?}");
    }
}

#[test]
fn lines_that_belong_into_a_program_are_refused_in_a_change_of_the_tool() {
    let mut bench = Bench::set(&["22=1"]);
    change(&mut bench, "T2M6");
    assert!(send(&mut bench, b"G0X1\n\xa3").is_empty());
    for line in [
        "G0X1",
        "X1",
        "G1X1F100",
        "G2X2I1F100",
        "G28",
        "G30Z1",
        "G53G0X0",
        "M6",
        "T3M6",
        "M61Q2",
        "M0",
        "M2",
        "M30",
        "M3S100",
        "M4",
        "$C",
    ] {
        assert_eq!(bench.ask(line), ["error:40"], "{line}");
    }
    for line in [
        "",
        "G10L2P1X1",
        "G10L20P2Z0",
        "G92X0",
        "G43.1Z3",
        "G49",
        "T5",
        "M5",
        "M8",
        "G4P0",
        "G91",
        "S5",
        "$J=X1F100",
        "$10=1",
        "G28.1",
    ] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert_eq!(bench.ask("$H").last().unwrap(), "ok");
    assert_eq!(bench.machine.state, State::Idle);
}

#[test]
fn a_reset_drops_the_lines_that_are_kept() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("M61Q1"), ["ok"]);
    change(&mut bench, "T2M6");
    assert!(send(&mut bench, b"G0X9\nM61Q9\n\xa3").is_empty());
    assert_eq!(bench.ask("G43.1Z2"), ["ok"]);
    assert_eq!(send(&mut bench, b"\x18"), ["ok", WELCOME[0], WELCOME[1]]);
    assert_eq!(reported_tool(&mut bench), Some("1".into()));
    assert_eq!(bench.machine.state, State::Idle);
    assert_eq!(bench.ask("$#")[9], "[TLO:0.000]");
    assert_eq!(bench.ask("G0X2"), ["ok"]);
    assert_eq!(bench.machine.steps.0[0], 500);
}

#[test]
fn elsewhere_0xa3_is_ignored() {
    let mut bench = Bench::new();
    assert_eq!(send(&mut bench, b"\xa3G0\xa3X1\n"), ["ok"]);
    assert!(send(&mut bench, b"M0\n\xa3").is_empty());
    assert_eq!(bench.machine.state, State::HoldComplete);
    assert_eq!(send(&mut bench, b"G0X2\n~"), ["ok", "ok"]);
    assert_eq!(bench.machine.steps.0[0], 500);
}

#[test]
fn the_first_feed_move_after_a_change_stops_once_where_the_spindle_is_off() {
    let stop = ["[MSG:Spindle is off]"];
    let mut bench = Bench::new();
    assert_eq!(bench.answer("M3S500\nM5\n"), ["ok", "ok"]);
    change(&mut bench, "T2M6");
    assert_eq!(bench.answer("~"), ["ok"]);
    for line in ["G0X1", "G4P0", "$J=X2F100", "G1F100", "G38.3Z-1"] {
        assert_eq!(bench.ask(line).last().unwrap(), "ok", "{line}");
    }
    bench.works();
    assert_eq!(bench.ask("G1X9"), stop);
    assert_eq!(bench.machine.state, State::HoldComplete);
    assert!(
        !bench
            .works()
            .iter()
            .any(|work| matches!(work, Work::Move(_)))
    );
    assert_eq!(bench.answer("~"), ["ok"]);
    assert_eq!(bench.machine.steps.0[0], 9 * 250);
    assert_eq!(bench.answer("G1X8\nX7\n"), ["ok", "ok"]);
    for (begins, next) in [
        // Switched on, in time.
        ("M3S500", "M4G1X1F100"),
        // A laser; a pen; a program that has not used it.
        ("$32=1", "G1X1F100"),
        ("M5", "G1X1F100"),
        ("M30", "G2X2I1F100"),
    ] {
        let mut bench = Bench::new();
        if begins == "M30" {
            assert_eq!(bench.answer("M3S500\nM30\n")[2], "ok");
        } else {
            assert_eq!(bench.ask(begins), ["ok"]);
        }
        if begins == "$32=1" {
            assert_eq!(bench.ask("M3S500"), ["ok"]);
        }
        change(&mut bench, "T2M6");
        assert_eq!(bench.answer("~"), ["ok"]);
        assert_eq!(bench.ask(next), ["ok"], "{begins}");
        assert_eq!(bench.ask("G1X5"), ["ok"], "{begins}");
    }
}
