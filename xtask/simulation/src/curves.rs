//! Speed, acceleration and jerk of each axis over time, of which every peak stays.

use leadscrew::{
    axis::AXES,
    sim::{PlayedSegment, SegmentKind},
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};

use crate::columns::ColumnWriter;

/// Most stretches of a curve.
pub(crate) const STRETCHES: usize = 3000;
/// Shortest time over which an acceleration is measured, ticks: that of most segments. At a corner the speed
/// of an axis changes at once, within what `$11` allows.
const MEASURED: u64 = TICKS_PER_MS as u64 * 9 / 10;
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
}

impl AxisCurves {
    fn push(&mut self, between_s: [f64; 2], speed: f64) {
        let seconds = between_s[1] - between_s[0];
        let acceleration = (speed - self.speed) / seconds;
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

/// The curves of all axes.
#[derive(Debug, Clone)]
pub(crate) struct Curves {
    /// Steps per mm or degree.
    scales: [f64; AXES],
    pub(crate) axes: [AxisCurves; AXES],
    /// Start of the first segment, ticks.
    origin: Option<u64>,
    /// How far has been measured, ticks.
    measured: u64,
    /// The segment that is played.
    played: Option<PlayedSegment>,
}

impl Curves {
    pub(crate) fn new(scales: [f64; AXES]) -> Self {
        Self {
            scales,
            axes: Default::default(),
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
        } else {
            self.origin = Some(begins);
            self.measured = begins;
        }
        self.played = Some(*segment);
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
    use leadscrew::axis::Axes;

    use super::*;

    /// An axis that is as fast as the function says at the end of each ms.
    fn curves(ms: u32, speed: impl Fn(u32) -> f32) -> Curves {
        let mut curves = Curves::new([10.0; AXES]);
        for number in 0..=ms {
            let mut end_steps_s = Axes([0.0; AXES]);
            end_steps_s[0] = 10.0 * speed(number + 1);
            curves.push(&PlayedSegment {
                start_ticks: 7 + u64::from(number) * u64::from(TICKS_PER_MS),
                steps: Axes([0; AXES]),
                end_mm_min: 0.0,
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
