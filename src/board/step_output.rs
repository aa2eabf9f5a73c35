//! The outputs of the step interrupt: pins at the times of the step timer.

use leadscrew::stepper::{EventReader, EventTap, EventWriter, SegmentRing, StepEvent, Upcoming};

use super::{pins, release::SEGMENT_START, step_timer, step_timer::StepTimer};

/// What the step interrupt drives, and it alone.
pub(crate) struct StepOutput(StepTimer);

#[expect(clippy::unused_self, reason = "whoever has it is the step interrupt")]
impl StepOutput {
    /// Drives pins and a timer that have been set up.
    pub(super) const fn new(timer: StepTimer) -> Self {
        Self(timer)
    }

    /// Outputs what was set up last time: the first thing to do.
    #[inline]
    pub(crate) fn write(&mut self) {
        pins::write();
    }

    /// Tells the timer how long after the event that comes next the one behind it does; if there is
    /// none yet, it will be stopped before. Sets up the next event. When a segment begins with it,
    /// releases `segment_start`: without a branch, so that no event takes longer than another.
    #[inline]
    pub(crate) fn set_up(
        &mut self,
        Upcoming { event, following }: Upcoming,
        events: &mut EventReader<'_>,
    ) {
        let late = self.0.then(following).behind();
        events.count_late(late);
        pins::prepare(event);
        self.0.pend(SEGMENT_START, event);
    }

    /// Sets nothing up: no event will come.
    #[inline]
    pub(crate) fn stop(&mut self, segments: &SegmentRing) {
        segments.stop();
        pins::clear();
        self.0.stop().pend(SEGMENT_START, true);
    }
}

/// Tells the time of an event that came too late for the step interrupt to know of it.
#[inline]
pub(super) fn go_on(events: &mut EventWriter<'_>, segments: &SegmentRing) {
    if let Some(event) = events.appended_late(segments) {
        step_timer::then(event);
        events.append(event);
    }
}

/// Sets up the first event, if there is one, and tells the one behind it. Only while the step
/// interrupt stands.
#[inline]
pub(super) fn set_up(events: &mut EventWriter<'_>) -> Option<StepEvent> {
    let Upcoming { event, following } = events.set_up()?;
    pins::prepare(event);
    step_timer::set_up(event);
    Some(following)
}

/// Starts the step interrupt, or stops it by force: with a lock around it, as more than one task
/// does.
#[expect(unreachable_pub, reason = "RTIC wants what is locked to be public")]
pub struct StepSwitch(());

#[expect(clippy::unused_self, reason = "whoever has it holds the lock")]
impl StepSwitch {
    /// There is one.
    pub(super) const fn new() -> Self {
        Self(())
    }

    /// Starts, when the first event is set up, with the one behind it; but what has been cut meanwhile has to be seen to first.
    #[inline]
    pub(crate) fn start(&mut self, following: StepEvent, segments: &SegmentRing) {
        if !segments.is_halted() {
            segments.start();
            step_timer::start(following);
        }
    }

    /// Stops at once: the event that is set up will not happen.
    #[inline]
    pub(crate) fn halt(&mut self, events: EventTap<'_>, segments: &SegmentRing) {
        step_timer::halt();
        events.halt(segments);
        pins::clear();
    }
}
