//! Speed, acceleration and jerk of each axis over time, of which every peak stays, and the corners.
//!
//! In a corner that `$11` lets pass at speed, the speeds of the axes change at once. These jumps are no part of the
//! accelerations: the corners are listed with their speeds.

use std::{array, f64::consts::PI};

use leadscrew::{
    axis::AXES,
    settings::Settings,
    sim::{PlayedSegment, SegmentKind},
    units::{TICKS_PER_MS, TICKS_PER_SECOND, TICKS_PER_US},
};

use crate::{
    columns::ColumnWriter,
    job::Corners,
    junction::{Point, allowed_mm_s, turn_rad},
    recording::scales,
};

/// Most stretches of a curve.
pub(crate) const STRETCHES: usize = 3000;
/// Shortest time over which an acceleration is measured, ticks: that of most segments.
const MEASURED: u64 = TICKS_PER_MS as u64 * 9 / 10;
/// Changes of direction that jump, rad, and those that count as a corner, as with `cargo xtask sim --quality`.
const KINK_RAD: f64 = 0.5 * PI / 180.0;
const CORNER_RAD: f64 = 5.0 * PI / 180.0;
/// Slowest speed that has a direction, mm/min.
const SLOWEST_MM_MIN: f32 = 0.1;
/// Levels between zero and the greatest value.
const LEVELS: f64 = 2000.0;

/// Least and greatest values of a quantity in stretches of time.
#[derive(Debug, Clone)]
pub(crate) struct Extremes {
    /// Length of a stretch, s.
    stretch_s: f64,
    /// Of a stretch without a value, [`NONE`].
    values: Vec<(f64, f64)>,
}

/// No value yet.
const NONE: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);

impl Default for Extremes {
    fn default() -> Self {
        Self {
            stretch_s: 0.001,
            values: Vec::new(),
        }
    }
}

impl Extremes {
    /// A quantity lies between two values for a time.
    fn push(&mut self, [from_s, to_s]: [f64; 2], [least, greatest]: [f64; 2]) {
        self.stretch_until(to_s);
        let place = |seconds: f64| (seconds / self.stretch_s) as usize;
        let (first, last) = (place(from_s), place(to_s));
        for value in &mut self.values[first..=last] {
            *value = (value.0.min(least), value.1.max(greatest));
        }
    }

    /// Makes the curve as long as a time.
    fn stretch_until(&mut self, to_s: f64) {
        while to_s / self.stretch_s >= STRETCHES as f64 {
            self.stretch_s *= 2.0;
            let pairs = self.values.chunks(2);
            let merged = pairs.map(|pair| {
                let least = pair.iter().map(|value| value.0).fold(NONE.0, f64::min);
                (
                    least,
                    pair.iter().map(|value| value.1).fold(NONE.1, f64::max),
                )
            });
            self.values = merged.collect();
        }
        let last = (to_s / self.stretch_s) as usize;
        if self.values.len() <= last {
            self.values.resize(last + 1, NONE);
        }
    }

    /// The greatest value, without its sign.
    pub(crate) fn greatest(&self) -> f64 {
        let known = self.values.iter().filter(|value| value.0.is_finite());
        known.fold(0.0, |most, (least, greatest)| {
            most.max(-least).max(*greatest)
        })
    }

    /// Returns the value of a level, and appends least and greatest levels.
    fn write(&self, bytes: &mut Vec<u8>) -> f64 {
        let level = self.greatest() / LEVELS;
        let levels = |value: f64| {
            let is_known = level > 0.0 && value.is_finite();
            if is_known {
                (value / level).round() as i64
            } else {
                0
            }
        };
        let (mut least, mut greatest) = (ColumnWriter::default(), ColumnWriter::default());
        for value in &self.values {
            least.push(levels(value.0));
            greatest.push(levels(value.1));
        }
        bytes.append(&mut least.bytes);
        bytes.append(&mut greatest.bytes);
        level
    }
}

/// The curves of an axis.
#[derive(Debug, Clone, Default)]
pub(crate) struct AxisCurves {
    /// mm/s or degrees/s, mm/s², mm/s³.
    pub(crate) derivatives: [Extremes; 3],
    /// Speed and acceleration at the end of what has been measured.
    speed: f64,
    acceleration: f64,
    /// Jumps of the speed since then.
    jumps: f64,
}

impl AxisCurves {
    fn push(&mut self, between_s: [f64; 2], speed: f64) {
        let seconds = between_s[1] - between_s[0];
        let acceleration = (speed - self.speed - std::mem::take(&mut self.jumps)) / seconds;
        let jerk = (acceleration - self.acceleration) / seconds;
        let speeds = [speed.min(self.speed), speed.max(self.speed)];
        for (curve, values) in
            self.derivatives
                .iter_mut()
                .zip([speeds, [acceleration; 2], [jerk; 2]])
        {
            if values != [0.0; 2] {
                curve.push(between_s, values);
            }
        }
        (self.speed, self.acceleration) = (speed, acceleration);
    }

    pub(crate) fn has_moved(&self) -> bool {
        self.derivatives[0].greatest() > 0.0
    }
}

