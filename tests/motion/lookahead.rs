//! The look-ahead against a slow reference planner, and what it owes the machine at all times.

use crate::support::{self, Rig, arc, cases, check_limits, line, line_at, number, with};
use leadscrew::{
    axis::Axes,
    model::{Command, FeedRate, Override, Plane, Rotation},
    motion::{BLOCKS, LookAhead},
    path::{Block, Router, Work},
    settings::Settings,
    units::{Nm, TICKS_PER_MS},
};
use proptest::prelude::*;

/// The fastest speeds at which the blocks can be entered, and the time of all, by iteration.
struct Reference {
    entry_sqr: Vec<f64>,
    seconds: f64,
}

/// Change of v² along a block: in a measure z with v² = f(z), a constant per mm.
#[derive(Clone, Copy)]
struct Rule {
    length: f64,
    top_sqr: f64,
    acceleration: f64,
    /// v² at which the centripetal acceleration is all there is.
    limit_sqr: f64,
}

impl Rule {
    fn new(block: &Block) -> Self {
        Self {
            length: f64::from(block.length_mm),
            top_sqr: f64::from(block.nominal_mm_s).powi(2),
            acceleration: f64::from(block.acceleration_mm_s2),
            limit_sqr: block
                .curve
                .as_ref()
                .map_or(f64::INFINITY, |curve| f64::from(curve.limit_sqr)),
        }
    }

    /// The greatest v² after `length` mm from v², in small steps of the differential equation.
    fn reach(&self, speed_sqr: f64, length: f64) -> f64 {
        if self.limit_sqr.is_infinite() {
            return speed_sqr + 2.0 * self.acceleration * length;
        }
        let angle = (speed_sqr / self.limit_sqr).min(1.0).asin();
        let angle = angle + 2.0 * self.acceleration / self.limit_sqr * length;
        self.limit_sqr * angle.min(std::f64::consts::FRAC_PI_2).sin()
    }

    /// Time from one v² to another as fast as allowed, by integration over the path.
    fn seconds(&self, entry_sqr: f64, exit_sqr: f64) -> f64 {
        const PARTS: usize = 2000;
        let mut total = 0.0;
        let ds = self.length / PARTS as f64;
        let speed_sqr = |n: usize| {
            let distance = ds * n as f64;
            self.top_sqr
                .min(self.reach(entry_sqr, distance))
                .min(self.reach(exit_sqr, (self.length - distance).max(0.0)))
        };
        let mut before = speed_sqr(0).sqrt();
        for n in 1..=PARTS {
            let here = speed_sqr(n).sqrt();
            total += 2.0 * ds / (before + here).max(1.0e-9);
            before = here;
        }
        total
    }
}

impl Reference {
    fn new(blocks: &[Block]) -> Self {
        let rules: Vec<Rule> = blocks.iter().map(Rule::new).collect();
        let n = blocks.len();
        let mut entry = vec![0.0; n + 1];
        for k in 1..n {
            entry[k] = f64::from(blocks[k].junction_sqr)
                .min(rules[k].top_sqr)
                .min(rules[k - 1].top_sqr);
        }
        loop {
            let mut has_changed = false;
            for k in 0..n {
                let fastest = rules[k].reach(entry[k], rules[k].length);
                if entry[k + 1] > fastest * (1.0 + 1.0e-12) {
                    entry[k + 1] = fastest;
                    has_changed = true;
                }
                let fastest = rules[k].reach(entry[k + 1], rules[k].length);
                if entry[k] > fastest * (1.0 + 1.0e-12) {
                    entry[k] = fastest;
                    has_changed = true;
                }
            }
            if !has_changed {
                break;
            }
        }
        let seconds = (0..n)
            .map(|k| rules[k].seconds(entry[k], entry[k + 1]))
            .sum();
        Self {
            entry_sqr: entry,
            seconds,
        }
    }
}

fn blocks(settings: &Settings, commands: &[Command]) -> Vec<Block> {
    let mut router = Router::new(settings);
    let moves = commands
        .iter()
        .filter_map(|command| match router.route(command) {
            Some(Work::Move(block)) => Some(block),
            _ => None,
        });
    moves.collect()
}

/// Entry speeds squared as the look-ahead plans them, which brakes only; from the second on.
fn planned(blocks: &[Block]) -> Vec<f32> {
    planned_by(LookAhead::new(), blocks)
}

/// The same by a look-ahead through which so many blocks have gone before.
fn planned_after(before: &Block, times: usize, blocks: &[Block]) -> Vec<f32> {
    let mut plan = LookAhead::new();
    for _ in 0..times {
        plan.push(before);
        plan.pop();
    }
    planned_by(plan, blocks)
}

