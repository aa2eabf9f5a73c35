//! Jogs, queued and cancelled.

use leadscrew::model::{Notice, State};

use crate::{
    CANCEL, DOOR, MS, go, jog, moving, notices, state,
    support::{check_limits, fast, line},
};

#[test]
fn a_jog_is_cancelled_by_its_byte_a_hold_and_the_door() {
    for byte in [CANCEL, b'!', DOOR] {
        let mut rig = moving(&fast(), &jog(&[50.0], 2000.0));
        go(&mut rig, &jog(&[80.0], 2000.0));
        assert_eq!(state(&rig), State::Jog);
        rig.run_to(300 * MS);
        rig.receive(byte);
        rig.run_to(310 * MS);
        assert_eq!(state(&rig), State::Jog);
        // A jog that was made before its sender knew is void.
        go(&mut rig, &jog(&[120.0], 2000.0));
        rig.run_to_standstill();
        let snapshot = rig.snapshot();
        let expected = if byte == DOOR {
            State::DoorClosed
        } else {
            State::Idle
        };
        assert_eq!(snapshot.state, expected);
        assert_eq!((snapshot.finished, snapshot.cancelled_motions), (3, 1));
        assert!(snapshot.is_at_rest);
        assert_eq!(snapshot.steps, rig.trace.net_steps());
        assert!((700..1000).contains(&snapshot.steps[0]), "{snapshot:?}");
        check_limits(&fast(), &rig.trace);
        rig.receive(b'~');
        assert_eq!(state(&rig), State::Idle);
        let count = usize::from(byte == DOOR);
        assert_eq!(notices(&rig), vec![Notice::CheckDoor; count]);
    }
}

#[test]
fn jog_cancel_cancels_nothing_else() {
    let mut rig = moving(&fast(), &line(&[20.0], 2000.0));
    rig.run_to(100 * MS);
    rig.receive(CANCEL);
    rig.run_to_standstill();
    assert_eq!(rig.snapshot().steps[0], 1600);
    // Nor is it kept for the next jog.
    rig.receive(CANCEL);
    go(&mut rig, &jog(&[0.0], 2000.0));
    rig.run_to_standstill();
    assert_eq!(rig.snapshot().steps[0], 0);
}

#[test]
fn queued_jogs_do_not_stop_between() {
    let mut rig = moving(&fast(), &jog(&[10.0], 2000.0));
    go(&mut rig, &jog(&[20.0], 2000.0));
    go(&mut rig, &jog(&[30.0], 2000.0));
    rig.run_to_standstill();
    let steps = rig.trace.steps(0);
    let seconds = steps[steps.len() - 1].seconds - steps[0].seconds;
    // 30 mm at 2000 mm/min, and one ramp up and one down.
    assert!(seconds < 30.0 / (2000.0 / 60.0) + 2.0 * 0.067, "{seconds}");
    assert_eq!(steps.len(), 2400);
}
