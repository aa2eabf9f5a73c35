//! What is measured of one axis, or of the way along the path.

use leadscrew::axis::AXES;

use super::{
    Smoothness,
    fit::Crossing,
    intervals::{IntervalError, Intervals},
    sweep::{Measured, Sought, Sweep},
};
use crate::series::Series;

/// A gap this many times longer than the one beside it is a standstill. The longest in a motion of
/// constant acceleration is 2/(√2 - 1) = 4.83 times as long: where the axis turns just before the
/// next step.
const STANDSTILL: f64 = 5.5;
/// Shorter gaps are none, s.
const SHORT_S: f64 = 0.001;

/// The crossings of one axis, and what is measured on them.
pub(super) struct Track {
    /// Of an axis: the newest crossing, which may already be behind a corner, or the first behind one,
    /// which may be before it: a path that is rounded to steps does not say it to a step.
    held: Option<Crossing>,
    is_first: bool,
    is_axis: bool,
    last: Option<Crossing>,
    /// Between the last two crossings, s.
    gap_s: Option<f64>,
    has_moved: bool,
    speed: Sweep,
    acceleration: Sweep,
    jerk: Sweep,
    jump: Sweep,
    /// Of the path: how the steps of all axes fit its speed.
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
        let sweep = |sought| Sweep::new(sought, scale);
        Self {
            held: None,
            is_first: false,
            is_axis: intervals.is_none(),
            last: None,
            gap_s: None,
            has_moved: false,
            speed: sweep(Sought::Speed),
            acceleration: sweep(Sought::Acceleration),
            jerk: sweep(Sought::Jerk),
            jump: sweep(Sought::Jump),
            intervals,
            accelerations: Series::default(),
            jerks: Series::default(),
        }
    }

    pub(super) const fn has_moved(&self) -> bool {
        self.has_moved
    }

    /// What comes after has nothing to do with what came before.
    pub(super) fn cut(&mut self) {
        self.last = None;
        self.gap_s = None;
        for sweep in [
            &mut self.speed,
            &mut self.acceleration,
            &mut self.jerk,
            &mut self.jump,
        ] {
            sweep.cut();
        }
        if let Some(intervals) = &mut self.intervals {
            intervals.cut();
        }
    }

    /// The path turns: as [`Self::cut`], and the crossings on both sides of the corner are left out.
    pub(super) fn turn(&mut self) {
        self.cut();
        self.held = None;
        self.is_first = true;
    }

    /// The axis changes its speed in a corner that is judged as one, mm/s.
    pub(super) fn allow(&mut self, seconds: f64, jump_mm_s: f64) {
        for sweep in [&mut self.acceleration, &mut self.jerk, &mut self.jump] {
            sweep.allow(seconds, jump_mm_s);
        }
    }

    /// Takes the next crossing; the speed over the window that ends with it, if one does.
    pub(super) fn push(&mut self, crossing: Crossing) -> Option<Measured> {
        self.has_moved = true;
        if !self.is_axis {
            return self.follow(crossing);
        }
        if std::mem::take(&mut self.is_first) {
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
                self.cut();
            } else if shorter && self.gap_s > Some(SHORT_S) {
                self.cut();
                self.take(last);
                self.gap_s = Some(gap_s);
            } else {
                self.gap_s = Some(gap_s);
            }
        }
        self.take(crossing)
    }

    /// An axis steps, forward or back, while the path has been followed for so many mm, if that is known.
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
        if let Some(measured) = self.jerk.push(crossing) {
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

/// What was measured.
pub(super) struct Finished {
    pub(super) smoothness: Smoothness,
    /// Of the path: those of each axis.
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
