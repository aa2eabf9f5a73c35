//! Releases by software: the vectors that tasks borrow, and the waiting of tasks that never end.
//!
//! # Cost
//!
//! A received byte releases by one store without a branch: `serial_rx` is smaller by four lines of flash.
//! [`end_round`] is a function of its own. Inlined into `idle`, the address of the register would be kept over all
//! rounds, and the proof would not know it.

use core::{
    future::poll_fn,
    mem,
    sync::atomic::{AtomicBool, Ordering::Relaxed},
    task::{Poll, Waker},
};

use cortex_m::peripheral::NVIC;
use leadscrew::{
    model::Release,
    tasks::{Platform, Task},
};

use super::{
    motion_clock, outputs,
    pac::Interrupt,
    trace,
    vectors::{PREPARE, SEGMENT_START, WAKE},
};

/// Releases a task.
pub(super) fn pend(task: Task) {
    match task {
        Task::SegmentStart => pend_vector(SEGMENT_START),
        Task::Prepare => pend_vector(PREPARE),
        Task::Wake => rtic::pend(WAKE),
    }
}

/// Releases a task by its vector, and records the time.
pub(super) fn pend_vector(vector: Interrupt) {
    trace::release(vector);
    rtic::pend(vector);
}

/// The platform of every task but `prepare`, which has [`Actuators`](super::Actuators).
pub(crate) struct ChipPlatform;

impl Platform for ChipPlatform {
    fn pend(&mut self, task: Task) {
        pend(task);
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "nothing in flash may be called")]
    #[expect(unsafe_code, reason = "two vectors of one register")]
    fn release(&mut self, release: Release) {
        const { assert!(PREPARE as u16 / 32 == 0 && WAKE as u16 / 32 == 0) };
        let mask = match release {
            Release::Nobody => return,
            Release::Interpret | Release::Report => 1 << WAKE as u16,
            Release::Prepare => {
                trace::release(PREPARE);
                1 << PREPARE as u16
            }
        };
        // SAFETY: a write of 1 sets a bit, a write of 0 changes nothing (PM0214 4.3.4).
        unsafe { (*NVIC::PTR).ispr[0].write(mask) };
    }

    fn now_ticks(&self) -> u32 {
        motion_clock::now_ticks()
    }

    fn set_duty(&mut self, duty: u16) {
        outputs::set_duty(duty);
    }
}

/// Whether `interpret` has more to do, and waits for `idle` before it goes on.
static AWAITS_IDLE: AtomicBool = AtomicBool::new(false);

/// Lets `interpret` wait for `idle`, which feeds the watchdog: however many lines wait, it comes round between two
/// runs.
pub(crate) fn await_idle() {
    AWAITS_IDLE.store(true, Relaxed);
}

/// Returns whether `interpret` waits for `idle`.
pub(crate) fn awaits_idle() -> bool {
    AWAITS_IDLE.load(Relaxed)
}

/// Releases `interpret` if it waits for `idle`; for `idle` alone.
#[inline(never)]
pub(crate) fn end_round() {
    if awaits_idle() {
        AWAITS_IDLE.store(false, Relaxed);
        rtic::pend(WAKE);
    }
}

/// Waits until `wake` has run and the task may go on.
///
/// No release is lost: `wake` has the same priority, so it runs either before the task has found no
/// work or after the waker is stored. `may_go_on` is asked at each wake: woken before it may go on, the task waits again, and `end_round`
/// wakes it once `idle` has come round.
pub(crate) async fn released(
    mut waker: impl rtic::Mutex<T = Option<Waker>>,
    may_go_on: impl Fn() -> bool,
) {
    let mut is_woken = false;
    poll_fn(|context| {
        if mem::replace(&mut is_woken, true) && may_go_on() {
            return Poll::Ready(());
        }
        waker.lock(|waker| *waker = Some(context.waker().clone()));
        Poll::Pending
    })
    .await;
}
