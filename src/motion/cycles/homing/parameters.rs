//! The parameters of the homing cycle, from the settings.

use crate::{
    axis::{AXES, Axes, X, Y, Z},
    math,
    model::core_xy,
    motion::{cycles::cycle_move::CycleLimits, limits::TICKS_PER_S},
    settings::Settings,
    stepper::{AxisMotion, Segment},
    units::{FineSteps, TICKS_PER_MS},
};

/// Per s² to per tick².
const PER_TICK_SQR: f32 = 1.0 / (TICKS_PER_S * TICKS_PER_S);

/// Speeds, distances and times of the cycle.
#[derive(Debug)]
pub(super) struct HomingParameters {
    pub(super) limits: CycleLimits,
    /// Axes whose switch is at their negative end, bit 0 = X.
    pub(super) negative: u8,
    /// Axes without a switch, which are at home where they stand, bit 0 = X.
    pub(super) by_marks: u8,
    /// Speeds of each axis.
    pub(super) search_mm_s: f32,
    pub(super) locate_mm_s: f32,
    pub(super) travel_mm: Axes<f32>,
    /// Coordinate of each axis once it is homed, mm.
    home_mm: Axes<f32>,
    pub(super) pull_off_mm: f32,
    /// What the motor turns before the axis follows it off the switch: whole steps.
    pub(super) backlash_mm: Axes<f32>,
    pub(super) debounce_ticks: u32,
}

impl HomingParameters {
    pub(super) const NONE: Self = Self {
        limits: CycleLimits::NONE,
        negative: 0,
        by_marks: 0,
        search_mm_s: 0.0,
        locate_mm_s: 0.0,
        travel_mm: Axes([0.0; AXES]),
        home_mm: Axes([0.0; AXES]),
        pull_off_mm: 0.0,
        backlash_mm: Axes([0.0; AXES]),
        debounce_ticks: 0,
    };

    /// Takes over the settings.
    pub(super) fn configure(&mut self, settings: &Settings) {
        self.limits.configure(settings);
        self.negative = settings.homing_direction;
        self.by_marks = settings.homing_marks;
        self.search_mm_s = settings.homing_seek_mm_min / 60.0;
        self.locate_mm_s = settings.homing_feed_mm_min / 60.0;
        self.travel_mm = settings.max_travel_mm;
        self.home_mm = Axes::from_fn(|axis| settings.home_mm(axis));
        self.pull_off_mm = settings.homing_pull_off_mm;
        self.backlash_mm = Axes::from_fn(|axis| {
            settings.backlash_steps(axis) as f32 / self.limits.steps_per_mm[axis]
        });
        self.debounce_ticks = u32::from(settings.homing_debounce_ms) * TICKS_PER_MS;
    }

    /// Returns the deceleration of an axis that has found its switch, steps per tick².
    pub(super) fn deceleration(&self, axis: usize) -> f32 {
        let limits = &self.limits;
        let mut mm_s2 = limits.acceleration_mm_s2[axis];
        if limits.is_core_xy && axis != Z {
            // Both axes may slow down at the same time, by the same motor.
            let [a, b] = [X, Y].map(|motor| limits.acceleration_mm_s2[motor]);
            mm_s2 = 0.5 * math::min(a, b);
        }
        mm_s2 * limits.steps_per_mm[axis] * PER_TICK_SQR
    }

    /// Returns where the axes are for where the motors are.
    pub(super) fn axes_of(&self, motors: &Axes<FineSteps>) -> Axes<FineSteps> {
        if self.limits.is_core_xy {
            core_xy::fine_steps_of(*motors)
        } else {
            *motors
        }
    }

    /// Returns the same in whole steps.
    pub(super) fn axis_steps_of(&self, motors: &Axes<i32>) -> Axes<i32> {
        if self.limits.is_core_xy {
            core_xy::steps_of(*motors)
        } else {
            *motors
        }
    }

    /// Returns where the motors are for where the axes are.
    pub(super) fn motor_steps_of(&self, axes: Axes<i32>) -> Axes<i32> {
        if self.limits.is_core_xy {
            core_xy::motors_of(axes)
        } else {
            axes
        }
    }

    /// Makes a segment of the axes one of the motors.
    pub(super) fn drive_motors(&self, segment: &mut Segment) {
        if self.limits.is_core_xy {
            let to = core_xy::motors_of(segment.axes.map(|motion| motion.to.0));
            let acceleration = core_xy::motors_of(segment.axes.map(|motion| motion.acceleration));
            segment.axes = to.zip(acceleration, |to, acceleration| AxisMotion {
                to: FineSteps(to),
                acceleration,
            });
        }
    }

    /// Returns those of some axes whose motors move that axis alone, bit 0 = X.
    pub(super) const fn of_own_motors(&self, axes: u8) -> u8 {
        if self.limits.is_core_xy {
            axes & !(1 << X | 1 << Y)
        } else {
            axes
        }
    }

    const fn is_negative(&self, axis: usize) -> bool {
        self.negative >> axis & 1 != 0
    }

    /// Returns a distance as steps towards the switch.
    pub(super) fn towards_switch(&self, axis: usize, mm: f32) -> i32 {
        let steps = round(mm * self.limits.steps_per_mm[axis]);
        if self.is_negative(axis) {
            -steps
        } else {
            steps
        }
    }

    /// Returns the position of an axis once it is homed, steps, in Grbl's arithmetic.
    pub(super) fn home(&self, axis: usize) -> i32 {
        round(self.home_mm[axis] * self.limits.steps_per_mm[axis])
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
