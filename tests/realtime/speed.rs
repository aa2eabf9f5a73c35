//! Delay and extent of a change of speed by overrides and holds.

use leadscrew::{
    model::{FeedRate, Overrides},
    path::Work,
};

use crate::{
    DOOR, MS, jog, moving, send,
    support::{RESET, Rig, TICKS_PER_S, at, each, fast, line, line_at, with},
};

/// Time from a byte in cruise to the first step that is off the pace before it, ms.
fn latency(byte: u8, before: &[u8], at: u64) -> f64 {
    let settings = with(&[320.0], &[12_000.0], &[500.0]);
    let mut rig = moving(&settings, &line(&[200.0], 6000.0));
    for byte in before {
        rig.receive(*byte);
    }
    rig.run_to(at);
    let cruising = rig.trace.steps(0);
    rig.receive(byte);
    rig.run_to(at + 30 * MS);
    let steps = rig.trace.steps(0);
    let last = cruising.len() - 1;
    let period = (steps[last].seconds - steps[last - 400].seconds) / 400.0;
    let off = steps[last..].iter().enumerate().find(|(k, step)| {
        let expected = steps[last].seconds + *k as f64 * period;
        (step.seconds - expected).abs() > 5.0 / TICKS_PER_S
    });
    let (_, off) = off.expect("the speed changes");
    (off.seconds - at as f64 / TICKS_PER_S) * 1000.0
}

#[test]
fn a_hold_or_an_override_changes_the_speed_within_5_ms() {
    let mut worst = 0.0_f64;
    for (byte, before) in [
        (b'!', &[][..]),
        (DOOR, &[]),
        (RESET, &[]),
        (0x92, &[]),
        (0x94, &[]),
        (0x91, &[]),
        (0x93, &[]),
        (0x90, &[0x92, 0x92, 0x92]),
    ] {
        for k in (0..23).step_by(each(4)) {
            let ms = latency(byte, before, 600 * MS + k * 7919);
            assert!((0.0..=5.0).contains(&ms), "{byte:#x}: {ms} ms");
            worst = worst.max(ms);
        }
    }
    println!("slowest: {worst:.3} ms");
}

#[test]
fn a_rapid_override_changes_rapids_and_no_feed() {
    for (feed_rate, reached) in [
        (FeedRate::Rapid, 1250.0),
        (FeedRate::Feed(5000.0), 5000.0),
        (FeedRate::Jog(5000.0), 5000.0),
    ] {
        let mut rig = moving(&fast(), &line_at(at(&[100.0]), feed_rate));
        rig.receive(0x97);
        rig.run_to(300 * MS);
        let feed = rig.snapshot().feed_mm_min;
        assert!((feed - reached).abs() < 1.0, "{feed}");
    }
}

#[test]
fn a_feed_override_acts_within_the_limit_of_the_axes() {
    for (bytes, programmed, reached) in [
        (&[0x91; 10][..], 1000.0, 2000.0),
        (&[0x91; 10], 4000.0, 5000.0),
        (&[0x92; 9], 1000.0, 100.0),
        (&[0x92; 9], 1.0, 1.0),
        (&[0x91, 0x93, 0x93, 0x94], 1000.0, 1110.0),
    ] {
        let mut rig = moving(&fast(), &line(&[100.0], programmed));
        rig.run_to(200 * MS);
        for byte in bytes {
            rig.receive(*byte);
        }
        rig.run_to(700 * MS);
        let feed = rig.snapshot().feed_mm_min;
        assert!((feed - reached).abs() < 0.01 * reached, "{feed} {reached}");
    }
}

#[test]
fn a_feed_override_acts_on_lines_as_short_as_a_segment() {
    let settings = fast();
    let lines: Vec<_> = { 1..=600 }
        .map(|tenth| line(&[0.1 * f64::from(tenth)], 4000.0))
        .collect();
    let mut rig = Rig::new(&settings);
    rig.run(&lines, &[0x92; 9].map(|byte| (300 * MS, byte)));
    let steps = rig.trace.steps(0);
    // 4000 mm/min at 80 steps/mm; and a tenth of that, 0.2 s behind the override.
    for (second, expected_hz) in [(0.28, 5333.0), (0.5, 533.3), (2.0, 533.3)] {
        let first = steps.partition_point(|step| step.seconds < second);
        let hz = 50.0 / (steps[first + 50].seconds - steps[first].seconds);
        assert!(
            (hz / expected_hz - 1.0).abs() < 0.03,
            "{hz} Hz at {second} s"
        );
    }
}

#[test]
fn a_jog_has_no_feed_override() {
    let mut rig = moving(&fast(), &jog(&[100.0], 1000.0));
    rig.receive(0x91);
    rig.run_to(200 * MS);
    assert_eq!(rig.snapshot().feed_mm_min.round(), 1000.0);
}

#[test]
fn the_end_of_a_program_and_a_reset_end_overrides() {
    let mut rig = Rig::new(&fast());
    for byte in [0x91, 0x97, 0x9a] {
        rig.receive(byte);
    }
    let overrides = rig.snapshot().overrides;
    assert_eq!(
        (overrides.feed, overrides.rapid, overrides.spindle),
        (110, 25, 110)
    );
    send(&mut rig, Work::EndOverrides);
    assert_eq!(rig.snapshot().overrides, Overrides::NONE);
    rig.receive(0x91);
    rig.receive(RESET);
    assert_eq!(rig.snapshot().overrides.feed, 100);
}