fn planned_by(mut plan: LookAhead, blocks: &[Block]) -> Vec<f32> {
    for block in blocks {
        plan.push(block);
        while plan.is_unfinished() {
            plan.continue_pass();
        }
    }
    let mut entries = Vec::new();
    while !plan.is_empty() {
        entries.push(plan.exit_sqr());
        plan.pop();
    }
    entries
}

/// Programs of short lines and arcs around a wandering point.
fn programs(moves: usize) -> impl Strategy<Value = Vec<Command>> {
    let step = (
        prop::array::uniform3(-4.0..4.0_f64),
        100.0..9000.0_f32,
        0..4_u8,
        0.3..1.0_f64,
    );
    prop::collection::vec(step, 2..moves).prop_map(|steps| {
        let mut at = [0.0; 3];
        let mut commands = Vec::new();
        for (displacement, feed, kind, share) in steps {
            let scale = if kind == 0 { 0.05 } else { 1.0 };
            let to = [0, 1, 2].map(|n| at[n] + scale * displacement[n]);
            if kind == 3 {
                // The centre on the perpendicular through the middle of the chord.
                let (x, y) = (to[0] - at[0], to[1] - at[1]);
                let centre = [0.5 * x - share * y, 0.5 * y + share * x];
                let rotation = if share > 0.6 {
                    Rotation::Clockwise
                } else {
                    Rotation::CounterClockwise
                };
                commands.push(arc(Plane::Xy, rotation, &to, centre, feed));
            } else {
                commands.push(line(&to, feed));
            }
            at = to;
        }
        commands
    })
}

fn machines() -> impl Strategy<Value = Settings> {
    (
        prop::array::uniform3(40.0..500.0_f64),
        prop::array::uniform3(1000.0..9000.0_f32),
        prop::array::uniform3(50.0..2000.0_f32),
        0.001..0.1_f32,
    )
        .prop_map(
            |(steps, rates, accelerations, junction_deviation_mm)| Settings {
                junction_deviation_mm,
                step_pulse_us: 3,
                ..with(&steps, &rates, &accelerations)
            },
        )
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn every_entry_speed_lets_the_tool_stop_and_none_is_slower_than_it_must(
        settings in machines(),
        commands in programs(24),
    ) {
        let blocks = blocks(&settings, &commands);
        let reference = Reference::new(&blocks);
        let planned = planned(&blocks);
        // The executor accelerates as far as it can, so the speeds that matter are the lesser ones.
        let mut entry: f64 = 0.0;
        for (k, block) in blocks.iter().enumerate() {
            let rule = Rule::new(block);
            entry = rule.reach(entry, rule.length).min(f64::from(planned[k]));
            let exact = reference.entry_sqr[k + 1];
            prop_assert!(
                (entry.sqrt() - exact.sqrt()).abs() <= 1.0e-3 * exact.sqrt() + 1.0e-4,
                "block {k} is left at {} instead of {}", entry.sqrt(), exact.sqrt()
            );
        }
    }

    #[test]
    fn the_plan_is_the_same_wherever_its_ring_begins(
        settings in machines(),
        commands in programs(120),
        times in 2..BLOCKS,
    ) {
        let slow = blocks(&settings, &[line(&[100.0, 0.0, 0.0], 100.0)])[0];
        let blocks = blocks(&settings, &commands);
        prop_assume!(blocks.len() < BLOCKS);
        let once = planned_after(&slow, 1, &blocks);
        prop_assert_eq!(planned_after(&slow, times, &blocks), once);
    }

    #[test]
    fn a_program_takes_the_time_that_the_limits_need(
        settings in machines(),
        commands in programs(12),
    ) {
        let reference = Reference::new(&blocks(&settings, &commands));
        let trace = Rig::play(&settings, &number(&commands));
        let seconds = trace.whole_seconds();
        prop_assert!(
            (seconds / reference.seconds - 1.0).abs() <= 0.01,
            "{seconds} s instead of {} s", reference.seconds
        );
        trace.check_pulses();
    }

    #[test]
    fn a_late_feed_of_blocks_never_leaves_the_tool_in_motion(
        settings in machines(),
        commands in programs(16),
        feed_ticks in 1_000..40_000_000_u64,
    ) {
        let mut rig = Rig::new(&settings);
        rig.feed_ticks = feed_ticks;
        rig.run(&number(&commands), &[]);
        rig.trace.check_pulses();
        let lines = commands.iter().filter(|c| matches!(c, Command::Line { .. })).count();
        if lines == commands.len() {
            check_limits(&settings, &rig.trace);
        }
        let end = commands.last().and_then(support::target).unwrap();
        prop_assert_eq!(rig.trace.net_steps(), support::target_steps(&settings, &end));
    }
}

