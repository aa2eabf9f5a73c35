//! The steps of one axis within a segment: how many, and when.
//!
//! q(τ) = vτ + aτ²/2 in steps, and step k falls where q crosses half-way to it. At an even pace each
//! time follows from the one before; otherwise it is solved for, so that every step costs the same.

use crate::{
    math,
    model::timing::PULSE_LOW_TICKS,
    units::{FineSteps, Steps},
};

/// Binary places of a step's time at an even pace: 1.5 ms, the longest segment, and a period more fit
/// the word, and a thousand periods are off by a thirtieth of a tick at most.
pub(super) const TIME_FRACTION_BITS: u32 = 14;
/// What the times of steps at an even pace may be off the true ones, ticks.
const PERIODIC_ERROR_TICKS: f32 = 0.25;
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
    pub(super) remaining: u32,
    /// Time of the next step, ticks from the segment's start, while steps are left.
    pub(super) next_ticks: u32,
    /// The latest that it can be.
    latest_ticks: u32,
    /// Half of the speed at the segment's start, steps per tick, and half of the speed's square.
    half_speed: f32,
    half_speed_sqr: f32,
    /// Steps per tick².
    acceleration: f32,
    /// The way of the next step from the segment's start, steps.
    distance_steps: f32,
    /// Time of the next step and the time between two, ticks at an even pace, with [`EVEN_BITS`] binary places.
    pub(super) time_fixed: u32,
    pub(super) period_fixed: u32,
    is_periodic: bool,
}

/// An axis without steps.
pub(super) const NO_STEPS: AxisSteps = AxisSteps {
    remaining: 0,
    next_ticks: 0,
    latest_ticks: 0,
    half_speed: 0.0,
    half_speed_sqr: 0.0,
    acceleration: 0.0,
    distance_steps: 0.0,
    time_fixed: 0,
    period_fixed: 0,
    is_periodic: true,
};

impl AxisSteps {
    /// Whether it goes at an even pace, slow enough for such pulses.
    pub(super) fn is_slow(&self, pulse_ticks: u32) -> bool {
        self.is_periodic && self.period_fixed >> TIME_FRACTION_BITS >= pulse_ticks + PULSE_LOW_TICKS
    }

    /// Whether it goes at an even pace, with so many ticks or more from step to step, and no step
    /// comes too late.
    pub(super) fn is_apart(&self, ticks: u32) -> bool {
        let before_last = self
            .period_fixed
            .wrapping_mul(self.remaining.wrapping_sub(1));
        let last = self.time_fixed.wrapping_add(before_last) >> TIME_FRACTION_BITS;
        self.is_periodic
            && self.period_fixed >> TIME_FRACTION_BITS >= ticks
            && last <= self.latest_ticks
    }

    /// When the axis has come to the next step: 2q/(v + √(v² + 2aq)), the form that never cancels.
    /// Nothing to divide by is a time without end.
    #[inline]
    fn solve(&self) -> u32 {
        let half_reached =
            math::half_root_of_twice(self.half_speed_sqr + self.acceleration * self.distance_steps);
        (self.distance_steps / (self.half_speed + half_reached)) as u32
    }

    /// Lets the steps come as late as that.
    pub(super) fn set_latest(&mut self, latest: u32) {
        if self.remaining != 0 {
            self.latest_ticks = latest;
            let next = if self.is_periodic {
                self.time_fixed >> TIME_FRACTION_BITS
            } else {
                self.solve()
            };
            self.next_ticks = next.min(latest);
        }
    }

    /// Moves on to the next step, at an even pace.
    #[inline]
    pub(super) fn advance_periodic(&mut self) {
        self.remaining -= 1;
        self.time_fixed = self.time_fixed.wrapping_add(self.period_fixed);
        self.next_ticks = (self.time_fixed >> TIME_FRACTION_BITS).min(self.latest_ticks);
    }

    /// The same at another pace.
    #[inline]
    pub(super) fn advance_solved(&mut self) {
        self.remaining -= 1;
        self.distance_steps += 1.0;
        self.next_ticks = self.solve().min(self.latest_ticks);
    }

    /// Whether all steps come at an even pace.
    pub(super) const fn is_periodic(&self) -> bool {
        self.is_periodic
    }
}

