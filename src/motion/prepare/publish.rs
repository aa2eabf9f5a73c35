//! What tasks and outputs get to know of the machine after a run of `prepare`.

use super::Motion;
use crate::{
    axis::{AXES, Axes},
    machine::{Ending, Snapshot},
    model::{Coolant, Notices, Outputs, Power, Probed, Spindle, ToolChangeSpan},
    stepper::SegmentRing,
};

/// What is published, as far as it is kept nowhere else.
#[derive(Debug)]
pub(super) struct Published {
    /// Entries finished, wrapping.
    pub(super) finished: u32,
    /// Motions ended before their target, wrapping.
    pub(super) cancelled_motions: u32,
    /// The power at rest, and the one shown last.
    at_rest: Power,
    power: Power,
    pub(super) outputs: Outputs,
    /// The outputs have changed since the platform got to know them.
    pub(super) outputs_changed: bool,
    pub(super) notices: Notices,
    pub(super) probed: Probed,
    pub(super) tool_marks: ToolChangeSpan,
}

impl Published {
    pub(super) const fn new() -> Self {
        Self {
            finished: 0,
            cancelled_motions: 0,
            at_rest: Power::OFF,
            power: Power::OFF,
            outputs: Outputs {
                spindle: Spindle::Off,
                duty: 0,
                coolant: Coolant::OFF,
                drivers: false,
            },
            outputs_changed: true,
            notices: Notices::new(),
            probed: Probed {
                steps: Axes([0; AXES]),
                success: false,
            },
            tool_marks: ToolChangeSpan::NONE,
        }
    }

    #[inline]
    pub(super) const fn take_outputs_changed(&mut self) -> bool {
        core::mem::replace(&mut self.outputs_changed, false)
    }
}

impl Motion {
    /// Publishes how far the machine has come, and its accessories. Returns whether it has come to
    /// rest or left it, or coolant has been toggled: tasks wait for these.
    #[inline]
    pub(super) fn publish_motion(
        &mut self,
        is_still: bool,
        segments: &SegmentRing,
        new: &mut Snapshot,
    ) -> bool {
        let is_toggled = self.publish_accessories(segments, new);
        let is_at_rest = is_still
            && self.plan.is_empty()
            && !self.is_occupied()
            && !self.parking.is_away()
            && self.control.ending == Ending::None;
        let changed = new.is_at_rest != is_at_rest;
        new.is_at_rest = is_at_rest;
        new.blocks_free = self.plan.free() as u16;
        // A task that waits for all blocks waits for rest: a finished one alone changes nothing.
        new.finished = self.published.finished;
        is_toggled || changed
    }

    /// Publishes the state. Returns whether anything has changed that a task waits for.
    #[inline]
    pub(super) fn publish_state(&mut self, new: &mut Snapshot) -> bool {
        let has_notices = new.notices.count() != self.published.notices.count();
        let changed = new.state != self.control.state
            || new.reset_count != self.handled.reset_count
            || new.cancelled_motions != self.published.cancelled_motions
            || has_notices;
        new.state = self.control.state;
        if has_notices {
            new.notices = self.published.notices;
        }
        new.probed = self.published.probed;
        new.tool_marks = self.published.tool_marks;
        new.reset_count = self.handled.reset_count;
        new.cancelled_motions = self.published.cancelled_motions;
        new.reset_in_motion = self.faults.reset_in_motion;
        new.has_underrun = self.faults.has_underrun;
        new.is_critical = self.faults.is_critical;
        changed
    }

    /// Publishes spindle, laser and coolant. Returns whether coolant has been toggled.
    #[inline]
    fn publish_accessories(&mut self, segments: &SegmentRing, new: &mut Snapshot) -> bool {
        // Off, a spindle has no power at rest nor in motion.
        let is_changed = self.accessories.take_changed();
        (is_changed || !self.accessories.is_spindle_off())
            && self.publish_power(is_changed, segments, new)
    }

    /// The same of a spindle that is on, or after a change.
    #[inline(never)]
    fn publish_power(
        &mut self,
        is_changed: bool,
        segments: &SegmentRing,
        new: &mut Snapshot,
    ) -> bool {
        if is_changed {
            self.published.at_rest = self.accessories.power_at_rest();
        }
        let power = if segments.is_running() && !self.accessories.is_spindle_off() {
            Power {
                rpm: segments.spindle_rpm(),
                duty: segments.duty(),
            }
        } else {
            self.published.at_rest
        };
        if !is_changed && power == self.published.power {
            return false;
        }
        self.published.power = power;
        self.switch_outputs(power, segments, new)
    }

    /// Switches spindle, laser and coolant, and publishes them.
    #[inline]
    fn switch_outputs(&mut self, power: Power, segments: &SegmentRing, new: &mut Snapshot) -> bool {
        self.published.outputs_changed = true;
        let accessories = &self.accessories;
        segments.inhibit_spindle(accessories.is_spindle_off());
        self.published.outputs.spindle = accessories.switched(power);
        self.published.outputs.duty = self.published.at_rest.duty;
        self.published.outputs.coolant = accessories.coolant();
        let (programmed_coolant, coolant_toggles) = accessories.programmed_coolant();
        let is_toggled = new.coolant_toggles != coolant_toggles;
        new.spindle_rpm = power.rpm;
        new.spindle = accessories.direction(power);
        new.coolant = self.published.outputs.coolant;
        new.programmed_coolant = programmed_coolant;
        new.coolant_toggles = coolant_toggles;
        new.accessory_changes = accessories.changes();
        new.overrides = accessories.overrides();
        is_toggled
    }
}
