//! Offsets and stored positions.
//!
//! Work position = machine position - work coordinate system - `G92` - tool length.

use crate::{
    axis::{Axes, Z},
    gcode::StoredPosition,
    model::WorkCoordinates,
    settings::Origins,
    units::Nm,
};

/// The axis along which a tool length is measured.
pub(super) const TOOL_AXIS: usize = Z;

/// Everything that lies between machine and work coordinates, and the stored positions. nm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Offsets {
    /// What outlives power: `G54` to `G59`, `G28` and `G30`.
    pub origins: Origins,
    /// The offset of `G92`.
    pub work: Axes<Nm>,
    /// The tool length of `G43.1`, along Z.
    pub tool_length: Nm,
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
