//! Holds, overrides, jogs, the door and the outputs, as the pins and the clock show them.
#![cfg(not(target_os = "none"))]

mod support;

use leadscrew::{
    axis::Axes,
    machine::{Alarm, Levels, Notice, Notices, Outputs, State},
    planner::{Block, Command, Coolant, Laser, Pace, Spindle, Work},
    settings::Settings,
    units::{Nm, TICKS_PER_MS},
};
use proptest::prelude::*;
use support::{
    Act, RESET, Rig, TICKS_PER_S, Trace, at, cases, check_limits, check_path, fast, line, line_at,
    number, target, target_steps, with,
};

const MS: u64 = TICKS_PER_MS as u64;
const DOOR: u8 = 0x84;
const CANCEL: u8 = 0x85;

fn jog(mm: &[f64], mm_min: f32) -> Command {
    line_at(at(mm), Pace::Jog(mm_min))
}

/// The rig, moving.
fn moving(settings: &Settings, command: &Command) -> Rig {
    let mut rig = Rig::new(settings);
    go(&mut rig, command);
    rig
}

fn go(rig: &mut Rig, command: &Command) {
    let work = rig.router.work(command).expect("it moves");
    assert!(rig.enqueue(work));
    rig.prepare();
}

fn send(rig: &mut Rig, work: Work) {
    assert!(rig.enqueue(work));
    rig.prepare();
}

fn notices(rig: &Rig) -> Vec<Notice> {
    let notices: Notices = rig.snapshot().notices;
    let mut seen = 0;
    std::iter::from_fn(|| notices.next(&mut seen)).collect()
}

fn state(rig: &Rig) -> State {
    rig.snapshot().state
}

/// Time from a byte in cruise to the first step that is off the pace before it, ms.
fn latency(byte: u8, before: &[u8], at: u64) -> f64 {
    let settings = with(&[320.0], &[12_000.0], &[500.0]);
    let mut rig = moving(&settings, &line(&[200.0], 6000.0));
    for byte in before {
        rig.receive(*byte);
    }
    rig.run_to(at);
    let cruising = rig.trace.steps(0);
    rig.receive(byte);
    rig.run_to(at + 30 * MS);
    let steps = rig.trace.steps(0);
    let last = cruising.len() - 1;
    let period = (steps[last].seconds - steps[last - 400].seconds) / 400.0;
    let off = steps[last..].iter().enumerate().find(|(k, step)| {
        let expected = steps[last].seconds + *k as f64 * period;
        (step.seconds - expected).abs() > 5.0 / TICKS_PER_S
    });
    let (_, off) = off.expect("the speed changes");
    (off.seconds - at as f64 / TICKS_PER_S) * 1000.0
}

#[test]
fn a_hold_or_an_override_changes_the_speed_within_5_ms() {
    let mut worst = 0.0_f64;
    for (byte, before) in [
        (b'!', &[][..]),
        (DOOR, &[]),
        (RESET, &[]),
        (0x92, &[]),
        (0x94, &[]),
        (0x91, &[]),
        (0x93, &[]),
        (0x90, &[0x92, 0x92, 0x92]),
    ] {
        for k in 0..23 {
            let ms = latency(byte, before, 600 * MS + k * 7919);
            assert!((0.0..=5.0).contains(&ms), "{byte:#x}: {ms} ms");
            worst = worst.max(ms);
        }
    }
    println!("slowest: {worst:.3} ms");
}

#[test]
fn a_rapid_override_changes_rapids_and_no_feed() {
    for (pace, reached) in [
        (Pace::Rapid, 1250.0),
        (Pace::Feed(5000.0), 5000.0),
        (Pace::Jog(5000.0), 5000.0),
    ] {
        let mut rig = moving(&fast(), &line_at(at(&[100.0]), pace));
        rig.receive(0x97);
        rig.run_to(300 * MS);
        let feed = rig.snapshot().feed_mm_min;
        assert!((feed - reached).abs() < 1.0, "{feed}");
    }
}

#[test]
fn a_feed_override_acts_within_the_limit_of_the_axes() {
    for (bytes, programmed, reached) in [
        (&[0x91; 10][..], 1000.0, 2000.0),
        (&[0x91; 10], 4000.0, 5000.0),
        (&[0x92; 9], 1000.0, 100.0),
        (&[0x92; 9], 1.0, 1.0),
        (&[0x91, 0x93, 0x93, 0x94], 1000.0, 1110.0),
    ] {
        let mut rig = moving(&fast(), &line(&[100.0], programmed));
        rig.run_to(200 * MS);
        for byte in bytes {
            rig.receive(*byte);
        }
        rig.run_to(700 * MS);
        let feed = rig.snapshot().feed_mm_min;
        assert!((feed - reached).abs() < 0.01 * reached, "{feed} {reached}");
    }
}