/// A corner that is passed at speed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Corner {
    /// Time since the first motion, µs.
    us: u64,
    speed_mm_min: f64,
    /// The speed that the junction deviation allows, mm/min.
    allowed_mm_min: f64,
}

impl Corner {
    fn share(&self) -> f64 {
        self.speed_mm_min / self.allowed_mm_min
    }
}

/// The curves of all axes.
#[derive(Debug, Clone)]
pub(crate) struct Curves {
    /// Steps per mm or degree.
    scales: [f64; AXES],
    pub(crate) axes: [AxisCurves; AXES],
    /// Limit of each axis, mm/s², and the junction deviation, mm.
    accelerations: Point,
    deviation_mm: f64,
    corners: Vec<Corner>,
    /// Start of the first segment, ticks.
    origin: Option<u64>,
    /// How far has been measured, ticks.
    measured: u64,
    /// The segment that is played.
    played: Option<PlayedSegment>,
}

impl Curves {
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            scales: scales(settings),
            axes: Default::default(),
            accelerations: settings.acceleration_mm_s2.0.map(f64::from),
            deviation_mm: settings.junction_deviation_mm.into(),
            corners: Vec::new(),
            origin: None,
            measured: 0,
            played: None,
        }
    }

    /// Adds the segment that begins: the one before it has ended.
    pub(crate) fn push(&mut self, segment: &PlayedSegment) {
        let begins = segment.start_ticks;
        if let (Some(played), Some(origin)) = (self.played, self.origin) {
            let is_still = played.kind == SegmentKind::Standstill;
            if begins >= self.measured + MEASURED {
                // A standstill may be long: what the axes do at its beginning is over soon.
                let end = if is_still {
                    begins.min(self.measured + MEASURED)
                } else {
                    begins
                };
                let seconds = |ticks: u64| (ticks - origin) as f64 / f64::from(TICKS_PER_SECOND);
                let between_s = [seconds(self.measured), seconds(end)];
                for (axis, curves) in self.axes.iter_mut().enumerate() {
                    let speed = f64::from(played.end_steps_s[axis]) / self.scales[axis];
                    curves.push(between_s, speed);
                    if is_still && end < begins {
                        curves.acceleration = 0.0;
                    }
                }
                self.measured = begins;
            }
            self.pass_corner(&played, segment, begins - origin);
        } else {
            self.origin = Some(begins);
            self.measured = begins;
        }
        self.played = Some(*segment);
    }

    /// Takes the corner between two segments, if there is one.
    fn pass_corner(&mut self, played: &PlayedSegment, segment: &PlayedSegment, ticks: u64) {
        if played.end_mm_min < SLOWEST_MM_MIN || segment.kind == SegmentKind::Standstill {
            return;
        }
        let speed_mm_s = f64::from(played.end_mm_min) / 60.0;
        let [before, after] = [played.end_steps_s, segment.begin_steps_s].map(|steps_s| -> Point {
            array::from_fn(|axis| f64::from(steps_s[axis]) / self.scales[axis] / speed_mm_s)
        });
        let turn = turn_rad(&before, &after);
        // Nothing has a direction whose axes do not move.
        if turn.is_nan() || turn < KINK_RAD {
            return;
        }
        for (axis, curves) in self.axes.iter_mut().enumerate() {
            curves.jumps += (after[axis] - before[axis]) * speed_mm_s;
        }
        if turn > CORNER_RAD {
            let allowed = allowed_mm_s(&before, &after, &self.accelerations, self.deviation_mm);
            self.corners.push(Corner {
                us: ticks / u64::from(TICKS_PER_US),
                speed_mm_min: played.end_mm_min.into(),
                allowed_mm_min: allowed * 60.0,
            });
        }
    }

    /// Appends the corners; of more than [`STRETCHES`], the one of each stretch that uses the most of what is allowed.
    /// Returns how many are appended, and the figures of all.
    pub(crate) fn write_corners(&self, bytes: &mut Vec<u8>) -> Corners {
        let corners = &self.corners;
        let end_us = corners.last().map_or(0, |corner| corner.us);
        let stretch = |corner: &Corner| corner.us * STRETCHES as u64 / (end_us + 1);
        let is_whole = corners.len() <= STRETCHES;
        let stretches = corners.chunk_by(|a, b| !is_whole && stretch(a) == stretch(b));
        let kept =
            stretches.filter_map(|all| all.iter().max_by(|a, b| a.share().total_cmp(&b.share())));
        let mut columns: [ColumnWriter; 3] = Default::default();
        let mut written = 0;
        for corner in kept {
            columns[0].push(corner.us.cast_signed());
            columns[1].push(corner.speed_mm_min.round() as i64);
            columns[2].push(corner.allowed_mm_min.round() as i64);
            written += 1;
        }
        for column in &mut columns {
            bytes.append(&mut column.bytes);
        }
        let speeds = || corners.iter().map(|corner| corner.speed_mm_min);
        Corners {
            count: corners.len(),
            written,
            slowest: speeds().reduce(f64::min),
            fastest: speeds().reduce(f64::max),
            most_of_allowed: corners.iter().map(Corner::share).reduce(f64::max),
        }
    }

    /// Makes all curves as long as a job, with stretches of the same length.
    pub(crate) fn finish(&mut self, seconds: f64) -> f64 {
        let curves = || self.axes.iter().flat_map(|axis| &axis.derivatives);
        let stretch_s = curves().map(|curve| curve.stretch_s).fold(0.001, f64::max);
        let seconds = seconds.max(stretch_s * (STRETCHES / 2) as f64);
        for curve in self.axes.iter_mut().flat_map(|axis| &mut axis.derivatives) {
            curve.stretch_until(seconds);
        }
        self.axes[0].derivatives[0].stretch_s
    }

    /// Appends the curves of an axis; returns the values of their levels.
    pub(crate) fn write(&self, axis: usize, bytes: &mut Vec<u8>) -> [f64; 3] {
        let curves = &self.axes[axis].derivatives;
        [0, 1, 2].map(|index| curves[index].write(bytes))
    }
}

