//! Durations of segments: those that `prepare` is proven to keep up with.

use crate::support::{
    Act, Begin, PROVEN, Rig, TICKS_PER_S, arc, cases, check_limits, each, line, number, with,
};
use leadscrew::{
    axis::{AXES, Axes},
    model::{
        Command, FeedRate, Laser, Plane, Rotation,
        timing::{EVENT_SPACING_TICKS, MAX_SEGMENT_TICKS, SPARSE_SEGMENT_TICKS},
    },
    motion::{MEAN_SEGMENT_US, STEPS_PER_SEGMENT},
    settings::{Settings, StepRate},
    sim::Edge,
    units::{Nm, TICKS_PER_US},
};
use proptest::prelude::*;

/// `segment`, `jerk_limited_segment` and `extra_segments` in schedule.toml.
const MEAN_TICKS: u32 = TICKS_PER_US * MEAN_SEGMENT_US;
const JERK_LIMITED_MEAN_TICKS: u32 = MAX_SEGMENT_TICKS / 2;
const JERK_LIMITED_EXTRA_SEGMENTS: u32 = 2;
/// The same as `extra_segments`: one of them is the segment begun before the window.
const EXTRA_SEGMENTS: f64 = 2.0;
/// `longest_segment` there: with a standstill that comes and goes in the same step.
const LONGEST_TICKS: u32 = MAX_SEGMENT_TICKS + EVENT_SPACING_TICKS;
/// `longest_sparse_segment` there.
const LONGEST_SPARSE_TICKS: u32 = SPARSE_SEGMENT_TICKS + EVENT_SPACING_TICKS;

#[test]
fn the_proof_counts_on_the_durations_of_segments_that_are_tested_here() {
    let proof = include_str!("../../schedule.toml");
    for formula in [
        "longest_segment = \"MAX_SEGMENT_TICKS * 1ticks + event_spacing\"",
        "longest_sparse_segment = \"SPARSE_SEGMENT_TICKS * 1ticks + event_spacing\"",
        "segment = \"MEAN_SEGMENT_US * 1us\"",
        "jerk_limited_segment = \"MAX_SEGMENT_TICKS * 1ticks / 2\"",
        "extra_segments = 3",
        "jerk_limited_extra_segments = 2",
        "substituted_steps = \"STEPS_PER_SEGMENT\"",
    ] {
        assert!(proof.contains(&format!("\n{formula}\n")), "{formula}");
    }
    let jitters = proof.lines().filter(|line| line.starts_with("jitter = "));
    assert!(jitters.eq(["jitter = \"look_interval\""; 3]));
}

/// Checks the length of each segment, and the number of segments in any stretch of time, also for the steps made in it.
fn check(segments: &[Begin], step_rate: StepRate) -> Result<(), TestCaseError> {
    let steps_per_tick = f64::from(step_rate.hz()) / TICKS_PER_S;
    let mut level = 0.0_f64;
    for pair in segments.windows(2) {
        let ticks = pair[1].ticks.wrapping_sub(pair[0].ticks);
        prop_assert!(
            ticks <= LONGEST_SPARSE_TICKS,
            "{ticks} at {}",
            pair[0].ticks
        );
        let steps = f64::from(pair[1].steps - pair[0].steps);
        // `segment_steps` there: each axis may round up.
        let most = steps_per_tick * f64::from(LONGEST_TICKS.min(ticks)) + AXES as f64;
        let is_sparse = ticks > LONGEST_TICKS;
        prop_assert!(
            !is_sparse || steps <= most,
            "{steps} steps at {}",
            pair[0].ticks
        );
        // Rounded to ticks.
        let ticks = f64::from(ticks + 1);
        // Of a stretch of time as a whole: more steps than that in a segment count, too.
        let left_out = steps_per_tick * ticks - steps;
        let instead = left_out / f64::from(STEPS_PER_SEGMENT);
        level = (level + 1.0 - ticks / f64::from(MEAN_TICKS) - instead).max(0.0);
        // Each axis may make a step more.
        let most = EXTRA_SEGMENTS + AXES as f64 / f64::from(STEPS_PER_SEGMENT);
        prop_assert!(
            level <= most,
            "{level} at {} of {segments:?}",
            pair[0].ticks
        );
    }
    Ok(())
}

/// The same where acceleration is continuous, with a mean of their own and whatever steps are made.
fn check_smooth(segments: &[Begin], ramp_s: f32) -> Result<(), TestCaseError> {
    if ramp_s > 0.0 {
        check_mean(
            segments,
            JERK_LIMITED_MEAN_TICKS,
            JERK_LIMITED_EXTRA_SEGMENTS,
        )
    } else {
        check(segments, PROVEN)
    }
}

