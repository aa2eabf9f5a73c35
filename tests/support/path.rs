//! The programmed path in double precision, and how far the steps are from it.

use std::{f64::consts::TAU, ops::Range};

use leadscrew::{
    axis::{AXES, Axes},
    model::{Circle, Command, Rotation},
    path::{BlendOutput, CornerArc},
    settings::Settings,
    stepper::STEP_JITTER_TICKS,
    units::Nm,
};

use super::{TICKS_PER_S, Trace, add_steps, target, target_steps};

/// Grain of the search along the path, steps.
const GRAIN: f64 = 0.05;
/// The part that the search leaves out.
const SEARCH: f64 = 0.03;
/// Most that a step is early or late so that events keep their distance, with the rounding of its time, s.
pub(crate) const SHIFT_S: f64 = (STEP_JITTER_TICKS + 2) as f64 / TICKS_PER_S;

type Point = [f64; AXES];

/// One command's path, in steps.
pub(crate) struct Piece {
    begin: Point,
    end: Point,
    curve: Option<CircularArc>,
    round: Option<Corner>,
    /// Its steps are those of the motors of `CoreXY`.
    is_core_xy: bool,
    /// Not less than the length, in steps.
    length: f64,
}

/// The circular part.
struct CircularArc {
    axes: [usize; 2],
    centre: [f64; 2],
    scale: [f64; 2],
    radius: [f64; 2],
    angle: f64,
    sweep: f64,
}

impl Piece {
    fn new(settings: &Settings, from: &Axes<Nm>, command: &Command) -> Option<Self> {
        let to = target(command)?;
        let scale = |axis: usize| settings.steps_per_mm[axis].millionths() as f64 * 1.0e-6;
        let point = |at: &Axes<Nm>| -> Point {
            std::array::from_fn(|axis| at[axis].0 as f64 * 1.0e-6 * scale(axis))
        };
        let (begin, end) = (point(from), point(&to));
        let mut length: f64 = (0..AXES).map(|n| (end[n] - begin[n]).abs()).sum();
        let mut curve = None;
        if let Command::Arc { circle, .. } = command {
            let (first, second, _) = circle.plane.axes();
            let turn = CircularArc::new(circle, [first, second], from, &to, scale);
            let finest = scale(first).max(scale(second));
            length += turn.sweep.abs() * turn.radius[0].max(turn.radius[1]) * finest;
            curve = Some(turn);
        }
        Some(Self {
            begin,
            end,
            curve,
            round: None,
            is_core_xy: settings.core_xy,
            length: length * motors_per_axis(settings),
        })
    }

    /// A rounded corner from where the piece before ended.
    fn round(settings: &Settings, from: &Axes<Nm>, round: &CornerArc) -> Self {
        let scale = |axis: usize| settings.steps_per_mm[axis].millionths() as f64 * 1.0e-6;
        let point = |at: &Axes<Nm>| -> Point {
            std::array::from_fn(|axis| at[axis].0 as f64 * 1.0e-6 * scale(axis))
        };
        let (begin, end) = (point(from), point(&round.target));
        let arm = |direction: &[f32; 3]| -> Point {
            std::array::from_fn(|axis| {
                let share = f64::from(direction.get(axis).copied().unwrap_or(0.0));
                share * f64::from(round.radius_mm) * scale(axis)
            })
        };
        let corner = Corner {
            outwards: arm(&round.radial),
            along: arm(&round.tangent),
            sweep: f64::from(round.sweep_rad),
        };
        let length: f64 = (0..AXES)
            .map(|axis| 2.0 * (corner.outwards[axis].abs() + corner.along[axis].abs()))
            .sum();
        Self {
            begin,
            end,
            curve: None,
            round: Some(corner),
            is_core_xy: settings.core_xy,
            length: length * motors_per_axis(settings),
        }
    }

    /// True for a straight line.
    pub(crate) fn is_line(&self) -> bool {
        self.curve.is_none() && self.round.is_none()
    }

    /// Not less than its length, steps.
    pub(crate) fn length(&self) -> f64 {
        self.length
    }

    /// Position after a share of the distance, steps.
    pub(crate) fn at(&self, share: f64) -> Point {
        let mut point = self.begin;
        for (point, end) in point.iter_mut().zip(&self.end) {
            *point += (end - *point) * share;
        }
        if let Some(turn) = &self.curve {
            let radius = turn.radius[0] + (turn.radius[1] - turn.radius[0]) * share;
            let (sine, cosine) = (turn.angle + turn.sweep * share).sin_cos();
            point[turn.axes[0]] = turn.scale[0] * (turn.centre[0] + radius * cosine);
            point[turn.axes[1]] = turn.scale[1] * (turn.centre[1] + radius * sine);
        }
        if let Some(corner) = &self.round {
            let (sine, cosine) = (corner.sweep * share).sin_cos();
            point = std::array::from_fn(|axis| {
                let (outwards, along) = (corner.outwards[axis], corner.along[axis]);
                self.begin[axis] + outwards * (cosine - 1.0) + along * sine
            });
        }
        if self.is_core_xy {
            [point[0], point[1]] = [point[0] + point[1], point[0] - point[1]];
        }
        point
    }
}

/// How many steps of motors one of an axis makes at most.
fn motors_per_axis(settings: &Settings) -> f64 {
    if settings.core_xy { 2.0 } else { 1.0 }
}

/// A rounded corner: its radii to the start and along it, in steps.
struct Corner {
    outwards: Point,
    along: Point,
    sweep: f64,
}

