//! Analytic motions through the meter.

use std::f64::consts::{SQRT_2, TAU};

use leadscrew::{
    axis::{AXES, Axes},
    settings::{Settings, StepRate},
    sim::Edge,
    units::{StepsPerMm, TICKS_PER_SECOND},
};
use simulation::program_reader::ProgramReader;

use super::{ArcFigures, Meter, Quality, text};

const TICKS: f64 = TICKS_PER_SECOND as f64;

/// 80 steps/mm, 500 mm/s².
fn settings() -> Settings {
    Settings {
        steps_per_mm: Axes::all(StepsPerMm::from_millionths(80_000_000).unwrap()),
        max_rate_mm_min: Axes::all(6000.0),
        acceleration_mm_s2: Axes::all(500.0),
        ..Settings::new(StepRate::Unproven)
    }
}

/// Steps of a motion, on a fine grid of times. A step is due when its axis is midway between two steps.
fn steps_of(seconds: f64, at: impl Fn(f64) -> [f64; 2]) -> Vec<(f64, usize, i32)> {
    const GRID_S: f64 = 1.0e-4;
    let mut steps = Vec::new();
    let mut now = [0_i32; 2];
    for index in 1..=(seconds / GRID_S).ceil() as u32 {
        let to = (f64::from(index) * GRID_S).min(seconds);
        for (axis, now) in now.iter_mut().enumerate() {
            loop {
                let end = at(to)[axis] * 80.0;
                let sign = if end > f64::from(*now) { 1 } else { -1 };
                let due = f64::from(*now) + 0.5 * f64::from(sign);
                if (end - due) * f64::from(sign) <= 1.0e-9 {
                    break;
                }
                let (mut low, mut high) = (to - GRID_S, to);
                for _ in 0..40 {
                    let middle = f64::midpoint(low, high);
                    let is_there = (at(middle)[axis] * 80.0 - due) * f64::from(sign) >= 0.0;
                    (low, high) = if is_there {
                        (low, middle)
                    } else {
                        (middle, high)
                    };
                }
                *now += sign;
                steps.push((high, axis, sign));
            }
        }
    }
    steps.sort_by(|a, b| a.0.total_cmp(&b.0));
    steps
}

/// What the meter says of steps beside a program.
fn measured(settings: &Settings, program: &[&str], steps: &[(f64, usize, i32)]) -> Quality {
    let mut meter = Meter::new(ProgramReader::new(settings));
    for line in program {
        meter.line(line.as_bytes());
    }
    for (seconds, axis, sign) in steps {
        meter.edge(&Edge {
            ticks: (seconds * TICKS).round() as u64 + 1,
            raise: 1 << axis,
            drop: 0,
            directions: if *sign < 0 { 1 << axis } else { 0 },
            duty: 0,
            is_rapid: false,
        });
    }
    meter.finish().0
}

/// From standstill to standstill: the distance after a time, at 500 mm/s² up to 50 mm/s.
fn trapezoid(length: f64) -> (f64, impl Fn(f64) -> f64) {
    let (speed, acceleration) = (50.0, 500.0);
    let ramp = speed / acceleration;
    let total = length / speed + ramp;
    let distance = move |t: f64| {
        let t = t.clamp(0.0, total);
        let remaining_s = total - t;
        if t < ramp {
            0.5 * acceleration * t * t
        } else if remaining_s < ramp {
            length - 0.5 * acceleration * remaining_s * remaining_s
        } else {
            speed * (t - 0.5 * ramp)
        }
    };
    (total, distance)
}

