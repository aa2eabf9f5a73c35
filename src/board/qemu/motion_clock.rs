//! The clock of the motion: the time of the events that the stand-in plays.

use super::{pac, qemu};

pub(super) use qemu::now_ticks;

/// Starts nothing: the stand-in counts.
pub(super) const fn start(_: &pac::TIM5) {}

/// Returns whether a millisecond has passed since the last call, for `idle` alone: the time of events stands still at
/// rest.
pub(super) fn take_millisecond(_: &mut u32) -> bool {
    qemu::take_millisecond()
}
