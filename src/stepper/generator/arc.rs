//! The steps of an arc in whole steps: in their order, also where an axis reverses within the segment.

use super::{DIRECTION_SETUP_SLOTS, Generator, is_not_before};
use crate::{
    axis::AXES,
    model::timing::{PULSE_LOW_SLOTS, SLOT_TICKS, pulse_slots},
    stepper::{ArcSteps, Segment},
};

impl Generator {
    /// Begins the steps of an arc in the segment. Returns the directions at its beginning.
    #[inline(never)]
    pub(super) fn begin_arc(&mut self, arc: ArcSteps, segment: &Segment) -> u8 {
        let mut directions = self.directions;
        let (mut last, mut known) = (directions, 0);
        let mut steps = arc;
        // wcet-bound: segment_steps
        while let Some(step) = steps.take_step() {
            let bit = 1 << step.axis;
            let level = u8::from(step.is_negative) << step.axis;
            if known & bit == 0 {
                known |= bit;
                directions = directions & !bit | level;
            } else if last & bit != level {
                // A change of direction.
                self.max_events += 1;
            }
            last = last & !bit | level;
            self.max_events += 2;
        }
        // wcet-bound: axes
        for axis in 0..AXES {
            if known >> axis & 1 != 0 {
                self.position[axis] = segment.axes[axis].to;
            }
        }
        self.moving_axes |= u32::from(known);
        self.arc = (known != 0).then_some(arc);
        directions
    }

    /// Adds the steps of the arc to the slots behind those of all other axes: each later than the one before.
    #[inline(never)]
    pub(super) fn add_arc_steps(&mut self, mut arc: ArcSteps) {
        let base = self.base_slot;
        let pulse = pulse_slots(self.pulse_ticks);
        let mut free = self.first_slot.cast_signed();
        // wcet-bound: segment_steps
        while let Some(step) = arc.take_step() {
            let bit = 1 << step.axis;
            let Some(end) = self.pulse_end_slots.get_mut(step.axis) else {
                continue;
            };
            let pulse_end = end.wrapping_sub(base).cast_signed();
            if (self.directions & bit != 0) != step.is_negative {
                self.directions ^= bit;
                let from = base.wrapping_add(free.max(pulse_end + 1).cast_unsigned());
                let slot = self.slots.add_direction_change(from, self.directions);
                free = slot.wrapping_sub(base).cast_signed() + DIRECTION_SETUP_SLOTS.cast_signed();
            }
            let mut earliest = free.max(pulse_end + PULSE_LOW_SLOTS.cast_signed());
            if self.reversing_axes & u32::from(bit) != 0 {
                earliest = earliest.max(self.first_slot_reversing.cast_signed());
            }
            let earliest = earliest.cast_unsigned();
            let time = self.offset_ticks + step.ticks;
            let (mut slot, mut ticks) = (time / SLOT_TICKS, time % SLOT_TICKS);
            if slot < earliest {
                (slot, ticks) = (earliest, 0);
            }
            let at = base.wrapping_add(slot);
            self.slots.add_step(at, u32::from(bit), ticks);
            *end = at.wrapping_add(pulse);
            self.slots.add_pulse_end(*end, u32::from(bit));
            self.last_step_slot = self.last_step_slot.max(slot);
            free = slot.cast_signed() + 1;
        }
        debug_assert!(is_not_before(base.wrapping_add(free.cast_unsigned()), base));
    }

    /// Takes the steps of the arc that will not be made off the position.
    #[inline(never)]
    pub(super) fn withdraw_arc(&mut self, mut arc: ArcSteps) {
        // wcet-bound: segment_steps
        while let Some(step) = arc.take_step() {
            self.withdraw_steps(step.axis, step.is_negative, 1);
        }
    }
}