#[test]
fn a_perfect_trapezoid_has_no_error_and_its_own_peaks() {
    let (total, distance) = trapezoid(50.0);
    let steps = steps_of(total, |t| [distance(t), 0.6 * distance(t)]);
    let length = 50.0 * 1.36_f64.sqrt();
    let feed = 50.0 * 1.36_f64.sqrt() * 60.0;
    let quality = measured(&settings(), &[&format!("G1 X50 Y30 F{feed:.3}")], &steps);
    assert_eq!(quality.axes.len(), 2);
    for (axis, share) in quality.axes.iter().zip([1.0, 0.6]) {
        let error = &axis.interval_error;
        assert!(error.rms < 0.000_5 && error.p999 < 0.005, "{error:?}");
        assert_eq!(error.unjudged, 0);
        let acceleration = &axis.smoothness.acceleration_mm_s2;
        assert!(
            (acceleration.value / (500.0 * share) - 1.0).abs() < 0.02,
            "{acceleration:?}"
        );
        assert!((acceleration.of_limit.unwrap() / share - 1.0).abs() < 0.02);
        let jump = &axis.smoothness.speed_jump_mm_s;
        assert!(jump.value <= jump.floor, "{jump:?}");
        assert_eq!(axis.jerk_limit_mm_s3, None);
        assert_eq!(axis.smoothness.jerk_mm_s3.of_limit, None);
    }
    // Along the path, 1.166 times what X has.
    let path = &quality.path.acceleration_mm_s2;
    assert!(
        (path.value / (10.0 * length) - 1.0).abs() < 0.02,
        "{path:?}"
    );
    assert!(
        quality.deviation.hausdorff_mm <= quality.deviation.floor_mm,
        "{:?}",
        quality.deviation
    );
    assert!(quality.is_path_known);
    let at_feed = total - 0.2;
    assert!(
        (quality.feed.at_feed_s - at_feed).abs() < 0.01,
        "{:?}",
        quality.feed
    );
    assert!((quality.job_time_s - total).abs() < 0.02);
    assert_eq!(quality.corners.count, 0);
    assert!(quality.violations.is_empty());
}

#[test]
fn the_motors_of_core_xy_are_measured_along_the_path_of_the_tool() {
    let settings = Settings {
        core_xy: true,
        ..settings()
    };
    // Along X both turn, along a diagonal one alone: 35.355 mm of the tool, at 50/√2 mm/s.
    for (program, shares, length) in [
        ("G1 X50 F3000", [1.0, 1.0], 1.0),
        ("G1 Y-50 F3000", [-1.0, 1.0], 1.0),
        ("G1 X25 Y25 F2121.320", [1.0, 0.0], SQRT_2.recip()),
        ("G1 X-25 Y25 F2121.320", [0.0, -1.0], SQRT_2.recip()),
        ("G1 X40 Y10 F2473.863", [1.0, 0.6], 0.68_f64.sqrt()),
    ] {
        let (total, distance) = trapezoid(50.0);
        let steps = steps_of(total, |t| shares.map(|share| share * distance(t)));
        let quality = measured(&settings, &[program], &steps);
        let motors = shares.into_iter().zip(["motor X", "motor Y"]);
        let turning: Vec<_> = motors.filter(|(share, _)| *share != 0.0).collect();
        assert_eq!(quality.axes.len(), turning.len());
        for (motor, (share, name)) in quality.axes.iter().zip(turning) {
            assert_eq!(motor.axis, name);
            let acceleration = &motor.smoothness.acceleration_mm_s2;
            let part = acceleration.value / (500.0 * f64::abs(share));
            assert!((part - 1.0).abs() < 0.02, "{program}: {acceleration:?}");
            assert_eq!(motor.acceleration_limit_mm_s2, 500.0);
            assert!(motor.interval_error.rms < 0.000_5, "{program}: {motor:?}");
        }
        let path = &quality.path.acceleration_mm_s2;
        let part = path.value / (500.0 * length);
        assert!((part - 1.0).abs() < 0.02, "{program}: {path:?}");
        let of_limit = path.of_limit.unwrap();
        assert!((of_limit - 1.0).abs() < 0.02, "{program}: {path:?}");
        let deviation = &quality.deviation;
        assert!(
            deviation.hausdorff_mm < deviation.floor_mm + 1.0e-9 && deviation.floor_mm < 0.006_3,
            "{program}: {deviation:?}"
        );
        assert!((quality.feed.at_feed_s - total + 0.2).abs() < 0.01);
        assert_eq!(quality.violations, Vec::<String>::new());
    }
}

