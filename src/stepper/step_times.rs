//! The steps of one axis within a segment: how many, and when.
//!
//! q(τ) = vτ + aτ²/2 in steps, and step k falls where q crosses half-distance to it. At a constant rate each time is a
//! period after the previous time; otherwise it is solved for, so that every step costs the same.

use crate::{
    math,
    stepper::AxisMotion,
    units::{FineSteps, Steps},
};

/// Binary places of a step's time at a constant rate: 1.5 ms, the longest segment, and a period more
/// fit the word. A thousand periods, each rounded down, are off by a sixteenth of a tick at most.
pub(super) const TIME_FRACTION_BITS: u32 = 14;
/// Bounds the error of the times of steps that are taken to come at a constant rate, ticks: an eighth
/// of what `steps_come_within_two_ticks_or_two_millionths_of_their_distance` allows.
const PERIODIC_ERROR_TICKS: f32 = 0.25;
/// Bounds the mean period from above, steps per tick: far below one step in the longest segment.
const MIN_RATE: f32 = 1.0e-12;

/// The steps of one axis that are still to come in the segment.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct AxisSteps {
    /// Steps that remain.
    pub(super) remaining: u32,
    /// Time of the next step, ticks from the segment's start, while steps remain.
    pub(super) next_ticks: u32,
    /// The latest time of a step, ticks from the segment's start.
    latest_ticks: u32,
    /// Half of the speed at the segment's start, steps per tick.
    half_speed: f32,
    /// Half of the square of that speed, (steps per tick)².
    half_speed_sqr: f32,
    /// Acceleration, steps per tick².
    acceleration: f32,
    /// Distance of the next step from where the segment starts, steps.
    distance_steps: f32,
    /// Time of the next step at a constant rate, ticks from the segment's start with
    /// [`TIME_FRACTION_BITS`] binary places.
    pub(super) time_fixed: u32,
    /// Period of a constant rate, ticks with as many binary places.
    pub(super) period_fixed: u32,
    /// The steps are taken to come at a constant rate.
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
    /// Returns whether the rate is constant, with a period of `min_ticks` or more.
    pub(super) fn has_period(&self, min_ticks: u32) -> bool {
        self.is_periodic && self.period_fixed >> TIME_FRACTION_BITS >= min_ticks
    }

    /// Returns whether the last step comes in time, one period after the other.
    pub(super) fn is_in_time(&self) -> bool {
        let periods = self.remaining.wrapping_sub(1);
        let last = self.period_fixed.wrapping_mul(periods);
        self.time_fixed.wrapping_add(last) >> TIME_FRACTION_BITS <= self.latest_ticks
    }

    /// Returns the time of the next step: 2q/(v + √(v² + 2aq)), the form that never cancels.
    /// Without speed the time is the longest there is.
    fn solve(&self) -> u32 {
        let half_reached =
            math::half_root_of_twice(self.half_speed_sqr + self.acceleration * self.distance_steps);
        (self.distance_steps / (self.half_speed + half_reached)) as u32
    }

    /// Sets the latest time of a step.
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

    /// Moves on to the next step at a constant rate.
    pub(super) fn advance_periodic(&mut self) {
        self.remaining -= 1;
        self.time_fixed = self.time_fixed.wrapping_add(self.period_fixed);
        self.next_ticks = (self.time_fixed >> TIME_FRACTION_BITS).min(self.latest_ticks);
    }

    /// Moves on to the next step where the rate changes.
    pub(super) fn advance_solved(&mut self) {
        self.remaining -= 1;
        self.distance_steps += 1.0;
        self.next_ticks = self.solve().min(self.latest_ticks);
    }

    /// Returns whether all steps come at a constant rate.
    pub(super) const fn is_periodic(&self) -> bool {
        self.is_periodic
    }
}

/// Returns the steps of an axis from a position to that of `motion`, and whether they are negative.
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
    let distance = to_f32(motion.to.0.wrapping_sub(from.0)) * sign;
    let offset = to_f32(from.0.wrapping_sub(i64::from(begin) << 32)) * sign;
    let mut acceleration = motion.acceleration * sign;
    let mut speed = distance * rate - 0.5 * acceleration * duration;
    if speed < 0.0 {
        speed = 0.0;
        acceleration = 2.0 * distance * rate * rate;
    } else if speed + acceleration * duration < 0.0 {
        speed = 2.0 * distance * rate;
        acceleration = -speed * rate;
    }
    // A parabola is off its chord by at most a·T²/8.
    let mean_period = 1.0 / math::max(distance * rate, MIN_RATE);
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

/// Returns a fixed-point distance of at most 2048 steps in floating point, to 24 bits where it is
/// small.
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

    /// What the roundings of single precision may take a step off its place, of its distance.
    const SINGLE_PRECISION: f64 = 2.0e-6;

    /// A step of an axis that speeds up or slows down evenly.
    struct Step {
        time: u32,
        /// The exact time, ticks.
        exact: f64,
        /// How far the axis has come at `time` by the exact parabola, and how far it should, steps.
        reached: f64,
        distance: f64,
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
            let distance = all.len() as f64 + 0.5 - offset;
            let root = (begin * begin + 2.0 * acceleration * distance)
                .max(0.0)
                .sqrt();
            let time = f64::from(steps.next_ticks);
            all.push(Step {
                time: steps.next_ticks,
                exact: (2.0 * distance / (begin + root)).min(ticks),
                reached: begin * time + 0.5 * acceleration * time * time,
                distance,
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
        #![proptest_config(crate::cases(64))]

        #[test]
        fn steps_come_within_two_ticks_or_two_millionths_of_their_distance(
            begin_hz in prop_oneof![Just(0.0), 10.0..3000.0_f64, 3000.0..150_000.0],
            ratio in prop_oneof![Just(0.0), 0.01..0.9_f64, 0.9..1.1, 1.1..20.0],
            milliseconds in 0.05..1.5_f64,
            offset in -0.499..0.499_f64,
        ) {
            let end_hz = if begin_hz == 0.0 { ratio * 7000.0 } else { begin_hz * ratio };
            for step in times(begin_hz, end_hz.min(150_000.0), milliseconds, offset) {
                // Where the axis nearly stands, no arithmetic can tell the time of a place to a tick.
                let late = (f64::from(step.time) - step.exact).abs();
                let far = (step.reached - step.distance).abs();
                prop_assert!(
                    late < 2.0 || far < step.distance * SINGLE_PRECISION,
                    "{late} ticks at {}, {far} of {} steps", step.exact, step.distance,
                );
            }
        }
    }
}
