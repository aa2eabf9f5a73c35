//! What of the firmware's stand-ins for hardware is needed here, and whether the emulator wants this program.

use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use leadscrew::model::Outputs;

use super::pac;

#[path = "../../src/board/emulation/flash.rs"]
mod flash;

pub(super) use flash::{read_flash, write_flash};

static IS_EMULATED: AtomicBool = AtomicBool::new(false);

/// Returns whether the program runs in the emulator.
pub(super) fn is_emulated() -> bool {
    IS_EMULATED.load(Relaxed)
}

/// Looks whether the program runs in the emulator: no chip has all clocks off.
pub(super) fn detect(rcc: &pac::RCC) {
    IS_EMULATED.store(rcc.cr().read().bits() == 0, Relaxed);
}

/// Returns whether the folder of the emulator has the file that asks for the program.
pub(super) fn is_wanted() -> bool {
    semihosting::fs::File::open(c"bring-up").is_ok()
}

/// Returns whether the folder of the emulator has the file that asks for a stack without a guard.
pub(super) fn is_unguarded() -> bool {
    is_emulated() && semihosting::fs::File::open(c"unguarded").is_ok()
}

/// Erases what stands for the flash, unless the folder of the emulator has the file that asks for one that is worn
/// out.
pub(super) fn erase_flash(offset: usize, length: usize) {
    if semihosting::fs::File::open(c"worn").is_err() {
        flash::erase_flash(offset, length);
    }
}

/// The emulator has no watchdog.
pub(super) const fn feed_watchdog() {}

/// The emulator has no pins.
pub(super) const fn record_outputs(_: &Outputs) {}
