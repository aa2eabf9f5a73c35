//! The averaging window that turns acceleration limits into jerk limits.
//!
//! The speed of a reference of constant acceleration a, averaged over a time T, has a jerk of a/T.

use crate::{axis::AXES, math, model::timing::SAMPLE_S, settings::Settings};

/// Shortest window, samples. The mean of a single one exceeds accelerations by 2 % where blocks come late
/// (`so_do_blocks_that_come_late` in `motion/jerk_limited/profile/tests.rs`), that of two does not; the
/// remainder is reserve.
const MIN_SAMPLES: usize = 5;

/// Longest window, samples: the reference keeps as many. A jerk limit that asks for a longer one
/// lowers the acceleration instead.
const MAX_SAMPLES: usize = 120;

/// The window over which speeds of the reference are averaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct AveragingWindow {
    /// Length, samples; 0 without a jerk limit.
    pub(crate) samples: usize,
}

impl AveragingWindow {
    /// The shortest window that keeps the jerk limit of every axis at its full acceleration.
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

    /// Returns the length, s; 0 without a jerk limit.
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
