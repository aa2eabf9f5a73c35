//! A board of QEMU: its netduinoplus2, with a stand-in for the hardware that it lacks. The feature `qemu` builds the
//! firmware for it, and the files of this folder take the places of those of the chip with their names.
//!
//! QEMU's netduinoplus2 has no clocks, no GPIO and no basic timers, and its SysTick is no clock
//! for a hundred thousand events a second. So the step timer does not count there: the handler of a
//! vector that the machine does not use, TIM2's, stands in for it. A run of the handler advances
//! the time to the next event, reads the time of the event after that from the reload register, and
//! pends the step interrupt, which preempts the handler at once. The handler runs when no task has
//! work, so that time passes as fast as the emulator executes the events, and no event is late
//! because the host was busy; and each millisecond, by TIM2 itself, so that steps also preempt
//! tasks. The firmware's tasks run unchanged.
//!
//! In place of the pins, the handler records the outputs in memory, which a tool reads
//! (`memory::FIGURES`), and reads the contacts from memory, which a test writes
//! (`memory::CONTACTS`). The timer that samples the contacts follows the clock of the events in
//! motion; at rest the runs of the handler count the milliseconds, and always for `prepare`'s delay.

use core::sync::atomic::{
    AtomicBool, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use cortex_m::peripheral::{NVIC, SCB, SYST};
use leadscrew::units::TICKS_PER_MS;

#[cfg(feature = "trace")]
use super::trace::Activation;
use super::{
    pac,
    release::pend_vector,
    step_timer,
    vectors::{PREPARE, nvic_priority},
};

pub(super) mod memory;

/// The vector whose handler stands in for the step timer.
const STAND_IN: pac::Interrupt = pac::Interrupt::TIM2;
/// Vector of `inputs`.
const INPUTS: pac::Interrupt = pac::Interrupt::TIM1_UP_TIM10;
/// Period of TIM2, which runs the handler also while tasks have work: 1 ms of the emulated timer, ns.
const PREEMPTION_NS: u32 = 1_000_000;

/// The ring of the handler's records in `trace`.
#[cfg(feature = "trace")]
const RING: usize = 1;
/// Core cycles in a tick: the step timer counts half ticks.
const CYCLES_PER_TICK: u32 = 2;

/// The time, and the time of the next event, ticks.
static NOW: AtomicU32 = AtomicU32::new(0);
static DUE: AtomicU32 = AtomicU32::new(0);

/// Events that the handler may play before `idle` runs again: two, one of them by TIM2.
///
/// On a busy host TIM2 may run the handler many times while a task makes no progress: time then
/// waits.
static RUNS_LEFT: AtomicU32 = AtomicU32::new(0);
/// Greatest time to an event that preempts tasks, ticks: their deadlines are longer, so time waits for them.
const PREEMPTING_TICKS: u32 = TICKS_PER_MS / 2;

/// Milliseconds left of the delay of `prepare`, 0 without one, and whether it has ended.
static DELAY_MS: AtomicU32 = AtomicU32::new(0);
static IS_DELAY_OVER: AtomicBool = AtomicBool::new(false);

/// Ticks between two samples of the contacts, 0 without samples; whether that period has just been
/// set; when the next sample is due; and whether `inputs` was released for one.
static SAMPLE_TICKS: AtomicU32 = AtomicU32::new(0);
static IS_SAMPLING_NEW: AtomicBool = AtomicBool::new(false);
static SAMPLE_DUE: AtomicU32 = AtomicU32::new(0);
static IS_SAMPLE: AtomicBool = AtomicBool::new(false);
/// Whether a millisecond has passed since `idle` looked; more are not counted, as on a chip.
static HAS_MILLISECOND_PASSED: AtomicBool = AtomicBool::new(false);

/// Reads the contacts for the first time, and starts TIM2.
#[expect(unsafe_code, reason = "a timer that nobody owns")]
pub(super) fn start() {
    /// Between 5 and 4 of RTIC: the emulator keeps all eight bits of a priority.
    const BETWEEN: u8 = u8::midpoint(nvic_priority(5), nvic_priority(4));
    let _ = memory::have_contacts_changed();
    // SAFETY: the handler, which does not run yet, alone uses the timer.
    let timer = unsafe { &*pac::TIM2::ptr() };
    // The counter is not cleared: the emulator would add what it was set back by to each period.
    timer.dier().write(|w| w.uie().set_bit());
    timer.cr1().write(|w| w.cen().set_bit());
    timer.arr().write(|w| w.arr().set(PREEMPTION_NS));
    unmask(STAND_IN, BETWEEN);
}

/// Gives a vector that RTIC does not manage a priority, and unmasks it.
#[expect(unsafe_code, reason = "vectors that RTIC does not manage")]
pub(super) fn unmask(vector: pac::Interrupt, priority: u8) {
    // SAFETY: RTIC keeps interrupts off until `init` has returned, and the handlers share nothing
    // under a lock.
    unsafe {
        cortex_m::Peripherals::steal()
            .NVIC
            .set_priority(vector, priority);
        NVIC::unmask(vector);
    }
}

/// Sets the time from now to the next event, ticks.
pub(super) fn count(ticks: u32) {
    DUE.store(NOW.load(Relaxed).wrapping_add(ticks), Relaxed);
}

/// Returns the time, ticks.
pub(super) fn now_ticks() -> u32 {
    NOW.load(Relaxed)
}

/// Returns the time of the next event, ticks.
fn due() -> u32 {
    DUE.load(Relaxed)
}

/// Lets time pass while no task has work.
pub(crate) fn sleep() {
    if step_timer::is_running() {
        RUNS_LEFT.store(2, Relaxed);
        NVIC::pend(STAND_IN);
    } else {
        cortex_m::asm::wfi();
    }
}

/// Begins a delay of `prepare`.
pub(super) fn start_delay(delay_ms: u16) {
    IS_DELAY_OVER.store(false, Relaxed);
    DELAY_MS.store(delay_ms.into(), Relaxed);
}

/// Takes the end of the delay of `prepare`.
pub(super) fn take_delay_end() -> bool {
    IS_DELAY_OVER.swap(false, Relaxed)
}

/// Sets the time between two samples of the contacts; 0: no samples.
pub(super) fn sample_every(ticks: u32) {
    SAMPLE_TICKS.store(ticks, Relaxed);
    IS_SAMPLING_NEW.store(true, Relaxed);
}

/// Takes the release of `inputs` for a sample.
pub(super) fn take_sample_release() -> bool {
    IS_SAMPLE.swap(false, Relaxed)
}

#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a vector that RTIC does not manage")]
extern "C" fn TIM2() {
    #[cfg(feature = "trace")]
    let _activation = Activation::<RING>::begin(None);
    if take_overflow() {
        count_millisecond();
    }
    // No time has passed since the period was set.
    if IS_SAMPLING_NEW.swap(false, Relaxed) {
        let ticks = SAMPLE_TICKS.load(Relaxed);
        SAMPLE_DUE.store(NOW.load(Relaxed).wrapping_add(ticks), Relaxed);
    }
    if memory::have_contacts_changed() {
        pend_vector(INPUTS);
    } else if !step_timer::is_running() {
        if SAMPLE_TICKS.load(Relaxed) != 0 {
            release_for_sample();
        }
    } else if is_sample_first() {
        release_for_sample();
    } else {
        play();
    }
}

/// Plays the next event, unless time waits.
fn play() {
    let runs_left = RUNS_LEFT.load(Relaxed);
    let is_near = due().wrapping_sub(NOW.load(Relaxed)) <= PREEMPTING_TICKS;
    if runs_left == 2 || runs_left == 1 && is_near {
        RUNS_LEFT.store(runs_left - 1, Relaxed);
        memory::record(due());
        NOW.store(due(), Relaxed);
        // As a counter at zero does, takes what is in the reload register before the step interrupt
        // writes it.
        count((SYST::get_reload() + 1) / CYCLES_PER_TICK);
        compiler_fence(SeqCst);
        SCB::set_pendst();
    }
}

/// Returns whether a millisecond has passed since the last call; for `idle` alone.
pub(super) fn take_millisecond() -> bool {
    HAS_MILLISECOND_PASSED.swap(false, Relaxed)
}

/// Counts a millisecond, and that of the delay of `prepare`.
fn count_millisecond() {
    HAS_MILLISECOND_PASSED.store(true, Relaxed);
    let left = DELAY_MS.load(Relaxed);
    if left != 0 {
        DELAY_MS.store(left - 1, Relaxed);
        if left == 1 {
            IS_DELAY_OVER.store(true, Relaxed);
            pend_vector(PREPARE);
        }
    }
}

/// Returns whether a sample is due before the next event.
fn is_sample_first() -> bool {
    let ahead = due().wrapping_sub(SAMPLE_DUE.load(Relaxed));
    SAMPLE_TICKS.load(Relaxed) != 0 && ahead.cast_signed() >= 0
}

/// Advances the time to the next sample, and releases `inputs` for it.
fn release_for_sample() {
    let due = SAMPLE_DUE.load(Relaxed);
    NOW.store(due, Relaxed);
    SAMPLE_DUE.store(due.wrapping_add(SAMPLE_TICKS.load(Relaxed)), Relaxed);
    IS_SAMPLE.store(true, Relaxed);
    pend_vector(INPUTS);
}

/// Takes an overflow of TIM2: returns whether a millisecond has passed since the last call.
#[expect(unsafe_code, reason = "nobody can hand the timer to a handler")]
fn take_overflow() -> bool {
    // SAFETY: the handler alone uses the timer.
    let timer = unsafe { &*pac::TIM2::ptr() };
    let is_over = timer.sr().read().uif().bit_is_set();
    if is_over {
        timer.sr().write(|w| w.uif().clear_bit());
    }
    is_over
}
