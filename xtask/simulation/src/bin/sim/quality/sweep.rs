//! Windows that follow a motion: peaks of a derivative, and jumps of the speed.

use std::collections::VecDeque;

use leadscrew::{stepper::STEP_JITTER_TICKS, units::TICKS_PER_SECOND};
use serde::Serialize;

use super::fit::{Crossing, Fit};

/// Shortest window, s.
pub(super) const SHORTEST_S: f64 = 0.001;
/// Longest window, s.
const LONGEST_S: f64 = 0.25;
/// Standard deviations of what counts as the floor of the noise.
const SIGMAS: f64 = 4.0;
/// Maximum ratio of noise to value; with more noise the window grows.
const NOISE_PART: f64 = 0.05;

/// Jerk that windows resolve where no jerk limit is set, as the acceleration limit per time: the
/// limit is reached in 50 ms, 1/s.
const JERK_PER_S: f64 = 20.0;
/// The maximum apparent jump of the speed from an acceleration within its limit, as a part of the
/// limit times the window. It is the integral of the absolute weight of the acceleration in the estimate.
const JUMP_PART: f64 = 0.3955;

/// The quantity that a sweep measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Measurand {
    /// Mean speed.
    Speed,
    /// Mean acceleration.
    Acceleration,
    /// Mean jerk.
    Jerk,
    /// Jump of the speed that no acceleration explains.
    Jump,
}

impl Measurand {
    const fn degree(self) -> usize {
        match self {
            Self::Speed => 1,
            Self::Acceleration | Self::Jump => 2,
            Self::Jerk => 3,
        }
    }

    /// Minimum number of crossings of a window.
    const fn fewest(self) -> usize {
        match self {
            Self::Jump => 12,
            Self::Speed | Self::Acceleration | Self::Jerk => self.degree() + 4,
        }
    }

    /// Number of windows that contain a crossing.
    const fn overlap(self) -> f64 {
        match self {
            Self::Speed => 1.0,
            Self::Acceleration | Self::Jerk => 4.0,
            Self::Jump => 16.0,
        }
    }
}

/// The greatest value of a sweep.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct Peak {
    /// The absolute value minus the effect of allowed jumps.
    pub(crate) value: f64,
    /// The middle of the window, s since the first step.
    pub(crate) at_s: f64,
    /// Length of the window, s.
    pub(crate) window_s: f64,
    /// The noise floor of the window: the effect of the noise of the step times, and for a jump
    /// also of an acceleration within the limit.
    pub(crate) floor: f64,
    /// The greatest ratio of a value to its limit; `None` without a limit.
    pub(crate) of_limit: Option<f64>,
    /// Duration of the motion that windows covered, s.
    pub(crate) covered_s: f64,
}

/// A value over a window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    pub(super) value: f64,
}

/// Moves windows over crossings as they come.
#[derive(Debug, Clone)]
pub(super) struct Sweep {
    measurand: Measurand,
    /// Units of a position to the mm.
    scale: f64,
    points: VecDeque<Crossing>,
    /// Sum of the squared standard deviations of the times of the crossings, s².
    grains: f64,
    /// Allowed jumps: time, s, and size, of the speed, mm/s, and of the acceleration, mm/s².
    jumps: VecDeque<(f64, [f64; 2])>,
    covered_until: f64,
    /// The excess of the peak over its threshold: 0, or the floor of a jump.
    excess: f64,
    pub(super) peak: Peak,
}

impl Sweep {
    pub(super) fn new(measurand: Measurand, scale: f64) -> Self {
        Self {
            measurand,
            scale,
            excess: f64::NEG_INFINITY,
            points: VecDeque::new(),
            grains: 0.0,
            jumps: VecDeque::new(),
            covered_until: f64::NEG_INFINITY,
            peak: Peak::default(),
        }
    }

    /// Separates the following motion from the motion so far.
    pub(super) fn interrupt(&mut self) {
        self.points.clear();
        self.grains = 0.0;
    }

    /// Allows jumps of the speed and of the acceleration at a time.
    pub(super) fn allow(&mut self, seconds: f64, jumps: [f64; 2]) {
        self.jumps.push_back((seconds, jumps));
        let begin = self.points.front().map_or(seconds, |first| first.seconds);
        while self.jumps.front().is_some_and(|(at, _)| *at < begin) {
            self.jumps.pop_front();
        }
    }

    /// The maximum effect of allowed jumps on a window, mm/s to a power, each jump in the middle.
    ///
    /// In the middle a jump of 1 mm/s has the greatest weight of the mean of derivative 2, (1 - x²)² over
    /// its integral. The weight of derivative 3, (1 - x²)³, has its greatest slope, and in the middle the
    /// greatest weight of a jump of 1 mm/s².
    fn allowance(&self, from_s: f64, to_s: f64) -> f64 {
        let in_window = self
            .jumps
            .iter()
            .filter(|(at, _)| (from_s..=to_s).contains(at));
        let [speed, acceleration] = in_window.fold([0.0; 2], |sum, (_, jumps)| {
            [sum[0] + jumps[0], sum[1] + jumps[1]]
        });
        let seconds = to_s - from_s;
        match self.measurand {
            Measurand::Speed => 0.0,
            Measurand::Jump => speed,
            Measurand::Acceleration => speed * 1.875 / seconds,
            Measurand::Jerk => speed * 7.513 / seconds.powi(2) + acceleration * 2.1875 / seconds,
        }
    }

