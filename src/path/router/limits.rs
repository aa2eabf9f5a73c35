//! Limits along a direction and at a junction, from the limits of the axes.
//!
//! Junction speed: S. Jeon, "Improving Grbl's cornering algorithm" (2011). With the junction deviation δ
//! and the angle θ between the directions, v² = a·δ·cos(θ/2) / (1 - cos(θ/2)): the speed on a circle
//! that touches both lines and leaves the corner by δ.

use core::f32::consts::SQRT_2;

use crate::{
    axis::{AXES, Axes, LINEAR},
    math,
    model::{FeedRate, Plane, core_xy},
    path::{RampTime, programmed_speed::programmed_mm_s},
    settings::Settings,
    units::StepsPerMm,
};

/// Square of the change of direction below which two blocks are one line: 1.4 mrad, as in Grbl.
const COLLINEAR_SQR: f32 = 2.0e-6;

/// The limits of the axes that those of a move are computed from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub(super) steps_per_mm: Axes<f32>,
    pub(super) speed_mm_s: Axes<f32>,
    pub(super) acceleration_mm_s2: Axes<f32>,
    /// [`f32::MAX`] without a limit.
    pub(super) jerk_mm_s3: Axes<f32>,
    pub(super) ramp_time: RampTime,
    pub(super) junction_deviation_mm: f32,
    /// Greatest step rate of all axes together.
    pub(super) steps_per_s: f32,
    /// The limits in the places of X and Y are those of the motors of `CoreXY`.
    pub(super) is_core_xy: bool,
    /// Linear axes that have backlash, bit 0 = X.
    backlash_axes: u8,
    /// Arcs are in whole steps: `$790`.
    #[cfg(arc_machine)]
    has_step_arcs: bool,
}

impl Limits {
    /// Shortest time for a corner arc, s.
    pub(super) const MIN_CORNER_ARC_S: f32 = super::arc::MIN_ARC_S;
    /// Duration of a line that leaves the greatest slack for an arc after it, s: `motion/segment_rate.rs`.
    pub(crate) const FULL_SLACK_LINE_S: f32 = 3.5e-3;
    /// Shortest time for a corner arc without slack, s, and what each section after the first adds.
    const MIN_ARC_WITHOUT_SLACK_S: f32 = 4.0e-3;
    const ADDED_PER_SECTION_S: f32 = 1.2e-3;

    pub(super) fn new(settings: &Settings) -> Self {
        let step_rate = settings.greatest_step_rate_hz();
        let steps_per_mm = settings.steps_per_mm.map(StepsPerMm::to_f32);
        let ramp_time = RampTime::new(settings);
        Self {
            steps_per_mm,
            speed_mm_s: settings.max_rate_mm_min.zip(steps_per_mm, |rate, steps| {
                (rate / 60.0).min(step_rate / steps)
            }),
            acceleration_mm_s2: settings
                .acceleration_mm_s2
                .zip(settings.jerk_mm_s3, |a, jerk| {
                    ramp_time.acceleration(a, jerk)
                }),
            jerk_mm_s3: (settings.jerk_mm_s3).map(|jerk| if jerk > 0.0 { jerk } else { f32::MAX }),
            ramp_time,
            junction_deviation_mm: settings.junction_deviation_mm,
            steps_per_s: settings.step_rate.hz() as f32,
            is_core_xy: settings.core_xy,
            backlash_axes: settings.backlash_axes(),
            #[cfg(arc_machine)]
            has_step_arcs: settings.arc_rule != 0,
        }
    }

    /// Returns the movement of the motors for one of the axes.
    #[inline]
    pub(super) fn motors_of(&self, movement: Axes<f32>) -> Axes<f32> {
        if self.is_core_xy {
            core_xy::motors_of(movement)
        } else {
            movement
        }
    }

    /// Returns how much more the fastest motor moves than the fastest axis, at most.
    pub(super) fn motors_per_axis(&self) -> f32 {
        if self.is_core_xy { SQRT_2 } else { 1.0 }
    }

