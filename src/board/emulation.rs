//! What the emulator leaves out, and what it is asked for.
//!
//! QEMU 7.2's netduinoplus2 has no RCC, no GPIO and no output compare. SysTick's handler stands in
//! for the compare: it sets the counter to the compare value that the step interrupt has written,
//! and pends the step interrupt, which preempts it at once. The handler runs when no task has
//! anything to do, so that time passes as fast as the emulator gets through the events and no event
//! is ever late because the host was busy; and once in a while on its own, so that steps also
//! preempt tasks. The firmware's tasks run unchanged.
//!
//! As the handler stands where the hardware would, it also keeps the record of what the pins do,
//! which a tool reads from memory: [`FIGURES`].

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use cortex_m::peripheral::{NVIC, SCB, SYST, scb::SystemHandler, syst::SystClkSource};
use leadscrew::axis::AXES;

use super::{pac, pins, step_timer};

/// Lets the emulated counter all but stand still between the handler's settings of it.
pub(super) const PRESCALER: u16 = u16::MAX;
/// Time between two runs of the handler without being asked, in the emulator's core cycles: 1 ms.
const PREEMPTION_CYCLES: u32 = 168_000;

/// Whether the firmware runs in the emulator.
static IS_EMULATED: AtomicBool = AtomicBool::new(false);

/// Runs of the handler until tasks must have come to an end: one when they have, one before.
///
/// A host that is busy may let many runs fall due while a task gets nowhere; then time must wait.
static RUNS_LEFT: AtomicU32 = AtomicU32::new(0);

/// What the pins have done.
#[repr(C)]
struct Figures {
    /// Events that began a pulse.
    events: AtomicU32,
    /// Their hash, as [`leadscrew::sim::Tally`] has it, low word first.
    hash: [AtomicU32; 2],
    /// Ticks from the first such event to the last, low word first.
    ticks: [AtomicU32; 2],
    /// Pulses of each axis.
    pulses: [AtomicU32; 6],
    /// Position of each axis, steps.
    steps: [AtomicU32; 6],
}

/// Read by `cargo xtask qemu` by its symbol.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a symbol that a tool can find")]
static FIGURES: Figures = Figures {
    events: AtomicU32::new(0),
    hash: [AtomicU32::new(0x8422_2325), AtomicU32::new(0xcbf2_9ce4)],
    ticks: [const { AtomicU32::new(0) }; 2],
    pulses: [const { AtomicU32::new(0) }; 6],
    steps: [const { AtomicU32::new(0) }; 6],
};

/// When the last event with a pulse was due.
static LAST: AtomicU32 = AtomicU32::new(0);

/// Whether the firmware runs in the emulator.
pub(super) fn is_emulated() -> bool {
    IS_EMULATED.load(Relaxed)
}

/// Finds out where the firmware runs: no chip has all clocks off.
pub(super) fn detect(rcc: &pac::RCC) -> bool {
    let is_emulated = rcc.cr().read().bits() == 0;
    IS_EMULATED.store(is_emulated, Relaxed);
    is_emulated
}

/// Prepares SysTick, one level below the step interrupt and above all others.
#[expect(unsafe_code, reason = "priorities")]
pub(super) fn init(syst: &mut SYST, scb: &mut SCB) {
    /// The step interrupt's level is 0xC0, the next task's 0xD0; the emulator keeps all eight bits.
    const BETWEEN: u8 = 0xC8;
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(PREEMPTION_CYCLES - 1);
    syst.clear_current();
    syst.enable_interrupt();
    syst.enable_counter();
    // SAFETY: before any task runs, and SysTick shares nothing under a lock.
    unsafe { scb.set_priority(SystemHandler::SysTick, BETWEEN) };
}

/// Lets time pass: for when no task has anything to do.
pub(super) fn idle() {
    if step_timer::is_running() {
        RUNS_LEFT.store(2, Relaxed);
        SCB::set_pendst();
    } else {
        cortex_m::asm::wfi();
    }
}

#[cortex_m_rt::exception]
fn SysTick() {
    let runs_left = RUNS_LEFT.load(Relaxed);
    if runs_left != 0 && step_timer::is_running() {
        RUNS_LEFT.store(runs_left - 1, Relaxed);
        step_timer::skip();
        record();
        NVIC::pend(pac::Interrupt::TIM2);
    }
}

/// Adds the event that is due to the figures.
fn record() {
    let (axes, directions) = pins::pulses_next();
    if axes == 0 {
        return;
    }
    let due = step_timer::due();
    let elapsed = if FIGURES.events.load(Relaxed) == 0 {
        0
    } else {
        due.wrapping_sub(LAST.load(Relaxed))
    };
    LAST.store(due, Relaxed);
    add(&FIGURES.events, 1);
    store(
        &FIGURES.ticks,
        load(&FIGURES.ticks).wrapping_add(elapsed.into()),
    );
    let mut hash = load(&FIGURES.hash);
    for word in [elapsed, axes, directions.into()] {
        hash = (hash ^ u64::from(word)).wrapping_mul(0x0100_0000_01b3);
    }
    store(&FIGURES.hash, hash);
    for axis in 0..AXES {
        if axes & 1 << axis != 0 {
            add(&FIGURES.pulses[axis], 1);
            let is_negative = directions & 1 << axis != 0;
            add(&FIGURES.steps[axis], if is_negative { u32::MAX } else { 1 });
        }
    }
}

fn add(word: &AtomicU32, value: u32) {
    word.store(word.load(Relaxed).wrapping_add(value), Relaxed);
}

fn load([low, high]: &[AtomicU32; 2]) -> u64 {
    u64::from(high.load(Relaxed)) << 32 | u64::from(low.load(Relaxed))
}

fn store([low, high]: &[AtomicU32; 2], value: u64) {
    low.store(value as u32, Relaxed);
    high.store((value >> 32) as u32, Relaxed);
}
