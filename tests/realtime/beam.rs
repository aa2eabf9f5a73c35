//! The laser.

use leadscrew::{
    model::{Command, Coolant, FeedRate, Laser, Notice, Outputs, Spindle, State},
    path::{Block, Work},
    settings::Settings,
};

use crate::{
    DOOR, MS, notices, send, state,
    support::{RESET, Rig, TICKS_PER_S, at, fast, line, line_at},
};

/// A block with a laser.
fn burn(rig: &mut Rig, command: &Command, laser: Laser) {
    let Some(Work::Move(block)) = rig.router.route(command) else {
        panic!("it moves");
    };
    send(rig, Work::Move(Block { laser, ..block }));
}

fn laser() -> Settings {
    Settings {
        laser: true,
        ..fast()
    }
}

#[test]
fn the_beam_follows_the_speed_and_is_off_at_rest() {
    let mut rig = Rig::new(&laser());
    send(&mut rig, Work::Spindle(Spindle::CounterClockwise, 800.0));
    assert_eq!(rig.snapshot().spindle_rpm, 0.0);
    let beam = Laser::Proportional(800.0);
    burn(&mut rig, &line(&[20.0], 3000.0), beam);
    rig.run_to_standstill();
    assert_eq!(rig.drive.outputs().duty, 0);
    assert_eq!(rig.drive.outputs().spindle, Spindle::Off);
    // A hundred ms of ramp, cruise, ramp: the duty is that of the speed all along.
    let full = f64::from(Outputs::FULL) * 0.8;
    let start = rig.trace.starts[0] as f64 / TICKS_PER_S;
    let mut checked = 0;
    for edge in rig.trace.edges.iter().filter(|edge| edge.raise != 0) {
        let time = edge.ticks as f64 / TICKS_PER_S - start;
        let ramp = (time / 0.1).min(1.0);
        if time < 0.35 {
            let error = f64::from(edge.duty) - full * ramp;
            assert!(error.abs() <= 10.0, "{time} s: {} {error}", edge.duty);
            checked += 1;
        }
    }
    assert!(checked > 1000);
}

#[test]
fn a_constant_beam_stays_after_a_feed_move_and_is_off_in_rapids() {
    let mut rig = Rig::new(&laser());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 0.0));
    burn(
        &mut rig,
        &line_at(at(&[10.0]), FeedRate::Rapid),
        Laser::Constant(0.0),
    );
    rig.run_to(20 * MS);
    assert_eq!(rig.snapshot().spindle, Spindle::Off);
    rig.run_to_standstill();
    burn(&mut rig, &line(&[20.0], 3000.0), Laser::Constant(500.0));
    rig.run_to_standstill();
    assert_eq!(rig.snapshot().spindle_rpm, 500.0);
    assert_eq!(rig.drive.outputs().duty / 4, 128);
    burn(
        &mut rig,
        &line_at(at(&[0.0]), FeedRate::Rapid),
        Laser::Constant(0.0),
    );
    rig.run_to_standstill();
    assert_eq!(
        (rig.snapshot().spindle_rpm, rig.drive.outputs().duty),
        (0.0, 0)
    );
}

#[test]
fn a_hold_switches_the_beam_off_and_the_resume_on() {
    for direction in [Spindle::Clockwise, Spindle::CounterClockwise] {
        let mut rig = Rig::new(&laser());
        send(&mut rig, Work::Spindle(direction, 500.0));
        let beam = match direction {
            Spindle::CounterClockwise => Laser::Proportional(500.0),
            Spindle::Off | Spindle::Clockwise => Laser::Constant(500.0),
        };
        burn(&mut rig, &line(&[30.0], 1000.0), beam);
        rig.run_to(300 * MS);
        assert_eq!(rig.drive.outputs().duty / 4, 128);
        rig.receive(b'!');
        rig.run_to_standstill();
        assert_eq!(rig.drive.outputs().duty, 0);
        rig.receive(0x9e);
        assert_eq!(rig.drive.outputs().duty, 0);
        rig.receive(0x9e);
        rig.receive(b'~');
        rig.run_to(rig.now + 200 * MS);
        assert_eq!(rig.drive.outputs().duty / 4, 128);
        assert_eq!(notices(&rig), [Notice::RestoringSpindle; 2]);
    }
}

#[test]
fn a_laser_waits_for_no_spindle_when_the_door_closes() {
    let mut rig = Rig::new(&laser());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 500.0));
    burn(&mut rig, &line(&[30.0], 1000.0), Laser::Constant(500.0));
    rig.run_to(300 * MS);
    rig.receive(DOOR);
    rig.run_to_standstill();
    assert_eq!(rig.drive.outputs().duty, 0);
    rig.receive(b'~');
    assert_eq!(state(&rig), State::Run);
    rig.run_to(rig.now + 10 * MS);
    assert_eq!(rig.drive.outputs().duty / 4, 128);
    assert_eq!(notices(&rig), [Notice::CheckDoor]);
}

#[test]
fn a_reset_switches_everything_off_at_once() {
    let mut rig = Rig::new(&laser());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 500.0));
    rig.receive(0xa0);
    burn(&mut rig, &line(&[30.0], 1000.0), Laser::Constant(500.0));
    rig.run_to(300 * MS);
    rig.receive(RESET);
    assert_eq!(rig.drive.outputs().spindle, Spindle::Off);
    assert_eq!(rig.drive.outputs().coolant, Coolant::OFF);
    rig.run_to(302 * MS);
    assert_eq!(rig.drive.outputs().duty, 0);
    rig.run_to_standstill();
    assert_eq!(state(&rig), State::Alarm);
    rig.run_to(rig.now + 26 * MS);
    assert_eq!(*rig.drive.outputs(), Outputs::default());
}

#[test]
fn a_beam_that_a_hold_at_rest_ended_comes_back_with_the_next_motion_only() {
    let mut rig = Rig::new(&laser());
    let beam = Laser::Constant(500.0);
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 500.0));
    assert!(rig.drive.outputs().duty > 0);
    rig.receive(b'!');
    assert_eq!(rig.drive.outputs().duty, 0);
    rig.receive(b'~');
    assert_eq!(state(&rig), State::Idle);
    assert_eq!(notices(&rig), [Notice::RestoringSpindle]);
    assert_eq!(rig.drive.outputs().duty, 0);
    burn(&mut rig, &line(&[5.0], 1000.0), beam);
    rig.run_to_standstill();
    assert!(rig.drive.outputs().duty > 0);
}

#[test]
fn a_beam_switched_on_in_a_hold_waits_for_the_motion() {
    let mut rig = Rig::new(&laser());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 500.0));
    burn(&mut rig, &line(&[20.0], 1000.0), Laser::Constant(500.0));
    rig.run_to(200 * MS);
    rig.receive(b'!');
    rig.run_to(400 * MS);
    rig.receive(0x9E);
    assert_eq!(notices(&rig), [Notice::RestoringSpindle]);
    assert_eq!(state(&rig), State::HoldComplete);
    assert_eq!(rig.drive.outputs().duty, 0);
    rig.receive(b'~');
    rig.run_to(500 * MS);
    assert!(rig.snapshot().spindle_rpm > 0.0);
}
