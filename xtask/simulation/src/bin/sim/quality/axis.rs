//! Measurements of one axis, or of the distance along the path.

use std::mem;

use leadscrew::axis::AXES;

use super::{
    Smoothness,
    fit::Crossing,
    intervals::{IntervalError, Intervals},
    sweep::{Measurand, Measured, Sweep},
};
use crate::series::Series;

/// Ratio of a gap to its neighbour from which the gap is a standstill.
///
/// The maximum in a motion of constant acceleration is 2/(√2 - 1) = 4.83, where the axis reverses
/// just before the next step.
const STANDSTILL: f64 = 5.5;
/// Minimum duration of a standstill, s.
const SHORT_S: f64 = 0.001;

/// The crossings of one axis and their measurements.
pub(super) struct Track {
    /// The newest crossing of an axis, or the first crossing after a corner.
    ///
    /// The side of the corner is uncertain by one step: the path is rounded to steps.
    held: Option<Crossing>,
    is_first: bool,
    /// The position of the first crossing after a corner: an axis that steps back over it is as uncertain then.
    first_position: Option<f64>,
    is_axis: bool,
    last: Option<Crossing>,
    /// Between the last two crossings, s.
    gap_s: Option<f64>,
    has_moved: bool,
    speed: Sweep,
    acceleration: Sweep,
    jerk: Sweep,
    jump: Sweep,
    /// The deviations of the steps of all axes from the speed of the path.
    intervals: Option<Intervals>,
    accelerations: Series,
    jerks: Series,
}

impl Track {
    /// An axis: positions in steps.
    pub(super) fn of_axis(steps_per_mm: f64) -> Self {
        Self::new(steps_per_mm, None)
    }

    /// The path: positions in mm.
    pub(super) fn of_path() -> Self {
        Self::new(1.0, Some(Intervals::new()))
    }

    fn new(scale: f64, intervals: Option<Intervals>) -> Self {
        let sweep = |measurand| Sweep::new(measurand, scale);
        Self {
            held: None,
            is_first: false,
            first_position: None,
            is_axis: intervals.is_none(),
            last: None,
            gap_s: None,
            has_moved: false,
            speed: sweep(Measurand::Speed),
            acceleration: sweep(Measurand::Acceleration),
            jerk: sweep(Measurand::Jerk),
            jump: sweep(Measurand::Jump),
            intervals,
            accelerations: Series::default(),
            jerks: Series::default(),
        }
    }

    pub(super) const fn has_moved(&self) -> bool {
        self.has_moved
    }

    /// Separates the following motion from the motion so far.
    pub(super) fn interrupt(&mut self) {
        self.last = None;
        self.gap_s = None;
        for sweep in [
            &mut self.speed,
            &mut self.acceleration,
            &mut self.jerk,
            &mut self.jump,
        ] {
            sweep.interrupt();
        }
        if let Some(intervals) = &mut self.intervals {
            intervals.interrupt();
        }
    }

    /// Separates the motion at a corner, as [`Self::interrupt`], without the crossings on both sides of the corner. The
    /// path goes on there but for its jerk, which is told without the first crossing.
    pub(super) fn turn(&mut self) {
        if self.is_axis {
            self.interrupt();
            self.held = None;
        } else {
            self.jerk.interrupt();
        }
        self.is_first = true;
    }

    /// Allows the jumps of speed and acceleration of the axis between two pieces, mm/s and mm/s².
    pub(super) fn allow(&mut self, seconds: f64, jumps: [f64; 2]) {
        for sweep in [&mut self.acceleration, &mut self.jerk, &mut self.jump] {
            sweep.allow(seconds, jumps);
        }
    }

    /// Takes the next crossing. Returns the speed over the window that ends with the crossing, if a window does.
    pub(super) fn push(&mut self, crossing: Crossing) -> Option<Measured> {
        self.has_moved = true;
        if !self.is_axis {
            return self.follow(crossing);
        }
        if mem::take(&mut self.is_first) {
            self.first_position = Some(crossing.position);
            return None;
        }
        if self.first_position.take() == Some(crossing.position) {
            return None;
        }
        let before = self.held.replace(crossing)?;
        self.follow(before)
    }

    fn follow(&mut self, crossing: Crossing) -> Option<Measured> {
        if let Some(last) = self.last {
            let gap_s = crossing.seconds - last.seconds;
            let longer = self.gap_s.is_some_and(|gap| gap_s > STANDSTILL * gap);
            let shorter = self.gap_s.is_some_and(|gap| gap > STANDSTILL * gap_s);
            if longer && gap_s > SHORT_S {
                self.interrupt();
            } else if shorter && self.gap_s > Some(SHORT_S) {
                self.interrupt();
                self.take(last);
                self.gap_s = Some(gap_s);
            } else {
                self.gap_s = Some(gap_s);
            }
        }
        self.take(crossing)
    }

    /// Takes a step of an axis, with the distance along the path, if known, mm.
    pub(super) fn step(&mut self, axis: (usize, i32), seconds: f64, mm: Option<f64>) {
        if let Some(intervals) = &mut self.intervals {
            intervals.step(axis, seconds, mm);
        }
    }

    fn take(&mut self, crossing: Crossing) -> Option<Measured> {
        self.last = Some(crossing);
        if let Some(intervals) = &mut self.intervals {
            intervals.push(crossing);
        }
        self.jump.push(crossing);
        if let Some(measured) = self.acceleration.push(crossing) {
            add(&mut self.accelerations, &measured);
        }
        // Of the path: an axis has left it out.
        let is_uncertain = mem::take(&mut self.is_first);
        if !is_uncertain && let Some(measured) = self.jerk.push(crossing) {
            add(&mut self.jerks, &measured);
        }
        self.speed.push(crossing)
    }

    pub(super) fn finish(self) -> Finished {
        Finished {
            smoothness: Smoothness {
                speed_jump_mm_s: self.jump.peak,
                acceleration_mm_s2: self.acceleration.peak,
                jerk_mm_s3: self.jerk.peak,
            },
            interval_errors: self.intervals.map(Intervals::finish).unwrap_or_default(),
            accelerations: self.accelerations,
            jerks: self.jerks,
        }
    }
}

/// Returns the measurements.
pub(super) struct Finished {
    pub(super) smoothness: Smoothness,
    /// The measurements of each axis along the path.
    pub(super) interval_errors: [IntervalError; AXES],
    pub(super) accelerations: Series,
    pub(super) jerks: Series,
}

/// Draws a value over the quarter of its window in the middle: windows overlap.
fn add(series: &mut Series, measured: &Measured) {
    let middle = f64::midpoint(measured.from_s, measured.to_s);
    let eighth = (measured.to_s - measured.from_s) / 8.0;
    series.push(middle - eighth, middle + eighth, measured.value);
}
