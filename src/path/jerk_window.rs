//! What limits of jerk make of limits of acceleration.

use crate::{axis::AXES, math, model::timing::SAMPLE_S, settings::Settings};

/// Shortest window, cells: so that a limit of speed that is reached in the middle of a cell is kept by
/// the mean, and blocks take the time that they have to.
const SHORTEST_WINDOW: usize = 5;

/// Longest window, cells. Where the jerk is lower than that needs, so is the acceleration.
const LONGEST_WINDOW: usize = 120;

/// What the jerk limits make of the acceleration limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct AveragingWindow {
    /// Its length, cells; 0 without any limit of jerk.
    pub(crate) samples: usize,
}

impl AveragingWindow {
    /// Long enough for every axis.
    pub(crate) fn new(settings: &Settings) -> Self {
        let mut longest_s = 0.0;
        // wcet-bound: axes
        for axis in 0..AXES {
            let jerk = settings.jerk_mm_s3[axis];
            if jerk > 0.0 {
                longest_s = math::max(longest_s, settings.acceleration_mm_s2[axis] / jerk);
            }
        }
        if longest_s <= 0.0 {
            return Self { samples: 0 };
        }
        let cells = math::min(longest_s * (1.0 / SAMPLE_S) + 0.999, LONGEST_WINDOW as f32);
        Self {
            samples: (cells as usize).max(SHORTEST_WINDOW),
        }
    }

    /// Its length, s; 0 without any limit of jerk.
    pub(crate) fn seconds(self) -> f32 {
        self.samples as f32 * SAMPLE_S
    }

    /// The acceleration of an axis that keeps its jerk, mm/s².
    pub(crate) fn acceleration(self, acceleration_mm_s2: f32, jerk_mm_s3: f32) -> f32 {
        if jerk_mm_s3 > 0.0 {
            math::min(acceleration_mm_s2, jerk_mm_s3 * self.seconds())
        } else {
            acceleration_mm_s2
        }
    }
}
