//! The watch of `inputs` over switches, probe and buttons.
//!
//! `inputs` runs when any input changes, and [`SAMPLE_TICKS`](super::SAMPLE_TICKS) after a run that
//! needs a sample. Every input passes the filter. The awaited change of the probe and the edges of
//! limit switches are also latched at once: their first edge gives the position. The filter confirms both.

use super::{Filter, Inputs, SAMPLES};
use crate::{
    model::{Levels, Requests},
    stepper::EventTap,
};

/// The actions that a sample requires.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SampleActions {
    /// Take another sample [`SAMPLE_TICKS`](super::SAMPLE_TICKS) after this one.
    pub sample_again: bool,
    /// Release `prepare`.
    pub release_prepare: bool,
    /// Stop the step interrupt at once, and call [`EventTap::halt`].
    pub halt_steps: bool,
}

/// The state of `inputs`.
#[derive(Debug)]
pub struct Watch {
    filter: Filter,
    /// The contacts that were closed in the last run.
    raw: Levels,
    /// Samples in a row without the contact of the probe that has been latched.
    absent: u32,
}

impl Watch {
    /// Returns a watch that begins with the contacts closed at power-up: none of these buttons
    /// counts as pressed.
    #[must_use]
    pub fn new(closed: Levels, inputs: &Inputs) -> Self {
        inputs.set_closed(closed);
        Self {
            filter: Filter::new(closed),
            raw: closed,
            absent: 0,
        }
    }

    /// Latches the positions of the probe and of limit switches at the beginning of each run, from
    /// the closed contacts. A limit switch counts once the filter agrees. Returns whether the
    /// awaited change of the probe has come, which releases `prepare`.
    ///
    /// Deadline: one step time while probing, as the latched position is that of the run. A miss
    /// latches a position that is late by the delay.
    #[inline]
    pub fn latch(&mut self, raw: Levels, inputs: &Inputs, events: EventTap<'_>) -> bool {
        let output = events.output_count();
        let is_contact = inputs.is_contact(raw);
        if is_contact {
            inputs.latch_probe(output);
            self.absent = 0;
        }
        let reached = (raw ^ self.raw) & (raw ^ inputs.inverted());
        inputs.latch_limits(reached, output);
        self.raw = raw;
        is_contact
    }

    /// Handles a change of an input. Returns whether samples are needed, the first one
    /// [`SAMPLE_TICKS`](super::SAMPLE_TICKS) from now if none is due.
    #[inline]
    pub fn edge(&mut self) -> bool {
        self.filter.change(self.raw)
    }

    /// Handles a sample.
    #[inline]
    pub fn sample(&mut self, inputs: &Inputs, requests: &Requests) -> SampleActions {
        let changed = self.filter.sample(self.raw);
        let closed = self.filter.stable();
        inputs.set_closed(closed);
        requests.press(changed & closed);
        let is_unconfirmed = inputs.is_probe_unconfirmed();
        let is_spike = is_unconfirmed && self.decide_contact(changed, inputs);
        let made = changed & (closed ^ inputs.inverted());
        if made.has(Levels::PROBE) {
            requests.report_contact();
        }
        SampleActions {
            sample_again: self.filter.change(self.raw) | is_unconfirmed,
            release_prepare: changed != Levels::NONE || is_spike,
            halt_steps: made.has(inputs.armed_limits()),
        }
    }

    /// Decides about a latched contact of the probe, from the levels that have changed for the filter. A change of the
    /// probe's level confirms the contact; [`SAMPLES`] samples without the contact drop it as a spike. Returns whether
    /// it was a spike.
    #[inline]
    fn decide_contact(&mut self, changed: Levels, inputs: &Inputs) -> bool {
        if changed.has(Levels::PROBE) {
            inputs.confirm_probe();
        } else if (self.raw ^ self.filter.stable()).has(Levels::PROBE) {
            self.absent = 0;
        } else {
            self.absent += 1;
            if self.absent == SAMPLES {
                inputs.forget_probe();
                return true;
            }
        }
        false
    }
}
