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
//! in numerical controls; for what the reference owes its mean, see [`super::junctions`].
//!
//! The reference is computed in *cells* of 1 ms, in which its speed changes evenly, so that in each of
//! them the mean's acceleration does. What makes the machine hold, go on, or change its speed, does so to
//! the reference.

use super::reference::{Cell, Leaving};
use crate::{math, model::timing::CELL_S, motion::executor::LONGEST_S, path::AveragingWindow};

/// Cells of history, a power of two: the longest window fits.
const CELLS: usize = 128;
/// Most cells known beyond the beginning of the one being played.
pub(in crate::motion) const AHEAD: usize = 3;
/// The time that is known when a segment is made, s: the longest segment's.
const KNOWN_S: f32 = LONGEST_S + 1.0e-6;
/// Units of way in a mm: 1 nm.
pub(super) const UNITS_PER_MM: f32 = 1_048_576.0;
/// The same, mm.
pub(super) const UNIT_MM: f32 = 1.0 / UNITS_PER_MM;
/// Stands for a speed of 0 in a divisor, mm/s.
const LEAST_MM_S: f32 = 1.0e-12;

/// The reference's mean: its speed at the beginnings of the cell being played and of those after it.
#[derive(Debug)]
pub(in crate::motion) struct Smooth {
    window: usize,
    /// Speed at the beginnings of cells, mm/s, the one being played first.
    speeds: [f32; AHEAD + 1],
    /// Half the change of acceleration in each, mm/s³: how the speed bends between its ends.
    bends: [f32; AHEAD],
    /// The way in each, mm; of the first, what is left of it. 0 where none is known.
    ways_mm: [f32; AHEAD],
    /// Cells known, the one being played first.
    known: usize,
    /// What has been played of the first cell, s.
    played_s: f32,
    /// Another cell is needed for the next segment: found when that changes, as each run of `prepare`
    /// asks for it twice.
    is_short: bool,
    /// Way of the reference in the window, units; of a cell's, what dividing it left over; and the
    /// mean's speed for each of them, mm/s.
    sum: u32,
    over: u32,
    per_unit: f32,
    /// The bend of a cell for a difference of speed, 1/s²: 0.5/(cell · window).
    per_bend: f32,
    /// The newest cell of the reference, its speed at the end, and how many there have been since
    /// rest, as many as the window has at most.
    newest: usize,
    end_mm_s: f32,
    age: usize,
    ways: [u32; CELLS],
    changes_mm_s: [f32; CELLS],
}

/// A place on the way ahead.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct Place {
    /// When, s from now on.
    pub(in crate::motion) seconds: f32,
    /// How far, mm.
    pub(in crate::motion) way_mm: f32,
    /// How fast, mm/s.
    pub(in crate::motion) speed_mm_s: f32,
}

/// By how much a bend makes the way shorter in a time, mm.
fn bent_mm(bend: f32, seconds: f32) -> f32 {
    (1.0 / 6.0) * bend * seconds * seconds * seconds
}

/// What is known of the way ahead: where the machine is now, and will be at the ends of cells.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct Outlook {
    places: [Place; AHEAD + 1],
    /// The last of them, and the first standstill before it.
    pub(in crate::motion) end: Place,
    pub(in crate::motion) rest: Option<Place>,
}

impl Smooth {
    pub(in crate::motion) const fn new() -> Self {
        Self {
            window: 0,
            speeds: [0.0; AHEAD + 1],
            bends: [0.0; AHEAD],
            ways_mm: [0.0; AHEAD],
            known: 0,
            played_s: 0.0,
            is_short: false,
            sum: 0,
            over: 0,
            per_unit: 0.0,
            per_bend: 0.0,
            newest: 0,
            end_mm_s: 0.0,
            age: 0,
            ways: [0; CELLS],
            changes_mm_s: [0.0; CELLS],
        }
    }

    /// At rest: takes a window over.
    pub(in crate::motion) fn configure(&mut self, window: AveragingWindow) {
        self.window = window.samples;
        if window.samples != 0 {
            self.per_unit = UNIT_MM / window.seconds();
            self.per_bend = 0.5 / (CELL_S * window.seconds());
        }
        self.rest();
    }

