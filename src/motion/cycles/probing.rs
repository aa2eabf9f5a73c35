//! Probing: a move that a change of the probe ends.
//!
//! The `inputs` interrupt latches the moment of the change, which becomes a position here. Read with
//! Grbl 1.1 `motion_control.c`, `mc_probe_cycle`.

use crate::{
    axis::Axes,
    machine::{Contact, Inputs},
    model::{Alarm, Levels, Probed, Probing},
};

/// A probing move in execution.
#[derive(Debug)]
pub(crate) struct ProbingCycle {
    probing: Probing,
    /// Where the probe changed.
    contact: Option<Axes<i32>>,
}

impl ProbingCycle {
    /// Begins a move, at rest, if the probe is as it has to be before.
    pub(crate) fn begin(probing: Probing, inputs: &Inputs) -> Option<Self> {
        let is_active = inputs.active().has(Levels::PROBE);
        if is_active != probing.is_away {
            return None;
        }
        inputs.arm_probe(if probing.is_away {
            Contact::Broken
        } else {
            Contact::Made
        });
        Some(Self {
            probing,
            contact: None,
        })
    }

    /// Whether the probe has changed, so that the remainder of the move is not executed.
    pub(crate) const fn is_touched(&self) -> bool {
        self.contact.is_some()
    }

    /// Whether the probe has changed, at a position that is not known yet.
    pub(crate) fn has_latched(&self, inputs: &Inputs) -> bool {
        self.contact.is_none() && inputs.probe_latch().is_some()
    }

    /// Takes over the position where the probe changed.
    pub(crate) const fn latch(&mut self, position: Axes<i32>) {
        self.contact = Some(position);
    }

    /// Ends at rest at `steps`; returns the alarm if the probe should have changed and has not.
    pub(crate) fn finish(&self, steps: Axes<i32>, probed: &mut Probed) -> Option<Alarm> {
        probed.success = self.is_touched();
        // A miss that is an error leaves the position of the probing move before.
        if !probed.success && !self.probing.may_miss {
            return Some(Alarm::ProbeContact);
        }
        probed.steps = self.contact.unwrap_or(steps);
        None
    }
}
