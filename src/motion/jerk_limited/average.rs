//! Motion of continuous acceleration: the mean of a motion whose acceleration is the same in each sample.
//!
//! The *reference motion* has one acceleration in each *sample* of 1 ms; the next is different by no more than the
//! jerk allows. The machine's motion is the moving average of the reference over an *averaging window* of two samples: so
//! its acceleration changes linearly. The distance along the path is averaged, so that the path itself does not change.
//! Read with the moving average as an interpolator of acceleration and deceleration in numerical controls; for the limits
//! that the reference keeps, see [`super::junctions`]. A feed hold, a cycle start, or an override acts on the reference.
//!
//! # Cost
//!
//! Whether a sample is needed is stored whenever that changes, as each run of `prepare` reads it twice. The fields of
//! [`MovingAverage`] are in this order in memory: what a reset makes 0 is in parts, of which each is a few stores.

use super::reference::{LeavingSample, Sample, UNIT_MM};
use crate::{
    math,
    model::timing::SAMPLE_S,
    motion::limits::{LONGEST_SEGMENT_S, MIN_DIVISOR_MM_S},
};

/// Samples of the averaging window: with fewer, accelerations would change at once.
const WINDOW_SAMPLES: usize = 2;
/// Length of the window, s.
const WINDOW_S: f32 = WINDOW_SAMPLES as f32 * SAMPLE_S;
/// The mean's speed for a unit in the window, mm/s.
const SPEED_PER_UNIT: f32 = UNIT_MM / WINDOW_S;
/// Half the jerk of a sample for a difference of speed, 1/s²: 0.5/(sample · window).
const HALF_JERK_PER_SPEED: f32 = 0.5 / (SAMPLE_S * WINDOW_S);
/// Most samples known, the one being played included.
pub(in crate::motion) const SAMPLES_AHEAD: usize = 3;
/// Time that is known when a segment is made, s: the longest segment's, and 1 µs for rounding.
const KNOWN_S: f32 = LONGEST_SEGMENT_S + 1.0e-6;

/// The moving average of the reference, from the sample being played on.
#[derive(Debug)]
#[repr(C)]
pub(in crate::motion) struct MovingAverage {
    /// Speed at the beginnings of samples, mm/s, the one being played first.
    speeds: [f32; SAMPLES_AHEAD + 1],
    /// Half the jerk in each, mm/s³.
    half_jerks: [f32; SAMPLES_AHEAD],
    /// The distance in each, mm; of the first its remainder. 0 for a sample that is not known.
    distances_mm: [f32; SAMPLES_AHEAD],
    /// Samples known, the one being played first.
    known: usize,
    /// Time of the first sample that has been played, s.
    played_s: f32,
    /// The next segment needs another sample.
    needs_sample: bool,
    /// Distance of the reference in the window, units.
    sum: u32,
    /// Remainder of the division by the window's length, units.
    remainder: u32,
    /// Speed at the end of that sample, mm/s.
    end_mm_s: f32,
    /// Samples since the last standstill, one more than are known ahead at most.
    age: usize,
    /// Distance of the reference in each sample, units, the oldest first.
    distances: [u32; WINDOW_SAMPLES],
    /// Change of the reference's speed in each sample, mm/s, the oldest first.
    speed_changes_mm_s: [f32; WINDOW_SAMPLES],
    /// Motion has limits of jerk.
    is_active: bool,
}

/// A point of the path ahead.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct PathPoint {
    /// Time from now to the point, s.
    pub(in crate::motion) seconds: f32,
    /// Distance from here, mm.
    pub(in crate::motion) distance_mm: f32,
    /// Speed there, mm/s.
    pub(in crate::motion) speed_mm_s: f32,
}

/// The distance that a jerk takes from an evenly changing speed in a time, mm.
fn jerk_distance_mm(half_jerk: f32, seconds: f32) -> f32 {
    half_jerk * ((1.0 / 6.0) * seconds * seconds * seconds)
}

/// The known motion ahead: where the machine is now, and will be at the ends of samples.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct Forecast {
    points: [PathPoint; SAMPLES_AHEAD + 1],
    /// The last of these points.
    pub(in crate::motion) end: PathPoint,
    /// The first standstill before it.
    pub(in crate::motion) standstill: Option<PathPoint>,
}

impl MovingAverage {
    pub(in crate::motion) const fn new() -> Self {
        Self {
            speeds: [0.0; SAMPLES_AHEAD + 1],
            half_jerks: [0.0; SAMPLES_AHEAD],
            distances_mm: [0.0; SAMPLES_AHEAD],
            known: 0,
            played_s: 0.0,
            needs_sample: false,
            sum: 0,
            remainder: 0,
            end_mm_s: 0.0,
            age: 0,
            distances: [0; WINDOW_SAMPLES],
            speed_changes_mm_s: [0.0; WINDOW_SAMPLES],
            is_active: false,
        }
    }

