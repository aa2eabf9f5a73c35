//! Laws that no order of events may break.

use leadscrew::{
    axis::Axes,
    model::{Command, FeedRate},
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

use crate::{
    CANCEL, DOOR, MS,
    support::{
        Act, RESET, Rig, Trace, cases, check_limits, check_path, line_at, number, target,
        target_steps, with,
    },
};

fn commands(jogs: bool) -> impl Strategy<Value = Vec<Command>> {
    let coordinate = prop_oneof![
        4 => -3_000_000..3_000_000_i64,
        2 => -30_000..30_000_i64,
        1 => Just(0_i64),
    ];
    let feed_rate = (0..4_u8, 20.0..12_000.0_f32).prop_map(move |(kind, mm_min)| match kind {
        _ if jogs => FeedRate::Jog(mm_min),
        0 => FeedRate::Rapid,
        _ => FeedRate::Feed(mm_min),
    });
    let line = (prop::array::uniform3(coordinate), feed_rate).prop_map(|(nm, feed_rate)| {
        line_at(
            Axes::from_fn(|axis| nm.get(axis).map_or(Nm(0), |nm| Nm(*nm))),
            feed_rate,
        )
    });
    prop::collection::vec(line, 1..16)
}

/// Times in ms and bytes, in order of time.
fn acts(bytes: &'static [u8]) -> impl Strategy<Value = Vec<Act>> {
    let byte = prop::sample::select(bytes);
    prop::collection::vec((0..700_u64, byte), 0..16).prop_map(|mut acts| {
        acts.sort_unstable();
        acts.into_iter()
            .map(|(ms, byte)| (ms * MS + 7919 * ms, byte))
            .collect()
    })
}

fn settings() -> impl Strategy<Value = Settings> {
    let steps = prop::sample::select(vec![10.0, 78.74, 80.0, 250.0, 320.0, 1000.0 / 3.0]);
    (
        prop::array::uniform3(steps),
        prop::array::uniform3(60.0..12_000.0_f32),
        prop::array::uniform3(5.0..5000.0_f32),
    )
        .prop_map(|(steps, rates, accelerations)| with(&steps, &rates, &accelerations))
}

fn play(settings: &Settings, commands: &[Command], acts: &[Act], feed_ticks: u64) -> Trace {
    let commands = number(commands);
    let mut rig = Rig::new(settings);
    rig.feed_ticks = feed_ticks;
    rig.run(&commands, acts);
    rig.trace.check_pulses();
    check_limits(settings, &rig.trace);
    rig.trace
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn overrides_and_holds_keep_every_limit_and_the_path(
        settings in settings(),
        commands in commands(false),
        acts in acts(&[0x90, 0x91, 0x92, 0x91, 0x92, 0x95, 0x96, 0x97, b'!', b'~', DOOR]),
        feed_ticks in prop::sample::select(vec![0, 3_000_000_u64]),
    ) {
        let trace = play(&settings, &commands, &acts, feed_ticks);
        check_path(&settings, &number(&commands), &trace, 1.0);
        let end = commands.last().and_then(target).unwrap();
        prop_assert_eq!(trace.net_steps(), target_steps(&settings, &end));
    }

    #[test]
    fn no_stop_of_any_kind_loses_or_doubles_a_step(
        settings in settings(),
        commands in commands(false),
        acts in acts(&[RESET, b'!', b'~', DOOR, CANCEL, 0x92, 0x91, 0x97]),
        feed_ticks in prop::sample::select(vec![0, 3_000_000_u64]),
        parking in any::<bool>(),
    ) {
        let settings = Settings {
            parking,
            homing: u8::from(parking),
            parking_pull_out_mm: 0.1,
            parking_target_mm: 1.0,
            ..settings
        };
        play(&settings, &commands, &acts, feed_ticks);
    }

    #[test]
    fn no_end_of_a_jog_loses_or_doubles_a_step(
        settings in settings(),
        commands in commands(true),
        acts in acts(&[RESET, b'!', b'~', DOOR, CANCEL, CANCEL, 0x92]),
        feed_ticks in prop::sample::select(vec![0, 3_000_000_u64]),
    ) {
        play(&settings, &commands, &acts, feed_ticks);
    }
}