#[test]
fn stairs_show_their_jumps() {
    // The speed is held for 10 ms at a time: jumps of 5 mm/s.
    let (total, _) = trapezoid(50.0);
    let stair = |t: f64| {
        let index = (t / 0.01).floor();
        let speed = |index: f64| {
            (5.0 * (index + 0.5))
                .min(5.0 * (total * 100.0 - index - 0.5))
                .min(50.0)
        };
        let whole: f64 = (0..index as u32)
            .map(|index| 0.01 * speed(f64::from(index)))
            .sum();
        whole + (t - 0.01 * index) * speed(index)
    };
    let steps = steps_of(total, |t| [stair(t), 0.0]);
    let quality = measured(&settings(), &["G1 X50 F3000"], &steps);
    let axis = &quality.axes[0];
    let jump = &axis.smoothness.speed_jump_mm_s;
    assert!(
        jump.value > jump.floor && (4.5..5.2).contains(&jump.value),
        "{jump:?}"
    );
    let along = &quality.path.speed_jump_mm_s;
    assert!((4.5..5.2).contains(&along.value), "{along:?}");
    assert!(quality.violations[0].ends_with("% of the acceleration limit of X"));
    // Five times the acceleration that was meant, over a millisecond or two.
    assert!(axis.smoothness.acceleration_mm_s2.value > 1500.0);
    assert!(axis.interval_error.rms > 0.005, "{:?}", axis.interval_error);
}

#[test]
fn steps_on_the_ticks_of_a_faster_axis_show_an_interval_error() {
    let (total, distance) = trapezoid(50.0);
    let exact = steps_of(total, |t| [distance(t), 0.618 * distance(t)]);
    let ticks: Vec<f64> = exact
        .iter()
        .filter(|step| step.1 == 0)
        .map(|step| step.0)
        .collect();
    let late = exact.iter().filter_map(|(seconds, axis, sign)| {
        let next = ticks.partition_point(|tick| tick < seconds);
        Some((*ticks.get(next)?, *axis, *sign))
    });
    let quality = measured(
        &settings(),
        &["G1 X50 Y30.9 F3000"],
        &late.collect::<Vec<_>>(),
    );
    let [x, y] = &quality.axes[..] else {
        panic!("{:?}", quality.axes);
    };
    assert!(x.interval_error.rms < 0.001);
    assert!(
        (0.2..0.4).contains(&y.interval_error.rms),
        "{:?}",
        y.interval_error
    );
}

#[test]
fn an_arc_divided_into_chords_shows_its_deviation() {
    // A quarter of 20 mm in chords 0.05 mm from it.
    let chord = 2.0 * (1.0_f64 - 0.05 / 20.0).acos();
    let at = |t: f64| {
        let turned = t / 2.0 * std::f64::consts::FRAC_PI_2;
        let (first, share) = ((turned / chord).floor(), (turned / chord).fract());
        let corner = |index: f64| {
            let angle = (index * chord).min(std::f64::consts::FRAC_PI_2);
            [20.0 * angle.cos(), 20.0 * angle.sin()]
        };
        let (from, to) = (corner(first), corner(first + 1.0));
        [0, 1].map(|n| from[n] + (to[n] - from[n]) * share - if n == 0 { 20.0 } else { 0.0 })
    };
    let steps = steps_of(2.0, at);
    let quality = measured(&settings(), &["G3 X-20 Y20 I-20 J0 F900"], &steps);
    let deviation = &quality.deviation;
    assert!((0.045..0.062).contains(&deviation.mm), "{deviation:?}");
    assert!((3.5..5.0).contains(&deviation.steps), "{deviation:?}");
}

#[test]
fn a_rounded_corner_shows_what_is_left_out() {
    // From 9 mm in X to 1 mm in Y along the diagonal: the corner is √½ mm from it.
    let at = |t: f64| {
        let x = t.min(9.0) + (0.5 * (t - 9.0)).clamp(0.0, 1.0);
        let y = (0.5 * (t - 9.0)).clamp(0.0, 1.0) + (t - 11.0).clamp(0.0, 9.0);
        [x, y]
    };
    let steps: Vec<_> = steps_of(20.0, at)
        .iter()
        .map(|s| (s.0 / 10.0, s.1, s.2))
        .collect();
    let quality = measured(&settings(), &["G1 X10 F600", "Y10"], &steps);
    let left_out = quality.deviation.left_out_mm;
    assert!(
        (left_out - 0.5_f64.sqrt()).abs() < 0.02,
        "{:?}",
        quality.deviation
    );
    assert_eq!(quality.deviation.hausdorff_mm, left_out);
    assert!((quality.deviation.mm - 0.5).abs() < 0.02);
    assert_eq!((quality.corners.count, quality.corners.rounded), (1, 1));
}

