//! Motions that are not blocks of a program: homing and probing.

pub(super) mod homing;
pub(super) mod probing;
