//! Axes with two motors and a switch at each: where homing leaves both motors, and how homing fails.

use leadscrew::{
    axis::{AXES, X, Y, Z},
    model::Levels,
    settings::Settings,
    sim::{Closes, Simulator, Switch},
};
use proptest::prelude::*;

use crate::support::{Machine, cases, fast};

/// Steps per mm of every axis.
const PER_MM: i32 = 80;
/// Steps from power-up to the switches.
const AWAY: i32 = 20 * PER_MM;
/// What homing leaves between switch and axis, steps.
const PULL_OFF: i32 = PER_MM;

fn settings() -> Settings {
    Settings {
        homing: 1,
        homing_seek_mm_min: 2000.0,
        homing_feed_mm_min: 200.0,
        ..fast()
    }
}

/// Returns a machine of which some axes have two motors, the second some steps ahead, with switches at both ends of
/// each gantry.
fn gantry(settings: &Settings, axes: u8, ahead: i32) -> Machine {
    let mut machine = Machine::of(Simulator::ganged(settings, axes));
    let others = Levels::limits(((1 << AXES) - 1) & !0b111);
    machine.set_pin(others, settings.limit_invert);
    for axis in [X, Y, Z] {
        let closes = closes(settings, axis);
        machine.mount(axis, closes, Levels::limits(1 << axis));
        if axes >> axis & 1 != 0 {
            let second = Switch {
                axis,
                closes,
                input: Levels::second_limits(1 << axis),
            };
            assert!(machine.mount_second(second));
            machine.skew(axis, ahead);
        }
    }
    machine.run(100);
    machine.received.clear();
    machine
}

/// Returns how far both motors of an axis are from their switch, away from it, steps.
fn distances(machine: &Machine, axis: usize) -> [i32; 2] {
    let settings = machine.session().settings();
    let sign = if is_negative(settings, axis) { -1 } else { 1 };
    let motors = [machine.physical_steps(), machine.second_steps()];
    motors.map(|steps| AWAY - sign * steps[axis])
}

/// Returns how far the second motor of an axis is ahead of the first, steps.
fn ahead(machine: &Machine, axis: usize) -> i32 {
    machine.second_steps()[axis] - machine.physical_steps()[axis]
}

fn is_negative(settings: &Settings, axis: usize) -> bool {
    settings.homing_direction >> axis & 1 != 0
}

/// Returns where the contact at the end of an axis is closed: with `$5=1` everywhere but at the end.
fn closes(settings: &Settings, axis: usize) -> Closes {
    match (is_negative(settings, axis), settings.limit_invert) {
        (true, false) => Closes::DownFrom(-AWAY),
        (true, true) => Closes::From(1 - AWAY),
        (false, false) => Closes::From(AWAY),
        (false, true) => Closes::DownFrom(AWAY - 1),
    }
}

#[test]
fn a_gantry_skewed_by_3_mm_ends_square_within_a_step() {
    for (homing_direction, skew) in [(0, 240), (0, -240), (0b111, 240), (0b111, -240)] {
        let settings = Settings {
            homing_direction,
            ..settings()
        };
        let mut machine = gantry(&settings, 1 << Y, skew);
        assert_eq!(machine.ask("$H"), ["ok"]);
        for distance in distances(&machine, Y) {
            assert!((distance - PULL_OFF).abs() <= 1, "{distance} steps");
        }
        assert!(
            ahead(&machine, Y).abs() <= 1,
            "{} steps",
            ahead(&machine, Y)
        );
        assert_eq!(distances(&machine, X)[0], PULL_OFF);
        assert_eq!(distances(&machine, Z)[0], PULL_OFF);
        let home = if homing_direction == 0 { "-1" } else { "-199" };
        let position = format!("{home}.000,{home}.000,{home}.000");
        assert_eq!(machine.report().xyz(), Some(&*position));
        // From there on both move as one.
        let before = distances(&machine, Y);
        assert_eq!(machine.ask("G53G0Y-50"), ["ok"]);
        let moved = distances(&machine, Y);
        assert_eq!(moved[0] - before[0], moved[1] - before[1]);
        assert_ne!(moved, before);
    }
}

