//! Moves at the edges of what can be programmed and set.

use crate::support::{
    RESET, Rig, TICKS_PER_S, Trace, arc, at, cases, check_limits, check_path, fast, line, line_at,
    number, target, target_steps, with,
};
use leadscrew::{
    axis::{AXES, Axes},
    model::{Command, FeedRate, Plane, Rotation},
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

/// Plays numbered commands; checks pulses, path and limits.
fn check(settings: &Settings, commands: &[Command]) -> Trace {
    let commands = number(commands);
    let trace = Rig::play(settings, &commands);
    trace.check_pulses();
    check_path(settings, &commands, &trace, 0.0);
    check_limits(settings, &trace);
    trace
}

/// Mean speed of an axis between its first and its last step, mm/min.
fn mean_speed(settings: &Settings, trace: &Trace, axis: usize) -> f64 {
    let steps = trace.steps(axis);
    let (first, last) = (steps[0], steps[steps.len() - 1]);
    let distance = f64::from((last.position - first.position).abs());
    distance / f64::from(settings.steps_per_mm[axis].to_f32()) / (last.seconds - first.seconds)
        * 60.0
}

#[test]
fn blocks_of_one_step_make_one_step_each() {
    let settings = with(&[80.0, 100.0, 400.0], &[5000.0], &[500.0]);
    let mut at = [0.0; 3];
    let mut commands = Vec::new();
    for k in 0..2000_u32 {
        let axis = (k * 7 % 3) as usize;
        let sign = if k * 13 % 7 < 5 { 1.0 } else { -1.0 };
        at[axis] += sign / [80.0, 100.0, 400.0][axis];
        commands.push(line(&at, 5000.0));
    }
    let trace = check(&settings, &commands);
    let steps: usize = (0..AXES).map(|axis| trace.steps(axis).len()).sum();
    assert_eq!(steps, 2000);
}

#[test]
fn thousands_of_short_lines_around_a_curve_flow() {
    let settings = with(&[250.0, 250.0, 250.0], &[6000.0], &[500.0]);
    let mut commands = Vec::new();
    for k in 1..3000_u32 {
        let angle = f64::from(k) * 0.005;
        // Chords of 0.05 mm and of 0.01 mm.
        let angle = if k % 10 == 0 { angle - 0.004 } else { angle };
        commands.push(line(
            &[10.0 * angle.sin(), 10.0 - 10.0 * angle.cos(), angle * 0.1],
            3000.0,
        ));
    }
    let trace = check(&settings, &commands);
    // 150 mm at 50 mm/s.
    let seconds = trace.whole_seconds();
    assert!((2.99..3.3).contains(&seconds), "{seconds}");
}

#[test]
fn moves_without_length_make_no_step_and_add_up() {
    let settings = fast();
    let mut commands = vec![line(&[0.0], 100.0)];
    commands.extend(
        (1..=1000).map(|k| line(&[f64::from(k) * 0.001, f64::from(k) * -0.000_001], 600.0)),
    );
    commands.push(line(&[1.0, -0.001], 600.0));
    let trace = Rig::play(&settings, &number(&commands));
    assert_eq!(trace.net_steps(), target_steps(&settings, &at(&[1.0])));
    assert_eq!(trace.steps(0).len(), 80);
    assert!(trace.steps(1).is_empty());
    let seconds = trace.whole_seconds();
    assert!((0.1..0.13).contains(&seconds), "{seconds}");
}

#[test]
fn a_block_of_twenty_metres_ends_on_its_step() {
    let settings = with(&[20.0, 7.874, 3.0], &[120_000.0], &[2000.0]);
    let trace = check(
        &settings,
        &[line(&[20_000.0, -9_999.999, 12_345.678], 120_000.0)],
    );
    let speed = mean_speed(&settings, &trace, 0);
    assert!((speed / 95_000.0 - 1.0).abs() < 0.1, "{speed}");
}

#[test]
fn one_millimetre_per_minute_is_kept() {
    let settings = with(&[250.0, 4000.0], &[5000.0], &[500.0]);
    for commands in [
        vec![line(&[0.1, 0.05], 1.0)],
        // Slower still means 1 mm/min, as in Grbl.
        vec![line(&[0.1, 0.05], 0.01)],
    ] {
        let trace = check(&settings, &commands);
        let length = 0.1_f64.hypot(0.05);
        let speed = mean_speed(&settings, &trace, 0) * length / 0.1;
        assert!((speed - 1.0).abs() < 1.0e-3, "{speed}");
        let intervals: Vec<f64> = trace
            .steps(0)
            .windows(2)
            .map(|w| w[1].seconds - w[0].seconds)
            .collect();
        for interval in &intervals[1..] {
            assert!(
                (interval / intervals[1] - 1.0).abs() < 0.01,
                "{intervals:?}"
            );
        }
    }
}

#[test]
fn a_long_block_is_begun_at_one_millimetre_per_minute() {
    let settings = with(&[400.0, 320.0], &[5000.0], &[500.0]);
    let mut rig = Rig::new(&settings);
    rig.run(
        &[line(&[12_000.0, 9_000.0], 1.0)],
        &[(TICKS_PER_S as u64 * 8, RESET)],
    );
    let steps = rig.trace.steps(0);
    for pair in steps.windows(2).skip(1) {
        let interval = pair[1].seconds - pair[0].seconds;
        let exact = 60.0 / 400.0 / 0.8;
        assert!((interval / exact - 1.0).abs() < 0.02, "{interval}");
    }
    assert_eq!(steps.len(), (8.0_f64 * 400.0 * 0.8 / 60.0).round() as usize);
}

#[test]
fn a_slow_feed_is_reached_after_a_slower_corner() {
    // Acceleration that reaches the feed in far less than a segment.
    let settings = Settings {
        junction_deviation_mm: 1.0e-9,
        ..with(&[400.0], &[5000.0], &[5000.0])
    };
    for feed in [1.0, 3.0, 10.0] {
        let commands = [
            line(&[0.1], feed),
            line(&[0.1, 0.1], feed),
            line(&[0.2, 0.2], feed),
        ];
        let trace = check(&settings, &commands);
        let length = 0.2 + 0.1 * 2.0_f64.sqrt();
        let exact = length / f64::from(feed) * 60.0;
        assert!((trace.whole_seconds() / exact - 1.0).abs() < 2.0e-3);
    }
}

#[test]
fn long_pulses_slow_the_machine_and_lose_nothing() {
    for step_pulse_us in [0, 1, 2, 100, 255] {
        let settings = Settings {
            step_pulse_us,
            ..with(&[400.0, 320.0, 1000.0], &[30_000.0], &[5000.0])
        };
        let commands = [
            line(&[4.0, 1.3, -2.0], 30_000.0),
            line(&[0.0, 1.3, 2.0], 30_000.0),
            arc(
                Plane::Xy,
                Rotation::Clockwise,
                &[0.0, 1.3, 0.5],
                [0.7, 0.7],
                30_000.0,
            ),
            line(&[1.0], 30_000.0),
        ];
        let commands = number(&commands);
        let trace = Rig::play(&settings, &commands);
        trace.check_pulses();
        assert_eq!(trace.net_steps(), target_steps(&settings, &at(&[1.0])));
        let longest = f64::from(step_pulse_us) * 1.0e-6;
        check_path(&settings, &commands, &trace, 0.1 + longest * 1.0e3);
    }
}

#[test]
fn a_fast_block_before_a_very_slow_one_is_left_at_its_speed() {
    let settings = Settings {
        step_pulse_us: 168,
        junction_deviation_mm: 10.0,
        ..with(
            &[804.348_388, 66_862.845_954, 56_067.022_895],
            &[516_871.44, 5.399_190_4, 484_351.53],
            &[971_887.7, 797_243.06, 888_242.44],
        )
    };
    let commands = number(&[
        line(&[-0.436_303, -0.002_176, 0.000_834], 661_399.25),
        line(&[-0.006_392, -0.005_069, 0.001_751], 661_399.25),
        line(&[0.069_566, 0.005_165, 0.004_263], 661_399.25),
        line(&[0.293_341, 0.003_496, -0.001_955], 661_399.25),
    ]);
    let trace = Rig::play(&settings, &commands);
    trace.check_pulses();
    check_path(&settings, &commands, &trace, 0.1);
}

#[test]
fn steps_faster_than_the_queue_is_long_lose_no_segment() {
    let settings = Settings {
        step_pulse_us: 1,
        ..with(
            &[1.0, 1.0, 1280.0],
            &[11_295.916, 9_002.947, 10_110.096],
            &[4579.403, 1190.923, 2820.636],
        )
    };
    let commands = number(&[
        line(&[0.0, -0.002_487, 1.952_611], 60_000.0),
        line(&[0.0, -0.615_628, 0.056_93], 60_000.0),
        line(&[0.0, -1.219_31, -2.248_039], 6_402.830_6),
    ]);
    let trace = Rig::play(&settings, &commands);
    trace.check_pulses();
    assert_eq!(
        trace.net_steps(),
        target_steps(&settings, &at(&[0.0, -1.219_31, -2.248_039]))
    );
}

#[test]
fn inverse_time_moves_take_their_time() {
    let settings = with(&[250.0], &[6000.0], &[5000.0]);
    for (per_min, seconds) in [(60.0, 1.0), (30.0, 2.0), (600.0, 0.1)] {
        for command in [
            line_at(at(&[1.0, 0.5]), FeedRate::InverseTime(per_min)),
            match arc(Plane::Xy, Rotation::Clockwise, &[0.0], [0.3, 0.0], 1.0) {
                Command::Arc {
                    target,
                    circle,
                    line,
                    ..
                } => Command::Arc {
                    target,
                    circle,
                    feed_rate: FeedRate::InverseTime(per_min),
                    line,
                },
                other => other,
            },
        ] {
            let whole = Rig::play(&settings, &[command]).whole_seconds();
            // The ramps at both ends come on top.
            assert!(whole >= seconds && whole < seconds + 0.02, "{whole}");
        }
    }
}

#[test]
fn all_axes_together_end_on_their_steps() {
    let settings = with(
        &[80.0, 320.0, 400.0, 26.6667, 8.888, 100.0],
        &[6000.0],
        &[500.0],
    );
    let target =
        Axes::from_fn(|axis| Nm([7_000_000, -2_345_678, 1, 90_000_000, -45_000_001, 5][axis]));
    let rotary = Axes::from_fn(|axis| {
        if axis < 3 {
            target[axis]
        } else {
            Nm(target[axis].0 - 30_000_000)
        }
    });
    let commands = [
        line_at(target, FeedRate::Feed(2000.0)),
        line_at(rotary, FeedRate::Feed(2000.0)),
        line_at(rotary, FeedRate::Rapid),
    ];
    let trace = Rig::play(&settings, &number(&commands));
    trace.check_pulses();
    check_limits(&settings, &trace);
    assert_eq!(trace.net_steps(), target_steps(&settings, &rotary));
}

proptest! {
    #![proptest_config(cases(8))]

    #[test]
    fn odd_settings_lose_no_step(
        steps in prop::array::uniform3(prop_oneof![0.02..1.0_f64, 1.0..2000.0_f64, 20_000.0..100_000.0_f64]),
        rates in prop::array::uniform3(prop_oneof![1.0..20.0_f32, 1000.0..1.0e6_f32]),
        accelerations in prop::array::uniform3(prop_oneof![0.05..5.0_f32, 1.0e4..1.0e6_f32]),
        step_pulse_us in prop_oneof![0..6_u8, 100..=255_u8],
        junction_deviation_mm in prop_oneof![Just(0.0_f32), Just(10.0_f32)],
        shares in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 1..6),
        feed_rate in prop_oneof![Just(FeedRate::Rapid), (0.0..1.0e6_f32).prop_map(FeedRate::Feed)],
        reset_at in prop::option::of(0..2_000_000_000_u64),
    ) {
        let settings = Settings {
            step_pulse_us,
            junction_deviation_mm,
            ..with(&steps, &rates, &accelerations)
        };
        // Within a few hundred steps and a minute's way of each axis.
        let commands: Vec<Command> = shares
            .iter()
            .map(|shares| {
                let mm = [0, 1, 2].map(|n| {
                    let reach = (400.0 / steps[n]).min(f64::from(rates[n]) * 0.2);
                    shares[n] * reach.min(f64::from(accelerations[n]) * 20.0)
                });
                line_at(at(&mm), match feed_rate {
                    FeedRate::Feed(feed) => FeedRate::Feed(feed.max(reach_mm_min(&mm))),
                    feed_rate => feed_rate,
                })
            })
            .collect();
        let acts: Vec<_> = reset_at.into_iter().map(|ticks| (ticks, RESET)).collect();
        let mut rig = Rig::new(&settings);
        rig.run(&number(&commands), &acts);
        rig.trace.check_pulses();
        if rig.trace.resets.is_empty() {
            let end = commands.last().and_then(target).unwrap();
            prop_assert_eq!(rig.trace.net_steps(), target_steps(&settings, &end));
        }
    }
}

/// A feed at which a move takes no more than two minutes.
fn reach_mm_min(mm: &[f64; 3]) -> f32 {
    mm.iter().map(|mm| mm.abs()).sum::<f64>() as f32
}
