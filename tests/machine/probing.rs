//! Probing moves: what they tell, where they end, and what may happen on the way.

use crate::support::{Cell, add_steps, cases, check_limits, fast};
use leadscrew::{
    axis::{Axes, X, Z},
    model::{Alarm, Levels, Notice, Probing, State},
    path::Work,
    settings::Settings,
    sim::Closes,
};
use proptest::prelude::*;

const TOWARDS: Probing = Probing::Probe {
    is_away: false,
    may_miss: false,
};
const TOWARDS_OR_MISS: Probing = Probing::Probe {
    is_away: false,
    may_miss: true,
};
const AWAY: Probing = Probing::Probe {
    is_away: true,
    may_miss: false,
};
const AWAY_OR_MISS: Probing = Probing::Probe {
    is_away: true,
    may_miss: true,
};

/// A machine with a plate 5 mm below.
fn cell() -> Cell {
    let mut cell = Cell::new(&fast());
    cell.mount(Z, Closes::DownFrom(-400), Levels::PROBE);
    cell
}

/// Positions of the axes at the first step after which `holds` is true.
fn position_when(cell: &Cell, holds: impl Fn(&Axes<i32>) -> bool) -> Axes<i32> {
    let mut position = Axes::all(0);
    for edge in &cell.trace.edges {
        add_steps(&mut position, edge);
        if edge.raise != 0 && holds(&position) {
            return position;
        }
    }
    panic!("it never does");
}

#[test]
fn the_contact_is_reported_and_the_machine_slows_down() {
    let mut cell = cell();
    cell.probe(&[0.0, 0.0, -10.0], 600.0, TOWARDS);
    assert_eq!(cell.state(), State::Run);
    cell.run_to_end();
    assert_eq!(cell.state(), State::Idle);
    assert_eq!(cell.notices(), [Notice::Probed]);
    let snapshot = cell.snapshot();
    assert!(snapshot.probed.success);
    assert_eq!(snapshot.probed.steps.0[..3], [0, 0, -400]);
    assert_eq!(snapshot.steps, cell.physical());
    // 10 mm/s at 500 mm/s² need 0.1 mm, and 4 ms are prepared ahead.
    let beyond = -400 - snapshot.steps[Z];
    assert!((8..=14).contains(&beyond), "{beyond}");
    cell.trace.check_pulses();
    check_limits(&fast(), &cell.trace);
    // The machine goes on from there, and the plate is no more of interest.
    cell.router.set_steps(snapshot.steps);
    cell.go(&[0.0, 0.0, -12.0], 600.0);
    cell.go(&[0.0, 0.0, 0.0], 600.0);
    cell.run_to_end();
    assert_eq!(cell.physical()[Z], 0);
    assert_eq!(cell.snapshot().probed, snapshot.probed);
}

#[test]
fn a_miss_is_an_alarm_where_it_is_an_error() {
    for (probing, alarm) in [(TOWARDS, true), (TOWARDS_OR_MISS, false)] {
        let mut cell = Cell::new(&fast());
        cell.probe(&[0.0, 0.0, -3.0], 600.0, probing);
        cell.run_to_end();
        let snapshot = cell.snapshot();
        assert_eq!(snapshot.steps[Z], -240);
        assert!(!snapshot.probed.success);
        if alarm {
            assert_eq!(snapshot.state, State::Alarm);
            let expected = [Notice::Alarm(Alarm::ProbeContact), Notice::Probed];
            assert_eq!(cell.notices(), expected);
            assert_eq!(snapshot.probed.steps[Z], 0);
            assert!(!snapshot.is_critical);
            cell.send(Work::Unlock);
            assert_eq!(cell.state(), State::Idle);
        } else {
            assert_eq!(snapshot.state, State::Idle);
            assert_eq!(cell.notices(), [Notice::Probed]);
            assert_eq!(snapshot.probed.steps[Z], -240);
        }
    }
}

