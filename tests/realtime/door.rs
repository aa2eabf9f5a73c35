//! The safety door.

use leadscrew::{
    model::{Coolant, Levels, Notice, Outputs, Spindle, State},
    path::Work,
};

use crate::{
    DOOR, MS, go, moving, notices, send, state,
    support::{RESET, Rig, fast, line},
};

#[test]
fn the_door_in_a_run_switches_off_and_comes_back_in_grbls_time() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 1000.0));
    let flood = Coolant {
        flood: true,
        mist: false,
    };
    send(&mut rig, Work::Coolant(flood));
    go(&mut rig, &line(&[30.0], 1000.0));
    rig.run_to(300 * MS);
    rig.receive(DOOR);
    assert_eq!(state(&rig), State::DoorRetracting);
    assert_eq!(rig.snapshot().spindle, Spindle::Clockwise);
    rig.run_to(700 * MS);
    let snapshot = rig.snapshot();
    assert_eq!(snapshot.state, State::DoorClosed);
    assert_eq!(
        (snapshot.spindle, snapshot.spindle_rpm),
        (Spindle::Off, 0.0)
    );
    assert_eq!(
        (snapshot.coolant, snapshot.programmed_coolant),
        (Coolant::OFF, flood)
    );
    assert_eq!(*rig.drive.outputs(), Outputs::default());
    rig.receive(b'~');
    let start = rig.now;
    assert_eq!(state(&rig), State::DoorRestoring);
    assert_eq!(rig.drive.outputs().duty, Outputs::FULL);
    rig.run_to(start + 3999 * MS);
    assert_eq!(rig.snapshot().spindle_rpm, 1000.0);
    assert_eq!(rig.snapshot().coolant, Coolant::OFF);
    rig.run_to(start + 4999 * MS);
    assert_eq!(rig.snapshot().coolant, flood);
    assert_eq!(state(&rig), State::DoorRestoring);
    rig.run_to(start + 5001 * MS);
    assert_eq!(state(&rig), State::Run);
    rig.run_to_standstill();
    assert_eq!(rig.snapshot().steps[0], 2400);
    assert_eq!(notices(&rig), [Notice::CheckDoor]);
}

#[test]
fn a_door_opened_while_restoring_begins_anew() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 1000.0));
    rig.receive(DOOR);
    assert_eq!(state(&rig), State::DoorClosed);
    rig.receive(b'~');
    rig.run_to(2000 * MS);
    rig.receive(DOOR);
    assert_eq!(state(&rig), State::DoorClosed);
    assert_eq!(rig.drive.outputs().duty, 0);
    rig.run_to(9000 * MS);
    assert_eq!(state(&rig), State::DoorClosed);
    rig.receive(b'~');
    rig.run_to(12_999 * MS);
    assert_eq!(state(&rig), State::DoorRestoring);
    rig.run_to(13_001 * MS);
    assert_eq!(state(&rig), State::Idle);
    assert_eq!(rig.snapshot().spindle, Spindle::Clockwise);
    assert_eq!(notices(&rig), [Notice::CheckDoor; 2]);
}

#[test]
fn a_hold_while_restoring_switches_off_again_until_cycle_start() {
    // With the spindle on and the coolant still off, and with both.
    for (ms, are_flooded) in [(2000, false), (4500, true)] {
        let mut rig = Rig::new(&fast());
        send(&mut rig, Work::Spindle(Spindle::Clockwise, 1000.0));
        let flood = Coolant {
            flood: true,
            mist: false,
        };
        send(&mut rig, Work::Coolant(flood));
        go(&mut rig, &line(&[30.0], 1000.0));
        rig.run_to(300 * MS);
        rig.receive(DOOR);
        rig.run_to(700 * MS);
        rig.receive(b'~');
        rig.run_to((700 + ms) * MS);
        assert_eq!(state(&rig), State::DoorRestoring);
        assert_eq!(rig.drive.outputs().coolant.flood, are_flooded);
        let x = rig.snapshot().steps[0];
        rig.receive(b'!');
        assert_eq!(state(&rig), State::DoorClosed);
        assert_eq!(*rig.drive.outputs(), Outputs::default());
        rig.run_to(20_000 * MS);
        assert_eq!(
            (state(&rig), rig.snapshot().steps[0]),
            (State::DoorClosed, x)
        );
        rig.receive(b'~');
        assert_eq!(rig.drive.outputs().spindle, Spindle::Clockwise);
        rig.run_to(24_999 * MS);
        assert_eq!(state(&rig), State::DoorRestoring);
        rig.run_to(25_001 * MS);
        assert_eq!(state(&rig), State::Run);
        assert_eq!(rig.snapshot().coolant, flood);
        rig.run_to_standstill();
        assert_eq!(rig.snapshot().steps[0], 2400);
        assert_eq!(notices(&rig), [Notice::CheckDoor]);
    }
}

#[test]
fn a_door_that_stays_open_lets_nothing_start() {
    let mut rig = moving(&fast(), &line(&[30.0], 1000.0));
    rig.run_to(200 * MS);
    rig.drive.inputs.set_closed(Levels::DOOR);
    rig.receive(DOOR);
    rig.run_to_standstill();
    assert_eq!(state(&rig), State::DoorAjar);
    rig.receive(b'~');
    assert_eq!(state(&rig), State::DoorAjar);
    rig.drive.inputs.set_closed(Levels::NONE);
    rig.drive.release_prepare();
    rig.prepare();
    assert_eq!(state(&rig), State::DoorClosed);
    rig.receive(b'~');
    assert_eq!(state(&rig), State::Run);
}

#[test]
fn a_reset_with_the_door_open_is_in_the_door_state() {
    let mut rig = Rig::new(&fast());
    rig.drive.inputs.set_closed(Levels::DOOR);
    rig.receive(RESET);
    assert_eq!(state(&rig), State::DoorAjar);
    assert!(rig.snapshot().is_at_rest);
}

#[test]
fn a_dwell_goes_on_when_the_door_is_shut_again() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Dwell(500));
    rig.run_to(100 * MS);
    rig.receive(DOOR);
    rig.run_to(2000 * MS);
    assert_eq!(state(&rig), State::DoorClosed);
    rig.receive(b'~');
    rig.run_to(2300 * MS);
    assert_eq!((state(&rig), rig.snapshot().finished), (State::Idle, 0));
    rig.run_to(2500 * MS);
    assert_eq!(rig.snapshot().finished, 1);
}
