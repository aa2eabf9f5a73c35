//! Probing: a move that a change of the probe ends, or a limit switch.
//!
//! The `inputs` interrupt latches the moment of the change, which becomes a position here, and the filter
//! confirms it meanwhile: the machine goes on after a spike. A limit switch counts once the filter agrees; a switch
//! closed already ends the move where it begins. Read with Grbl 1.1 `motion_control.c`, `mc_probe_cycle`.

use crate::{
    axis::{AXES, Axes},
    machine::{Contact, Inputs},
    model::{Alarm, Levels, Probed, Probing},
    path::Block,
};

/// A probing move in execution.
#[derive(Debug)]
pub(crate) struct ProbingCycle {
    /// The axes whose limit switches end the move, bit 0 = X; 0 where the probe does.
    axes: u8,
    may_miss: bool,
    /// [`ProbingCycle::latched_output`] as seen last.
    latched: Option<u32>,
    /// Where the probe changed, or a switch closed.
    contact: Option<Axes<i32>>,
    /// The machine slows down, or stands, because of a contact.
    is_stopping: bool,
}

/// What a probing move has come to, at rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ProbingState {
    /// The filter does not know yet whether the probe has changed.
    Undecided,
    /// It was a spike, and there is more of the move.
    Continues,
    /// The move is over.
    Ended,
}

impl ProbingCycle {
    /// Begins a move, at rest, if the probe is as it has to be before.
    pub(crate) fn begin(block: &Block, probing: Probing, inputs: &Inputs) -> Option<Self> {
        let mut cycle = Self {
            axes: 0,
            may_miss: true,
            latched: None,
            contact: None,
            is_stopping: false,
        };
        match probing {
            Probing::LimitSwitch => {
                for (axis, delta) in block.delta.iter().enumerate() {
                    cycle.axes |= u8::from(*delta != 0) << axis;
                }
            }
            Probing::Probe { is_away, may_miss } => {
                inputs.arm_probe(if is_away {
                    Contact::Broken
                } else {
                    Contact::Made
                });
                // Armed before: a change that the filter sees from now on has been latched.
                if inputs.active().has(Levels::PROBE) != is_away {
                    inputs.disarm_probe();
                    return None;
                }
                cycle.may_miss = may_miss;
            }
        }
        Some(cycle)
    }

    /// Returns the limit switches that end the move.
    pub(crate) const fn switches(&self) -> Levels {
        Levels::limits(self.axes)
    }

    /// Whether a limit switch ends the move, and not the probe.
    pub(crate) const fn awaits_a_switch(&self) -> bool {
        self.axes != 0
    }

    /// Whether the contact has come, so that the remainder of the move is not executed for now.
    pub(crate) const fn is_stopping(&self) -> bool {
        self.is_stopping
    }

    /// Whether the contact has come, at a position that is not known yet, or was a spike.
    pub(crate) fn has_latched(&self, inputs: &Inputs) -> bool {
        !(self.awaits_a_switch() && self.is_stopping) && self.latched != self.latched_output(inputs)
    }

    /// Returns the number of events output when the contact came, if it has.
    pub(crate) fn latched_output(&self, inputs: &Inputs) -> Option<u32> {
        if !self.awaits_a_switch() {
            return inputs.probe_latch();
        }
        let closed = inputs.active() & self.switches();
        let mut axes = 0..AXES;
        let axis = axes.find(|axis| closed.has(Levels::limits(1 << axis)))?;
        Some(inputs.limit_latch(inputs.active_switch(axis)))
    }

    /// Takes over the position of the contact.
    pub(crate) const fn latch(&mut self, latched: u32, position: Axes<i32>) {
        self.latched = Some(latched);
        self.contact = Some(position);
        self.is_stopping = true;
    }

    /// Forgets a contact that was a spike. The machine comes to rest before it goes on.
    pub(crate) const fn forget(&mut self) {
        self.latched = None;
        self.contact = None;
    }

    /// Returns the result of the move at rest; `is_done` tells that nothing of it is left.
    pub(crate) fn at_rest(&mut self, is_done: bool, inputs: &Inputs) -> ProbingState {
        let is_confirmed = self.awaits_a_switch() || inputs.is_probe_confirmed();
        match self.contact {
            Some(_) if is_confirmed => ProbingState::Ended,
            Some(_) => ProbingState::Undecided,
            None if is_done => ProbingState::Ended,
            None => {
                self.is_stopping = false;
                ProbingState::Continues
            }
        }
    }

    /// Ends at rest at `steps`; returns the alarm if the probe should have changed and has not.
    pub(crate) fn finish(&self, steps: Axes<i32>, probed: &mut Probed) -> Option<Alarm> {
        probed.success = self.contact.is_some();
        // A miss that is an error leaves the position of the probing move before.
        if !probed.success && !self.may_miss {
            return Some(Alarm::ProbeContact);
        }
        probed.steps = self.contact.unwrap_or(steps);
        None
    }
}
