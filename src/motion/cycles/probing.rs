//! Probing: a move that a change of the probe ends, or a limit switch.
//!
//! The `inputs` interrupt latches the moment of the change, which becomes a position here. A limit switch
//! counts once the filter agrees; one that is closed already ends the move where it begins. Read with
//! Grbl 1.1 `motion_control.c`, `mc_probe_cycle`.

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
    /// Where the probe changed, or a switch closed.
    contact: Option<Axes<i32>>,
}

impl ProbingCycle {
    /// Begins a move, at rest, if the probe is as it has to be before.
    pub(crate) fn begin(block: &Block, probing: Probing, inputs: &Inputs) -> Option<Self> {
        let mut cycle = Self {
            axes: 0,
            may_miss: true,
            contact: None,
        };
        match probing {
            Probing::LimitSwitch => {
                // wcet-bound: axes
                for (axis, delta) in block.delta.iter().enumerate() {
                    cycle.axes |= u8::from(*delta != 0) << axis;
                }
            }
            Probing::Probe { is_away, may_miss } => {
                if inputs.active().has(Levels::PROBE) != is_away {
                    return None;
                }
                inputs.arm_probe(if is_away {
                    Contact::Broken
                } else {
                    Contact::Made
                });
                cycle.may_miss = may_miss;
            }
        }
        Some(cycle)
    }

    /// Returns the limit switches that end the move.
    pub(crate) const fn switches(&self) -> Levels {
        Levels::limits(self.axes)
    }

    /// Whether the contact has come, so that the remainder of the move is not executed.
    pub(crate) const fn is_touched(&self) -> bool {
        self.contact.is_some()
    }

    /// Whether the contact has come, at a position that is not known yet.
    pub(crate) fn has_latched(&self, inputs: &Inputs) -> bool {
        self.contact.is_none() && self.latched_output(inputs).is_some()
    }

    /// Returns the number of events output when the contact came, if it has.
    pub(crate) fn latched_output(&self, inputs: &Inputs) -> Option<u32> {
        if self.axes == 0 {
            return inputs.probe_latch();
        }
        let closed = inputs.active() & self.switches();
        // wcet-bound: axes
        let mut axes = 0..AXES;
        let axis = axes.find(|axis| closed.has(Levels::limits(1 << axis)))?;
        Some(inputs.limit_latch(axis))
    }

    /// Takes over the position of the contact.
    pub(crate) const fn latch(&mut self, position: Axes<i32>) {
        self.contact = Some(position);
    }

    /// Ends at rest at `steps`; returns the alarm if the probe should have changed and has not.
    pub(crate) fn finish(&self, steps: Axes<i32>, probed: &mut Probed) -> Option<Alarm> {
        probed.success = self.is_touched();
        // A miss that is an error leaves the position of the probing move before.
        if !probed.success && !self.may_miss {
            return Some(Alarm::ProbeContact);
        }
        probed.steps = self.contact.unwrap_or(steps);
        None
    }
}
