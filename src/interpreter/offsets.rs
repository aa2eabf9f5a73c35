//! Offsets and stored positions.
//!
//! Work position = machine position - work coordinate system - `G92` - tool length.

use crate::{
    axis::{Axes, Z},
    gcode::{Reference, WorkCoordinates},
    units::Nm,
};

/// The axis along which a tool length is measured.
pub(super) const TOOL_AXIS: usize = Z;

/// Everything that lies between machine and work coordinates, and the stored positions. nm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Offsets {
    /// Origins of `G54` to `G59`, in the machine frame.
    pub coordinates: [Axes<Nm>; WorkCoordinates::ALL.len()],
    /// The position of `G28`, in the machine frame.
    pub g28: Axes<Nm>,
    /// The position of `G30`, in the machine frame.
    pub g30: Axes<Nm>,
    /// The offset of `G92`.
    pub work: Axes<Nm>,
    /// The tool length of `G43.1`, along Z.
    pub tool_length: Nm,
}

impl Offsets {
    /// The origin of a work coordinate system.
    #[must_use]
    pub fn origin(&self, system: WorkCoordinates) -> Axes<Nm> {
        self.coordinates[system.index()]
    }

    /// A stored position.
    #[must_use]
    pub fn stored(&self, reference: Reference) -> Axes<Nm> {
        match reference {
            Reference::G28 => self.g28,
            Reference::G30 => self.g30,
        }
    }

    /// Machine position minus work position in a work coordinate system.
    #[must_use]
    pub fn total(&self, system: WorkCoordinates) -> Axes<Nm> {
        let mut total = self
            .origin(system)
            .zip(self.work, |origin, work| origin + work);
        total[TOOL_AXIS] = total[TOOL_AXIS] + self.tool_length;
        total
    }
}
