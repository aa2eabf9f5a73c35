//! Motion with limits of jerk, as the step pins show it.

use crate::moves::{acts, check_disturbed, lines};
use crate::support::{
    self, Rig, Trace, Trapezoid, at, cases, check_limits, each, interval_error_rms, line, line_at,
    number, target, target_steps, with,
};
use leadscrew::{axis::Axes, model::FeedRate, settings::Settings, units::TICKS_PER_MS};
use proptest::prelude::*;

const DOOR: u8 = 0x84;
const RESET: u8 = support::RESET;

fn machine(jerk: f32) -> Settings {
    Settings {
        jerk_mm_s3: Axes::all(jerk),
        ..with(&[320.0, 320.0, 400.0], &[6000.0], &[500.0])
    }
}

/// A line from rest to rest whose speed is the mean, over a window, of that of a trapezoid.
struct Mean {
    trapezoid: Trapezoid,
    window: f64,
}

impl Mean {
    /// Time at which each distance is reached, rising.
    fn when(&self, distances: impl Iterator<Item = f64>) -> Vec<f64> {
        const DT: f64 = 2.0e-6;
        let distance = |t: f64| self.trapezoid.distance(t);
        let speed = |t: f64| (distance(t) - distance(t - self.window)) / self.window;
        let (mut t, mut done, mut before) = (0.0, 0.0, 0.0);
        let mut times = Vec::new();
        for distance in distances {
            while done < distance && t < 10.0 {
                before = done;
                done += 0.5 * (speed(t) + speed(t + DT)) * DT;
                t += DT;
            }
            times.push(t - DT * (done - distance) / (done - before).max(1.0e-12));
        }
        times
    }
}

/// Greatest change of acceleration over time of an axis, from mean speeds over windows, mm/s³.
fn hardest_jerk(trace: &Trace, axis: usize, per_mm: f64, window_s: f64) -> f64 {
    let steps = trace.steps(axis);
    let mut means = Vec::new();
    let mut first = 0;
    for (last, step) in steps.iter().enumerate() {
        let seconds = step.seconds - steps[first].seconds;
        if seconds >= window_s {
            let middle = 0.5 * (step.seconds + steps[first].seconds);
            means.push((middle, (last - first) as f64 / per_mm / seconds));
            first = last;
        }
    }
    let slope = |a: (f64, f64), b: (f64, f64)| (0.5 * (a.0 + b.0), (b.1 - a.1) / (b.0 - a.0));
    let gains: Vec<_> = means.windows(2).map(|two| slope(two[0], two[1])).collect();
    let jerks = gains.windows(2).map(|two| slope(two[0], two[1]).1.abs());
    jerks.fold(0.0, f64::max)
}

#[test]
fn a_line_is_the_third_order_optimum() {
    let settings = machine(10_000.0);
    let displacement = [100.0_f64, 61.8, 38.2];
    let trace = Rig::play(&settings, &number(&[line(&displacement, 6000.0)]));
    trace.check_pulses();
    check_limits(&settings, &trace);
    assert_eq!(
        trace.net_steps(),
        target_steps(&settings, &at(&displacement))
    );
    let length = displacement
        .iter()
        .map(|displacement| displacement * displacement)
        .sum::<f64>()
        .sqrt();
    let ideal = Mean {
        trapezoid: Trapezoid {
            length,
            speed: 100.0,
            acceleration: 500.0 * length / 100.0,
        },
        window: 0.051,
    };
    let optimum = ideal.trapezoid.seconds() + 0.05;
    let whole = trace.whole_seconds();
    println!("{whole:.4} s of {optimum:.4} s");
    assert!(whole <= optimum * 1.005, "{whole}");
    let start = trace.starts[0] as f64 / support::TICKS_PER_S;
    for (axis, displacement) in displacement.into_iter().enumerate() {
        let per_mm = f64::from(settings.steps_per_mm[axis].to_f32());
        let steps = trace.steps(axis);
        let times: Vec<f64> = steps.iter().map(|step| step.seconds - start).collect();
        let distances = steps
            .iter()
            .map(|step| (f64::from(step.position) - 0.5) / per_mm * length / displacement);
        let rms = interval_error_rms(&times, &ideal.when(distances));
        let jerk = hardest_jerk(&trace, axis, per_mm, 0.004);
        println!(
            "axis {axis}: interval error {:.3} % rms, jerk {jerk:.0} mm/s³",
            rms * 100.0
        );
        assert!(rms <= 0.005, "axis {axis}: {rms}");
        assert!(axis > 0 || jerk <= 10_000.0 * 1.05, "{jerk}");
    }
}

/// Greatest addition of a hold to the time that the limits allow, ms.
const HOLD_MS: f64 = 5.0;

