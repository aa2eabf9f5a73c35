//! Releases by software: the vectors that tasks borrow, and the waiting of tasks that never end.

use core::{
    future::poll_fn,
    mem,
    task::{Poll, Waker},
};

use leadscrew::tasks::{Platform, Task};

use super::{outputs, pac::Interrupt, trace};

/// Vector of `prepare` and of its timer.
pub(crate) const PREPARE: Interrupt = Interrupt::TIM1_BRK_TIM9;
/// Vector of `inputs` and of its timer.
#[cfg(feature = "emulated")]
pub(super) const INPUTS: Interrupt = Interrupt::TIM1_UP_TIM10;
/// Vector of `segment_start`.
pub(crate) const SEGMENT_START: Interrupt = Interrupt::I2C3_EV;
/// Vector of `wake`, and of the clock of `interpret`.
pub(crate) const WAKE: Interrupt = Interrupt::TIM4;

/// Releases a task.
#[inline]
pub(super) fn pend(task: Task) {
    match task {
        Task::SegmentStart => pend_vector(SEGMENT_START),
        Task::Prepare => pend_vector(PREPARE),
        Task::Wake => rtic::pend(WAKE),
    }
}

/// Releases a task by its vector, and records the time.
#[inline]
pub(super) fn pend_vector(vector: Interrupt) {
    trace::release(vector);
    rtic::pend(vector);
}

/// The platform of every task but `prepare`, which has [`Actuators`](super::Actuators).
pub(crate) struct ChipPlatform;

impl Platform for ChipPlatform {
    #[inline]
    fn pend(&mut self, task: Task) {
        pend(task);
    }

    #[inline]
    fn set_duty(&mut self, duty: u16) {
        outputs::set_duty(duty);
    }
}

/// Waits until `wake` has run.
///
/// No release is lost: `wake` has the same priority, so it runs either before the task has found no
/// work or after the waker is stored.
pub(crate) async fn released(mut waker: impl rtic::Mutex<T = Option<Waker>>) {
    let mut is_woken = false;
    poll_fn(|context| {
        if mem::replace(&mut is_woken, true) {
            return Poll::Ready(());
        }
        waker.lock(|waker| *waker = Some(context.waker().clone()));
        Poll::Pending
    })
    .await;
}
