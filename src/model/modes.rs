//! The modes of G-code that other modules than the interpreter use.

use core::ops::{Index, IndexMut};

/// The state of the spindle.
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

/// The state of the coolant.
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
    /// Returns the first axis, the second axis, and the axis along the normal.
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

/// Sense of rotation of an arc.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rotation {
    /// `G2`.
    Clockwise,
    /// `G3`.
    CounterClockwise,
}

/// The path control mode: how moves follow each other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum PathControl {
    /// `G61`: along the programmed path, as fast as the corners allow.
    #[default]
    ExactPath,
    /// `G61.1`: to a standstill at the end of each move.
    ExactStop,
    /// `G64`: near the programmed path, without losing more speed than needed.
    Continuous {
        /// Largest distance from the programmed path, nm (`P`); 0 for as far as half of each line.
        tolerance_nm: u32,
        /// Largest distance from short lines that become one, nm (`Q`); 0 when none do.
        merging_nm: u32,
    },
}

impl PathControl {
    /// Returns the command as reports write it; `None` in the power-up mode, which Grbl does not
    /// report.
    #[must_use]
    pub const fn word(self) -> Option<&'static str> {
        match self {
            Self::ExactPath => None,
            Self::ExactStop => Some("G61.1"),
            Self::Continuous { .. } => Some("G64"),
        }
    }
}

/// Makes the work coordinate systems from one row each, in the order of their `G10` numbers: name,
/// command, and the number of the command with its fraction in hundredths.
macro_rules! work_coordinates {
    ($($(#[$attribute:meta])* $name:ident $word:literal ($whole:literal, $hundredths:literal),)*) => {
        /// A work coordinate system.
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
        #[repr(u8)]
        pub enum WorkCoordinates {
            $(#[doc = concat!("`", $word, "`.")] $(#[$attribute])* $name,)*
        }

        impl WorkCoordinates {
            /// All systems, in the order of their `G10` numbers, which begin with 1.
            pub const ALL: [Self; [$($word),*].len()] = [$(Self::$name),*];

            /// Returns the command as reports write it.
            #[must_use]
            pub const fn word(self) -> &'static str {
                match self {
                    $(Self::$name => $word,)*
                }
            }

            /// Returns the system of a command, from the number of the command and its fraction in
            /// hundredths.
            #[must_use]
            pub const fn of_code(whole: u8, hundredths: u8) -> Option<Self> {
                match (whole, hundredths) {
                    $(($whole, $hundredths) => Some(Self::$name),)*
                    _ => None,
                }
            }
        }
    };
}

work_coordinates! {
    #[default] G54 "G54" (54, 0),
    G55 "G55" (55, 0),
    G56 "G56" (56, 0),
    G57 "G57" (57, 0),
    G58 "G58" (58, 0),
    G59 "G59" (59, 0),
    G59_1 "G59.1" (59, 10),
    G59_2 "G59.2" (59, 20),
    G59_3 "G59.3" (59, 30),
}

impl WorkCoordinates {
    /// The first system that Grbl does not have.
    pub const FIRST_BEYOND_GRBL: Self = Self::G59_1;

    /// Returns the index in [`Self::ALL`].
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// A value for each work coordinate system.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PerSystem<T>(pub [T; WorkCoordinates::ALL.len()]);

impl<T> Index<WorkCoordinates> for PerSystem<T> {
    type Output = T;

    fn index(&self, system: WorkCoordinates) -> &T {
        &self.0[system.index()]
    }
}

impl<T> IndexMut<WorkCoordinates> for PerSystem<T> {
    fn index_mut(&mut self, system: WorkCoordinates) -> &mut T {
        &mut self.0[system.index()]
    }
}
