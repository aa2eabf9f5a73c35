//! Arcs as the step pins show them, against exact geometry.

use std::f64::consts::TAU;

use crate::support::{
    self, Rig, Trace, arc, at, cases, check_limits, check_path, each, line, number, target_steps,
    with,
};
use leadscrew::{
    axis::Axes,
    model::{Command, Plane, Rotation},
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

const ROTATIONS: [Rotation; 2] = [Rotation::Clockwise, Rotation::CounterClockwise];
const PLANES: [Plane; 3] = [Plane::Xy, Plane::Zx, Plane::Yz];

/// Plays arcs and checks counts, path and pulses; the largest distance from the path, in steps.
fn check(settings: &Settings, commands: &[Command]) -> (Trace, f64) {
    let trace = Rig::play(settings, commands);
    trace.check_pulses();
    let worst = check_path(settings, commands, &trace, 0.0);
    (trace, worst)
}

/// A point in a plane, mm.
fn in_plane(plane: Plane, first: f64, second: f64, normal: f64) -> [f64; 3] {
    let (a, b, c) = plane.axes();
    let mut point = [0.0; 3];
    (point[a], point[b], point[c]) = (first, second, normal);
    point
}

/// An arc on a circle around (0, 0) from one angle to another (degrees), after a line to its start.
fn around_origin(
    plane: Plane,
    rotation: Rotation,
    radius: f64,
    from: f64,
    to: f64,
    mm_min: f32,
) -> [Command; 2] {
    let on = |degrees: f64| {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        [radius * cosine, radius * sine]
    };
    let (a, b) = (on(from), on(to));
    [
        line(&in_plane(plane, a[0], a[1], 0.0), mm_min),
        arc(
            plane,
            rotation,
            &in_plane(plane, b[0], b[1], 0.0),
            [-a[0], -a[1]],
            mm_min,
        ),
    ]
}

fn settings() -> Settings {
    with(&[80.0, 320.0, 157.48], &[6000.0], &[500.0, 400.0, 300.0])
}

#[test]
fn arcs_stay_on_their_circle_in_all_planes_directions_and_quadrants() {
    for plane in PLANES {
        for rotation in ROTATIONS {
            for (from, to) in [
                (0, 90),
                (90, 180),
                (200, 250),
                (300, 20),
                (45, 44),
                (10, 190),
            ] {
                let commands = around_origin(plane, rotation, 2.1, from.into(), to.into(), 900.0);
                check(&settings(), &commands);
            }
        }
    }
}

#[test]
fn full_circles_close() {
    for plane in PLANES {
        for rotation in ROTATIONS {
            for centre in [[1.0, 0.0], [-0.377, 0.8134], [0.0, -1.3]] {
                let commands = [arc(plane, rotation, &[0.0; 3], centre, 2000.0)];
                let (trace, _) = check(&settings(), &commands);
                let (first, ..) = plane.axes();
                let radius = f64::hypot(centre[0], centre[1]);
                let steps_per_mm = f64::from(settings().steps_per_mm[first].to_f32());
                let there_and_back = 4.0 * radius * steps_per_mm;
                let steps = trace.steps(first).len() as f64;
                assert!((steps - there_and_back).abs() <= 4.0, "{steps}");
            }
        }
    }
}

#[test]
fn helices_spirals_and_odd_centres_stay_on_their_path() {
    for rotation in ROTATIONS {
        let helix = arc(Plane::Xy, rotation, &[0.0, 0.0, 3.3], [1.5, 0.7], 2400.0);
        // The end is 4 µm farther from the centre than the start.
        let spiral = arc(Plane::Zx, rotation, &[2.004, 0.0, 0.0], [0.0, 1.0], 1200.0);
        let off_grid = arc(
            Plane::Yz,
            rotation,
            &[0.0, 1.234_567, 0.765_433],
            [0.617_283, 0.382_716],
            1200.0,
        );
        for command in [helix, spiral, off_grid] {
            check(&settings(), &[command]);
        }
    }
}

#[test]
fn many_turns_are_all_made() {
    for rotation in ROTATIONS {
        for turns in [2, 3, 7] {
            let mut helix = arc(Plane::Xy, rotation, &[1.0, 1.0, 4.0], [1.0, 0.0], 3000.0);
            if let Command::Arc { circle, .. } = &mut helix {
                circle.turns = turns;
            }
            check(&settings(), &[helix]);
        }
    }
}

#[test]
fn a_circle_of_ten_metres_stays_within_half_a_step() {
    let settings = with(&[80.0, 78.74, 400.0], &[60_000.0], &[3000.0]);
    for rotation in ROTATIONS {
        let commands = around_origin(Plane::Xy, rotation, 10_000.0, 89.0, 89.9, 60_000.0);
        let mut short = commands;
        if let Command::Arc { circle, .. } = &mut short[1]
            && rotation == Rotation::Clockwise
        {
            // The short way back.
            circle.rotation = Rotation::CounterClockwise;
        }
        check_from_start(&settings, &short);
    }
}

/// The same as [`check`], beginning where the first command ends.
fn check_from_start(settings: &Settings, commands: &[Command; 2]) -> f64 {
    let mut rig = Rig::new(settings);
    let Some(start) = support::target(&commands[0]) else {
        unreachable!()
    };
    let shift = |command: &Command| -> Command {
        let mut command = *command;
        if let Command::Line { target, .. } | Command::Arc { target, .. } = &mut command {
            *target = target.position.zip(start, |to, from| to - from).into();
        }
        command
    };
    let moved = [shift(&commands[1])];
    rig.run(&moved, &[]);
    rig.trace.check_pulses();
    check_path(settings, &moved, &rig.trace, 0.0)
}

#[test]
fn a_tiny_arc_is_never_a_full_circle() {
    let settings = with(&[250.0], &[3000.0], &[500.0]);
    for radius in [0.01, 1.0, 250.0] {
        for length in [0.000_001, 0.003, 0.000_5, 0.02]
            .into_iter()
            .step_by(each(2))
        {
            let angle = f64::to_degrees(length / radius);
            for rotation in ROTATIONS {
                let sign = if rotation == Rotation::Clockwise {
                    -1.0
                } else {
                    1.0
                };
                let commands = around_origin(
                    Plane::Xy,
                    rotation,
                    radius,
                    30.0,
                    30.0 + sign * angle,
                    600.0,
                );
                let mut rig = Rig::new(&settings);
                rig.run(&commands[..1], &[]);
                let before = rig.trace.steps(0).len() + rig.trace.steps(1).len();
                rig.run(&commands[1..], &[]);
                let after = rig.trace.steps(0).len() + rig.trace.steps(1).len();
                assert!(after - before <= 14, "{} steps", after - before);
            }
        }
    }
}

#[test]
fn a_full_circle_after_a_move_without_a_step_is_whole() {
    let settings = with(&[250.0], &[3000.0], &[500.0]);
    let there_and_back = 4.0 * 2.0 * 250.0;
    for nudge in [
        [0.001, 0.0],
        [-0.001, 0.0],
        [0.0, 0.001],
        [0.0, -0.001],
        [0.001, 0.001],
    ] {
        for rotation in ROTATIONS {
            for centre in [[2.0, 0.0], [0.0, 2.0], [-2.0, 0.0], [0.0, -2.0]] {
                let commands = [
                    line(&nudge, 600.0),
                    arc(Plane::Xy, rotation, &nudge, centre, 600.0),
                ];
                let trace = Rig::play(&settings, &commands);
                for axis in [0, 1] {
                    let steps = trace.steps(axis).len() as f64;
                    assert!((steps - there_and_back).abs() <= 4.0, "{steps} {nudge:?}");
                }
                check_path(&settings, &commands, &trace, 0.3);
            }
        }
    }
}

#[test]
fn an_arc_meets_lines_without_a_jump_of_position() {
    let commands = [
        line(&[2.0, 0.0], 1200.0),
        arc(
            Plane::Xy,
            Rotation::CounterClockwise,
            &[3.0, 1.0],
            [0.0, 1.0],
            1200.0,
        ),
        line(&[3.0, 3.0], 1200.0),
        arc(
            Plane::Xy,
            Rotation::Clockwise,
            &[4.5, 4.5],
            [1.5, 0.0],
            1200.0,
        ),
        line(&[6.0, 4.5], 1200.0),
    ];
    let (trace, _) = check(&settings(), &commands);
    assert_eq!(
        trace.net_steps(),
        target_steps(&settings(), &at(&[6.0, 4.5]))
    );
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn random_arcs_stay_within_half_a_step(
        steps in prop::array::uniform3(40.0..450.0_f64),
        acceleration in 20.0..3000.0_f32,
        radius in 0.02..3.0_f64,
        from in 0.0..360.0_f64,
        travel in 0.0..360.0_f64,
        mismatch in -0.004..0.004_f64,
        normal in -1.0..1.0_f64,
        feed in 30.0..6000.0_f32,
        plane in prop::sample::select(&PLANES[..]),
        rotation in prop::sample::select(&ROTATIONS[..]),
    ) {
        let settings = with(&steps, &[6000.0], &[acceleration]);
        let [approach, around] = around_origin(plane, rotation, radius, from, from + travel, feed);
        let around = match (around, support::target(&around)) {
            (Command::Arc { circle, feed_rate, line, .. }, Some(mut target)) => {
                let (first, second, axis) = plane.axes();
                let scale = 1.0 + mismatch.min(radius) / radius;
                for axis in [first, second] {
                    target[axis] = Nm((target[axis].0 as f64 * scale) as i64);
                }
                target[axis] = Nm::from_mm_f64(normal);
                Command::Arc { target: target.into(), circle, feed_rate, line }
            }
            _ => unreachable!(),
        };
        check(&settings, &[approach, around]);
    }
}

/// Steps/mm of what is nudged.
const NUDGED: f64 = 160.0;

/// An arc from one angle on, rad, between two lines, behind a line of so many steps, less than half of
/// one.
fn after_nudge(
    nudge: [f64; 2],
    radius: f64,
    [from, travel]: [f64; 2],
    rotation: Rotation,
    turns: u16,
) -> Vec<Command> {
    let begin = nudge.map(|steps| 2.0 + steps / NUDGED);
    let centre = [-radius * from.cos(), -radius * from.sin()];
    let angle = match rotation {
        Rotation::Clockwise => from - travel,
        Rotation::CounterClockwise => from + travel,
    };
    let end = [
        begin[0] + centre[0] + radius * angle.cos(),
        begin[1] + centre[1] + radius * angle.sin(),
    ];
    let mut around = arc(Plane::Xy, rotation, &end, centre, 12_000.0);
    if let Command::Arc { circle, .. } = &mut around {
        circle.turns = turns;
    }
    number(&[
        line(&[2.0, 2.0], 6000.0),
        line(&begin, 6000.0),
        around,
        line(&[end[0] + 2.0, end[1] - 1.0], 6000.0),
    ])
}

fn check_nudged(acceleration: f32, ramp_s: f32, commands: &[Command]) {
    let settings = Settings {
        step_pulse_us: 3,
        jerk_mm_s3: Axes::all(if ramp_s > 0.0 {
            acceleration / ramp_s
        } else {
            0.0
        }),
        ..with(&[NUDGED], &[12_000.0], &[acceleration])
    };
    let trace = Rig::play(&settings, commands);
    trace.check_pulses();
    check_path(&settings, commands, &trace, 1.0);
    check_limits(&settings, &trace);
}

#[test]
fn a_small_arc_after_a_move_without_a_step_ends_without_a_jump() {
    let angles = [0.0, 0.3];
    let commands = after_nudge([0.0, -0.436], 0.050_66, angles, Rotation::Clockwise, 1);
    check_nudged(100.0, 0.0, &commands);
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn arcs_after_a_move_without_a_step_keep_the_limits(
        nudge in prop::array::uniform2(-0.49..0.49_f64),
        radius in prop_oneof![0.005..0.1_f64, 0.1..1.0, 1.0..20.0],
        from in 0.0..TAU,
        travel in prop_oneof![0.01..0.3_f64, 0.3..TAU],
        turns in 1_u16..3,
        acceleration in 100.0..5000.0_f32,
        ramp_s in prop_oneof![Just(0.0_f32), 0.003..0.1_f32],
        rotation in prop::sample::select(&ROTATIONS[..]),
    ) {
        let commands = after_nudge(nudge, radius, [from, travel], rotation, turns);
        check_nudged(acceleration, ramp_s, &commands);
    }
}

/// A trace's figures for an arc around the origin of its plane (mm), in the middle of its time.
struct Middle {
    speed_mm_min: f64,
    /// Greatest acceleration in the plane at any time, mm/s².
    hardest_mm_s2: f64,
}

/// Speed and acceleration of an arc in XY around `centre`, from positions `window_s` apart.
fn measure(settings: &Settings, trace: &Trace, centre: [f64; 2], window_s: f64) -> Middle {
    let axes = [0, 1].map(|axis| {
        let mm = 1.0 / f64::from(settings.steps_per_mm[axis].to_f32());
        let steps = trace.steps(axis);
        move |seconds: f64| {
            let after = steps.partition_point(|step| step.seconds <= seconds);
            let crossing = |n: usize| {
                let step = steps[n.min(steps.len() - 1)];
                (
                    step.seconds,
                    f64::from(step.position) - 0.5 * f64::from(step.sign),
                )
            };
            let ((t0, p0), (t1, p1)) = (crossing(after.max(1) - 1), crossing(after));
            let share = if t1 > t0 {
                ((seconds - t0) / (t1 - t0)).clamp(0.0, 1.0)
            } else {
                0.0
            };
            (p0 + (p1 - p0) * share) * mm
        }
    });
    let at = |seconds: f64| [axes[0](seconds), axes[1](seconds)];
    let first = trace
        .edges
        .first()
        .map_or(0.0, |e| e.ticks as f64 / support::TICKS_PER_S);
    let end = first + trace.motion_seconds();
    let mut hardest_mm_s2 = 0.0_f64;
    let mut seconds = first + window_s;
    while seconds < end - window_s {
        let [a, b, c] = [-window_s, 0.0, window_s].map(|shift| at(seconds + shift));
        let second = |n: usize| (a[n] - 2.0 * b[n] + c[n]) / (window_s * window_s);
        hardest_mm_s2 = hardest_mm_s2.max(second(0).hypot(second(1)));
        seconds += 0.37 * window_s;
    }
    let angle = |seconds: f64| {
        let [x, y] = at(seconds);
        (y - centre[1]).atan2(x - centre[0])
    };
    let half = 0.05 * (end - first);
    let middle = 0.5 * (first + end);
    let turned = (angle(middle + half) - angle(middle - half) + std::f64::consts::PI)
        .rem_euclid(TAU)
        - std::f64::consts::PI;
    let radius = f64::hypot(centre[0], centre[1]);
    Middle {
        speed_mm_min: turned.abs() * radius / (2.0 * half) * 60.0,
        hardest_mm_s2,
    }
}

#[test]
fn an_arc_reaches_the_centripetal_limit_and_keeps_within_it() {
    for (radius, mm_min, steps, window_s) in
        [(1.0, 848.5, 4000.0, 0.008), (100.0, 8485.3, 400.0, 0.03)]
    {
        let settings = Settings {
            step_pulse_us: 3,
            ..with(&[steps], &[20_000.0], &[200.0])
        };
        for rotation in ROTATIONS {
            let centre = [0.6 * radius, -0.8 * radius];
            let commands = [arc(Plane::Xy, rotation, &[0.0; 3], centre, 20_000.0)];
            let trace = Rig::play(&settings, &commands);
            let Middle {
                speed_mm_min,
                hardest_mm_s2,
            } = measure(&settings, &trace, centre, window_s);
            println!("r = {radius} mm: {speed_mm_min:.1} mm/min, {hardest_mm_s2:.1} mm/s²");
            assert!((speed_mm_min / mm_min - 1.0).abs() < 0.02, "{speed_mm_min}");
            assert!(hardest_mm_s2 <= 200.0 * 1.05, "{hardest_mm_s2}");
        }
    }
}

#[test]
fn a_held_and_resumed_arc_keeps_its_path_and_its_limit() {
    let settings = Settings {
        step_pulse_us: 3,
        ..with(&[1000.0], &[20_000.0], &[200.0])
    };
    let centre = [0.0, 10.0];
    let commands = [arc(
        Plane::Xy,
        Rotation::Clockwise,
        &[0.0; 3],
        centre,
        20_000.0,
    )];
    let mut rig = Rig::new(&settings);
    rig.run(&commands, &[(40_000_000, b'!'), (70_000_000, b'~')]);
    let peak = measure(&settings, &rig.trace, centre, 0.012).hardest_mm_s2;
    assert!(peak <= 200.0 * 1.05, "{peak}");
    check_path(&settings, &commands, &rig.trace, 0.0);
}

proptest! {
    #![proptest_config(cases(8))]

    #[test]
    fn no_arc_exceeds_the_acceleration_in_its_plane(
        radius in 0.5..20.0_f64,
        acceleration in 50.0..1000.0_f32,
        ramp_s in prop_oneof![Just(0.0_f32), 0.003..0.1_f32],
        direction in 0.0..TAU,
        to in 0.0..360.0_f64,
        feed in 300.0..20_000.0_f32,
        hold in prop::option::of(0..1000_u64),
        overrides in prop::collection::vec(
            (0..1500_u64, prop::sample::select(vec![0x90, 0x91, 0x92, 0x92, 0x92])),
            0..12,
        ),
        rotation in prop::sample::select(&ROTATIONS[..]),
    ) {
        let fastest = (f64::from(acceleration) * radius).sqrt();
        let settings = Settings {
            step_pulse_us: 3,
            jerk_mm_s3: Axes::all(if ramp_s > 0.0 { acceleration / ramp_s } else { 0.0 }),
            ..with(&[(60_000.0 / fastest).min(4000.0)], &[20_000.0], &[acceleration])
        };
        let centre = [-radius * direction.cos(), -radius * direction.sin()];
        let angle = direction + to.to_radians();
        let end = [centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin()];
        let commands = [arc(Plane::Xy, rotation, &end, centre, feed)];
        let overrides = overrides.iter().map(|(ms, byte)| (ms * 84_000, *byte));
        let mut acts: Vec<_> = hold
            .into_iter()
            .flat_map(|ms| [(ms * 84_000, b'!'), (ms * 84_000 + 84_000_000, b'~')])
            .chain(overrides)
            .collect();
        acts.sort_unstable();
        let mut rig = Rig::new(&settings);
        rig.run(&commands, &acts);
        rig.trace.check_pulses();
        check_path(&settings, &commands, &rig.trace, 0.0);
        let window_s = 0.25 * (radius / f64::from(acceleration)).sqrt();
        if rig.trace.motion_seconds() > 3.0 * window_s {
            let peak = measure(&settings, &rig.trace, centre, window_s).hardest_mm_s2;
            prop_assert!(peak <= f64::from(acceleration) * 1.05, "{peak}");
        }
    }
}
