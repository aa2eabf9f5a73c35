//! What the settings allow along a direction and in a corner.

use super::{LINEAR, dot};
use crate::{
    axis::{AXES, Axes},
    math,
    path::AveragingWindow,
    settings::Settings,
    units::StepsPerMm,
};

/// Square of the change of direction below which two blocks are one line: 1.4 mrad, as in Grbl.
const STRAIGHT: f32 = 2.0e-6;

/// What the limits of a move are computed from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub(super) steps_per_mm: Axes<f32>,
    pub(super) speed_mm_s: Axes<f32>,
    pub(super) acceleration_mm_s2: Axes<f32>,
    /// [`f32::MAX`] without a limit.
    pub(super) jerk_mm_s3: Axes<f32>,
    pub(super) window: AveragingWindow,
    pub(super) junction_deviation_mm: f32,
    /// Of all axes together.
    pub(super) steps_per_s: f32,
}

impl Limits {
    pub(super) fn new(settings: &Settings) -> Self {
        let step_rate = settings.greatest_step_rate_hz();
        let steps_per_mm = settings.steps_per_mm.map(StepsPerMm::to_f32);
        let window = AveragingWindow::new(settings);
        Self {
            steps_per_mm,
            speed_mm_s: settings.max_rate_mm_min.zip(steps_per_mm, |rate, steps| {
                (rate / 60.0).min(step_rate / steps)
            }),
            acceleration_mm_s2: settings
                .acceleration_mm_s2
                .zip(settings.jerk_mm_s3, |a, jerk| window.acceleration(a, jerk)),
            jerk_mm_s3: (settings.jerk_mm_s3).map(|jerk| if jerk > 0.0 { jerk } else { f32::MAX }),
            window,
            junction_deviation_mm: settings.junction_deviation_mm,
            steps_per_s: settings.step_rate.hz() as f32,
        }
    }

    /// The smallest of the limits, each divided by the axis's share of the direction.
    pub(super) fn along(limits: &Axes<f32>, direction: &Axes<f32>) -> f32 {
        let mut smallest = f32::MAX;
        for (limit, share) in limits.iter().zip(direction) {
            if *share != 0.0 {
                smallest = math::min(smallest, limit / share.abs());
            }
        }
        smallest
    }

    /// The greatest speed along a direction for the steps of all axes together.
    pub(super) fn together(&self, steps_per_mm: &Axes<f32>) -> f32 {
        let steps_per_mm: f32 = steps_per_mm.iter().map(|steps| steps.abs()).sum();
        self.steps_per_s / steps_per_mm
    }

    /// The greatest speed of a line for all the steps that it makes: an axis that turns at each line may
    /// make one in each of them, however short its ways are.
    pub(super) fn for_steps(&self, steps: f32, length_mm: f32, speed_mm_s: f32) -> f32 {
        let room = self.steps_per_s * length_mm;
        if steps * speed_mm_s > room {
            room / steps
        } else {
            speed_mm_s
        }
    }

    /// Limit of the squared speed in the corner between two directions, each as what the axes move for
    /// one mm of the path.
    ///
    /// Where rotary axes turn farther for that behind the corner than before it, their speed jumps as
    /// that of others in a turn does: the change counts, whatever it is due to.
    pub(crate) fn junction_sqr(&self, before: &Axes<f32>, after: &Axes<f32>) -> f32 {
        // Sine and cosine of half the turn: half the difference and half the sum of the directions.
        let change = after.zip(*before, |after, before| after - before);
        let change_sqr = dot(&change, &change);
        let sum = unit(*after).zip(unit(*before), |after, before| after + before);
        let cosine_sqr = 0.25 * dot(&sum, &sum);
        if change_sqr <= STRAIGHT * greatest_sqr(before, after) {
            return f32::MAX;
        }
        if cosine_sqr <= 0.25 * STRAIGHT {
            return 0.0;
        }
        // The acceleration in the corner points along the change of direction: a unit vector, where
        // `along` takes the change itself.
        let acceleration = Self::along(&self.acceleration_mm_s2, &change) * math::sqrt(change_sqr);
        let cosine = math::sqrt(cosine_sqr);
        // cos / (1 - cos), without the difference that cancels.
        let ratio = cosine * (1.0 + cosine) / (0.25 * change_sqr);
        acceleration * self.junction_deviation_mm * ratio
    }
}

/// The unit vector of a direction, or none. With linear axes alone, directions are unit vectors already.
fn unit(direction: Axes<f32>) -> Axes<f32> {
    let length_sqr = dot(&direction, &direction);
    if AXES == LINEAR || length_sqr <= 0.0 {
        return direction;
    }
    let length = math::sqrt(length_sqr);
    direction.map(|share| share / length)
}

/// The greater square of two directions: 1 with linear axes alone.
fn greatest_sqr(one: &Axes<f32>, other: &Axes<f32>) -> f32 {
    if AXES == LINEAR {
        return 1.0;
    }
    math::max(dot(one, one), dot(other, other))
}