#[test]
fn the_speed_in_a_corner_is_measured() {
    // 10 mm/s through a right angle: 20 mm/s at its ends.
    let speed = |t: f64| {
        if t < 1.0 {
            (1.0 - t) * 10.0 + 10.0
        } else {
            (t - 1.0) * 10.0 + 10.0
        }
    };
    let distance = |t: f64| {
        let (first, second) = (t.min(1.0), (t - 1.0).max(0.0));
        20.0 * first - 5.0 * first * first + 10.0 * second + 5.0 * second * second
    };
    let at = |t: f64| [distance(t).min(15.0), (distance(t) - 15.0).max(0.0)];
    assert!((speed(0.0) - 20.0).abs() < 1.0e-9);
    let quality = measured(&settings(), &["G1 X15 F1200", "Y15"], &steps_of(2.0, at));
    let [corner] = &quality.corners.list[..] else {
        panic!("{:?}", quality.corners);
    };
    assert!((corner.speed_mm_s - 10.0).abs() < 0.05, "{corner:?}");
    assert!((corner.turn_degrees - 90.0).abs() < 1.0e-6);
    assert_eq!(corner.at_mm[..2], [15.0, 0.0]);
    // √(a·√2·δ·(√½ / (1 - √½))): 500 mm/s², 0.01 mm.
    assert!((corner.allowed_mm_s - 4.131_6).abs() < 0.001, "{corner:?}");
    assert!((quality.corners.most_of_allowed.unwrap() - 10.0 / 4.131_6).abs() < 0.02);
    assert!((corner.jump_mm_s - 10.0 * 2.0_f64.sqrt()).abs() < 0.1);
    let [violation] = &quality.violations[..] else {
        panic!("{:?}", quality.violations);
    };
    assert!(violation.ends_with("the speed that $11 allows in a corner"));
    // The distance along the path stays smooth, and no axis is measured across the corner.
    let accelerations = quality
        .axes
        .iter()
        .map(|axis| axis.smoothness.acceleration_mm_s2.value);
    assert!(accelerations.fold(0.0, f64::max) < 11.0);
    assert!(quality.path.speed_jump_mm_s.value <= quality.path.speed_jump_mm_s.floor);
}

#[test]
fn corners_a_few_steps_from_each_other_are_distinguished_from_the_path_between_them() {
    // 10 mm/s at both ends of 10 steps in Y, accelerated and braked at 500 mm/s² between them.
    let (length, speed, acceleration) = (0.125, 10.0_f64, 500.0);
    let half = ((speed * speed + acceleration * length).sqrt() - speed) / acceleration;
    let ramp = |t: f64| speed * t + 0.5 * acceleration * t * t;
    let at = |t: f64| {
        let before = (1.0 - t).max(0.0);
        let after_corner = (t - 1.0 - 2.0 * half).max(0.0);
        let between = (t - 1.0).clamp(0.0, 2.0 * half);
        let y = if between < half {
            ramp(between)
        } else {
            length - ramp(2.0 * half - between)
        };
        let x = 15.0 - (10.0 * before + 5.0 * before * before);
        [
            x + 10.0 * after_corner + 5.0 * after_corner * after_corner,
            y,
        ]
    };
    let steps = steps_of(2.0 + 2.0 * half, at);
    let quality = measured(&settings(), &["G1 X15 F1200", "Y0.125", "X30"], &steps);
    let speeds = quality.corners.list.iter().map(|corner| corner.speed_mm_s);
    let speeds: Vec<f64> = speeds.collect();
    assert_eq!(speeds.len(), 2);
    let is_right = |speed: &f64| (speed - 10.0).abs() < 0.1;
    assert!(speeds.iter().all(is_right), "{speeds:?}");
}

