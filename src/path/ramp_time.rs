//! The ramp time: how long an acceleration takes to be there, with limits of jerk.
//!
//! It is the same for all axes and directions: a jerk is an acceleration divided by it.

use crate::{axis::AXES, math, model::timing::SAMPLE_S, settings::Settings};

/// Shortest ramp time, samples: an acceleration that rises in fewer of them would be none of even jerk.
const MIN_SAMPLES: usize = 5;

/// Longest ramp time, samples. A jerk limit that asks for a longer one lowers the acceleration instead.
const MAX_SAMPLES: usize = 120;

/// The time in which accelerations rise to their limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RampTime {
    /// Length, samples; 0 without a jerk limit.
    pub(crate) samples: usize,
}

impl RampTime {
    /// The shortest one that keeps the jerk limit of every axis at its full acceleration.
    pub(crate) fn new(settings: &Settings) -> Self {
        let mut longest_s = 0.0;
        for axis in 0..AXES {
            let jerk = settings.jerk_mm_s3[axis];
            if jerk > 0.0 {
                longest_s = math::max(longest_s, settings.acceleration_mm_s2[axis] / jerk);
            }
        }
        if longest_s <= 0.0 {
            return Self { samples: 0 };
        }
        let samples = math::min(longest_s * (1.0 / SAMPLE_S) + 0.999, MAX_SAMPLES as f32);
        Self {
            samples: (samples as usize).max(MIN_SAMPLES),
        }
    }

    /// Returns true if an axis has a jerk limit.
    pub(crate) fn is_jerk_limited(self) -> bool {
        self.samples != 0
    }

    /// Returns the ramp time, s; 0 without a jerk limit.
    pub(crate) fn seconds(self) -> f32 {
        self.samples as f32 * SAMPLE_S
    }

    /// Returns the acceleration of an axis within its jerk limit, mm/s².
    pub(crate) fn acceleration(self, acceleration_mm_s2: f32, jerk_mm_s3: f32) -> f32 {
        if jerk_mm_s3 > 0.0 {
            math::min(acceleration_mm_s2, jerk_mm_s3 * self.seconds())
        } else {
            acceleration_mm_s2
        }
    }
}