impl CircularArc {
    fn new(
        circle: &Circle,
        axes: [usize; 2],
        from: &Axes<Nm>,
        to: &Axes<Nm>,
        scale: impl Fn(usize) -> f64,
    ) -> Self {
        let centre = [0, 1].map(|n| from[axes[n]] + circle.centre[n]);
        let arm = |at: &Axes<Nm>| [0, 1].map(|n| (at[axes[n]] - centre[n]).0 as f64 * 1.0e-6);
        let (begin, end) = (arm(from), arm(to));
        let angle = begin[1].atan2(begin[0]);
        let is_closed = axes.iter().all(|axis| from[*axis] == to[*axis]);
        let travel = (end[1].atan2(end[0]) - angle).rem_euclid(TAU);
        let turns = TAU * f64::from(circle.turns - 1);
        let sweep = match circle.rotation {
            _ if is_closed => TAU,
            Rotation::CounterClockwise => travel,
            Rotation::Clockwise => TAU - travel,
        } + turns;
        Self {
            axes,
            centre: centre.map(|nm| nm.0 as f64 * 1.0e-6),
            scale: axes.map(scale),
            radius: [begin[0].hypot(begin[1]), end[0].hypot(end[1])],
            angle,
            sweep: match circle.rotation {
                Rotation::CounterClockwise => sweep,
                Rotation::Clockwise => -sweep,
            },
        }
    }
}

/// The path of commands from the origin.
pub(crate) fn pieces(settings: &Settings, commands: &[Command]) -> Vec<Piece> {
    let mut from = Axes::all(Nm(0));
    let mut pieces = Vec::new();
    for command in commands {
        pieces.extend(Piece::new(settings, &from, command));
        from = target(command).unwrap_or(from);
    }
    pieces
}

/// The path that the router is given, from the origin.
pub(crate) fn pieces_of_blended(settings: &Settings, outputs: &[BlendOutput]) -> Vec<Piece> {
    let mut from = Axes::all(Nm(0));
    let mut pieces = Vec::new();
    for output in outputs {
        match output {
            BlendOutput::Command(command) => {
                pieces.extend(Piece::new(settings, &from, command));
                from = target(command).unwrap_or(from);
            }
            BlendOutput::CornerArc(round) => {
                pieces.push(Piece::round(settings, &from, round));
                from = round.target;
            }
        }
    }
    pieces
}

/// Fastest step rate that the settings allow on each axis, Hz.
pub(crate) fn step_rates(settings: &Settings) -> Axes<f64> {
    settings
        .max_rate_mm_min
        .zip(settings.steps_per_mm, |rate, resolution| {
            f64::from(rate) / 60.0 * f64::from(resolution.to_f32())
        })
}

/// Follows the path with the steps, in order; the largest distance of an axis, in steps.
///
/// # Panics
/// When the steps leave the path by more than half a step, what an event's shift makes, and
/// `slack` steps, or do not end at its end. An axis that has to wait to step back is a step behind.
pub(crate) fn check_path(
    settings: &Settings,
    commands: &[Command],
    trace: &Trace,
    slack: f64,
) -> f64 {
    let pieces = pieces(settings, commands);
    let (worst, position) = follow(settings, &pieces, trace, slack);
    if let Some(end) = commands.iter().rev().find_map(target) {
        assert_eq!(position, target_steps(settings, &end), "final position");
    }
    worst
}

/// Follows pieces of path with the steps; the largest distance of an axis, and the position, in
/// steps.
///
/// # Panics
/// When the steps leave the path by more than half a step, what an event's shift makes, and `slack`
/// steps.
pub(crate) fn follow(
    settings: &Settings,
    pieces: &[Piece],
    trace: &Trace,
    slack: f64,
) -> (f64, Axes<i32>) {
    let rates = step_rates(settings);
    let least: Point = std::array::from_fn(|n| 0.5 + SEARCH + slack + rates[n] * SHIFT_S);
    let waits: [Vec<Range<u64>>; AXES] = std::array::from_fn(|axis| trace.waits(axis));
    let mut position = Axes::all(0_i32);
    let (mut piece, mut share) = (0, 0.0);
    let mut worst = 0.0_f64;
    for edge in trace.edges.iter().filter(|edge| edge.raise != 0) {
        add_steps(&mut position, edge);
        let limit: Point = std::array::from_fn(|n| {
            let next = waits[n].partition_point(|wait| wait.end <= edge.ticks);
            let is_waiting = waits[n]
                .get(next)
                .is_some_and(|it| it.contains(&edge.ticks));
            least[n] + if is_waiting { 1.0 } else { 0.0 }
        });
        // The tolerance of a coarse axis, and its next step, are many steps of a fine one.
        let mut tries = 0.0;
        loop {
            let here = pieces[piece].at(share);
            let off = |n: usize| (here[n] - f64::from(position[n])).abs();
            if (0..AXES).all(|n| off(n) <= limit[n]) {
                worst = (0..AXES).map(off).fold(worst, f64::max);
                break;
            }
            tries += GRAIN;
            assert!(
                tries < 60.0 + 4.0 * pieces[piece].length.sqrt(),
                "{position:?} is off the path, {here:?} at {share} of move {piece}, {edge:?}"
            );
            let next = GRAIN / pieces[piece].length.max(GRAIN);
            if share >= 1.0 && piece + 1 < pieces.len() {
                (piece, share) = (piece + 1, 0.0);
            } else {
                share = (share + next).min(1.0);
            }
        }
    }
    (worst, position)
}

/// A move too short for a step becomes part of the next: that one's path begins up to a step off.
pub(crate) fn slack(settings: &Settings, commands: &[Command]) -> f64 {
    let mut before = Axes::all(0);
    let mut has_shifted = false;
    for target in commands.iter().filter_map(target) {
        let steps = target_steps(settings, &target);
        has_shifted |= steps == before;
        before = steps;
    }
    if has_shifted { 1.0 } else { 0.0 }
}