#[cfg(test)]
mod tests {
    use leadscrew::{axis::Axes, settings::assign};

    use super::*;

    /// A machine of 10 steps/mm.
    fn settings() -> Settings {
        let mut settings = Settings::default();
        for statement in ["100=10", "101=10", "102=10"] {
            assign(&mut settings, statement.as_bytes()).expect("the scales are accepted");
        }
        settings
    }

    /// An axis that is as fast as the function says at the end of each ms.
    fn curves(ms: u32, speed: impl Fn(u32) -> f32) -> Curves {
        let mut curves = Curves::new(&settings());
        for number in 0..=ms {
            let mut end_steps_s = Axes([0.0; AXES]);
            end_steps_s[0] = 10.0 * speed(number + 1);
            curves.push(&PlayedSegment {
                start_ticks: 7 + u64::from(number) * u64::from(TICKS_PER_MS),
                steps: Axes([0; AXES]),
                end_mm_min: 0.0,
                begin_steps_s: end_steps_s,
                end_steps_s,
                programmed_mm_min: 0.0,
                line: 0,
                kind: SegmentKind::Feed,
                duty: 0,
            });
        }
        curves
    }

    #[test]
    fn derivatives_of_a_ramp_are_right() {
        let curves = curves(100, |ms| 0.5 * ms.min(50) as f32);
        let [speed, acceleration, jerk] = curves.axes[0]
            .derivatives
            .each_ref()
            .map(Extremes::greatest);
        assert!((speed - 25.0).abs() < 1e-6, "{speed}");
        assert!((acceleration - 500.0).abs() < 1e-3, "{acceleration}");
        assert!((jerk - 500_000.0).abs() < 1.0, "{jerk}");
        assert!(!curves.axes[1].has_moved());
    }

    #[test]
    fn the_jump_of_a_corner_is_no_acceleration() {
        let mut curves = Curves::new(&settings());
        // 1 mm/s along X, and from 50 ms on along Y.
        for number in 0..=100 {
            let axis = usize::from(number >= 50);
            let mut steps_s = Axes([0.0; AXES]);
            steps_s[axis] = 10.0;
            curves.push(&PlayedSegment {
                start_ticks: number * u64::from(TICKS_PER_MS),
                steps: Axes([0; AXES]),
                end_mm_min: 60.0,
                begin_steps_s: steps_s,
                end_steps_s: steps_s,
                programmed_mm_min: 60.0,
                line: 1,
                kind: SegmentKind::Feed,
                duty: 0,
            });
        }
        for axis in 0..2 {
            let [_, acceleration, jerk] = &curves.axes[axis].derivatives;
            // X begins at speed.
            let begun = if axis == 0 { 1000.0 } else { 0.0 };
            assert!((acceleration.greatest() - begun).abs() < 1.0, "{axis}");
            assert!(axis == 0 || jerk.greatest() < 1.0);
        }
        let corners = curves.write_corners(&mut Vec::new());
        // 10 mm/s² and 0.01 mm, as in the tests of the quality.
        let allowed = 60.0 * (10.0 * 2.0_f64.sqrt() * 0.01 * 2.414_213_562).sqrt();
        let share = corners.most_of_allowed.expect("there is a corner");
        assert!((share - 60.0 / allowed).abs() < 1.0e-6, "{share}");
        assert_eq!((corners.count, corners.written), (1, 1));
        assert_eq!((corners.slowest, corners.fastest), (Some(60.0), Some(60.0)));
    }

    #[test]
    fn a_peak_stays_in_a_long_job() {
        let mut curves = curves(200_000, |ms| if ms == 54_321 { 9.0 } else { 1.0 });
        let stretch_s = curves.finish(200.0);
        let speed = &curves.axes[0].derivatives[0];
        assert!(speed.values.len() <= STRETCHES);
        assert_eq!(speed.values[(54.321 / stretch_s) as usize].1, 9.0);
        assert_eq!(speed.values[(60.0 / stretch_s) as usize], (1.0, 1.0));
        let lengths = curves.axes.iter().flat_map(|axis| &axis.derivatives);
        assert!(
            lengths
                .map(|curve| curve.values.len())
                .all(|length| length == speed.values.len())
        );
    }
}