#[test]
fn a_jog_has_no_feed_override() {
    let mut rig = moving(&fast(), &jog(&[100.0], 1000.0));
    rig.receive(0x91);
    rig.run_to(200 * MS);
    assert_eq!(rig.snapshot().feed_mm_min.round(), 1000.0);
}

#[test]
fn the_end_of_a_program_and_a_reset_end_overrides() {
    let mut rig = Rig::new(&fast());
    for byte in [0x91, 0x97, 0x9a] {
        rig.receive(byte);
    }
    let overrides = rig.snapshot().overrides;
    assert_eq!(
        (overrides.feed, overrides.rapid, overrides.spindle),
        (110, 25, 110)
    );
    send(&mut rig, Work::EndOverrides);
    assert_eq!(
        rig.snapshot().overrides,
        leadscrew::machine::Overrides::NONE
    );
    rig.receive(0x91);
    rig.receive(RESET);
    assert_eq!(rig.snapshot().overrides.feed, 100);
}

#[test]
fn hold_and_start_together_hold() {
    let mut rig = moving(&fast(), &line(&[50.0], 3000.0));
    rig.run_to(200 * MS);
    rig.receive(b'!');
    assert_eq!(state(&rig), State::HoldSlowing);
    rig.receive(b'~');
    rig.run_to_rest();
    assert_eq!(state(&rig), State::HoldComplete);
    rig.receive(b'~');
    assert_eq!(state(&rig), State::Run);
    rig.run_to_rest();
    assert_eq!(state(&rig), State::Idle);
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
        rig.run_to_rest();
        let snapshot = rig.snapshot();
        let expected = if byte == DOOR {
            State::DoorClosed
        } else {
            State::Idle
        };
        assert_eq!(snapshot.state, expected);
        assert_eq!((snapshot.finished, snapshot.cuts), (3, 1));
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
    rig.run_to_rest();
    assert_eq!(rig.snapshot().steps[0], 1600);
    // Nor is it kept for the next jog.
    rig.receive(CANCEL);
    go(&mut rig, &jog(&[0.0], 2000.0));
    rig.run_to_rest();
    assert_eq!(rig.snapshot().steps[0], 0);
}

