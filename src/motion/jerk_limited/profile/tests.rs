//! Speed, acceleration and jerk along the path, as the segments have them.

mod feasible;
mod programs;

use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::{
    axis::AXES,
    model::{Command, FeedRate, Overrides, timing::SAMPLE_S},
    motion::{LookAhead, jerk_limited::MovingAverage},
    path::{Block, RampTime, Router, Work},
    settings::Settings,
    units::{Nm, TICKS_PER_SECOND},
};

/// What happens before a segment.
#[derive(Debug, Clone, Copy)]
enum Act {
    Hold,
    Resume,
    Feed(u8),
}

/// The end of a segment: when, how fast, in which block, and how far along the path.
#[derive(Debug, Clone, Copy)]
struct PlayedSample {
    seconds: f64,
    speed: f64,
    block: usize,
}

/// Segment after segment, and what they did.
struct Run {
    plan: LookAhead,
    smooth: MovingAverage,
    executor: Executor,
    position: Axes<FineSteps>,
    goal: Goal,
    seconds: f64,
    blocks: Vec<Block>,
    pushed: usize,
    done: usize,
    samples: Vec<PlayedSample>,
    /// Speed at the end of each block.
    corners: Vec<f64>,
}

impl Run {
    fn new(settings: &Settings, blocks: &[Block]) -> Self {
        let ramp_time = RampTime::new(settings);
        let mut run = Self {
            plan: LookAhead::new(),
            smooth: MovingAverage::new(),
            executor: Executor::new(),
            position: Axes([FineSteps(0); AXES]),
            goal: Goal::Run,
            seconds: 0.0,
            blocks: blocks.to_vec(),
            pushed: 0,
            done: 0,
            samples: Vec::new(),
            corners: Vec::new(),
        };
        run.smooth.configure(ramp_time.is_jerk_limited());
        run.plan.set_ramp_time(ramp_time);
        run.sample(0.0, 0.0);
        run
    }

    fn sample(&mut self, after_s: f64, speed: f64) {
        self.seconds += after_s;
        self.samples.push(PlayedSample {
            seconds: self.seconds,
            speed,
            block: self.done,
        });
    }

    fn finish_plan(&mut self) {
        while self.plan.is_unfinished() {
            self.plan.continue_pass();
        }
    }

    fn push(&mut self) {
        self.plan.push(&self.blocks[self.pushed]);
        self.pushed += 1;
        self.finish_plan();
    }

    fn act(&mut self, act: Act) {
        match act {
            Act::Hold => self.goal = Goal::Stop,
            Act::Resume => self.goal = Goal::Run,
            Act::Feed(feed) => {
                let overrides = Overrides {
                    feed,
                    ..Overrides::NONE
                };
                self.plan.replan(overrides, self.executor.replanned());
                self.finish_plan();
            }
        }
    }

    /// The next segment; false at rest.
    fn segment(&mut self) -> bool {
        let (plan, smooth) = (&mut self.plan, &mut self.smooth);
        while smooth.needs_sample() && !plan.is_empty() {
            let leaving = smooth.leaving_sample();
            let sample = plan.next_sample(self.goal == Goal::Stop, leaving);
            smooth.push(sample, leaving);
        }
        let mut segment = Segment::NONE;
        let position = self.position;
        let next = plan.next_segment(
            &mut self.executor,
            smooth,
            &position,
            self.goal,
            &mut segment,
        );
        if next == NextSegment::Standstill {
            assert!(!self.executor.is_moving());
            self.sample(1.0e-3, 0.0);
            return false;
        }
        self.position = segment.axes.map(|axis| axis.to);
        let speed = f64::from(segment.feed_mm_min) / 60.0;
        self.sample(
            f64::from(segment.ticks) / f64::from(TICKS_PER_SECOND),
            speed,
        );
        if next == NextSegment::EndsBlock {
            self.corners.push(speed);
            self.done += 1;
        }
        true
    }
}

