//! Spindle, coolant and stepper drivers.

use leadscrew::{
    model::{Notice, Spindle, State},
    path::Work,
    settings::Settings,
};

use crate::{
    DOOR, MS, go, notices, send, state,
    support::{Rig, fast, line},
};

#[test]
fn the_spindle_stops_in_a_hold_only_and_comes_back() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 1000.0));
    rig.receive(0x9e);
    assert_eq!(rig.snapshot().spindle, Spindle::Clockwise);
    go(&mut rig, &line(&[30.0], 1000.0));
    rig.run_to(300 * MS);
    rig.receive(0x9e);
    rig.receive(b'!');
    rig.run_to_standstill();
    assert_eq!(rig.snapshot().spindle, Spindle::Clockwise);
    rig.receive(0x9e);
    assert_eq!(rig.snapshot().spindle, Spindle::Off);
    assert_eq!(rig.snapshot().spindle_rpm, 0.0);
    assert_eq!(rig.drive.outputs().spindle, Spindle::Off);
    rig.receive(0x9e);
    assert_eq!(rig.snapshot().spindle_rpm, 1000.0);
    rig.receive(0x9e);
    rig.receive(b'~');
    assert_eq!(state(&rig), State::Run);
    assert_eq!(rig.snapshot().spindle, Spindle::Clockwise);
    assert_eq!(notices(&rig), [Notice::RestoringSpindle; 2]);
}

#[test]
fn a_speed_comes_before_the_dwell_that_follows_at_rest_and_in_motion() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 1000.0));
    for (rpm, moves) in [(500.0, false), (300.0, true)] {
        let start = rig.now;
        if moves {
            go(&mut rig, &line(&[1.0], 1000.0));
        }
        assert!(rig.enqueue(Work::Speed(rpm)) && rig.enqueue(Work::Dwell(500)));
        rig.prepare();
        if moves {
            assert_eq!(rig.snapshot().spindle_rpm, 500.0);
        }
        rig.run_to(start + 400 * MS);
        assert_eq!(
            (state(&rig), rig.snapshot().spindle_rpm),
            (State::Idle, rpm)
        );
        rig.run_to(start + 1000 * MS);
    }
}

#[test]
fn a_spindle_override_acts_at_rest_in_motion_and_in_a_hold() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 500.0));
    rig.receive(0x9a);
    assert_eq!(rig.snapshot().spindle_rpm, 550.0);
    assert_eq!(rig.drive.outputs().duty / 4, 140);
    go(&mut rig, &line(&[30.0], 1000.0));
    rig.run_to(300 * MS);
    rig.receive(0x9b);
    rig.receive(0x9b);
    rig.run_to(305 * MS);
    assert_eq!(rig.snapshot().spindle_rpm, 450.0);
    assert_eq!(rig.drive.outputs().duty / 4, 115);
    rig.receive(b'!');
    rig.run_to_standstill();
    rig.receive(0x99);
    assert_eq!(rig.snapshot().spindle_rpm, 500.0);
    assert_eq!(rig.drive.outputs().duty / 4, 128);
}

#[test]
fn coolant_is_toggled_where_grbl_does() {
    let mut rig = Rig::new(&fast());
    rig.receive(0xa0);
    assert!(rig.snapshot().coolant.flood && rig.snapshot().programmed_coolant.flood);
    assert_eq!(rig.snapshot().coolant_toggles, 1);
    rig.receive(0xa1);
    assert!(rig.snapshot().coolant.mist && rig.snapshot().programmed_coolant.mist);
    assert_eq!(rig.snapshot().coolant_toggles, 2);
    rig.receive(0xa1);
    assert!(!rig.snapshot().programmed_coolant.mist);
    rig.receive(b'!');
    rig.receive(0xa0);
    assert!(!rig.snapshot().coolant.flood);
    rig.receive(DOOR);
    rig.receive(0xa0);
    assert!(!rig.snapshot().programmed_coolant.flood);
}

#[test]
fn drivers_are_on_in_motion_and_for_a_while_after_it() {
    let mut rig = Rig::new(&fast());
    assert!(!rig.drive.outputs().drivers);
    go(&mut rig, &line(&[1.0], 1000.0));
    assert!(rig.drive.outputs().drivers);
    rig.run_to_standstill();
    let end = rig.now;
    rig.run_to(end + 24 * MS);
    assert!(rig.drive.outputs().drivers);
    rig.run_to(end + 26 * MS);
    assert!(!rig.drive.outputs().drivers);
    // Motion that comes in between keeps them on.
    go(&mut rig, &line(&[0.0], 1000.0));
    rig.run_to_standstill();
    rig.run_to(rig.now + 20 * MS);
    go(&mut rig, &line(&[10.0], 1000.0));
    let start = rig.now;
    rig.run_to(start + 200 * MS);
    assert_eq!(state(&rig), State::Run);
    assert!(rig.drive.outputs().drivers);
}

#[test]
fn drivers_may_stay_on_for_ever() {
    let settings = Settings {
        idle_delay_ms: 255,
        ..fast()
    };
    let mut rig = Rig::new(&settings);
    assert!(rig.drive.outputs().drivers);
    go(&mut rig, &line(&[1.0], 1000.0));
    rig.run_to_standstill();
    rig.run_to(rig.now + 10_000 * MS);
    assert!(rig.drive.outputs().drivers);
    send(&mut rig, Work::Sleep);
    assert!(!rig.drive.outputs().drivers);
}