#[test]
fn a_hold_in_a_cruise_takes_5_ms_more_than_the_limits_allow() {
    for jerk in [30_000.0, 0.0, 10_000.0, 50_000.0]
        .into_iter()
        .step_by(each(3))
    {
        let settings = machine(jerk);
        let ramp_s = if jerk > 0.0 {
            500.0 / f64::from(jerk)
        } else {
            0.0
        };
        // 100 mm/s at 500 mm/s², and half of the acceleration's own time.
        let shortest_mm = 10.0 + 100.0 * 0.5 * ramp_s;
        for instant in (0..100_u64).step_by(each(25)) {
            let asked = 500 * u64::from(TICKS_PER_MS) + 95_027 * instant;
            let resume = (asked + 100_000_000, b'~');
            let mut rig = Rig::new(&settings);
            let line = line_at(at(&[200.0]), FeedRate::Feed(6000.0));
            rig.run(&number(&[line]), &[(asked, b'!'), resume]);
            let steps = rig.trace.steps(0);
            let held = steps
                .iter()
                .filter(|step| (asked..resume.0).contains(&step.ticks));
            let last = held.clone().map(|step| step.ticks).max().unwrap_or(asked);
            let late_ms = (held.count() as f64 / 320.0 - shortest_mm) / 0.1;
            assert!(late_ms <= HOLD_MS, "{late_ms} ms at {asked}, jerk {jerk}");
            // 100 mm/s at 500 mm/s², and the acceleration's own time.
            let took_ms = (last - asked) as f64 / f64::from(TICKS_PER_MS);
            let late_ms = took_ms - 200.0 - 1000.0 * ramp_s;
            assert!(late_ms <= HOLD_MS, "{late_ms} ms at {asked}, jerk {jerk}");
        }
    }
}

#[test]
fn a_hold_and_a_cancelled_jog_take_two_windows_more_than_the_trapezoid() {
    let settings = machine(10_000.0);
    let target = || at(&[200.0]);
    for (feed_rate, byte) in [
        (FeedRate::Feed(6000.0), b'!'),
        (FeedRate::Jog(6000.0), 0x85),
    ] {
        for ms in [5, 150, 40, 400, 60, 700].into_iter().step_by(each(2)) {
            let asked = ms * u64::from(TICKS_PER_MS);
            let mut rig = Rig::new(&settings);
            let resume = (asked + 100_000_000, b'~');
            let acts = [(asked, byte), resume];
            rig.run(&number(&[line_at(target(), feed_rate)]), &acts);
            rig.trace.check_pulses();
            check_limits(&settings, &rig.trace);
            let before = rig.trace.edges.iter().filter(|edge| edge.ticks < resume.0);
            let stopped = before.map(|edge| edge.ticks).max().unwrap_or(0);
            // 100 mm/s at 500 mm/s², the window to end an acceleration and the one to brake.
            let longest = 200 + 2 * 50 + 5;
            let took = stopped.saturating_sub(asked) / u64::from(TICKS_PER_MS);
            assert!(took <= longest, "{took} ms");
        }
    }
}

/// Rapids and feed rates.
fn feed_rates() -> impl Strategy<Value = FeedRate> {
    prop_oneof![
        Just(FeedRate::Rapid),
        (20.0..12_000.0_f32).prop_map(FeedRate::Feed),
    ]
}

/// Machines whose acceleration takes 1 to 150 ms.
fn machines() -> impl Strategy<Value = Settings> {
    let steps = prop::sample::select(vec![78.74, 80.0, 250.0, 320.0, 1000.0 / 3.0]);
    (
        prop::array::uniform3(steps),
        prop::array::uniform3(60.0..12_000.0_f32),
        prop::array::uniform3(5.0..5000.0_f32),
        prop::array::uniform3(0.001..0.15_f32),
    )
        .prop_map(|(steps, rates, accelerations, seconds)| Settings {
            jerk_mm_s3: Axes::from_fn(|axis| {
                let axis = axis.min(2);
                accelerations[axis] / seconds[axis]
            }),
            ..with(&steps, &rates, &accelerations)
        })
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn no_order_of_events_loses_a_step_or_breaks_a_limit(
        settings in machines(),
        commands in lines(feed_rates()),
        acts in acts(&[0x90, 0x91, 0x92, 0x91, 0x92, 0x95, 0x96, 0x97, b'!', b'~', b'~', DOOR, RESET], 16),
        feed_ticks in prop::sample::select(vec![0, 100_000, 3_000_000_u64]),
    ) {
        let trace = check_disturbed(&settings, &commands, &acts, feed_ticks);
        if trace.resets.is_empty() {
            let end = commands.last().and_then(target).unwrap();
            prop_assert_eq!(trace.net_steps(), target_steps(&settings, &end));
        }
    }
}

#[test]
fn a_line_in_parts_before_a_slower_one_takes_no_longer_than_in_one() {
    let settings = machine(10_000.0);
    let seconds = |ends: &[f64]| {
        let lines = ends.iter().map(|end| line(&[*end], 4000.0));
        let mut moves: Vec<_> = lines.collect();
        moves.push(line(&[9.0], 1200.0));
        let trace = Rig::play(&settings, &number(&moves));
        check_limits(&settings, &trace);
        trace.whole_seconds()
    };
    let whole = seconds(&[7.0]);
    // A part is shorter than the way on which the machine slows down.
    for parts in [&[5.0, 7.0][..], &[6.0, 7.0], &[5.0, 6.0, 7.0]] {
        let in_parts = seconds(parts);
        assert!(
            in_parts <= whole + 0.001,
            "{parts:?}: {in_parts} s of {whole} s"
        );
    }
}
