//! The watchdog of the chip, which resets it when a task does not come to its end.
//!
//! `idle` feeds it: it runs only when every task that was released has come to its end. So `idle`, `interpret`,
//! `prepare` and all above them must come round. What takes long by itself, the erasing and programming of
//! flash, feeds it in its loops. Once started, nothing but a reset stops it. It is the first that is started, so that
//! a chip whose clocks cannot be set up is reset again and again, with its outputs off. RM0090 21.3, 21.4.
//!
//! `interpret` has work as long as lines wait. It does one run at a time, and waits for `idle` in between
//! (`release.rs`): so no number of lines is taken for a task that hangs. The longest run is that of an arc in whole
//! steps, whose areas are summed up before it begins: some 40 ms.

use super::{emulation, pac};

/// Counts of a quarter of the internal slow clock, whose frequency is 17 to 47 kHz, 32 kHz typically (data
/// sheet, LSI): at least 100 ms, 147 ms typically, at most 276 ms.
const RELOAD: u16 = 1175;

/// Starts the watchdog; it waits while a debugger has halted the processor.
pub(super) fn start(watchdog: &pac::IWDG, debug: &pac::DBGMCU) {
    debug.apb1_fz().modify(|_, w| w.dbg_iwdg_stop().set_bit());
    watchdog.kr().write(|w| w.key().start());
    watchdog.kr().write(|w| w.key().unlock());
    watchdog.pr().write(|w| w.pr().set(0));
    watchdog.rlr().write(|w| w.rl().set(RELOAD));
    feed();
}

/// Feeds the watchdog. Also from RAM, where nothing in flash may be called.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
#[expect(unsafe_code, reason = "several places feed it")]
pub(crate) fn feed() {
    emulation::feed_watchdog();
    // SAFETY: the key has no other effect than to feed.
    let watchdog = unsafe { &*pac::IWDG::ptr() };
    watchdog.kr().write(|w| w.key().feed());
}
