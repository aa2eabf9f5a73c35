//! Codes of fans, drivers, the laser, limits, overrides, pauses and reports.

use leadscrew::model::{Spindle, State};

use crate::host::{Host, STEPS_PER_MM, first, numbered, place, seconds};

/// The answer to a line begins so: more axes may follow.
fn assert_begins(host: &mut Host, line: &str, expected: &str) {
    let answer = first(host, line);
    assert!(answer.starts_with(expected), "{line}: {answer}");
}

#[test]
fn a_fan_switches_between_two_moves() {
    let mut host = Host::with(&["783=1", "30=255"]);
    host.receive(b"G1 X10 F6000\nM106 S127.5\nG1 X20\nM107\nG1 X30\n");
    let mut on = Vec::new();
    while place(&mut host)[0] < 30 {
        host.run_ms(1);
        if host.simulator.outputs().duty != 0 {
            on.push(host.xy()[0]);
        }
    }
    host.rest();
    assert_eq!(host.lines(), ["ok"; 5]);
    let ends = [10, 20].map(|mm| Some(mm * STEPS_PER_MM));
    assert_eq!([on.first().copied(), on.last().copied()], ends);
    let mut host = Host::with(&["783=1", "30=255"]);
    host.ask("M106 S127");
    let duty = host.simulator.outputs().duty;
    let full = leadscrew::model::Outputs::FULL;
    assert!((duty * 2).abs_diff(full) <= full / 100, "{duty}");
    assert_eq!(host.simulator.outputs().spindle, Spindle::Clockwise);
    host.ask("M107");
    assert_eq!(host.simulator.outputs().duty, 0);
    let mut host = Host::with(&["783=2"]);
    host.ask("M106");
    assert!(host.simulator.outputs().coolant.flood);
    host.ask("M106 S0");
    assert!(!host.simulator.outputs().coolant.flood);
    let mut host = Host::new();
    assert_eq!(first(&mut host, "M106 S255"), "echo:M106: not present");
    // Once for each job.
    assert_eq!(first(&mut host, "M106 S255"), "");
    host.ask("M110 N0");
    assert_eq!(first(&mut host, "M106 S255"), "echo:M106: not present");
}

#[test]
fn limits_are_lowered_until_a_reset() {
    let mut host = Host::new();
    assert_begins(&mut host, "M203", "echo:M203 X100.000 Y100.000 Z100.000");
    assert_eq!(first(&mut host, "M203 X10 Y500"), "");
    assert_begins(&mut host, "M203", "echo:M203 X10.000 Y100.000 Z100.000");
    let slow = seconds(&mut host, "G1 X50 F6000");
    assert!((5.0..5.3).contains(&slow), "{slow}");
    assert_eq!(first(&mut host, "M204 S50"), "");
    assert_begins(&mut host, "M201", "echo:M201 X50.000 Y50.000 Z50.000");
    for (line, told) in [
        ("M92 X10", "echo:use $100"),
        ("M205 X8.00 Y8.00", "echo:use $11"),
        ("M205", "echo:M205 J0.010"),
        ("M502", "echo:use $RST=$"),
    ] {
        assert_eq!(first(&mut host, line), told, "{line}");
    }
    assert_begins(&mut host, "M92", "echo:M92 X80.000 Y80.000 Z80.000");
    let settings = host.ask("M503");
    assert!(
        settings.contains(&"echo:$110=6000.000".to_owned()),
        "{settings:?}"
    );
    host.ask("M999");
    host.run_ms(50);
    host.lines();
    assert_begins(&mut host, "M203", "echo:M203 X100.000 Y100.000 Z100.000");
    let fast = seconds(&mut host, "G1 X0 F6000");
    assert!((0.6..0.9).contains(&fast), "{fast}");
}

#[test]
fn m220_is_the_feed_override() {
    let mut host = Host::new();
    for percent in [100, 50, 37, 200, 195, 10, 15, 100] {
        assert_eq!(host.ask(&format!("M220 S{percent}")), ["ok"]);
        host.run_ms(1);
        let overrides = host.simulator.snapshot().overrides;
        assert_eq!(i32::from(overrides.feed), percent);
    }
}

/// Makes a break on the line, behind which the machine waits for the operator.
fn hold_by_break(host: &mut Host) {
    host.simulator.pull_line(true);
    host.run_ms(100);
    host.simulator.pull_line(false);
    host.run_ms(30_000);
    assert_eq!(host.state(), State::HoldComplete);
    let told = host.lines();
    let is_break = |line: &String| line.contains("Break on the line");
    assert!(told.iter().any(is_break), "{told:?}");
}

