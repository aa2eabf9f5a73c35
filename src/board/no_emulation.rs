//! The functions of `emulation` on boards that no emulator stands for: they do nothing.

use leadscrew::model::{Levels, Outputs};

use super::pac;

/// Returns whether the firmware runs in the emulator.
pub(super) const fn detect(_rcc: &pac::RCC) -> bool {
    false
}

/// Starts the stand-in.
pub(super) const fn init(_timer: &pac::TIM2, _watchdog: &pac::TIM3, _nvic: &mut pac::NVIC) {}

/// Returns whether the firmware runs in the emulator.
pub(super) const fn is_emulated() -> bool {
    false
}

/// Sets the time to the next event.
pub(super) const fn count(_ticks: u32) {}

/// Lets time pass.
pub(super) const fn idle() {}

/// Returns the contacts that are closed.
pub(super) const fn contacts() -> Levels {
    Levels::NONE
}

/// Returns whether the line from the sender is low.
pub(super) const fn is_line_low() -> bool {
    false
}

/// Returns whether a millisecond has passed since the last call.
pub(super) const fn take_millisecond() -> bool {
    false
}

/// Takes the release of `inputs` for a sample.
pub(super) const fn take_sample_release() -> bool {
    false
}

/// Sets the time between two samples of the contacts.
pub(super) const fn sample_every(_ticks: u32) {}

/// Feeds the watchdog.
pub(super) const fn feed_watchdog() {}

/// Begins a delay of `prepare`.
pub(super) const fn start_delay(_delay_ms: u16) {}

/// Takes the end of the delay of `prepare`.
pub(super) const fn take_delay_end() -> bool {
    false
}

/// Records the outputs.
pub(super) const fn record_outputs(_outputs: &Outputs) {}

/// Reads emulated flash.
#[cfg(not(feature = "eeprom"))]
pub(super) const fn read_flash(_offset: usize, _bytes: &mut [u8]) {}

/// Programs emulated flash.
#[cfg(not(feature = "eeprom"))]
pub(super) const fn write_flash(_offset: usize, _bytes: &[u8]) {}

/// Erases emulated flash.
#[cfg(not(feature = "eeprom"))]
pub(super) const fn erase_flash(_offset: usize, _length: usize) {}
