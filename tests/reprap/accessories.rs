//! Codes of fans, drivers, the laser, limits, overrides, pauses and reports.

use leadscrew::model::{Spindle, State};

use crate::{
    machine::{STEPS_PER_MM, first, numbered, reprap, reprap_with, seconds, xy, xy_mm},
    support::Machine,
};

/// The answer to a line begins so: more axes may follow.
fn assert_begins(machine: &mut Machine, line: &str, expected: &str) {
    let answer = first(machine, line);
    assert!(answer.starts_with(expected), "{line}: {answer}");
}

#[test]
fn a_fan_switches_between_two_moves() {
    let mut machine = reprap_with(&["783=1", "30=255"]);
    machine.send(b"G1 X10 F6000\nM106 S127.5\nG1 X20\nM107\nG1 X30\n");
    let mut on = Vec::new();
    while xy_mm(&machine)[0] < 30 {
        machine.run(1);
        if machine.outputs().duty != 0 {
            on.push(xy(&machine)[0]);
        }
    }
    assert_eq!(machine.answers(), ["ok"; 5]);
    let ends = [10, 20].map(|mm| Some(mm * STEPS_PER_MM));
    assert_eq!([on.first().copied(), on.last().copied()], ends);
    let mut machine = reprap_with(&["783=1", "30=255"]);
    let full = leadscrew::model::Outputs::FULL;
    for (speed, duty) in [
        ("127", 127.0),
        ("0.5", 0.5),
        ("254.5", 254.5),
        ("255", 255.0),
    ] {
        machine.ask(&format!("M106 S{speed}"));
        let exact = (duty / 255.0 * f64::from(full)) as u16;
        assert!(machine.outputs().duty.abs_diff(exact) <= 4, "{speed}");
    }
    assert_eq!(machine.outputs().spindle, Spindle::Clockwise);
    machine.ask("M107");
    assert_eq!(machine.outputs().duty, 0);
    let mut machine = reprap_with(&["783=2"]);
    machine.ask("M106");
    assert!(machine.outputs().coolant.flood);
    machine.ask("M106 S0");
    assert!(!machine.outputs().coolant.flood);
    machine.ask("M106 S0.1");
    assert!(machine.outputs().coolant.flood);
    let mut machine = reprap();
    assert_eq!(first(&mut machine, "M106 S255"), "echo:M106: not present");
    // Once for each job.
    assert_eq!(first(&mut machine, "M106 S255"), "");
    machine.ask("M110 N0");
    assert_eq!(first(&mut machine, "M106 S255"), "echo:M106: not present");
}

#[test]
fn a_limit_lowered_after_a_change_of_settings_changes_nothing_else() {
    // Each move is a step and a half.
    let mut machine = reprap();
    machine.ask("$100=40");
    machine.ask("G91");
    for _ in 0..40 {
        machine.ask("G1 X0.0374 F600");
        machine.ask("M204 S200");
    }
    assert_eq!(xy(&machine), [60, 0]);

    let mut machine = reprap();
    machine.ask("$32=1");
    machine.ask("M3 S500");
    machine.ask("M204 S200");
    assert_eq!(
        machine.session().interpreter().modal().spindle,
        Spindle::Clockwise
    );
    machine.ask("G1 X5 F600");
    assert_ne!(machine.outputs().duty, 0);
}

#[test]
fn a_laser_mode_that_a_hold_overtakes_switches_the_spindle_off() {
    let mut machine = reprap();
    machine.ask("M3 S500");
    assert_ne!(machine.outputs().duty, 0);
    // Both are read in one run of the interpreter, before the machine holds.
    machine.set_baud(115_200);
    machine.send_for("!$32=1\n", 100);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.session().settings().laser);
    assert_eq!(machine.outputs().duty, 0);
    machine.send("~");
    machine.run_to_standstill();
    assert_eq!((machine.state(), machine.outputs().duty), (State::Idle, 0));
}

#[test]
fn limits_are_lowered_until_a_reset() {
    let mut machine = reprap();
    assert_begins(&mut machine, "M203", "echo:M203 X100.000 Y100.000 Z100.000");
    assert_eq!(first(&mut machine, "M203 X10 Y500"), "");
    assert_begins(&mut machine, "M203", "echo:M203 X10.000 Y100.000 Z100.000");
    let slow = seconds(&mut machine, "G1 X50 F6000");
    assert!((5.0..5.3).contains(&slow), "{slow}");
    assert_eq!(first(&mut machine, "M204 S50"), "");
    assert_begins(&mut machine, "M201", "echo:M201 X50.000 Y50.000 Z50.000");
    for (line, expected) in [
        ("M92 X10", "echo:use $100"),
        ("M205 X8.00 Y8.00", "echo:use $11"),
        ("M205", "echo:M205 J0.010"),
        ("M502", "echo:use $RST=$"),
    ] {
        assert_eq!(first(&mut machine, line), expected, "{line}");
    }
    assert_begins(&mut machine, "M92", "echo:M92 X80.000 Y80.000 Z80.000");
    let settings = machine.ask("M503");
    assert!(
        settings.contains(&"echo:$110=6000.000".to_owned()),
        "{settings:?}"
    );
    machine.ask("M999");
    machine.run(50);
    machine.lines();
    assert_begins(&mut machine, "M203", "echo:M203 X100.000 Y100.000 Z100.000");
    let fast = seconds(&mut machine, "G1 X0 F6000");
    assert!((0.6..0.9).contains(&fast), "{fast}");
}

