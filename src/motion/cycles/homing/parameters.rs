//! The parameters of the homing cycle, from the settings.

use crate::{
    axis::{AXES, Axes},
    math,
    path::{MIN_SPEED_MM_S, fastest_mm_s},
    settings::Settings,
    units::{StepsPerMm, TICKS_PER_MS},
};

/// Speeds, distances and times of the cycle.
#[derive(Debug, Clone, Copy)]
pub(super) struct HomingParameters {
    /// Axes whose switch is at their negative end, bit 0 = X.
    pub(super) negative: u8,
    /// Speeds, steps/s.
    pub(super) search: Axes<f32>,
    pub(super) locate: Axes<f32>,
    /// steps/s².
    pub(super) acceleration: Axes<f32>,
    pub(super) steps_per_mm: Axes<f32>,
    pub(super) travel_mm: Axes<f32>,
    pub(super) pull_off_mm: f32,
    pub(super) debounce_ticks: u64,
}

impl HomingParameters {
    pub(super) const NONE: Self = Self {
        negative: 0,
        search: Axes([0.0; AXES]),
        locate: Axes([0.0; AXES]),
        acceleration: Axes([0.0; AXES]),
        steps_per_mm: Axes([1.0; AXES]),
        travel_mm: Axes([0.0; AXES]),
        pull_off_mm: 0.0,
        debounce_ticks: 0,
    };

    pub(super) fn new(settings: &Settings) -> Self {
        let steps_per_mm = settings.steps_per_mm.map(StepsPerMm::to_f32);
        let at = |mm_min: f32| {
            let fastest = fastest_mm_s(settings);
            // `$24` and `$25` may be 0.
            let speed_mm_s = math::max(mm_min / 60.0, MIN_SPEED_MM_S);
            fastest.zip(steps_per_mm, |fastest, steps| {
                math::min(speed_mm_s, fastest) * steps
            })
        };
        Self {
            negative: settings.homing_direction,
            search: at(settings.homing_seek_mm_min),
            locate: at(settings.homing_feed_mm_min),
            acceleration: settings
                .acceleration_mm_s2
                .zip(steps_per_mm, |acceleration, steps| acceleration * steps),
            steps_per_mm,
            travel_mm: settings.max_travel_mm,
            pull_off_mm: settings.homing_pull_off_mm,
            debounce_ticks: u64::from(settings.homing_debounce_ms) * u64::from(TICKS_PER_MS),
        }
    }

    const fn is_negative(&self, axis: usize) -> bool {
        self.negative >> axis & 1 != 0
    }

    /// Returns a distance as steps towards the switch.
    pub(super) fn towards_switch(&self, axis: usize, mm: f32) -> i32 {
        let steps = round(mm * self.steps_per_mm[axis]);
        if self.is_negative(axis) {
            -steps
        } else {
            steps
        }
    }

    /// Returns the position of an axis once it is homed, steps, in Grbl's arithmetic.
    pub(super) fn home(&self, axis: usize) -> i32 {
        let mm = if self.is_negative(axis) {
            self.pull_off_mm - self.travel_mm[axis]
        } else {
            -self.pull_off_mm
        };
        round(mm * self.steps_per_mm[axis])
    }
}

/// Returns the nearest whole number, halves away from zero.
fn round(value: f32) -> i32 {
    (if value < 0.0 {
        value - 0.5
    } else {
        value + 0.5
    }) as i32
}
