//! Whatever can be set and programmed: no panic, no hang, no axis faster than allowed.
#![cfg(not(target_os = "none"))]

mod support;

use heapless::spsc::Queue;
use leadscrew::{
    axis::{AXES, Axes},
    planner::{Circle, Command, Entry, Pace, Plane, Rotation, Router, Target, Work},
    protocol::realtime::{self, Requests},
    settings::Settings,
    sim::Drive,
    stepper::EVENT_RING,
    units::{Nm, StepsPerMm, TICKS_PER_SECOND},
};
use proptest::prelude::*;
use support::{RESET, cases};

/// Numbers of all magnitudes between two ends.
fn wide(least: f64, most: f64) -> impl Strategy<Value = f64> {
    let ends = prop_oneof![1 => Just(least), 1 => Just(most), 6 => Just(0.0)];
    (ends, least.ln()..most.ln()).prop_map(|(end, ln)| if end == 0.0 { ln.exp() } else { end })
}

fn per_axis(least: f64, most: f64) -> impl Strategy<Value = [f64; 6]> {
    prop_oneof![
        prop::array::uniform6(wide(least, most)),
        wide(least, most).prop_map(|value| [value; 6]),
    ]
}

fn settings() -> impl Strategy<Value = Settings> {
    let number = prop_oneof![Just(0.0_f32), wide(0.001, 1.0e7).prop_map(|n| n as f32)];
    (
        per_axis(0.001, 100_000.0),
        per_axis(0.001, 1.0e7),
        per_axis(0.001, 1.0e7),
        number,
        0..=255_u8,
    )
        .prop_map(|(steps, rates, accelerations, deviation, pulse)| Settings {
            step_pulse_us: pulse,
            junction_deviation_mm: deviation,
            steps_per_mm: Axes::from_fn(|axis| {
                StepsPerMm::from_millionths((steps[axis] * 1.0e6) as u64).unwrap()
            }),
            max_rate_mm_min: Axes::from_fn(|axis| rates[axis] as f32),
            acceleration_mm_s2: Axes::from_fn(|axis| accelerations[axis] as f32),
            ..Settings::default()
        })
}

#[derive(Debug, Clone)]
struct Move {
    /// Parts of the way to the farthest point, as powers of ten, and signs; 0 stays.
    to: [f64; 6],
    pace: Pace,
    /// Plane, rotation, centre, turns.
    arc: Option<(Plane, Rotation, [f64; 2], u16)>,
}

fn share() -> impl Strategy<Value = f64> {
    prop_oneof![
        2 => Just(0.0),
        1 => Just(1.0),
        1 => Just(-1.0),
        4 => (-17.0..0.0_f64).prop_map(|ten| 10.0_f64.powf(ten)),
        4 => (-17.0..0.0_f64).prop_map(|ten| -(10.0_f64.powf(ten))),
    ]
}

fn moves() -> impl Strategy<Value = Vec<Move>> {
    let pace = prop_oneof![
        Just(Pace::Rapid),
        prop_oneof![
            Just(0.0),
            Just(f32::MAX),
            (-6.0..9.0_f32).prop_map(|ten| 10.0_f32.powf(ten))
        ]
        .prop_map(Pace::Feed),
        prop_oneof![
            Just(0.0),
            Just(f32::MAX),
            (-6.0..9.0_f32).prop_map(|ten| 10.0_f32.powf(ten))
        ]
        .prop_map(Pace::InverseTime),
    ];
    let plane = prop_oneof![Just(Plane::Xy), Just(Plane::Zx), Just(Plane::Yz)];
    let rotation = prop_oneof![Just(Rotation::Clockwise), Just(Rotation::CounterClockwise)];
    let turns = prop_oneof![4 => Just(1_u16), 1 => Just(u16::MAX), 2 => 1..1000_u16];
    let arc = (plane, rotation, [share(), share()], turns);
    let one = (prop::array::uniform6(share()), pace, prop::option::of(arc))
        .prop_map(|(to, pace, arc)| Move { to, pace, arc });
    prop::collection::vec(one, 1..8)
}

/// The commands that the interpreter lets through.
fn commands(settings: &Settings, moves: &[Move]) -> Vec<Command> {
    let farthest = settings.farthest();
    let mut at = Axes::all(Nm(0));
    let mut commands = Vec::new();
    for one in moves {
        let position = Axes::from_fn(|axis| Nm((farthest[axis].0 as f64 * one.to[axis]) as i64));
        let target: Target = position.into();
        let (pace, line) = (one.pace, 0);
        let mut command = Command::Line { target, pace, line };
        if let Some((plane, rotation, shares, turns)) = one.arc {
            let (first, second, _) = plane.axes();
            let reach = farthest[first].0.min(farthest[second].0) as f64 * 2.0;
            let centre = shares.map(|share| Nm((share * reach) as i64));
            let mut to = position;
            // A circle, so that both ends are equally far from the centre.
            to[first] = at[first];
            to[second] = at[second];
            let radius = centre[0].to_mm_f64().hypot(centre[1].to_mm_f64());
            let length = radius * 6.29 * f64::from(turns);
            let finest = settings.steps_per_mm[first]
                .to_f32()
                .max(settings.steps_per_mm[second].to_f32());
            // Positions on the path have 31 binary places: quarters of a step.
            if centre != [Nm(0); 2] && length * f64::from(finest) < 536_870_912.0 {
                command = Command::Arc {
                    target: to.into(),
                    circle: Circle {
                        plane,
                        centre,
                        rotation,
                        turns,
                    },
                    pace,
                    line,
                };
                at = to;
                commands.push(command);
                continue;
            }
        }
        at = position;
        commands.push(command);
    }
    commands
}

