//! A run as pictures show it: its path, and least and greatest values over time, in bounded memory.

use std::{array, collections::VecDeque, ops::Range};

use leadscrew::{
    axis::{AXES, LINEAR, X, Y},
    model::Outputs,
    settings::Settings,
};

use crate::{
    series::Series,
    steps_per_mm,
    trace::{Move, Row},
};

/// Between two samples, ns.
const SPACING_NS: u64 = 1_000_000;
const SPACING_S: f64 = SPACING_NS as f64 * 1e-9;
/// The longest interval of steps that is no standstill for sure, ns.
const SLOWEST_NS: u64 = 250_000_000;
/// Samples on either side of one over which its acceleration and its speed are fitted.
const REACH: usize = 8;
const SPEED_REACH: usize = 2;
/// Most points of a path.
const POINTS: usize = 1 << 17;
/// What moves more slowly stands still, mm/s.
const STANDSTILL_MM_S: f64 = 1e-6;

/// One axis between its step times.
///
/// An axis is halfway when it steps, and moves evenly from there to the next step.
#[derive(Debug, Clone, Default)]
struct Column {
    /// Positions at sample times, steps.
    pending: VecDeque<f64>,
    /// Sample times so far.
    count: u64,
    /// Steps after the newest event.
    steps: i32,
    /// The end of what is known, ns and steps.
    newest: (u64, f64),
    /// Time of the newest step, and between the newest two, ns.
    stepped: u64,
    interval: u64,
}

impl Column {
    /// Fills the samples up to `until` along a straight line.
    fn line_to(&mut self, until: u64, position: f64) {
        let (start, from) = self.newest;
        let length = until.saturating_sub(start).max(1) as f64;
        while self.count * SPACING_NS <= until {
            let at = self.count * SPACING_NS;
            let share = at.saturating_sub(start) as f64 / length;
            self.pending
                .push_back(from + (position - from) * share.min(1.0));
            self.count += 1;
        }
        if until >= start {
            self.newest = (until, position);
        }
    }

    /// Time from the last step to a standstill, ns: with constant acceleration, 1.37 times the interval
    /// before, √1 / (√3 - √1).
    const fn ramp(&self) -> u64 {
        self.interval + self.interval * 3 / 8
    }

    /// Takes note that a time comes without a step. A gap of several ramps is a standstill.
    fn wait(&mut self, time: u64) {
        let ramp = self.ramp();
        if time - self.stepped > 4 * ramp.max(SPACING_NS) {
            self.line_to(self.stepped + ramp, self.steps.into());
            self.line_to(time - ramp, self.steps.into());
        }
    }

    fn step(&mut self, time: u64, steps: i32) {
        self.wait(time);
        self.interval = (time - self.stepped).min(SLOWEST_NS);
        self.line_to(time, f64::from(self.steps + steps) / 2.0);
        (self.stepped, self.steps) = (time, steps);
    }
}

/// A place of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    /// When, s from the first step.
    pub(crate) seconds: f64,
    /// Position, mm or degrees.
    pub(crate) at: [f64; AXES],
    /// Speed along the path, mm/s.
    pub(crate) speed: f64,
    pub(crate) is_rapid: bool,
}

/// What moves show over time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motion {
    /// The path, with a point for each of some ms.
    pub(crate) path: Vec<Point>,
    /// Speed along the path in feed moves and in rapids, mm/s: of the linear axes where one moves, and
    /// of the rotary axes otherwise, degrees/s.
    pub(crate) speeds: [Series; 2],
    /// Acceleration of each axis, mm/s² or degrees/s².
    pub(crate) accelerations: [Series; AXES],
    /// Position of each axis, mm or degrees.
    pub(crate) positions: [Series; AXES],
    /// Output of spindle or laser, percent of the whole.
    pub(crate) power: Series,
    /// Time in motion in feed moves and in rapids, s.
    pub(crate) seconds: [f64; 2],
    /// Least and greatest position of each axis, mm or degrees.
    pub(crate) extents: [(f64, f64); AXES],
    /// Length of the motion, s.
    pub(crate) duration_s: f64,
}