#[test]
fn a_square_gantry_is_homed_as_fast_as_an_axis_with_one_motor() {
    let seconds = |axes| {
        let mut machine = gantry(&settings(), axes, 0);
        let begin = machine.seconds();
        assert_eq!(machine.ask("$H"), ["ok"]);
        machine.seconds() - begin
    };
    assert_eq!(seconds(0b11), seconds(0));
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn gantries_end_square_however_they_are_skewed(
        ahead in -9 * PER_MM..9 * PER_MM,
        homing_direction in 0_u8..8,
        axes in 1_u8..8,
        seek_mm_min in 200.0_f32..3000.0,
        limit_invert: bool,
    ) {
        let settings = Settings {
            homing_direction,
            homing_seek_mm_min: seek_mm_min,
            limit_invert,
            ..settings()
        };
        let mut machine = gantry(&settings, axes, ahead);
        prop_assert_eq!(machine.ask("$H"), ["ok"]);
        for axis in [X, Y, Z] {
            let [first, second] = distances(&machine, axis);
            prop_assert!((first - PULL_OFF).abs() <= 1, "axis {}: {}", axis, first);
            if axes >> axis & 1 != 0 {
                prop_assert!((second - PULL_OFF).abs() <= 1, "axis {}: {}", axis, second);
            }
        }
    }
}

/// Homes a gantry until one of its motors moves alone, the second with the sign of `skew`.
fn begin_squaring(skew: i32) -> Machine {
    let mut machine = gantry(&settings(), 1 << Y, skew);
    machine.send("$H\n");
    machine.run_until(|machine| ahead(machine, Y) != skew);
    machine
}

/// After a cycle that has failed, both motors move as one.
fn check_both_follow(machine: &mut Machine) {
    let skew = ahead(machine, Y);
    let before = distances(machine, Y);
    assert!(machine.exchange("$X\n").ends_with("ok\r\n"));
    assert_eq!(machine.ask("$J=G91Y-5F1000"), ["ok"]);
    assert_eq!(distances(machine, Y)[0], before[0] + 5 * PER_MM);
    assert_eq!(ahead(machine, Y), skew);
}

#[test]
fn a_gantry_that_is_skewed_too_much_is_alarm_10() {
    // A twentieth of the travel of 200 mm.
    for ahead in [-10, 10] {
        let within = ahead * PER_MM - ahead.signum();
        assert_eq!(gantry(&settings(), 1 << Y, within).ask("$H"), ["ok"]);
        let mut machine = gantry(&settings(), 1 << Y, ahead * PER_MM + ahead.signum());
        let answer = machine.exchange("$H\n");
        assert!(answer.contains("ALARM:10"), "{answer}");
        check_both_follow(&mut machine);
    }
}

#[test]
fn a_reset_while_one_motor_moves_alone_leaves_none_of_them_out() {
    for skew in [-400, 400] {
        let mut machine = begin_squaring(skew);
        machine.run(20);
        machine.send_for("\x18", 2000);
        let received = machine.take_received();
        assert!(received.contains("ALARM:6"), "{received}");
        assert_ne!(ahead(&machine, Y), skew);
        check_both_follow(&mut machine);
        assert_eq!(machine.ask("$J=G91X-5F1000"), ["ok"]);
        assert_eq!(machine.ask("$H"), ["ok"]);
        assert!(
            ahead(&machine, Y).abs() <= 1,
            "{} steps",
            ahead(&machine, Y)
        );
    }
}

#[test]
fn the_switch_of_a_second_motor_is_one_of_its_axis() {
    let settings = Settings {
        hard_limits: true,
        ..settings()
    };
    let mut machine = gantry(&settings, 1 << Y, 0);
    assert_eq!(machine.ask("$H"), ["ok"]);
    machine.set_pin(Levels::second_limits(1 << Y), true);
    machine.run(10);
    let received = machine.take_received();
    assert!(received.contains("ALARM:1\r\n"), "{received}");
    assert_eq!(machine.report().field("Pn"), Some("Y"));
    let received = machine.exchange("\x18$H\n");
    assert!(received.contains("error:203"), "{received}");
}
