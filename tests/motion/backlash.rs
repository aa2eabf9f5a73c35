//! `$160`…: a model of a machine with play, to whose motors the steps go, against the programmed path.

use crate::support::{
    Rig, TICKS_PER_S, Trace, add_steps, arc, at, cases, check_limits, check_path, follow, line,
    line_at, number, pieces_of_blended, slack, target_steps, with,
};
use leadscrew::{
    axis::{AXES, Axes},
    model::{Circle, Command, FeedRate, PathControl, Plane, Rotation},
    path::BlendOutput,
    settings::Settings,
    sim::Edge,
};
use proptest::prelude::*;

/// A machine with play in X, Y and Z, or in some of them.
fn loose(backlash_mm: [f32; 3], has_jerk: bool) -> Settings {
    Settings {
        backlash_mm: Axes::from_fn(|axis| backlash_mm.get(axis).copied().unwrap_or(0.0)),
        // Y and A pull off in the positive direction.
        homing_direction: 0b1010,
        jerk_mm_s3: Axes::all(if has_jerk { 10_000.0 } else { 0.0 }),
        ..with(
            &[160.0, 250.0, 400.0],
            &[6000.0, 5000.0, 900.0],
            &[800.0, 600.0, 100.0],
        )
    }
}

/// The steps in which the table follows its motors, each of which has this play, steps.
fn table(settings: &Settings, motors: &Trace, play: &Axes<i32>) -> Trace {
    let mut table = Axes::all(0);
    let mut motor = Axes::from_fn(|axis| {
        let is_positive = settings.homing_direction >> axis & 1 != 0;
        if is_positive { play[axis] } else { 0 }
    });
    let mut trace = Trace::new(settings);
    for (edge, line) in motors.edges.iter().zip(&motors.lines) {
        add_steps(&mut motor, edge);
        let mut of_table = *edge;
        for axis in 0..AXES {
            let follows = table[axis].clamp(motor[axis] - play[axis], motor[axis]);
            if follows == table[axis] {
                of_table.raise &= !(1 << axis);
            }
            table[axis] = follows;
        }
        trace.push(of_table, *line);
    }
    trace
}

/// Plays commands, and returns the steps of the motors and those of the table.
fn play(settings: &Settings, commands: &[Command]) -> [Trace; 2] {
    let motors = Rig::play(settings, commands);
    motors.check_pulses();
    let table = table(settings, &motors, &backlash(settings));
    [motors, table]
}

fn backlash(settings: &Settings) -> Axes<i32> {
    Axes::from_fn(|axis| settings.backlash_steps(axis))
}

/// Plays commands on a machine with play, whose table must follow the path to a step.
fn check(settings: &Settings, commands: &[Command]) {
    let commands = number(commands);
    let [motors, table] = play(settings, &commands);
    // A move too short for a step begins up to a step off: `slack`.
    check_path(
        settings,
        &commands,
        &table,
        0.5 + slack(settings, &commands),
    );
    check_limits(settings, &motors);
}

/// Returns whether the table leaves the path where the firmware does not know of the play.
fn is_off_without(settings: &Settings, commands: &[Command]) -> bool {
    let unaware = Settings {
        backlash_mm: Axes::all(0.0),
        ..*settings
    };
    let motors = Rig::play(&unaware, commands);
    let ideal = *commands
        .iter()
        .rev()
        .find_map(|command| match command {
            Command::Line { target, .. } | Command::Arc { target, .. } => Some(&target.position),
            _ => None,
        })
        .unwrap();
    let table = table(settings, &motors, &backlash(settings));
    let (end, farthest) = (table.net_steps(), farthest(&table));
    let wanted = target_steps(settings, &ideal);
    let ends_elsewhere = (0..AXES).any(|axis| (end[axis] - wanted[axis]).abs() > 1);
    ends_elsewhere
        || (0..AXES).any(|axis| (farthest[axis] - self::farthest(&motors)[axis]).abs() > 1)
}

/// The farthest step that each axis comes to.
fn farthest(trace: &Trace) -> Axes<i32> {
    let (mut here, mut most) = (Axes::all(0), Axes::all(0));
    for edge in &trace.edges {
        add_steps(&mut here, edge);
        most = most.zip(here, i32::max);
    }
    most
}

fn turns(commands: Command, turns: u16) -> Command {
    let Command::Arc {
        target,
        circle,
        feed_rate,
        line,
    } = commands
    else {
        unreachable!()
    };
    let circle = Circle { turns, ..circle };
    Command::Arc {
        target,
        circle,
        feed_rate,
        line,
    }
}

const ALL: [f32; 3] = [0.1, 0.06, 0.2];

