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
/// Time on either side over which the speed is fitted, s.
const SIDE_S: f64 = 0.004;
/// Fewest crossings of a side for a speed.
const FEWEST_OF_SIDE: usize = 5;
/// Crossings of a side that are waited for, and most of them.
const FEWEST: usize = 8;
const MOST: usize = 256;
/// Most corners that are kept one by one.
const KEPT: usize = 10_000;

/// A corner of the program.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct CornerSpeed {
    /// Where it is programmed, mm in machine coordinates.
    pub(crate) at_mm: Vec<f64>,
    /// Change of direction, degrees.
    pub(crate) turn_degrees: f64,
    /// Speed along the path there, mm/s.
    pub(crate) speed_mm_s: f64,
    /// What the junction deviation allows, mm/s.
    pub(crate) allowed_mm_s: f64,
    /// Jump of the velocity that it is at that speed, mm/s.
    pub(crate) jump_mm_s: f64,
    /// It was rounded.
    pub(crate) is_rounded: bool,
}

/// All corners of a program.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Corners {
    /// How many there are, stops apart.
    pub(crate) count: u64,
    /// Those whose speed could be measured.
    pub(crate) measured: u64,
    /// Those that were rounded.
    pub(crate) rounded: u64,
    /// Slowest and fastest, mm/s.
    pub(crate) slowest_mm_s: Option<f64>,
    pub(crate) fastest_mm_s: Option<f64>,
    /// The greatest speed of one that was not rounded, as a part of what is allowed there, of those
    /// that allow more than an acceleration makes within one step from rest.
    pub(crate) most_of_allowed: Option<f64>,
    /// The first ten thousand of them.
    pub(crate) list: Vec<CornerSpeed>,
}

/// A corner whose way out has not been seen yet.
#[derive(Debug)]
struct Open {
    passed: Passed,
    /// When and how fast it is on the way in.
    way_in: Option<(f64, f64)>,
    way_out: Vec<Crossing>,
    /// Of a rounded one: when it was passed, s.
    at_s: f64,
}

/// Measures corners as they come.
#[derive(Debug, Default)]
pub(super) struct Meter {
    /// The way along the path, newest last.
    way: VecDeque<Crossing>,
    /// Positions of all axes after each event, mm.
    places: VecDeque<(f64, Point)>,
    open: Option<Open>,
    /// Where the newest corner is on the path, mm.
    begun_mm: Option<f64>,
    rounded: VecDeque<Open>,
    /// Slower corners cannot be told from what is one step beside them, mm/s.
    resolved_mm_s: f64,
    pub(super) corners: Corners,
}

impl Meter {
    /// For steps that tell corners from what is beside them down to a speed.
    pub(super) fn new(resolved_mm_s: f64) -> Self {
        Self {
            resolved_mm_s,
            ..Self::default()
        }
    }

    /// The machine is somewhere.
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

    /// A corner is passed.
    pub(super) fn pass(&mut self, passed: Passed, seconds: f64) {
        if passed.corner.turn_rad < CORNER_RAD || passed.corner.is_stop {
            return;
        }
        self.close(Some(passed.mm));
        self.corners.count += 1;
        let open = Open {
            way_in: self.way_in(passed.mm),
            passed,
            way_out: Vec::new(),
            at_s: seconds,
        };
        self.begun_mm = Some(passed.mm);
        if passed.is_exact {
            self.open = Some(open);
            self.way.clear();
        } else {
            self.corners.rounded += 1;
            self.rounded.push_back(open);
        }
    }

    /// The way along the path is known.
    pub(super) fn progress(&mut self, crossing: Crossing) {
        let old = crossing.seconds - SIDE_S;
        self.way.push_back(crossing);
        while self.way.len() > MOST || (self.way.len() > FEWEST && self.way[0].seconds < old) {
            self.way.pop_front();
        }
        if let Some(open) = &mut self.open {
            open.way_out.push(crossing);
            let count = open.way_out.len();
            // Twice what is asked for: another corner that comes before that matters.
            let is_long = crossing.seconds - open.way_out[0].seconds >= 2.0 * SIDE_S;
            if count >= 2 * MOST || (count >= 2 * FEWEST && is_long) {
                self.close(None);
            }
        }
    }

    /// The way along the path is interrupted.
    pub(super) fn cut(&mut self) {
        self.close(None);
        self.way.clear();
        self.begun_mm = None;
    }

    /// When, and how fast, the way so far comes to a place: by the half behind the middle between the
    /// corner before and this one, as that half may be braked in and the other accelerated.
    fn way_in(&self, mm: f64) -> Option<(f64, f64)> {
        let from = self
            .begun_mm
            .map_or(f64::MIN, |begun| f64::midpoint(begun, mm));
        let near = self.way.iter().filter(|crossing| crossing.position >= from);
        let fit = fitted(&near)?;
        let last = self.way.back()?;
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

    /// The way out is over; so far ahead is the next corner, if that is known.
    fn close(&mut self, next_mm: Option<f64>) {
        let Some(open) = self.open.take() else {
            return;
        };
        let to = next_mm.map_or(f64::MAX, |next| f64::midpoint(open.passed.mm, next));
        let first = open.way_out.first();
        let until = first.map_or(0.0, |first| first.seconds + SIDE_S);
        let near = open.way_out.iter().enumerate().filter(|(index, crossing)| {
            let is_near = *index < FEWEST || *index < MOST && crossing.seconds <= until;
            is_near && crossing.position <= to
        });
        let out = fitted(&near.map(|(_, crossing)| crossing));
        let out = out.zip(first).map(|(fit, first)| {
            let at = open
                .way_in
                .map_or(first.seconds, |(at, _)| at.min(first.seconds));
            fit.speed(at.max(first.seconds - SIDE_S)).max(0.0)
        });
        let speed = match (open.way_in, out) {
            (Some((_, way_in)), Some(out)) => Some(f64::midpoint(way_in, out)),
            (way_in, out) => way_in.map(|(_, speed)| speed).or(out),
        };
        self.add(&open, speed);
    }

    /// A rounded corner: from the positions of all axes around the instant.
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

/// A parabola: speeds change by up to their own size on one side of a corner.
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
