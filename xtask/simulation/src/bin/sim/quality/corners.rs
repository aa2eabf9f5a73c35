//! How fast corners are passed.

use std::collections::VecDeque;

use leadscrew::axis::AXES;
use serde::Serialize;

use super::{
    fit::{Crossing, Fit},
    follow::Passed,
    geometry::{Point, norm},
};

/// A change of direction that counts as a corner, rad: 5°.
const CORNER_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Duration on either side of a corner over which the speed is fitted, s.
const SIDE_S: f64 = 0.004;
/// Minimum number of crossings of a side for a speed.
const FEWEST_OF_SIDE: usize = 5;
/// Number of crossings of a side that ends the wait, and the maximum number that is kept.
const FEWEST: usize = 8;
const MOST: usize = 256;
/// Maximum number of corners that are kept one by one.
const KEPT: usize = 10_000;

/// A corner of the program.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct CornerSpeed {
    /// The programmed place, mm in machine coordinates.
    pub(crate) at_mm: Vec<f64>,
    /// Change of direction, degrees.
    pub(crate) turn_degrees: f64,
    /// Speed along the path in the corner, mm/s.
    pub(crate) speed_mm_s: f64,
    /// The speed that the junction deviation allows, mm/s.
    pub(crate) allowed_mm_s: f64,
    /// Jump of the velocity at the measured speed, mm/s.
    pub(crate) jump_mm_s: f64,
    /// The corner was rounded.
    pub(crate) is_rounded: bool,
}

/// All corners of a program.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Corners {
    /// Number of corners without stops.
    pub(crate) count: u64,
    /// Number of corners whose speed could be measured.
    pub(crate) measured: u64,
    /// Number of corners that were rounded.
    pub(crate) rounded: u64,
    /// Least speed, mm/s.
    pub(crate) slowest_mm_s: Option<f64>,
    /// Greatest speed, mm/s.
    pub(crate) fastest_mm_s: Option<f64>,
    /// The greatest ratio of the speed in a corner to its allowed speed.
    ///
    /// Rounded corners do not count, nor corners whose allowed speed an acceleration from standstill
    /// reaches within one step.
    pub(crate) most_of_allowed: Option<f64>,
    /// The first ten thousand corners.
    pub(crate) list: Vec<CornerSpeed>,
}

/// A corner whose exit has not been measured yet.
#[derive(Debug)]
struct Open {
    passed: Passed,
    /// Time, s, and speed, mm/s, at the entry.
    entry_speed: Option<(f64, f64)>,
    exit: Vec<Crossing>,
    /// The time at which a rounded corner was passed, s.
    at_s: f64,
}

/// Measures corners as they come.
#[derive(Debug, Default)]
pub(super) struct Meter {
    /// The distances along the path, newest last.
    path: VecDeque<Crossing>,
    /// Positions of all axes after each event, mm.
    places: VecDeque<(f64, Point)>,
    open: Option<Open>,
    /// The distance of the newest corner along the path, mm.
    begun_mm: Option<f64>,
    rounded: VecDeque<Open>,
    /// Minimum speed at which a corner is distinguished from a path one step off, mm/s.
    resolved_mm_s: f64,
    pub(super) corners: Corners,
}

impl Meter {
    /// A meter whose steps resolve corners down to a speed.
    pub(super) fn new(resolved_mm_s: f64) -> Self {
        Self {
            resolved_mm_s,
            ..Self::default()
        }
    }

    /// Takes the position of the machine.
    pub(super) fn place(&mut self, seconds: f64, at: Point) {
        self.places.push_back((seconds, at));
        let old = seconds - 3.0 * SIDE_S;
        while self.places.front().is_some_and(|(at, _)| *at < old) || self.places.len() > 4 * MOST {
            self.places.pop_front();
        }
        while self
            .rounded
            .front()
            .is_some_and(|open| open.at_s + SIDE_S < seconds)
        {
            self.close_rounded();
        }
    }

    /// Takes a corner that is passed.
    pub(super) fn pass(&mut self, passed: Passed, seconds: f64) {
        if passed.corner.turn_rad < CORNER_RAD || passed.corner.is_stop {
            return;
        }
        self.close(Some(passed.mm));
        self.corners.count += 1;
        let open = Open {
            entry_speed: self.entry_speed(passed.mm),
            passed,
            exit: Vec::new(),
            at_s: seconds,
        };
        self.begun_mm = Some(passed.mm);
        if passed.is_exact {
            self.open = Some(open);
            self.path.clear();
        } else {
            self.corners.rounded += 1;
            self.rounded.push_back(open);
        }
    }

    /// Takes a distance along the path.
    pub(super) fn progress(&mut self, crossing: Crossing) {
        let old = crossing.seconds - SIDE_S;
        self.path.push_back(crossing);
        while self.path.len() > MOST || (self.path.len() > FEWEST && self.path[0].seconds < old) {
            self.path.pop_front();
        }
        if let Some(open) = &mut self.open {
            open.exit.push(crossing);
            let count = open.exit.len();
            // Twice the fitted duration: an earlier corner within that time matters.
            let is_long = crossing.seconds - open.exit[0].seconds >= 2.0 * SIDE_S;
            if count >= 2 * MOST || (count >= 2 * FEWEST && is_long) {
                self.close(None);
            }
        }
    }

