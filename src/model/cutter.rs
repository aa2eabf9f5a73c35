//! The cutter whose radius is compensated.

use super::Plane;

/// A side of the programmed path, seen in the direction of travel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Side {
    /// `G41`.
    #[default]
    Left,
    /// `G42`.
    Right,
}

impl Side {
    /// Returns the other side.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

/// The cutter beside the programmed path.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Cutter {
    /// The side on which it is.
    pub side: Side,
    /// Radius, mm; not negative.
    pub radius_mm: f64,
    /// The plane of the path: that of X and Y, or of Z and X.
    pub plane: Plane,
}
