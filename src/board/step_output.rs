//! The outputs of the step interrupt: pins at the times of the step timer.

use leadscrew::{
    stepper::{EventTap, SegmentRing, StepEvent, Upcoming},
    tasks::{StepOutput, StepPlatform},
};

use super::{pins, release::SEGMENT_START, step_timer, step_timer::StepTimer};

/// What the step interrupt drives, and it alone.
pub(crate) struct StepPins(StepTimer);

impl StepPins {
    /// Drives pins and a timer that have been set up.
    pub(super) const fn new(timer: StepTimer) -> Self {
        Self(timer)
    }
}

impl StepPlatform for StepPins {
    #[inline]
    fn output(&mut self) {
        pins::write();
    }

    #[inline]
    fn set_reload(&mut self, following: StepEvent) -> u32 {
        self.0.set_reload(following).is_late()
    }

    #[inline]
    fn set_up(&mut self, event: StepEvent) {
        pins::prepare(event);
    }

    #[inline]
    fn pend_segment_start(&mut self, event: StepEvent) {
        self.0.pend(SEGMENT_START, event);
    }

    #[inline]
    fn stop(&mut self) {
        pins::clear();
        self.0.stop().pend(SEGMENT_START, true);
    }
}

/// Starts the step interrupt, or stops it by force: with a lock around it, as more than one task
/// does.
#[expect(unreachable_pub, reason = "RTIC wants what is locked to be public")]
pub struct StepSwitch(());

impl StepSwitch {
    /// There is one.
    pub(super) const fn new() -> Self {
        Self(())
    }
}

/// The step interrupt, for the tasks below it: its switch under a lock, and what it has played.
pub(crate) struct StepInterrupt<M> {
    pub(crate) switch: M,
    pub(crate) played: EventTap<'static>,
}

impl<M: rtic::Mutex<T = StepSwitch>> StepOutput for StepInterrupt<M> {
    #[inline]
    fn start(&mut self, first: Upcoming, segments: &SegmentRing) {
        pins::prepare(first.event);
        step_timer::set_up(first.event);
        self.switch.lock(|_| {
            // A motion that has been halted meanwhile is for another run of `prepare`.
            if !segments.is_halted() {
                segments.start();
                step_timer::start(first.following);
            }
        });
    }

    #[inline]
    fn stop(&mut self, segments: &SegmentRing) {
        let played = self.played;
        self.switch.lock(|_| {
            step_timer::halt();
            played.halt(segments);
            pins::clear();
        });
    }

    #[inline]
    fn append(&mut self, event: StepEvent) {
        step_timer::set_reload(event);
    }

    #[inline]
    fn played(&self) -> EventTap<'_> {
        self.played
    }
}
