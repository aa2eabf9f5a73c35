//! `CoreXY`, `$795`: X and Y hang on two belts whose motors stand still. Motor A makes the steps of X + Y, motor B
//! those of X - Y.
//!
//! Both motors have the same resolution. Step counters, blocks and segments are those of the motors, in the places
//! of X and Y; coordinates, the travel and the switches are those of the axes.

use core::ops::{Add, Sub};

use crate::{
    axis::{Axes, X, Y},
    units::{FineSteps, Nm},
};

/// Returns what the motors do for what the axes do.
#[must_use]
#[inline]
pub fn motors_of<T: Copy + Add<Output = T> + Sub<Output = T>>(mut axes: Axes<T>) -> Axes<T> {
    let (x, y) = (axes[X], axes[Y]);
    axes[X] = x + y;
    axes[Y] = x - y;
    axes
}

/// Returns half of the sum and of the difference of the first two values.
fn halves<T: Copy>(motors: Axes<T>, value: fn(T) -> i64, result: fn(i64) -> T) -> Axes<T> {
    let (a, b) = (value(motors[X]), value(motors[Y]));
    let mut axes = motors;
    axes[X] = result(a.wrapping_add(b) >> 1);
    axes[Y] = result(a.wrapping_sub(b) >> 1);
    axes
}

/// Returns where the axes are for where the motors are, to a nanometre.
#[must_use]
pub fn position_of(motors: Axes<Nm>) -> Axes<Nm> {
    halves(motors, |nm| nm.0, Nm)
}

/// Returns the same in whole steps, to half a step.
#[must_use]
pub fn steps_of(motors: Axes<i32>) -> Axes<i32> {
    halves(motors, i64::from, |steps| steps as i32)
}

/// Returns the same in parts of a step.
#[must_use]
pub fn fine_steps_of(motors: Axes<FineSteps>) -> Axes<FineSteps> {
    halves(motors, |fine| fine.0, FineSteps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motors_turn_for_both_axes_and_say_where_they_are() {
        let mut position = Axes::all(Nm(7));
        [position[X], position[Y]] = [Nm(-3_000_001), Nm(5)];
        let motors = motors_of(position);
        assert_eq!([motors[X], motors[Y]], [Nm(-2_999_996), Nm(-3_000_006)]);
        assert_eq!(position_of(motors), position);
        let mut steps = Axes::all(i32::MAX);
        assert_eq!(steps_of(steps)[X], i32::MAX);
        [steps[X], steps[Y]] = [3, -4];
        assert_eq!([steps_of(steps)[X], steps_of(steps)[Y]], [-1, 3]);
        let fine = steps.map(|steps| FineSteps(i64::from(steps) << 32));
        assert_eq!(fine_steps_of(fine)[X], FineSteps(-FineSteps::ONE / 2));
    }
}
