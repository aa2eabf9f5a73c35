//! Whatever can be set and programmed: no panic, no hang, no axis faster than allowed.

use crate::support::{RESET, cases, receive};
use leadscrew::{
    axis::{AXES, Axes},
    model::{Circle, Command, FeedRate, Plane, Requests, Rotation, Target, queues::EVENT_RING},
    path::{Block, Entry, Router, Work},
    settings::Settings,
    sim::Drive,
    units::{Nm, StepsPerMm, TICKS_PER_MS, TICKS_PER_SECOND},
};
use proptest::prelude::*;

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
    feed_rate: FeedRate,
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
    let feed_rate = prop_oneof![
        Just(FeedRate::Rapid),
        prop_oneof![
            Just(0.0),
            Just(f32::MAX),
            (-6.0..9.0_f32).prop_map(|ten| 10.0_f32.powf(ten))
        ]
        .prop_map(FeedRate::Feed),
        prop_oneof![
            Just(0.0),
            Just(f32::MAX),
            (-6.0..9.0_f32).prop_map(|ten| 10.0_f32.powf(ten))
        ]
        .prop_map(FeedRate::InverseTime),
    ];
    let plane = prop_oneof![Just(Plane::Xy), Just(Plane::Zx), Just(Plane::Yz)];
    let rotation = prop_oneof![Just(Rotation::Clockwise), Just(Rotation::CounterClockwise)];
    let turns = prop_oneof![4 => Just(1_u16), 1 => Just(u16::MAX), 2 => 1..1000_u16];
    let arc = (plane, rotation, [share(), share()], turns);
    let one = (
        prop::array::uniform6(share()),
        feed_rate,
        prop::option::of(arc),
    )
        .prop_map(|(to, feed_rate, arc)| Move { to, feed_rate, arc });
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
        let (feed_rate, line) = (one.feed_rate, 0);
        let mut command = Command::Line {
            target,
            feed_rate,
            line,
        };
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
                        tilt: leadscrew::units::MicroDegrees::ZERO,
                    },
                    feed_rate,
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

/// The drive while it plays commands.
struct Play<'a> {
    settings: &'a Settings,
    drive: Drive,
    router: Router,
    requests: Requests,
    waiting: Option<Work>,
    now: u64,
    sent: u32,
    steps: Axes<i32>,
    /// Time of each axis' last steps, and their number.
    times: Axes<([u64; 8], usize)>,
    /// Longest duration of the commands sent.
    longest_s: f64,
}

impl<'a> Play<'a> {
    fn new(settings: &'a Settings) -> Self {
        Self {
            settings,
            drive: Drive::new(settings),
            router: Router::new(settings),
            requests: Requests::new(),
            waiting: None,
            now: 0,
            sent: 0,
            steps: Axes::all(0),
            times: Axes::all(([0; 8], 0)),
            longest_s: 0.01,
        }
    }

    /// Sends commands as long as there is room.
    fn send(&mut self, commands: &mut core::slice::Iter<'_, Command>) {
        while self.waiting.is_some() || commands.len() > 0 {
            let router = &mut self.router;
            let next = || commands.next().and_then(|command| router.route(command));
            self.waiting = self.waiting.or_else(next);
            let Some(work) = self.waiting else { continue };
            let entry = Entry {
                cancellation_count: 0,
                work,
            };
            if !self.drive.enqueue(entry) {
                break;
            }
            if let Work::Move(block) = &work {
                self.check_block(block);
            }
            self.sent += 1;
            self.waiting = None;
        }
    }

    fn check_block(&mut self, block: &Block) {
        let [length, speed] = [block.length_mm, block.nominal_mm_s].map(f64::from);
        assert!(length > 0.0 && length.is_finite(), "{block:?}");
        assert!(speed > 0.0 && speed.is_finite(), "{block:?}");
        assert!(block.acceleration_mm_s2 > 0.0, "{block:?}");
        assert!(block.junction_sqr >= 0.0, "{block:?}");
        // Cruise and two ramps; on an arc, part of the acceleration goes to the centre.
        let ramps = speed / f64::from(block.acceleration_mm_s2);
        let share = if block.curve.is_some() { 2.0 } else { 1.0 };
        // Time that `prepare` needs for the sections between the places where an axis of an arc reverses.
        let quarters = block.curve.map(|it| it.sweep.unsigned_abs() >> 30);
        let pieces_s = quarters.map_or(0.0, |quarters| 5.0e-3 + 1.2e-3 * quarters as f64);
        self.longest_s += length / speed + ramps * share + pieces_s;
    }