    /// Whether it is in use.
    pub(in crate::motion) fn is_on(&self) -> bool {
        self.window != 0
    }

    /// Forgets the motion.
    pub(in crate::motion) fn rest(&mut self) {
        self.speeds = [0.0; AHEAD + 1];
        self.ways_mm = [0.0; AHEAD];
        self.known = 0;
        self.played_s = 0.0;
        self.sum = 0;
        self.over = 0;
        self.end_mm_s = 0.0;
        self.age = 0;
        self.is_short = self.is_on();
    }

    /// Whether nothing of the reference's motion is left to be played.
    pub(in crate::motion) fn is_at_rest(&self) -> bool {
        let mut sum = 0.0;
        // wcet-bound: 4
        for speed in &self.speeds {
            sum += speed;
        }
        self.sum == 0 && sum <= 0.0
    }

    /// Whether nothing has been played since rest.
    pub(in crate::motion) fn begins(&self) -> bool {
        self.age <= AHEAD && self.played_s <= 0.0
    }

    /// Whether another cell of the reference is needed: the longest segment is to be known, and from
    /// rest one more cell. Not more than that, as a hold comes behind it.
    #[inline]
    pub(in crate::motion) fn needs_cell(&self) -> bool {
        self.is_short
    }

    /// Finds out whether another cell is needed.
    fn refresh(&mut self) {
        let least_s = if self.begins() {
            AHEAD as f32 * CELL_S
        } else {
            KNOWN_S
        };
        self.is_short = self.known < AHEAD && self.known_s() < least_s;
    }

    /// What leaves the window with the next cell.
    pub(in crate::motion) fn leaving(&self) -> Leaving {
        let change = if self.age < self.window {
            0.0
        } else {
            self.changes_mm_s[self.oldest()]
        };
        Leaving {
            change,
            is_rest: self.sum == 0,
        }
    }

    /// The place of the cell that leaves the window with the next one.
    fn oldest(&self) -> usize {
        self.newest.wrapping_sub(self.window).wrapping_add(1) & (CELLS - 1)
    }

    /// The next cell of the reference.
    pub(in crate::motion) fn push(&mut self, cell: Cell, leaving: Leaving) {
        let oldest = if self.age < self.window {
            self.age += 1;
            0
        } else {
            self.ways[self.oldest()]
        };
        let change = cell.end_mm_s - self.end_mm_s;
        self.end_mm_s = cell.end_mm_s;
        self.newest = (self.newest + 1) & (CELLS - 1);
        self.ways[self.newest] = cell.way;
        self.changes_mm_s[self.newest] = change;
        let before = self.sum.wrapping_add(self.over);
        self.sum = self.sum.wrapping_add(cell.way).wrapping_sub(oldest);
        let double = before.wrapping_add(self.sum);
        let shares = (2 * self.window as u32).max(1);
        let way = double / shares;
        self.over = double - way * shares;
        let bend = (change - leaving.change) * self.per_bend;
        if let Some(place) = self.bends.get_mut(self.known) {
            *place = bend;
        }
        if let Some(place) = self.ways_mm.get_mut(self.known) {
            *place += way as f32 * UNIT_MM - bent_mm(bend, CELL_S);
        }
        self.known += 1;
        if let Some(speed) = self.speeds.get_mut(self.known) {
            *speed = self.sum as f32 * self.per_unit;
        }
        self.refresh();
    }

    /// What is known, s.
    fn known_s(&self) -> f32 {
        self.known as f32 * CELL_S - self.played_s
    }

