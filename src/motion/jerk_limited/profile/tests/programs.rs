//! How long programs take under limits of jerk, beside a feasible plan.

use std::vec::Vec;

use super::{feasible::feasible_s, play};
use crate::{
    axis::Axes,
    model::{Circle, Command, FeedRate, PathControl, Plane, Rotation},
    path::{Blender, Block, RampTime, Router, Work},
    settings::Settings,
    units::{MicroDegrees, Nm},
};

/// Numbers that are the same each time.
struct RandomNumbers(u64);

impl RandomNumbers {
    fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn between(&mut self, least: f64, most: f64) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        least + (most - least) * (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn happens(&mut self, probability: f64) -> bool {
        self.between(0.0, 1.0) < probability
    }
}

/// What a program is like.
#[derive(Debug, Clone, Copy)]
enum ProgramKind {
    /// Outlines of changing curvature, as lines of 0.3 to 5 mm, with corners.
    Outlines,
    /// Small letters of lines below a millimetre.
    Engraving,
    /// Lines and arcs, tangent to each other or not.
    Arcs,
    /// Lines of any length and direction, with other feeds.
    Random,
}

const KINDS: [ProgramKind; 4] = [
    ProgramKind::Outlines,
    ProgramKind::Engraving,
    ProgramKind::Arcs,
    ProgramKind::Random,
];

/// A program that grows.
struct Program {
    numbers: RandomNumbers,
    at: [f64; 2],
    heading: f64,
    feed: f32,
    commands: Vec<Command>,
}

impl Program {
    fn target(&self) -> Axes<Nm> {
        let coordinate = |axis: usize| self.at.get(axis).map_or(Nm(0), |mm| Nm::from_mm_f64(*mm));
        Axes::from_fn(coordinate)
    }

    fn line(&mut self, length: f64) {
        let (sine, cosine) = self.heading.sin_cos();
        self.at = [self.at[0] + length * cosine, self.at[1] + length * sine];
        self.commands.push(Command::Line {
            target: self.target().into(),
            feed_rate: FeedRate::Feed(self.feed),
            line: 0,
        });
    }

    fn rapid(&mut self, at: [f64; 2]) {
        self.at = at;
        self.commands.push(Command::Line {
            target: self.target().into(),
            feed_rate: FeedRate::Rapid,
            line: 0,
        });
    }

    /// An arc by an angle, to the left where that is positive.
    fn arc(&mut self, radius: f64, angle: f64) {
        let to_centre = |heading: f64| {
            let (sine, cosine) = heading.sin_cos();
            [-radius * sine, radius * cosine].map(|mm| mm * angle.signum())
        };
        let begin = to_centre(self.heading);
        self.heading += angle;
        let end = to_centre(self.heading);
        self.at = [0, 1].map(|axis| self.at[axis] + begin[axis] - end[axis]);
        self.commands.push(Command::Arc {
            target: self.target().into(),
            circle: Circle {
                plane: Plane::Xy,
                centre: begin.map(Nm::from_mm_f64),
                rotation: if angle > 0.0 {
                    Rotation::CounterClockwise
                } else {
                    Rotation::Clockwise
                },
                turns: 1,
                tilt: MicroDegrees::ZERO,
            },
            feed_rate: FeedRate::Feed(self.feed),
            line: 0,
        });
    }

    /// Short lines along a curve whose curvature wanders.
    fn curve(&mut self, lines: u32, lengths: [f64; 2], bend: f64, corners: f64) {
        let mut curvature = self.numbers.between(-bend, bend);
        for _ in 0..lines {
            let part = self.numbers.between(0.0, 1.0).powi(3);
            let length = lengths[0] + (lengths[1] - lengths[0]) * part;
            curvature = 0.8 * curvature + 0.5 * self.numbers.between(-bend, bend);
            self.heading += curvature * length.min(1.5);
            if self.numbers.happens(corners) {
                self.heading += self.numbers.between(-2.5, 2.5);
            }
            self.line(length);
        }
    }

