//! Entry into an exception, return from it, and what floating point adds.
#![expect(unsafe_code, reason = "handlers of exceptions")]

use core::{
    arch::{asm, global_asm},
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use crate::{
    cycles::{COUNTER, Sample},
    target::Samples,
};

/// The processor's register that pends exceptions, and its bits.
const ICSR: u32 = 0xe000_ed04;
const PEND_PLAIN: u32 = 1 << 28;
const PEND_FLOAT: u32 = 1 << 26;
const CLEAR: u32 = 1 << 27 | 1 << 25;
/// Cycles of the handler before it reads the counter, and from there to its return.
const BEFORE: u32 = 2;
const AFTER: u32 = 6;
/// Number of measurements of each.
const RUNS: u32 = 8;

/// Cycle count at which the handler was entered.
#[unsafe(no_mangle)]
static ENTERED: AtomicU32 = AtomicU32::new(0);

// `SysTick` does the same as `PendSV`, but uses floating point first.
global_asm!(
    ".global PendSV",
    ".thumb_func",
    "PendSV:",
    "movw r0, #0x1004",
    "movt r0, #0xe000",
    "ldr r1, [r0]",
    "movw r2, #:lower16:ENTERED",
    "movt r2, #:upper16:ENTERED",
    "str r1, [r2]",
    "bx lr",
    ".global SysTick",
    ".thumb_func",
    "SysTick:",
    "vmov.f32 s0, s0",
    "b PendSV",
);

/// Pends exceptions: when that began, and when it was over.
fn pend(what: u32) -> (u32, u32) {
    let (start, end): (u32, u32);
    // SAFETY: the handlers keep to the procedure call standard.
    unsafe {
        asm!(
            "dsb", "isb", "ldr {start}, [{counter}]",
            "str {what}, [{icsr}]", "dsb", "isb",
            "ldr {end}, [{counter}]",
            start = out(reg) start, end = out(reg) end, counter = in(reg) COUNTER,
            what = in(reg) what, icsr = in(reg) ICSR,
        );
    }
    (start, end)
}

/// Cycles of pending while the exceptions are masked.
fn masked(what: u32) -> u32 {
    let (start, end) = pend(what);
    let _ = pend(CLEAR);
    end.wrapping_sub(start)
}

/// Measures entry and return, each with `PRIMASK` as it is found: set.
pub(crate) fn measure(samples: &mut Samples) {
    let new = || Sample {
        repetitions: 1,
        least: u32::MAX,
        most: 0,
    };
    let (mut entry, mut exit, mut lazy) = (new(), new(), new());
    let add = |sample: &mut Sample, cycles: u32| {
        sample.least = sample.least.min(cycles);
        sample.most = sample.most.max(cycles);
    };
    let served = |what: u32| {
        // SAFETY: there is no critical section, and no other interrupt is enabled.
        unsafe { cortex_m::interrupt::enable() };
        let times = pend(what);
        cortex_m::interrupt::disable();
        times
    };
    for run in 0..=RUNS {
        let without = masked(PEND_PLAIN);
        let (start, end) = served(PEND_PLAIN);
        let entered = ENTERED.load(Relaxed);
        let in_all = end.wrapping_sub(start).saturating_sub(without);
        let to_handler = entered.wrapping_sub(start).saturating_sub(without + BEFORE);
        let exit_cycles = in_all.saturating_sub(to_handler + BEFORE + AFTER);
        let (start, end) = served(PEND_FLOAT);
        // The move and the branch of the other handler are 1 and 4 cycles.
        let more = end.wrapping_sub(start).saturating_sub(without + in_all + 5);
        // The first run fills the cache.
        if run > 0 {
            add(&mut entry, to_handler);
            add(&mut exit, exit_cycles);
            add(&mut lazy, more.div_ceil(2));
        }
    }
    samples.put("entry", "pended", &entry);
    samples.put("exit", "pended", &exit);
    samples.put("lazy_save", "half", &lazy);
}
