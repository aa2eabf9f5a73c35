//! The body of the `inputs` interrupt: watches switches, probe and buttons.
//!
//! Runs when any input changes, and [`SAMPLE_TICKS`](super::SAMPLE_TICKS) after a run that asked
//! for it. Every input passes the filter, but for the probe while it is waited for: its first edge
//! tells the position.

use super::{Filter, Inputs, Levels};
use crate::{
    protocol::realtime::{Button, Requests},
    stepper::{EventTap, StepCounts},
};

/// Why the interrupt runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// An input has changed.
    Edge,
    /// A sample is due.
    Sample,
}

/// What the interrupt asks of its shell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Watched {
    /// Run again as [`Cause::Sample`], [`SAMPLE_TICKS`](super::SAMPLE_TICKS) after the last sample,
    /// or from now when none is due.
    pub sample: bool,
    /// Release `prepare`.
    pub prepare: bool,
}

/// The interrupt's own state.
#[derive(Debug)]
pub struct Watch {
    filter: Filter,
    /// The contacts that were closed in the last run.
    raw: Levels,
}

impl Watch {
    /// Begins with the contacts that are closed at power-up: none of them counts as pressed then.
    #[must_use]
    pub fn new(closed: Levels, inputs: &Inputs) -> Self {
        inputs.set_closed(closed);
        Self {
            filter: Filter::new(closed),
            raw: closed,
        }
    }

    /// One run, with the contacts that are closed now.
    ///
    /// Deadline: the probe's position is that of the run, so one step time where it matters; a miss
    /// tells a position that is as much too late.
    pub fn run(
        &mut self,
        cause: Cause,
        raw: Levels,
        inputs: &Inputs,
        requests: &Requests,
        counts: &StepCounts,
        events: &EventTap<'_>,
    ) -> Watched {
        let is_contact = inputs.is_contact(raw);
        if is_contact {
            inputs.latch(events.output(counts));
        }
        // Where a limit switch was reached is where it changed, and counts once the filter agrees.
        let reached = (raw ^ self.raw) & (raw ^ inputs.inverted());
        inputs.reach(reached, events.output(counts));
        self.raw = raw;
        let changed = match cause {
            Cause::Edge => Levels::NONE,
            Cause::Sample => self.filter.sample(raw),
        };
        if changed != Levels::NONE {
            let closed = self.filter.stable();
            inputs.set_closed(closed);
            press(changed & closed, requests);
            let limits = changed & (closed ^ inputs.inverted());
            if limits.has(inputs.guarded()) {
                events.cut(counts);
            }
        }
        Watched {
            sample: self.filter.change(raw),
            prepare: is_contact || changed != Levels::NONE,
        }
    }
}

/// Presses the buttons whose contact has just closed.
fn press(closed: Levels, requests: &Requests) {
    // wcet-bound: 4
    for (input, button) in [
        (Levels::HOLD, Button::Hold),
        (Levels::RESET, Button::Reset),
        (Levels::START, Button::Start),
        (Levels::DOOR, Button::Door),
    ] {
        if closed.has(input) {
            requests.press(button);
        }
    }
}