/// Plays blocks of which one comes every so many segments, with acts at numbers of segments.
fn play(settings: &Settings, blocks: &[Block], every: usize, acts: &[(usize, Act)]) -> Run {
    let mut run = Run::new(settings, blocks);
    let last = acts.iter().map(|act| act.0).max().unwrap_or(0);
    for number in 0..1_000_000 {
        let has_come = |pushed: usize| pushed < blocks.len() && number >= pushed * every;
        while has_come(run.pushed) && run.plan.free() > 0 {
            run.push();
        }
        for (_, act) in acts.iter().filter(|act| act.0 == number) {
            run.act(*act);
        }
        let is_resting = !run.segment();
        if is_resting && run.pushed == blocks.len() && run.plan.is_empty() {
            break;
        }
        if is_resting && number >= last {
            run.goal = Goal::Run;
        }
    }
    assert_eq!(run.done, blocks.len(), "stalled");
    run
}

/// The greatest value along a block that every axis allows.
fn along(settings: &Settings, block: &Block, limits: &Axes<f32>) -> f64 {
    let mut least = f64::MAX;
    for axis in 0..AXES {
        let steps_per_mm = f64::from(settings.steps_per_mm[axis].to_f32());
        let share = f64::from(block.steps_per_mm[axis].abs()) / steps_per_mm;
        if share > 1.0e-9 && limits[axis] > 0.0 {
            least = least.min(f64::from(limits[axis]) / share);
        }
    }
    least
}

/// Peaks as parts of the limits.
#[derive(Debug, Default)]
struct Peaks {
    speed: f64,
    acceleration: f64,
    jerk: f64,
    /// Of speeds at the ends of blocks.
    corner: f64,
}

/// Slower than that, a jerk is of a few nanometres in a millisecond, mm/s.
const CREEP: f64 = 0.05;

fn peaks(settings: &Settings, run: &Run) -> Peaks {
    let mut peaks = Peaks::default();
    let last = run.blocks.len() - 1;
    for three in run.samples.windows(3) {
        let blocks = &run.blocks[three[0].block.min(last)..=three[2].block.min(last)];
        let most = |limit: &dyn Fn(&Block) -> f64| blocks.iter().map(limit).fold(0.0, f64::max);
        let times = [0, 1].map(|k| three[k + 1].seconds - three[k].seconds);
        let gains = [0, 1].map(|k| (three[k + 1].speed - three[k].speed) / times[k]);
        let speed = three[1].speed;
        // What single precision makes of speeds, and whole nanometres of the window.
        let rounding = times.map(|time| (4.0e-7 * speed + 3.0e-4) / time);
        // It changes from one millisecond to the next.
        let time = (0.5 * (times[0] + times[1])).max(1.0e-3);
        let jerk = ((gains[1] - gains[0]).abs() - rounding[0] - rounding[1]) / time;
        let limit = most(&|block| along(settings, block, &settings.jerk_mm_s3));
        if speed > CREEP {
            peaks.jerk = peaks.jerk.max(jerk / limit);
        }
        let limit = most(&|block| along(settings, block, &settings.acceleration_mm_s2));
        let part = (gains[0].abs() - rounding[0]) / limit;
        peaks.acceleration = peaks.acceleration.max(part);
        let limit = most(&|block| f64::from(block.limit_mm_s));
        peaks.speed = peaks.speed.max(speed / limit);
    }
    for (speed, next) in run.corners.iter().zip(&run.blocks[1..]) {
        let limit = f64::from(math::sqrt(next.junction_sqr));
        peaks.corner = peaks.corner.max((speed - CREEP) / limit.max(0.2));
    }
    peaks
}

