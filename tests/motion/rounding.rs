//! Paths under `G64`: never farther from the programmed path than `P`.

use crate::support::{
    self, Piece, Rig, arc, cases, check_limits, each, fast, follow, line, number, pieces,
    pieces_of_blended, target_steps, with,
};
use leadscrew::{
    axis::Axes,
    model::{Command, PathControl, Plane, Rotation},
    path::{BlendOutput, Blender, Router},
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

fn continuous(tolerance_nm: u32, merging_nm: u32) -> PathControl {
    PathControl::Continuous {
        tolerance_nm,
        merging_nm,
    }
}

/// The executed path of commands, and the deviation that is reported.
fn blended(
    settings: &Settings,
    control: PathControl,
    commands: &[Command],
) -> (Vec<BlendOutput>, f32) {
    let led: Vec<_> = commands.iter().map(|command| (control, *command)).collect();
    blended_of(settings, &led)
}

/// The same where each command has a path control of its own.
fn blended_of(settings: &Settings, commands: &[(PathControl, Command)]) -> (Vec<BlendOutput>, f32) {
    let mut router = Router::new(settings);
    let mut path = Blender::new();
    let mut outputs = Vec::new();
    let mut drain = |router: &mut Router, path: &mut Blender| {
        while let Some(output) = path.front().copied() {
            router.route_blended(&output);
            outputs.push(output);
            path.dequeue();
        }
    };
    for (control, command) in commands {
        router.blend(&mut path, *control, command);
        drain(&mut router, &mut path);
    }
    router.flush(&mut path);
    drain(&mut router, &mut path);
    assert!(!path.has_pending());
    (outputs, path.take_deviation_mm())
}

fn rounds(outputs: &[BlendOutput]) -> usize {
    outputs
        .iter()
        .filter(|output| matches!(output, BlendOutput::CornerArc(_)))
        .count()
}

fn lines(outputs: &[BlendOutput]) -> usize {
    let is_line =
        |output: &&BlendOutput| matches!(output, BlendOutput::Command(Command::Line { .. }));
    outputs.iter().filter(is_line).count()
}

/// One step is a micrometre, so that points are in micrometres.
fn fine() -> Settings {
    with(&[1000.0], &[5000.0], &[500.0])
}

type Point = [f64; 3];

/// Points along pieces, in order, closer to each other than a grain, micrometres.
fn samples(pieces: &[Piece], grain: f64) -> Vec<Point> {
    let mut points = Vec::new();
    for piece in pieces {
        // Of a small arc so many that their chords are the arc, to a thousandth of a micrometre.
        let least = if piece.is_line() { 1.0 } else { 64.0 };
        let parts = (piece.length() / grain).ceil().max(least);
        for part in 0..=parts as usize {
            let at = piece.at(part as f64 / parts);
            points.push([at[0], at[1], at[2]]);
        }
    }
    points
}

/// The distance of a point from the stretch between two others.
fn distance(point: &Point, from: &Point, to: &Point) -> f64 {
    let direction: Point = std::array::from_fn(|n| to[n] - from[n]);
    let off: Point = std::array::from_fn(|n| point[n] - from[n]);
    let dot = |a: &Point, b: &Point| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let length_sqr = dot(&direction, &direction);
    let share = if length_sqr > 0.0 {
        (dot(&off, &direction) / length_sqr).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let normal: Point = std::array::from_fn(|n| off[n] - share * direction[n]);
    dot(&normal, &normal).sqrt()
}

/// The greatest distance of points from a line through others.
fn farthest(points: &[Point], path: &[Point]) -> f64 {
    let (mut farthest, mut nearest_part) = (0.0_f64, 0);
    // A few first, so that few of the rest are the farthest so far.
    for point in points.iter().step_by(64).chain(points) {
        let mut nearest = f64::MAX;
        // First where the point before was near: one that is near enough makes no difference.
        let parts = (nearest_part..path.len() - 1).chain(0..nearest_part);
        for part in parts {
            let off = distance(point, &path[part], &path[part + 1]);
            if off < nearest {
                (nearest, nearest_part) = (off, part);
            }
            if nearest <= farthest {
                break;
            }
        }
        farthest = farthest.max(nearest);
    }
    farthest
}

/// The greatest distance between the programmed path and the output path, in either direction, mm.
fn deviation_mm(commands: &[Command], outputs: &[BlendOutput], grain: f64) -> f64 {
    let settings = fine();
    let programmed = samples(&pieces(&settings, commands), grain);
    let executed = samples(&pieces_of_blended(&settings, outputs), grain);
    1.0e-3 * farthest(&executed, &programmed).max(farthest(&programmed, &executed))
}

/// A corner after a straight way.
fn corner(degrees: f64, mm_min: f32) -> [Command; 2] {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    [
        line(&[10.0, 0.0, 0.0], mm_min),
        line(&[10.0 + 10.0 * cosine, 10.0 * sine, 0.0], mm_min),
    ]
}

#[test]
fn a_corner_is_rounded_as_far_from_it_as_is_asked_for() {
    for degrees in [15.0, 50.0, 45.0, 20.0].into_iter().step_by(each(4)) {
        let commands = corner(degrees, 5000.0);
        let control = continuous(50_000, 0);
        let (outputs, reported_mm) = blended(&fine(), control, &commands);
        assert_eq!((rounds(&outputs), lines(&outputs)), (1, 2), "{degrees}");
        let found_mm = deviation_mm(&commands, &outputs, 5.0);
        assert!((found_mm - 0.05).abs() < 0.0002, "{degrees}: {found_mm}");
        assert!((f64::from(reported_mm) - 0.05).abs() < 0.0002, "{degrees}");
    }
}

/// A contour from the origin along X: an arc of an angle, positive to the left, or a line for a length of 10 mm.
fn contour(parts: [(f64, f64); 2], turn: f64) -> Vec<Command> {
    let (mut at, mut heading) = ([0.0_f64; 3], 0.0_f64);
    let mut commands = Vec::new();
    for (number, (radius, angle)) in parts.into_iter().enumerate() {
        heading += if number == 0 { 0.0 } else { turn };
        if angle == 0.0 {
            at = [
                at[0] + 10.0 * heading.cos(),
                at[1] + 10.0 * heading.sin(),
                0.0,
            ];
            commands.push(line(&at, 5000.0));
            continue;
        }
        let towards = heading + std::f64::consts::FRAC_PI_2.copysign(angle);
        let centre = [radius * towards.cos(), radius * towards.sin()];
        heading += angle;
        let from = heading - std::f64::consts::FRAC_PI_2.copysign(angle);
        at[0] += centre[0] + radius * from.cos();
        at[1] += centre[1] + radius * from.sin();
        let rotation = if angle > 0.0 {
            Rotation::CounterClockwise
        } else {
            Rotation::Clockwise
        };
        commands.push(arc(Plane::Xy, rotation, &at, centre, 5000.0));
    }
    commands
}

#[test]
fn a_corner_at_an_arc_is_rounded_as_far_from_it_as_is_asked_for() {
    let shapes = [(20.0, 0.5), (20.0, -0.5), (0.0, 0.0)];
    for before in shapes {
        for after in shapes {
            for turn in [0.3, -0.7] {
                let commands = contour([before, after], turn);
                let (outputs, reported_mm) = blended(&fine(), continuous(50_000, 0), &commands);
                let name = format!("{before:?} {after:?} {turn}");
                assert_eq!((rounds(&outputs), outputs.len()), (1, 3), "{name}");
                let found_mm = deviation_mm(&commands, &outputs, 5.0);
                assert!((found_mm - 0.05).abs() < 0.0002, "{name}: {found_mm}");
                assert!((f64::from(reported_mm) - 0.05).abs() < 0.0002, "{name}");
            }
        }
    }
}

#[test]
fn an_arc_loses_half_at_each_end_at_most_and_keeps_its_circle() {
    let mut commands = contour([(0.0, 0.0), (4.0, 1.0)], 0.6);
    let last = contour([(4.0, 1.0), (0.0, 0.0)], 0.6);
    let end = support::target(&commands[1]).unwrap();
    commands.push(last[1]);
    let (outputs, _) = blended(
        &with(&[1000.0], &[5000.0], &[2000.0]),
        continuous(0, 0),
        &commands,
    );
    let arcs = outputs.iter().filter_map(|output| match output {
        BlendOutput::Command(Command::Arc { target, circle, .. }) => Some((*target, *circle)),
        _ => None,
    });
    let [(target, circle)] = arcs.collect::<Vec<_>>()[..] else {
        panic!("{outputs:?}");
    };
    assert_ne!(target.position, end);
    let from = outputs.iter().find_map(|output| match output {
        BlendOutput::CornerArc(round) => Some(round.target),
        BlendOutput::Command(_) => None,
    });
    let from = from.unwrap();
    let radius = |at: &Axes<Nm>| {
        let off = [0, 1].map(|n| (at[n] - from[n] - circle.centre[n]).0 as f64 * 1.0e-6);
        off[0].hypot(off[1])
    };
    assert!((radius(&from) - 4.0).abs() < 3.0e-6, "{}", radius(&from));
    assert!((radius(&target.position) - 4.0).abs() < 3.0e-6);
}

#[test]
fn circles_helices_and_spirals_stay_as_they_are() {
    let lead_in = line(&[10.0, 0.0, 0.0], 5000.0);
    let lead_out = line(&[0.0, -20.0, 5.0], 5000.0);
    let turn = |at: &[f64], centre| arc(Plane::Xy, Rotation::CounterClockwise, at, centre, 5000.0);
    for curve in [
        turn(&[10.0, 0.0, 0.0], [3.0, 4.0]),
        turn(&[13.0, 9.0, 1.0], [3.0, 4.0]),
        turn(&[13.0, 9.1, 0.0], [3.0, 4.0]),
    ] {
        let commands = [lead_in, curve, lead_out];
        let (outputs, reported_mm) = blended(&fine(), continuous(50_000, 0), &commands);
        let unchanged = commands.map(BlendOutput::Command);
        assert_eq!((&outputs[..], reported_mm), (&unchanged[..], 0.0));
    }
}

#[test]
fn a_corner_after_another_tolerance_is_where_its_lines_meet() {
    let (sine, cosine) = 45.0_f64.to_radians().sin_cos();
    let commands = [
        line(&[0.0, 10.0], 5000.0),
        line(&[10.0, 10.0], 5000.0),
        line(&[10.0 + 10.0 * cosine, 10.0 + 10.0 * sine], 5000.0),
    ];
    let (wide, narrow) = (continuous(500_000, 0), continuous(50_000, 0));
    let led = [
        (wide, commands[0]),
        (narrow, commands[1]),
        (narrow, commands[2]),
    ];
    let (outputs, reported_mm) = blended_of(&fine(), &led);
    assert_eq!((rounds(&outputs), lines(&outputs)), (1, 3));
    let found_mm = deviation_mm(&commands, &outputs, 5.0);
    assert!((found_mm - 0.05).abs() < 0.0002, "{found_mm}");
    assert!((f64::from(reported_mm) - 0.05).abs() < 0.0002);
}

#[test]
fn a_corner_that_is_no_slower_than_its_rounding_is_kept() {
    for (degrees, mm_min) in [(0.01, 5000.0), (5.0, 300.0), (179.9, 5000.0)] {
        let commands = corner(degrees, mm_min);
        let (outputs, reported_mm) = blended(&fine(), continuous(50_000, 0), &commands);
        assert_eq!((rounds(&outputs), lines(&outputs)), (0, 2), "{degrees}");
        assert_eq!(reported_mm, 0.0);
    }
}

#[test]
fn without_a_tolerance_a_corner_takes_half_of_each_line_at_most() {
    let half = 0.5_f64.sqrt();
    let commands = [
        line(&[1.0], 5000.0),
        line(&[1.0 + half, half], 5000.0),
        line(&[2.0 + half, half], 5000.0),
    ];
    let (outputs, _) = blended(&fine(), continuous(0, 0), &commands);
    // Two eighths of a circle with nothing of the line between them.
    let [
        BlendOutput::Command(_),
        BlendOutput::CornerArc(first),
        BlendOutput::CornerArc(second),
        BlendOutput::Command(_),
    ] = outputs[..]
    else {
        panic!("{outputs:?}");
    };
    let radius = 0.5 / std::f64::consts::FRAC_PI_8.tan();
    assert!((f64::from(first.radius_mm) - radius).abs() < 1.0e-5);
    assert!((f64::from(second.radius_mm) - radius).abs() < 1.0e-5);
    let middle = support::at(&[1.0 + 0.5 * half, 0.5 * half]);
    let off = first.target.zip(middle, |end, middle| (end - middle).0);
    assert!(off.iter().all(|nm| nm.abs() <= 1), "{off:?}");
}

#[test]
fn short_lines_become_one_within_the_tolerance() {
    let mut commands = Vec::new();
    for n in 1..=60 {
        let off = if n % 2 == 0 { 0.004 } else { -0.004 };
        commands.push(line(&[0.1 * f64::from(n), off], 1200.0));
    }
    let (merged, reported_mm) = blended(&fine(), continuous(20_000, 20_000), &commands);
    assert_eq!(lines(&merged), 1);
    assert!(reported_mm > 0.006 && reported_mm < 0.010, "{reported_mm}");
    let (strict, _) = blended(&fine(), continuous(20_000, 2_000), &commands);
    assert!(lines(&strict) > 30);
    // Each is shorter than what is asked of the corners, and there is a limit to their number.
    let commands: Vec<_> = (1..=250)
        .map(|n| line(&[0.1 * f64::from(n)], 1200.0))
        .collect();
    let (merged, reported_mm) = blended(&fine(), continuous(20_000, 20_000), &commands);
    assert_eq!(lines(&merged), 3);
    assert!(reported_mm < 1.0e-5, "{reported_mm}");
}

#[test]
fn lines_of_other_feeds_axes_and_paces_are_not_merged() {
    let rapid = support::line_at(support::at(&[2.0]), leadscrew::model::FeedRate::Rapid);
    let timed = leadscrew::model::FeedRate::InverseTime(10.0);
    let timed = support::line_at(support::at(&[4.0]), timed);
    let commands = [
        line(&[1.0], 600.0),
        line(&[1.5], 700.0),
        rapid,
        line(&[3.0], 600.0),
        timed,
        line(&[5.0], 600.0),
    ];
    let (merged, _) = blended(&fine(), continuous(20_000, 20_000), &commands);
    assert_eq!(lines(&merged), 6);
}

#[test]
fn a_corner_after_a_line_without_a_step_ends_without_a_jump() {
    // Of each line of a millimetre, the corners leave less than a step.
    let settings = fast();
    for begin in [0.0, 0.003, 0.006] {
        let mut at = [10.0 + begin, 0.0];
        let mut commands = vec![line(&[begin], 5000.0), line(&at, 5000.0)];
        for corner in 0..32 {
            let (sine, cosine) = if corner % 2 == 0 {
                (0.5, 0.75_f64.sqrt())
            } else {
                (0.0, 1.0)
            };
            at = [at[0] + cosine, at[1] + sine];
            commands.push(line(&at, 5000.0));
        }
        commands.push(line(&[at[0] + 10.0, at[1]], 5000.0));
        let mut rig = Rig::new(&settings);
        rig.control = continuous(65_000, 0);
        rig.run(&number(&commands), &[]);
        assert!(rounds(&rig.blended) > 30);
        let mut before = Axes::all(0);
        let stepless = rig.blended.iter().filter(|output| {
            let end = match output {
                BlendOutput::Command(command) => support::target(command),
                BlendOutput::CornerArc(round) => Some(round.target),
            };
            let steps = end.map_or(before, |end| target_steps(&settings, &end));
            core::mem::replace(&mut before, steps) == steps
        });
        assert!(stepless.count() > 0);
        check_limits(&settings, &rig.trace);
        let pieces = pieces_of_blended(&settings, &rig.blended);
        follow(&settings, &pieces, &rig.trace, 1.0);
        assert_eq!(
            rig.trace.net_steps(),
            target_steps(&settings, &support::at(&[at[0] + 10.0, at[1]]))
        );
    }
}

#[test]
fn within_limits_of_jerk_steps_follow_the_rounded_path_within_those_of_acceleration() {
    let settings = Settings {
        jerk_mm_s3: Axes::all(10_000.0),
        ..fast()
    };
    let (mut at, mut commands) = ([0.0_f64; 2], Vec::new());
    for side in 0..12_u8 {
        let (sine, cosine) = (20.0 * f64::from(side)).to_radians().sin_cos();
        at = [at[0] + 20.0 * cosine, at[1] + 20.0 * sine];
        commands.push(line(&at, 3000.0));
    }
    let mut rig = Rig::new(&settings);
    rig.control = continuous(200_000, 0);
    rig.run(&number(&commands), &[]);
    assert!(rounds(&rig.blended) > 8, "{:?}", rig.blended);
    check_limits(&settings, &rig.trace);
    let pieces = pieces_of_blended(&settings, &rig.blended);
    follow(&settings, &pieces, &rig.trace, 1.0);
}

/// Random ways: mostly short, some long, some on a curve, at a few feeds.
fn programs() -> impl Strategy<Value = Vec<Command>> {
    let turn = prop_oneof![3 => -0.3..0.3, 1 => -3.1..3.1];
    let length = prop_oneof![4 => 0.02..0.4, 1 => 0.4..4.0];
    let rise = prop_oneof![2 => Just(0.0), 1 => -0.5..0.5];
    let feed = prop::sample::select(vec![300.0_f32, 1200.0, 1200.0, 5000.0]);
    let step = (turn, length, rise, feed, 0..12);
    prop::collection::vec(step, 2..30).prop_map(|steps| {
        let (mut at, mut heading) = ([0.0_f64; 3], 0.0_f64);
        let mut commands = Vec::new();
        for (turn, length, rise, feed, kind) in steps {
            heading += turn;
            at[0] += length * heading.cos();
            at[1] += length * heading.sin();
            at[2] += length * rise;
            if kind < 4 {
                // An arc, flat or not, to the left or to the right.
                let (x, y) = (length * heading.cos(), length * heading.sin());
                let (side, rotation) = if kind % 2 == 0 {
                    (1.0, Rotation::CounterClockwise)
                } else {
                    (-1.0, Rotation::Clockwise)
                };
                let far = if kind < 2 { 3.0 * side } else { side };
                let centre = [0.5 * x - far * y, 0.5 * y + far * x];
                commands.push(arc(Plane::Xy, rotation, &at, centre, feed));
            } else {
                commands.push(line(&at, feed));
            }
        }
        commands
    })
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn no_path_deviates_more_than_is_asked_for(
        commands in programs(),
        tolerance_um in prop::sample::select(vec![5_u32, 20, 100]),
        merging_um in prop::sample::select(vec![0_u32, 3, 20, 100]),
    ) {
        let control = continuous(1000 * tolerance_um, 1000 * merging_um);
        let (outputs, reported_mm) = blended(&fine(), control, &commands);
        let found_mm = deviation_mm(&commands, &outputs, 10.0);
        // Positions are whole nanometres; and points on a curve are this far from their chords.
        let least_mm = 1.0e-3 * f64::from(tolerance_um);
        prop_assert!(found_mm <= least_mm + 2.0e-5, "{found_mm} of {least_mm}");
        prop_assert!(found_mm <= f64::from(reported_mm) + 2.0e-5, "{found_mm}; reported {reported_mm}");
    }

    #[test]
    fn no_path_deviates_more_than_is_asked_for_where_that_changes(
        commands in programs(),
        controls in prop::collection::vec((0_u32..100, 0_u32..100, 1_usize..6), 1..8),
    ) {
        let most_um = controls.iter().map(|(tolerance_um, ..)| 1 + tolerance_um).max();
        let mut controls = controls.iter().cycle().flat_map(|(tolerance_um, merging_um, lines)| {
            let control = continuous(1000 * (1 + tolerance_um), 1000 * merging_um);
            std::iter::repeat_n(control, *lines)
        });
        let led: Vec<_> = commands.iter().map(|command| (controls.next().unwrap(), *command)).collect();
        let (outputs, reported_mm) = blended_of(&fine(), &led);
        let found_mm = deviation_mm(&commands, &outputs, 10.0);
        let least_mm = 1.0e-3 * f64::from(most_um.unwrap());
        prop_assert!(found_mm <= least_mm + 2.0e-5, "{found_mm} of {least_mm}");
        prop_assert!(found_mm <= f64::from(reported_mm) + 2.0e-5, "{found_mm}; reported {reported_mm}");
    }

    #[test]
    fn steps_follow_the_rounded_path_within_the_limits(
        commands in programs(),
        tolerance_um in prop::sample::select(vec![0_u32, 5, 50, 500]),
        is_uneven in any::<bool>(),
    ) {
        let settings = if is_uneven {
            with(&[80.0, 320.0, 157.48], &[6000.0, 5000.0, 3000.0], &[500.0, 400.0, 300.0])
        } else {
            fast()
        };
        let commands = number(&commands);
        let mut rig = Rig::new(&settings);
        rig.control = continuous(1000 * tolerance_um, 0);
        rig.run(&commands, &[]);
        rig.trace.check_pulses();
        let pieces = pieces_of_blended(&settings, &rig.blended);
        follow(&settings, &pieces, &rig.trace, 1.0);
        check_limits(&settings, &rig.trace);
        let end = commands.iter().rev().find_map(support::target);
        let end = target_steps(&settings, &end.unwrap_or(Axes::all(Nm(0))));
        prop_assert_eq!(rig.trace.net_steps(), end);
    }
}
