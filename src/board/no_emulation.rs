//! Boards that no emulator stands for: what `emulation` does for the one it does.

use leadscrew::model::{Levels, Outputs};

/// Returns whether the firmware runs in the emulator.
pub(super) const fn is_emulated() -> bool {
    false
}

/// Counts the time to the first event.
pub(super) const fn count(_ticks: u32) {}

/// Lets time pass.
pub(super) const fn idle() {}

/// Returns the contacts that are closed.
pub(super) const fn contacts() -> Levels {
    Levels::NONE
}

/// Returns whether the sampling timer released `inputs`.
pub(super) const fn is_sample() -> bool {
    false
}

/// Sets the sampling timer.
pub(super) const fn sample_every(_ticks: u32) {}

/// Sets the timer of `prepare`.
pub(super) const fn wake_in(_milliseconds: u16) {}

/// Returns whether the time of `prepare` is over.
pub(super) const fn take_wake() -> bool {
    false
}

/// Keeps a record of what is switched.
pub(super) const fn switched(_outputs: &Outputs) {}

/// Reads emulated flash.
pub(super) const fn read_flash(_place: usize, _bytes: &mut [u8]) {}

/// Programs emulated flash.
pub(super) const fn write_flash(_place: usize, _bytes: &[u8]) {}

/// Erases emulated flash.
pub(super) const fn erase_flash(_place: usize, _length: usize) {}