    /// Sets whether motion has limits of jerk. At standstill only.
    pub(in crate::motion) fn configure(&mut self, is_active: bool) {
        self.is_active = is_active;
        self.reset();
    }

    /// Drops the motion: the machine is at a standstill.
    pub(in crate::motion) fn reset(&mut self) {
        self.speeds = [0.0; SAMPLES_AHEAD + 1];
        self.distances_mm = [0.0; SAMPLES_AHEAD];
        self.known = 0;
        self.played_s = 0.0;
        self.sum = 0;
        self.remainder = 0;
        self.end_mm_s = 0.0;
        self.age = 0;
        self.distances = [0; WINDOW_SAMPLES];
        self.speed_changes_mm_s = [0.0; WINDOW_SAMPLES];
        self.needs_sample = self.is_active;
    }

    /// Whether the reference's motion has been played to its end.
    pub(in crate::motion) fn is_at_standstill(&self) -> bool {
        let mut sum = 0.0;
        for speed in &self.speeds {
            sum += speed;
        }
        self.sum == 0 && sum <= 0.0
    }

    /// Whether nothing has been played since the standstill.
    pub(in crate::motion) fn is_first_segment(&self) -> bool {
        self.age <= SAMPLES_AHEAD && self.played_s <= 0.0
    }

    /// Whether the next segment needs another sample of the reference: the longest segment must be
    /// known, and from a standstill one more sample. No more, as a feed hold acts behind them.
    #[inline]
    pub(in crate::motion) fn needs_sample(&self) -> bool {
        self.needs_sample
    }

    fn update_needs_sample(&mut self) {
        let min_s = if self.is_first_segment() {
            SAMPLES_AHEAD as f32 * SAMPLE_S
        } else {
            KNOWN_S
        };
        self.needs_sample = self.known < SAMPLES_AHEAD && self.known_s() < min_s;
    }

    /// The sample that leaves the window with the next one.
    pub(in crate::motion) fn leaving_sample(&self) -> LeavingSample {
        let [change, _] = self.speed_changes_mm_s;
        LeavingSample {
            change,
            is_standstill: self.sum == 0,
        }
    }

    /// Adds the next sample of the reference.
    pub(in crate::motion) fn push(&mut self, sample: Sample, leaving: LeavingSample) {
        let known = self.known;
        if known >= SAMPLES_AHEAD {
            return;
        }
        self.age = (self.age + 1).min(SAMPLES_AHEAD + 1);
        let change = sample.end_mm_s - self.end_mm_s;
        self.end_mm_s = sample.end_mm_s;
        let [oldest, newer] = self.distances;
        self.distances = [newer, sample.distance];
        let [_, newer] = self.speed_changes_mm_s;
        self.speed_changes_mm_s = [newer, change];
        let before = self.sum.wrapping_add(self.remainder);
        self.sum = self.sum.wrapping_add(sample.distance).wrapping_sub(oldest);
        let double = before.wrapping_add(self.sum);
        let shares = 2 * WINDOW_SAMPLES as u32;
        let distance = double / shares;
        self.remainder = double - distance * shares;
        let half_jerk = (change - leaving.change) * HALF_JERK_PER_SPEED;
        self.half_jerks[known] = half_jerk;
        self.distances_mm[known] +=
            distance as f32 * UNIT_MM - jerk_distance_mm(half_jerk, SAMPLE_S);
        self.known = known + 1;
        self.speeds[known + 1] = self.sum as f32 * SPEED_PER_UNIT;
        self.update_needs_sample();
    }

    /// Known time from now on, s.
    fn known_s(&self) -> f32 {
        self.known as f32 * SAMPLE_S - self.played_s
    }

    /// The known motion ahead, from the present speed.
    pub(in crate::motion) fn forecast(&self, speed_mm_s: f32) -> Forecast {
        let mut end = PathPoint {
            seconds: 0.0,
            distance_mm: 0.0,
            speed_mm_s,
        };
        let mut forecast = Forecast {
            points: [end; SAMPLES_AHEAD + 1],
            end,
            standstill: None,
        };
        let mut sample_s = SAMPLE_S - self.played_s;
        let ends = self.speeds[1..].iter().zip(&self.distances_mm);
        for (point, (to, distance)) in forecast.points[1..].iter_mut().zip(ends).take(self.known) {
            if end.speed_mm_s <= 0.0 && end.seconds > 0.0 && forecast.standstill.is_none() {
                forecast.standstill = Some(end);
            }
            end = PathPoint {
                seconds: end.seconds + sample_s,
                distance_mm: end.distance_mm + distance,
                speed_mm_s: *to,
            };
            *point = end;
            sample_s = SAMPLE_S;
        }
        forecast.end = end;
        forecast
    }

