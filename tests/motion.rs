//! Moves as the step pins show them: exact counts, limits kept, path kept.
#![cfg(not(target_os = "none"))]

mod support;

use leadscrew::{
    axis::Axes,
    planner::{Command, Pace, Plane, Rotation},
    settings::Settings,
    units::{Nm, TICKS_PER_MS},
};
use proptest::prelude::*;
use support::{
    Act, RESET, Rig, Trace, arc, cases, check_limits, check_path, fast, line, line_at, number,
    target, target_steps, with,
};

/// A move too short for a step becomes part of the next: that one's path begins up to a step off.
fn slack(settings: &Settings, commands: &[Command]) -> f64 {
    let mut before = Axes::all(0);
    let mut has_shifted = false;
    for target in commands.iter().filter_map(target) {
        let steps = target_steps(settings, &target);
        has_shifted |= steps == before;
        before = steps;
    }
    if has_shifted { 1.0 } else { 0.0 }
}

/// Plays numbered commands; checks counts, pulses, path and limits.
fn check(settings: &Settings, commands: &[Command]) -> Trace {
    let commands = number(commands);
    let trace = Rig::play(settings, &commands);
    trace.check_pulses();
    check_path(settings, &commands, &trace, slack(settings, &commands));
    check_limits(settings, &trace);
    trace
}

#[test]
fn a_line_makes_its_steps() {
    let trace = check(&fast(), &[line(&[10.0, -5.0, 2.5], 3000.0)]);
    assert_eq!(trace.net_steps().0[..3], [800, -400, 200]);
}

#[test]
fn the_same_program_twice_makes_the_same_trace() {
    let settings = with(&[78.74, 320.0, 400.0], &[9000.0], &[700.0]);
    let commands = [
        line(&[10.0, -5.0, 2.5], 3000.0),
        arc(
            Plane::Xy,
            Rotation::Clockwise,
            &[10.0, -5.0, 4.0],
            [1.0, 2.0],
            1500.0,
        ),
        line(&[-3.0, 4.0, 2.5], 9000.0),
    ];
    let acts = [(9_000_000, b'!'), (12_000_000, b'~'), (60_000_000, RESET)];
    let play = || {
        let mut rig = Rig::new(&settings);
        rig.run(&commands, &acts);
        rig.trace.hash()
    };
    assert_eq!(play(), play());
}

fn settings() -> impl Strategy<Value = Settings> {
    let steps = prop::sample::select(vec![
        1.0,
        10.0,
        78.74,
        80.0,
        157.480_315,
        250.0,
        320.0,
        1000.0 / 3.0,
        400.0,
        1280.0,
    ]);
    (
        prop::array::uniform3(steps),
        prop::array::uniform3(60.0..12_000.0_f32),
        prop::array::uniform3(5.0..5000.0_f32),
        prop::sample::select(vec![1_u8, 3, 5, 10, 20, 60]),
    )
        .prop_map(|(steps, rates, accelerations, step_pulse_us)| Settings {
            step_pulse_us,
            ..with(&steps, &rates, &accelerations)
        })
}

/// Lines, some of them rapid, in inverse time, short or without any length.
fn lines() -> impl Strategy<Value = Vec<Command>> {
    let coordinate = prop_oneof![
        4 => -3_000_000..3_000_000_i64,
        2 => -30_000..30_000_i64,
        1 => Just(0_i64),
    ];
    let pace = prop_oneof![
        Just(Pace::Rapid),
        (20.0..12_000.0_f32).prop_map(Pace::Feed),
        (30.0..3000.0_f32).prop_map(Pace::InverseTime),
    ];
    let line = (prop::array::uniform3(coordinate), pace).prop_map(|(nm, pace)| {
        line_at(
            Axes::from_fn(|axis| nm.get(axis).map_or(Nm(0), |nm| Nm(*nm))),
            pace,
        )
    });
    prop::collection::vec(line, 1..12)
}

/// Times in ms and bytes, in order of time.
fn acts() -> impl Strategy<Value = Vec<Act>> {
    let byte = prop::sample::select(vec![b'!', b'!', b'~', b'~', b'~', RESET]);
    prop::collection::vec((0..700_u64, byte), 0..8).prop_map(|mut acts| {
        acts.sort_unstable();
        acts.into_iter()
            .map(|(ms, byte)| (ms * u64::from(TICKS_PER_MS) + 7919 * ms, byte))
            .collect()
    })
}

proptest! {
    #![proptest_config(cases(48))]

    #[test]
    fn lines_end_on_their_steps_within_all_limits(settings in settings(), commands in lines()) {
        let trace = check(&settings, &commands);
        let end = commands.last().and_then(target).unwrap();
        prop_assert_eq!(trace.net_steps(), target_steps(&settings, &end));
    }

    #[test]
    fn no_hold_resume_or_reset_loses_or_doubles_a_step(
        settings in settings(),
        commands in lines(),
        acts in acts(),
        feed_ticks in prop::sample::select(vec![0, 100_000, 3_000_000_u64]),
    ) {
        let commands = number(&commands);
        let mut rig = Rig::new(&settings);
        rig.feed_ticks = feed_ticks;
        rig.run(&commands, &acts);
        rig.trace.check_pulses();
        check_limits(&settings, &rig.trace);
        if rig.trace.resets.is_empty() {
            check_path(&settings, &commands, &rig.trace, slack(&settings, &commands));
        }
    }
}
