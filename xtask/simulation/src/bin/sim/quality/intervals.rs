//! Errors of the time between two steps against the ideal time of the motion along the path.
//!
//! The ideal profile is the distance along the programmed path as a smooth function of time. The
//! function is fitted to the steps of the dominant axis. A step of an axis is ideally due when the
//! distance reaches the point where the path crosses the middle between two steps of the axis.

use std::collections::VecDeque;

use leadscrew::axis::AXES;
use serde::Serialize;

use super::fit::{Crossing, Fit};

/// Shortest window of the smooth motion, s.
const WINDOW_S: f64 = 0.01;
/// Minimum number of crossings of a window.
const CROSSINGS: usize = 17;
/// Minimum number of crossings between two interruptions for any judgement.
const FEWEST: usize = 9;

/// Tolerance at which the search for the ideal time ends, mm.
const CONVERGED_MM: f64 = 1.0e-6;

/// Bins of the distribution for each factor of 10 of the error, and the least error.
const BINS_PER_DECADE: f64 = 100.0;
const LEAST_ERROR: f64 = 1.0e-7;
const BINS: usize = 901;

/// Errors of the intervals between the steps of an axis, as parts of the ideal interval.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct IntervalError {
    /// Root of the mean square.
    pub(crate) rms: f64,
    /// The error that 99.9 % of the intervals do not exceed.
    pub(crate) p999: f64,
    /// The greatest error.
    pub(crate) worst: f64,
    /// Number of intervals that were judged.
    pub(crate) intervals: u64,
    /// Number of steps without a judgement: off the path, nearly at right angles to the path, or with
    /// too few steps between two standstills.
    pub(crate) unjudged: u64,
}

/// A step of an axis and the distance along the path at which the step is due.
#[derive(Debug, Clone, Copy)]
struct Due {
    axis: usize,
    sign: i32,
    seconds: f64,
    mm: f64,
}

/// The errors of one axis.
#[derive(Debug, Clone)]
struct Errors {
    /// The last step that was judged, and its ideal time, s.
    last: Option<(Due, f64)>,
    squares: f64,
    worst: f64,
    bins: Vec<u64>,
    judged: u64,
    unjudged: u64,
}

/// Judges the steps of all axes in their order.
#[derive(Debug, Clone)]
pub(super) struct Intervals {
    /// The distance along the path.
    path: VecDeque<Crossing>,
    /// Steps that are not judged yet.
    open: VecDeque<Due>,
    axes: [Errors; AXES],
}

impl Intervals {
    pub(super) fn new() -> Self {
        let errors = || Errors {
            last: None,
            squares: 0.0,
            worst: 0.0,
            bins: vec![0; BINS],
            judged: 0,
            unjudged: 0,
        };
        Self {
            path: VecDeque::new(),
            open: VecDeque::new(),
            axes: std::array::from_fn(|_| errors()),
        }
    }

    /// Takes a step of an axis with its distance along the path, if known. Call after [`Self::push`].
    pub(super) fn step(&mut self, (axis, sign): (usize, i32), seconds: f64, mm: Option<f64>) {
        if let Some(mm) = mm {
            self.open.push_back(Due {
                axis,
                sign,
                seconds,
                mm,
            });
        } else {
            self.axes[axis].unjudged += 1;
        }
    }

    /// Takes a distance along the path.
    pub(super) fn push(&mut self, crossing: Crossing) {
        self.path.push_back(crossing);
        let length = self.path.len();
        if length < CROSSINGS || crossing.seconds - self.path[0].seconds < WINDOW_S {
            return;
        }
        self.judge(self.path[length * 3 / 4].seconds);
        self.path.drain(..length / 2);
    }

    /// Separates the following motion from the motion so far.
    pub(super) fn interrupt(&mut self) {
        if self.path.len() >= FEWEST {
            self.judge(self.path[self.path.len() - 1].seconds);
        }
        for due in self.open.drain(..) {
            self.axes[due.axis].unjudged += 1;
        }
        self.path.clear();
        for axis in &mut self.axes {
            axis.last = None;
        }
    }

    /// Judges the steps up to a time.
    fn judge(&mut self, until: f64) {
        let Some(fit) = Fit::new(&self.path.iter(), 3) else {
            return;
        };
        let from = self.path[0].seconds;
        while let Some(due) = self
            .open
            .front()
            .copied()
            .filter(|due| due.seconds <= until)
        {
            self.open.pop_front();
            let errors = &mut self.axes[due.axis];
            let Some(ideal_s) = ideal_s(&fit, &due) else {
                errors.unjudged += 1;
                errors.last = None;
                continue;
            };
            // Where an axis reverses, its two steps bound no interval.
            let last = errors.last.filter(|(last, _)| last.sign == due.sign);
            if let Some((last, last_ideal_s)) = last {
                // One fit serves both where both lie in its window.
                let again = (last.seconds >= from).then(|| self::ideal_s(&fit, &last));
                let before_s = again.flatten().unwrap_or(last_ideal_s);
                let interval_s = ideal_s - before_s;
                if interval_s > 0.0 {
                    errors.add(((due.seconds - last.seconds) / interval_s - 1.0).abs());
                } else {
                    errors.unjudged += 1;
                }
            }
            errors.last = Some((due, ideal_s));
        }
    }

    pub(super) fn finish(mut self) -> [IntervalError; AXES] {
        self.interrupt();
        self.axes.map(|axis| axis.finish())
    }
}

impl Errors {
    fn add(&mut self, error: f64) {
        self.judged += 1;
        self.squares += error * error;
        self.worst = self.worst.max(error);
        let decades = (error.max(LEAST_ERROR) / LEAST_ERROR).log10();
        let bin = (decades * BINS_PER_DECADE) as usize;
        self.bins[bin.min(BINS - 1)] += 1;
    }

    fn finish(&self) -> IntervalError {
        let enough = (self.judged as f64 * 0.999).ceil() as u64;
        let mut count = 0;
        let bin = self.bins.iter().position(|bin| {
            count += bin;
            count >= enough
        });
        let upper = (bin.unwrap_or(0) + 1) as f64 / BINS_PER_DECADE;
        IntervalError {
            rms: (self.squares / self.judged.max(1) as f64).sqrt(),
            p999: (LEAST_ERROR * 10.0_f64.powf(upper)).min(self.worst),
            worst: self.worst,
            intervals: self.judged,
            unjudged: self.unjudged,
        }
    }
}

/// The time at which the smooth motion reaches a distance (Newton); `None` at a standstill.
fn ideal_s(fit: &Fit, due: &Due) -> Option<f64> {
    let mut seconds = due.seconds;
    for _ in 0..4 {
        let speed = fit.speed(seconds);
        if speed <= 0.0 {
            return None;
        }
        seconds += (due.mm - fit.position(seconds)) / speed;
    }
    let is_there = (fit.position(seconds) - due.mm).abs() < CONVERGED_MM;
    is_there.then_some(seconds)
}