    /// What is known of the way ahead, at a speed now.
    pub(in crate::motion) fn outlook(&self, speed_mm_s: f32) -> Outlook {
        let mut end = Place {
            seconds: 0.0,
            way_mm: 0.0,
            speed_mm_s,
        };
        let mut outlook = Outlook {
            places: [end; AHEAD + 1],
            end,
            rest: None,
        };
        let mut cell_s = CELL_S - self.played_s;
        let ends = self.speeds[1..].iter().zip(&self.ways_mm);
        // wcet-bound: 3
        for (place, (to, way)) in outlook.places[1..].iter_mut().zip(ends).take(self.known) {
            if end.speed_mm_s <= 0.0 && end.seconds > 0.0 && outlook.rest.is_none() {
                outlook.rest = Some(end);
            }
            end = Place {
                seconds: end.seconds + cell_s,
                way_mm: end.way_mm + way,
                speed_mm_s: *to,
            };
            *place = end;
            cell_s = CELL_S;
        }
        outlook.end = end;
        outlook
    }

    /// The place after a time, which is known.
    pub(in crate::motion) fn after(&self, outlook: &Outlook, seconds: f32) -> Place {
        let cell = ((self.played_s + seconds) * (1.0 / CELL_S)) as usize;
        let cell = cell.min(AHEAD - 1);
        self.within(outlook, cell, seconds - outlook.places[cell].seconds)
    }

    /// The place after a way, which is known.
    pub(in crate::motion) fn at(&self, outlook: &Outlook, way_mm: f32) -> Place {
        let [_, a, b, _] = &outlook.places;
        let cell = if way_mm <= a.way_mm || self.known <= 1 {
            0
        } else if way_mm <= b.way_mm || self.known <= 2 {
            1
        } else {
            2
        };
        let [from, to] = [&outlook.places[cell], &outlook.places[cell + 1]];
        let most_s = to.seconds - from.seconds;
        let left_mm = way_mm - from.way_mm;
        // As if its speed changed evenly, ...
        let (v, change) = (from.speed_mm_s, to.speed_mm_s - from.speed_mm_s);
        let square = v * v + 2.0 * left_mm * change / most_s;
        let sum = v + math::sqrt(math::max(square, 0.0));
        let about_s = math::min(2.0 * left_mm / math::max(sum, LEAST_MM_S), most_s);
        // ... and nearer by Newton's method.
        let about = self.within(outlook, cell, about_s);
        let late_s = (about.way_mm - way_mm) / math::max(about.speed_mm_s, LEAST_MM_S);
        let seconds = math::min(math::max(about_s - late_s, 0.5 * about_s), most_s);
        Place {
            way_mm,
            ..self.within(outlook, cell, seconds)
        }
    }

    /// The place so long after the beginning of what is left of a cell: so far before its end.
    fn within(&self, outlook: &Outlook, cell: usize, seconds: f32) -> Place {
        let [from, to] = [&outlook.places[cell], &outlook.places[cell + 1]];
        let seconds = from.seconds + seconds;
        let rest_s = to.seconds - seconds;
        let bend = self.bends[cell];
        let change = (self.speeds[cell + 1] - self.speeds[cell]) * (1.0 / CELL_S);
        let evenly = to.speed_mm_s - change * rest_s;
        let speed_mm_s = math::max(evenly - bend * rest_s * (CELL_S - rest_s), 0.0);
        let rest_mm = 0.5 * (speed_mm_s + to.speed_mm_s) * rest_s - bent_mm(bend, rest_s);
        Place {
            seconds,
            way_mm: to.way_mm - rest_mm,
            speed_mm_s,
        }
    }

    /// Goes on by a time that is known, and a way.
    pub(in crate::motion) fn play(&mut self, seconds: f32, way_mm: f32) {
        self.played_s += seconds;
        let [first, ..] = &mut self.ways_mm;
        *first -= way_mm;
        // wcet-bound: 3
        for _ in 0..AHEAD {
            if self.played_s < CELL_S || self.known == 0 {
                break;
            }
            self.played_s -= CELL_S;
            let [_, b, c, d] = self.speeds;
            self.speeds = [b, c, d, 0.0];
            let [_, b, c] = self.bends;
            self.bends = [b, c, 0.0];
            let [rest, b, c] = self.ways_mm;
            self.ways_mm = [rest + b, c, 0.0];
            self.known -= 1;
        }
        self.refresh();
    }
}
