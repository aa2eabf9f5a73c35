//! The homing cycle on a machine with switches: its end position, its duration, its failures.

use crate::support::{Cell, cases, check_limits, fast};
use leadscrew::{
    axis::{AXES, Axes, X, Y, Z},
    model::{Alarm, Levels, Spindle, State},
    path::Work,
    settings::Settings,
    sim::Closes,
};
use proptest::prelude::*;

/// As the recorded machine is set: 80 steps/mm, 5000 mm/min, 500 mm/s².
fn machine() -> Settings {
    Settings {
        homing: 1,
        homing_seek_mm_min: 2000.0,
        homing_feed_mm_min: 200.0,
        ..fast()
    }
}

/// Mounts a switch for each of the first three axes so many steps away.
fn mount(cell: &mut Cell, settings: &Settings, distance: [i32; 3]) {
    for (axis, distance) in distance.into_iter().enumerate() {
        let closes = if settings.homing_direction >> axis & 1 == 0 {
            Closes::From(distance)
        } else {
            Closes::DownFrom(-distance)
        };
        cell.mount(axis, closes, Levels::limits(1 << axis));
    }
}

/// Homes and tells how long it took, s.
fn home(cell: &mut Cell, axes: u8) -> f64 {
    let begin = cell.seconds();
    cell.send(Work::Home(axes));
    assert_eq!(cell.state(), State::Home);
    cell.run_to_end();
    cell.seconds() - begin
}

#[test]
fn every_axis_ends_a_pull_off_from_its_switch() {
    for homing_direction in 0..8 {
        let settings = Settings {
            homing_direction,
            ..machine()
        };
        let mut cell = Cell::new(&settings);
        let distance = [1600, 1200, 800];
        mount(&mut cell, &settings, distance);
        home(&mut cell, 0);
        assert_eq!(cell.state(), State::Idle);
        assert_eq!(cell.alarms(), []);
        for (axis, distance) in distance.into_iter().enumerate() {
            let is_negative = homing_direction >> axis & 1 != 0;
            let (home, sign) = if is_negative {
                ((-200 + 1) * 80, -1)
            } else {
                (-80, 1)
            };
            assert_eq!(cell.snapshot().steps[axis], home, "axis {axis}");
            assert_eq!(cell.physical()[axis], sign * (distance - 80), "axis {axis}");
        }
        cell.trace.check_pulses();
        check_limits(&settings, &cell.trace);
        // The machine goes on from there.
        cell.router.set_steps(cell.snapshot().steps);
        let before = cell.physical();
        cell.go(&[-10.0, -10.0, -10.0], 2000.0);
        cell.run_to_end();
        assert_eq!(cell.snapshot().steps[X], -800);
        let moved = cell.physical()[X] - before[X];
        let home = if homing_direction & 1 == 0 {
            -80
        } else {
            -199 * 80
        };
        assert_eq!(moved, -800 - home);
    }
}

#[test]
fn a_cycle_takes_as_long_as_with_grbl() {
    // t095 and t101 of the recorded sessions.
    for (seek_mm_min, recorded_s) in [(2000.0, 3.974), (1000.0, 4.855)] {
        let settings = Settings {
            homing_seek_mm_min: seek_mm_min,
            ..machine()
        };
        let mut cell = Cell::new(&settings);
        mount(&mut cell, &settings, [1600, 1200, 800]);
        let seconds = home(&mut cell, 0);
        assert!((seconds - recorded_s).abs() < 0.05, "{seconds} s");
    }
}