fn blocks(settings: &Settings, displacements: &[([f64; 3], f32)]) -> Vec<Block> {
    let mut router = Router::new(settings);
    let mut at = [0.0; 3];
    let mut blocks = Vec::new();
    for (displacement, feed) in displacements {
        at = [0, 1, 2].map(|n| at[n] + displacement[n]);
        let position = Axes::from_fn(|axis| at.get(axis).map_or(Nm(0), |mm| Nm::from_mm_f64(*mm)));
        let command = Command::Line {
            target: position.into(),
            feed_rate: if *feed < 0.0 {
                FeedRate::Rapid
            } else {
                FeedRate::Feed(*feed)
            },
            line: 0,
        };
        if let Some(Work::Move(block)) = router.route(&command) {
            blocks.push(block);
        }
    }
    blocks
}

fn machines() -> impl Strategy<Value = Settings> {
    (
        prop::array::uniform3(2000.0..9000.0_f32),
        prop::array::uniform3(100.0..800.0_f32),
        // Some need the shortest window.
        prop_oneof![
            3 => prop::array::uniform3(0.003..0.13_f32),
            1 => prop::array::uniform3(0.0003..0.002_f32),
        ],
        0.001..0.1_f32,
    )
        .prop_map(|(rates, accelerations, seconds, junction_deviation_mm)| {
            let by = |values: [f32; 3]| Axes::from_fn(|axis| values[axis.min(2)]);
            let jerks = [0, 1, 2].map(|n| accelerations[n] / seconds[n]);
            Settings {
                max_rate_mm_min: by(rates),
                acceleration_mm_s2: by(accelerations),
                jerk_mm_s3: by(jerks),
                junction_deviation_mm,
                ..Settings::default()
            }
        })
}

/// Ways that wander: now straight on, now around corners, short and long.
fn displacements() -> impl Strategy<Value = Vec<([f64; 3], f32)>> {
    let displacement = (
        prop::array::uniform3(-1.0..1.0_f64),
        0.0..1.0_f64,
        prop_oneof![2 => 0.05..1.0_f64, 1 => 1.0..30.0_f64],
        prop_oneof![1 => Just(-1.0_f32), 4 => 200.0..6000.0_f32, 4 => Just(3000.0_f32)],
    );
    prop::collection::vec(displacement, 2..60).prop_map(|displacements| {
        let mut direction = [1.0, 0.3, -0.2];
        displacements
            .into_iter()
            .map(|(turn, sharp, length, feed)| {
                let sharp = if sharp < 0.8 { 0.2 * sharp } else { 3.0 };
                direction = [0, 1, 2].map(|n| direction[n] + sharp * turn[n]);
                let norm = direction
                    .iter()
                    .map(|x| x * x)
                    .sum::<f64>()
                    .sqrt()
                    .max(1.0e-6);
                direction = direction.map(|x| x / norm);
                (direction.map(|x| x * length), feed)
            })
            .collect()
    })
}

fn acts() -> impl Strategy<Value = Vec<(usize, Act)>> {
    let act = prop_oneof![
        2 => Just(Act::Hold),
        3 => Just(Act::Resume),
        1 => (10..200_u8).prop_map(Act::Feed),
    ];
    prop::collection::vec((1..1500_usize, act), 0..12)
}

fn check(peaks: &Peaks) -> Result<(), TestCaseError> {
    prop_assert!(peaks.speed <= 1.005, "{peaks:?}");
    prop_assert!(peaks.acceleration <= 1.02, "{peaks:?}");
    prop_assert!(peaks.jerk <= 1.05, "{peaks:?}");
    prop_assert!(peaks.corner <= 1.02, "{peaks:?}");
    Ok(())
}

/// Equal axes with an acceleration that takes so long to be there.
fn machine(acceleration: f32, ramp_s: f32) -> Settings {
    Settings {
        max_rate_mm_min: Axes::all(10_000.0),
        acceleration_mm_s2: Axes::all(acceleration),
        jerk_mm_s3: Axes::all(acceleration / ramp_s),
        ..Settings::default()
    }
}

