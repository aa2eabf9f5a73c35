//! The outputs of the step interrupt: pins at the times of the step timer.

use leadscrew::stepper::{EventReader, StepCounts, StepEvent, Stepper};

pub(crate) use super::pins::follow;
use super::{outputs, pins, step_timer::StepTimer};

/// What the step interrupt drives, and it alone.
pub(crate) struct StepOutput(StepTimer);

impl StepOutput {
    /// Drives pins and a timer that have been set up.
    pub(super) const fn new(timer: StepTimer) -> Self {
        Self(timer)
    }

    /// Outputs what was set up last time: the first thing to do. Then the timer, which is slow to
    /// reach, is told that its interrupt is being served.
    #[inline]
    pub(crate) fn write(&mut self) {
        pins::write();
        self.0.acknowledge();
    }

    /// Sets up the next event. Whether it is late.
    #[inline]
    pub(crate) fn set_up(&mut self, event: StepEvent) -> bool {
        pins::prepare(event.raise(), event.drop());
        self.0.schedule(event.ticks())
    }

    /// Sets up the first event of a segment, or stops the timer. Whether the event is late.
    ///
    /// Apart from the rest, so that the rest needs few registers and no stack frame.
    #[cold]
    #[inline(never)]
    pub(crate) fn turn(
        &mut self,
        stepper: &mut Stepper,
        events: &mut EventReader<'_>,
        counts: &StepCounts,
    ) -> bool {
        let Some((event, begun)) = stepper.begin_or_stop(events, counts) else {
            pins::prepare(0, 0);
            self.0.stop();
            return false;
        };
        pins::set_directions(begun.directions);
        outputs::set_duty(begun.duty);
        self.set_up(event)
    }
}
