//! Motion of continuous acceleration: the mean of a motion with constant accelerations.
//!
//! ```text
//!  acceleration of the reference      that of its mean over the window
//!      ____                                ____
//!     |    |                              /    \
//!  ___|    |____      ____ time        __/      \____        __ time
//!                |    |                              \      /
//!                |____|                               \____/
//! ```
//!
//! The *reference* is how far along the path a machine would be that changes between accelerations of
//! -a, 0 and +a at once. Its mean over a window T is what this machine does: acceleration changes by a
//! in T at most, so that the jerk is a/T. That is as fast as a motion with this jerk can be wherever
//! the acceleration reaches a. It is the way along the path that is averaged, so that the path itself
//! stays what it is. Read with the moving average as an interpolator of acceleration and deceleration
//! in numerical controls; for what the reference owes its mean, see [`gate`].
//!
//! The reference is computed in *cells* of 1 ms, between which its mean's speed changes evenly. What
//! makes the machine hold, go on, or change its speed, does so to the reference.

pub(super) mod bend;
pub(super) mod gate;
pub(super) mod pacer;

use self::pacer::{CELL_S, Leaving};
use super::executor::LONGEST_S;
use crate::{axis::AXES, math, settings::Settings};

/// Cells of history, a power of two: the window, and two more.
const CELLS: usize = 128;
/// Shortest window, cells: so that a limit of speed that is reached in the middle of a cell is kept by
/// the mean, and blocks take the time that they have to.
const SHORTEST_WINDOW: usize = 5;
/// Longest window, cells. Where the jerk is lower than that needs, so is the acceleration.
const LONGEST_WINDOW: usize = 120;
/// Most cells known beyond the beginning of the one being played.
pub(super) const AHEAD: usize = 3;
/// The time that is known when a segment is made, s: the longest segment's.
const KNOWN_S: f32 = LONGEST_S + 1.0e-6;
/// Units of way in a mm: 1 nm.
const UNITS_PER_MM: f32 = 1_048_576.0;
/// The same, mm.
const UNIT_MM: f32 = 1.0 / UNITS_PER_MM;

/// What the jerk limits make of the acceleration limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    /// Its length, cells; 0 without any limit of jerk.
    pub(super) cells: usize,
}

impl Window {
    /// Long enough for every axis.
    pub(super) fn new(settings: &Settings) -> Self {
        let mut longest_s = 0.0;
        // wcet-bound: axes
        for axis in 0..AXES {
            let jerk = settings.jerk_mm_s3[axis];
            if jerk > 0.0 {
                longest_s = math::max(longest_s, settings.acceleration_mm_s2[axis] / jerk);
            }
        }
        if longest_s <= 0.0 {
            return Self { cells: 0 };
        }
        // One more than it takes: segments are not in step with cells.
        let cells = math::min(longest_s * (1.0 / CELL_S) + 1.999, LONGEST_WINDOW as f32);
        Self {
            cells: (cells as usize).max(SHORTEST_WINDOW),
        }
    }

    /// Its length, s; 0 without any limit of jerk.
    pub(super) fn seconds(self) -> f32 {
        self.cells as f32 * CELL_S
    }

    /// The acceleration of an axis that keeps its jerk, mm/s².
    pub(super) fn acceleration(self, acceleration_mm_s2: f32, jerk_mm_s3: f32) -> f32 {
        if jerk_mm_s3 > 0.0 {
            let longest_s = (self.cells - 1) as f32 * CELL_S;
            math::min(acceleration_mm_s2, jerk_mm_s3 * longest_s)
        } else {
            acceleration_mm_s2
        }
    }
}

/// The reference's mean: its speed at the beginnings of the cell being played and of those after it.
#[derive(Debug)]
pub(super) struct Smooth {
    window: usize,
    /// Speed at the beginnings of cells, mm/s, the one being played first.
    speeds: [f32; AHEAD + 1],
    /// How many of them follow the first.
    known: usize,
    /// What has been played of the first cell, s.
    played_s: f32,
    /// Way of the reference in the window, units, and its inverse length.
    sum: u32,
    per_unit: f32,
    /// The newest cell of the reference, and how many there have been since rest, one more than the
    /// window at most.
    newest: usize,
    age: usize,
    ways: [u32; CELLS],
    ends_mm_s: [f32; CELLS],
}

impl Smooth {
    pub(super) const fn new() -> Self {
        Self {
            window: 0,
            speeds: [0.0; AHEAD + 1],
            known: 0,
            played_s: 0.0,
            sum: 0,
            per_unit: 0.0,
            newest: 0,
            age: 0,
            ways: [0; CELLS],
            ends_mm_s: [0.0; CELLS],
        }
    }

    /// At rest: takes a window over.
    pub(super) fn configure(&mut self, window: Window) {
        self.window = window.cells;
        if window.cells != 0 {
            self.per_unit = UNIT_MM / window.seconds();
        }
        self.rest();
    }

    /// Whether it is in use.
    pub(super) fn is_on(&self) -> bool {
        self.window != 0
    }

    /// Forgets the motion.
    pub(super) fn rest(&mut self) {
        self.speeds = [0.0; AHEAD + 1];
        self.known = 0;
        self.played_s = 0.0;
        self.sum = 0;
        self.age = 0;
    }