#[test]
fn queued_jogs_do_not_stop_between() {
    let mut rig = moving(&fast(), &jog(&[10.0], 2000.0));
    go(&mut rig, &jog(&[20.0], 2000.0));
    go(&mut rig, &jog(&[30.0], 2000.0));
    rig.run_to_rest();
    let steps = rig.trace.steps(0);
    let seconds = steps[steps.len() - 1].seconds - steps[0].seconds;
    // 30 mm at 2000 mm/min, and one ramp up and one down.
    assert!(seconds < 30.0 / (2000.0 / 60.0) + 2.0 * 0.067, "{seconds}");
    assert_eq!(steps.len(), 2400);
}

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
        (snapshot.coolant, snapshot.coolant_asked),
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
    rig.run_to_rest();
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
fn a_door_that_stays_open_lets_nothing_start() {
    let mut rig = moving(&fast(), &line(&[30.0], 1000.0));
    rig.run_to(200 * MS);
    rig.drive.inputs.set_closed(Levels::DOOR);
    rig.receive(DOOR);
    rig.run_to_rest();
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
fn a_limit_switch_that_is_active_locks_at_a_reset() {
    let settings = Settings {
        hard_limits: true,
        ..fast()
    };
    let mut rig = Rig::new(&settings);
    rig.drive.inputs.set_closed(Levels::limits(1));
    for _ in 0..2 {
        let mut line = heapless::spsc::Queue::<u8, 4>::new();
        let (mut line, _) = line.split();
        let _ = leadscrew::protocol::realtime::receive(RESET, &rig.requests, &mut line);
        rig.drive.release_prepare();
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
    rig.run_to_rest();
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
fn the_spindle_stops_in_a_hold_only_and_comes_back() {
    let mut rig = Rig::new(&fast());
    send(&mut rig, Work::Spindle(Spindle::Clockwise, 1000.0));
    rig.receive(0x9e);
    assert_eq!(rig.snapshot().spindle, Spindle::Clockwise);
    go(&mut rig, &line(&[30.0], 1000.0));
    rig.run_to(300 * MS);
    rig.receive(0x9e);
    rig.receive(b'!');
    rig.run_to_rest();
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
    rig.run_to_rest();
    rig.receive(0x99);
    assert_eq!(rig.snapshot().spindle_rpm, 500.0);
    assert_eq!(rig.drive.outputs().duty / 4, 128);
}

#[test]
fn coolant_is_toggled_where_grbl_does() {
    let mut rig = Rig::new(&fast());
    rig.receive(0xa0);
    assert!(rig.snapshot().coolant.flood && rig.snapshot().coolant_asked.flood);
    assert_eq!(rig.snapshot().coolant_toggles, 1);
    rig.receive(0xa1);
    assert!(!rig.snapshot().coolant_asked.mist);
    rig.receive(b'!');
    rig.receive(0xa0);
    assert!(!rig.snapshot().coolant.flood);
    rig.receive(DOOR);
    rig.receive(0xa0);
    assert!(!rig.snapshot().coolant_asked.flood);
}

/// A block with a laser.
fn burn(rig: &mut Rig, command: &Command, laser: Laser) {
    let Some(Work::Move(block)) = rig.router.work(command) else {
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
    rig.run_to_rest();
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
        &line_at(at(&[10.0]), Pace::Rapid),
        Laser::Constant(0.0),
    );
    rig.run_to(20 * MS);
    assert_eq!(rig.snapshot().spindle, Spindle::Off);
    rig.run_to_rest();
    burn(&mut rig, &line(&[20.0], 3000.0), Laser::Constant(500.0));
    rig.run_to_rest();
    assert_eq!(rig.snapshot().spindle_rpm, 500.0);
    assert_eq!(rig.drive.outputs().duty / 4, 128);
    burn(
        &mut rig,
        &line_at(at(&[0.0]), Pace::Rapid),
        Laser::Constant(0.0),
    );
    rig.run_to_rest();
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
        rig.run_to_rest();
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
    rig.run_to_rest();
    assert_eq!(rig.drive.outputs().duty, 0);
    rig.receive(b'~');
    assert_eq!(state(&rig), State::Run);
    rig.run_to(rig.now + 10 * MS);
    assert_eq!(rig.drive.outputs().duty / 4, 128);
    assert_eq!(notices(&rig), [Notice::CheckDoor]);
}

#[test]
fn drivers_are_on_in_motion_and_for_a_while_after_it() {
    let mut rig = Rig::new(&fast());
    assert!(!rig.drive.outputs().drivers);
    go(&mut rig, &line(&[1.0], 1000.0));
    assert!(rig.drive.outputs().drivers);
    rig.run_to_rest();
    let end = rig.now;
    rig.run_to(end + 24 * MS);
    assert!(rig.drive.outputs().drivers);
    rig.run_to(end + 26 * MS);
    assert!(!rig.drive.outputs().drivers);
    // Motion that comes in between keeps them on.
    go(&mut rig, &line(&[0.0], 1000.0));
    rig.run_to_rest();
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
    rig.run_to_rest();
    rig.run_to(rig.now + 10_000 * MS);
    assert!(rig.drive.outputs().drivers);
    send(&mut rig, Work::Sleep);
    assert!(!rig.drive.outputs().drivers);
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
                    pace: Pace::Jog(_),
                    ..
                }
            );
            let mut rig = moving(&fast(), &command);
            send(&mut rig, Work::Spindle(Spindle::Off, 0.0));
            rig.run_to(300 * MS);
            for byte in bytes {
                match byte {
                    b'#' => rig.run_to_rest(),
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
            rig.run_to_rest();
            let expected = if is_alarm { State::Alarm } else { State::Idle };
            assert_eq!(state(&rig), expected);
            assert_eq!(rig.snapshot().steps, rig.trace.net_steps());
            check_limits(&fast(), &rig.trace);
        }
    }
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
    rig.run_to_rest();
    assert_eq!(state(&rig), State::Alarm);
    rig.run_to(rig.now + 26 * MS);
    assert_eq!(*rig.drive.outputs(), Outputs::default());
}

/// A homed machine that parks, with Z 20 mm down and X on its way.
fn above_work() -> Rig {
    let settings = Settings {
        parking: true,
        homing: true,
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
    rig.run_to_rest();
    assert_eq!(rig.snapshot().steps.0[..3], [2400, 0, -1600]);
    check_limits(&fast(), &rig.trace);
    rig.trace.check_pulses();
}

#[test]
fn a_door_opened_on_the_way_back_parks_again() {
    // Fast on the way to the waypoint, waiting there, and slow into the work.
    for ms in [500, 3000, 7000] {
        let mut rig = above_work();
        rig.receive(DOOR);
        wait_for(&mut rig, State::DoorClosed);
        rig.receive(b'~');
        rig.run_to(rig.now + ms * MS);
        assert_eq!(state(&rig), State::DoorRestoring);
        rig.receive(DOOR);
        wait_for(&mut rig, State::DoorClosed);
        assert_eq!(z(&rig), -400);
        assert_eq!(rig.snapshot().spindle, Spindle::Off);
        rig.receive(b'~');
        wait_for(&mut rig, State::Run);
        rig.run_to_rest();
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
        rig.run_to_rest();
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
    rig.run_to_rest();
    assert_eq!(state(&rig), State::DoorClosed);
    let mut rig = above_work();
    rig.run_to_rest();
    go(&mut rig, &jog(&[0.0, 0.0, -20.0], 1000.0));
    rig.run_to(rig.now + 200 * MS);
    rig.receive(DOOR);
    rig.run_to_rest();
    assert_eq!((state(&rig), z(&rig)), (State::DoorClosed, -1600));
    assert_eq!(rig.snapshot().spindle, Spindle::Off);
}

#[test]
fn a_reset_drops_what_is_held() {
    for byte in [b'!', DOOR] {
        let mut rig = moving(&fast(), &line(&[50.0], 3000.0));
        go(&mut rig, &line(&[0.0], 3000.0));
        rig.run_to(300 * MS);
        rig.receive(byte);
        rig.run_to_rest();
        let steps = rig.snapshot().steps;
        rig.receive(RESET);
        rig.run_to(rig.now + 5000 * MS);
        let snapshot = rig.snapshot();
        assert_eq!((snapshot.state, snapshot.steps), (State::Idle, steps));
        assert_eq!((snapshot.finished, snapshot.is_at_rest), (2, true));
    }
}

fn commands(jogs: bool) -> impl Strategy<Value = Vec<Command>> {
    let coordinate = prop_oneof![
        4 => -3_000_000..3_000_000_i64,
        2 => -30_000..30_000_i64,
        1 => Just(0_i64),
    ];
    let pace = (0..4_u8, 20.0..12_000.0_f32).prop_map(move |(kind, mm_min)| match kind {
        _ if jogs => Pace::Jog(mm_min),
        0 => Pace::Rapid,
        _ => Pace::Feed(mm_min),
    });
    let line = (prop::array::uniform3(coordinate), pace).prop_map(|(nm, pace)| {
        line_at(
            Axes::from_fn(|axis| nm.get(axis).map_or(Nm(0), |nm| Nm(*nm))),
            pace,
        )
    });
    prop::collection::vec(line, 1..16)
}

/// Times in ms and bytes, in order of time.
fn acts(bytes: &'static [u8]) -> impl Strategy<Value = Vec<Act>> {
    let byte = prop::sample::select(bytes);
    prop::collection::vec((0..700_u64, byte), 0..16).prop_map(|mut acts| {
        acts.sort_unstable();
        acts.into_iter()
            .map(|(ms, byte)| (ms * MS + 7919 * ms, byte))
            .collect()
    })
}

fn settings() -> impl Strategy<Value = Settings> {
    let steps = prop::sample::select(vec![10.0, 78.74, 80.0, 250.0, 320.0, 1000.0 / 3.0]);
    (
        prop::array::uniform3(steps),
        prop::array::uniform3(60.0..12_000.0_f32),
        prop::array::uniform3(5.0..5000.0_f32),
    )
        .prop_map(|(steps, rates, accelerations)| with(&steps, &rates, &accelerations))
}

fn play(settings: &Settings, commands: &[Command], acts: &[Act], feed_ticks: u64) -> Trace {
    let commands = number(commands);
    let mut rig = Rig::new(settings);
    rig.feed_ticks = feed_ticks;
    rig.run(&commands, acts);
    rig.trace.check_pulses();
    check_limits(settings, &rig.trace);
    rig.trace
}

proptest! {
    #![proptest_config(cases(48))]

    #[test]
    fn overrides_and_holds_keep_every_limit_and_the_path(
        settings in settings(),
        commands in commands(false),
        acts in acts(&[0x90, 0x91, 0x92, 0x91, 0x92, 0x95, 0x96, 0x97, b'!', b'~', DOOR]),
        feed_ticks in prop::sample::select(vec![0, 3_000_000_u64]),
    ) {
        let trace = play(&settings, &commands, &acts, feed_ticks);
        check_path(&settings, &number(&commands), &trace, 1.0);
        let end = commands.last().and_then(target).unwrap();
        prop_assert_eq!(trace.net_steps(), target_steps(&settings, &end));
    }

    #[test]
    fn no_stop_of_any_kind_loses_or_doubles_a_step(
        settings in settings(),
        commands in commands(false),
        acts in acts(&[RESET, b'!', b'~', DOOR, CANCEL, 0x92, 0x91, 0x97]),
        feed_ticks in prop::sample::select(vec![0, 3_000_000_u64]),
    ) {
        play(&settings, &commands, &acts, feed_ticks);
    }

    #[test]
    fn no_end_of_a_jog_loses_or_doubles_a_step(
        settings in settings(),
        commands in commands(true),
        acts in acts(&[RESET, b'!', b'~', DOOR, CANCEL, CANCEL, 0x92]),
        feed_ticks in prop::sample::select(vec![0, 3_000_000_u64]),
    ) {
        play(&settings, &commands, &acts, feed_ticks);
    }
}