#[test]
fn a_bend_too_slight_for_a_corner_is_no_acceleration() {
    // 100 mm/s along chords of 20 mm with corners of 0.4°. The speed of an axis jumps by 0.5 mm/s, for which the limit
    // of 10 mm/s² needs 50 ms.
    let slow = Settings {
        acceleration_mm_s2: Axes::all(10.0),
        ..settings()
    };
    let heading = |chord: u32| (45.0 + 0.4 * f64::from(chord)).to_radians().sin_cos();
    let at = |t: f64| {
        let chord = (5.0 * t) as u32;
        let spans = (0..=chord).map(|k| (heading(k), (100.0 * t - 20.0 * f64::from(k)).min(20.0)));
        spans.fold([0.0; 2], |[x, y], ((sine, cosine), distance)| {
            [x + distance * cosine, y + distance * sine]
        })
    };
    let to = |t: f64| {
        let [x, y] = at(t);
        format!("G1 X{x:.3} Y{y:.3} F6000")
    };
    let steps = steps_of(0.8, at);
    let bent = [to(0.2), to(0.4), to(0.6), to(0.8)];
    let quality = measured(&slow, &bent.each_ref().map(String::as_str), &steps);
    assert_eq!(quality.corners.count, 0);
    assert!(quality.violations.is_empty(), "{:?}", quality.violations);
    // Where no corner is programmed, nothing allows them.
    let quality = measured(&slow, &[&to(0.8)], &steps);
    assert_eq!(quality.violations.len(), 2, "{:?}", quality.violations);
}

#[test]
fn a_path_followed_at_an_offset_has_no_jumps_where_another_axis_dominates() {
    // A circle of 20 mm that is 0.8 steps too large, at 20 mm/s: both axes are as fast at each eighth.
    let at = |t: f64| {
        let (sine, cosine) = t.sin_cos();
        [20.01 * cosine - 20.0, 20.01 * sine]
    };
    let steps = steps_of(3.0, at);
    let quality = measured(&settings(), &["G3 X0 Y0 I-20 J0 F1200"], &steps);
    let jump = &quality.path.speed_jump_mm_s;
    assert!(jump.value < jump.floor, "{jump:?}");
    assert!(
        quality.path.acceleration_mm_s2.value < 50.0,
        "{:?}",
        quality.path
    );
}

#[test]
fn a_smooth_jerk_is_found() {
    // sin² speed: 20 mm in 1 s, jerk at most 2·20·(2π)²/2.
    let distance = |t: f64| 20.0 * (t - (TAU * t).sin() / TAU);
    let slow = Settings {
        acceleration_mm_s2: Axes::all(50.0),
        ..settings()
    };
    let quality = measured(
        &slow,
        &["G1 X20 F2400"],
        &steps_of(1.0, |t| [distance(t), 0.0]),
    );
    let jerk = &quality.axes[0].smoothness.jerk_mm_s3;
    let most = 20.0 * TAU.powi(2);
    assert!(
        (0.9..1.1).contains(&(jerk.value / most)),
        "{jerk:?}, {most}"
    );
    assert!(jerk.floor < 0.2 * most, "{jerk:?}");
    let acceleration = &quality.axes[0].smoothness.acceleration_mm_s2;
    let most = 20.0 * TAU;
    assert!(
        (0.93..1.05).contains(&(acceleration.value / most)),
        "{acceleration:?}, {most}"
    );
}

#[test]
fn the_jerk_of_an_arc_is_allowed_where_corners_are_passed_and_is_reported() {
    // A line of 5 mm and half a circle of r 1 to the left, at 10 mm/s: 100 mm/s² and 1000 mm/s³ on it.
    let at = |t: f64| {
        let (sine, cosine) = (10.0 * (t - 0.5)).max(0.0).sin_cos();
        [(10.0 * t).min(5.0) + sine, 1.0 - cosine]
    };
    let program = ["G1 X5 F600", "G3 X5 Y2 I0 J1"];
    let steps = steps_of(0.8, at);
    let with_deviation = |junction_deviation_mm: f32| {
        let settings = Settings {
            jerk_mm_s3: Axes::all(300.0),
            junction_deviation_mm,
            ..settings()
        };
        measured(&settings, &program, &steps)
    };
    let quality = with_deviation(0.01);
    assert!((quality.arcs.jerk_mm_s3 / 1000.0 - 1.0).abs() < 0.02);
    assert!((quality.arcs.jump_mm_s2 / 100.0 - 1.0).abs() < 0.02);
    assert!(quality.violations.is_empty(), "{:?}", quality.violations);
    assert!(text(&quality).contains("arcs"));
    // A machine that stops in corners has to keep the limit on arcs, too.
    let quality = with_deviation(0.0);
    assert_eq!(quality.arcs, ArcFigures::default());
    let violations = quality.violations.iter();
    assert!(violations.clone().any(|it| it.contains("jerk limit of Y")));
    assert!(!text(&quality).contains("arcs"));
}