/// Plays commands for so many step events, then resets; the machine must come to rest.
fn play(settings: &Settings, commands: &[Command], most_events: u32) {
    let mut drive = Drive::new(settings);
    let mut router = Router::new(settings);
    let requests = Requests::new();
    let mut commands = commands.iter();
    let mut waiting: Option<Work> = None;
    let (mut now, mut events, mut sent) = (0, 0_u32, 0_u32);
    let mut steps = Axes::all(0_i32);
    let mut times: Axes<[u64; 8]> = Axes::all([0; 8]);
    let mut number = [0_usize; 6];
    let (mut longest_s, mut reset_feed) = (0.01, f32::MAX);
    loop {
        while waiting.is_some() || commands.len() > 0 {
            waiting = waiting.or_else(|| commands.next().and_then(|command| router.work(command)));
            let Some(work) = waiting else { continue };
            if let Work::Move(block) = &work {
                assert!(
                    block.length_mm > 0.0 && block.length_mm.is_finite(),
                    "{block:?}"
                );
                assert!(
                    block.speed_mm_s > 0.0 && block.speed_mm_s.is_finite(),
                    "{block:?}"
                );
                assert!(block.acceleration_mm_s2 > 0.0, "{block:?}");
                assert!(block.junction_sqr >= 0.0, "{block:?}");
            }
            if drive.entries.enqueue(Entry { epoch: 0, work }).is_err() {
                break;
            }
            if let Work::Move(block) = &work {
                let [length, speed] = [block.length_mm, block.speed_mm_s].map(f64::from);
                // Cruise and two ramps; on an arc, part of the acceleration goes to the centre.
                let ramps = speed / f64::from(block.acceleration_mm_s2);
                let share = if block.curve.is_some() { 2.0 } else { 1.0 };
                longest_s += length / speed + ramps * share;
            }
            sent += 1;
            waiting = None;
            drive.release_prepare();
        }
        while drive.prepare(&requests, now) {}
        let snapshot = *drive.snapshot();
        if snapshot.is_at_rest && drive.entries.is_empty() {
            break;
        }
        let edge = drive
            .step()
            .unwrap_or_else(|| panic!("stuck: {snapshot:?}"));
        assert!(
            edge.ticks - now <= 4 * u64::from(TICKS_PER_SECOND) / 1000,
            "a long wait"
        );
        now = edge.ticks;
        drive.release_prepare();
        events += 1;
        if events == most_events {
            // As from now on, only a stop.
            commands = [].iter();
            waiting = None;
            let mut line = Queue::<u8, 4>::new();
            let _ = realtime::receive(RESET, &requests, &mut line.split().0);
        }
        // What is queued is played first.
        if events > most_events + EVENT_RING as u32 {
            let feed = drive.snapshot().feed_mm_min;
            assert!(feed <= reset_feed, "{feed} after {reset_feed}");
            reset_feed = feed;
            if events > most_events + 20_000 {
                // From a great speed at a small acceleration it takes days to stop.
                return;
            }
        } else if events <= most_events {
            let seconds = now as f64 / f64::from(TICKS_PER_SECOND);
            assert!(seconds < 1.1 * longest_s, "{:?}", drive.snapshot());
        }
        for axis in 0..AXES {
            if edge.raise >> axis & 1 == 0 {
                continue;
            }
            steps[axis] += if edge.directions >> axis & 1 == 0 {
                1
            } else {
                -1
            };
            let times = &mut times[axis];
            let place = &mut number[axis];
            let before = times[*place % 8];
            times[*place % 8] = now;
            *place += 1;
            if *place > 8 {
                let seconds = (now - before) as f64 / f64::from(TICKS_PER_SECOND);
                let rate = f64::from(settings.max_rate_mm_min[axis]) / 60.0
                    * f64::from(settings.steps_per_mm[axis].to_f32());
                let least = 6.0 / rate;
                assert!(
                    seconds + 12.0e-6 > least * 0.9,
                    "axis {axis}: 8 steps in {seconds} s instead of {least} s"
                );
            }
        }
    }
    assert_eq!(drive.snapshot().finished, sent);
    assert_eq!(drive.snapshot().steps, steps);
    assert_eq!(drive.counts.late(), 0);
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn nothing_that_can_be_set_or_programmed_panics_hangs_or_runs_away(
        settings in settings(),
        moves in moves(),
        events in 1..3000_u32,
    ) {
        play(&settings, &commands(&settings, &moves), events);
    }
}
