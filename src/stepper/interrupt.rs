//! The body of the step interrupt: plays events.
//!
//! The same instructions for any number of axes: an event holds masks, and nothing is counted here.

use super::{Begun, EventReader, StepCounts, StepEvent};

/// What the step interrupt does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Advance {
    /// Ticks from this event to the next one; `None` stops the timer.
    pub wait: Option<u32>,
    /// Pulses to begin then, bit 0 = X.
    pub raise: u32,
    /// Pulses to end then.
    pub drop: u32,
    /// A segment begins: directions and duty to be set now.
    pub begun: Option<Begun>,
}

impl Advance {
    /// Whether a segment has begun or the queue is empty: `prepare` has to run.
    #[must_use]
    pub const fn releases_prepare(&self) -> bool {
        self.begun.is_some() || self.wait.is_none()
    }
}

/// The step interrupt's own state.
#[derive(Debug)]
pub struct Stepper {
    /// The event queue must not run empty.
    is_moving: bool,
}

impl Stepper {
    /// At rest, with nothing to play.
    #[must_use]
    pub const fn new() -> Self {
        Self { is_moving: false }
    }

    /// Takes the next event, once the pins have been set for the one before.
    ///
    /// Deadline: before the next event is due. A miss delays that event and is counted by the
    /// timer; no step is lost.
    #[inline]
    pub fn advance(&mut self, events: &mut EventReader<'_>, counts: &StepCounts) -> Advance {
        let (event, begun) = if let Some(event) = events.take_within_segment() {
            (Some(event), None)
        } else {
            let turn = self.begin_or_stop(events, counts);
            (turn.map(|turn| turn.0), turn.map(|turn| turn.1))
        };
        let event_or_none = event.unwrap_or_default();
        Advance {
            wait: event.map(StepEvent::ticks),
            raise: event_or_none.raise(),
            drop: event_or_none.drop(),
            begun,
        }
    }

    /// What [`EventReader::take_within_segment`] leaves to be done: takes the first event of the
    /// next segment, and the directions and the duty that have to be output now.
    /// `None` stops the timer: there is no event, or no event may follow.
    #[inline]
    pub fn begin_or_stop(
        &mut self,
        events: &mut EventReader<'_>,
        counts: &StepCounts,
    ) -> Option<(StepEvent, Begun)> {
        let next = if counts.is_cut() { None } else { events.take() };
        let Some(event) = next else {
            counts.stop(self.is_moving);
            return None;
        };
        let begun = counts.begin();
        self.is_moving = begun.is_moving;
        Some((event, begun))
    }
}

impl Default for Stepper {
    fn default() -> Self {
        Self::new()
    }
}