fn check_mean(segments: &[Begin], mean: u32, saved: u32) -> Result<(), TestCaseError> {
    let most = saved * mean;
    let mut slack = most;
    for pair in segments.windows(2) {
        let ticks = pair[1].ticks.wrapping_sub(pair[0].ticks);
        prop_assert!(ticks <= LONGEST_TICKS, "{ticks} at {}", pair[0].ticks);
        // Rounded to ticks.
        slack = (slack + ticks + 1).min(most);
        prop_assert!(slack >= mean, "at {} of {segments:?}", pair[0].ticks);
        slack -= mean;
    }
    Ok(())
}

/// Plays a program; where its segments begin, without the standstills at which it waits.
fn play(settings: &Settings, commands: &[Command], acts: &[Act], feed_ticks: u64) -> Vec<Begin> {
    let mut rig = Rig::new(settings);
    rig.feed_ticks = feed_ticks;
    rig.run(commands, acts);
    check_events(&rig.trace.edges, settings.step_rate);
    rig.segments
}

/// Checks that no stretch of time has more step events than `task.step` in schedule.toml allows.
fn check_events(events: &[Edge], step_rate: StepRate) {
    let segments_per_s = TICKS_PER_S / f64::from(MEAN_TICKS);
    let per_tick = 2.0 * (f64::from(step_rate.hz()) + segments_per_s) / TICKS_PER_S;
    let burst = 2.0 * (AXES as f64 + EXTRA_SEGMENTS + 1.0);
    let (mut level, mut before) = (0.0_f64, 0);
    for event in events {
        level = (level - per_tick * (event.ticks - before) as f64).max(0.0) + 1.0;
        before = event.ticks;
        // The first event of a stretch comes at its beginning.
        assert!(level <= burst + 1.0, "{level} events at {before}");
    }
}

/// Lines, and arcs for a sixth of them, each turned from the one before, mm and rad.
fn path(chords: &[(f64, f64)], bend: f64, arcs: bool, mm_min: f32) -> Vec<Command> {
    let (mut angle, mut here) = (0.0, [0.0_f64; 2]);
    let moves = chords.iter().enumerate().map(|(number, (length, turn))| {
        angle += (turn - 3.15) * bend;
        here = [
            here[0] + length * angle.cos(),
            here[1] + length * angle.sin(),
        ];
        if arcs && number % 6 == 5 {
            // Around a centre beside the middle of the way.
            let bulge = [0.1, 0.5, 3.0][number % 3];
            let centre = [
                length * (0.5 * angle.cos() - bulge * angle.sin()),
                length * (0.5 * angle.sin() + bulge * angle.cos()),
            ];
            let rotation = [Rotation::Clockwise, Rotation::CounterClockwise][number / 6 % 2];
            return arc(Plane::Xy, rotation, &here, centre, mm_min);
        }
        line(&here, mm_min)
    });
    moves.collect()
}

fn chords(count: impl Into<prop::collection::SizeRange>) -> impl Strategy<Value = Vec<(f64, f64)>> {
    let length = prop_oneof![0.001..0.01_f64, 0.01..0.1, 0.1..1.0, 1.0..5.0];
    prop::collection::vec((length, 0.0..6.3_f64), count)
}

/// With acceleration that takes `ramp_s` to be there, or none.
fn settings(acceleration: f32, ramp_s: f32, junction_deviation_mm: f32) -> Settings {
    Settings {
        jerk_mm_s3: Axes::all(if ramp_s > 0.0 {
            acceleration / ramp_s
        } else {
            0.0
        }),
        junction_deviation_mm,
        ..with(&[400.0; 3], &[60_000.0], &[acceleration])
    }
}

fn accelerations() -> impl Strategy<Value = f32> {
    prop_oneof![Just(100.0_f32), Just(1000.0), Just(20_000.0)]
}

fn ramps() -> impl Strategy<Value = f32> {
    prop_oneof![2 => Just(0.0_f32), 1 => 0.0..0.01_f32, 1 => 0.01..0.15_f32]
}

fn feeds() -> impl Strategy<Value = f32> {
    prop_oneof![Just(600.0_f32), Just(6000.0), Just(60_000.0)]
}

