//! Motions that are not blocks of a program: homing, parking and probing.

pub(super) mod cycle_move;
pub(super) mod homing;
pub(super) mod parking;
pub(super) mod probing;