    /// Separates the following distances from the distances so far.
    pub(super) fn interrupt(&mut self) {
        self.close(None);
        self.path.clear();
        self.begun_mm = None;
    }

    /// Time and speed at which the path so far reaches a corner at a distance.
    ///
    /// The second half since the corner before is fitted: the first half may be accelerated, the second
    /// half braked.
    fn entry_speed(&self, mm: f64) -> Option<(f64, f64)> {
        let from = self
            .begun_mm
            .map_or(f64::MIN, |begun| f64::midpoint(begun, mm));
        let near = self
            .path
            .iter()
            .filter(|crossing| crossing.position >= from);
        let fit = fitted(&near)?;
        let last = self.path.back()?;
        let mut seconds = last.seconds;
        for _ in 0..3 {
            let speed = fit.speed(seconds);
            if speed > 1.0e-6 {
                seconds += (mm - fit.position(seconds)) / speed;
            }
        }
        let seconds = seconds.clamp(last.seconds, last.seconds + SIDE_S);
        Some((seconds, fit.speed(seconds).max(0.0)))
    }

    /// Measures the exit of a corner; `next_mm` is the distance of the next corner, if known.
    fn close(&mut self, next_mm: Option<f64>) {
        let Some(open) = self.open.take() else {
            return;
        };
        let to = next_mm.map_or(f64::MAX, |next| f64::midpoint(open.passed.mm, next));
        let first = open.exit.first();
        let until = first.map_or(0.0, |first| first.seconds + SIDE_S);
        let near = open.exit.iter().enumerate().filter(|(index, crossing)| {
            let is_near = *index < FEWEST || *index < MOST && crossing.seconds <= until;
            is_near && crossing.position <= to
        });
        let out = fitted(&near.map(|(_, crossing)| crossing));
        let out = out.zip(first).map(|(fit, first)| {
            let at = open
                .entry_speed
                .map_or(first.seconds, |(at, _)| at.min(first.seconds));
            fit.speed(at.max(first.seconds - SIDE_S)).max(0.0)
        });
        let speed = match (open.entry_speed, out) {
            (Some((_, entry_speed)), Some(out)) => Some(f64::midpoint(entry_speed, out)),
            (entry_speed, out) => entry_speed.map(|(_, speed)| speed).or(out),
        };
        self.add(&open, speed);
    }

    /// Measures a rounded corner from the positions of all axes around the instant.
    fn close_rounded(&mut self) {
        let Some(open) = self.rounded.pop_front() else {
            return;
        };
        let near = |seconds: f64| (seconds - open.at_s).abs() <= SIDE_S / 2.0;
        let places = self.places.iter().filter(|(seconds, _)| near(*seconds));
        let count = places.clone().count();
        let square: f64 = (0..AXES)
            .map(|axis| slope(places.clone().map(|(seconds, at)| (*seconds, at[axis]))).powi(2))
            .sum();
        self.add(&open, (count >= FEWEST).then(|| square.sqrt()));
    }

    fn add(&mut self, open: &Open, speed_mm_s: Option<f64>) {
        let Some(speed_mm_s) = speed_mm_s else {
            return;
        };
        let corners = &mut self.corners;
        corners.measured += 1;
        let least = corners.slowest_mm_s.unwrap_or(f64::INFINITY);
        corners.slowest_mm_s = Some(least.min(speed_mm_s));
        corners.fastest_mm_s = Some(corners.fastest_mm_s.unwrap_or(0.0).max(speed_mm_s));
        let allowed_mm_s = open.passed.corner.allowed_mm_s;
        if open.passed.is_exact && allowed_mm_s > self.resolved_mm_s {
            let part = speed_mm_s / allowed_mm_s;
            corners.most_of_allowed = Some(corners.most_of_allowed.unwrap_or(0.0).max(part));
        }
        if corners.list.len() < KEPT {
            corners.list.push(CornerSpeed {
                at_mm: open.passed.at.to_vec(),
                turn_degrees: open.passed.corner.turn_rad.to_degrees(),
                speed_mm_s,
                allowed_mm_s,
                jump_mm_s: speed_mm_s * norm(&open.passed.corner.change),
                is_rounded: !open.passed.is_exact,
            });
        }
    }

    pub(super) fn finish(mut self) -> Corners {
        self.close(None);
        while !self.rounded.is_empty() {
            self.close_rounded();
        }
        self.corners
    }
}

/// Fits a parabola: speeds change by up to their own size on one side of a corner.
fn fitted<'a, P>(points: &P) -> Option<Fit>
where
    P: DoubleEndedIterator<Item = &'a Crossing> + Clone,
{
    let is_enough = points.clone().count() >= FEWEST_OF_SIDE;
    is_enough.then(|| Fit::new(points, 2)).flatten()
}

/// The slope of the straight line through points.
fn slope(points: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let count = points.clone().count().max(1) as f64;
    let (x, y) = points
        .clone()
        .fold((0.0, 0.0), |(x, y), point| (x + point.0, y + point.1));
    let (x, y) = (x / count, y / count);
    let [above, below] = points.fold([0.0; 2], |[above, below], point| {
        let dx = point.0 - x;
        [above + dx * (point.1 - y), below + dx * dx]
    });
    if below > 0.0 { above / below } else { 0.0 }
}
