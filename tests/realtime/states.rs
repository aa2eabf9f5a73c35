//! Holds, pauses, sleep, check mode, alarms and resets.

use leadscrew::{
    model::{Alarm, Command, FeedRate, Levels, Notice, Outputs, Spindle, State},
    path::Work,
    settings::Settings,
};

use crate::{
    CANCEL, DOOR, MS, go, jog, moving, notices, send, state,
    support::{RESET, Rig, check_limits, fast, line, receive},
};

#[test]
fn hold_and_start_together_hold() {
    let mut rig = moving(&fast(), &line(&[50.0], 3000.0));
    rig.run_to(200 * MS);
    rig.receive(b'!');
    assert_eq!(state(&rig), State::HoldSlowing);
    rig.receive(b'~');
    rig.run_to_standstill();
    assert_eq!(state(&rig), State::HoldComplete);
    rig.receive(b'~');
    assert_eq!(state(&rig), State::Run);
    rig.run_to_standstill();
    assert_eq!(state(&rig), State::Idle);
    assert_eq!(rig.snapshot().steps[0], 4000);
}

#[test]
fn hold_and_start_at_the_same_time_leave_a_held_machine_held() {
    let mut rig = moving(&fast(), &line(&[50.0], 3000.0));
    rig.run_to(200 * MS);
    rig.receive(b'!');
    rig.run_to_standstill();
    for bytes in [[b'!', b'~'], [b'~', b'!']] {
        for byte in bytes {
            receive(&mut rig.drive, &rig.requests, byte);
        }
        rig.prepare();
        assert_eq!(state(&rig), State::HoldComplete);
    }
    rig.receive(b'~');
    rig.run_to_standstill();
    assert_eq!(rig.snapshot().steps[0], 4000);
}

#[test]
fn a_hold_stops_a_dwell_where_it_is() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Dwell(500));
    assert_eq!(state(&rig), State::Idle);
    rig.run_to(100 * MS);
    rig.receive(b'!');
    rig.run_to(2000 * MS);
    assert_eq!(state(&rig), State::HoldComplete);
    assert_eq!(rig.snapshot().finished, 0);
    rig.receive(b'~');
    rig.run_to(2300 * MS);
    assert_eq!((state(&rig), rig.snapshot().finished), (State::Idle, 0));
    rig.run_to(2500 * MS);
    assert_eq!(rig.snapshot().finished, 1);
}

#[test]
fn a_program_pause_waits_for_cycle_start() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Pause);
    assert_eq!(state(&rig), State::HoldComplete);
    assert_eq!(rig.snapshot().finished, 0);
    rig.receive(b'~');
    assert_eq!((state(&rig), rig.snapshot().finished), (State::Idle, 1));
}

#[test]
fn a_program_pause_right_after_a_move_waits_for_cycle_start() {
    let mut rig = moving(&fast(), &line(&[5.0], 3000.0));
    send(&mut rig, Work::Pause);
    rig.run_to_standstill();
    assert_eq!(state(&rig), State::HoldComplete);
    assert_eq!(rig.snapshot().finished, 1);
    rig.receive(b'~');
    assert_eq!((state(&rig), rig.snapshot().finished), (State::Idle, 2));
}

#[test]
fn a_limit_switch_that_is_active_locks_at_a_reset() {
    let settings = Settings {
        hard_limits: true,
        ..fast()
    };
    let mut rig = Rig::new(&settings);
    rig.drive.inputs.set_closed(Levels::limits(1));
    for _ in 0..2 {
        receive(&mut rig.drive, &rig.requests, RESET);
        while rig.drive.prepare(&rig.requests, rig.now) {}
        assert_eq!(state(&rig), State::Alarm);
        assert!(!rig.snapshot().reset_in_motion);
    }
    assert!(notices(&rig).is_empty());
}

