//! `G1 S1`: up to a limit switch.

use leadscrew::{
    axis::{X, Y},
    model::{Levels, State},
    sim::{Closes, Switch},
};

use crate::host::{Host, STEPS_PER_MM};

/// Where the switch of X closes, steps.
const CLOSES_AT: i32 = 5 * STEPS_PER_MM;

/// A machine with a limit switch at 5 mm of an axis.
fn with_switch(axis: usize, more: &[&str]) -> Host {
    let mut host = Host::with(more);
    let is_mounted = host.simulator.mount(Switch {
        axis,
        closes: Closes::From(CLOSES_AT),
        input: Levels::limits(1 << axis),
    });
    assert!(is_mounted);
    host
}

/// What `M114` answers about X.
fn reported_x(host: &mut Host) -> String {
    let answer = host.ask("M114");
    let (x, _) = answer[0].split_once(" Y:").expect("a Y");
    x.to_owned()
}

#[test]
fn s1_ends_at_the_switch() {
    for more in [&[][..], &["21=1"]] {
        let mut host = with_switch(X, more);
        assert_eq!(host.ask("G1 S1 X50 Y10 F3000"), ["ok"]);
        assert_eq!(host.state(), State::Idle);
        let [x, y] = host.xy();
        // 50 mm/s at 500 mm/s² need 2.5 mm; the filter and what is prepared take 1 mm.
        let beyond = x - CLOSES_AT;
        assert!((STEPS_PER_MM..4 * STEPS_PER_MM).contains(&beyond), "{x}");
        assert!((y * 5 - x).abs() <= 5, "on the line: {x} {y}");
        let mm = f64::from(x) / f64::from(STEPS_PER_MM);
        assert_eq!(reported_x(&mut host), format!("X:{mm:.3}"));
        // The program goes on from there, and the switch is no more of interest.
        assert_eq!(host.ask("G1 X2 Y1"), ["ok"]);
        assert_eq!(host.xy(), [2 * STEPS_PER_MM, STEPS_PER_MM]);
    }
}

#[test]
fn s1_without_a_contact_ends_at_its_target() {
    let mut host = with_switch(Y, &[]);
    assert_eq!(host.ask("G1 S1 X1.2345 F3000"), ["ok"]);
    assert_eq!(reported_x(&mut host), "X:1.235");
    // Exactly there: twice as far is no step off.
    assert_eq!(host.ask("G91"), ["ok"]);
    assert_eq!(host.ask("G0 S1 X1.2345"), ["ok"]);
    assert_eq!(host.xy(), [198, 0]);
    // The end of the move, and no way at all.
    for line in ["G1 S1 X0", "G1 S1", "G1 S1 F900"] {
        assert_eq!(host.ask(line), ["ok"], "{line}");
    }
    assert_eq!(host.xy(), [198, 0]);
}

#[test]
fn a_switch_that_is_closed_keeps_its_axis_from_moving_by_s1() {
    let mut host = with_switch(X, &[]);
    assert_eq!(host.ask("G1 X6 F3000"), ["ok"]);
    for line in ["G1 S1 X50", "G1 S1 X0 Y10"] {
        assert_eq!(host.ask(line), ["ok"], "{line}");
        assert_eq!(host.xy(), [6 * STEPS_PER_MM, 0], "{line}");
        assert_eq!(reported_x(&mut host), "X:6.000", "{line}");
    }
    // The switch of an axis that stays does not matter.
    assert_eq!(host.ask("G1 S1 Y10"), ["ok"]);
    assert_eq!(host.xy(), [6 * STEPS_PER_MM, 10 * STEPS_PER_MM]);
}

#[test]
fn hard_limits_guard_what_s1_does_not_move_and_what_follows() {
    let limit = "Error:Printer stopped due to errors. a limit switch closed: the position is lost \
        (ALARM:1); M999 to go on";
    let mut host = with_switch(X, &["21=1"]);
    host.receive(b"G1 S1 Y50 F3000\n");
    host.run_ms(200);
    host.simulator.set_pin(Levels::limits(1), true);
    host.rest();
    assert_eq!(host.lines(), [limit, "ok"]);
    assert_eq!(host.state(), State::Alarm);
    for ending in [&b""[..], b"M410\n"] {
        let mut host = with_switch(X, &["21=1"]);
        host.receive(b"G1 S1 X50 F3000\n");
        host.run_ms(50);
        host.receive(ending);
        host.rest();
        host.lines();
        assert_eq!(host.state(), State::Idle);
        assert_eq!(host.ask("G1 X0"), ["ok"]);
        assert_eq!(host.ask("G1 X50"), ["ok", limit]);
        assert_eq!(host.state(), State::Alarm);
    }
}

#[test]
fn s1_takes_no_e_no_arc_and_is_the_power_of_a_laser() {
    let mut host = with_switch(X, &[]);
    let unused = "Error:no command uses one of the value words (error:36)";
    assert_eq!(host.ask("G1 S1 X9 E1"), [unused, "ok"]);
    let unknown = "echo:Unknown command: \"G2 S1 X9 Y9 I9\"";
    assert_eq!(host.ask("G2 S1 X9 Y9 I9"), [unknown, "ok"]);
    assert_eq!(host.xy(), [0, 0]);
    let mut host = with_switch(X, &["32=1"]);
    assert_eq!(host.ask("G1 S1 X9 F3000"), ["ok"]);
    assert_eq!(host.xy(), [9 * STEPS_PER_MM, 0]);
}
