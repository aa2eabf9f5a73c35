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

use super::reference::{LeavingSample, Sample};
use crate::{
    math,
    model::timing::SAMPLE_S,
    motion::limits::{LONGEST_SEGMENT_S, MIN_DIVISOR_MM_S},
    path::AveragingWindow,
};

/// Cells of history, a power of two: the longest window fits.
const WINDOW_SAMPLES: usize = 128;
/// Most cells known beyond the beginning of the one being played.
pub(in crate::motion) const SAMPLES_AHEAD: usize = 3;
/// The time that is known when a segment is made, s: the longest segment's.
const KNOWN_S: f32 = LONGEST_SEGMENT_S + 1.0e-6;
/// Units of way in a mm: 1 nm.
pub(super) const UNITS_PER_MM: f32 = 1_048_576.0;
/// The same, mm.
pub(super) const UNIT_MM: f32 = 1.0 / UNITS_PER_MM;

/// The reference's mean: its speed at the beginnings of the cell being played and of those after it.
#[derive(Debug)]
pub(in crate::motion) struct MovingAverage {
    window: usize,
    /// Speed at the beginnings of cells, mm/s, the one being played first.
    speeds: [f32; SAMPLES_AHEAD + 1],
    /// Half the change of acceleration in each, mm/s³: how the speed bends between its ends.
    half_jerks: [f32; SAMPLES_AHEAD],
    /// The way in each, mm; of the first, what is left of it. 0 where none is known.
    distances_mm: [f32; SAMPLES_AHEAD],
    /// Cells known, the one being played first.
    known: usize,
    /// What has been played of the first cell, s.
    played_s: f32,
    /// Another cell is needed for the next segment: found when that changes, as each run of `prepare`
    /// asks for it twice.
    needs_sample: bool,
    /// Way of the reference in the window, units; of a cell's, what dividing it left over; and the
    /// mean's speed for each of them, mm/s.
    sum: u32,
    remainder: u32,
    speed_per_unit: f32,
    /// The bend of a cell for a difference of speed, 1/s²: 0.5/(cell · window).
    half_jerk_per_speed: f32,
    /// The newest cell of the reference, its speed at the end, and how many there have been since
    /// rest, as many as the window has at most.
    newest: usize,
    end_mm_s: f32,
    age: usize,
    distances: [u32; WINDOW_SAMPLES],
    speed_changes_mm_s: [f32; WINDOW_SAMPLES],
}

/// A place on the way ahead.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct PathPoint {
    /// When, s from now on.
    pub(in crate::motion) seconds: f32,
    /// How far, mm.
    pub(in crate::motion) distance_mm: f32,
    /// How fast, mm/s.
    pub(in crate::motion) speed_mm_s: f32,
}

/// By how much a bend makes the way shorter in a time, mm.
fn jerk_distance_mm(bend: f32, seconds: f32) -> f32 {
    (1.0 / 6.0) * bend * seconds * seconds * seconds
}

/// What is known of the way ahead: where the machine is now, and will be at the ends of cells.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct Forecast {
    points: [PathPoint; SAMPLES_AHEAD + 1],
    /// The last of them, and the first standstill before it.
    pub(in crate::motion) end: PathPoint,
    pub(in crate::motion) standstill: Option<PathPoint>,
}

impl MovingAverage {
    pub(in crate::motion) const fn new() -> Self {
        Self {
            window: 0,
            speeds: [0.0; SAMPLES_AHEAD + 1],
            half_jerks: [0.0; SAMPLES_AHEAD],
            distances_mm: [0.0; SAMPLES_AHEAD],
            known: 0,
            played_s: 0.0,
            needs_sample: false,
            sum: 0,
            remainder: 0,
            speed_per_unit: 0.0,
            half_jerk_per_speed: 0.0,
            newest: 0,
            end_mm_s: 0.0,
            age: 0,
            distances: [0; WINDOW_SAMPLES],
            speed_changes_mm_s: [0.0; WINDOW_SAMPLES],
        }
    }

    /// At rest: takes a window over.
    pub(in crate::motion) fn configure(&mut self, window: AveragingWindow) {
        self.window = window.samples;
        if window.samples != 0 {
            self.speed_per_unit = UNIT_MM / window.seconds();
            self.half_jerk_per_speed = 0.5 / (SAMPLE_S * window.seconds());
        }
        self.reset();
    }

