//! The body of the `inputs` interrupt: watches switches, probe and buttons.
//!
//! Runs when any input changes, and [`SAMPLE_TICKS`](super::SAMPLE_TICKS) after a run that asked
//! for a sample. Every input passes the filter, but for the probe while its change is awaited: the
//! first edge gives the position.

use super::{Filter, Inputs};
use crate::{
    model::{Levels, Requests},
    stepper::EventTap,
};

/// What a sample asks of the interrupt's shell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Watched {
    /// Take another sample [`SAMPLE_TICKS`](super::SAMPLE_TICKS) after this one.
    pub sample_again: bool,
    /// Release `prepare`.
    pub release_prepare: bool,
    /// Stop the step interrupt at once, and call [`EventTap::halt`].
    pub halt_steps: bool,
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

    /// Latches the positions of the probe and of limit switches at the beginning of each run, with
    /// the contacts that are closed now. A limit switch counts once the filter agrees. Returns whether
    /// the awaited change of the probe has come, so that `prepare` is to be released.
    ///
    /// Deadline: the probe's position is that of the run, so one step time where it matters; a miss
    /// gives a position that is as much too late.
    #[inline]
    pub fn latch(&mut self, raw: Levels, inputs: &Inputs, events: EventTap<'_>) -> bool {
        let output = events.output_count();
        let is_contact = inputs.is_contact(raw);
        if is_contact {
            inputs.latch_probe(output);
        }
        let reached = (raw ^ self.raw) & (raw ^ inputs.inverted());
        inputs.latch_limits(reached, output);
        self.raw = raw;
        is_contact
    }

    /// Acts on an input that has changed. Returns whether samples are needed, the first
    /// [`SAMPLE_TICKS`](super::SAMPLE_TICKS) from now if none is due.
    #[inline]
    pub fn edge(&mut self) -> bool {
        self.filter.change(self.raw)
    }

    /// Takes a sample that is due.
    #[inline]
    pub fn sample(&mut self, inputs: &Inputs, requests: &Requests) -> Watched {
        let changed = self.filter.sample(self.raw);
        let closed = self.filter.stable();
        inputs.set_closed(closed);
        requests.press(changed & closed);
        let limits = changed & (closed ^ inputs.inverted());
        Watched {
            sample_again: self.filter.change(self.raw),
            release_prepare: changed != Levels::NONE,
            halt_steps: limits.has(inputs.armed_limits()),
        }
    }
}