    /// Whether nothing of the reference's motion is left to be played.
    pub(super) fn is_at_rest(&self) -> bool {
        let mut sum = 0.0;
        // wcet-bound: 4
        for speed in &self.speeds {
            sum += speed;
        }
        self.sum == 0 && sum <= 0.0
    }

    /// Whether nothing has been played since rest.
    pub(super) fn begins(&self) -> bool {
        self.age <= AHEAD && self.played_s <= 0.0
    }

    /// Whether another cell of the reference is needed: the longest segment is to be known, and from
    /// rest one more cell. Not more than that, as a hold comes behind it.
    pub(super) fn needs_cell(&self) -> bool {
        let least_s = if self.begins() {
            AHEAD as f32 * CELL_S
        } else {
            KNOWN_S
        };
        self.is_on() && self.known < AHEAD && self.known_s() < least_s
    }

    /// What leaves the window with the next cell.
    pub(super) fn leaving(&self) -> Leaving {
        let end = |back: usize| {
            if back < self.age {
                self.ends_mm_s[self.newest.wrapping_sub(back) & (CELLS - 1)]
            } else {
                0.0
            }
        };
        Leaving {
            change: end(self.window - 1) - end(self.window),
            is_rest: self.sum == 0,
        }
    }

    /// The way of the reference in the next cell, units, and its speed at the end.
    pub(super) fn push(&mut self, way: u32, end_mm_s: f32) {
        let oldest = if self.age < self.window {
            0
        } else {
            self.ways[self.newest.wrapping_sub(self.window - 1) & (CELLS - 1)]
        };
        if self.age <= self.window {
            self.age += 1;
        }
        self.newest = (self.newest + 1) & (CELLS - 1);
        self.ways[self.newest] = way;
        self.ends_mm_s[self.newest] = end_mm_s;
        self.sum = self.sum.wrapping_add(way).wrapping_sub(oldest);
        self.known += 1;
        if let Some(speed) = self.speeds.get_mut(self.known) {
            *speed = self.sum as f32 * self.per_unit;
        }
    }

    /// What is known, s.
    pub(super) fn known_s(&self) -> f32 {
        self.known as f32 * CELL_S - self.played_s
    }

    /// The time from now on to the first standstill, s, or all that is known.
    pub(super) fn rest_in(&self) -> f32 {
        let mut cells = 0;
        // wcet-bound: 3
        for [_, to] in self.cells() {
            cells += 1;
            if to <= 0.0 {
                return cells as f32 * CELL_S - self.played_s;
            }
        }
        self.known_s()
    }

    /// The way from now on in a time, which is known, and the speed after it.
    pub(super) fn after(&self, seconds: f32) -> (f32, f32) {
        let mut left_s = seconds;
        let mut way_mm = 0.0;
        let mut begin_s = self.played_s;
        // wcet-bound: 3
        for [from, to] in self.cells() {
            let change = (to - from) * (1.0 / CELL_S);
            let speed = from + change * begin_s;
            let cell_s = CELL_S - begin_s;
            if left_s <= cell_s {
                let end = speed + change * left_s;
                return (way_mm + 0.5 * (speed + end) * left_s, math::max(end, 0.0));
            }
            way_mm += 0.5 * (speed + to) * cell_s;
            left_s -= cell_s;
            begin_s = 0.0;
        }
        (way_mm, 0.0)
    }

    /// The time from now on for a way, s, and the speed after it; not more than is known.
    pub(super) fn time_for(&self, way_mm: f32) -> (f32, f32) {
        let mut left_mm = way_mm;
        let mut seconds = 0.0;
        let mut begin_s = self.played_s;
        let mut reached = 0.0;
        // wcet-bound: 3
        for [from, to] in self.cells() {
            let change = (to - from) * (1.0 / CELL_S);
            let speed = from + change * begin_s;
            let cell_s = CELL_S - begin_s;
            let cell_mm = 0.5 * (speed + to) * cell_s;
            if left_mm <= cell_mm {
                let end = math::sqrt(speed * speed + 2.0 * change * left_mm);
                let sum = math::max(speed + end, 1.0e-12);
                return (seconds + math::min(2.0 * left_mm / sum, cell_s), end);
            }
            left_mm -= cell_mm;
            seconds += cell_s;
            begin_s = 0.0;
            reached = to;
        }
        (seconds, reached)
    }

    /// The speeds at both ends of the cells that are known.
    fn cells(&self) -> impl Iterator<Item = [f32; 2]> {
        let [a, b, c, d] = self.speeds;
        [[a, b], [b, c], [c, d]].into_iter().take(self.known)
    }

    /// Goes on by a time that is known.
    pub(super) fn play(&mut self, seconds: f32) {
        self.played_s += seconds;
        // wcet-bound: 3
        for _ in 0..AHEAD {
            if self.played_s < CELL_S || self.known == 0 {
                return;
            }
            self.played_s -= CELL_S;
            let [_, b, c, d] = self.speeds;
            self.speeds = [b, c, d, 0.0];
            self.known -= 1;
        }
    }
}
