//! `CoreXY`, `$795`: the motors' steps against the path of the axes, and the limits of the motors.

use crate::support::{
    Rig, Trace, arc, at, cases, check_limits, check_path, follow, line, line_at, number,
    pieces_of_blended, slack, target, target_steps, with,
};
use leadscrew::{
    axis::{Axes, X, Y, Z},
    model::{Command, FeedRate, PathControl, Plane, Rotation, core_xy},
    path::TiltedArc,
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

/// A machine whose motors differ in what they can do, with limits of jerk or without.
fn belts(has_jerk: bool) -> Settings {
    Settings {
        core_xy: true,
        jerk_mm_s3: Axes::all(if has_jerk { 10_000.0 } else { 0.0 }),
        ..with(
            &[160.0, 160.0, 400.0],
            &[6000.0, 5000.0, 900.0],
            &[800.0, 600.0, 100.0],
        )
    }
}

/// Lines, arcs, helices and spirals in the plane of X and Y; with `others`, arcs in other planes, too.
fn programs(others: bool) -> impl Strategy<Value = Vec<Command>> {
    let move_ = (
        prop::array::uniform3(-6.0..6.0_f64),
        prop_oneof![2 => Just(0_usize), 3 => 1_usize..4],
        0.2..4.0_f64,
        prop::array::uniform2(-3.1..3.1_f64),
        prop::sample::select(vec![200.0_f32, 1500.0, 6000.0]),
        any::<bool>(),
    );
    prop::collection::vec(move_, 1..12).prop_map(move |moves| {
        let mut here = [0.0_f64; 3];
        let mut commands = Vec::new();
        for (to, kind, radius, angles, feed, is_clockwise) in moves {
            let plane = match kind {
                0 => None,
                2 if others => Some(Plane::Zx),
                3 if others => Some(Plane::Yz),
                _ => Some(Plane::Xy),
            };
            let Some(plane) = plane else {
                here = to;
                commands.push(line(&here, feed));
                continue;
            };
            let rotation = if is_clockwise {
                Rotation::Clockwise
            } else {
                Rotation::CounterClockwise
            };
            let (first, second, normal) = plane.axes();
            let [from, until] = angles;
            let centre = [-radius * from.cos(), -radius * from.sin()];
            here[first] += centre[0] + radius * until.cos();
            here[second] += centre[1] + radius * until.sin();
            if feed > 1000.0 {
                // A helix.
                here[normal] += 0.3 * radius;
            }
            commands.push(arc(plane, rotation, &here, centre, feed));
        }
        commands
    })
}

/// Returns the commands with chords for the arcs of which the machine gets chords, as the session makes them.
fn with_chords(settings: &Settings, commands: &[Command]) -> Vec<Command> {
    let mut from = Axes::all(Nm(0));
    let mut sent = Vec::new();
    for command in commands {
        match TiltedArc::of(command, &from, settings) {
            Some(mut arc) => sent.extend(std::iter::from_fn(|| arc.next_chord())),
            None => sent.push(*command),
        }
        from = target(command).unwrap_or(from);
    }
    sent
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn random_programs_stay_within_half_a_step_of_their_path(
        commands in programs(false),
        has_jerk: bool,
    ) {
        let settings = belts(has_jerk);
        let commands = number(&commands);
        let trace = Rig::play(&settings, &commands);
        trace.check_pulses();
        check_path(&settings, &commands, &trace, slack(&settings, &commands));
        check_limits(&settings, &trace);
        // Where the motors stand is where a cartesian machine is, to half of their steps.
        let end = core_xy::steps_of(trace.net_steps());
        let cartesian = Settings { core_xy: false, ..settings };
        let there = Rig::play(&cartesian, &commands).net_steps();
        for axis in [X, Y, Z] {
            prop_assert!((end[axis] - there[axis]).abs() <= 1, "{end:?}, {there:?}");
        }
    }

    #[test]
    fn arcs_of_other_planes_are_chords_within_the_arc_tolerance(commands in programs(true)) {
        let settings = belts(false);
        let sent = number(&with_chords(&settings, &commands));
        let trace = Rig::play(&settings, &sent);
        trace.check_pulses();
        // `$12` along X and along Y is twice that for a motor; a chord may make no step.
        let tolerance = 2.0 * f64::from(settings.arc_tolerance_mm) * 400.0;
        check_path(&settings, &commands, &trace, tolerance + slack(&settings, &sent));
        check_limits(&settings, &trace);
    }

    #[test]
    fn rounded_corners_are_followed_by_the_motors(
        commands in programs(false),
        tolerance_um in prop::sample::select(vec![0_u32, 5, 50, 500]),
        has_jerk: bool,
    ) {
        let settings = belts(has_jerk);
        let commands = number(&commands);
        let mut rig = Rig::new(&settings);
        rig.control = PathControl::Continuous { tolerance_nm: 1000 * tolerance_um, merging_nm: 0 };
        rig.run(&commands, &[]);
        rig.trace.check_pulses();
        let pieces = pieces_of_blended(&settings, &rig.blended);
        follow(&settings, &pieces, &rig.trace, 1.0);
        check_limits(&settings, &rig.trace);
        let end = commands.iter().rev().find_map(target);
        let end = target_steps(&settings, &end.unwrap_or(Axes::all(Nm(0))));
        prop_assert_eq!(rig.trace.net_steps(), end);
    }
}

/// Plays a rapid from the origin.
fn rapid(settings: &Settings, mm: [f64; 2]) -> Trace {
    Rig::play(settings, &[line_at(at(&mm), FeedRate::Rapid)])
}

#[test]
fn a_motor_that_turns_alone_moves_as_the_motor_of_an_axis_does() {
    for has_jerk in [false, true] {
        let core = belts(has_jerk);
        let cartesian = Settings {
            core_xy: false,
            ..core
        };
        // Along one diagonal only A turns, along the other only B: by X + Y, and by X - Y.
        for (diagonal, motor, along) in [
            ([30.0, 30.0], X, [60.0, 0.0]),
            ([30.0, -30.0], Y, [0.0, 60.0]),
            ([-7.5, 7.5], Y, [0.0, -15.0]),
        ] {
            let (core, cartesian) = (rapid(&core, diagonal), rapid(&cartesian, along));
            assert_eq!(core.net_steps(), cartesian.net_steps());
            let times = |trace: &Trace| -> Vec<u64> {
                let steps = trace.steps(motor);
                steps
                    .iter()
                    .map(|step| step.ticks - steps[0].ticks)
                    .collect()
            };
            for (core, cartesian) in times(&core).into_iter().zip(times(&cartesian)) {
                let difference = core.abs_diff(cartesian);
                assert!(
                    difference <= 4 + cartesian / 10_000,
                    "{difference} of {cartesian} ticks"
                );
            }
        }
    }
}

#[test]
fn both_motors_turn_for_one_axis_with_the_limits_of_the_slower() {
    let core = belts(false);
    let slower = Settings {
        core_xy: false,
        max_rate_mm_min: Axes::all(core.max_rate_mm_min[Y]),
        acceleration_mm_s2: Axes::all(core.acceleration_mm_s2[Y]),
        ..core
    };
    for (mm, motors) in [([40.0, 0.0], [6400, 6400]), ([0.0, 40.0], [6400, -6400])] {
        let (trace, alone) = (rapid(&core, mm), rapid(&slower, mm));
        let net = trace.net_steps();
        assert_eq!([net[X], net[Y]], motors);
        let difference = trace.motion_seconds() - alone.motion_seconds();
        assert!(difference.abs() < 1.0e-3, "{difference} s");
    }
}

#[test]
fn a_full_circle_takes_both_motors_there_and_back() {
    for rotation in [Rotation::Clockwise, Rotation::CounterClockwise] {
        let commands = [arc(Plane::Xy, rotation, &[0.0; 3], [3.0, -4.0], 2000.0)];
        let settings = belts(false);
        let trace = Rig::play(&settings, &commands);
        check_path(&settings, &commands, &trace, 0.0);
        for motor in [X, Y] {
            // Four times the radius, times the square root of 2.
            let steps = trace.steps(motor).len() as f64;
            let expected = 4.0 * 5.0 * std::f64::consts::SQRT_2 * 160.0;
            assert!((steps - expected).abs() <= 4.0, "{steps}, {expected}");
        }
    }
}