#[test]
fn a_full_look_ahead_is_as_good_as_the_reference() {
    let settings = with(&[250.0], &[6000.0], &[200.0]);
    let commands: Vec<Command> = (0..120)
        .map(|k| {
            let angle = f64::from(k) * 0.05;
            let mm = [20.0 * angle.sin(), 20.0 - 20.0 * angle.cos()];
            line_at(
                Axes::from_fn(|axis| mm.get(axis).map_or(Nm(0), |mm| Nm::from_mm_f64(*mm))),
                FeedRate::Feed(6000.0),
            )
        })
        .collect();
    let reference = Reference::new(&blocks(&settings, &commands));
    let seconds = Rig::play(&settings, &commands).motion_seconds();
    assert!(
        (seconds / reference.seconds - 1.0).abs() < 0.01,
        "{seconds}"
    );
}

/// Junction deviation in double precision: the corner's circle under the axes' accelerations.
fn junction_speed(settings: &Settings, displacements: [[f64; 3]; 2]) -> f64 {
    let unit = |displacement: [f64; 3]| {
        let length = displacement
            .iter()
            .map(|displacement| displacement * displacement)
            .sum::<f64>()
            .sqrt();
        displacement.map(|displacement| displacement / length)
    };
    let [before, after] = displacements.map(unit);
    let change = [0, 1, 2].map(|n| after[n] - before[n]);
    let length = change.iter().map(|x| x * x).sum::<f64>().sqrt();
    let acceleration = (0..3)
        .filter(|n| change[*n] != 0.0)
        .map(|n| f64::from(settings.acceleration_mm_s2[n]) * length / change[n].abs())
        .fold(f64::INFINITY, f64::min);
    // Half the turning angle: sin = |change| / 2; 1 - cos without cancellation.
    let sine = 0.5 * length;
    let cosine = (1.0 - sine * sine).max(0.0).sqrt();
    let ratio = cosine * (1.0 + cosine) / (sine * sine);
    (acceleration * f64::from(settings.junction_deviation_mm) * ratio).sqrt()
}

proptest! {
    #![proptest_config(cases(128))]

    #[test]
    fn corners_are_taken_as_fast_as_the_junction_deviation_says(
        first in prop::array::uniform3(-5.0..5.0_f64),
        turn in prop::array::uniform3(-5.0..5.0_f64),
        sharpness in -3.0..0.5_f64,
        acceleration in prop::array::uniform3(50.0..2000.0_f32),
    ) {
        let settings = with(&[100.0], &[60_000.0], &acceleration);
        let second = [0, 1, 2].map(|n| first[n] + turn[n] * 10.0_f64.powf(sharpness));
        let nm = |mm: [f64; 3]| mm.map(|mm| (mm * 1.0e6).round() * 1.0e-6);
        let (first, second) = (nm(first), nm(second));
        let end = [0, 1, 2].map(|n| first[n] + second[n]);
        let blocks = blocks(&settings, &[line(&first, 60_000.0), line(&end, 60_000.0)]);
        if let [_, block] = blocks[..] {
            let exact = junction_speed(&settings, [first, second]);
            let speed = f64::from(block.junction_sqr).sqrt();
            // Turns below 1.4 mrad count as none, as in Grbl.
            prop_assert!(
                (speed / exact - 1.0).abs() < 2.0e-3 || block.junction_sqr == f32::MAX,
                "{speed} instead of {exact}"
            );
        }
    }
}

#[test]
fn an_override_that_comes_with_a_segment_due_brakes_within_the_limits() {
    let settings = with(&[80.0], &[6000.0], &[500.0]);
    let lines = (1..=120).map(|k| line(&[0.4 * f64::from(k)], 6000.0));
    let commands = number(&lines.collect::<Vec<_>>());
    for edges in (1..46).step_by(3) {
        let mut rig = Rig::new(&settings);
        for command in &commands {
            let work = rig.router.route(command).expect("it moves");
            assert!(rig.enqueue(work));
            rig.prepare();
        }
        rig.run_to(250 * u64::from(TICKS_PER_MS));
        // Segments are made between the override and the pass that follows from it.
        for _ in 0..edges {
            let edge = rig.drive.step().expect("it moves");
            rig.now = edge.ticks;
            rig.trace.push(edge, 0);
        }
        rig.receive(Override::FeedLess as u8);
        rig.run_to_standstill();
        check_limits(&settings, &rig.trace);
        assert_eq!(rig.trace.net_steps(), rig.snapshot().steps);
    }
}