impl Motion {
    /// Returns whether an axis moves at all.
    pub(crate) fn moves(&self, axis: usize) -> bool {
        let (least, greatest) = self.extents[axis];
        greatest > least
    }

    /// Returns the axes that move, of some.
    pub(crate) fn moving(&self, axes: Range<usize>) -> impl Iterator<Item = usize> {
        axes.filter(|axis| self.moves(*axis))
    }
}

/// Positions of all axes at a sample time, mm or degrees.
type Sample = ([f64; AXES], Move);

/// Takes the events of a run, and makes samples of them.
#[derive(Debug, Clone)]
pub(crate) struct Samples {
    steps_per_mm: [f64; AXES],
    /// Steps in the places of X and Y are those of the motors of `CoreXY`.
    is_core_xy: bool,
    columns: [Column; AXES],
    moves: VecDeque<Move>,
    /// Moves so far, one for each sample time.
    count: u64,
    end_ns: u64,
    /// Those around the one that is measured next.
    window: VecDeque<Sample>,
    measured: u64,
    /// Samples for each point of the path.
    stride: u64,
    motion: Motion,
}

impl Samples {
    /// Returns those of a machine at the origin.
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            steps_per_mm: steps_per_mm(settings),
            is_core_xy: settings.core_xy,
            columns: Default::default(),
            moves: VecDeque::new(),
            count: 0,
            end_ns: 0,
            window: VecDeque::new(),
            measured: 0,
            stride: 1,
            motion: Motion::default(),
        }
    }

    /// Takes one event. Events come in the order of time.
    pub(crate) fn push(&mut self, row: &Row) {
        self.end_ns = row.time_ns;
        for (axis, column) in self.columns.iter_mut().enumerate() {
            if row.steps[axis] == column.steps {
                column.wait(row.time_ns);
            } else {
                column.step(row.time_ns, row.steps[axis]);
            }
        }
        let steps = array::from_fn(|axis| f64::from(row.steps[axis]));
        let here = self.position(steps).into_iter();
        for ((least, greatest), at) in self.motion.extents.iter_mut().zip(here) {
            (*least, *greatest) = (least.min(at), greatest.max(at));
        }
        while self.count * SPACING_NS <= row.time_ns {
            self.moves.push_back(row.of);
            self.count += 1;
        }
        self.measure();
    }

    /// Returns where the axes are, mm or degrees, for the steps of the motors.
    fn position(&self, steps: [f64; AXES]) -> [f64; AXES] {
        let mut at: [f64; AXES] = array::from_fn(|axis| steps[axis] / self.steps_per_mm[axis]);
        if self.is_core_xy {
            [at[X], at[Y]] = [0.5 * (at[X] + at[Y]), 0.5 * (at[X] - at[Y])];
        }
        at
    }

    /// Measures what all axes are known for.
    fn measure(&mut self) {
        let known = self.columns.iter().map(|column| column.pending.len());
        let known = known.fold(self.moves.len(), usize::min);
        for _ in 0..known {
            let steps = array::from_fn(|axis| {
                let steps = self.columns[axis].pending.pop_front();
                steps.unwrap_or_default()
            });
            let at = self.position(steps);
            let of = self.moves.pop_front().unwrap_or_default();
            if self.window.is_empty() {
                // At rest before the first step.
                self.window.extend([(at, of); REACH]);
            }
            self.take((at, of));
        }
    }

    /// Takes a sample, and measures the middle sample of the window that the sample ends.
    fn take(&mut self, sample: Sample) {
        self.window.push_back(sample);
        if self.window.len() <= 2 * REACH {
            return;
        }
        let (at, of) = self.window[REACH];
        let from_s = self.measured as f64 * SPACING_S;
        let to_s = from_s + 0.9 * SPACING_S;
        let motion = &mut self.motion;
        let kind = usize::from(of.is_rapid);
        let [mut linear, mut rotary] = [0.0_f64; 2];
        for (axis, position) in at.into_iter().enumerate() {
            let (speed, _) = derivatives(&self.window, axis, SPEED_REACH);
            let (_, acceleration) = derivatives(&self.window, axis, REACH);
            motion.accelerations[axis].push(from_s, to_s, acceleration);
            if axis < LINEAR {
                linear = linear.hypot(speed);
            } else {
                rotary = rotary.hypot(speed);
            }
            motion.positions[axis].push(from_s, to_s, position);
        }
        let speed = if linear > STANDSTILL_MM_S {
            linear
        } else {
            rotary
        };
        motion.speeds[kind].push(from_s, to_s, speed);
        let power = f64::from(of.duty) / f64::from(Outputs::FULL) * 100.0;
        motion.power.push(from_s, to_s, power);
        if speed > STANDSTILL_MM_S {
            motion.seconds[kind] += SPACING_S;
        }
        motion.duration_s = from_s;
        if self.measured.is_multiple_of(self.stride) {
            motion.path.push(Point {
                seconds: from_s,
                at,
                speed,
                is_rapid: of.is_rapid,
            });
            if motion.path.len() == POINTS {
                let mut index = 0;
                motion.path.retain(|_| {
                    index += 1;
                    index % 2 == 1
                });
                self.stride *= 2;
            }
        }
        self.measured += 1;
        self.window.pop_front();
    }

    /// Returns what all of them show, up to the rest of the slowest axis.
    pub(crate) fn finish(mut self) -> Motion {
        let ends = self.columns.iter();
        let end = ends.map(|column| column.stepped + column.ramp());
        let end = end
            .fold(self.end_ns, u64::max)
            .min(self.end_ns + 20_000_000)
            + SPACING_NS;
        for column in &mut self.columns {
            let standstill = (column.stepped + column.ramp()).min(end);
            column.line_to(standstill, column.steps.into());
            column.line_to(end, column.steps.into());
        }
        let newest = self.moves.back().copied().unwrap_or_default();
        let missing = (end / SPACING_NS + 1).saturating_sub(self.count);
        self.moves.extend((0..missing).map(|_| newest));
        self.measure();
        if let Some(last) = self.window.back().copied() {
            for _ in 0..REACH {
                self.take(last);
            }
        }
        self.motion
    }
}