    /// Whether it is in use.
    pub(in crate::motion) fn is_active(&self) -> bool {
        self.window != 0
    }

    /// Forgets the motion.
    pub(in crate::motion) fn reset(&mut self) {
        self.speeds = [0.0; SAMPLES_AHEAD + 1];
        self.distances_mm = [0.0; SAMPLES_AHEAD];
        self.known = 0;
        self.played_s = 0.0;
        self.sum = 0;
        self.remainder = 0;
        self.end_mm_s = 0.0;
        self.age = 0;
        self.needs_sample = self.is_active();
    }

    /// Whether nothing of the reference's motion is left to be played.
    pub(in crate::motion) fn is_at_standstill(&self) -> bool {
        let mut sum = 0.0;
        // wcet-bound: 4
        for speed in &self.speeds {
            sum += speed;
        }
        self.sum == 0 && sum <= 0.0
    }

    /// Whether nothing has been played since rest.
    pub(in crate::motion) fn is_first_segment(&self) -> bool {
        self.age <= SAMPLES_AHEAD && self.played_s <= 0.0
    }

    /// Whether another cell of the reference is needed: the longest segment is to be known, and from
    /// rest one more cell. Not more than that, as a hold comes behind it.
    #[inline]
    pub(in crate::motion) fn needs_sample(&self) -> bool {
        self.needs_sample
    }

    /// Finds out whether another cell is needed.
    fn update_needs_sample(&mut self) {
        let least_s = if self.is_first_segment() {
            SAMPLES_AHEAD as f32 * SAMPLE_S
        } else {
            KNOWN_S
        };
        self.needs_sample = self.known < SAMPLES_AHEAD && self.known_s() < least_s;
    }

    /// What leaves the window with the next cell.
    pub(in crate::motion) fn leaving_sample(&self) -> LeavingSample {
        let change = if self.age < self.window {
            0.0
        } else {
            self.speed_changes_mm_s[self.oldest()]
        };
        LeavingSample {
            change,
            is_standstill: self.sum == 0,
        }
    }

    /// The place of the cell that leaves the window with the next one.
    fn oldest(&self) -> usize {
        self.newest.wrapping_sub(self.window).wrapping_add(1) & (WINDOW_SAMPLES - 1)
    }

    /// The next cell of the reference.
    pub(in crate::motion) fn push(&mut self, cell: Sample, leaving: LeavingSample) {
        let oldest = if self.age < self.window {
            self.age += 1;
            0
        } else {
            self.distances[self.oldest()]
        };
        let change = cell.end_mm_s - self.end_mm_s;
        self.end_mm_s = cell.end_mm_s;
        self.newest = (self.newest + 1) & (WINDOW_SAMPLES - 1);
        self.distances[self.newest] = cell.distance;
        self.speed_changes_mm_s[self.newest] = change;
        let before = self.sum.wrapping_add(self.remainder);
        self.sum = self.sum.wrapping_add(cell.distance).wrapping_sub(oldest);
        let double = before.wrapping_add(self.sum);
        let shares = (2 * self.window as u32).max(1);
        let way = double / shares;
        self.remainder = double - way * shares;
        let bend = (change - leaving.change) * self.half_jerk_per_speed;
        if let Some(place) = self.half_jerks.get_mut(self.known) {
            *place = bend;
        }
        if let Some(place) = self.distances_mm.get_mut(self.known) {
            *place += way as f32 * UNIT_MM - jerk_distance_mm(bend, SAMPLE_S);
        }
        self.known += 1;
        if let Some(speed) = self.speeds.get_mut(self.known) {
            *speed = self.sum as f32 * self.speed_per_unit;
        }
        self.update_needs_sample();
    }

    /// What is known, s.
    fn known_s(&self) -> f32 {
        self.known as f32 * SAMPLE_S - self.played_s
    }

