//! Parking while the safety door is open.

use leadscrew::{
    model::{Spindle, State},
    path::Work,
    settings::Settings,
};

use crate::{
    DOOR, MS, go, jog, moving, send, state,
    support::{RESET, Rig, check_limits, each, fast, line, with},
};

/// A homed machine that parks, with Z 20 mm down and X on its way.
fn above_work() -> Rig {
    let settings = Settings {
        parking: true,
        homing: 1,
        ..fast()
    };
    let mut rig = Rig::new(&settings);
    assert_eq!(rig.snapshot().state, State::Alarm);
    assert!(rig.enqueue(Work::Unlock));
    while rig.drive.prepare(&rig.requests, rig.now) {}
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 1000.0));
    go(&mut rig, &line(&[0.0, 0.0, -20.0], 5000.0));
    go(&mut rig, &line(&[30.0, 0.0, -20.0], 1000.0));
    rig.run_to(800 * MS);
    rig
}

fn z(rig: &Rig) -> i32 {
    rig.snapshot().steps[2]
}

fn wait_for(rig: &mut Rig, awaited: State) {
    let end = rig.now + 60_000 * MS;
    while state(rig) != awaited {
        let next = rig.now + MS;
        rig.run_to(next);
        assert!(rig.now < end, "{:?}", rig.snapshot());
    }
}

#[test]
fn parking_lifts_z_and_brings_it_back_to_the_step() {
    let mut rig = above_work();
    rig.receive(DOOR);
    let x_at = |rig: &Rig| rig.snapshot().steps[0];
    rig.run_to(rig.now + 1000 * MS);
    assert_eq!(state(&rig), State::DoorRetracting);
    // Slow, with the spindle on, up to the waypoint; fast without it beyond.
    assert_eq!(rig.snapshot().feed_mm_min.round(), 100.0);
    assert_eq!(rig.snapshot().spindle_rpm, 1000.0);
    let x = x_at(&rig);
    wait_for(&mut rig, State::DoorClosed);
    assert_eq!((z(&rig), x_at(&rig)), (-5 * 80, x));
    assert_eq!(rig.snapshot().spindle, Spindle::Off);
    assert!(!rig.snapshot().is_at_rest);
    rig.receive(b'~');
    rig.run_to(rig.now + 3000 * MS);
    assert_eq!((state(&rig), z(&rig)), (State::DoorRestoring, -15 * 80));
    assert_eq!(rig.snapshot().spindle_rpm, 1000.0);
    wait_for(&mut rig, State::Run);
    assert_eq!((z(&rig), x_at(&rig)), (-20 * 80, x));
    rig.run_to_standstill();
    assert_eq!(rig.snapshot().steps.0[..3], [2400, 0, -1600]);
    check_limits(&fast(), &rig.trace);
    rig.trace.check_pulses();
}

#[test]
fn parking_far_at_a_fine_resolution_keeps_the_limits() {
    // Two million steps; fewer when it must be quick.
    let mm = [200_i16, 40][usize::from(each(2) > 1)];
    let settings = Settings {
        parking: true,
        homing: 1,
        parking_target_mm: mm.into(),
        parking_mm_min: 600.0,
        ..with(&[80.0, 80.0, 10_000.0], &[5000.0, 5000.0, 240.0], &[500.0])
    };
    let mut rig = Rig::new(&settings);
    assert!(rig.enqueue(Work::Unlock));
    while rig.drive.prepare(&rig.requests, rig.now) {}
    rig.receive(DOOR);
    wait_for(&mut rig, State::DoorClosed);
    assert_eq!(z(&rig), 10_000 * i32::from(mm));
    check_limits(&settings, &rig.trace);
}

#[test]
fn a_door_opened_or_a_hold_while_returning_parks_again() {
    // Fast on the way to the waypoint, waiting there, and slow into the work.
    for (ms, stop) in [500, 3000, 7000]
        .into_iter()
        .flat_map(|ms| [(ms, DOOR), (ms, b'!')])
    {
        let mut rig = above_work();
        rig.receive(DOOR);
        wait_for(&mut rig, State::DoorClosed);
        rig.receive(b'~');
        rig.run_to(rig.now + ms * MS);
        assert_eq!(state(&rig), State::DoorRestoring);
        rig.receive(stop);
        assert_eq!(state(&rig), State::DoorRetracting);
        wait_for(&mut rig, State::DoorClosed);
        assert_eq!(z(&rig), -400);
        assert_eq!(rig.snapshot().spindle, Spindle::Off);
        rig.run_to(rig.now + 20_000 * MS);
        assert_eq!((state(&rig), z(&rig)), (State::DoorClosed, -400));
        rig.receive(b'~');
        wait_for(&mut rig, State::Run);
        rig.run_to_standstill();
        assert_eq!(rig.snapshot().steps.0[..3], [2400, 0, -1600]);
        check_limits(&fast(), &rig.trace);
    }
}

#[test]
fn a_reset_while_parking_slows_down_and_keeps_the_position() {
    for (ms, is_alarm) in [(1000, true), (4000, true), (20_000, false)] {
        let mut rig = above_work();
        rig.receive(DOOR);
        rig.run_to(rig.now + ms * MS);
        rig.receive(RESET);
        assert_eq!(rig.snapshot().reset_in_motion, is_alarm, "{ms}");
        rig.run_to_standstill();
        assert!(rig.snapshot().is_at_rest, "{ms}: {:?}", rig.snapshot());
        assert_eq!(rig.snapshot().steps, rig.trace.net_steps());
        check_limits(&fast(), &rig.trace);
    }
}

#[test]
fn nothing_is_parked_above_the_place_for_it_nor_without_homing_nor_in_a_jog() {
    let settings = Settings {
        parking: true,
        ..fast()
    };
    let mut rig = moving(&settings, &line(&[10.0, 0.0, -20.0], 5000.0));
    rig.run_to(100 * MS);
    rig.receive(DOOR);
    rig.run_to_standstill();
    assert_eq!(state(&rig), State::DoorClosed);
    let mut rig = above_work();
    rig.run_to_standstill();
    go(&mut rig, &jog(&[0.0, 0.0, -20.0], 1000.0));
    rig.run_to(rig.now + 200 * MS);
    rig.receive(DOOR);
    rig.run_to_standstill();
    assert_eq!((state(&rig), z(&rig)), (State::DoorClosed, -1600));
    assert_eq!(rig.snapshot().spindle, Spindle::Off);
}
