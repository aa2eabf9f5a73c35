//! Faults on purpose: each ends in a reset, which this program survives.

use core::hint::black_box;

use cortex_m::peripheral::{NVIC, SCB};
use leadscrew::model::ResetCause;

use super::{
    Kept, clock, emulation,
    kept::{leave, left},
    outputs::{self, CYCLES, LEFT_ON, NOT_REACHED, ON, START},
    pac, watchdog,
};

/// A fault.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fault {
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
    /// A program that hangs.
    Watchdog,
}

/// All of them, in their order, with what the facts call them.
const FAULTS: [(Fault, &str); 6] = [
    (Fault::Undefined, "fault.undefined"),
    (Fault::Stack, "fault.stack"),
    (Fault::Panic, "fault.panic"),
    (Fault::Clock, "fault.clock"),
    (Fault::Interrupt, "fault.interrupt"),
    (Fault::Watchdog, "fault.watchdog"),
];

/// Longest time for a fault to reset the chip: more than the watchdog ever takes, 0.3 s.
const PATIENCE_CYCLES: i64 = 80_000_000;

/// Records what came of the last fault that was made.
pub(super) fn record(stage: usize, cause: ResetCause, kept: &mut Kept) {
    let Some((fault, name)) = stage.checked_sub(1).and_then(|index| FAULTS.get(index)) else {
        return;
    };
    let facts = kept.facts();
    facts.put_of(name, "cause", cause as i64);
    // The watchdog switches nothing off: the reset does.
    if *fault == Fault::Watchdog {
        return;
    }
    if left(CYCLES) != NOT_REACHED {
        facts.put_of(name, "cycles_to_off", left(CYCLES).into());
    }
    if !emulation::is_emulated() {
        facts.put_of(name, "on_before", left(ON).into());
        facts.put_of(name, "on_after", left(LEFT_ON).into());
    }
}

/// Makes the next fault, if there is one left: then this does not return.
pub(super) fn go_on(kept: &mut Kept, dog: &pac::IWDG, debug: &pac::DBGMCU) {
    while let Some((fault, name)) = FAULTS.get(kept.stage()) {
        if *fault == Fault::Watchdog && emulation::is_emulated() {
            return;
        }
        leave(CYCLES, NOT_REACHED);
        leave(LEFT_ON, NOT_REACHED);
        // What hangs has its outputs on until the reset: not here.
        if *fault != Fault::Watchdog {
            leave(ON, outputs::switch_on());
        }
        kept.arm();
        leave(START, clock::now());
        make(*fault, dog, debug);
        clock::wait(PATIENCE_CYCLES);
        outputs::make_safe();
        kept.disarm();
        kept.facts().put_of(name, "cause", 0);
    }
}

fn make(fault: Fault, dog: &pac::IWDG, debug: &pac::DBGMCU) {
    match fault {
        Fault::Undefined => cortex_m::asm::udf(),
        Fault::Stack => {
            black_box(deepen(black_box(u32::MAX)));
        }
        Fault::Panic => panic!("on purpose"),
        Fault::Clock => pend_nmi(),
        Fault::Interrupt => pend_unknown(),
        Fault::Watchdog => watchdog::start(dog, debug),
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