/// Returns speed and acceleration of an axis in the middle of a window, mm/s and mm/s²: a parabola is
/// fitted to the samples within `reach` (least squares, Savitzky and Golay 1964).
fn derivatives(window: &VecDeque<Sample>, axis: usize, reach: usize) -> (f64, f64) {
    let middle = window[REACH].0[axis];
    let [mut odd, mut even, mut all, mut s2, mut s4] = [0.0; 5];
    for (index, (at, _)) in window
        .iter()
        .enumerate()
        .skip(REACH - reach)
        .take(2 * reach + 1)
    {
        let place = index as f64 - REACH as f64;
        let (square, value) = (place * place, at[axis] - middle);
        odd += place * value;
        even += square * value;
        all += value;
        s2 += square;
        s4 += square * square;
    }
    let n = (2 * reach + 1) as f64;
    let curvature = (n * even - s2 * all) / (n * s4 - s2 * s2);
    (
        odd / s2 / SPACING_S,
        2.0 * curvature / (SPACING_S * SPACING_S),
    )
}

#[cfg(test)]
mod tests {
    use leadscrew::axis::X;

    use super::*;

    fn row(time_ns: u64, x: i32) -> Row {
        let mut steps = [0; AXES];
        steps[X] = x;
        Row {
            time_ns,
            steps,
            of: Move::default(),
        }
    }

    fn samples(steps_per_mm: f64) -> Samples {
        Samples {
            steps_per_mm: [steps_per_mm; AXES],
            ..Samples::new(&Settings::default())
        }
    }

    /// A move from rest to rest: 50 mm/s reached with 1000 mm/s², 80 steps/mm.
    fn trapezoid() -> (Vec<Row>, f64) {
        let (speed, acceleration, scale, steps) = (50.0_f64, 1000.0, 80.0, 1600);
        let length = f64::from(steps) / scale;
        let ramp = speed * speed / 2.0 / acceleration;
        let total = 2.0 * speed / acceleration + (length - 2.0 * ramp) / speed;
        let time_at = |mm: f64| {
            if mm < ramp {
                (2.0 * mm / acceleration).sqrt()
            } else if mm <= length - ramp {
                speed / acceleration + (mm - ramp) / speed
            } else {
                total - (2.0 * (length - mm) / acceleration).sqrt()
            }
        };
        let first = time_at(0.5 / scale);
        let rows = (1..=steps).map(|step| {
            let time = time_at((f64::from(step) - 0.5) / scale) - first;
            row((time * 1e9) as u64, step)
        });
        (rows.collect(), total)
    }