#[test]
fn an_axis_that_finds_its_switch_slows_no_other_down() {
    let settings = machine();
    let mut cell = Cell::new(&settings);
    mount(&mut cell, &settings, [800, 1600, 800]);
    home(&mut cell, 1 << X | 1 << Y);
    let farthest = cell
        .trace
        .steps(X)
        .into_iter()
        .max_by_key(|step| step.position);
    let stopped_s = farthest.map(|step| step.seconds).unwrap();
    let y = cell.trace.steps(Y);
    // Twice as long as X takes to brake from 2000 mm/min.
    let around: Vec<_> = (y.windows(2))
        .filter(|pair| (pair[0].seconds - stopped_s).abs() < 0.067)
        .collect();
    assert!(around.len() > 300, "{} steps", around.len());
    for pair in around {
        let period_s = pair[1].seconds - pair[0].seconds;
        assert!(
            (period_s * 2000.0 / 60.0 * 80.0 - 1.0).abs() < 0.02,
            "{period_s} s"
        );
    }
}

#[test]
fn the_slowest_homing_speed_is_kept() {
    let settings = Settings {
        homing_seek_mm_min: 1.0,
        ..machine()
    };
    let mut cell = Cell::new(&settings);
    mount(&mut cell, &settings, [1600, 1200, 800]);
    cell.send(Work::Home(0));
    cell.run_ms(6000);
    assert_eq!(cell.physical()[Z], 8);
    check_limits(&settings, &cell.trace);
}

#[test]
fn a_locked_machine_does_not_move() {
    let mut cell = Cell::new(&machine());
    assert_eq!(cell.state(), State::Alarm);
    cell.go(&[3.0], 2000.0);
    cell.run_to_end();
    assert_eq!(cell.physical(), Axes::all(0));
}

#[test]
fn a_laser_is_dark_while_homing() {
    let settings = Settings {
        laser: true,
        ..machine()
    };
    let mut cell = Cell::new(&settings);
    mount(&mut cell, &settings, [1600, 1200, 800]);
    cell.send(Work::Unlock);
    cell.send(Work::Spindle(Spindle::Clockwise, 500.0));
    assert_ne!(cell.drive.outputs().duty, 0);
    cell.send(Work::Home(0));
    cell.run_until(|cell| cell.physical()[Z] > 100);
    assert_eq!(cell.drive.outputs().duty, 0);
    assert_eq!(cell.drive.outputs().spindle, Spindle::Off);
}

#[test]
fn a_single_axis_leaves_the_others_where_they_are() {
    let settings = machine();
    let mut cell = Cell::new(&settings);
    mount(&mut cell, &settings, [1600, 1200, 800]);
    cell.send(Work::Unlock);
    cell.go(&[3.0, 4.0, 5.0], 2000.0);
    cell.run_to_end();
    home(&mut cell, 1 << Y);
    assert_eq!(cell.snapshot().steps.0[..3], [240, -80, 400]);
    assert_eq!(cell.physical().0[..3], [240, 1120, 400]);
    home(&mut cell, 1 << X | 1 << Z);
    assert_eq!(cell.snapshot().steps.0[..3], [-80; 3]);
    assert_eq!(cell.physical().0[..3], [1520, 1120, 720]);
}

#[test]
fn the_position_is_live_and_a_hold_changes_nothing() {
    let settings = machine();
    let mut cell = Cell::new(&settings);
    mount(&mut cell, &settings, [1600, 1200, 800]);
    cell.send(Work::Home(0));
    cell.run_ms(200);
    cell.byte(b'!');
    for _ in 0..5 {
        cell.run_ms(20);
        assert_eq!(cell.state(), State::Home);
        let (reported, physical) = (cell.snapshot().steps[Z], cell.physical()[Z]);
        assert!(
            reported > 200 && (reported - physical).abs() < 8,
            "{reported} {physical}"
        );
    }
    cell.run_to_end();
    assert_eq!(cell.state(), State::Idle);
}

#[test]
fn a_switch_that_is_not_there_is_alarm_9() {
    let settings = Settings {
        max_travel_mm: Axes::all(50.0),
        ..machine()
    };
    let mut cell = Cell::new(&settings);
    home(&mut cell, 0);
    assert_eq!(cell.state(), State::Alarm);
    assert_eq!(cell.alarms(), [Alarm::HomingNotFound]);
    assert_eq!(cell.snapshot().steps.0[..3], [0, 0, 6000]);
    assert_eq!(cell.physical()[Z], 6000);
    // It can be unlocked, and moved.
    cell.send(Work::Unlock);
    cell.router.set_steps(cell.snapshot().steps);
    cell.go(&[0.0, 0.0, 0.0], 2000.0);
    cell.run_to_end();
    assert_eq!(cell.physical()[Z], 0);
}