#[test]
fn a_miss_that_is_an_error_leaves_the_position_of_the_contact_before() {
    let mut cell = cell();
    cell.probe(&[0.0, 0.0, -10.0], 600.0, TOWARDS);
    cell.run_to_end();
    cell.router.set_steps(cell.snapshot().steps);
    cell.go(&[0.0; 3], 2000.0);
    cell.run_to_end();
    cell.probe(&[0.0, 0.0, -1.0], 600.0, TOWARDS);
    cell.run_to_end();
    assert_eq!(cell.alarms(), [Alarm::ProbeContact]);
    assert_eq!(cell.snapshot().probed.steps[Z], -400);
    assert!(!cell.snapshot().probed.success);
}

#[test]
fn a_probe_that_is_already_there_is_alarm_4() {
    for (probing, closed) in [
        (TOWARDS, true),
        (TOWARDS_OR_MISS, true),
        (AWAY, false),
        (AWAY_OR_MISS, false),
    ] {
        let mut cell = Cell::new(&fast());
        cell.set_pin(Levels::PROBE, closed);
        cell.run_ms(1);
        cell.probe(&[1.0, 0.0, -3.0], 600.0, probing);
        cell.run_to_end();
        assert_eq!(cell.state(), State::Alarm);
        assert_eq!(cell.notices(), [Notice::Alarm(Alarm::ProbeState)]);
        assert_eq!(cell.physical(), Axes::all(0));
        assert!(!cell.snapshot().probed.success);
    }
}

#[test]
fn the_probe_can_be_left() {
    for probing in [AWAY, AWAY_OR_MISS] {
        let mut cell = Cell::new(&fast());
        cell.mount(X, Closes::DownFrom(160), Levels::PROBE);
        cell.run_ms(1);
        cell.probe(&[5.0, 0.0, 1.0], 1000.0, probing);
        cell.run_to_end();
        let there = position_when(&cell, |steps| steps[X] > 160);
        assert_eq!(cell.snapshot().probed.steps, there);
        assert!(cell.snapshot().probed.success);
    }
}

#[test]
fn an_inverted_probe_is_active_while_open() {
    let settings = Settings {
        probe_invert: true,
        ..fast()
    };
    let mut cell = Cell::new(&settings);
    cell.mount(Z, Closes::From(-399), Levels::PROBE);
    cell.run_ms(1);
    cell.probe(&[0.0, 0.0, -10.0], 600.0, TOWARDS);
    cell.run_to_end();
    assert_eq!(cell.snapshot().probed.steps[Z], -400);
}

#[test]
fn a_contact_with_the_last_step_counts() {
    let mut cell = cell();
    cell.probe(&[0.0, 0.0, -5.0], 600.0, TOWARDS);
    cell.run_to_end();
    assert_eq!(cell.notices(), [Notice::Probed]);
    assert_eq!(cell.snapshot().probed.steps[Z], -400);
    assert!(cell.snapshot().probed.success);
}

#[test]
fn a_hold_holds_a_probing_move() {
    let mut cell = cell();
    cell.probe(&[0.0, 0.0, -10.0], 600.0, TOWARDS);
    cell.run_ms(200);
    cell.byte(b'!');
    cell.run_until(|cell| cell.state() == State::HoldComplete);
    cell.run_ms(100);
    assert!(cell.physical()[Z] > -400);
    cell.byte(b'~');
    cell.run_to_end();
    assert_eq!(cell.notices(), [Notice::Probed]);
    assert_eq!(cell.snapshot().probed.steps[Z], -400);
}