    /// Runs `prepare` and plays one event; false at rest with everything done.
    fn step(&mut self) -> bool {
        while self.drive.prepare(&self.requests, self.now) {}
        let snapshot = self.drive.snapshot();
        if snapshot.is_at_rest && self.drive.has_no_entry() {
            assert_eq!(snapshot.finished, self.sent);
            assert_eq!(snapshot.steps, self.steps);
            assert_eq!(self.drive.late(), 0);
            return false;
        }
        let edge = self.drive.step();
        let edge = edge.unwrap_or_else(|| panic!("stuck: {snapshot:?}"));
        assert!(edge.ticks - self.now <= 4 * u64::from(TICKS_PER_MS));
        self.now = edge.ticks;
        for axis in 0..AXES {
            if edge.raise >> axis & 1 != 0 {
                self.count(axis, edge.directions >> axis & 1 == 0);
            }
        }
        true
    }

    /// A step: eight must take their time.
    fn count(&mut self, axis: usize, is_forward: bool) {
        self.steps[axis] += if is_forward { 1 } else { -1 };
        let (times, number) = &mut self.times[axis];
        let before = core::mem::replace(&mut times[*number % 8], self.now);
        *number += 1;
        let per_mm = f64::from(self.settings.steps_per_mm[axis].to_f32());
        let rate = f64::from(self.settings.max_rate_mm_min[axis]) / 60.0 * per_mm;
        let least = 0.9 * 6.0 / rate - 12.0e-6;
        let seconds = (self.now - before) as f64 / f64::from(TICKS_PER_SECOND);
        assert!(
            *number <= 8 || seconds > least,
            "axis {axis}: 8 steps in {seconds} s, not {least} s"
        );
    }

    fn reset(&mut self) {
        self.waiting = None;
        receive(&mut self.drive, &self.requests, RESET);
    }
}

/// Plays commands for so many step events, then resets; the machine must come to rest.
fn play(settings: &Settings, commands: &[Command], most_events: u32) {
    let mut play = Play::new(settings);
    let mut commands = commands.iter();
    for _ in 0..most_events {
        play.send(&mut commands);
        if !play.step() {
            return;
        }
        let seconds = play.now as f64 / f64::from(TICKS_PER_SECOND);
        assert!(
            seconds < 1.1 * play.longest_s,
            "{:?}",
            play.drive.snapshot()
        );
    }
    play.reset();
    let mut feed = f32::MAX;
    // From a great speed at a small acceleration it may take days to stop.
    for number in 0..20_000 {
        if !play.step() {
            return;
        }
        // The queued segments are played first.
        let slower = play.drive.snapshot().feed_mm_min;
        if number > EVENT_RING {
            // To the rounding of single precision.
            assert!(
                slower <= feed * (1.0 + f32::EPSILON),
                "{slower} after {feed}"
            );
            feed = slower.min(feed);
        }
    }
}

#[test]
fn a_tiny_arc_after_a_move_without_a_step_keeps_the_rates() {
    let mut steps = Axes::all(1_000_000);
    steps[2] = 100_000_000_000;
    let settings = Settings {
        steps_per_mm: steps.map(|millionths| StepsPerMm::from_millionths(millionths).unwrap()),
        max_rate_mm_min: Axes::all(1.0),
        acceleration_mm_s2: Axes::all(1.0e7),
        ..Settings::default()
    };
    let mut target = Axes::all(Nm(0));
    target[0] = Nm(-320_000);
    let (target, feed_rate, line) = (Target::from(target), FeedRate::Rapid, 0);
    let circle = Circle {
        plane: Plane::Zx,
        centre: [Nm(3049), Nm(0)],
        rotation: Rotation::Clockwise,
        turns: u16::MAX,
        tilt: leadscrew::units::MicroDegrees::ZERO,
    };
    let commands = [
        Command::Line {
            target,
            feed_rate,
            line,
        },
        Command::Arc {
            target,
            circle,
            feed_rate,
            line,
        },
    ];
    play(&settings, &commands, 3000);
}

#[test]
fn a_stop_in_front_of_a_corner_to_be_stopped_in_does_not_go_round_it() {
    let by = |values: [f32; 2]| Axes::from_fn(|axis| values[axis.min(1)]);
    let steps = |axis| [1_000_000_000, 1_000_000][usize::min(axis, 1)];
    // The rounded remainder of 100 mm/s is large for an axis that is so slow.
    let settings = Settings {
        junction_deviation_mm: 0.0,
        steps_per_mm: Axes::from_fn(|axis| StepsPerMm::from_millionths(steps(axis)).unwrap()),
        max_rate_mm_min: by([0.001, 6000.0]),
        acceleration_mm_s2: by([0.01, 100.0]),
        ..Settings::default()
    };
    let commands = [[0, 100_000_000], [1_000_000, 100_000_000]].map(|to| Command::Line {
        target: Axes::from_fn(|axis| Nm(to.get(axis).copied().unwrap_or(0))).into(),
        feed_rate: FeedRate::Rapid,
        line: 0,
    });
    for events in (10..3000).step_by(10) {
        play(&settings, &commands, events);
    }
}

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn nothing_that_can_be_set_or_programmed_panics_hangs_or_diverges(
        settings in settings(),
        moves in moves(),
        events in 1..3000_u32,
    ) {
        play(&settings, &commands(&settings, &moves), events);
    }
}
