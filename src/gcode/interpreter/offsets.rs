//! Offsets and stored positions, and the work coordinates that come of them.
//!
//! Machine position = origin + rotation · (work position + `G92`) + tool length offset, where the
//! rotation is about Z: in the plane of X and Y. Read with LinuxCNC 2.9 "Coordinate Systems".

use super::{CheckedLine, Interpreter};
use crate::{
    axis::{Axes, X, Y},
    gcode::StoredPosition,
    model::{WorkCoordinates, XyRotation},
    settings::Origins,
    units::Nm,
};

/// Everything that lies between machine and work coordinates, and the stored positions. nm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Offsets {
    /// What outlives power: `G54` to `G59.3`, `G28` and `G30`.
    pub origins: Origins,
    /// The offset of `G92` and `G52`.
    pub work: Axes<Nm>,
    /// The offset that `G92` or `G52` has set last, which `G92.3` restores.
    pub remembered_work: Axes<Nm>,
    /// The tool length offset.
    pub tool: Axes<Nm>,
}

impl Offsets {
    /// The origin of a work coordinate system.
    #[must_use]
    pub fn origin(&self, system: WorkCoordinates) -> Axes<Nm> {
        self.origins.coordinates[system]
    }

    /// A stored position.
    #[must_use]
    pub fn stored(&self, reference: StoredPosition) -> Axes<Nm> {
        match reference {
            StoredPosition::G28 => self.origins.g28,
            StoredPosition::G30 => self.origins.g30,
        }
    }
}

/// The work coordinates in effect: those of one system, with `G92` and the tool length offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Frame {
    /// Machine position minus work position without rotation.
    pub(super) total: Axes<Nm>,
    /// The offset of `G92`.
    work: Axes<Nm>,
    pub(super) rotation: XyRotation,
}

impl Frame {
    /// The frame of a machine without offsets.
    pub(super) const MACHINE: Self = Self {
        total: Axes::all(Nm(0)),
        work: Axes::all(Nm(0)),
        rotation: XyRotation::NONE,
    };

    /// Returns the frame of a work coordinate system. `known` is a rotation that need not be computed
    /// again.
    pub(super) fn of(
        origins: &Origins,
        system: WorkCoordinates,
        work: &Axes<Nm>,
        tool: &Axes<Nm>,
        known: &XyRotation,
    ) -> Self {
        let origin = &origins.coordinates[system];
        let angle = origins.rotations[system];
        Self {
            total: Axes::from_fn(|axis| origin[axis] + work[axis] + tool[axis]),
            work: *work,
            rotation: if angle == known.angle() {
                *known
            } else {
                XyRotation::by(angle)
            },
        }
    }

    /// Returns the origin of coordinates of an axis in the coordinates of a path: work coordinates
    /// where they are rotated, else those of the machine.
    pub(super) fn path_origin(&self, axis: usize) -> Nm {
        if self.rotation.is_none() {
            self.total[axis]
        } else {
            Nm(0)
        }
    }

    /// Returns the machine position of a work position.
    pub(super) fn machine(&self, work_position: &Axes<Nm>) -> Axes<Nm> {
        let mut machine = work_position.zip(self.total, |value, total| value + total);
        if !self.rotation.is_none() {
            let rotated = self
                .rotation
                .rotate([X, Y].map(|axis| work_position[axis] + self.work[axis]));
            for (axis, rotated) in [X, Y].into_iter().zip(rotated) {
                machine[axis] = self.total[axis] - self.work[axis] + rotated;
            }
        }
        machine
    }

    /// Returns the work position of a machine position.
    pub(super) fn work_position(&self, machine: &Axes<Nm>) -> Axes<Nm> {
        let mut position = machine.zip(self.total, |value, total| value - total);
        if !self.rotation.is_none() {
            let rotated = [X, Y].map(|axis| machine[axis] - self.total[axis] + self.work[axis]);
            let unrotated = self.rotation.unrotate(rotated);
            for (axis, unrotated) in [X, Y].into_iter().zip(unrotated) {
                position[axis] = unrotated - self.work[axis];
            }
        }
        position
    }
}

/// Returns the work coordinates in which a line is executed: it may change the system and the tool
/// length offset first.
pub(super) fn frame(state: &Interpreter, checked: &CheckedLine) -> Frame {
    let system = checked.modal.coordinates;
    if system == state.modal.coordinates && checked.tool == state.offsets.tool {
        state.frame
    } else {
        frame_of(state, checked, system)
    }
}

/// The same in a system.
pub(super) fn frame_of(
    state: &Interpreter,
    checked: &CheckedLine,
    system: WorkCoordinates,
) -> Frame {
    let offsets = &state.offsets;
    let known = &state.frame.rotation;
    Frame::of(
        &offsets.origins,
        system,
        &offsets.work,
        &checked.tool,
        known,
    )
}

/// Returns the present position in work coordinates.
pub(super) fn present(state: &Interpreter, frame: &Frame) -> Axes<Nm> {
    if *frame == state.frame {
        state.work_position()
    } else {
        frame.work_position(&state.position)
    }
}
