//! Probing: a move that a change of the probe ends.
//!
//! The `inputs` interrupt latches the moment of the change; here it becomes a position. Read with
//! Grbl 1.1 `motion_control.c`, `mc_probe_cycle`.

use crate::{
    axis::Axes,
    machine::{Contact, Inputs},
    model::{Alarm, Levels, Probed, Probing},
};

/// The probing move in execution.
#[derive(Debug)]
pub(crate) struct ProbingCycle {
    probing: Option<Probing>,
    /// Where the probe changed.
    contact: Option<Axes<i32>>,
}

impl ProbingCycle {
    pub(crate) const fn new() -> Self {
        Self {
            probing: None,
            contact: None,
        }
    }

    /// Begins, at rest; whether the probe is as it has to be before.
    pub(crate) fn begin(&mut self, probing: Probing, inputs: &Inputs) -> bool {
        let is_active = inputs.active().has(Levels::PROBE);
        if is_active != probing.is_away {
            return false;
        }
        inputs.arm_probe(if probing.is_away {
            Contact::Broken
        } else {
            Contact::Made
        });
        self.probing = Some(probing);
        self.contact = None;
        true
    }

    /// Whether a probing move is in execution.
    pub(crate) const fn is_active(&self) -> bool {
        self.probing.is_some()
    }

    /// Whether it has changed, so that the rest of the move is not executed.
    pub(crate) const fn is_touched(&self) -> bool {
        self.contact.is_some()
    }

    /// Whether it has changed, and where is not known yet.
    pub(crate) fn has_latched(&self, inputs: &Inputs) -> bool {
        self.is_active() && self.contact.is_none() && inputs.probe_latch().is_some()
    }

    /// It has changed there.
    pub(crate) fn latch(&mut self, there: Axes<i32>) {
        self.contact = Some(there);
    }

    /// Ends at rest at `steps`: the alarm if the probe should have changed and has not.
    pub(crate) fn finish(&mut self, steps: Axes<i32>, probed: &mut Probed) -> Option<Alarm> {
        probed.success = self.is_touched();
        let probing = self.probing.take().unwrap_or_default();
        if let Some(contact) = self.contact.take() {
            probed.steps = contact;
            return None;
        }
        if probing.may_miss {
            // A miss that is an error leaves the position of the probing move before.
            probed.steps = steps;
            return None;
        }
        Some(Alarm::ProbeContact)
    }

    /// Ends without a result: a reset.
    pub(crate) fn cancel(&mut self) {
        self.probing = None;
        self.contact = None;
    }
}
