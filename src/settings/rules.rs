//! Rules that tie settings to one another.
//!
//! A row names its rules: `check` refuses a new value, `adjust` changes the settings that depend on
//! it. Stored values were checked when they were typed; they are adjusted again, as some of them may
//! have been left out.

use super::{SettingError, Settings};

/// Soft limits need homing.
pub(super) fn soft_limits_need_homing(
    settings: &Settings,
    _axis: usize,
) -> Result<(), SettingError> {
    if settings.soft_limits && !settings.homing {
        return Err(SettingError::NeedsHoming);
    }
    Ok(())
}

/// Soft limits end with homing.
pub(super) fn soft_limits_end_with_homing(settings: &mut Settings) {
    settings.soft_limits &= settings.homing;
}

/// The resolution and the largest speed of an axis are a step rate that can be made.
pub(super) fn step_rate_is_possible(settings: &Settings, axis: usize) -> Result<(), SettingError> {
    let mm_s = settings.max_rate_mm_min[axis] / 60.0;
    if settings.steps_per_mm[axis].to_f32() * mm_s > settings.greatest_step_rate_hz() {
        return Err(SettingError::StepRate);
    }
    Ok(())
}
