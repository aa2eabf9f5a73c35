//! Axes that follow their motors with backlash, `$160` to `$165`.

use leadscrew::{axis::AXES, settings::Settings, sim::Edge};

/// Axes of which some stand while their motors take up backlash.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AxesWithBacklash {
    /// Backlash of each axis, steps.
    backlash: [i32; AXES],
    /// Where the motors are, steps; each pushes its axis in the positive direction from here, and in the negative
    /// direction from as far as the backlash behind it.
    motors: [i32; AXES],
    /// Where the axes are, steps.
    axes: [i32; AXES],
}

impl AxesWithBacklash {
    /// Axes that moved last as by the pull-off of homing; `None` without backlash.
    pub(crate) fn of(settings: &Settings) -> Option<Self> {
        if settings.backlash_axes() == 0 {
            return None;
        }
        let backlash = std::array::from_fn(|axis| settings.backlash_steps(axis));
        let lead = |axis: usize| i32::from(settings.homing_direction >> axis & 1) * backlash[axis];
        Some(Self {
            backlash,
            motors: std::array::from_fn(lead),
            axes: [0; AXES],
        })
    }

    /// Follows an edge on the pins, and returns it without the steps in which a motor moves alone.
    pub(crate) fn follow(&mut self, edge: &Edge) -> Edge {
        let mut of_axes = *edge;
        for axis in (0..AXES).filter(|axis| edge.raise >> axis & 1 != 0) {
            let is_negative = edge.directions >> axis & 1 != 0;
            self.motors[axis] += if is_negative { -1 } else { 1 };
            let least = self.motors[axis] - self.backlash[axis];
            let followed = self.axes[axis].clamp(least, self.motors[axis]);
            if followed == self.axes[axis] {
                of_axes.raise &= !(1 << axis);
            }
            self.axes[axis] = followed;
        }
        of_axes
    }

    /// Where the axes are, steps from where they began.
    pub(crate) fn steps(&self) -> [i32; AXES] {
        self.axes
    }
}
