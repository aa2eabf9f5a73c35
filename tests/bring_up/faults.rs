//! Faults on purpose: each ends in a reset, which this program survives.
//!
//! Before each, outputs are switched on. A fault that nothing notices would leave the outputs on, so the watchdog runs
//! meanwhile, as the first fault shows. A stack without its guard is not tried: it would overwrite everything, what
//! this program knows of itself too.

use core::hint::black_box;

use cortex_m::{
    peripheral::{MPU, NVIC, SCB},
    register::msp,
};
use leadscrew::model::ResetCause;

use super::{
    Kept, clock, emulation,
    kept::{leave, left},
    outputs::{self, CYCLES, HAS_WATCHDOG, LEFT_ON, NOT_REACHED, ON, START},
    pac, watchdog,
};

/// A fault.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fault {
    /// A program that hangs.
    Watchdog,
    /// An instruction that is none.
    Undefined,
    /// A stack that grows into its guard.
    Stack,
    /// A panic.
    Panic,
    /// The exception of a crystal that stops.
    Clock,
    /// An interrupt without a task.
    Interrupt,
}

/// All of them, in their order, with what the facts call them.
const FAULTS: [(Fault, &str); 6] = [
    (Fault::Watchdog, "fault.watchdog"),
    (Fault::Undefined, "fault.undefined"),
    (Fault::Stack, "fault.stack"),
    (Fault::Panic, "fault.panic"),
    (Fault::Clock, "fault.clock"),
    (Fault::Interrupt, "fault.interrupt"),
];

/// Longest time for a fault to reset the chip: more than the watchdog ever takes, 0.3 s.
const PATIENCE_CYCLES: i64 = 80_000_000;
/// Longest time for the watchdog to take its setting, five of its own cycles, many times: RM0090 21.4.4.
const SETTING_CYCLES: i64 = 1_000_000;
/// Flag of a reset by the watchdog: RM0090 7.3.21.
const BY_WATCHDOG: u32 = 1 << 29;

/// Records what came of the last fault that was made.
pub(super) fn record(cause: ResetCause, reset_flags: u32, kept: &mut Kept) {
    let Some((fault, name)) = kept
        .stage()
        .checked_sub(1)
        .and_then(|index| FAULTS.get(index))
    else {
        return;
    };
    let facts = kept.facts();
    facts.put_of(name, "cause", cause as i64);
    let is_by_watchdog = reset_flags & BY_WATCHDOG != 0;
    // The watchdog switches nothing off: the reset does.
    if *fault == Fault::Watchdog {
        leave(HAS_WATCHDOG, is_by_watchdog.into());
        return;
    }
    if left(CYCLES) != NOT_REACHED {
        facts.put_of(name, "cycles_to_off", left(CYCLES).into());
    }
    if !emulation::is_emulated() {
        facts.put_of(name, "by_watchdog", is_by_watchdog.into());
        facts.put_of(name, "on_before", left(ON).into());
        facts.put_of(name, "on_after", left(LEFT_ON).into());
    }
}

/// Makes the next fault, if there is one left: then this does not return.
pub(super) fn go_on(kept: &mut Kept, dog: &pac::IWDG, debug: &pac::DBGMCU, guard: &MPU) {
    while let Some((fault, name)) = FAULTS.get(kept.stage()) {
        if *fault == Fault::Watchdog {
            leave(HAS_WATCHDOG, 0);
            if emulation::is_emulated() {
                kept.skip();
                continue;
            }
        }
        if *fault == Fault::Stack && !is_guarded(guard) {
            kept.skip();
            kept.facts().put_of(name, "unguarded", 1);
            continue;
        }
        leave(CYCLES, NOT_REACHED);
        leave(LEFT_ON, NOT_REACHED);
        kept.arm();
        let is_watched = watch(dog, debug) && left(HAS_WATCHDOG) == 1;
        // Nothing is on for longer than the watchdog takes, and nothing while that is tried.
        let is_safe = is_watched || emulation::is_emulated();
        leave(ON, if is_safe { outputs::switch_on() } else { 0 });
        leave(START, clock::now());
        make(*fault);
        clock::wait(PATIENCE_CYCLES);
        outputs::make_safe();
        kept.disarm();
        kept.facts().put_of(name, "cause", 0);
    }
}

/// Starts the watchdog on the chip. Returns whether it runs and has taken its time: until then it may take
/// nearly 1 s.
fn watch(dog: &pac::IWDG, debug: &pac::DBGMCU) -> bool {
    if emulation::is_emulated() {
        return false;
    }
    watchdog::start(dog, debug);
    watchdog::set_period(dog);
    let start = clock::now();
    while dog.sr().read().bits() != 0 {
        if clock::cycles(clock::now().wrapping_sub(start)) > SETTING_CYCLES {
            return false;
        }
    }
    watchdog::feed();
    true
}

#[expect(unsafe_code, reason = "a symbol of the linker script")]
unsafe extern "C" {
    /// End of the statics.
    static __sheap: u32;
}

/// Returns whether the memory between the statics and the stack has a guard as `stack` sets it up.
fn is_guarded(guard: &MPU) -> bool {
    /// 4 KiB without access; all other memory as without the unit, which is off in a hard fault.
    const NO_ACCESS: u32 = 0x1000_0017;
    const ONLY_REGION: u32 = 0b101;
    /// The number of the region.
    const REGION: u32 = 0x1f;
    let unused = (&raw const __sheap) as u32..msp::read();
    guard.ctrl.read() == ONLY_REGION
        && guard.rasr.read() == NO_ACCESS
        && unused.contains(&(guard.rbar.read() & !REGION))
}

fn make(fault: Fault) {
    match fault {
        Fault::Watchdog => {}
        Fault::Undefined => cortex_m::asm::udf(),
        Fault::Stack => {
            black_box(deepen(black_box(u32::MAX)));
        }
        Fault::Panic => panic!("on purpose"),
        Fault::Clock => pend_nmi(),
        Fault::Interrupt => pend_unknown(),
    }
}

/// Takes 256 bytes of stack for each of so many calls.
#[inline(never)]
fn deepen(calls: u32) -> u32 {
    let taken = black_box([calls; 64]);
    if calls == 0 {
        return 0;
    }
    deepen(black_box(calls - 1)).wrapping_add(black_box(taken[0]))
}

#[expect(unsafe_code, reason = "a raw word for a register")]
fn pend_nmi() {
    const NMIPENDSET: u32 = 1 << 31;
    // SAFETY: pends an exception whose handler never returns.
    unsafe { (*SCB::PTR).icsr.write(NMIPENDSET) };
    cortex_m::asm::isb();
}

/// Pends the first vector of all, that of the other watchdog, which no firmware uses.
#[expect(unsafe_code, reason = "a vector without a handler")]
fn pend_unknown() {
    NVIC::pend(pac::Interrupt::WWDG);
    // SAFETY: the handler never returns.
    unsafe {
        NVIC::unmask(pac::Interrupt::WWDG);
        cortex_m::interrupt::enable();
    }
    cortex_m::asm::isb();
}
