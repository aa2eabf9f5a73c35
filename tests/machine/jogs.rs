//! Jogs that are shortened to the travel, `$40`.

use leadscrew::model::{Levels, State};

use crate::support::Machine;

/// Steps of a millimetre.
const STEPS: i32 = 250;
/// X, Y and Z home where they stand, at the end of a travel of 200 mm.
const MARKS: [&str; 9] = [
    "22=1", "788=7", "110=6000", "111=6000", "112=6000", "120=500", "121=500", "122=500", "40=1",
];

fn machine_with(assignments: &[&str]) -> Machine {
    Machine::new(&[&MARKS, assignments].concat())
}

fn homed(assignments: &[&str]) -> Machine {
    let mut machine = machine_with(assignments);
    assert_eq!(machine.ask("$H"), ["ok"]);
    machine
}

/// Machine position of the axes, steps.
fn position(machine: &Machine) -> [i32; 3] {
    let steps = machine.snapshot().steps;
    [steps[0], steps[1], steps[2]]
}

fn mm(values: [f64; 3]) -> [i32; 3] {
    values.map(|value| (value * f64::from(STEPS)).round() as i32)
}

#[test]
fn a_jog_beyond_the_travel_ends_at_it() {
    for soft_limits in ["20=0", "20=1"] {
        let mut machine = homed(&[soft_limits]);
        for (jog, end) in [
            ("$J=G91 X-50 F5000", [-50.0, 0.0, 0.0]),
            ("$J=G91 X-500 F5000", [-200.0, 0.0, 0.0]),
            ("$J=G91 X500 F5000", [0.0, 0.0, 0.0]),
            ("$J=G90 Z-99999999 F5000", [0.0, 0.0, -200.0]),
            ("$J=G53 Y-500 F5000", [0.0, -200.0, -200.0]),
            ("$J=G53 Y0 F5000", [0.0, 0.0, -200.0]),
            ("$J=G91 G20 Z100 F200", [0.0, 0.0, 0.0]),
            ("$J=G91 G20 Z-1 F200", [0.0, 0.0, -25.4]),
        ] {
            assert_eq!(machine.ask(jog), ["ok"], "{jog}");
            assert_eq!(machine.state(), State::Idle, "{jog}");
            assert_eq!(position(&machine), mm(end), "{jog}");
        }
    }
}

#[test]
fn a_jog_that_is_held_at_the_limit_is_answered_and_does_not_move() {
    let mut machine = homed(&["20=1"]);
    for _ in 0..20 {
        machine.send("$J=G91 X20 Y3 F5000\n");
    }
    let answers = machine.answers();
    assert_eq!(answers, vec!["ok"; 20]);
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(position(&machine), [0; 3]);
    assert_eq!(machine.xyz(), [0; 3]);
}

#[test]
fn a_shortened_jog_keeps_its_direction() {
    let mut machine = homed(&["20=1"]);
    assert_eq!(machine.ask("$J=G90 X-100 Y-100 Z-100 F5000"), ["ok"]);
    // X comes to its end after a fifth, Y after a half.
    assert_eq!(machine.ask("$J=G91 X500 Y-200 Z10 F5000"), ["ok"]);
    assert_eq!(position(&machine), mm([0.0, -140.0, -98.0]));
    // At the wall nothing slides along it; away from it all axes move.
    assert_eq!(machine.ask("$J=G91 X1 Y1 F5000"), ["ok"]);
    assert_eq!(position(&machine), mm([0.0, -140.0, -98.0]));
    assert_eq!(machine.ask("$J=G91 X-1 Y1 F5000"), ["ok"]);
    assert_eq!(position(&machine), mm([-1.0, -139.0, -98.0]));
}

#[test]
fn offsets_and_rotations_change_nothing_of_where_a_jog_ends() {
    let mut machine = homed(&["20=1"]);
    assert_eq!(machine.ask("$J=G90 X-100 Y-100 Z-100 F5000"), ["ok"]);
    for line in ["G10 L2 P1 X-50 Y-50 Z-50 R90", "G92 Y3", "G43.1 Z7"] {
        assert_eq!(machine.ask(line), ["ok"]);
    }
    assert_eq!(machine.ask("$J=G90 Z300 F5000"), ["ok"]);
    assert_eq!(position(&machine), mm([-100.0, -100.0, 0.0]));
    // Work X is along machine Y.
    assert_eq!(machine.ask("$J=G91 X300 F5000"), ["ok"]);
    assert_eq!(position(&machine), mm([-100.0, 0.0, 0.0]));
    // What is programmed next begins there.
    assert_eq!(machine.ask("G91 G0 X-10"), ["ok"]);
    assert_eq!(position(&machine), mm([-100.0, -10.0, 0.0]));
}