#[test]
fn a_switch_that_stays_closed_is_alarm_8() {
    // Behind the search, and behind the approach that follows it.
    for closings in [&[true][..], &[true, false, true]] {
        let settings = machine();
        let mut cell = Cell::new(&settings);
        mount(&mut cell, &settings, [1600, 1200, 800]);
        cell.send(Work::Home(1 << X));
        for is_closed in closings {
            cell.run_until(|cell| cell.snapshot().inputs.has(Levels::LIMITS) == *is_closed);
        }
        cell.set_pin(Levels::limits(1 << X), true);
        cell.run_to_end();
        assert_eq!(cell.state(), State::Alarm);
        assert_eq!(cell.alarms(), [Alarm::HomingPullOff]);
        assert_eq!(cell.snapshot().steps, cell.physical());
        assert_eq!(cell.physical()[X], 1520);
    }
}

#[test]
fn a_switch_that_does_not_close_again_is_alarm_9() {
    let settings = machine();
    let mut cell = Cell::new(&settings);
    cell.set_pin(Levels::limits(1 << X), false);
    cell.send(Work::Home(1 << X));
    cell.run_ms(300);
    cell.set_pin(Levels::limits(1 << X), true);
    cell.run_ms(100);
    cell.set_pin(Levels::limits(1 << X), false);
    cell.run_to_end();
    assert_eq!(cell.alarms(), [Alarm::HomingNotFound]);
    assert_eq!(cell.snapshot().steps, cell.physical());
}

#[test]
fn reset_and_door_slow_down_and_keep_the_position() {
    for (byte, alarm) in [(0x18, Alarm::HomingReset), (0x84, Alarm::HomingDoor)] {
        // In the search, in the first pull-off, in a pause, in the locating approach.
        for ms in [100, 300, 650, 700, 1100] {
            let settings = machine();
            let mut cell = Cell::new(&settings);
            mount(&mut cell, &settings, [1600, 1200, 800]);
            cell.send(Work::Home(0));
            cell.run_ms(ms);
            assert_eq!(cell.state(), State::Home);
            cell.byte(byte);
            assert_eq!(cell.alarms(), [alarm], "{ms} ms");
            assert_eq!(cell.state(), State::Alarm);
            assert!(!cell.snapshot().reset_in_motion);
            cell.run_to_end();
            assert_eq!(cell.snapshot().steps, cell.physical());
            assert_eq!(cell.state(), State::Alarm);
            cell.trace.check_pulses();
            check_limits(&settings, &cell.trace);
        }
    }
}

#[test]
fn the_door_pin_ends_homing() {
    let settings = machine();
    let mut cell = Cell::new(&settings);
    mount(&mut cell, &settings, [1600, 1200, 800]);
    cell.send(Work::Home(0));
    cell.run_ms(100);
    cell.set_pin(Levels::DOOR, true);
    cell.run_to_end();
    assert_eq!(cell.alarms(), [Alarm::HomingDoor]);
}

#[test]
fn hard_limits_are_off_while_homing_and_on_again_after_it() {
    let settings = Settings {
        hard_limits: true,
        ..machine()
    };
    let mut cell = Cell::new(&settings);
    mount(&mut cell, &settings, [1600, 1200, 800]);
    home(&mut cell, 0);
    assert_eq!(cell.alarms(), []);
    assert_eq!(cell.state(), State::Idle);
    cell.router.set_steps(cell.snapshot().steps);
    cell.go(&[5.0, -1.0, -1.0], 600.0);
    cell.run_until(|cell| cell.state() == State::Alarm);
    assert_eq!(cell.alarms(), [Alarm::HardLimit]);
}

