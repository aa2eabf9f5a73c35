//! The crystal: started, and its frequency measured before the PLL is made of it.
//!
//! A board's file may name another crystal than the board has: boards of one maker have 8, 12 or 25 MHz. The PLL
//! would then run at another frequency, or never be ready. TIM11 captures its count of the internal oscillator's
//! periods at each 248th period of the crystal: RM0090 7.3.3 (RTCPRE), 19.5.11 (`TIM11_OR`); RM0383 14.5.11, RM0390 18.5.11.
//! No manual says whether that input needs the real-time clock, which is made of the same divided crystal; where
//! nothing comes from it, the board's file is taken for right.

use leadscrew::model::SelfTestFault;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

use super::{chosen::WIRING, pac, watchdog};

/// Reads of the crystal's flag before the crystal counts as missing: more than 100 ms at the 16 MHz of the
/// internal oscillator, of which each read takes 8 cycles at least. A crystal needs 2 ms (data sheet, HSE).
const CRYSTAL_READS: u32 = 200_000;
/// The internal oscillator, kHz.
const HSI_KHZ: u32 = 16_000;
/// Periods of the crystal between two captures: RTCPRE, and the prescaler of the capture.
const CRYSTAL_DIVIDER: u8 = 31;
const PERIODS_PER_CAPTURE: u32 = CRYSTAL_DIVIDER as u32 * 8;
/// Captures over which the frequency is measured: 16 bits count them at 4 MHz, the slowest crystal.
const CAPTURES: u32 = 16;
/// Reads of the flag before a capture counts as missing: more than 10 ms, while one takes 62 µs at 4 MHz.
const CAPTURE_READS: u32 = 20_000;
/// How far from the board's file the frequency may be, percent: the internal oscillator is right within 8 % (data
/// sheet, HSI), and crystals of 8, 12, 16 and 25 MHz are 25 % apart at least.
const TOLERANCE_PERCENT: u32 = 12;

/// Starts the crystal of the board's file, and measures its frequency.
///
/// # Errors
///
/// With the crystal off, if it does not run in time or is another one.
pub(super) fn start(rcc: &mut Rcc) -> Result<(), SelfTestFault> {
    rcc.cr()
        .modify(|_, w| w.hsebyp().bit(WIRING.is_crystal_bypassed));
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let is_ready = || rcc.cr().read().hserdy().bit_is_set();
    let found = if watchdog::await_flag(CRYSTAL_READS, is_ready) {
        check(frequency_khz(rcc))
    } else {
        Err(SelfTestFault::NoCrystal)
    };
    if found.is_ok() {
        // A crystal that stops from here on is an NMI, which stops the machine: RM0090 7.2.7. It is switched on before
        // the PLL is waited for, which without the crystal would never be ready.
        rcc.cr().modify(|_, w| w.csson().set_bit());
    } else {
        rcc.cr()
            .modify(|_, w| w.hseon().clear_bit().hsebyp().clear_bit());
    }
    found
}

/// Compares what was measured with the board's file. An unmeasured frequency is taken for right: the crystal itself
/// reports that it runs.
fn check(khz: Option<u32>) -> Result<(), SelfTestFault> {
    let expected_khz = WIRING.crystal_hz / 1000;
    match khz {
        Some(khz) if khz.abs_diff(expected_khz) * 100 > expected_khz * TOLERANCE_PERCENT => {
            Err(SelfTestFault::OtherCrystal { khz, expected_khz })
        }
        Some(_) | None => Ok(()),
    }
}

/// Measures the frequency of the crystal with the clock of TIM11 at that of the internal oscillator.
#[expect(unsafe_code, reason = "a timer that nobody owns, and raw fields")]
fn frequency_khz(rcc: &mut Rcc) -> Option<u32> {
    // SAFETY: nothing else uses the timer.
    let timer = unsafe { &*pac::TIM11::ptr() };
    pac::TIM11::enable(rcc);
    // SAFETY: dividers of 2 to 31 exist, and so does the source that is the divided crystal.
    unsafe {
        rcc.cfgr().modify(|_, w| w.rtcpre().bits(CRYSTAL_DIVIDER));
        timer.or().write(|w| w.rmp().bits(0b10));
        // CC1S: the input itself; IC1PSC: each eighth edge.
        timer.ccmr1_input().write(|w| w.bits(0b1101));
    }
    timer.ccer().write(|w| w.cc1e().set_bit());
    timer.cr1().write(|w| w.cen().set_bit());
    let counts = counts(timer);
    pac::TIM11::reset(rcc);
    pac::TIM11::disable(rcc);
    // SAFETY: zero is the value after a reset.
    rcc.cfgr().modify(|_, w| unsafe { w.rtcpre().bits(0) });
    (HSI_KHZ * PERIODS_PER_CAPTURE * CAPTURES).checked_div(counts?.into())
}

/// Returns the counts between the first capture and the last.
fn counts(timer: &pac::tim11::RegisterBlock) -> Option<u16> {
    let capture = || {
        let is_taken = || timer.sr().read().cc1if().bit_is_set();
        // The read of the capture clears its flag.
        watchdog::await_flag(CAPTURE_READS, is_taken).then(|| timer.ccr1().read().ccr().bits())
    };
    let first = capture()?;
    let mut last = first;
    for _ in 0..CAPTURES {
        last = capture()?;
    }
    // A capture that came before the previous capture was read is lost.
    let is_whole = timer.sr().read().cc1of().bit_is_clear();
    is_whole.then(|| last.wrapping_sub(first))
}