    /// Returns the greatest parts of a movement along a circle that each motor makes, from two directions of its
    /// plane at a right angle.
    pub(crate) fn arc_shares(&self, radial: Axes<f32>, tangent: Axes<f32>) -> Axes<f32> {
        let (radial, tangent) = (self.motors_of(radial), self.motors_of(tangent));
        radial.zip(tangent, |a, b| math::sqrt(a * a + b * b))
    }

    /// Returns the same for the plane of two axes.
    pub(crate) fn plane_shares(&self, axes: [usize; 2]) -> Axes<f32> {
        let [first, second] =
            axes.map(|axis| Axes::from_fn(|other| if other == axis { 1.0 } else { 0.0 }));
        self.arc_shares(first, second)
    }

    /// Returns whether corners at the arcs of a plane may be rounded: not where arcs are chords or in whole steps, nor
    /// within limits of jerk.
    pub(crate) fn rounds_arcs(&self, plane: Plane) -> bool {
        #[cfg(arc_machine)]
        if self.has_step_arcs {
            return false;
        }
        let is_chords = self.is_core_xy && plane != Plane::Xy;
        !is_chords && !self.is_jerk_limited()
    }

    /// Returns the smallest of the limits, each divided by the axis's share of the direction.
    pub(crate) fn along(limits: &Axes<f32>, direction: &Axes<f32>) -> f32 {
        let mut smallest = f32::MAX;
        for (limit, share) in limits.iter().zip(direction) {
            if *share != 0.0 {
                smallest = math::min(smallest, limit / share.abs());
            }
        }
        smallest
    }

    /// Returns the acceleration along a movement of the motors, or along an arc with their greatest shares, mm/s².
    pub(crate) fn acceleration_along(&self, shares: &Axes<f32>) -> f32 {
        Self::along(&self.acceleration_mm_s2, shares)
    }

    /// Returns the greatest speed for the step rate of all axes together, mm/s.
    pub(super) fn step_rate_mm_s(&self, steps_per_mm: &Axes<f32>) -> f32 {
        let steps_per_mm: f32 = steps_per_mm.iter().map(|steps| steps.abs()).sum();
        self.steps_per_s / steps_per_mm
    }

    /// Returns the speed at which a line makes its whole steps within the step rate, mm/s: an axis that
    /// reverses at each line may make a step in each of them, however short they are.
    pub(super) fn whole_steps_mm_s(&self, steps: f32, length_mm: f32, speed_mm_s: f32) -> f32 {
        let available = self.steps_per_s * length_mm;
        if steps * speed_mm_s > available {
            available / steps
        } else {
            speed_mm_s
        }
    }

    /// Returns the greatest speed along an arc for the axes with their greatest shares, mm/s.
    pub(crate) fn arc_mm_s(&self, shares: &Axes<f32>) -> f32 {
        let steps_per_mm = shares.zip(self.steps_per_mm, |share, steps| share * steps);
        Self::along(&self.speed_mm_s, shares).min(self.step_rate_mm_s(&steps_per_mm))
    }

    /// Returns the greatest speed on a curve, mm/s: `speed_mm_s`, the step rate of all axes together, the
    /// centripetal limit and the shortest time for the curve.
    pub(super) fn curve_mm_s(
        &self,
        speed_mm_s: f32,
        steps_per_mm: &Axes<f32>,
        limit_sqr: f32,
        shortest_time_mm_s: f32,
    ) -> f32 {
        speed_mm_s
            .min(self.step_rate_mm_s(steps_per_mm))
            .min(math::sqrt(limit_sqr))
            .min(shortest_time_mm_s)
    }

    /// Returns the speed of a line at a feed rate that does not depend on its length, mm/s.
    pub(crate) fn line_mm_s(&self, feed_rate: FeedRate, direction: &Axes<f32>) -> f32 {
        let limit_mm_s = Self::along(&self.speed_mm_s, &self.motors_of(*direction));
        math::min(programmed_mm_s(feed_rate, 0.0, limit_mm_s), limit_mm_s)
    }

