//! A record of each activation of a task, for a debugger to read, with the feature `trace`.
//!
//! A task begins with a call of the function of its name. The returned [`Activation`] writes the
//! record when the task ends: start, duration with all preemptions, and latency from the release to
//! the start. `cargo xtask latency` reads the records and compares them with the bounds.
//!
//! # Cost
//!
//! `docs/latency.md` has the cycles of a record. [`rings`] writes it in the same few instructions whatever
//! happens; the fences keep the compiler from moving the task's work out of the measured time.

use core::sync::atomic::{
    AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use cortex_m::peripheral::{DCB, DWT};
use leadscrew::units::CORE_MHZ;

use super::{
    contacts,
    pac::{self, Interrupt},
    trace_clock::{lateness, now},
    vectors::{PREPARE, SEGMENT_START},
};

mod rings;

/// The number of each task's ring, the highest priority first; ring 1 is of a handler that stands in for hardware.
const STEP: usize = 0;
const SERIAL_RX: usize = 2;
const SEGMENT_START_TASK: usize = 3;
const INPUTS: usize = 4;
const PREPARE_TASK: usize = 5;
/// The number of rings.
const TASKS: usize = 6;

/// Latency of an activation whose release is not known.
const UNKNOWN: u32 = u32::MAX;
/// Core cycles in a microsecond.
const CYCLES_PER_US: u32 = CORE_MHZ;

/// Time of each task's release by software, with bit 0 set; 0 once the task has started.
static RELEASED: [AtomicU32; TASKS] = [const { AtomicU32::new(0) }; TASKS];

/// Starts the cycle counter. It counts, and a debugger reads memory, also while the processor sleeps.
pub(super) fn init(control: &mut DCB, watch: &mut DWT, debug: &pac::DBGMCU) {
    debug.cr().modify(|_, w| w.dbg_sleep().set_bit());
    control.enable_trace();
    watch.enable_cycle_counter();
}

/// An activation, which writes its record when it is dropped.
pub(crate) struct Activation<const TASK: usize> {
    start: u32,
    latency: u32,
}

/// Begins an activation of `step`, whose latency is the time since the event was due.
pub(crate) fn step() -> Activation<STEP> {
    Activation::start(lateness())
}

/// Begins an activation of `serial_rx`, whose latency is unknown.
#[cfg(not(feature = "usb"))]
pub(crate) fn serial_rx() -> Activation<SERIAL_RX> {
    Activation::start(UNKNOWN)
}

/// Begins an activation of `usb`, whose latency is unknown.
#[cfg(feature = "usb")]
pub(crate) fn usb() -> Activation<SERIAL_RX> {
    Activation::start(UNKNOWN)
}

/// Begins an activation of `inputs`, whose latency after an edge is unknown.
pub(crate) fn inputs() -> Activation<INPUTS> {
    let age_us = contacts::timer_release_age_us();
    Activation::begin(age_us.map(|age_us| u32::from(age_us) * CYCLES_PER_US))
}

/// Begins an activation of `segment_start`.
pub(crate) fn segment_start() -> Activation<SEGMENT_START_TASK> {
    Activation::begin(None)
}

/// Begins an activation of `prepare`.
pub(crate) fn prepare() -> Activation<PREPARE_TASK> {
    Activation::begin(None)
}

/// Records the time of a release by software, unless the task has not started since an earlier one.
///
/// For the caller right before the release. An interrupt in between makes the recorded latency too
/// long, never too short, and by no more than an earlier release would have made it.
pub(super) fn release(vector: Interrupt) {
    let task = match vector {
        SEGMENT_START => SEGMENT_START_TASK,
        Interrupt::TIM1_UP_TIM10 => INPUTS,
        PREPARE => PREPARE_TASK,
        _ => return,
    };
    let time = now() | 1;
    if RELEASED[task].load(Relaxed) == 0 {
        RELEASED[task].store(time, Relaxed);
    }
}

impl<const TASK: usize> Activation<TASK> {
    /// Begins an activation with a latency.
    fn start(latency: u32) -> Self {
        let start = now();
        compiler_fence(SeqCst);
        Self { start, latency }
    }

    /// Begins an activation with the latency since a timer's release, or else since one by software.
    pub(super) fn begin(latency: Option<u32>) -> Self {
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
    fn drop(&mut self) {
        compiler_fence(SeqCst);
        let duration = now().wrapping_sub(self.start);
        rings::write::<TASK>([self.start, duration, self.latency]);
    }
}