    /// Takes the next crossing. Returns the measurement over the window that ends with the crossing, if a window does.
    pub(super) fn push(&mut self, crossing: Crossing) -> Option<Measured> {
        self.points.push_back(crossing);
        self.grains += crossing.grain_s.powi(2);
        let (first, last) = (*self.points.front()?, crossing);
        let seconds = last.seconds - first.seconds;
        let is_long = seconds >= LONGEST_S;
        let enough = self.points.len() >= self.measurand.fewest() && seconds >= SHORTEST_S;
        if !enough || !(is_long || self.expected_noise(seconds) <= self.allowed_noise()) {
            return None;
        }
        let measured = self.measure(seconds);
        let next = first.seconds + seconds / self.measurand.overlap();
        while self.points.len() > 1 && self.points[0].seconds < next {
            let passed = self.points.pop_front().map_or(0.0, |point| point.grain_s);
            self.grains = (self.grains - passed.powi(2)).max(0.0);
        }
        measured
    }

    /// Standard deviation of a time in the window, s.
    fn grain_s(&self) -> f64 {
        (self.grains / self.points.len() as f64).sqrt()
    }

    /// Standard deviation of a position in the window, from the deviations of the times.
    fn position_noise(&self, seconds: f64) -> f64 {
        let distance = self.points.iter().zip(self.points.iter().skip(1));
        let distance: f64 = distance.map(|(a, b)| (b.position - a.position).abs()).sum();
        self.grain_s() * distance / seconds
    }

    /// The noise of a window, mm/s to a power, for crossings at even times.
    fn expected_noise(&self, seconds: f64) -> f64 {
        let grain_s = self.grain_s();
        let speed = (self.points.len() - 1) as f64 / seconds * self.step_mm();
        let root = (self.points.len() as f64).sqrt();
        let factor = match self.measurand {
            Measurand::Speed => 12.0_f64.sqrt() / seconds,
            Measurand::Acceleration => 720.0_f64.sqrt() / seconds.powi(2),
            Measurand::Jerk => 100_800.0_f64.sqrt() / seconds.powi(3),
            Measurand::Jump => 56.0 / seconds,
        };
        SIGMAS * grain_s * speed * factor / root + self.outlier(seconds)
    }

    /// The maximum effect of one step that is displaced by two spacings of events, mm/s to a power.
    ///
    /// At the end of a segment a step may be displaced, whatever other axes do. A crossing at an end of N even
    /// crossings has the greatest weight in the mean of derivative m: (2m + 1)!/m!/(N·T^m).
    fn outlier(&self, seconds: f64) -> f64 {
        const SHIFT_S: f64 = STEP_JITTER_TICKS as f64 / TICKS_PER_SECOND as f64;
        let count = self.points.len() as f64;
        let speed = (count - 1.0) / seconds * self.step_mm();
        let weight = match self.measurand {
            Measurand::Speed => 6.0 / seconds,
            Measurand::Acceleration => 60.0 / seconds.powi(2),
            Measurand::Jerk => 840.0 / seconds.powi(3),
            Measurand::Jump => 150.0 / seconds,
        };
        SHIFT_S * speed * weight / count
    }

    /// The distance between two crossings, mm.
    fn step_mm(&self) -> f64 {
        let (first, last) = (self.points[0], self.points[self.points.len() - 1]);
        let steps = (self.points.len() - 1).max(1) as f64;
        (last.position - first.position).abs() / steps / self.scale
    }

    fn allowed_noise(&self) -> f64 {
        let [acceleration, jerk] = self.points[self.points.len() / 2].limit;
        match self.measurand {
            Measurand::Speed => f64::INFINITY,
            Measurand::Jump => 0.5 * acceleration * SHORTEST_S,
            Measurand::Acceleration => NOISE_PART * acceleration,
            Measurand::Jerk if jerk > 0.0 => NOISE_PART * jerk,
            Measurand::Jerk => NOISE_PART * acceleration * JERK_PER_S,
        }
    }

    fn measure(&mut self, seconds: f64) -> Option<Measured> {
        let fit = Fit::new(&self.points.iter(), self.measurand.degree())?;
        let noise = self.position_noise(seconds);
        let (value, noise) = match self.measurand {
            Measurand::Jump => fit.jump(self.points.iter(), noise),
            Measurand::Speed | Measurand::Acceleration | Measurand::Jerk => {
                (fit.leading(), fit.leading_noise(noise))
            }
        };
        let value = value / self.scale;
        let mut floor = SIGMAS * noise / self.scale + self.outlier(seconds);
        let limit = |kind: usize| {
            let limits = self.points.iter().map(|point| point.limit[kind]);
            limits.fold(0.0, f64::max)
        };
        let (from_s, to_s) = (self.points[0].seconds, self.points[0].seconds + seconds);
        let allowance = self.allowance(from_s, to_s);
        let beyond_allowance = (value.abs() - allowance).max(0.0);
        let (excess, of_limit) = match self.measurand {
            Measurand::Speed => (beyond_allowance, 0.0),
            Measurand::Acceleration => (beyond_allowance, limit(0)),
            Measurand::Jerk => (beyond_allowance, limit(1)),
            Measurand::Jump => {
                floor += JUMP_PART * limit(0) * seconds;
                (beyond_allowance - floor, 0.0)
            }
        };
        let peak = &mut self.peak;
        peak.covered_s += to_s - from_s.max(self.covered_until);
        self.covered_until = to_s;
        if excess > self.excess {
            self.excess = excess;
            peak.value = beyond_allowance;
            peak.at_s = f64::midpoint(from_s, to_s);
            peak.window_s = seconds;
            peak.floor = floor;
        }
        if of_limit > 0.0 {
            let part = beyond_allowance / of_limit;
            peak.of_limit = Some(peak.of_limit.map_or(part, |most| most.max(part)));
        }
        Some(Measured {
            from_s,
            to_s,
            value,
        })
    }
}
