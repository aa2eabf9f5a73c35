//! A record of each activation of a task, for a debugger to read: built in with the feature `trace`.
//!
//! A task begins with a call of the function that has its name, and what that returns writes the
//! record when the task ends: how long after its release it started, when that was, and how long it
//! took, with everything that preempted it. `cargo xtask latency` takes that out again and compares
//! with the bounds. `docs/latency.md` says what a record costs.
//!
//! Time is the cycle counter's. The emulator has none: with `trace-emulated` it is a timer's.

use core::sync::atomic::{
    AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use cortex_m::peripheral::{DCB, DWT};

use super::{
    inputs,
    pac::Interrupt,
    release::{PREPARE, SEGMENT_START},
};

mod rings;

#[cfg(not(feature = "trace-emulated"))]
use super::step_timer::lateness;

#[cfg(feature = "trace-emulated")]
use super::emulation::{clock as now, lateness};

/// The tasks, by the number of their ring: the highest priority first.
const STEP: usize = 0;
/// What stands in for hardware in the emulator.
#[cfg(feature = "emulated")]
const STAND_IN: usize = 1;
const SERIAL_RX: usize = 2;
const SEGMENT_START_TASK: usize = 3;
const INPUTS: usize = 4;
const PREPARE_TASK: usize = 5;
/// How many there are.
const TASKS: usize = 6;

/// Latency of an activation whose release nobody has seen.
const UNKNOWN: u32 = u32::MAX;
/// Core cycles in a tick of the timer that releases `inputs`.
const CYCLES_PER_INPUT_TICK: u32 = 168;

/// When each task was released by software, with bit 0 set; 0: it has started since.
static RELEASED: [AtomicU32; TASKS] = [const { AtomicU32::new(0) }; TASKS];

/// Lets the cycle counter run.
pub(super) fn init(control: &mut DCB, watch: &mut DWT) {
    control.enable_trace();
    watch.enable_cycle_counter();
}

/// An activation; its record is written when it is dropped, so only `start` makes one.
pub(crate) struct Activation<const TASK: usize> {
    start: u32,
    latency: u32,
}

/// Begins an activation of `step`, which is due at a time of its timer: in the emulator at once.
#[inline]
pub(crate) fn step() -> Activation<STEP> {
    Activation::start(lateness())
}

/// Begins an activation of `serial_rx`, whose latency is unknown.
#[inline]
pub(crate) fn serial_rx() -> Activation<SERIAL_RX> {
    Activation::start(UNKNOWN)
}

/// Begins an activation of `inputs`, whose latency after an edge is unknown.
#[inline]
pub(crate) fn inputs() -> Activation<INPUTS> {
    let age = inputs::timer_age();
    Activation::begin(age.map(|ticks| u32::from(ticks) * CYCLES_PER_INPUT_TICK))
}

/// Begins an activation of `segment_start`.
#[inline]
pub(crate) fn segment_start() -> Activation<SEGMENT_START_TASK> {
    Activation::begin(None)
}

/// Begins an activation of `prepare`.
#[inline]
pub(crate) fn prepare() -> Activation<PREPARE_TASK> {
    Activation::begin(None)
}

/// Begins a run of the handler that stands in for hardware.
#[cfg(feature = "emulated")]
#[inline]
pub(super) fn stand_in() -> Activation<STAND_IN> {
    Activation::begin(None)
}

/// Keeps the time of a release by software, unless an earlier one has not been followed yet.
///
/// To be called right before the release. Whoever is interrupted in between makes the latency seem
/// too long, never too short, and by no more than an earlier release would have made it.
#[inline]
pub(super) fn release(vector: Interrupt) {
    let task = match vector {
        SEGMENT_START => SEGMENT_START_TASK,
        Interrupt::TIM7 => INPUTS,
        PREPARE => PREPARE_TASK,
        _ => return,
    };
    let time = now() | 1;
    if RELEASED[task].load(Relaxed) == 0 {
        RELEASED[task].store(time, Relaxed);
    }
}

impl<const TASK: usize> Activation<TASK> {
    /// Begins, with this latency.
    #[inline]
    fn start(latency: u32) -> Self {
        let start = now();
        // The task begins here, not earlier.
        compiler_fence(SeqCst);
        Self { start, latency }
    }

    /// Begins, with the latency by a timer, or else that of a release by software.
    #[inline]
    fn begin(latency: Option<u32>) -> Self {
        let released = RELEASED[TASK].load(Relaxed);
        RELEASED[TASK].store(0, Relaxed);
        let mut activation = Self::start(UNKNOWN);
        if let Some(latency) = latency {
            activation.latency = latency;
        } else if released != 0 {
            activation.latency = activation.start.wrapping_sub(released);
        }
        activation
    }
}

impl<const TASK: usize> Drop for Activation<TASK> {
    #[inline]
    fn drop(&mut self) {
        compiler_fence(SeqCst);
        let duration = now().wrapping_sub(self.start);
        rings::write::<TASK>([self.start, duration, self.latency]);
    }
}

/// Returns the time, core cycles.
#[cfg(not(feature = "trace-emulated"))]
#[inline]
fn now() -> u32 {
    DWT::cycle_count()
}
