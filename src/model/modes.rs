//! What the modal groups of G-code choose between, as far as more than the interpreter knows it.

/// What the spindle does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Spindle {
    /// `M5`.
    #[default]
    Off,
    /// `M3`.
    Clockwise,
    /// `M4`.
    CounterClockwise,
}

/// What the coolant does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Coolant {
    /// `M8`.
    pub flood: bool,
    /// `M7`.
    pub mist: bool,
}

impl Coolant {
    /// `M9`.
    pub const OFF: Self = Self {
        flood: false,
        mist: false,
    };
}

/// The plane of arcs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Plane {
    /// `G17`.
    #[default]
    Xy,
    /// `G18`.
    Zx,
    /// `G19`.
    Yz,
}

impl Plane {
    /// First axis, second axis, and the axis along the normal.
    #[must_use]
    pub const fn axes(self) -> (usize, usize, usize) {
        use crate::axis::{X, Y, Z};
        match self {
            Self::Xy => (X, Y, Z),
            Self::Zx => (Z, X, Y),
            Self::Yz => (Y, Z, X),
        }
    }
}

/// Sense of rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rotation {
    /// `G2`.
    Clockwise,
    /// `G3`.
    CounterClockwise,
}

/// How moves follow each other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum PathControl {
    /// `G61`: along the programmed path, as fast as the corners allow.
    #[default]
    ExactPath,
    /// `G61.1`: to a standstill at the end of each move.
    ExactStop,
    /// `G64`: near the programmed path, without losing more speed than needed.
    Continuous {
        /// Farthest from the programmed path, nm (`P`); 0 for as far as half of each line.
        tolerance_nm: u32,
        /// Farthest from short lines that become one, nm (`Q`); 0 when none do.
        merging_nm: u32,
    },
}

impl PathControl {
    /// The command as reports write it; `None` in the power-up mode, which Grbl does not report.
    #[must_use]
    pub const fn word(self) -> Option<&'static str> {
        match self {
            Self::ExactPath => None,
            Self::ExactStop => Some("G61.1"),
            Self::Continuous { .. } => Some("G64"),
        }
    }
}

/// A work coordinate system.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum WorkCoordinates {
    /// `G54`, number 1 of `G10`.
    #[default]
    G54,
    /// `G55`.
    G55,
    /// `G56`.
    G56,
    /// `G57`.
    G57,
    /// `G58`.
    G58,
    /// `G59`.
    G59,
}

impl WorkCoordinates {
    /// All of them, in order.
    pub const ALL: [Self; 6] = [
        Self::G54,
        Self::G55,
        Self::G56,
        Self::G57,
        Self::G58,
        Self::G59,
    ];

    /// Its place in [`Self::ALL`].
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The command as reports write it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::G54 => "G54",
            Self::G55 => "G55",
            Self::G56 => "G56",
            Self::G57 => "G57",
            Self::G58 => "G58",
            Self::G59 => "G59",
        }
    }
}
