//! Axes and their motors, which are not the same on a machine with `CoreXY`.

use std::{array, f64::consts::SQRT_2};

use leadscrew::{
    axis::{AXES, LETTERS, X, Y},
    settings::Settings,
};

use super::{geometry::Point, jerk_limits};
use crate::steps_per_mm;

/// Scales of the motors along the tool path: a motor of `CoreXY` turns for √2 mm while it moves the tool by 1 mm.
#[derive(Debug, Clone)]
pub(super) struct MotorScales {
    /// mm of the motor for one mm along the direction in which it moves the tool.
    pub(super) ratios: Point,
    /// Along that direction, steps/mm and mm/s².
    pub(super) steps_per_mm: Point,
    pub(super) accelerations: Point,
    pub(super) jerks: [Option<f64>; AXES],
    /// Those of the motor itself, mm/s² and mm/s³ of the motor; 0 without one.
    pub(super) limits: [[f64; 2]; AXES],
}

impl MotorScales {
    pub(super) fn of(settings: &Settings) -> Self {
        let mut ratios = [1.0; AXES];
        if settings.core_xy {
            [ratios[X], ratios[Y]] = [SQRT_2; 2];
        }
        let (scales, jerks) = (steps_per_mm(settings), jerk_limits(settings));
        let limits = settings.acceleration_mm_s2;
        Self {
            ratios,
            steps_per_mm: array::from_fn(|axis| scales[axis] * ratios[axis]),
            accelerations: array::from_fn(|axis| f64::from(limits[axis]) / ratios[axis]),
            jerks: array::from_fn(|axis| Some(jerks[axis]? / ratios[axis])),
            limits: array::from_fn(|axis| [limits[axis].into(), jerks[axis].unwrap_or(0.0)]),
        }
    }
}

/// The name of an axis, or of a motor of `CoreXY`.
pub(crate) fn name(axis: usize, is_core_xy: bool) -> String {
    let letter = char::from(LETTERS[axis]);
    if is_core_xy && axis <= Y {
        format!("motor {letter}")
    } else {
        letter.to_string()
    }
}
