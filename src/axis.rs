//! The axes, and a value for each of them.

/// Number of axes, chosen by the Cargo features `axes-4` to `axes-6`.
pub const AXES: usize = if cfg!(feature = "axes-6") {
    6
} else if cfg!(feature = "axes-5") {
    5
} else if cfg!(feature = "axes-4") {
    4
} else {
    3
};

/// Number of linear axes: X, Y, Z. The others are rotary.
pub const LINEAR: usize = 3;

/// The letters of the axes, in the order of [`Axes`].
pub const LETTERS: [u8; 6] = *b"XYZABC";

/// Index of the X axis.
pub const X: usize = 0;
/// Index of the Y axis.
pub const Y: usize = 1;
/// Index of the Z axis.
pub const Z: usize = 2;

/// One value per axis: X, Y, Z, then A, B, C where the machine has them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Axes<T>(pub [T; AXES]);

impl<T: Copy> Axes<T> {
    /// Returns the same value for every axis.
    #[must_use]
    pub const fn all(value: T) -> Self {
        Self([value; AXES])
    }

    /// Returns the values of a function of the index of each axis.
    #[must_use]
    pub fn from_fn(value: impl FnMut(usize) -> T) -> Self {
        Self(core::array::from_fn(value))
    }

    /// Returns a function of each value.
    #[must_use]
    pub fn map<U: Copy>(self, function: impl FnMut(T) -> U) -> Axes<U> {
        Axes(self.0.map(function))
    }

    /// Returns a function of each value and its counterpart.
    #[must_use]
    pub fn zip<U: Copy, V: Copy>(self, other: Axes<U>, function: impl Fn(T, U) -> V) -> Axes<V> {
        Axes::from_fn(|axis| function(self.0[axis], other.0[axis]))
    }

    /// Returns the values in the order of the axes.
    pub fn iter(&self) -> core::slice::Iter<'_, T> {
        self.0.iter()
    }

    /// Returns the values in the order of the axes, mutably.
    pub fn iter_mut(&mut self) -> core::slice::IterMut<'_, T> {
        self.0.iter_mut()
    }
}

impl<'a, T> IntoIterator for &'a Axes<T> {
    type Item = &'a T;
    type IntoIter = core::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl<'a, T> IntoIterator for &'a mut Axes<T> {
    type Item = &'a mut T;
    type IntoIter = core::slice::IterMut<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.iter_mut()
    }
}

impl<T> core::ops::Index<usize> for Axes<T> {
    type Output = T;

    fn index(&self, axis: usize) -> &T {
        &self.0[axis]
    }
}

impl<T> core::ops::IndexMut<usize> for Axes<T> {
    fn index_mut(&mut self, axis: usize) -> &mut T {
        &mut self.0[axis]
    }
}
