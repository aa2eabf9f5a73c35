//! The motion of one axis, independent of the others: a trapezoid, a segment at a time.
//!
//! Not the profile of blocks, which has one speed along the path: here an axis brakes while the
//! others search on.

use crate::{
    math,
    motion::limits::{NOMINAL_SEGMENT_S, TICKS_PER_S},
    stepper::AxisMotion,
    units::FineSteps,
};

/// Per s² to per tick².
const PER_TICK_SQR: f32 = 1.0 / (TICKS_PER_S * TICKS_PER_S);

/// The motion of one axis: to a target, at most at a speed.
#[derive(Debug, Clone, Copy)]
pub(super) struct AxisProfile {
    pub(super) target: FineSteps,
    /// steps/s, now and at most.
    pub(super) speed: f32,
    pub(super) limit: f32,
    /// The switch has been found, and its position.
    pub(super) is_found: bool,
    pub(super) switch: i32,
}

impl AxisProfile {
    pub(super) const NONE: Self = Self {
        target: FineSteps(0),
        speed: 0.0,
        limit: 0.0,
        is_found: false,
        switch: 0,
    };

    /// Ends the motion as soon as the acceleration (steps/s²) allows.
    pub(super) fn brake(&mut self, from: FineSteps, acceleration: f32) {
        let distance = self.speed * self.speed / (2.0 * acceleration);
        let distance = to_fine(distance);
        let is_negative = self.target.0 < from.0;
        self.target =
            FineSteps(
                from.0
                    .wrapping_add(if is_negative { -distance } else { distance }),
            );
    }

    /// Returns the motion in the next segment.
    pub(super) fn advance(&mut self, from: FineSteps, acceleration: f32) -> AxisMotion {
        let distance = self.target.0.wrapping_sub(from.0);
        let sign = if distance < 0 { -1.0 } else { 1.0 };
        let left = steps(distance.wrapping_abs());
        // The speed from which the remainder after the segment is just enough to brake:
        // v²/2a = left - (speed + v)·T/2.
        let half = 0.5 * acceleration * NOMINAL_SEGMENT_S;
        let room = acceleration * (2.0 * left - self.speed * NOMINAL_SEGMENT_S);
        let brake = math::sqrt(half * half + room) - half;
        let end = math::min(self.speed + 2.0 * half, math::min(self.limit, brake));
        let mean = 0.5 * (self.speed + end);
        if end <= 0.0 || mean * NOMINAL_SEGMENT_S >= left {
            self.speed = 0.0;
            return AxisMotion {
                to: self.target,
                acceleration: -2.0 * sign * left / (NOMINAL_SEGMENT_S * NOMINAL_SEGMENT_S)
                    * PER_TICK_SQR,
            };
        }
        let acceleration = (end - self.speed) / NOMINAL_SEGMENT_S;
        self.speed = end;
        let distance = to_fine(mean * NOMINAL_SEGMENT_S);
        AxisMotion {
            to: FineSteps(
                from.0
                    .wrapping_add(if sign < 0.0 { -distance } else { distance }),
            ),
            acceleration: sign * acceleration * PER_TICK_SQR,
        }
    }
}

/// Returns a positive number of steps with 32 binary places.
fn to_fine(steps: f32) -> i64 {
    let whole = steps as i32;
    let part = steps - whole as f32;
    (i64::from(whole) << 32) + (i64::from((part * 1_073_741_824.0) as i32) << 2)
}

/// Returns a positive number of steps with 32 binary places in floating point.
fn steps(fine: i64) -> f32 {
    if fine >> 43 == 0 {
        (fine >> 12) as i32 as f32 * (1.0 / 1_048_576.0)
    } else {
        (fine >> 32) as i32 as f32
    }
}