    #[test]
    fn speed_and_acceleration_of_a_trapezoid_are_found() {
        let (rows, total) = trapezoid();
        let mut samples = samples(80.0);
        for row in &rows {
            samples.push(row);
        }
        let motion = samples.finish();
        assert!((motion.duration_s - total).abs() < 0.02);
        assert!((motion.seconds[0] - total).abs() < 0.02);
        let fastest = motion.speeds[0].greatest();
        assert!((fastest - 50.0).abs() < 0.1, "{fastest}");
        for time in [0.015, 0.025, 0.035] {
            let acceleration = motion.accelerations[X].greatest_at(time).unwrap();
            assert!((acceleration - 1000.0).abs() < 30.0, "{acceleration}");
        }
        let middle = motion.accelerations[X].greatest_at(total / 2.0).unwrap();
        assert!(middle.abs() < 5.0, "{middle}");
        assert_eq!(motion.extents[X], (0.0, 20.0));
    }

    #[test]
    fn a_long_program_takes_bounded_memory_and_keeps_its_speeds() {
        let mut samples = samples(1.0);
        for step in 0..300_000 {
            samples.push(&row(step as u64 * 1_000_000, step));
        }
        let buffered = |column: &Column| column.pending.len() < 100;
        assert!(samples.columns.iter().all(buffered));
        let motion = samples.finish();
        assert!(motion.path.len() <= POINTS);
        assert!((motion.duration_s - 300.0).abs() < 0.5);
        assert!((motion.speeds[0].greatest() - 1000.0).abs() < 1.0);
        assert!(!motion.moves(1));
    }

    #[test]
    fn a_pause_is_no_slow_motion() {
        let mut samples = samples(1.0);
        for step in 0..100 {
            samples.push(&row(step * 1_000_000, step as i32 + 1));
        }
        samples.push(&row(2_000_000_000, 101));
        let motion = samples.finish();
        assert!(motion.speeds[0].greatest_at(1.0).unwrap() < 1e-9);
        assert!((motion.path[1000].at[X] - 100.0).abs() < 1e-9);
        assert!(motion.seconds[0] < 0.13, "{:?}", motion.seconds);
    }

    #[test]
    fn an_axis_that_moves_with_a_faster_one_keeps_its_slow_speed() {
        let mut samples = samples(1.0);
        let mut steps = [0; AXES];
        for event in 1..20_000_u64 {
            // X steps every 7 ms, Y every 0.1 ms.
            steps[0] += i32::from(event % 70 == 0);
            steps[1] += 1;
            samples.push(&Row {
                steps,
                ..row(event * 100_000, 0)
            });
        }
        let motion = samples.finish();
        let slow = &motion.accelerations[X];
        let greatest = slow.greatest_at(1.0).unwrap();
        assert!(greatest < 1.0, "{greatest}");
        assert!((motion.path[1000].at[X] - 1000.0 / 7.0).abs() < 0.51);
    }

    #[test]
    fn rapids_and_power_are_distinguished() {
        let mut samples = samples(1.0);
        for step in 0..200_u64 {
            samples.push(&Row {
                of: Move {
                    is_rapid: step >= 100,
                    duty: if step < 100 { Outputs::FULL / 2 } else { 0 },
                },
                ..row(step * 1_000_000, step as i32)
            });
        }
        let motion = samples.finish();
        let [feed, rapid] = &motion.speeds;
        assert!(feed.greatest_at(0.05).is_some() && rapid.greatest_at(0.05).is_none());
        assert!(feed.greatest_at(0.15).is_none() && rapid.greatest_at(0.15).is_some());
        assert!((motion.seconds[0] - motion.seconds[1]).abs() < 0.01);
        assert_eq!(motion.power.greatest_at(0.05), Some(50.0));
        assert_eq!(motion.power.greatest_at(0.15), Some(0.0));
        assert!(!motion.path[50].is_rapid && motion.path[150].is_rapid);
    }
}