#[test]
fn a_jog_that_begins_outside_may_only_come_back() {
    let mut machine = homed(&["20=1"]);
    assert_eq!(machine.ask("G53 G0 X-150"), ["ok"]);
    assert_eq!(machine.ask("$130=100"), ["ok"]);
    for (jog, x) in [
        ("$J=G91 X-10 F5000", -150.0),
        ("$J=G91 X10 F5000", -140.0),
        ("$J=G91 X-5 Y5 F5000", -140.0),
        ("$J=G91 X500 F5000", 0.0),
        ("$J=G91 X-500 F5000", -100.0),
    ] {
        assert_eq!(machine.ask(jog), ["ok"], "{jog}");
        assert_eq!(position(&machine), mm([x, 0.0, 0.0]), "{jog}");
    }
}

#[test]
fn only_axes_that_are_homed_and_have_a_travel_are_limited() {
    // Not homed: as without the setting.
    for (soft_limits, answer, y) in [("20=1", "error:15", 0.0), ("20=0", "ok", 5.0)] {
        let mut machine = machine_with(&[soft_limits]);
        assert_eq!(machine.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
        assert_eq!(machine.ask("$HX"), ["ok"]);
        assert_eq!(machine.ask("$J=G91 Y5 F5000"), [answer]);
        assert_eq!(machine.ask("$J=G91 X5 F5000"), ["ok"]);
        assert_eq!(position(&machine), mm([0.0, y, 0.0]));
    }
    // A travel of 0, as of a rotary axis.
    let mut machine = homed(&["20=1", "130=0"]);
    assert_eq!(machine.ask("$J=G91 X720 F5000"), ["ok"]);
    assert_eq!(machine.ask("$J=G91 X-100 Y7 F5000"), ["ok"]);
    assert_eq!(machine.ask("$J=G91 X-100 F5000"), ["ok"]);
    assert_eq!(position(&machine), mm([620.0, 0.0, 0.0]));
}

#[test]
fn a_jog_keeps_the_pull_off_from_hard_limits() {
    for (homing, directions, ends) in [
        ("22=1", "23=0", [-2.0, -198.0]),
        ("22=1", "23=1", [-2.0, -198.0]),
        ("22=9", "23=0", [0.0, -198.0]),
        ("22=9", "23=1", [198.0, 0.0]),
    ] {
        let settings = [
            homing, directions, "788=6", "21=1", "27=2", "25=3000", "24=600",
        ];
        let mut machine = machine_with(&settings);
        let closes = if directions == "23=0" {
            leadscrew::sim::Closes::From(1000)
        } else {
            leadscrew::sim::Closes::DownFrom(-1000)
        };
        machine.mount(0, closes, Levels::limits(1));
        assert_eq!(machine.ask("$H"), ["ok"]);
        for (jog, end) in ["$J=G91 X500 F5000", "$J=G91 X-500 F5000"]
            .into_iter()
            .zip(ends)
        {
            assert_eq!(machine.ask(jog), ["ok"]);
            assert_eq!(machine.state(), State::Idle, "{homing} {directions} {jog}");
            assert_eq!(
                position(&machine)[0],
                mm([end; 3])[0],
                "{homing} {directions} {jog}"
            );
        }
    }
}

#[test]
fn without_the_setting_a_jog_beyond_the_travel_is_refused() {
    let mut machine = homed(&["20=1", "40=0"]);
    assert_eq!(machine.ask("$J=G91 X-500 F5000"), ["error:15"]);
    assert_eq!(position(&machine), [0; 3]);
}

#[test]
fn shortened_jogs_need_homing_and_end_with_it() {
    let mut machine = Machine::new(&[]);
    assert_eq!(machine.ask("$40=1"), ["error:10"]);
    assert_eq!(machine.ask("$22=1"), ["ok"]);
    assert_eq!(machine.ask("$40=1"), ["ok"]);
    assert!(machine.ask("$+").contains(&"$40=1".to_owned()));
    assert_eq!(machine.ask("$22=0"), ["ok"]);
    assert!(machine.ask("$+").contains(&"$40=0".to_owned()));
}
