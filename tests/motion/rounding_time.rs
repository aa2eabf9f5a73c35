//! Motion time under `G64`: no program takes longer than under `G61`.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use crate::support::{Rig, arc, cases, line, line_at, number, with};
use leadscrew::{
    axis::Axes,
    model::{Command, FeedRate, PathControl, Plane, Rotation},
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

/// What the segments of a program may add to its time, s.
const MEASURED_S: f64 = 2.0e-3;

/// Part of its time by which a program may take longer: ramps of merged lines, which keep 99 % of the acceleration.
const RAMPS_PART: f64 = 1.0e-3;
/// The same of any program with limits of jerk, under which accelerations change from sample to sample.
const JERK_PART: f64 = 0.005;

/// The time of the motion as the pins show it, s.
fn seconds(settings: &Settings, control: PathControl, commands: &[Command]) -> f64 {
    let mut rig = Rig::new(settings);
    rig.control = control;
    rig.run(&number(commands), &[]);
    rig.trace.whole_seconds()
}

fn continuous(tolerance_mm: f64, merging_mm: f64) -> PathControl {
    let [tolerance_nm, merging_nm] = [tolerance_mm, merging_mm].map(|mm| (1.0e6 * mm) as u32);
    PathControl::Continuous {
        tolerance_nm,
        merging_nm,
    }
}

fn milling(jerk_mm_s3: f32) -> Settings {
    Settings {
        jerk_mm_s3: Axes::all(jerk_mm_s3),
        ..with(&[80.0], &[5000.0, 5000.0, 3000.0], &[500.0, 500.0, 300.0])
    }
}

/// A path from the origin, one move after the other.
struct Pen {
    at: [f64; 3],
    heading: f64,
    mm_min: f32,
    commands: Vec<Command>,
}

impl Pen {
    fn new(mm_min: f32) -> Self {
        Self {
            at: [0.0; 3],
            heading: 0.0,
            mm_min,
            commands: Vec::new(),
        }
    }

    fn ahead(&mut self, mm: f64, rise_mm: f64) {
        self.at[0] += mm * self.heading.cos();
        self.at[1] += mm * self.heading.sin();
        self.at[2] += rise_mm;
        self.commands.push(line(&self.at, self.mm_min));
    }

    fn rapid(&mut self, mm: f64) {
        self.ahead(mm, 0.0);
        let target = Axes::from_fn(|axis| Nm::from_mm_f64(self.at.get(axis).map_or(0.0, |mm| *mm)));
        self.commands.pop();
        self.commands.push(line_at(target, FeedRate::Rapid));
    }

    /// A curve of an angle as so many chords.
    fn chords(&mut self, radius: f64, angle: f64, count: u32) {
        let turn = angle / f64::from(count);
        for _ in 0..count {
            self.heading += 0.5 * turn;
            self.ahead(2.0 * radius * (0.5 * turn.abs()).sin(), 0.0);
            self.heading += 0.5 * turn;
        }
    }

    fn arc(&mut self, radius: f64, angle: f64) {
        let towards = self.heading + FRAC_PI_2.copysign(angle);
        let centre = [radius * towards.cos(), radius * towards.sin()];
        self.heading += angle;
        let from = self.heading - FRAC_PI_2.copysign(angle);
        self.at[0] += centre[0] + radius * from.cos();
        self.at[1] += centre[1] + radius * from.sin();
        let rotation = if angle > 0.0 {
            Rotation::CounterClockwise
        } else {
            Rotation::Clockwise
        };
        self.commands
            .push(arc(Plane::Xy, rotation, &self.at, centre, self.mm_min));
    }
}

/// An outline of curves as chords, of a radius each and so many to the quarter turn, with a sharp corner between them.
fn outline(per_quarter: u32, mm_min: f32) -> Vec<Command> {
    let mut pen = Pen::new(mm_min);
    for (number, radius) in [8.0, 2.0, 5.0, 0.7, 3.0].into_iter().enumerate() {
        let angle = if number % 2 == 0 { 2.4 } else { -1.9 };
        pen.chords(radius, angle, 2 * per_quarter);
        pen.heading += [0.0, 1.2, 0.0, -2.0, 0.4][number];
    }
    pen.commands
}

/// Isolation of a board: straight lines, and around pads a few chords or a corner of 45°.
fn board(mm_min: f32) -> Vec<Command> {
    let mut pen = Pen::new(mm_min);
    for number in 0..12_i32 {
        pen.ahead(0.4 + 0.9 * f64::from(number % 4), 0.0);
        let turn = FRAC_PI_4 * f64::from(1 + number % 3) * if number % 5 < 3 { 1.0 } else { -1.0 };
        if number % 3 == 0 {
            pen.heading += turn;
        } else {
            pen.chords(0.3 + 0.2 * f64::from(number % 2), turn, 4);
        }
    }
    pen.commands
}

/// Rows over hills.
fn relief(step_mm: f64) -> Vec<Command> {
    let height = |x: f64, y: f64| 2.0 * (0.9 * x).sin() * (0.7 * y).cos();
    let mut pen = Pen::new(4000.0);
    for row in 0..3_u32 {
        let y = 0.4 * f64::from(row);
        let count = (10.0 / step_mm) as u32;
        for number in 0..=count {
            let number = if row % 2 == 0 { number } else { count - number };
            let x = step_mm * f64::from(number);
            pen.at = [x, y, height(x, y)];
            pen.commands.push(line(&pen.at, pen.mm_min));
        }
    }
    pen.commands
}

/// A pocket with round corners, of arcs or of so many chords each.
fn pocket(radius: f64, chords: Option<u32>) -> Vec<Command> {
    let mut pen = Pen::new(3000.0);
    for side in 0..12_u32 {
        pen.ahead(10.0 + f64::from(side / 2) - 2.0 * radius, 0.0);
        match chords {
            Some(count) => pen.chords(radius, FRAC_PI_2, count),
            None => pen.arc(radius, FRAC_PI_2),
        }
    }
    pen.commands
}

/// Lines, arcs and S-curves, tangent to each other or not.
fn contour(is_tangent: bool) -> Vec<Command> {
    let mut pen = Pen::new(4000.0);
    for number in 0..16_u32 {
        match number % 4 {
            0 => pen.ahead(1.0 + f64::from(number), 0.0),
            1 => pen.arc(0.5 + 0.3 * f64::from(number), 1.3),
            2 => pen.arc(0.5 + 0.2 * f64::from(number), -1.1),
            _ => pen.ahead(0.4, 0.0),
        }
        if !is_tangent {
            pen.heading += [0.3, -0.9, 0.1, 0.6][number as usize % 4];
        }
    }
    pen.commands
}

fn corpus() -> Vec<(&'static str, Vec<Command>)> {
    vec![
        ("few chords", outline(4, 4000.0)),
        ("many chords", outline(40, 4000.0)),
        ("many chords, slowly", outline(40, 600.0)),
        ("board", board(4000.0)),
        ("board, slowly", board(900.0)),
        ("relief", relief(0.2)),
        ("coarse relief", relief(1.0)),
        ("square pocket", pocket(0.0, Some(1))),
        ("pocket of chords", pocket(1.0, Some(8))),
        ("pocket of arcs", pocket(3.0, None)),
        ("contour", contour(true)),
        ("contour with corners", contour(false)),
    ]
}

/// Checks a program and returns the part of its exact time.
fn check(
    settings: &Settings,
    control: PathControl,
    commands: &[Command],
    longest_part: f64,
) -> Result<f64, String> {
    let exact = seconds(settings, PathControl::ExactPath, commands);
    let rounded = seconds(settings, control, commands);
    if rounded <= exact * (1.0 + longest_part) + MEASURED_S {
        Ok(rounded / exact)
    } else {
        Err(format!("{rounded} s instead of {exact} s, {control:?}"))
    }
}

fn check_corpus(jerk_mm_s3: f32) {
    let settings = milling(jerk_mm_s3);
    for (name, commands) in corpus() {
        for (tolerance_mm, merging_mm) in [(0.05, 0.05), (0.2, 0.0), (0.01, 0.01)] {
            let control = continuous(tolerance_mm, merging_mm);
            if let Err(slower) = check(&settings, control, &commands, RAMPS_PART) {
                panic!("{name}: {slower}");
            }
        }
    }
}

#[test]
fn no_program_takes_longer_with_rounded_corners() {
    check_corpus(0.0);
}

#[test]
fn a_contour_with_sharp_corners_at_arcs_takes_less_time() {
    let mut pen = Pen::new(4000.0);
    for number in 0..12 {
        pen.arc(8.0, if number % 2 == 0 { 1.2 } else { -0.9 });
        pen.heading += 0.35;
        pen.ahead(6.0, 0.0);
        pen.heading += 0.35;
    }
    let settings = milling(0.0);
    let part = check(&settings, continuous(0.1, 0.0), &pen.commands, RAMPS_PART).unwrap();
    assert!(part < 0.97, "{part}");
}

#[test]
fn no_program_takes_longer_with_rounded_corners_and_limits_of_jerk() {
    check_corpus(10_000.0);
    check_corpus(50_000.0);
}

#[test]
fn corners_between_long_lines_take_less_time_within_limits_of_jerk() {
    let mut pen = Pen::new(3000.0);
    for _ in 0..24 {
        pen.ahead(10.0, 0.0);
        pen.heading += FRAC_PI_4 / 3.0;
    }
    let settings = milling(10_000.0);
    let part = check(&settings, continuous(0.1, 0.0), &pen.commands, RAMPS_PART).unwrap();
    assert!(part < 0.9, "{part}");
}

#[test]
fn chords_of_a_curve_take_less_time_with_rounded_corners() {
    let part = check(
        &milling(0.0),
        continuous(0.05, 0.05),
        &outline(4, 4000.0),
        RAMPS_PART,
    )
    .unwrap();
    assert!(part < 0.92, "{part}");
}

/// Random programs: lines short and long, all angles, changes of feed, rapids between feeds, arcs: a few or half.
fn programs(has_many_arcs: bool) -> impl Strategy<Value = Vec<Command>> {
    let turn = prop_oneof![4 => -1.0..1.0_f64, 1 => -3.1..3.1_f64];
    let step = (turn, 0.3..1.0_f64, 0..30_u8, -0.5..0.5_f64);
    let shape = (0.05..3.0_f64, 0.1..1.0_f64, 1.0..30.0_f64, any::<bool>());
    (shape, prop::collection::vec(step, 2..40)).prop_map(move |(shape, steps)| {
        let (most_turn, short_mm, ratio, is_flat) = shape;
        let is_flat = is_flat || has_many_arcs;
        let mut pen = Pen::new(3000.0);
        for (turn, part, kind, rise) in steps {
            pen.heading += turn * if turn.abs() < 1.0 { most_turn } else { 1.0 };
            let long = if kind % 6 == 0 { ratio } else { 1.0 };
            let mm = short_mm * part * long;
            match kind {
                1 => pen.rapid(mm),
                2 => pen.arc(0.5 + mm, 3.0 * rise + 0.1_f64.copysign(rise)),
                15.. if has_many_arcs => pen.arc(0.1 + mm, 3.0 * rise + 0.1_f64.copysign(rise)),
                3 => pen.mm_min = 200.0 + 5000.0 * part as f32,
                _ => pen.ahead(mm, if is_flat { 0.0 } else { mm * rise }),
            }
        }
        pen.ahead(1.0, 0.0);
        pen.commands
    })
}

fn machines() -> impl Strategy<Value = Settings> {
    let acceleration = 50.0..2000.0_f32;
    let accelerations = (any::<bool>(), prop::array::uniform3(acceleration));
    let deviation = prop::sample::select(vec![0.01_f32, 0.01, 0.002, 0.05]);
    let jerk = prop::sample::select(vec![0.0_f32, 0.0, 0.0, 0.0, 10_000.0, 50_000.0]);
    (accelerations, deviation, jerk).prop_map(|((is_even, accelerations), deviation, jerk)| {
        let [x, ..] = accelerations;
        let accelerations = if is_even { [x; 3] } else { accelerations };
        Settings {
            junction_deviation_mm: deviation,
            jerk_mm_s3: Axes::all(jerk),
            ..with(&[80.0], &[5000.0, 5000.0, 2000.0], &accelerations)
        }
    })
}

/// Checks a random program.
fn check_random(
    settings: &Settings,
    control: PathControl,
    commands: &[Command],
) -> Result<(), TestCaseError> {
    let has_jerk_limit = settings.jerk_mm_s3[0] > 0.0;
    let longest_part = if has_jerk_limit {
        JERK_PART
    } else {
        RAMPS_PART
    };
    let slower = check(settings, control, commands, longest_part).err();
    prop_assert!(slower.is_none(), "{}", slower.unwrap_or_default());
    Ok(())
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn no_random_contour_of_lines_and_arcs_takes_longer_with_rounded_corners(
        settings in machines(),
        commands in programs(true),
        tolerance_mm in 0.005..0.5_f64,
        merging_part in prop::sample::select(vec![0.0, 0.3, 1.0]),
    ) {
        let control = continuous(tolerance_mm, merging_part * tolerance_mm);
        check_random(&settings, control, &commands)?;
    }
}

proptest! {
    #![proptest_config(cases(750))]

    #[test]
    fn no_random_program_takes_longer_with_rounded_corners(
        settings in machines(),
        commands in programs(false),
        tolerance_mm in 0.005..0.5_f64,
        merging_part in prop::sample::select(vec![0.0, 0.3, 1.0]),
    ) {
        let control = continuous(tolerance_mm, merging_part * tolerance_mm);
        check_random(&settings, control, &commands)?;
    }
}
