//! The steps of one axis within a segment: how many, and when.
//!
//! q(τ) = vτ + aτ²/2 in steps, and step k falls where q crosses half-way to it. Each time is found
//! from the one before, in the cheapest way that is exact to a fraction of a tick.

use super::PULSE_LOW_TICKS;
use crate::{
    math,
    units::{FineSteps, Steps},
};

/// Binary places of a step's time at an even pace: 2 ms, the longest segment, fill the word, and a
/// thousand periods are off by a thirtieth of a tick at most.
pub(super) const EVEN_BITS: u32 = 14;
/// What the times of steps at an even pace may be off the true ones, ticks.
const EVEN_ERROR_TICKS: f32 = 0.25;
/// Relative change of speed from one step to the next above which a step time is computed by the
/// quadratic formula instead of from the step before.
const SLOW_CHANGE: f32 = 0.01;

/// The motion of one axis over a segment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AxisMotion {
    /// Exact position at the end.
    pub to: FineSteps,
    /// Acceleration, steps per tick².
    pub acceleration: f32,
}

/// The steps of one axis that are still to come in the segment.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct AxisSteps {
    /// Steps left.
    pub(super) left: u32,
    /// Time of the next step, ticks from the segment's start; `u32::MAX` when none is left.
    pub(super) next: u32,
    /// Speed at the segment's start, steps per tick.
    speed: f32,
    /// Half the acceleration, steps per tick².
    half_acceleration: f32,
    /// Distance of the next step from the segment's start, steps.
    distance: f32,
    /// Exact time of the next step, ticks.
    time: f32,
    /// Inverse of the speed at that time, ticks per step.
    period: f32,
    /// The same two in [`Pace::Even`], with [`EVEN_BITS`] binary places.
    pub(super) even_time: u32,
    pub(super) even_period: u32,
    pace: Pace,
}

/// How the time of a step follows from the one before.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Pace {
    /// By the same period: the speed does not change.
    #[default]
    Even,
    /// By extrapolation: the speed changes little from step to step.
    Smooth,
    /// By the quadratic formula.
    Steep,
}

/// An axis without steps.
pub(super) const NO_STEPS: AxisSteps = AxisSteps {
    left: 0,
    next: u32::MAX,
    speed: 0.0,
    half_acceleration: 0.0,
    distance: 0.0,
    time: 0.0,
    period: 0.0,
    even_time: 0,
    even_period: 0,
    pace: Pace::Even,
};

impl AxisSteps {
    /// The crossing at `distance` by the quadratic formula, in the form that never cancels.
    fn solve(&self) -> f32 {
        let square = self.speed * self.speed + 4.0 * self.half_acceleration * self.distance;
        2.0 * self.distance / math::max(self.speed + math::sqrt(square), 1.0e-12)
    }

    /// How many steps can follow alike, if any: at an even pace, slow enough for the pulses, the
    /// last one of the segment apart. The pulse before ends at `ended`.
    pub(super) fn evenly(&self, ended: u32, pulse_ticks: u32) -> Option<u32> {
        let is_on_time = self.next == self.even_time >> EVEN_BITS
            && self.next.wrapping_sub(ended) < 1 << 30
            && self.next.wrapping_sub(ended) >= PULSE_LOW_TICKS;
        let is_slow = self.even_period >> EVEN_BITS >= pulse_ticks + PULSE_LOW_TICKS;
        let is_even = self.pace == Pace::Even && self.left > 1;
        (is_even && is_on_time && is_slow).then(|| self.left - 1)
    }

    /// Moves on to the next step.
    #[inline]
    pub(super) fn advance(&mut self, end: u32) {
        self.left -= 1;
        if self.left == 0 {
            self.next = u32::MAX;
            return;
        }
        if self.pace == Pace::Even {
            self.even_time = self.even_time.wrapping_add(self.even_period);
            self.next = (self.even_time >> EVEN_BITS).min(end);
            return;
        }
        self.distance += 1.0;
        if self.pace == Pace::Steep {
            self.time = self.solve();
        } else {
            // One Newton step for the inverse of the speed, one for the time.
            let speed = self.speed + 2.0 * self.half_acceleration * self.time;
            self.period *= 2.0 - speed * self.period;
            let guess = self.time + self.period;
            let reached = (self.speed + self.half_acceleration * guess) * guess;
            self.time = guess - (reached - self.distance) * self.period;
        }
        self.next = (self.time as u32).min(end);
    }
}

/// The steps of an axis that goes from one position to another, and whether backwards.
pub(super) fn plan_axis(
    from: FineSteps,
    motion: AxisMotion,
    duration: f32,
    rate: f32,
    end: u32,
) -> (AxisSteps, bool) {
    let Steps(begin) = from.nearest();
    let steps = motion.to.nearest().0.wrapping_sub(begin);
    if steps == 0 {
        return (NO_STEPS, false);
    }
    let sign = if steps < 0 { -1.0 } else { 1.0 };
    let way = to_f32(motion.to.0.wrapping_sub(from.0)) * sign;
    let offset = to_f32(from.0.wrapping_sub(i64::from(begin) << 32)) * sign;
    let mut acceleration = motion.acceleration * sign;
    let mut speed = way * rate - 0.5 * acceleration * duration;
    if speed < 0.0 {
        speed = 0.0;
        acceleration = 2.0 * way * rate * rate;
    } else if speed + acceleration * duration < 0.0 {
        speed = 2.0 * way * rate;
        acceleration = -speed * rate;
    }
    // A parabola is off its chord by at most a·T²/8.
    let mean_period = 1.0 / math::max(way * rate, 1.0e-12);
    if acceleration.abs() * duration * duration * mean_period < 8.0 * EVEN_ERROR_TICKS {
        let scale = mean_period * (1 << EVEN_BITS) as f32;
        let even_time = ((0.5 - offset) * scale) as u32;
        let axis = AxisSteps {
            left: steps.unsigned_abs(),
            next: (even_time >> EVEN_BITS).min(end),
            even_time,
            even_period: scale as u32,
            ..NO_STEPS
        };
        return (axis, steps < 0);
    }
    let slowest = math::min(speed, speed + acceleration * duration);
    let mut axis = AxisSteps {
        left: steps.unsigned_abs(),
        speed,
        half_acceleration: 0.5 * acceleration,
        distance: 0.5 - offset,
        pace: if acceleration.abs() > SLOW_CHANGE * slowest * slowest {
            Pace::Steep
        } else {
            Pace::Smooth
        },
        ..NO_STEPS
    };
    axis.time = axis.solve();
    axis.period = 1.0 / math::max(speed + acceleration * axis.time, 1.0e-12);
    axis.next = (axis.time as u32).min(end);
    (axis, steps < 0)
}

/// A fixed-point distance of at most 2048 steps in floating point, to 24 bits where it is small.
fn to_f32(fine: i64) -> f32 {
    if fine >> 31 == fine >> 63 {
        fine as i32 as f32 * (1.0 / 4_294_967_296.0)
    } else {
        (fine >> 12) as i32 as f32 * (1.0 / 1_048_576.0)
    }
}