fn bends() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.01), Just(0.1), Just(1.0)]
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn lines_make_segments_of_seven_tenths_of_a_millisecond_on_average(
        chords in chords(30..400),
        bend in bends(),
        acceleration in accelerations(),
        ramp_s in ramps(),
        deviation in prop_oneof![Just(0.0_f32), Just(0.01), Just(10.0)],
        mm_min in feeds(),
    ) {
        let commands = path(&chords, bend, false, mm_min);
        check_smooth(&play(&settings(acceleration, ramp_s, deviation), &commands, &[], 0), ramp_s)?;
    }

    #[test]
    fn so_do_arcs(
        chords in chords(30..200),
        bend in bends(),
        acceleration in accelerations(),
        ramp_s in ramps(),
        mm_min in feeds(),
    ) {
        let commands = path(&chords, bend, true, mm_min);
        check_smooth(&play(&settings(acceleration, ramp_s, 0.01), &commands, &[], 0), ramp_s)?;
    }

    #[test]
    fn so_do_holds_and_overrides(
        chords in chords(30..200),
        bend in bends(),
        acceleration in accelerations(),
        ramp_s in ramps(),
        mm_min in feeds(),
        acts in prop::collection::vec(
            (0..10_000_000_u64, prop::sample::select(&b"!~!~\x90\x91\x92\x91\x92\x95\x97"[..])),
            1..60,
        ),
    ) {
        let commands = path(&chords, bend, true, mm_min);
        let mut now = 0;
        let acts: Vec<Act> = acts.iter().map(|(wait, byte)| { now += wait; (now, *byte) }).collect();
        check_smooth(&play(&settings(acceleration, ramp_s, 0.01), &commands, &acts, 0), ramp_s)?;
    }

    #[test]
    fn overrides_of_a_full_look_ahead_keep_the_limits(
        chords in chords(150..300),
        acceleration in prop_oneof![Just(100.0_f32), Just(1000.0)],
        ramp_s in ramps(),
        mm_min in feeds(),
        acts in prop::collection::vec(
            (0..10_000_000_u64, prop::sample::select(&b"\x90\x91\x92\x92\x92\x92"[..])),
            1..60,
        ),
    ) {
        let settings = settings(acceleration, ramp_s, 0.01);
        let mut now = 0;
        let acts: Vec<Act> = acts.iter().map(|(wait, byte)| { now += wait; (now, *byte) }).collect();
        let mut rig = Rig::new(&settings);
        rig.run(&number(&path(&chords, 0.1, false, mm_min)), &acts);
        check_limits(&settings, &rig.trace);
    }

    #[test]
    fn so_do_blocks_that_come_late(
        chords in chords(30..100),
        bend in bends(),
        acceleration in accelerations(),
        ramp_s in ramps(),
        mm_min in feeds(),
        feed_ticks in 1_000..1_000_000_u64,
    ) {
        let commands = path(&chords, bend, true, mm_min);
        check_smooth(&play(&settings(acceleration, ramp_s, 0.01), &commands, &[], feed_ticks), ramp_s)?;
    }
}

/// Lines of 10 steps at 250 steps/mm; each in how much time where the machine is fast, s.
fn short_lines_s(step_rate: StepRate) -> Result<f64, TestCaseError> {
    let settings = Settings {
        step_rate,
        ..with(&[250.0], &[13_000.0], &[20_000.0])
    };
    let commands: Vec<_> = (1..=2000)
        .map(|number| line(&[f64::from(number) * 0.04], 13_000.0))
        .collect();
    let segments = play(&settings, &commands, &[], 0);
    check(&segments, step_rate)?;
    let times = segments
        .windows(2)
        .map(|pair| pair[1].ticks - pair[0].ticks);
    let mut times: Vec<u32> = times.collect();
    times.sort_unstable();
    Ok(f64::from(times[times.len() / 2]) / TICKS_PER_S)
}

#[test]
fn lines_of_few_steps_follow_each_other_faster() -> Result<(), TestCaseError> {
    // The proven rate at 1 Mbaud with three axes.
    let seconds = short_lines_s(StepRate::Proven(172_000))?;
    let steps_per_s = 172_000.0;
    let (steps, mean_s) = (
        f64::from(STEPS_PER_SEGMENT),
        f64::from(MEAN_SEGMENT_US) / 1e6,
    );
    let expected = (steps + 10.0) / (steps / mean_s + steps_per_s);
    assert!((seconds / expected - 1.0).abs() < 0.01, "{seconds} s");
    assert!(AXES > 3 || seconds <= 1.0 / 3200.0, "{seconds} s");
    // An image of which nothing is proven.
    let seconds = short_lines_s(StepRate::Unproven)?;
    assert!(seconds > 0.5e-3, "{seconds} s");
    Ok(())
}

/// The longest segment of a slow motion to and fro, after a command.
fn longest_ticks(before: &[Command], feed_rate: impl Fn(f32) -> FeedRate) -> u32 {
    let mut commands = before.to_vec();
    commands.extend([5.0, 0.0].map(|x| Command::Line {
        target: Axes::from_fn(|axis| Nm::from_mm(if axis == 0 { x } else { 0.0 })).into(),
        feed_rate: feed_rate(600.0),
        line: 0,
    }));
    let segments = play(&settings(100.0, 0.0, 0.01), &commands, &[], 0);
    let ticks = { segments.windows(2) }.map(|pair| pair[1].ticks - pair[0].ticks);
    ticks.max().expect("it moves")
}

