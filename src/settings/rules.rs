//! Rules between settings.
//!
//! A row names its rules: `check` refuses a new value, `adjust` changes the settings that depend on
//! it. Stored values were checked when they were typed. They are adjusted again, as some values may
//! have been skipped.

use super::{SettingError, Settings};
use crate::{
    axis::{AXES, X, Y, Z},
    model::{HAS_HALF_STEPS, HAS_REPRAP},
    units::Nm,
};

/// Refuses bits of `$22` that the firmware does not have, and bits without a meaning while homing is off.
pub(super) fn homing_is_known(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    const ON: u8 = Settings::HOMING_ON;
    const AT_ZERO: u8 = Settings::HOMING_ON | Settings::ZERO_AT_HOME;
    match settings.homing {
        0 | ON | AT_ZERO => Ok(()),
        _ => Err(SettingError::OutOfRange),
    }
}

/// Refuses soft limits, of programs or of jogs, without homing.
pub(super) fn soft_limits_need_homing(
    settings: &Settings,
    _axis: usize,
) -> Result<(), SettingError> {
    if (settings.soft_limits || settings.shortens_jogs) && !settings.is_homing_on() {
        return Err(SettingError::NeedsHoming);
    }
    Ok(())
}

/// Switches soft limits off with homing, of programs and of jogs.
pub(super) fn limits_end_with_homing(settings: &mut Settings, _axis: usize) {
    settings.soft_limits &= settings.is_homing_on();
    settings.shortens_jogs &= settings.is_homing_on();
}

/// Refuses a resolution and a largest speed that together exceed the step rate of an axis.
pub(super) fn step_rate_is_possible(settings: &Settings, axis: usize) -> Result<(), SettingError> {
    let mm_s = settings.max_rate_mm_min[axis] / 60.0;
    if settings.steps_per_mm[axis].to_f32() * mm_s > settings.greatest_step_rate_hz() {
        return Err(SettingError::StepRate);
    }
    Ok(())
}

/// Refuses a resolution with which a largest speed exceeds the step rate, and another one of Y than of X where they
/// hang on the same belts. That of X is also Y's there.
pub(super) fn resolution_is_possible(settings: &Settings, axis: usize) -> Result<(), SettingError> {
    if settings.core_xy {
        if settings.steps_per_mm[Y] != settings.steps_per_mm[X] {
            return Err(SettingError::OutOfRange);
        }
        step_rate_is_possible(settings, Y)?;
    }
    step_rate_is_possible(settings, axis)?;
    lengths_are_counted(settings, axis)
}

/// Refuses a travel, and distances of homing and parking, that the steps of an axis cannot count.
pub(super) fn lengths_are_counted(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    let farthest = settings.farthest();
    let is_counted = |axis: usize, mm: f32| Nm::from_mm(mm.abs()) <= farthest[axis];
    let are_counted = (0..AXES).all(|axis| {
        is_counted(axis, settings.max_travel_mm[axis])
            && is_counted(axis, settings.homing_pull_off_mm)
    });
    if are_counted
        && is_counted(Z, settings.parking_target_mm)
        && is_counted(Z, settings.parking_pull_out_mm)
    {
        Ok(())
    } else {
        Err(SettingError::OutOfRange)
    }
}

/// Refuses belts whose motors would have to turn faster than the step rate allows, and those with backlash.
pub(super) fn belts_turn_at_rate(settings: &Settings, axis: usize) -> Result<(), SettingError> {
    belts_have_no_backlash(settings, axis)?;
    step_rate_is_possible(settings, Y)
}

/// Refuses backlash of X and Y where they hang on the same belts: that of a motor is none of an axis.
pub(super) fn belts_have_no_backlash(
    settings: &Settings,
    _axis: usize,
) -> Result<(), SettingError> {
    let has_backlash = [X, Y].iter().any(|axis| settings.backlash_mm[*axis] != 0.0);
    if settings.core_xy && has_backlash {
        return Err(SettingError::OutOfRange);
    }
    Ok(())
}

/// Gives both motors of `CoreXY` the resolution of X, unless it is that of Y which is new.
pub(super) fn belts_have_one_resolution(settings: &mut Settings, axis: usize) {
    if settings.core_xy && axis != Y {
        settings.steps_per_mm[Y] = settings.steps_per_mm[X];
    }
}

/// Refuses half steps where motors take steps and directions, and where an axis would have to be faster than its
/// motor is in full steps.
pub(super) fn motors_follow(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    if settings.half_steps && !HAS_HALF_STEPS {
        return Err(SettingError::OutOfRange);
    }
    (0..AXES).try_for_each(|axis| step_rate_is_possible(settings, axis))
}

/// Refuses rules for arcs that do not exist.
#[cfg(arc_machine)]
pub(super) fn arc_rule_is_known(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    match settings.arc_rule {
        0 | 1 => Ok(()),
        _ => Err(SettingError::OutOfRange),
    }
}

/// `$341`: `M6` is ignored, but for the number of the tool in the spindle.
pub const TOOL_CHANGE_IGNORED: u8 = 4;

/// Refuses ways to change a tool that do not exist: grblHAL's 1 to 3 measure the tool.
pub(super) fn tool_change_is_known(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    match settings.tool_change {
        0 | TOOL_CHANGE_IGNORED => Ok(()),
        _ => Err(SettingError::OutOfRange),
    }
}

/// Refuses delays shorter than half a second, but for none: grblHAL's range.
pub(super) fn delay_is_long_enough(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    let delays_s = [
        settings.door_spindle_delay_s,
        settings.door_coolant_delay_s,
        settings.spindle_delay_s,
    ];
    if delays_s
        .iter()
        .any(|&delay_s| 0.0 < delay_s && delay_s < 0.5)
    {
        return Err(SettingError::OutOfRange);
    }
    Ok(())
}

/// Refuses unknown dialects, and the dialect for which the firmware has not been built.
pub(super) fn dialect_is_known(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    match settings.dialect {
        0 | 2 => Ok(()),
        1 if HAS_REPRAP => Ok(()),
        _ => Err(SettingError::OutOfRange),
    }
}

/// X, Y and Z.
const LINEAR_AXES: usize = Z + 1;

/// Refuses axes that are not there, and X, Y and Z.
pub(super) fn extruder_is_an_axis(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    match usize::from(settings.extruder_axis) {
        0 => Ok(()),
        1..=LINEAR_AXES => Err(SettingError::OutOfRange),
        number if number > AXES => Err(SettingError::OutOfRange),
        _ => Ok(()),
    }
}

/// Refuses more than a minute.
pub(super) fn busy_interval_is_short(
    settings: &Settings,
    _axis: usize,
) -> Result<(), SettingError> {
    match settings.busy_interval_s {
        0..=60 => Ok(()),
        _ => Err(SettingError::OutOfRange),
    }
}

/// Refuses outputs that do not exist.
pub(super) fn fan_output_is_known(settings: &Settings, _axis: usize) -> Result<(), SettingError> {
    match settings.fan_output {
        0..=3 => Ok(()),
        _ => Err(SettingError::OutOfRange),
    }
}