    /// Returns the shortest time for a corner arc on which so many axes reverse, s; `has_slack` after a line that lasts
    /// [`Self::FULL_SLACK_LINE_S`] at least.
    pub(crate) fn shortest_corner_arc_s(reversals: usize, has_slack: bool) -> f32 {
        if has_slack {
            let sections = (1 + reversals) as f32;
            Self::MIN_CORNER_ARC_S.max(0.5 * Self::MIN_CORNER_ARC_S * sections)
        } else {
            Self::MIN_ARC_WITHOUT_SLACK_S
                + Self::ADDED_PER_SECTION_S * reversals.saturating_sub(1) as f32
        }
    }

    /// Returns true if an axis has a jerk limit.
    pub(crate) fn is_jerk_limited(&self) -> bool {
        self.ramp_time.is_jerk_limited()
    }

    /// Returns the time in which an acceleration rises to its limit, s: 0 without limits of jerk.
    pub(crate) fn ramp_s(&self) -> f32 {
        self.ramp_time.seconds()
    }

    /// Returns the acceleration along a line, mm/s².
    pub(crate) fn line_acceleration_mm_s2(&self, direction: &Axes<f32>) -> f32 {
        self.acceleration_along(&self.motors_of(*direction))
    }

    /// Returns whether an axis with backlash reverses between two directions: the machine stops there.
    pub(crate) fn reverses_backlash(&self, before: &Axes<f32>, after: &Axes<f32>) -> bool {
        let reverses = |axis: usize| before[axis] * after[axis] < 0.0;
        (0..LINEAR).any(|axis| self.backlash_axes >> axis & 1 != 0 && reverses(axis))
    }

    /// Returns the radius that is `steps` of the finest linear axis, mm.
    pub(crate) fn radius_mm(&self, steps: f32) -> f32 {
        let finest = self.steps_per_mm.iter().take(LINEAR);
        let finest = finest.fold(f32::MIN_POSITIVE, |a, b| math::max(a, *b));
        steps / (finest * self.motors_per_axis())
    }

    /// Returns the limit of the squared speed at the junction of two directions, (mm/s)². A direction is
    /// the movement of the axes per mm of path.
    ///
    /// Where rotary axes move farther per mm after the junction than before it, their speed jumps as that
    /// of other axes does at a corner: every change counts, whatever its cause.
    pub(crate) fn junction_sqr(&self, before: &Axes<f32>, after: &Axes<f32>) -> f32 {
        // Sine and cosine of half the angle: half the difference and half the sum of the directions.
        let change = after.zip(*before, |after, before| after - before);
        let change_sqr = math::dot(&change.0, &change.0);
        let sum = unit(*after).zip(unit(*before), |after, before| after + before);
        let cosine_sqr = 0.25 * math::dot(&sum.0, &sum.0);
        if change_sqr <= COLLINEAR_SQR * greatest_sqr(before, after) {
            return f32::MAX;
        }
        if cosine_sqr <= 0.25 * COLLINEAR_SQR {
            return 0.0;
        }
        // The acceleration points along the change of direction: along its unit vector, where `along`
        // divides by the change itself.
        let acceleration =
            self.acceleration_along(&self.motors_of(change)) * math::sqrt(change_sqr);
        let cosine = math::sqrt(cosine_sqr);
        // cos / (1 - cos), without the difference that cancels.
        let ratio = cosine * (1.0 + cosine) / (0.25 * change_sqr);
        acceleration * self.junction_deviation_mm * ratio
    }
}

/// Returns the unit vector of a direction, or zero. Without rotary axes, directions are unit vectors.
fn unit(direction: Axes<f32>) -> Axes<f32> {
    let length_sqr = math::dot(&direction.0, &direction.0);
    if AXES == LINEAR || length_sqr <= 0.0 {
        return direction;
    }
    let length = math::sqrt(length_sqr);
    direction.map(|share| share / length)
}

/// Returns the greater square of two directions: 1 without rotary axes.
fn greatest_sqr(one: &Axes<f32>, other: &Axes<f32>) -> f32 {
    if AXES == LINEAR {
        return 1.0;
    }
    math::max(math::dot(&one.0, &one.0), math::dot(&other.0, &other.0))
}