    /// The point after a time, which must be known.
    pub(in crate::motion) fn point_after(&self, forecast: &Forecast, seconds: f32) -> PathPoint {
        let sample = ((self.played_s + seconds) * (1.0 / SAMPLE_S)) as usize;
        let sample = sample.min(SAMPLES_AHEAD - 1);
        self.point_within(forecast, sample, seconds - forecast.points[sample].seconds)
    }

    /// The point after a distance, which must be known.
    pub(in crate::motion) fn point_at(&self, forecast: &Forecast, distance_mm: f32) -> PathPoint {
        let [_, a, b, _] = &forecast.points;
        let sample = if distance_mm <= a.distance_mm || self.known <= 1 {
            0
        } else if distance_mm <= b.distance_mm || self.known <= 2 {
            1
        } else {
            2
        };
        let [from, to] = [&forecast.points[sample], &forecast.points[sample + 1]];
        let most_s = to.seconds - from.seconds;
        let to_go_mm = distance_mm - from.distance_mm;
        // As if its speed changed evenly, ...
        let (v, change) = (from.speed_mm_s, to.speed_mm_s - from.speed_mm_s);
        let square = v * v + 2.0 * to_go_mm * change / most_s;
        let sum = v + math::sqrt(math::max(square, 0.0));
        let about_s = math::min(2.0 * to_go_mm / math::max(sum, MIN_DIVISOR_MM_S), most_s);
        // ... and nearer by Newton's method.
        let about = self.point_within(forecast, sample, about_s);
        let late_s =
            (about.distance_mm - distance_mm) / math::max(about.speed_mm_s, MIN_DIVISOR_MM_S);
        let seconds = math::min(math::max(about_s - late_s, 0.5 * about_s), most_s);
        PathPoint {
            distance_mm,
            ..self.point_within(forecast, sample, seconds)
        }
    }

    /// The point a time after the beginning of a sample's remainder.
    fn point_within(&self, forecast: &Forecast, sample: usize, seconds: f32) -> PathPoint {
        let [from, to] = [&forecast.points[sample], &forecast.points[sample + 1]];
        let seconds = from.seconds + seconds;
        let remaining_s = to.seconds - seconds;
        let half_jerk = self.half_jerks[sample];
        let change = (self.speeds[sample + 1] - self.speeds[sample]) * (1.0 / SAMPLE_S);
        let evenly = to.speed_mm_s - change * remaining_s;
        let speed_mm_s = math::max(
            evenly - half_jerk * remaining_s * (SAMPLE_S - remaining_s),
            0.0,
        );
        let remaining_mm = 0.5 * (speed_mm_s + to.speed_mm_s) * remaining_s
            - jerk_distance_mm(half_jerk, remaining_s);
        PathPoint {
            seconds,
            distance_mm: to.distance_mm - remaining_mm,
            speed_mm_s,
        }
    }

    /// Goes on by a time, which must be known, and its distance.
    pub(in crate::motion) fn advance(&mut self, seconds: f32, distance_mm: f32) {
        self.played_s += seconds;
        let [first, ..] = &mut self.distances_mm;
        *first -= distance_mm;
        for _ in 0..SAMPLES_AHEAD {
            if self.played_s < SAMPLE_S || self.known == 0 {
                break;
            }
            self.played_s -= SAMPLE_S;
            let [_, b, c, d] = self.speeds;
            self.speeds = [b, c, d, 0.0];
            let [_, b, c] = self.half_jerks;
            self.half_jerks = [b, c, 0.0];
            let [a, b, c] = self.distances_mm;
            self.distances_mm = [a + b, c, 0.0];
            self.known -= 1;
        }
        self.update_needs_sample();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A moving average.
    fn average() -> MovingAverage {
        let mut average = MovingAverage::new();
        average.configure(true);
        average
    }

    /// Adds samples of these distances, units. Returns how far they lead, mm.
    fn push(average: &mut MovingAverage, distances: &[u32]) -> f32 {
        for &distance in distances {
            let leaving = average.leaving_sample();
            let end_mm_s = 0.0;
            average.push(Sample { distance, end_mm_s }, leaving);
        }
        average.forecast(0.0).end.distance_mm
    }

    #[test]
    fn a_motion_that_was_dropped_leaves_nothing_to_the_next() {
        let mut average = average();
        let first_mm = push(&mut average, &[13]);
        for distances in [[1, 0], [13, 13], [5, 0]] {
            average.reset();
            push(&mut average, &distances);
            average.reset();
            assert_eq!(push(&mut average, &[13]), first_mm, "{distances:?}");
        }
    }
}