#[test]
fn m220_is_the_feed_override() {
    let mut machine = reprap();
    for percent in [100, 50, 37, 200, 195, 10, 15, 100] {
        assert_eq!(machine.ask(&format!("M220 S{percent}")), ["ok"]);
        machine.run(1);
        let overrides = machine.snapshot().overrides;
        assert_eq!(i32::from(overrides.feed), percent);
    }
}

/// Makes a break on the line, behind which the machine waits for the operator.
fn hold_by_break(machine: &mut Machine) {
    machine.pull_line(true);
    machine.run(100);
    machine.pull_line(false);
    machine.run(30_000);
    assert_eq!(machine.state(), State::HoldComplete);
    let lines = machine.lines();
    let is_break = |line: &String| line.contains("Break on the line");
    assert!(lines.iter().any(is_break), "{lines:?}");
}

#[test]
fn a_pause_with_a_time_waits_for_the_operator_after_a_break_on_the_line() {
    let mut machine = reprap();
    machine.send_for(b"M0 S2\nG1 X1 F6000\n", 100);
    hold_by_break(&mut machine);
    assert_eq!(xy_mm(&machine), [0, 0]);
    machine.ask("M108");
    assert_eq!(xy_mm(&machine), [1, 0]);
}

#[test]
fn lines_behind_m410_wait_for_the_operator_after_a_break_on_the_line() {
    let mut machine = reprap();
    machine.send_for(b"G1 X50 F500\n", 2500);
    machine.send_for(b"M410\nG1 X0 F500\nG1 X5\n", 10);
    hold_by_break(&mut machine);
    machine.ask("M108");
    assert_eq!(xy_mm(&machine), [5, 0]);
}

#[test]
fn a_pause_with_a_time_ends_by_itself() {
    let mut machine = reprap();
    machine.send_for(b"M0 S2\nG1 X1 F6000\n", 1900);
    assert_eq!(xy_mm(&machine), [0, 0]);
    machine.run(600);
    assert_eq!(xy_mm(&machine), [1, 0]);
    machine.send_for(b"M0 P500\nG1 X2\n", 400);
    assert_eq!(xy_mm(&machine), [1, 0]);
    machine.run_to_standstill();
    assert_eq!(xy_mm(&machine), [2, 0]);
}

#[test]
fn drivers_are_switched_at_standstill() {
    let mut machine = reprap_with(&["1=255"]);
    machine.ask("M84");
    assert!(!machine.outputs().drivers);
    machine.ask("M17");
    machine.run(5000);
    assert!(machine.outputs().drivers);
    machine.send(b"G1 X10 F6000\nM18 X Y\n");
    machine.run_to_standstill();
    assert_eq!(xy_mm(&machine), [10, 0]);
    assert!(!machine.outputs().drivers);
}

#[test]
fn m84_s_sets_the_time_of_standstill_up_to_a_reset() {
    let mut machine = reprap_with(&["1=25"]);
    assert_eq!(machine.ask("M84 S2"), ["ok"]);
    for x in [1, 2] {
        machine.send_for(format!("G1 X{x} F6000\n"), 1900);
        assert!(machine.outputs().drivers, "{x}");
    }
    machine.run(500);
    assert_eq!(machine.lines(), ["ok", "ok"]);
    assert!(!machine.outputs().drivers);
    assert_eq!(machine.ask("M84 S0"), ["ok"]);
    machine.ask("G1 X3");
    machine.run(40_000);
    assert!(machine.outputs().drivers, "0 is never, as in Marlin");
    machine.ask("M18");
    assert!(!machine.outputs().drivers);
    machine.ask("M999");
    machine.run(100);
    machine.lines();
    machine.ask("G1 X4 F6000");
    machine.run(100);
    assert!(!machine.outputs().drivers, "$1 counts again");
    assert_eq!(
        first(&mut machine, "M84 S70000"),
        "Error:the value is outside its range (error:39)"
    );
}

#[test]
fn switches_and_positions_are_reported() {
    let mut machine = reprap_with(&["23=1"]);
    let answer = machine.ask("M119");
    assert_eq!(
        answer[..3],
        ["Reporting endstop status", "x_min: open", "y_max: open"]
    );
    machine.ask("M154 S1");
    machine.run(2500);
    let lines = machine.lines();
    assert_eq!(lines.len(), 2, "{lines:?}");
    assert!(lines[0].starts_with("X:0.000 Y:0.000 Z:0.000 E:0.000 Count X:0"));
    machine.ask("M154 S0");
    machine.run(2500);
    assert!(machine.lines().is_empty());
    assert_eq!(
        machine.ask(&numbered(1, "M20")),
        ["Begin file list", "End file list", "ok"]
    );
}

#[test]
fn g0_is_dark_in_laser_mode() {
    let mut machine = reprap_with(&["32=1"]);
    machine.ask("M3 S500");
    machine.send_for(b"G1 X10 F600\n", 500);
    assert!(machine.outputs().duty > 0);
    machine.run_to_standstill();
    machine.send_for(b"G0 X50\n", 200);
    assert_eq!(machine.outputs().duty, 0);
    machine.run_to_standstill();
    machine.send_for(b"G1 X0 S0 F600\n", 500);
    assert_eq!(machine.outputs().duty, 0);
}