#[test]
fn thousands_of_blocks_end_at_rest() -> Result<(), TestCaseError> {
    for (acceleration, ramp_s, lengths, feeds) in [
        (2000.0, 0.005, [3.1, 2.7], [6000.0, 2000.0]),
        (2000.0, 0.005, [1.0, 1.3], [6000.0, 2000.0]),
        (5000.0, 0.005, [3.1, 2.7], [6000.0, 2000.0]),
        // Each takes a cell.
        (500.0, 0.05, [0.005, 0.005], [6000.0, 6000.0]),
        (500.0, 0.05, [0.00333, 0.00333], [6000.0, 6000.0]),
        (500.0, 0.05, [0.002, 0.002], [6000.0, 6000.0]),
    ] {
        let settings = machine(acceleration, ramp_s);
        let displacements: Vec<_> = (0..3000)
            .map(|number| ([lengths[number % 2], 0.0, 0.0], feeds[number % 2]))
            .collect();
        let run = play(&settings, &blocks(&settings, &displacements), 0, &[]);
        check(&peaks(&settings, &run))?;
        let (end, corners) = run.corners.split_last().expect("corners");
        assert!(*end <= CREEP, "{lengths:?} mm end at {end} mm/s");
        let inner = &corners[60..corners.len() - 60];
        let slowest = inner.iter().copied().fold(f64::MAX, f64::min);
        assert!(slowest >= 1.0, "{lengths:?} mm at {slowest} mm/s");
    }
    Ok(())
}

#[test]
fn blocks_shorter_than_what_braking_leaves_are_gone_to_their_end() -> Result<(), TestCaseError> {
    // Braking aims to leave 12.5 µm.
    let settings = machine(100_000.0, 0.09);
    for count in 1_u32..8 {
        let displacement = |number: u32| {
            let angle = 0.2 * f64::from(number);
            ([0.004 * angle.cos(), 0.004 * angle.sin(), 0.0], 3000.0)
        };
        let displacements: Vec<_> = (0..count).map(displacement).collect();
        let run = play(&settings, &blocks(&settings, &displacements), 0, &[]);
        check(&peaks(&settings, &run))?;
    }
    Ok(())
}

#[test]
fn a_circle_of_short_lines_is_gone_through_without_a_rest() -> Result<(), TestCaseError> {
    for (length, turn, ramp_s) in [
        (0.02, 0.001, 0.02),
        (0.05, 0.02, 0.05),
        (0.2, 0.02, 0.01),
        (1.0, 0.02, 0.02),
    ] {
        let settings = machine(500.0, ramp_s);
        let displacement = |number: u32| {
            let angle = turn * f64::from(number);
            ([length * angle.cos(), length * angle.sin(), 0.0], 3000.0)
        };
        let displacements: Vec<_> = (0..1000).map(displacement).collect();
        let run = play(&settings, &blocks(&settings, &displacements), 0, &[]);
        check(&peaks(&settings, &run))?;
        let inner = &run.corners[100..900];
        let slowest = inner.iter().copied().fold(f64::MAX, f64::min);
        assert!(slowest >= 15.0, "{length} mm at {slowest} mm/s");
    }
    Ok(())
}

#[test]
fn a_corner_that_comes_late_is_the_same_in_every_round() -> Result<(), TestCaseError> {
    let settings = machine(500.0, 0.05);
    let side = |number: u32| {
        let angle = f64::from(number % 8) * core::f64::consts::FRAC_PI_4;
        ([20.0 * angle.cos(), 20.0 * angle.sin(), 0.0], 3000.0)
    };
    let displacements: Vec<_> = (0..160).map(side).collect();
    for every in [380, 400, 420] {
        let run = play(&settings, &blocks(&settings, &displacements), every, &[]);
        check(&peaks(&settings, &run))?;
    }
    // A short block between the reference and the corner.
    for (short, turn) in [(0.03, 0.5), (0.05, 0.7), (0.1, 0.9)] {
        let displacements = [
            ([10.0, 0.0, 0.0], 6000.0),
            ([short, 0.0, 0.0], 6000.0),
            ([10.0 * f64::cos(turn), 10.0 * f64::sin(turn), 0.0], 6000.0),
        ];
        let blocks = blocks(&settings, &displacements);
        for every in 60..200 {
            check(&peaks(&settings, &play(&settings, &blocks, every, &[])))?;
        }
    }
    Ok(())
}

