//! `G1 S1`: up to a limit switch.

use leadscrew::{
    axis::{X, Y},
    model::{Levels, State},
    sim::Closes,
};

use crate::{
    machine::{STEPS_PER_MM, reprap_with, xy},
    support::Machine,
};

/// Where the switch of X closes, steps.
const CLOSES_AT: i32 = 5 * STEPS_PER_MM;

/// A machine with a limit switch at 5 mm of an axis.
fn with_switch(axis: usize, more: &[&str]) -> Machine {
    let mut machine = reprap_with(more);
    machine.mount(axis, Closes::From(CLOSES_AT), Levels::limits(1 << axis));
    machine
}

/// What `M114` answers about X.
fn reported_x(machine: &mut Machine) -> String {
    let answer = machine.ask("M114");
    let (x, _) = answer[0].split_once(" Y:").expect("a Y");
    x.to_owned()
}

#[test]
fn s1_ends_at_the_switch() {
    for more in [&[][..], &["21=1"]] {
        let mut machine = with_switch(X, more);
        assert_eq!(machine.ask("G1 S1 X50 Y10 F3000"), ["ok"]);
        assert_eq!(machine.state(), State::Idle);
        let [x, y] = xy(&machine);
        // 50 mm/s at 500 mm/s² need 2.5 mm; the filter and what is prepared take 1 mm.
        let beyond = x - CLOSES_AT;
        assert!((STEPS_PER_MM..4 * STEPS_PER_MM).contains(&beyond), "{x}");
        assert!((y * 5 - x).abs() <= 5, "on the line: {x} {y}");
        let mm = f64::from(x) / f64::from(STEPS_PER_MM);
        assert_eq!(reported_x(&mut machine), format!("X:{mm:.3}"));
        // The program goes on from there, and the switch is no more of interest.
        assert_eq!(machine.ask("G1 X2 Y1"), ["ok"]);
        assert_eq!(xy(&machine), [2 * STEPS_PER_MM, STEPS_PER_MM]);
    }
}

#[test]
fn s1_without_a_contact_ends_at_its_target() {
    let mut machine = with_switch(Y, &[]);
    assert_eq!(machine.ask("G1 S1 X1.2345 F3000"), ["ok"]);
    assert_eq!(reported_x(&mut machine), "X:1.235");
    // Exactly there: twice as far is no step off.
    assert_eq!(machine.ask("G91"), ["ok"]);
    assert_eq!(machine.ask("G0 S1 X1.2345"), ["ok"]);
    assert_eq!(xy(&machine), [198, 0]);
    // The end of the move, and no way at all.
    for line in ["G1 S1 X0", "G1 S1", "G1 S1 F900"] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    assert_eq!(xy(&machine), [198, 0]);
}

#[test]
fn a_switch_that_is_closed_keeps_its_axis_from_moving_by_s1() {
    let mut machine = with_switch(X, &[]);
    assert_eq!(machine.ask("G1 X6 F3000"), ["ok"]);
    for line in ["G1 S1 X50", "G1 S1 X0 Y10"] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
        assert_eq!(xy(&machine), [6 * STEPS_PER_MM, 0], "{line}");
        assert_eq!(reported_x(&mut machine), "X:6.000", "{line}");
    }
    // The switch of an axis that stays does not matter.
    assert_eq!(machine.ask("G1 S1 Y10"), ["ok"]);
    assert_eq!(xy(&machine), [6 * STEPS_PER_MM, 10 * STEPS_PER_MM]);
}

#[test]
fn hard_limits_guard_what_s1_does_not_move_and_what_follows() {
    let limit = "Error:Printer stopped due to errors. a limit switch closed: the position is lost \
        (ALARM:1); M999 to go on";
    let mut machine = with_switch(X, &["21=1"]);
    machine.send_for(b"G1 S1 Y50 F3000\n", 200);
    machine.set_pin(Levels::limits(1), true);
    assert_eq!(machine.answers(), [limit, "ok"]);
    assert_eq!(machine.state(), State::Alarm);
    for ending in [&b""[..], b"M410\n"] {
        let mut machine = with_switch(X, &["21=1"]);
        machine.send_for(b"G1 S1 X50 F3000\n", 50);
        machine.send(ending);
        machine.run_to_standstill();
        machine.lines();
        assert_eq!(machine.state(), State::Idle);
        assert_eq!(machine.ask("G1 X0"), ["ok"]);
        assert_eq!(machine.ask("G1 X50"), ["ok", limit]);
        assert_eq!(machine.state(), State::Alarm);
    }
}

#[test]
fn s1_takes_no_e_no_arc_and_is_the_power_of_a_laser() {
    let mut machine = with_switch(X, &[]);
    let unused = "Error:no command uses one of the value words (error:36)";
    assert_eq!(machine.ask("G1 S1 X9 E1"), [unused, "ok"]);
    let unknown = "echo:Unknown command: \"G2 S1 X9 Y9 I9\"";
    assert_eq!(machine.ask("G2 S1 X9 Y9 I9"), [unknown, "ok"]);
    assert_eq!(xy(&machine), [0, 0]);
    let mut machine = with_switch(X, &["32=1"]);
    assert_eq!(machine.ask("G1 S1 X9 F3000"), ["ok"]);
    assert_eq!(xy(&machine), [9 * STEPS_PER_MM, 0]);
}