#[test]
fn a_soft_limit_slows_down_first_and_then_locks_until_a_reset() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 500.0));
    go(&mut rig, &line(&[50.0], 3000.0));
    go(&mut rig, &line(&[60.0], 3000.0));
    rig.run_to(300 * MS);
    send(&mut rig, Work::Fault(Alarm::SoftLimit));
    assert_eq!(state(&rig), State::HoldSlowing);
    assert!(notices(&rig).is_empty());
    rig.run_to_standstill();
    let snapshot = rig.snapshot();
    assert_eq!(snapshot.state, State::Alarm);
    assert!(snapshot.is_critical && snapshot.is_at_rest);
    assert_eq!(snapshot.spindle, Spindle::Off);
    assert_eq!(snapshot.finished, 4);
    assert_eq!(notices(&rig), [Notice::Alarm(Alarm::SoftLimit)]);
    check_limits(&fast(), &rig.trace);
    rig.receive(RESET);
    let snapshot = rig.snapshot();
    assert!(!snapshot.is_critical && !snapshot.reset_in_motion);
    assert_eq!(snapshot.state, State::Alarm);
    assert_eq!(snapshot.steps, rig.trace.net_steps());
}

#[test]
fn a_soft_limit_at_rest_locks_at_once() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Fault(Alarm::SoftLimit));
    assert_eq!(state(&rig), State::Alarm);
    assert!(rig.snapshot().is_critical);
}

#[test]
fn a_sleeping_machine_wakes_up_locked() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 500.0));
    send(&mut rig, Work::Sleep);
    assert_eq!(state(&rig), State::Sleep);
    assert_eq!(*rig.drive.outputs(), Outputs::default());
    for byte in [b'!', b'~', 0xa0, CANCEL] {
        rig.receive(byte);
        assert_eq!(state(&rig), State::Sleep);
    }
    rig.receive(RESET);
    assert_eq!(state(&rig), State::Alarm);
    assert!(!rig.snapshot().reset_in_motion);
    assert_eq!(notices(&rig), [Notice::Sleeping]);
}

#[test]
fn check_mode_ends_with_a_reset_and_knows_no_hold() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Check);
    for byte in [b'!', DOOR, b'~'] {
        rig.receive(byte);
        assert_eq!(state(&rig), State::Check);
    }
    rig.receive(RESET);
    assert_eq!(state(&rig), State::Idle);
    assert!(notices(&rig).is_empty());
}

#[test]
fn a_reset_in_any_motion_is_an_alarm_and_at_rest_it_is_none() {
    for (bytes, is_alarm) in [
        (&[][..], true),
        (b"!", true),
        (&[DOOR], true),
        (b"!#", false),
        (&[DOOR, b'#'], false),
    ] {
        for command in [line(&[50.0], 2000.0), jog(&[50.0], 2000.0)] {
            let is_jog = matches!(
                command,
                Command::Line {
                    feed_rate: FeedRate::Jog(_),
                    ..
                }
            );
            let mut rig = moving(&fast(), &command);
            send(&mut rig, Work::Spindle(Spindle::Off, 0.0));
            rig.run_to(300 * MS);
            for byte in bytes {
                match byte {
                    b'#' => rig.run_to_standstill(),
                    byte => rig.receive(*byte),
                }
            }
            // `#`: at rest. A jog that is held has ended by then.
            rig.receive(RESET);
            assert_eq!(
                rig.snapshot().reset_in_motion,
                is_alarm,
                "{bytes:?} {is_jog}"
            );
            rig.run_to_standstill();
            let expected = if is_alarm { State::Alarm } else { State::Idle };
            assert_eq!(state(&rig), expected);
            assert_eq!(rig.snapshot().steps, rig.trace.net_steps());
            check_limits(&fast(), &rig.trace);
        }
    }
}

#[test]
fn a_reset_drops_what_is_held() {
    for byte in [b'!', DOOR] {
        let mut rig = moving(&fast(), &line(&[50.0], 3000.0));
        go(&mut rig, &line(&[0.0], 3000.0));
        rig.run_to(300 * MS);
        rig.receive(byte);
        rig.run_to_standstill();
        let steps = rig.snapshot().steps;
        rig.receive(RESET);
        rig.run_to(rig.now + 5000 * MS);
        let snapshot = rig.snapshot();
        assert_eq!((snapshot.state, snapshot.steps), (State::Idle, steps));
        assert_eq!((snapshot.finished, snapshot.is_at_rest), (2, true));
    }
}