    fn piece(&mut self, kind: ProgramKind) {
        match kind {
            ProgramKind::Outlines | ProgramKind::Engraving => {
                let at = [0, 1].map(|_| self.numbers.between(0.0, 60.0));
                self.rapid(at);
                self.heading = self.numbers.between(0.0, 6.2);
                if matches!(kind, ProgramKind::Outlines) {
                    self.curve(30, [0.3, 5.0], 0.3, 0.06);
                } else {
                    self.curve(20, [0.1, 0.9], 1.0, 0.1);
                }
            }
            ProgramKind::Arcs => {
                let length = self.numbers.between(0.1, 4.5).powi(2);
                self.line(length);
                if self.numbers.happens(0.3) {
                    self.heading += self.numbers.between(-2.0, 2.0);
                }
                let radius = 0.3 * 40.0_f64.powf(self.numbers.between(0.0, 1.0));
                let angle = self.numbers.between(0.2, 3.5);
                let is_left = self.numbers.happens(0.5);
                self.arc(radius, if is_left { angle } else { -angle });
            }
            ProgramKind::Random => {
                let length = 0.05 * 200.0_f64.powf(self.numbers.between(0.0, 1.0));
                self.heading += 3.1 * self.numbers.between(-1.0, 1.0).powi(3);
                let feed = self.feed;
                if self.numbers.happens(0.1) {
                    self.feed = self.numbers.between(300.0, 4800.0) as f32;
                }
                self.line(length);
                self.feed = feed;
            }
        }
    }
}

/// A program of a kind.
fn program(kind: ProgramKind, seed: u64) -> Vec<Command> {
    let mut numbers = RandomNumbers::new(seed);
    let feed = numbers.between(1500.0, 4500.0) as f32;
    let mut program = Program {
        numbers,
        at: [0.0; 2],
        heading: 0.0,
        feed,
        commands: Vec::new(),
    };
    let pieces = match kind {
        ProgramKind::Outlines => 3,
        ProgramKind::Engraving => 5,
        ProgramKind::Arcs => 25,
        ProgramKind::Random => 60,
    };
    for _ in 0..pieces {
        program.piece(kind);
    }
    program.commands
}

/// The blocks of commands.
fn blocks(settings: &Settings, control: PathControl, commands: &[Command]) -> Vec<Block> {
    let mut router = Router::new(settings);
    let mut blender = Blender::new();
    let mut blocks = Vec::new();
    for number in 0..=commands.len() {
        match commands.get(number) {
            Some(command) => router.blend(&mut blender, control, command),
            None => router.flush(&mut blender),
        }
        while let Some(output) = blender.front() {
            if let Some(Work::Move(block)) = router.route_blended(output) {
                blocks.push(block);
            }
            blender.dequeue();
        }
    }
    blocks
}

fn mill(jerk_mm_s3: f32) -> Settings {
    Settings {
        max_rate_mm_min: Axes::all(5000.0),
        acceleration_mm_s2: Axes::all(500.0),
        jerk_mm_s3: Axes::all(jerk_mm_s3),
        junction_deviation_mm: 0.01,
        ..Settings::default()
    }
}

#[test]
fn programs_take_at_most_2_percent_longer_than_a_feasible_plan() {
    for jerk in [10_000.0, 50_000.0] {
        let settings = mill(jerk);
        let ramp = f64::from(RampTime::new(&settings).seconds());
        for kind in KINDS {
            let seeds = crate::cases::rounds(24);
            for seed in 1..=seeds {
                let blocks = blocks(&settings, PathControl::ExactPath, &program(kind, seed));
                let seconds = play(&settings, &blocks, 0, &[]).seconds;
                let ratio = seconds / feasible_s(&blocks, ramp);
                std::println!("{kind:?} {seed}, {jerk} mm/s³: {seconds:.3} s, {ratio:.4}");
                assert!(ratio <= 1.02, "{kind:?} {seed}, {jerk} mm/s³: {ratio}");
            }
        }
    }
}