/// The steps of an axis that goes from one position to another, and whether backwards.
pub(super) fn plan_axis(
    from: FineSteps,
    motion: AxisMotion,
    duration: f32,
    rate: f32,
    latest: u32,
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
    if acceleration.abs() * duration * duration * mean_period < 8.0 * PERIODIC_ERROR_TICKS {
        let scale = mean_period * (1 << TIME_FRACTION_BITS) as f32;
        let even_time = ((0.5 - offset) * scale) as u32;
        let axis = AxisSteps {
            remaining: steps.unsigned_abs(),
            next_ticks: (even_time >> TIME_FRACTION_BITS).min(latest),
            latest_ticks: latest,
            time_fixed: even_time,
            period_fixed: scale as u32,
            ..NO_STEPS
        };
        return (axis, steps < 0);
    }
    let mut axis = AxisSteps {
        remaining: steps.unsigned_abs(),
        latest_ticks: latest,
        half_speed: 0.5 * speed,
        half_speed_sqr: 0.5 * speed * speed,
        acceleration,
        distance_steps: 0.5 - offset,
        is_periodic: false,
        ..NO_STEPS
    };
    axis.next_ticks = axis.solve().min(latest);
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

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;
    use crate::units::TICKS_PER_SECOND;

    /// What the roundings of single precision may take a step off its place, of its way.
    const SINGLE_PRECISION: f64 = 2.0e-6;

    /// A step of an axis that speeds up or slows down evenly.
    struct Step {
        time: u32,
        /// The exact time, ticks.
        exact: f64,
        /// How far the axis has come at `time` by the exact parabola, and how far it should, steps.
        reached: f64,
        way: f64,
    }

    /// Times of the steps of such an axis, beside the exact ones.
    fn times(begin_hz: f64, end_hz: f64, milliseconds: f64, offset: f64) -> Vec<Step> {
        let per_s = f64::from(TICKS_PER_SECOND);
        let ticks = (milliseconds * per_s / 1000.0).round();
        let (begin, end) = (begin_hz / per_s, end_hz / per_s);
        let acceleration = (end - begin) / ticks;
        let fine = |steps: f64| FineSteps((steps * 4_294_967_296.0).round() as i64);
        let from = fine(offset);
        let to = fine(offset + 0.5 * (begin + end) * ticks);
        let motion = AxisMotion {
            to,
            acceleration: acceleration as f32,
        };
        let (mut steps, _) =
            plan_axis(from, motion, ticks as f32, 1.0 / ticks as f32, ticks as u32);
        let mut all = Vec::new();
        while steps.remaining != 0 {
            let way = all.len() as f64 + 0.5 - offset;
            let root = (begin * begin + 2.0 * acceleration * way).max(0.0).sqrt();
            let time = f64::from(steps.next_ticks);
            all.push(Step {
                time: steps.next_ticks,
                exact: (2.0 * way / (begin + root)).min(ticks),
                reached: begin * time + 0.5 * acceleration * time * time,
                way,
            });
            if steps.is_periodic() {
                steps.advance_periodic();
            } else {
                steps.advance_solved();
            }
        }
        all
    }

    proptest! {
        #[test]
        fn steps_come_within_two_ticks_or_two_millionths_of_their_way(
            begin_hz in prop_oneof![Just(0.0), 10.0..3000.0_f64, 3000.0..150_000.0],
            ratio in prop_oneof![Just(0.0), 0.01..0.9_f64, 0.9..1.1, 1.1..20.0],
            milliseconds in 0.05..1.5_f64,
            offset in -0.499..0.499_f64,
        ) {
            let end_hz = if begin_hz == 0.0 { ratio * 7000.0 } else { begin_hz * ratio };
            for step in times(begin_hz, end_hz.min(150_000.0), milliseconds, offset) {
                // Where the axis nearly stands, no arithmetic can tell the time of a place to a tick.
                let late = (f64::from(step.time) - step.exact).abs();
                let far = (step.reached - step.way).abs();
                prop_assert!(
                    late < 2.0 || far < step.way * SINGLE_PRECISION,
                    "{late} ticks at {}, {far} of {} steps", step.exact, step.way,
                );
            }
        }
    }
}