#[test]
fn inverted_switches_home_as_well() {
    let settings = Settings {
        limit_invert: true,
        ..machine()
    };
    let mut cell = Cell::new(&settings);
    // A closed contact is inactive: switches open at their end.
    for axis in 0..AXES {
        cell.mount(axis, Closes::DownFrom(799), Levels::limits(1 << axis));
    }
    cell.run_ms(1);
    assert_eq!(cell.snapshot().inputs, Levels::NONE);
    home(&mut cell, 0);
    assert_eq!(cell.alarms(), []);
    assert_eq!(cell.snapshot().steps.0[..3], [-80; 3]);
    assert_eq!(cell.physical().0[..3], [720; 3]);
}

proptest! {
    #![proptest_config(cases(6))]

    #[test]
    fn any_machine_comes_home(
        distance in prop::array::uniform3(50_i32..4000),
        direction in 0_u8..8,
        seek in 100.0_f32..5000.0,
        feed in 20.0_f32..400.0,
        rate in prop::array::uniform3(500.0_f32..5000.0),
        acceleration in prop::array::uniform3(20.0_f32..2000.0),
        pull_off in 0.5_f32..5.0,
        debounce in 0_u8..,
    ) {
        let settings = Settings {
            homing_direction: direction,
            homing_seek_mm_min: seek,
            homing_feed_mm_min: feed,
            homing_pull_off_mm: pull_off,
            homing_debounce_ms: debounce,
            max_rate_mm_min: Axes::from_fn(|axis| rate[axis % 3]),
            acceleration_mm_s2: Axes::from_fn(|axis| acceleration[axis % 3]),
            ..machine()
        };
        let mut cell = Cell::new(&settings);
        mount(&mut cell, &settings, distance);
        home(&mut cell, 0);
        prop_assert_eq!(cell.alarms(), []);
        let pull_off_steps = (pull_off * 80.0).round() as i32;
        for (axis, distance) in distance.into_iter().enumerate() {
            let sign = if direction >> axis & 1 == 0 { 1 } else { -1 };
            prop_assert_eq!(cell.physical()[axis], sign * (distance - pull_off_steps));
        }
        cell.trace.check_pulses();
        check_limits(&settings, &cell.trace);
    }
}

#[test]
fn axes_by_marks_home_where_they_stand() {
    for (homing_direction, homing_marks) in [(0, 0b100), (0b100, 0b110), (0b001, 0b001)] {
        let settings = Settings {
            homing_direction,
            homing_marks,
            ..machine()
        };
        let mut cell = Cell::new(&settings);
        mount(&mut cell, &settings, [1600, 1200, 800]);
        home(&mut cell, 0);
        assert_eq!((cell.state(), cell.alarms()), (State::Idle, vec![]));
        for axis in [X, Y, Z] {
            let is_marked = homing_marks >> axis & 1 != 0;
            let is_negative = homing_direction >> axis & 1 != 0;
            let pull_off = if is_marked {
                0.0
            } else {
                settings.homing_pull_off_mm
            };
            let mm = if is_negative {
                pull_off - settings.max_travel_mm[axis]
            } else {
                -pull_off
            };
            assert_eq!(
                cell.snapshot().steps[axis],
                (mm * 80.0).round() as i32,
                "axis {axis}"
            );
            let has_moved = !cell.trace.steps(axis).is_empty();
            assert_eq!(has_moved, !is_marked, "axis {axis}");
        }
    }
}

#[test]
fn a_machine_without_any_switch_homes_by_marks() {
    let settings = Settings {
        homing_marks: 0b111,
        ..machine()
    };
    let mut cell = Cell::new(&settings);
    cell.send(Work::Home(0));
    cell.run_to_end();
    assert_eq!((cell.state(), cell.alarms()), (State::Idle, vec![]));
    assert_eq!(cell.snapshot().steps.0[..3], [0, 0, 0]);
}