    /// What is known of the way ahead, at a speed now.
    pub(in crate::motion) fn forecast(&self, speed_mm_s: f32) -> Forecast {
        let mut end = PathPoint {
            seconds: 0.0,
            distance_mm: 0.0,
            speed_mm_s,
        };
        let mut outlook = Forecast {
            points: [end; SAMPLES_AHEAD + 1],
            end,
            standstill: None,
        };
        let mut cell_s = SAMPLE_S - self.played_s;
        let ends = self.speeds[1..].iter().zip(&self.distances_mm);
        // wcet-bound: 3
        for (place, (to, way)) in outlook.points[1..].iter_mut().zip(ends).take(self.known) {
            if end.speed_mm_s <= 0.0 && end.seconds > 0.0 && outlook.standstill.is_none() {
                outlook.standstill = Some(end);
            }
            end = PathPoint {
                seconds: end.seconds + cell_s,
                distance_mm: end.distance_mm + way,
                speed_mm_s: *to,
            };
            *place = end;
            cell_s = SAMPLE_S;
        }
        outlook.end = end;
        outlook
    }

    /// The place after a time, which is known.
    pub(in crate::motion) fn point_after(&self, outlook: &Forecast, seconds: f32) -> PathPoint {
        let cell = ((self.played_s + seconds) * (1.0 / SAMPLE_S)) as usize;
        let cell = cell.min(SAMPLES_AHEAD - 1);
        self.point_within(outlook, cell, seconds - outlook.points[cell].seconds)
    }

    /// The place after a way, which is known.
    pub(in crate::motion) fn point_at(&self, outlook: &Forecast, distance_mm: f32) -> PathPoint {
        let [_, a, b, _] = &outlook.points;
        let cell = if distance_mm <= a.distance_mm || self.known <= 1 {
            0
        } else if distance_mm <= b.distance_mm || self.known <= 2 {
            1
        } else {
            2
        };
        let [from, to] = [&outlook.points[cell], &outlook.points[cell + 1]];
        let most_s = to.seconds - from.seconds;
        let left_mm = distance_mm - from.distance_mm;
        // As if its speed changed evenly, ...
        let (v, change) = (from.speed_mm_s, to.speed_mm_s - from.speed_mm_s);
        let square = v * v + 2.0 * left_mm * change / most_s;
        let sum = v + math::sqrt(math::max(square, 0.0));
        let about_s = math::min(2.0 * left_mm / math::max(sum, MIN_DIVISOR_MM_S), most_s);
        // ... and nearer by Newton's method.
        let about = self.point_within(outlook, cell, about_s);
        let late_s =
            (about.distance_mm - distance_mm) / math::max(about.speed_mm_s, MIN_DIVISOR_MM_S);
        let seconds = math::min(math::max(about_s - late_s, 0.5 * about_s), most_s);
        PathPoint {
            distance_mm,
            ..self.point_within(outlook, cell, seconds)
        }
    }

    /// The place so long after the beginning of what is left of a cell: so far before its end.
    fn point_within(&self, outlook: &Forecast, cell: usize, seconds: f32) -> PathPoint {
        let [from, to] = [&outlook.points[cell], &outlook.points[cell + 1]];
        let seconds = from.seconds + seconds;
        let rest_s = to.seconds - seconds;
        let bend = self.half_jerks[cell];
        let change = (self.speeds[cell + 1] - self.speeds[cell]) * (1.0 / SAMPLE_S);
        let evenly = to.speed_mm_s - change * rest_s;
        let speed_mm_s = math::max(evenly - bend * rest_s * (SAMPLE_S - rest_s), 0.0);
        let rest_mm = 0.5 * (speed_mm_s + to.speed_mm_s) * rest_s - jerk_distance_mm(bend, rest_s);
        PathPoint {
            seconds,
            distance_mm: to.distance_mm - rest_mm,
            speed_mm_s,
        }
    }

    /// Goes on by a time that is known, and a way.
    pub(in crate::motion) fn advance(&mut self, seconds: f32, distance_mm: f32) {
        self.played_s += seconds;
        let [first, ..] = &mut self.distances_mm;
        *first -= distance_mm;
        // wcet-bound: 3
        for _ in 0..SAMPLES_AHEAD {
            if self.played_s < SAMPLE_S || self.known == 0 {
                break;
            }
            self.played_s -= SAMPLE_S;
            let [_, b, c, d] = self.speeds;
            self.speeds = [b, c, d, 0.0];
            let [_, b, c] = self.half_jerks;
            self.half_jerks = [b, c, 0.0];
            let [rest, b, c] = self.distances_mm;
            self.distances_mm = [rest + b, c, 0.0];
            self.known -= 1;
        }
        self.update_needs_sample();
    }
}
