//! The watchdog of the chip, which resets it when a task does not come to its end.
//!
//! `idle` feeds the watchdog: it runs only when every released task has come to its end. So `idle`, `interpret`,
//! `prepare` and all above them must come round. What takes long by itself, the erasing and programming of flash, feeds
//! it in its loops. Once started, nothing but a reset stops it. The watchdog is started first, so that a chip whose
//! clocks cannot be set up is reset again and again, and moves nothing. RM0090 21.3, 21.4.
//!
//! `interpret` has work as long as lines wait. `interpret` does one run at a time, and waits for `idle` in between
//! (`release.rs`): so no number of lines is taken for a hanging task. The longest run is that of an arc in whole steps,
//! whose areas are summed up before it begins: some 40 ms.

use super::pac;

/// Counts of a quarter of the internal slow clock, whose frequency is 17 to 47 kHz, 32 kHz typically (data
/// sheet, LSI): at least 100 ms, 147 ms typically, at most 276 ms.
pub(crate) const RELOAD: u16 = 1175;

/// Reads of the status before its registers count as stuck: more than 100 ms at any clock, and a change takes 48 ms at the
/// slowest (six periods of the slow clock by 256).
const MAX_STATUS_READS: u32 = 1_000_000;
/// Cycles of the core between two feeds of a pause: 12 ms at most at the 16 MHz of the internal oscillator.
const PAUSE_CYCLES: u32 = 150_000;
/// Cycles of the core that `asm::delay` takes for each requested cycle.
const CYCLES_PER_DELAY: u32 = 3;

/// Starts the watchdog, with the period of a reset or of a bootloader; it waits while a debugger has halted the
/// processor.
pub(crate) fn start(watchdog: &pac::IWDG, debug: &pac::DBGMCU) {
    debug.apb1_fz().modify(|_, w| w.dbg_iwdg_stop().set_bit());
    watchdog.kr().write(|w| w.key().start());
    feed();
}

/// Sets the period. A bootloader may have changed the period while no slow clock ran, such as the bootloader in the
/// chip's ROM. The change has not ended then, and the registers take no other value: RM0090 21.4.4.
pub(crate) fn set_period(watchdog: &pac::IWDG) {
    let is_settled = || watchdog.sr().read().bits() == 0;
    for _ in 0..2 {
        let _ = await_flag(MAX_STATUS_READS, is_settled);
        watchdog.kr().write(|w| w.key().unlock());
        watchdog.pr().write(|w| w.pr().set(0));
        watchdog.rlr().write(|w| w.rl().set(RELOAD));
        let _ = await_flag(MAX_STATUS_READS, is_settled);
        if watchdog.pr().read().pr().bits() == 0 && watchdog.rlr().read().rl().bits() == RELOAD {
            break;
        }
    }
    feed();
}

/// Returns whether a flag comes within a number of reads, of 8 cycles at least, and feeds the watchdog meanwhile.
#[inline(never)]
pub(crate) fn await_flag(max_reads: u32, is_set: impl Fn() -> bool) -> bool {
    (0..max_reads).any(|_| {
        feed();
        // Keeps several reads from becoming one block of conditional ones, which not every model of the core executes right.
        cortex_m::asm::nop();
        is_set()
    })
}

/// Lets cycles of the core pass, and feeds the watchdog meanwhile.
pub(crate) fn pause(cycles: u32) {
    let mut left = cycles;
    while left != 0 {
        let now = left.min(PAUSE_CYCLES);
        cortex_m::asm::delay(now / CYCLES_PER_DELAY);
        feed();
        left -= now;
    }
}

/// Feeds the watchdog. Also from RAM, where nothing in flash may be called.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
#[expect(unsafe_code, reason = "several places feed it")]
pub(crate) fn feed() {
    // SAFETY: the key has no other effect than to feed.
    let watchdog = unsafe { &*pac::IWDG::ptr() };
    watchdog.kr().write(|w| w.key().feed());
}
