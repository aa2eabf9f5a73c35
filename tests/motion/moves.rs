//! Moves as the step pins show them: exact counts, limits kept, path kept.

use crate::support::{
    Act, RESET, Rig, TICKS_PER_S, Trace, Trapezoid, arc, at, cases, check_limits, check_path, each,
    fast, interval_error_rms, line, line_at, number, slack, target, target_steps, with,
};
use leadscrew::{
    axis::Axes,
    model::{Command, FeedRate, Plane, Rotation, State},
    settings::Settings,
    units::{Nm, TICKS_PER_MS},
};
use proptest::prelude::*;

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
fn each_edge_says_whether_it_is_of_a_rapid() {
    // Moves of a few steps, of one segment, and of many segments.
    for length_mm in [0.05, 0.5, 20.0] {
        let to = |mm: f64| at(&[mm * length_mm]);
        let commands = [
            line_at(to(1.0), FeedRate::Rapid),
            line_at(to(2.0), FeedRate::Feed(3000.0)),
            line_at(to(3.0), FeedRate::Rapid),
            line_at(to(2.0), FeedRate::Feed(300.0)),
        ];
        let trace = Rig::play(&fast(), &number(&commands));
        let edges = trace.edges.iter().filter(|edge| edge.raise != 0);
        let steps = (80.0 * length_mm) as usize;
        let wrong = edges.enumerate().filter(|(index, edge)| {
            // The segment before counts as the one being played until its successor has begun.
            let is_near_end = index % steps == 0;
            edge.is_rapid != (index / steps).is_multiple_of(2) && !is_near_end
        });
        assert_eq!(wrong.count(), 0, "{length_mm} mm");
    }
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

#[test]
fn an_end_exactly_between_two_steps_is_where_grbl_goes() {
    let settings = with(&[250.0], &[6000.0], &[500.0]);
    // In single precision it is a little less than half-way.
    let trace = check(&settings, &[line(&[-0.014], 3000.0)]);
    assert_eq!(trace.net_steps()[0], -3);
}

#[test]
fn a_hold_stops_as_soon_as_the_limits_allow_and_resumes_on_the_path() {
    let settings = with(&[320.0], &[6000.0], &[500.0]);
    let commands = number(&[
        line(&[40.0], 6000.0),
        line(&[80.0, 1.0], 6000.0),
        line(&[120.0, 1.0], 6000.0),
    ]);
    for hold_ms in [150_u64, 500, 399, 900, 777, 1100]
        .into_iter()
        .step_by(each(2))
    {
        let hold = hold_ms * u64::from(TICKS_PER_MS);
        let mut rig = Rig::new(&settings);
        rig.run(&commands, &[(hold, b'!'), (hold + 100_000_000, b'~')]);
        rig.trace.check_pulses();
        check_path(&settings, &commands, &rig.trace, 0.0);
        check_limits(&settings, &rig.trace);
        let resumed = hold + 100_000_000;
        let before = rig.trace.edges.iter().filter(|edge| edge.ticks < resumed);
        let stopped = before.map(|edge| edge.ticks).max().unwrap_or(0);
        // 100 mm/s at 500 mm/s², what is queued ahead, and one segment.
        let longest = 200 + 4 + 2;
        let took = (stopped - hold) / u64::from(TICKS_PER_MS);
        assert!(took <= longest, "{took} ms");
        assert_eq!(rig.trace.starts.len(), 2);
    }
}

#[test]
fn steps_at_the_ends_of_segments_are_not_taken_for_acceleration() {
    let settings = Settings {
        step_pulse_us: 1,
        ..with(
            &[1000.0 / 3.0, 1.0, 1280.0],
            &[11_108.821, 3_586.483_4, 5_633.020_5],
            &[28.262_499, 3440.8, 4106.18],
        )
    };
    let commands = [
        [0.130_496, -0.013_328, -0.632_043],
        [0.0, 0.0, 0.519_999],
        [1.744_416, 0.027_760, -2.195_237],
        [1.402_672, -0.023_180, 1.866_646],
        [-0.026_824, 0.003_357, -0.025_850],
        [2.262_495, -1.743_626, -1.113_529],
    ];
    check(
        &settings,
        &commands.map(|to| line_at(at(&to), FeedRate::Rapid)),
    );
}

/// `inputs` looks whether a segment is due, so that `prepare` need not wait for the next one to begin.
#[test]
fn a_segment_that_is_due_is_made_while_another_is_played() {
    let settings = with(&[320.0], &[6000.0], &[500.0]);
    let mut rig = Rig::new(&settings);
    let commands = number(&[line(&[40.0], 6000.0)]);
    let work = rig.router.route(&commands[0]).expect("it moves");
    assert!(rig.enqueue(work));
    rig.run_to(100 * u64::from(TICKS_PER_MS));
    let queued = |rig: &Rig| rig.drive.segments.numbers().0;
    let mut made = 0;
    for _ in 0..400 {
        let due = rig.drive.due().expect("it moves");
        rig.run_to(due);
        let (before, played) = rig.drive.segments.numbers();
        rig.drive.watch(&rig.requests, rig.now);
        rig.prepare();
        assert_eq!(rig.drive.segments.numbers().1, played);
        made += queued(&rig).wrapping_sub(before);
    }
    assert!(made > 2, "{made} segments");
}

#[test]
fn a_flood_of_requests_does_not_have_the_queue_run_dry() {
    let settings = with(&[320.0], &[6000.0], &[500.0]);
    let commands = number(&[line(&[40.0], 6000.0)]);
    // Up, down, up, down; and resets, of which the first one has the machine slow down.
    for flood in [[0x91, 0x92], [RESET, RESET]] {
        let mut rig = Rig::new(&settings);
        for command in &commands {
            let work = rig.router.route(command).expect("it moves");
            assert!(rig.enqueue(work));
        }
        rig.run_to(250 * u64::from(TICKS_PER_MS));
        assert_eq!(rig.snapshot().state, State::Run);
        rig.run_flooded(&flood.repeat(1000), u64::from(TICKS_PER_MS) * 2 / 5);
        let snapshot = rig.snapshot();
        assert!(!snapshot.has_underrun);
        assert!(snapshot.is_at_rest);
        assert_eq!(snapshot.steps, rig.trace.net_steps());
        rig.trace.check_pulses();
        check_limits(&settings, &rig.trace);
    }
}

#[test]
fn a_move_that_comes_before_a_standstill_is_over_begins_with_a_start() {
    let settings = with(&[320.0], &[6000.0], &[500.0]);
    let commands = number(&[line(&[1.0], 6000.0), line(&[2.0], 6000.0)]);
    let mut rig = Rig::new(&settings);
    // The move takes 89.4 ms, and its standstill is queued 2 ms before its end.
    for (command, until_ms) in commands.iter().zip([88, 88]) {
        let work = rig.router.route(command).expect("it moves");
        assert!(rig.enqueue(work));
        rig.run_to(until_ms * u64::from(TICKS_PER_MS));
    }
    assert!(!rig.snapshot().is_at_rest);
    rig.run_to_standstill();
    assert_eq!(rig.trace.starts.len(), 2);
    assert_eq!(rig.snapshot().steps.0[0], 640);
    rig.trace.check_pulses();
    check_limits(&settings, &rig.trace);
}

#[test]
fn two_resets_in_a_row_keep_the_position() {
    let settings = with(&[320.0], &[6000.0], &[500.0]);
    let commands = number(&[line(&[40.0], 6000.0), line(&[0.0, 3.0], 6000.0)]);
    for gap in [0, 1_000, 1_000_000, 12_000_000, 20_000_000] {
        let mut rig = Rig::new(&settings);
        rig.run(&commands, &[(30_000_000, RESET), (30_000_000 + gap, RESET)]);
        rig.trace.check_pulses();
        check_limits(&settings, &rig.trace);
        assert!(!rig.trace.resets.is_empty());
    }
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

/// Lines, some of them short or without any length.
pub(crate) fn lines(
    feed_rate: impl Strategy<Value = FeedRate>,
) -> impl Strategy<Value = Vec<Command>> {
    let coordinate = prop_oneof![
        4 => -3_000_000..3_000_000_i64,
        2 => -30_000..30_000_i64,
        1 => Just(0_i64),
    ];
    let line = (prop::array::uniform3(coordinate), feed_rate).prop_map(|(nm, feed_rate)| {
        line_at(
            Axes::from_fn(|axis| nm.get(axis).map_or(Nm(0), |nm| Nm(*nm))),
            feed_rate,
        )
    });
    prop::collection::vec(line, 1..12)
}

/// Rapids, and feed rates in both modes.
fn feed_rates() -> impl Strategy<Value = FeedRate> {
    prop_oneof![
        Just(FeedRate::Rapid),
        (20.0..12_000.0_f32).prop_map(FeedRate::Feed),
        (30.0..3000.0_f32).prop_map(FeedRate::InverseTime),
    ]
}

/// Times in ms and bytes, in order of time.
pub(crate) fn acts(bytes: &'static [u8], most: usize) -> impl Strategy<Value = Vec<Act>> {
    let byte = prop::sample::select(bytes);
    prop::collection::vec((0..700_u64, byte), 0..most).prop_map(|mut acts| {
        acts.sort_unstable();
        acts.into_iter()
            .map(|(ms, byte)| (ms * u64::from(TICKS_PER_MS) + 7919 * ms, byte))
            .collect()
    })
}

/// Checks what commands and realtime bytes make of the pins, and of the path where no reset has left it.
pub(crate) fn check_disturbed(
    settings: &Settings,
    commands: &[Command],
    acts: &[Act],
    feed_ticks: u64,
) -> Trace {
    let commands = number(commands);
    let mut rig = Rig::new(settings);
    rig.feed_ticks = feed_ticks;
    rig.run(&commands, acts);
    rig.trace.check_pulses();
    check_limits(settings, &rig.trace);
    if rig.trace.resets.is_empty() {
        check_path(settings, &commands, &rig.trace, slack(settings, &commands));
    }
    rig.trace
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn lines_end_on_their_steps_within_all_limits(settings in settings(), commands in lines(feed_rates())) {
        let trace = check(&settings, &commands);
        let end = commands.last().and_then(target).unwrap();
        prop_assert_eq!(trace.net_steps(), target_steps(&settings, &end));
    }

    #[test]
    fn no_hold_resume_or_reset_loses_or_doubles_a_step(
        settings in settings(),
        commands in lines(feed_rates()),
        acts in acts(b"!!~~~\x18", 8),
        feed_ticks in prop::sample::select(vec![0, 100_000, 3_000_000_u64]),
    ) {
        check_disturbed(&settings, &commands, &acts, feed_ticks);
    }
}

#[test]
fn one_line_of_three_axes_is_the_exact_trapezoid() {
    let settings = with(&[320.0, 320.0, 400.0], &[6000.0], &[500.0]);
    let commands = [line(&[100.0, 61.8, 38.2], 6000.0)];
    let trace = check(&settings, &commands);
    let displacement = [100.0_f64, 61.8, 38.2];
    let length = displacement
        .iter()
        .map(|displacement| displacement * displacement)
        .sum::<f64>()
        .sqrt();
    let ideal = Trapezoid {
        length,
        speed: 100.0,
        acceleration: 500.0 * length / 100.0,
    };
    let start = trace.starts[0] as f64 / TICKS_PER_S;
    for (axis, displacement) in displacement.into_iter().enumerate() {
        let steps = trace.steps(axis);
        let per_mm = f64::from(settings.steps_per_mm[axis].to_f32());
        let times: Vec<f64> = steps.iter().map(|step| step.seconds - start).collect();
        let exact: Vec<f64> = steps
            .iter()
            .map(|step| {
                ideal.when((f64::from(step.position) - 0.5) / per_mm * length / displacement)
            })
            .collect();
        let rms = interval_error_rms(&times, &exact);
        let worst = times
            .iter()
            .zip(&exact)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        println!(
            "axis {axis}: interval error {:.3} % rms, step times within {:.1} µs",
            rms * 100.0,
            worst * 1.0e6
        );
        assert!(rms <= 0.01, "axis {axis}: {rms}");
    }
    let whole = trace.whole_seconds();
    println!("{whole:.6} s of {:.6} s", ideal.seconds());
    assert!((whole / ideal.seconds() - 1.0).abs() <= 0.001, "{whole}");
    let off = off_line(&settings, &trace, displacement);
    assert!(off <= 0.51, "{off:.3} steps off the path");
    let jump = largest_jump(&settings, &trace, displacement, length);
    println!("largest jump of the path speed {jump:.3} mm/s");
    assert!(jump <= 0.7, "{jump}");
}

/// The most that an axis is off a line from the origin after any step, in steps.
fn off_line(settings: &Settings, trace: &Trace, displacement: [f64; 3]) -> f64 {
    let ends = [0, 1, 2].map(|n| displacement[n] * f64::from(settings.steps_per_mm[n].to_f32()));
    let mut position = [0.0; 3];
    let mut worst = 0.0_f64;
    for edge in trace.edges.iter().filter(|edge| edge.raise != 0) {
        for (axis, steps) in position.iter_mut().enumerate() {
            *steps += f64::from(u8::from(edge.raise & 1 << axis != 0));
        }
        let off = |share: f64| {
            let off = [0, 1, 2].map(|n| (ends[n] * share - position[n]).abs());
            off.into_iter().fold(0.0, f64::max)
        };
        // The nearest point of the line: the largest distance is convex along it.
        let near = position[0] / ends[0];
        let (mut low, mut high) = (near - 5.0 / ends[0], near + 5.0 / ends[0]);
        for _ in 0..20 {
            let third = (high - low) / 3.0;
            if off(low + third) < off(high - third) {
                high -= third;
            } else {
                low += third;
            }
        }
        worst = worst.max(off(low));
    }
    worst
}

/// Largest change of the path speed from one interval of the X axis to the next, mm/s, in cruise and, less the part of
/// the acceleration, on the ramps.
fn largest_jump(settings: &Settings, trace: &Trace, displacement: [f64; 3], length: f64) -> f64 {
    let per_mm = f64::from(settings.steps_per_mm[0].to_f32());
    let to_path = length / displacement[0];
    let times: Vec<f64> = trace.steps(0).iter().map(|step| step.seconds).collect();
    let mut jump = 0.0_f64;
    for span in times.windows(3) {
        let speed = |a: f64, b: f64| to_path / per_mm / (b - a);
        let change = speed(span[1], span[2]) - speed(span[0], span[1]);
        let explained = 500.0 * to_path * 0.5 * (span[2] - span[0]);
        jump = jump.max(change.abs() - explained);
    }
    jump
}