#[test]
fn a_contact_while_slowing_down_for_a_hold_ends_the_move_after_it() {
    let mut cell = cell();
    cell.probe(&[0.0, 0.0, -10.0], 3000.0, TOWARDS);
    cell.run_until(|cell| cell.physical()[Z] < -390);
    cell.byte(b'!');
    cell.run_until(|cell| cell.state() == State::HoldComplete);
    assert!(cell.physical()[Z] < -400);
    cell.run_ms(100);
    assert_eq!(cell.state(), State::HoldComplete);
    let standstill = cell.physical();
    cell.byte(b'~');
    cell.run_to_end();
    assert_eq!(cell.physical(), standstill);
    assert_eq!(cell.notices(), [Notice::Probed]);
    assert_eq!(cell.snapshot().probed.steps[Z], -400);
    assert_eq!(cell.state(), State::Idle);
}

#[test]
fn the_door_holds_a_probing_move() {
    let mut cell = cell();
    cell.probe(&[0.0, 0.0, -10.0], 600.0, TOWARDS);
    cell.run_ms(200);
    cell.byte(0x84);
    cell.run_ms(200);
    assert_eq!(cell.state(), State::DoorClosed);
    cell.byte(b'~');
    cell.run_to_end();
    assert_eq!(cell.notices(), [Notice::CheckDoor, Notice::Probed]);
    assert_eq!(cell.snapshot().probed.steps[Z], -400);
}

#[test]
fn a_miss_that_is_held_at_its_end_is_reported_when_it_goes_on() {
    const DOOR: u8 = 0x84;
    // At 10 mm/s, 0.1 mm before the target the machine slows down in any case.
    for stop in [b'!', DOOR] {
        let mut cell = cell();
        cell.probe(&[0.0, 0.0, -3.0], 600.0, TOWARDS);
        cell.run_until(|cell| cell.physical()[Z] < -236);
        cell.byte(stop);
        cell.run_ms(500);
        assert_eq!(cell.physical()[Z], -240);
        assert!(!cell.notices().contains(&Notice::Probed));
        cell.byte(b'~');
        cell.run_ms(500);
        assert_eq!(cell.state(), State::Alarm);
        let notices = cell.notices();
        let expected = [Notice::Alarm(Alarm::ProbeContact), Notice::Probed];
        assert!(notices.ends_with(&expected), "{notices:?}");
        // The answer of the line waits for that.
        assert!(cell.snapshot().is_at_rest);
    }
}

#[test]
fn a_reset_ends_a_probing_move_without_a_result() {
    let mut cell = cell();
    cell.probe(&[0.0, 0.0, -10.0], 600.0, TOWARDS);
    cell.run_ms(200);
    cell.byte(0x18);
    assert!(cell.snapshot().reset_in_motion);
    cell.run_to_end();
    assert_eq!(cell.state(), State::Alarm);
    assert_eq!(cell.snapshot().steps, cell.physical());
    assert!(!cell.notices().contains(&Notice::Probed));
    assert!(!cell.snapshot().probed.success);
    cell.send(Work::Unlock);
    cell.router.set_steps(cell.snapshot().steps);
    cell.go(&[0.0, 0.0, -10.0], 600.0);
    cell.run_to_end();
    assert_eq!(cell.physical()[Z], -800);
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn the_contact_is_where_the_probe_closed_at_any_speed(
        target in prop::array::uniform3(-20.0_f64..20.0),
        at in 0.02_f64..1.0,
        axis in 0_usize..3,
        feed in 10.0_f32..5000.0,
    ) {
        prop_assume!(target[axis].abs() > 1.0);
        let mut cell = Cell::new(&fast());
        let steps = (target[axis] * 80.0 * at) as i32;
        prop_assume!(steps != 0);
        let closes = if steps > 0 { Closes::From(steps) } else { Closes::DownFrom(steps) };
        cell.mount(axis, closes, Levels::PROBE);
        cell.probe(&target, feed, TOWARDS);
        cell.run_to_end();
        let there = position_when(&cell, |position| {
            if steps > 0 { position[axis] >= steps } else { position[axis] <= steps }
        });
        prop_assert_eq!(cell.snapshot().probed.steps, there);
        prop_assert_eq!(there[axis], steps);
        prop_assert!(cell.snapshot().probed.success);
        prop_assert_eq!(cell.snapshot().steps, cell.physical());
        cell.trace.check_pulses();
        check_limits(&fast(), &cell.trace);
    }
}