#[test]
fn segments_are_longer_on_lines_alone_that_nothing_waits_for() {
    let is_longer = |ticks| ticks > LONGEST_TICKS;
    assert!(is_longer(longest_ticks(&[], FeedRate::Feed)));
    assert!(!is_longer(longest_ticks(&[], FeedRate::Jog)));
    for laser in [Laser::Constant(100.0), Laser::Proportional(100.0)] {
        let power = [Command::Power(laser)];
        assert!(
            !is_longer(longest_ticks(&power, FeedRate::Feed)),
            "{laser:?}"
        );
    }
}

#[test]
fn an_axis_that_turns_at_each_line_makes_no_more_steps_than_are_proven() {
    for hz in [60_000, 172_000] {
        let settings = Settings {
            step_rate: StepRate::Proven(hz),
            step_pulse_us: 1,
            ..with(&[3200.0, 80.0, 3200.0], &[60_000.0], &[5000.0])
        };
        // X and Z at the full rate; Y goes back and forth where a step is due.
        let length = f64::from(hz) / 2.0 / 3200.0 * 0.701e-3;
        let commands = (0..2000).map(|number: u32| {
            let y = 0.00625 + [0.0001, -0.0001][number as usize % 2];
            let x = length * f64::from(number);
            line(&[x, y, x], 60_000.0)
        });
        let segments = play(&settings, &commands.collect::<Vec<_>>(), &[], 0);
        let fast = &segments[segments.len() / 4..segments.len() * 3 / 4];
        let [first, last] = [fast[0], fast[fast.len() - 1]];
        let seconds = f64::from(last.ticks - first.ticks) / TICKS_PER_S;
        let steps = f64::from(last.steps - first.steps);
        let most = seconds * f64::from(hz) + AXES as f64;
        assert!(steps > 0.98 * most, "{steps} of {most}");
        assert!(steps <= most, "{steps} of {most}");
    }
}

#[test]
fn a_tool_path_of_long_and_very_short_lines_makes_no_burst_of_segments() {
    let chords = [
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 0.0),
        (0.001, 5.83),
        (0.001, 0.0),
        (0.001, 0.0),
        (4.469, 2.243),
        (0.01, 1.979),
        (0.001, 0.0),
        (0.079, 1.684),
        (0.001, 1.339),
        (4.275, 0.0),
        (0.1, 2.075),
        (0.088, 0.0),
        (0.001, 2.512),
        (0.01, 0.55),
        (2.965, 1.128),
        (0.001, 1.142),
        (0.06, 2.038),
        (1.942, 0.722),
        (0.29, 4.018),
        (0.001, 2.206),
        (1.0, 6.05),
        (0.166, 0.247),
        (0.01, 1.782),
        (0.009, 2.587),
        (0.904, 0.113),
        (0.001, 3.618),
        (0.01, 4.095),
        (1.0, 4.148),
        (1.562, 0.782),
        (2.257, 4.775),
        (1.0, 4.516),
        (0.066, 4.574),
        (0.001, 5.854),
        (0.001, 0.0),
        (0.308, 3.552),
        (0.007, 0.0),
        (0.026, 4.064),
        (0.001, 0.0),
        (0.605, 0.0),
        (0.009, 0.0),
        (0.053, 4.488),
        (0.006, 0.0),
        (0.045, 0.0),
        (0.05, 0.0),
        (0.963, 0.0),
    ];
    let commands = path(&chords, 0.01, false, 60_000.0);
    let segments = play(&settings(20_000.0, 0.0, 0.01), &commands, &[], 0);
    check(&segments, PROVEN).unwrap();
}

#[test]
fn short_lines_after_an_arc_that_ends_after_a_reversal_make_no_burst_of_segments() {
    let mut chords = vec![(0.1, 3.15); 53];
    chords.extend([
        (1.25, 6.12),
        (0.0023, 0.0),
        (0.0034, 0.0),
        (0.001, 0.0),
        (0.03, 0.0),
    ]);
    // Arcs that end everywhere around the reversal.
    for turn in (0..200).step_by(each(9)) {
        chords[53].1 = f64::from(turn) * 0.03;
        let commands = path(&chords, 0.3, true, 6000.0);
        check(
            &play(&settings(20_000.0, 0.0, 0.01), &commands, &[], 0),
            PROVEN,
        )
        .unwrap();
    }
}