#[test]
fn lines_squares_circles_helices_and_holes_are_exact_with_play_and_off_without_the_setting() {
    let square: Vec<_> = [[10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]]
        .iter()
        .map(|corner| line(corner, 3000.0))
        .collect();
    let mut holes = Vec::new();
    for (x, y) in [(0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (2.5, 2.5)] {
        holes.push(line_at(at(&[x, y, 1.0]), FeedRate::Rapid));
        holes.push(line(&[x, y, -2.0], 300.0));
        holes.push(line_at(at(&[x, y, 1.0]), FeedRate::Rapid));
    }
    let circle = |plane, rotation| vec![arc(plane, rotation, &[0.0], [3.0, 2.0], 2500.0)];
    let mut programs = vec![
        vec![
            line(&[3.0], 600.0),
            line(&[-1.0], 600.0),
            line(&[2.0], 600.0),
        ],
        square,
        holes,
        vec![turns(
            arc(
                Plane::Xy,
                Rotation::Clockwise,
                &[0.0, 0.0, -2.0],
                [0.0, 5.0],
                2000.0,
            ),
            3,
        )],
        // From an extreme of both senses, and to one.
        vec![
            arc(
                Plane::Xy,
                Rotation::CounterClockwise,
                &[-5.0, 5.0],
                [-5.0, 0.0],
                2000.0,
            ),
            arc(
                Plane::Xy,
                Rotation::Clockwise,
                &[-5.0, 5.0],
                [0.0, -5.0],
                2000.0,
            ),
        ],
    ];
    for plane in [Plane::Xy, Plane::Zx, Plane::Yz] {
        for rotation in [Rotation::Clockwise, Rotation::CounterClockwise] {
            programs.push(circle(plane, rotation));
        }
    }
    for program in &programs {
        for has_jerk in [false, true] {
            check(&loose(ALL, has_jerk), program);
        }
        assert!(is_off_without(&loose(ALL, false), program), "{program:?}");
        check(&loose([0.0, 0.3, 0.0], false), program);
    }
}

#[test]
fn parts_of_an_arc_take_the_inverse_time_together() {
    let Command::Arc {
        target,
        circle,
        line,
        ..
    } = arc(
        Plane::Xy,
        Rotation::Clockwise,
        &[0.0, 0.0, 1.0],
        [3.0, 1.0],
        1.0,
    )
    else {
        unreachable!()
    };
    let feed_rate = FeedRate::InverseTime(20.0);
    let command = Command::Arc {
        target,
        circle,
        line,
        feed_rate,
    };
    let settings = loose(ALL, false);
    check(&settings, &[command]);
    let [motors, _] = play(&settings, &[command]);
    let seconds = |edge: Option<&Edge>| edge.unwrap().ticks as f64 / TICKS_PER_S;
    let taken = seconds(motors.edges.last()) - seconds(motors.edges.first());
    assert!((3.0..3.7).contains(&taken), "{taken} s");
}

#[test]
fn corners_in_which_no_axis_with_play_reverses_are_rounded_under_g64_and_others_exact() {
    let mut at = [0.0_f64; 2];
    let commands = [20.0_f64, 70.0, 110.0, 160.0, 200.0].map(|degrees| {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        at = [at[0] + 20.0 * cosine, at[1] + 20.0 * sine];
        line(&at, 4000.0)
    });
    for (backlash_mm, rounded) in [
        ([0.0; 3], 4),
        ([0.1, 0.0, 0.0], 3),
        ([0.0, 0.1, 0.0], 3),
        ([0.1, 0.1, 0.0], 2),
    ] {
        let settings = loose(backlash_mm, false);
        let mut rig = Rig::new(&settings);
        rig.control = PathControl::Continuous {
            tolerance_nm: 1_000_000,
            merging_nm: 0,
        };
        rig.run(&number(&commands), &[]);
        let is_round = |output: &&BlendOutput| matches!(output, BlendOutput::CornerArc(_));
        assert_eq!(rig.blended.iter().filter(is_round).count(), rounded);
        let table = table(&settings, &rig.trace, &backlash(&settings));
        follow(
            &settings,
            &pieces_of_blended(&settings, &rig.blended),
            &table,
            0.5,
        );
    }
}

/// Lines, arcs and helices in all planes.
fn programs() -> impl Strategy<Value = Vec<Command>> {
    let move_ = (
        prop::array::uniform3(-4.0..4.0_f64),
        0_usize..5,
        prop_oneof![1 => 0.001..0.05_f64, 4 => 0.2..4.0_f64],
        prop::array::uniform2(-3.1..3.1_f64),
        prop::sample::select(vec![200.0_f32, 1500.0, 6000.0]),
        any::<bool>(),
        1_u16..3,
    );
    prop::collection::vec(move_, 1..10).prop_map(move |moves| {
        let mut here = [0.0_f64; 3];
        let mut commands = Vec::new();
        for (to, kind, radius, angles, feed, is_clockwise, around) in moves {
            let plane = match kind {
                2 => Plane::Zx,
                3 => Plane::Yz,
                4 => Plane::Xy,
                _ => {
                    if kind == 0 {
                        here = to;
                    } else {
                        here[around as usize] = to[0];
                    }
                    commands.push(line(&here, feed));
                    continue;
                }
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
                here[normal] += 0.3 * radius;
            }
            commands.push(turns(arc(plane, rotation, &here, centre, feed), around));
        }
        commands
    })
}

proptest! {
    #![proptest_config(cases(48))]

    #[test]
    fn random_programs_are_exact_with_play(
        commands in programs(),
        backlash_mm in prop::array::uniform3(prop_oneof![Just(0.0), 0.004..0.5_f32]),
        has_jerk: bool,
    ) {
        check(&loose(backlash_mm, has_jerk), &commands);
    }

    #[test]
    fn paths_under_g64_are_exact_with_play(commands in programs(), has_jerk: bool) {
        let settings = loose(ALL, has_jerk);
        let mut rig = Rig::new(&settings);
        rig.control = PathControl::Continuous { tolerance_nm: 100_000, merging_nm: 20_000 };
        rig.run(&number(&commands), &[]);
        let table = table(&settings, &rig.trace, &backlash(&settings));
        let pieces = pieces_of_blended(&settings, &rig.blended);
        let (_, end) = follow(&settings, &pieces, &table, 1.0);
        let last = commands.iter().rev().find_map(crate::support::target).unwrap();
        prop_assert_eq!(end, target_steps(&settings, &last));
    }
}
