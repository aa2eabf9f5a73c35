//! Rotary axes beside linear ones, as the step pins show them.

use crate::support::{self, Rig, Trace, at, cases, check_path, line, peaks, target_steps, with};
use leadscrew::{
    axis::{AXES, Axes},
    model::{Circle, Command, FeedRate, Plane, Rotation},
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

/// Corners are passed at next to no speed, so that no axis may exceed its acceleration across one.
fn settings(ramp_s: f32) -> Settings {
    let settings = Settings {
        step_pulse_us: 3,
        junction_deviation_mm: 1.0e-6,
        ..with(
            &[80.0, 80.0, 80.0, 20.0],
            &[5000.0, 5000.0, 5000.0, 20_000.0],
            &[500.0, 500.0, 500.0, 1000.0],
        )
    };
    let jerk_mm_s3 = settings.acceleration_mm_s2.map(|acceleration| {
        if ramp_s > 0.0 {
            acceleration / ramp_s
        } else {
            0.0
        }
    });
    Settings {
        jerk_mm_s3,
        ..settings
    }
}

/// Most degrees that a rotary axis turns for one mm of these paths.
const SHARE: f64 = 100.0;
/// Speed along the path that is as good as a standstill, mm/s: 1 mm/min.
const SLOWEST_MM_S: f64 = 1.0 / 60.0;

/// Plays commands as one line of the program; no axis exceeds its limits, also across their ends.
fn check(settings: &Settings, commands: &[Command]) -> Trace {
    let trace = Rig::play(settings, commands);
    trace.check_pulses();
    check_path(settings, commands, &trace, 1.0);
    for axis in 0..AXES {
        for window_s in [0.003, 0.008] {
            let peaks = peaks(settings, &trace, axis, window_s);
            let rate = f64::from(settings.max_rate_mm_min[axis]) / 60.0;
            assert!(peaks.speed_mm_s <= rate * 1.002, "axis {axis}: {peaks:?}");
            // A path ends at once at the slowest speed.
            let stop = SLOWEST_MM_S * SHARE / window_s;
            let least = f64::from(settings.acceleration_mm_s2[axis]) * 1.02 + stop;
            assert!(
                peaks.acceleration_mm_s2 <= least,
                "axis {axis}: {peaks:?} of {least}"
            );
        }
    }
    trace
}

#[test]
fn a_rotary_axis_does_not_jump_where_its_share_of_the_path_changes() {
    for ramp_s in [0.0, 0.05] {
        let settings = settings(ramp_s);
        for (first, second) in [
            // A hundred degrees for each mm, then degrees alone, and the other way round.
            ([1.0, 0.0, 0.0, 100.0], [1.0, 0.0, 0.0, 200.0]),
            ([0.0, 0.0, 0.0, 100.0], [1.0, 0.0, 0.0, 200.0]),
            ([10.0, 0.0, 0.0, 20.0], [11.0, 0.0, 0.0, 200.0]),
            ([10.0, 5.0, 0.0, 20.0], [20.0, 10.0, 0.0, 21.0]),
        ] {
            check(&settings, &[line(&first, 600.0), line(&second, 600.0)]);
        }
    }
}

#[test]
fn the_feed_of_an_arc_is_that_of_its_linear_axes() {
    // A half turn of 5 mm radius at 10 mm/s, while A turns by 90 degrees.
    let target = at(&[10.0, 0.0, 0.0, 90.0]);
    let arc = Command::Arc {
        target: target.into(),
        circle: Circle {
            plane: Plane::Xy,
            centre: [Nm::from_mm_f64(5.0), Nm(0)],
            rotation: Rotation::Clockwise,
            turns: 1,
            tilt: leadscrew::units::MicroDegrees::ZERO,
        },
        feed_rate: FeedRate::Feed(600.0),
        line: 0,
    };
    let trace = check(&settings(0.0), &[arc]);
    let seconds = 5.0 * std::f64::consts::PI / 10.0;
    assert!(
        (trace.motion_seconds() - seconds).abs() < 0.1,
        "{}",
        trace.motion_seconds()
    );
}

#[test]
fn a_turn_with_hardly_any_linear_distance_reaches_its_end() {
    for ramp_s in [0.0, 0.05] {
        let settings = settings(ramp_s);
        for target in [
            [0.0001, 0.0, 0.0, 50.0],
            [0.00625, 0.0, 0.0, 500.0],
            [0.0125, 0.0, 0.0, 2000.0],
            [0.0, 0.1, 0.0, 2000.0],
        ] {
            let trace = check(&settings, &[line(&target, 1000.0)]);
            assert_eq!(trace.net_steps(), target_steps(&settings, &at(&target)));
        }
    }
}

#[test]
fn a_feed_is_along_the_linear_axes_where_they_make_steps() {
    let seconds = |target: &[f64], feed| {
        // A remaining distance shorter than a step is no linear move.
        let commands = [line(&[0.0001], 600.0), line(target, feed)];
        check(&settings(0.0), &commands).motion_seconds()
    };
    for (target, feed, expected) in [
        ([0.0001, 0.0, 0.0, 50.0], 600.0, 5.0),
        ([0.1, 0.0, 0.0, 200.0], 1.5, 4.0),
        ([0.1, 0.0, 0.0, 50.0], 1.5, 4.0),
    ] {
        let found = seconds(&target, feed);
        assert!((found - expected).abs() < 0.15, "{target:?}: {found}");
    }
}

/// Ways of the linear and the rotary axes, and how fast.
fn moves() -> impl Strategy<Value = Vec<Command>> {
    let displacement = prop_oneof![Just(0.0), 1.0..5.0_f64, -5.0..-1.0_f64];
    let turn = prop_oneof![2 => Just(0.0), 2 => -SHARE..SHARE, 1 => -2.0..2.0_f64];
    let feed_rate = prop_oneof![
        Just(FeedRate::Rapid),
        (100.0..6000.0_f32).prop_map(FeedRate::Feed),
        (30.0..600.0_f32).prop_map(FeedRate::InverseTime),
    ];
    let bulge = prop::option::weighted(0.2, 0.2..3.0_f64);
    let one = (
        prop::array::uniform3(displacement),
        prop::array::uniform3(turn),
        feed_rate,
        bulge,
    );
    prop::collection::vec(one, 1..12).prop_map(|moves| {
        let mut position = [0.0; 6];
        let mut commands = Vec::new();
        for (linear, turns, feed_rate, bulge) in moves {
            for (axis, displacement) in linear.into_iter().chain(turns).enumerate() {
                position[axis] += displacement;
            }
            let target = at(&position[..AXES]);
            let [x, y, _] = linear;
            commands.push(match bulge {
                Some(bulge) if x != 0.0 && y != 0.0 => Command::Arc {
                    target: target.into(),
                    circle: Circle {
                        plane: Plane::Xy,
                        centre: [0.5 * x - bulge * y, 0.5 * y + bulge * x].map(Nm::from_mm_f64),
                        rotation: Rotation::Clockwise,
                        turns: 1,
                        tilt: leadscrew::units::MicroDegrees::ZERO,
                    },
                    feed_rate,
                    line: 0,
                },
                _ => support::line_at(target, feed_rate),
            });
        }
        commands
    })
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn no_axis_exceeds_its_limits_across_the_ends_of_moves(
        commands in moves(),
        ramp_s in prop_oneof![Just(0.0_f32), 0.005..0.1_f32],
    ) {
        let settings = settings(ramp_s);
        let trace = check(&settings, &commands);
        let end = commands.last().and_then(support::target).unwrap_or(Axes::all(Nm(0)));
        prop_assert_eq!(trace.net_steps(), target_steps(&settings, &end));
    }
}
