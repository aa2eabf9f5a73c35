//! What the emulator leaves out, and what it is asked for.
//!
//! QEMU 7.2's netduinoplus2 has no RCC, no GPIO, no output compare and no basic timers. SysTick's
//! handler stands in for the compare: it sets the counter to the compare value that the step
//! interrupt has written, and pends the step interrupt, which preempts it at once. The handler runs
//! when no task has anything to do, so that time passes as fast as the emulator gets through the
//! events and no event is ever late because the host was busy; and once in a while on its own, so
//! that steps also preempt tasks. The firmware's tasks run unchanged.
//!
//! As the handler stands where the hardware would, it also keeps the record of what the pins do,
//! which a tool reads from memory: [`FIGURES`]. The contacts it takes from memory: [`CONTACTS`].
//! Of the other timers, the one that samples contacts follows the step timer's clock in motion; at
//! rest, and for `prepare`'s, the handler's own runs count the milliseconds.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use cortex_m::peripheral::{NVIC, SCB, SYST, scb::SystemHandler, syst::SystClkSource};

use super::{
    pac,
    release::{INPUTS, PREPARE},
    step_timer,
};

mod flash;
mod memory;

pub(super) use flash::{erase_flash, read_flash, write_flash};
pub(super) use memory::{contacts, switched};

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

/// Milliseconds until `prepare` is released, or 0, and whether that time is over.
static WAKE_MS: AtomicU32 = AtomicU32::new(0);
static IS_WAKE: AtomicBool = AtomicBool::new(false);

/// Ticks between two samples of the contacts, when the next is due on the step timer's clock, and
/// whether it has been. 0 ticks: no samples.
static SAMPLE_TICKS: AtomicU32 = AtomicU32::new(0);
static SAMPLE_DUE: AtomicU32 = AtomicU32::new(0);
static IS_SAMPLE: AtomicBool = AtomicBool::new(false);

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

/// Releases `prepare` after some milliseconds.
pub(super) fn wake_in(milliseconds: u16) {
    IS_WAKE.store(false, Relaxed);
    WAKE_MS.store(milliseconds.into(), Relaxed);
}

/// Whether the time of `prepare` is over: true once.
pub(super) fn take_wake() -> bool {
    let is_over = IS_WAKE.load(Relaxed);
    IS_WAKE.store(false, Relaxed);
    is_over
}

/// Sets the time between two samples of the contacts; 0: no samples.
pub(super) fn sample_every(ticks: u32) {
    SAMPLE_DUE.store(step_timer::now().wrapping_add(ticks), Relaxed);
    SAMPLE_TICKS.store(ticks, Relaxed);
}

/// Whether `inputs` was released to take a sample.
pub(super) fn is_sample() -> bool {
    let is_sample = IS_SAMPLE.load(Relaxed);
    IS_SAMPLE.store(false, Relaxed);
    is_sample
}

#[cortex_m_rt::exception]
fn SysTick() {
    if has_counted() {
        count_millisecond();
    }
    memory::record_duty();
    if memory::have_contacts_changed() {
        NVIC::pend(INPUTS);
    } else if !step_timer::is_running() {
        if SAMPLE_TICKS.load(Relaxed) != 0 {
            take_sample();
        }
    } else if is_sample_first() {
        take_sample();
    } else {
        play();
    }
}

/// Lets the event that is due happen, unless time must wait.
fn play() {
    let runs_left = RUNS_LEFT.load(Relaxed);
    if runs_left != 0 {
        RUNS_LEFT.store(runs_left - 1, Relaxed);
        step_timer::set(step_timer::due());
        memory::record();
        NVIC::pend(pac::Interrupt::TIM2);
    }
}

fn count_millisecond() {
    let left = WAKE_MS.load(Relaxed);
    if left != 0 {
        WAKE_MS.store(left - 1, Relaxed);
        if left == 1 {
            IS_WAKE.store(true, Relaxed);
            NVIC::pend(PREPARE);
        }
    }
}

/// Whether a sample is due before the next event.
fn is_sample_first() -> bool {
    let ahead = step_timer::due().wrapping_sub(SAMPLE_DUE.load(Relaxed));
    SAMPLE_TICKS.load(Relaxed) != 0 && ahead.cast_signed() >= 0
}

/// Lets the time of a sample come.
fn take_sample() {
    let due = SAMPLE_DUE.load(Relaxed);
    step_timer::set(due);
    SAMPLE_DUE.store(due.wrapping_add(SAMPLE_TICKS.load(Relaxed)), Relaxed);
    IS_SAMPLE.store(true, Relaxed);
    NVIC::pend(INPUTS);
}

/// Whether a millisecond has passed since this was asked last.
#[expect(unsafe_code, reason = "nobody can hand the timer to an exception")]
fn has_counted() -> bool {
    const COUNT_FLAG: u32 = 1 << 16;
    // SAFETY: the register exists; reading it clears the flag, which nobody else looks at.
    unsafe { (*SYST::PTR).csr.read() & COUNT_FLAG != 0 }
}