/// A contact of some µs, as a spindle's noise makes it.
fn spike(cell: &mut Cell, us: u32) {
    cell.set_pin(Levels::PROBE, true);
    cell.run_us(us);
    cell.set_pin(Levels::PROBE, false);
}

#[test]
fn one_spike_does_not_end_a_probing_move() {
    for probing in [TOWARDS, TOWARDS_OR_MISS] {
        let mut cell = cell();
        cell.probe(&[0.0, 0.0, -10.0], 600.0, probing);
        cell.run_until(|cell| cell.physical()[Z] <= -100);
        spike(&mut cell, 2);
        cell.run_until(|cell| cell.physical()[Z] <= -200);
        spike(&mut cell, 700);
        cell.run_to_end();
        assert_eq!(cell.notices(), [Notice::Probed]);
        assert!(cell.snapshot().probed.success);
        assert_eq!(cell.snapshot().probed.steps[Z], -400);
        cell.trace.check_pulses();
        check_limits(&fast(), &cell.trace);
    }
}

#[test]
fn a_spike_at_the_end_of_a_probing_move_is_a_miss() {
    for (probing, alarms) in [(TOWARDS, 1), (TOWARDS_OR_MISS, 0)] {
        let mut cell = Cell::new(&fast());
        cell.probe(&[0.0, 0.0, -3.0], 600.0, probing);
        cell.run_until(|cell| cell.physical()[Z] == -240);
        spike(&mut cell, 2);
        cell.run_to_end();
        assert!(!cell.snapshot().probed.success);
        assert_eq!(cell.alarms().len(), alarms);
        assert_eq!(cell.physical()[Z], -240);
    }
}

#[test]
fn a_spike_while_the_probe_is_left_does_not_end_the_move() {
    let mut cell = Cell::new(&fast());
    cell.set_pin(Levels::PROBE, true);
    cell.run_ms(2);
    cell.probe(&[0.0, 0.0, 5.0], 600.0, AWAY);
    cell.run_until(|cell| cell.physical()[Z] >= 100);
    cell.set_pin(Levels::PROBE, false);
    cell.run_us(2);
    cell.set_pin(Levels::PROBE, true);
    cell.run_until(|cell| cell.physical()[Z] >= 200);
    cell.set_pin(Levels::PROBE, false);
    let left = cell.physical();
    cell.run_to_end();
    assert!(cell.snapshot().probed.success);
    assert_eq!(cell.snapshot().probed.steps, left);
}

#[test]
fn a_contact_that_bounces_is_where_it_closed_first() {
    let mut cell = Cell::new(&fast());
    cell.probe(&[0.0, 0.0, -10.0], 600.0, TOWARDS);
    cell.run_until(|cell| cell.physical()[Z] <= -300);
    let first = cell.physical();
    for us in [20, 150, 280] {
        cell.set_pin(Levels::PROBE, true);
        cell.run_us(us);
        cell.set_pin(Levels::PROBE, false);
        cell.run_us(us);
    }
    cell.set_pin(Levels::PROBE, true);
    cell.run_to_end();
    assert!(cell.snapshot().probed.success);
    assert_eq!(cell.snapshot().probed.steps, first);
}

#[test]
fn noise_alone_never_is_a_contact() {
    let mut cell = Cell::new(&fast());
    cell.probe(&[0.0, 0.0, -10.0], 600.0, TOWARDS_OR_MISS);
    for gap in 1..40 {
        cell.run_us(250 * gap);
        spike(&mut cell, 37 * (gap % 20));
    }
    cell.run_to_end();
    assert!(!cell.snapshot().probed.success);
    assert_eq!(cell.physical()[Z], -800);
}
