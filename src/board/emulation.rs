//! What the emulator leaves out, and what it is asked for.
//!
//! QEMU 7.2's netduinoplus2 has no RCC, no GPIO and no basic timers, and its SysTick is no clock for
//! a hundred thousand events a second. So the step timer does not count there: the handler of a vector
//! that the machine does not use, TIM2's, stands in for it. It lets the time of the event that is set
//! up come, takes the time of the event after it from the reload register, and pends the step
//! interrupt, which preempts it at once. The handler runs when no task has anything to do, so that
//! time passes as fast as the emulator gets through the events and no event is ever late because the
//! host was busy; and each millisecond, by TIM2 itself, so that steps also preempt tasks. The
//! firmware's tasks run unchanged.
//!
//! As the handler stands where the hardware would, it also keeps the record of what the pins do,
//! which a tool reads from memory: [`FIGURES`]. The contacts it takes from memory: [`CONTACTS`].
//! Of the other timers, the one that samples contacts follows the events' clock in motion; at
//! rest, and for `prepare`'s, the handler's own runs count the milliseconds.

use core::sync::atomic::{
    AtomicBool, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use cortex_m::peripheral::{NVIC, SCB};

use super::{
    pac,
    release::{INPUTS, PREPARE, pend_vector},
    step_timer, trace,
};

mod flash;
mod memory;

pub(super) use flash::{erase_flash, read_flash, write_flash};
pub(super) use memory::{contacts, switched};

/// The vector whose handler stands in for the step timer.
const STAND_IN: pac::Interrupt = pac::Interrupt::TIM2;
/// Time between two runs of the handler without being asked: 1 ms of the emulated timer, ns.
const PREEMPTION_NS: u32 = 1_000_000;

/// The time, ticks, and when the event is due that is set up.
static NOW: AtomicU32 = AtomicU32::new(0);
static DUE: AtomicU32 = AtomicU32::new(0);

/// Whether the firmware runs in the emulator.
static IS_EMULATED: AtomicBool = AtomicBool::new(false);

/// Runs of the handler until tasks must have come to an end: one when they have, one before.
///
/// A host that is busy may let many runs fall due while a task gets nowhere; then time must wait.
static RUNS_LEFT: AtomicU32 = AtomicU32::new(0);

/// Milliseconds until `prepare` is released, or 0, and whether that time is over.
static WAKE_MS: AtomicU32 = AtomicU32::new(0);
static IS_WAKE: AtomicBool = AtomicBool::new(false);

/// Ticks between two samples of the contacts, whether these are new, when the next sample is due, and
/// whether one has been. 0 ticks: no samples.
static SAMPLE_TICKS: AtomicU32 = AtomicU32::new(0);
static IS_SAMPLING_NEW: AtomicBool = AtomicBool::new(false);
static SAMPLE_DUE: AtomicU32 = AtomicU32::new(0);
static IS_SAMPLE: AtomicBool = AtomicBool::new(false);

/// Returns whether the firmware runs in the emulator.
pub(super) fn is_emulated() -> bool {
    IS_EMULATED.load(Relaxed)
}

/// Finds out where the firmware runs: no chip has all clocks off.
pub(super) fn detect(rcc: &pac::RCC) -> bool {
    let is_emulated = rcc.cr().read().bits() == 0;
    IS_EMULATED.store(is_emulated, Relaxed);
    is_emulated
}

/// The time, ns: the emulator has no cycle counter, and this timer of it counts its virtual time.
#[cfg(feature = "trace-emulated")]
#[inline]
#[expect(unsafe_code, reason = "a timer that nobody owns")]
pub(super) fn clock() -> u32 {
    // SAFETY: reads a register without side effects.
    unsafe { (*pac::TIM5::ptr()).cnt().read().cnt().bits() }
}

/// Returns how late an event is: none ever is.
#[cfg(feature = "trace-emulated")]
pub(super) const fn lateness() -> u32 {
    0
}

/// Reads the contacts for the first time, and prepares the handler, one level below the step
/// interrupt and above all others.
#[expect(unsafe_code, reason = "a vector that RTIC does not manage")]
pub(super) fn init(timer: &pac::TIM2, nvic: &mut NVIC) {
    /// The step interrupt's level is 0xB0, the next task's 0xC0; the emulator keeps all eight bits.
    const BETWEEN: u8 = 0xB8;
    let _ = memory::have_contacts_changed();
    // Its counter must stay as it is: the emulator adds what it has been set back by to each period.
    timer.dier().write(|w| w.uie().set_bit());
    timer.cr1().write(|w| w.cen().set_bit());
    timer.arr().write(|w| w.arr().set(PREEMPTION_NS));
    // SAFETY: RTIC keeps interrupts off until `init` has returned, and the handler shares nothing
    // under a lock.
    unsafe {
        nvic.set_priority(STAND_IN, BETWEEN);
        NVIC::unmask(STAND_IN);
    }
}

/// Sets the time to the first event, ticks.
pub(super) fn count(ticks: u32) {
    DUE.store(NOW.load(Relaxed).wrapping_add(ticks), Relaxed);
}

/// Returns when the event is due that is set up.
fn due() -> u32 {
    DUE.load(Relaxed)
}

/// Lets time pass: for when no task has anything to do.
pub(super) fn idle() {
    if step_timer::is_running() {
        RUNS_LEFT.store(2, Relaxed);
        NVIC::pend(STAND_IN);
    } else {
        cortex_m::asm::wfi();
    }
}

/// Releases `prepare` after some milliseconds.
pub(super) fn wake_in(milliseconds: u16) {
    IS_WAKE.store(false, Relaxed);
    WAKE_MS.store(milliseconds.into(), Relaxed);
}

/// Returns once whether the time of `prepare` is over.
pub(super) fn take_wake() -> bool {
    let is_over = IS_WAKE.load(Relaxed);
    IS_WAKE.store(false, Relaxed);
    is_over
}

/// Sets the time between two samples of the contacts; 0: no samples.
pub(super) fn sample_every(ticks: u32) {
    SAMPLE_TICKS.store(ticks, Relaxed);
    IS_SAMPLING_NEW.store(true, Relaxed);
}

/// Returns whether `inputs` was released to take a sample.
pub(super) fn is_sample() -> bool {
    let is_sample = IS_SAMPLE.load(Relaxed);
    IS_SAMPLE.store(false, Relaxed);
    is_sample
}

#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a vector that RTIC does not manage")]
extern "C" fn TIM2() {
    let _activation = trace::stand_in();
    if has_counted() {
        count_millisecond();
    }
    memory::record_duty();
    // No time has passed since then.
    if IS_SAMPLING_NEW.load(Relaxed) {
        IS_SAMPLING_NEW.store(false, Relaxed);
        let ticks = SAMPLE_TICKS.load(Relaxed);
        SAMPLE_DUE.store(NOW.load(Relaxed).wrapping_add(ticks), Relaxed);
    }
    if memory::have_contacts_changed() {
        pend_vector(INPUTS);
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
        memory::record(due());
        NOW.store(due(), Relaxed);
        // The counter begins again with that; what the step interrupt writes is for the next time.
        count(step_timer::reload_ticks());
        compiler_fence(SeqCst);
        SCB::set_pendst();
    }
}

fn count_millisecond() {
    let left = WAKE_MS.load(Relaxed);
    if left != 0 {
        WAKE_MS.store(left - 1, Relaxed);
        if left == 1 {
            IS_WAKE.store(true, Relaxed);
            pend_vector(PREPARE);
        }
    }
}

/// Returns whether a sample is due before the next event.
fn is_sample_first() -> bool {
    let ahead = due().wrapping_sub(SAMPLE_DUE.load(Relaxed));
    SAMPLE_TICKS.load(Relaxed) != 0 && ahead.cast_signed() >= 0
}

/// Lets the time of a sample come.
fn take_sample() {
    let due = SAMPLE_DUE.load(Relaxed);
    NOW.store(due, Relaxed);
    SAMPLE_DUE.store(due.wrapping_add(SAMPLE_TICKS.load(Relaxed)), Relaxed);
    IS_SAMPLE.store(true, Relaxed);
    pend_vector(INPUTS);
}

/// Returns whether a millisecond has passed since this was asked last.
#[expect(unsafe_code, reason = "nobody can hand the timer to a handler")]
fn has_counted() -> bool {
    // SAFETY: the handler alone uses the timer.
    let timer = unsafe { &*pac::TIM2::ptr() };
    let is_over = timer.sr().read().uif().bit_is_set();
    if is_over {
        timer.sr().write(|w| w.uif().clear_bit());
    }
    is_over
}