#[test]
fn a_pause_with_a_time_waits_for_the_operator_after_a_break_on_the_line() {
    let mut host = Host::new();
    host.receive(b"M0 S2\nG1 X1 F6000\n");
    host.run_ms(100);
    hold_by_break(&mut host);
    assert_eq!(place(&mut host), [0, 0]);
    host.ask("M108");
    assert_eq!(place(&mut host), [1, 0]);
}

#[test]
fn lines_behind_m410_wait_for_the_operator_after_a_break_on_the_line() {
    let mut host = Host::new();
    host.receive(b"G1 X50 F500\n");
    host.run_ms(2500);
    host.receive(b"M410\nG1 X0 F500\nG1 X5\n");
    host.run_ms(10);
    hold_by_break(&mut host);
    host.ask("M108");
    assert_eq!(place(&mut host), [5, 0]);
}

#[test]
fn a_pause_with_a_time_ends_by_itself() {
    let mut host = Host::new();
    host.receive(b"M0 S2\nG1 X1 F6000\n");
    host.run_ms(1900);
    assert_eq!(place(&mut host), [0, 0]);
    host.run_ms(600);
    assert_eq!(place(&mut host), [1, 0]);
    host.receive(b"M0 P500\nG1 X2\n");
    host.run_ms(400);
    assert_eq!(place(&mut host), [1, 0]);
    host.rest();
    assert_eq!(place(&mut host), [2, 0]);
}

#[test]
fn drivers_are_switched_at_standstill() {
    let mut host = Host::with(&["1=255"]);
    host.ask("M84");
    assert!(!host.simulator.outputs().drivers);
    host.ask("M17");
    host.run_ms(5000);
    assert!(host.simulator.outputs().drivers);
    host.receive(b"G1 X10 F6000\nM18 X Y\n");
    host.rest();
    assert_eq!(place(&mut host), [10, 0]);
    assert!(!host.simulator.outputs().drivers);
}

#[test]
fn m84_s_sets_the_time_of_standstill_up_to_a_reset() {
    let mut host = Host::with(&["1=25"]);
    assert_eq!(host.ask("M84 S2"), ["ok"]);
    for x in [1, 2] {
        host.receive(format!("G1 X{x} F6000\n").as_bytes());
        host.run_ms(1900);
        assert!(host.simulator.outputs().drivers, "{x}");
    }
    host.run_ms(500);
    assert_eq!(host.lines(), ["ok", "ok"]);
    assert!(!host.simulator.outputs().drivers);
    assert_eq!(host.ask("M84 S0"), ["ok"]);
    host.ask("G1 X3");
    host.run_ms(40_000);
    assert!(host.simulator.outputs().drivers, "0 is never, as in Marlin");
    host.ask("M18");
    assert!(!host.simulator.outputs().drivers);
    host.ask("M999");
    host.run_ms(100);
    host.lines();
    host.ask("G1 X4 F6000");
    host.run_ms(100);
    assert!(!host.simulator.outputs().drivers, "$1 counts again");
    assert_eq!(
        first(&mut host, "M84 S70000"),
        "Error:the value is outside its range (error:39)"
    );
}

#[test]
fn switches_and_positions_are_reported() {
    let mut host = Host::with(&["23=1"]);
    let answer = host.ask("M119");
    assert_eq!(
        answer[..3],
        ["Reporting endstop status", "x_min: open", "y_max: open"]
    );
    host.ask("M154 S1");
    host.run_ms(2500);
    let told = host.lines();
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(told[0].starts_with("X:0.000 Y:0.000 Z:0.000 E:0.000 Count X:0"));
    host.ask("M154 S0");
    host.run_ms(2500);
    assert!(host.lines().is_empty());
    assert_eq!(
        host.ask(&numbered(1, "M20")),
        ["Begin file list", "End file list", "ok"]
    );
}

#[test]
fn g0_is_dark_in_laser_mode() {
    let mut host = Host::with(&["32=1"]);
    host.ask("M3 S500");
    host.receive(b"G1 X10 F600\n");
    host.run_ms(500);
    assert!(host.simulator.outputs().duty > 0);
    host.rest();
    host.receive(b"G0 X50\n");
    host.run_ms(200);
    assert_eq!(host.simulator.outputs().duty, 0);
    host.rest();
    host.receive(b"G1 X0 S0 F600\n");
    host.run_ms(500);
    assert_eq!(host.simulator.outputs().duty, 0);
}