#[test]
fn an_override_just_before_a_corner_leaves_its_limit_behind_it() -> Result<(), TestCaseError> {
    let by = |values: [f32; 3]| Axes::from_fn(|axis| values[axis.min(2)]);
    let settings = Settings {
        max_rate_mm_min: by([2000.0; 3]),
        acceleration_mm_s2: by([100.0, 210.0, 446.0]),
        jerk_mm_s3: by([33_000.0, 70_000.0, 4768.0]),
        junction_deviation_mm: 0.029,
        ..Settings::default()
    };
    // What comes behind the corner is faster, and under no override.
    let displacements = [
        ([0.766, -0.47, -0.038], 840.0),
        ([1.645, -2.164, 1.154], -1.0),
    ];
    let blocks = blocks(&settings, &displacements);
    for instant in 1..200 {
        let acts = [(instant, Act::Feed(10))];
        check(&peaks(&settings, &play(&settings, &blocks, 0, &acts)))?;
    }
    Ok(())
}

#[test]
fn what_rounding_lets_a_long_line_go_on_is_braked_before_its_end() -> Result<(), TestCaseError> {
    for acceleration in 0..200_u16 {
        let settings = machine(100.0 + 0.01 * f32::from(acceleration), 0.003);
        let line = [([12.0, 0.0, 0.0], 2000.0)];
        check(&peaks(
            &settings,
            &play(&settings, &blocks(&settings, &line), 0, &[]),
        ))?;
    }
    Ok(())
}

#[test]
fn a_corner_is_passed_at_rest_where_a_sample_reaches_its_speed() {
    let mut are_at_rest = Vec::new();
    for deviation in 1_u8..=60 {
        let settings = Settings {
            junction_deviation_mm: 0.0001 * f32::from(deviation),
            ..machine(1000.0, 0.02)
        };
        let displacements = [([30.0, 0.0, 0.0], 3000.0), ([0.0, 30.0, 0.0], 3000.0)];
        let blocks = blocks(&settings, &displacements);
        let slow_mm_s = 1000.0 * SAMPLE_S;
        let is_slow = math::sqrt(blocks[1].junction_sqr) < slow_mm_s;
        let corner_mm_s = play(&settings, &blocks, 0, &[]).corners[0];
        assert_eq!(
            corner_mm_s == 0.0,
            is_slow,
            "{deviation}: {corner_mm_s} mm/s"
        );
        are_at_rest.push(is_slow);
    }
    are_at_rest.dedup();
    assert_eq!(are_at_rest, [true, false]);
}

proptest! {
    #![proptest_config(crate::cases(16))]

    #[test]
    fn a_program_keeps_every_limit(settings in machines(), displacements in displacements()) {
        let blocks = blocks(&settings, &displacements);
        check(&peaks(&settings, &play(&settings, &blocks, 0, &[])))?;
    }

    #[test]
    fn so_do_holds_and_overrides(settings in machines(), displacements in displacements(), acts in acts()) {
        let blocks = blocks(&settings, &displacements);
        check(&peaks(&settings, &play(&settings, &blocks, 0, &acts)))?;
    }

    #[test]
    fn so_do_blocks_that_come_late(
        settings in machines(),
        displacements in displacements(),
        every in 1..200_usize,
    ) {
        let blocks = blocks(&settings, &displacements);
        check(&peaks(&settings, &play(&settings, &blocks, every, &[])))?;
    }
}
