//! What homing tells of the ends of the travel: where `G28` and `G30` lead without a stored position, where `G53` ends
//! before a switch, and how far jogs go.
//!
//! Read with grblHAL `machine_limits.c` (`apply_jog_limits`).

use super::{CheckedLine, Interpreter, offsets};
use crate::{
    axis::{AXES, Axes, LINEAR, Z},
    gcode::StoredPosition,
    settings::Settings,
    units::Nm,
};

/// Where axes have been homed, as long as their position is certain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Home {
    /// The axes, bit 0 = X.
    axes: u8,
    position: Axes<Nm>,
    /// The position of `G28` and `G30` where none has been stored.
    reference: Axes<Nm>,
}

impl Home {
    /// No axis is homed.
    pub(super) const NONE: Self = Self {
        axes: 0,
        position: Axes::all(Nm(0)),
        reference: Axes::all(Nm(0)),
    };

    /// Returns where an axis has been homed.
    fn of(&self, axis: usize) -> Option<Nm> {
        (self.axes >> axis & 1 != 0).then(|| self.position[axis])
    }
}

impl Interpreter {
    /// The axes of a mask, bit 0 = X, have been homed where they stand.
    pub fn set_homed(&mut self, axes: u8, settings: &Settings) {
        for axis in 0..AXES {
            if axes >> axis & 1 != 0 {
                let position = self.position[axis];
                self.home.position[axis] = position;
                self.home.reference[axis] = if axis == Z && settings.homes_downwards(Z) {
                    // Home is in the table.
                    settings.top()
                } else {
                    position
                };
            }
        }
        self.home.axes |= axes;
    }

    /// Axes may have lost steps since they have been homed.
    pub fn forget_home(&mut self) {
        self.home = Home::NONE;
    }

    /// The axes that are homed, bit 0 = X.
    #[must_use]
    pub fn homed_axes(&self) -> u8 {
        self.home.axes
    }

    /// Whether X, Y and Z are where their coordinates say: nothing has happened since homing by which they may
    /// have lost steps.
    #[must_use]
    pub fn is_homed(&self) -> bool {
        const ALL: u8 = (1 << LINEAR) - 1;
        self.home.axes & ALL == ALL
    }

    /// The position of `G28` or `G30`. Without a stored position it is the position where the axes have been homed, but
    /// for a Z homed downwards: machine zero is the switch, or the far end of the travel.
    pub(super) fn stored(&self, reference: StoredPosition) -> Axes<Nm> {
        let stored = self.offsets.stored(reference);
        if stored == Axes::all(Nm(0)) {
            self.home.reference
        } else {
            stored
        }
    }
}

/// Returns where a `G53` move of an axis to a target ends: where the axis has been homed, if the target is between there
/// and the end of the travel, which is a hard limit.
pub(super) fn before_switch(
    state: &Interpreter,
    settings: &Settings,
    axis: usize,
    target: Nm,
) -> Nm {
    let (Some(home), Some([lowest, highest])) = (state.home.of(axis), settings.travel(axis)) else {
        return target;
    };
    let is_beyond = if settings.homes_downwards(axis) {
        lowest <= target && target < home
    } else {
        home < target && target <= highest
    };
    if settings.hard_limits && is_beyond {
        home
    } else {
        target
    }
}

/// Returns where a jog of an axis ends, if it were alone.
fn jog_end(state: &Interpreter, settings: &Settings, axis: usize, from: Nm, to: Nm) -> Nm {
    match (state.home.of(axis), settings.travel_off_switches(axis)) {
        (Some(_), Some([lowest, highest])) => to.clamp(lowest.min(from), highest.max(from)),
        (_, _) => to,
    }
}

/// Shortens a jog, in its direction, to the travel of the axes that are homed. One that begins outside may come back.
pub(super) fn shorten_jog(state: &Interpreter, settings: &Settings, checked: &mut CheckedLine) {
    let from = state.position;
    let to = checked.values;
    let ends = Axes::from_fn(|axis| jog_end(state, settings, axis, from[axis], to[axis]));
    if ends == to {
        return;
    }
    let mut share = 1.0;
    for axis in 0..AXES {
        if ends[axis] != to[axis] {
            let axis_share =
                (ends[axis] - from[axis]).to_mm_f64() / (to[axis] - from[axis]).to_mm_f64();
            share = f64::min(share, axis_share);
        }
    }
    for axis in 0..AXES {
        let (from, to) = (from[axis], to[axis]);
        if to == from {
            continue;
        }
        let value = from + Nm::from_mm_f64((to - from).to_mm_f64() * share);
        // A rounded value is not beyond the end.
        let value = if to > from {
            value.min(ends[axis])
        } else {
            value.max(ends[axis])
        };
        checked.values[axis] = value;
        checked.single_mm[axis] = value.to_mm();
    }
    let frame = offsets::frame(state, checked);
    if !frame.rotation.is_none() {
        checked.work_target = frame.work_position(&checked.values);
    }
}