#[test]
fn a_jerk_beyond_that_of_the_arc_is_none_of_it() {
    // 10 mm/s and 6 mm/s in turns, on a circle of r 10: the arc makes 10 mm/s³ at most.
    let angle = |t: f64| 0.8 * t + 0.2 / TAU / 5.0 * (TAU * 5.0 * t).sin();
    let at = |t: f64| {
        let (sine, cosine) = angle(t).sin_cos();
        [10.0 * sine, 10.0 - 10.0 * cosine]
    };
    let settings = Settings {
        jerk_mm_s3: Axes::all(300.0),
        ..settings()
    };
    let quality = measured(&settings, &["G3 X0 Y20 I0 J10 F600"], &steps_of(1.9, at));
    let violations = quality.violations.iter();
    assert!(
        violations.clone().any(|it| it.contains("jerk limit of X")),
        "{quality:?}"
    );
}

#[test]
fn a_refused_line_ends_the_measurement_of_the_path() {
    let mut meter = Meter::new(ProgramReader::new(&settings()));
    meter.line(b"G1 X1 F600");
    meter.answer(true);
    assert!(!meter.finish().0.is_path_known);
    let mut meter = Meter::new(ProgramReader::new(&settings()));
    // Refused by the interpreter beside the machine too: no part of the path.
    meter.line(b"G1 X1 Q7");
    meter.answer(true);
    assert!(meter.finish().0.is_path_known);
}

#[test]
fn a_path_that_comes_back_on_itself_is_followed_in_its_order() {
    let at = |t: f64| [10.0 - (10.0 - 10.0 * t).abs(), 0.0];
    let quality = measured(
        &settings(),
        &["G1 X10 F600", "X0", "X10"],
        &steps_of(2.0, at),
    );
    assert!(quality.deviation.mm <= quality.deviation.floor_mm + 1.0e-9);
    let [there] = &quality.corners.list[..] else {
        panic!("{:?}", quality.corners);
    };
    assert!((there.turn_degrees - 180.0).abs() < 1.0e-6);
    assert_eq!(AXES, settings().steps_per_mm.0.len());
}

#[test]
fn tiny_moves_side_by_side_are_not_mixed_up() {
    // There and back two steps in Y, between a way down and a way up: to the whole steps the way back
    // is the nearer one, from the beginning.
    let lines = [
        "G1 Z-0.1 F600",
        "X0.005",
        "Y-0.022",
        "X0.0001",
        "Y0",
        "Z0.1",
    ];
    let spans = [(2, -1, 8), (1, -1, 2), (1, 1, 2), (2, 1, 16)];
    let steps = spans
        .into_iter()
        .flat_map(|(axis, sign, count)| (0..count).map(move |_| (axis, sign)));
    let steps: Vec<_> = (1..)
        .zip(steps)
        .map(|(number, (axis, sign))| (0.01 * f64::from(number), axis, sign))
        .collect();
    let quality = measured(&settings(), &lines, &steps);
    assert!(quality.deviation.steps < 0.8, "{:?}", quality.deviation);
}

#[test]
fn the_figures_are_printed_with_their_names() {
    let (total, distance) = trapezoid(20.0);
    let steps = steps_of(total, |t| [distance(t), 0.5 * distance(t)]);
    let quality = measured(&settings(), &["G1 X20 Y10 F3354"], &steps);
    let text = text(&quality);
    for part in [
        "job time",
        "interval error",
        "99.9 %",
        "speed jump",
        "peak acceleration",
        "peak jerk",
        "path deviation",
        "Hausdorff",
        "at the feed",
        "corners",
    ] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    let begins = |name: &str| text.lines().any(|line| line.trim_start().starts_with(name));
    assert!(begins("X ") && begins("Y ") && !begins("Z "), "{text}");
}
