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
/// The part of what is measured that the noise may be, or else the window grows.
const NOISE_PART: f64 = 0.05;

/// Without a limit of the jerk, windows are such that one can be told which reaches the acceleration's
/// limit in 50 ms, 1/s.
const JERK_PER_S: f64 = 20.0;
/// The most that an acceleration within its limit looks like as a jump of the speed, as a part of the
/// limit times the window: the integral of the estimate's weight on the acceleration, without its sign.
const JUMP_PART: f64 = 0.3955;

/// What a sweep looks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sought {
    /// Mean speed.
    Speed,
    /// Mean acceleration.
    Acceleration,
    /// Mean jerk.
    Jerk,
    /// Jump of the speed that no acceleration explains.
    Jump,
}

impl Sought {
    const fn degree(self) -> usize {
        match self {
            Self::Speed => 1,
            Self::Acceleration | Self::Jump => 2,
            Self::Jerk => 3,
        }
    }

    /// Fewest crossings of a window.
    const fn fewest(self) -> usize {
        match self {
            Self::Jump => 12,
            Self::Speed | Self::Acceleration | Self::Jerk => self.degree() + 4,
        }
    }

    /// Windows that each crossing is in.
    const fn overlap(self) -> f64 {
        match self {
            Self::Speed => 1.0,
            Self::Acceleration | Self::Jerk => 4.0,
            Self::Jump => 16.0,
        }
    }
}

/// The greatest value that was found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct Peak {
    /// The value, without its sign and without what allowed jumps may have made of it.
    pub(crate) value: f64,
    /// When: the middle of its window, s since the first step.
    pub(crate) at_s: f64,
    /// Length of its window, s.
    pub(crate) window_s: f64,
    /// What may be nothing: what the noise of the step times alone can make in that window, and for a
    /// jump what any acceleration within the limit can.
    pub(crate) floor: f64,
    /// The greatest value as a part of the limit where it was found; `None` without a limit.
    pub(crate) of_limit: Option<f64>,
    /// Motion that windows covered, s.
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
    sought: Sought,
    /// Units of a position to the mm.
    scale: f64,
    points: VecDeque<Crossing>,
    /// Squares of their times' standard deviations, summed, s².
    grains: f64,
    /// Jumps of the speed that are allowed: when, s, and how large, mm/s.
    jumps: VecDeque<(f64, f64)>,
    covered_until: f64,
    /// By how much the peak exceeds what it is judged by: nothing, or for a jump its floor.
    excess: f64,
    pub(super) peak: Peak,
}

impl Sweep {
    pub(super) fn new(sought: Sought, scale: f64) -> Self {
        Self {
            sought,
            scale,
            excess: f64::NEG_INFINITY,
            points: VecDeque::new(),
            grains: 0.0,
            jumps: VecDeque::new(),
            covered_until: f64::NEG_INFINITY,
            peak: Peak::default(),
        }
    }

    /// What comes after has nothing to do with what came before.
    pub(super) fn cut(&mut self) {
        self.points.clear();
        self.grains = 0.0;
    }

    /// The speed jumps at a time, and may.
    pub(super) fn allow(&mut self, seconds: f64, jump_mm_s: f64) {
        self.jumps.push_back((seconds, jump_mm_s));
        let begin = self.points.front().map_or(seconds, |first| first.seconds);
        while self.jumps.front().is_some_and(|(at, _)| *at < begin) {
            self.jumps.pop_front();
        }
    }

    /// What allowed jumps make of a window at most, mm/s to a power: each in its middle. A jump of 1 mm/s
    /// has there the greatest weight of the mean of derivative 2, (1 - x²)² over its integral, and the
    /// greatest slope of that of derivative 3, (1 - x²)³.
    fn allowance(&self, from_s: f64, to_s: f64) -> f64 {
        let in_window = self
            .jumps
            .iter()
            .filter(|(at, _)| (from_s..=to_s).contains(at));
        let jumps: f64 = in_window.map(|(_, jump)| jump).sum();
        let seconds = to_s - from_s;
        jumps
            * match self.sought {
                Sought::Speed => 0.0,
                Sought::Jump => 1.0,
                Sought::Acceleration => 1.875 / seconds,
                Sought::Jerk => 7.513 / seconds.powi(2),
            }
    }

