//! Tools: which one is in the spindle, and who is told.

use leadscrew::{
    model::{Coolant, Spindle, State},
    path::Work,
};

use super::bench::{Bench, WELCOME};

/// Returns the tool of the next status report, if it has one.
fn told(bench: &mut Bench) -> Option<String> {
    let report = bench.answer("?").remove(0);
    let (_, tool) = report.trim_end_matches('>').split_once("|T:")?;
    Some(tool.to_owned())
}

#[test]
fn a_new_tool_is_told_once() {
    let mut bench = Bench::new();
    let mut reports = |line: &str| {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
        [told(&mut bench), told(&mut bench)]
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
    assert_eq!(told(&mut bench), Some("3".into()));
    assert_eq!(bench.ask("$C"), ["[MSG:Enabled]", "ok"]);
    assert_eq!(bench.ask("M61Q4"), ["ok"]);
    assert_eq!(told(&mut bench), None);
    assert_eq!(bench.ask("$C")[2..], WELCOME);
    assert_eq!(bench.ask("M61Q3"), ["ok"]);
    assert_eq!(told(&mut bench), None);
}

/// Sends a line that changes the tool, and returns what comes before the machine waits.
fn change(bench: &mut Bench, line: &str) -> Vec<String> {
    let heard = bench.ask(line);
    assert_eq!(
        bench.machine.state,
        State::HoldComplete,
        "{line}: {heard:?}"
    );
    heard
}

#[test]
fn a_change_of_the_tool_waits_for_cycle_start_with_everything_off() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("M3S500M8"), ["ok"]);
    bench.works();
    let heard = change(&mut bench, "T2 M6 (MSG, 6 mm, two flutes)");
    assert_eq!(heard, ["[MSG:Tool change: T2 6 mm, two flutes]"]);
    let is_off = |bench: &Bench| bench.machine.spindle == Spindle::Off;
    assert!(is_off(&bench) && bench.machine.coolant == Coolant::OFF);
    assert_eq!(told(&mut bench), None);
    assert!(bench.answer("G1X1F100\n").is_empty());
    assert_eq!(bench.answer("~"), ["ok", "ok"]);
    assert_eq!(told(&mut bench), Some("2".into()));
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
fn the_rest_of_a_line_follows_the_change_of_the_tool() {
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
    assert_eq!(told(&mut bench), None);
    assert!(bench.ask("$G")[0].contains(" T0 "));
}

#[test]
fn a_reset_leaves_the_tool_that_is_in_the_spindle() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("M61Q1"), ["ok"]);
    assert_eq!(told(&mut bench), Some("1".into()));
    change(&mut bench, "T2M6");
    assert_eq!(bench.answer("\x18"), ["ok", WELCOME[0], WELCOME[1]]);
    assert_eq!(told(&mut bench), None);
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
    assert_eq!(told(&mut bench), Some("2".into()));
    assert_eq!(bench.ask("M5"), ["ok"]);
    assert_eq!(bench.ask("$341=0"), ["ok"]);
    assert_eq!(bench.ask("$C"), ["[MSG:Enabled]", "ok"]);
    assert_eq!(bench.answer("T3M6\nG1X1F100\nT2M6\n"), ["ok", "ok", "ok"]);
}

#[test]
fn a_homed_machine_goes_to_the_position_of_g30_for_a_change_and_comes_back() {
    let mut bench = Bench::set(&["22=1", "27=1", "789=1"]);
    let at = |bench: &mut Bench| bench.answer("?")[0].split('|').nth(1).unwrap().to_owned();
    let jog = |bench: &mut Bench, target: &str| {
        assert_eq!(bench.ask(&format!("$J=G53{target}F100")), ["ok"]);
    };
    jog(&mut bench, "X-50Y-60Z-10");
    assert_eq!(bench.ask("G30.1"), ["ok"]);
    jog(&mut bench, "X-20Y-30Z-40");
    // Not homed.
    change(&mut bench, "T1M6");
    assert_eq!(at(&mut bench), "MPos:-20.000,-30.000,-40.000");
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
    assert_eq!(at(&mut bench), "MPos:-50.000,-60.000,-10.000");
    assert_eq!(bench.answer("~"), ["ok"]);
    assert_eq!(moves(&mut bench), [[30, 30, 0], [0, 0, -30]]);
    assert_eq!(at(&mut bench), "MPos:-20.000,-30.000,-40.000");
    assert!(bench.ask("$G")[0].starts_with("[GC:G0 G54 G17 G20 G91 G94 G64 "));
}
