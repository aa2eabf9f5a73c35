//! How far the axes can count.

use crate::{
    axis::Axes,
    gcode::LineError,
    settings::Settings,
    units::{Nm, StepsPerMm},
};

/// The distance from zero that every axis reaches, at the finest resolution: a position within this distance needs no
/// division.
const MIN_REACH: Nm = match StepsPerMm::from_millionths(StepsPerMm::MAX) {
    Some(finest) => finest.farthest(),
    None => Nm(0),
};

/// Checks that every axis can count up to a position.
pub(super) fn check_position(settings: &Settings, position: &Axes<Nm>) -> Result<(), LineError> {
    if is_within_min_reach(position) {
        return Ok(());
    }
    let farthest = settings.farthest();
    let mut both = position.iter().zip(&farthest);
    if both.all(|(value, farthest)| -farthest.0 <= value.0 && value.0 <= farthest.0) {
        Ok(())
    } else {
        Err(LineError::InvalidTarget)
    }
}

/// Whether every axis reaches a position, whatever its resolution.
#[inline]
pub(super) fn is_within_min_reach(position: &Axes<Nm>) -> bool {
    let is_reached = |value: &Nm| -MIN_REACH.0 <= value.0 && value.0 <= MIN_REACH.0;
    position.iter().all(is_reached)
}