    /// Takes the next crossing; what was measured over the window that ends with it, if one does.
    pub(super) fn push(&mut self, crossing: Crossing) -> Option<Measured> {
        self.points.push_back(crossing);
        self.grains += crossing.grain_s.powi(2);
        let (first, last) = (*self.points.front()?, crossing);
        let seconds = last.seconds - first.seconds;
        let is_long = seconds >= LONGEST_S;
        let enough = self.points.len() >= self.sought.fewest() && seconds >= SHORTEST_S;
        if !enough || !(is_long || self.expected_noise(seconds) <= self.allowed_noise()) {
            return None;
        }
        let measured = self.measure(seconds);
        let next = first.seconds + seconds / self.sought.overlap();
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

    /// Standard deviation of a position in the window, from those of the times.
    fn position_noise(&self, seconds: f64) -> f64 {
        let way = self.points.iter().zip(self.points.iter().skip(1));
        let way: f64 = way.map(|(a, b)| (b.position - a.position).abs()).sum();
        self.grain_s() * way / seconds
    }

    /// The noise of a window, mm/s to a power, for crossings at even times.
    fn expected_noise(&self, seconds: f64) -> f64 {
        let grain_s = self.grain_s();
        let speed = (self.points.len() - 1) as f64 / seconds * self.step_mm();
        let root = (self.points.len() as f64).sqrt();
        let factor = match self.sought {
            Sought::Speed => 12.0_f64.sqrt() / seconds,
            Sought::Acceleration => 720.0_f64.sqrt() / seconds.powi(2),
            Sought::Jerk => 100_800.0_f64.sqrt() / seconds.powi(3),
            Sought::Jump => 56.0 / seconds,
        };
        SIGMAS * grain_s * speed * factor / root + self.outlier(seconds)
    }

    /// What one step that makes way by two spacings of events can make, mm/s to a power: at the end of
    /// a segment it may, whatever other axes do. A crossing at either end of N even ones has the weight
    /// (2m + 1)!/m!/(N·T^m) in the mean of derivative m, the greatest.
    fn outlier(&self, seconds: f64) -> f64 {
        const SHIFT_S: f64 = STEP_JITTER_TICKS as f64 / TICKS_PER_SECOND as f64;
        let count = self.points.len() as f64;
        let speed = (count - 1.0) / seconds * self.step_mm();
        let weight = match self.sought {
            Sought::Speed => 6.0 / seconds,
            Sought::Acceleration => 60.0 / seconds.powi(2),
            Sought::Jerk => 840.0 / seconds.powi(3),
            Sought::Jump => 150.0 / seconds,
        };
        SHIFT_S * speed * weight / count
    }

    /// The way between two crossings, mm.
    fn step_mm(&self) -> f64 {
        let (first, last) = (self.points[0], self.points[self.points.len() - 1]);
        let steps = (self.points.len() - 1).max(1) as f64;
        (last.position - first.position).abs() / steps / self.scale
    }

    fn allowed_noise(&self) -> f64 {
        let [acceleration, jerk] = self.points[self.points.len() / 2].limit;
        match self.sought {
            Sought::Speed => f64::INFINITY,
            Sought::Jump => 0.5 * acceleration * SHORTEST_S,
            Sought::Acceleration => NOISE_PART * acceleration,
            Sought::Jerk if jerk > 0.0 => NOISE_PART * jerk,
            Sought::Jerk => NOISE_PART * acceleration * JERK_PER_S,
        }
    }

    fn measure(&mut self, seconds: f64) -> Option<Measured> {
        let fit = Fit::new(&self.points.iter(), self.sought.degree())?;
        let noise = self.position_noise(seconds);
        let (value, noise) = match self.sought {
            Sought::Jump => fit.jump(self.points.iter(), noise),
            Sought::Speed | Sought::Acceleration | Sought::Jerk => {
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
        let beside = (value.abs() - allowance).max(0.0);
        let (excess, of_limit) = match self.sought {
            Sought::Speed => (beside, 0.0),
            Sought::Acceleration => (beside, limit(0)),
            Sought::Jerk => (beside, limit(1)),
            Sought::Jump => {
                floor += JUMP_PART * limit(0) * seconds;
                (beside - floor, 0.0)
            }
        };
        let peak = &mut self.peak;
        peak.covered_s += to_s - from_s.max(self.covered_until);
        self.covered_until = to_s;
        if excess > self.excess {
            self.excess = excess;
            peak.value = beside;
            peak.at_s = f64::midpoint(from_s, to_s);
            peak.window_s = seconds;
            peak.floor = floor;
        }
        if of_limit > 0.0 {
            let part = beside / of_limit;
            peak.of_limit = Some(peak.of_limit.map_or(part, |most| most.max(part)));
        }
        Some(Measured {
            from_s,
            to_s,
            value,
        })
    }
}
