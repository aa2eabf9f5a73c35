//! The outputs of the step interrupt: pins at the times of the step timer.
//!
//! # Cost
//!
//! Everything is inlined into the calling task; the step interrupt releases `segment_start` by a write that does
//! nothing for most events, instead of by a branch.

use leadscrew::{
    stepper::{EventTap, SegmentRing, StepEvent, Upcoming},
    tasks::{StepOutput, StepPlatform},
};

use super::{
    pins,
    step_timer::{self, StepTimer},
    vectors::SEGMENT_START,
};

/// The pins and the timer of the step interrupt, which alone drives them.
pub(crate) struct StepPins(StepTimer);

impl StepPins {
    /// Joins the timer with the pins, which have been set up.
    pub(super) const fn new(timer: StepTimer) -> Self {
        Self(timer)
    }
}

impl StepPlatform for StepPins {
    fn output(&mut self) {
        pins::write();
    }

    fn set_reload(&mut self, following: StepEvent) -> u32 {
        self.0.set_reload(following).is_late()
    }

    fn set_up(&mut self, event: StepEvent) {
        pins::set_next(event);
    }

    fn pend_segment_start(&mut self, event: StepEvent) {
        self.0.pend(SEGMENT_START, event);
    }

    fn stop(&mut self) {
        pins::clear_next();
        self.0.stop().pend(SEGMENT_START, true);
    }
}

/// Token of the right to start the step timer and to halt it: a task that does so holds RTIC's lock
/// of the token.
#[expect(unreachable_pub, reason = "RTIC wants what is locked to be public")]
pub struct StepTimerToken(());

impl StepTimerToken {
    /// Returns the token; `init` alone calls this.
    pub(super) const fn new() -> Self {
        Self(())
    }
}

/// The step interrupt for the tasks of lower priority: the token of its timer, and the count of events output.
pub(crate) struct StepInterrupt<M> {
    pub(crate) token: M,
    pub(crate) event_tap: EventTap<'static>,
}

impl<M: rtic::Mutex<T = StepTimerToken>> StepOutput for StepInterrupt<M> {
    fn start(&mut self, first: Upcoming, segments: &SegmentRing) {
        pins::set_next(first.event);
        step_timer::set_up(first.event);
        self.token.lock(|_| {
            // Another run of `prepare` handles a motion that has been halted meanwhile.
            if !segments.is_halted() {
                segments.start();
                step_timer::start(first.following);
            }
        });
    }

    fn stop(&mut self, segments: &SegmentRing) {
        let event_tap = self.event_tap;
        self.token.lock(|_| {
            step_timer::halt();
            event_tap.halt(segments);
            pins::clear_next();
        });
    }

    fn append(&mut self, event: StepEvent) {
        step_timer::set_reload(event);
    }

    fn event_tap(&self) -> EventTap<'_> {
        self.event_tap
    }
}
