//! The events of the segment that has begun: into the ring, all of them or none.

use super::{
    super::{
        EventWriter, StepEvent,
        method::{Direct, Method, Placement},
        ring::EventBatch,
        slots::SLOT_TICKS_SIGNED,
    },
    ALL_AXES, DIRECTION_SETUP_SLOTS, END_SLOTS, Generator, is_not_before,
};
use crate::{
    axis::AXES,
    model::{
        queues::EVENT_RING,
        timing::{PULSE_LOW_SLOTS, SLOT_TICKS, pulse_slots},
    },
};

impl Generator {
    /// Pushes the events of the segment and returns true, or returns false while the ring has no
    /// room for all of them. Room for 3.5 ms of events and a segment of 1.5 ms is there up to
    /// 200 000 steps per second of all axes together: the proof looks for no higher rate.
    pub fn push_events(&mut self, events: &mut EventWriter<'_>) -> bool {
        let mut events = events.begin();
        if events.room() < self.max_events.min(EVENT_RING as u32) {
            return false;
        }
        if self.reversing_axes != 0 {
            self.add_direction_change();
        }
        if let Some(direct) = self.direct() {
            self.push_direct(direct, &mut events);
        } else if self.moving_axes != 0 {
            self.add_steps();
        }
        self.push_slots(&mut events);
        self.next_event_number = events.number();
        true
    }

    /// Adds a change of the direction outputs before the steps of the segment, behind the pulses of
    /// the axes that reverse.
    fn add_direction_change(&mut self) {
        let mut slot = self.cursor.free_slot;
        // wcet-bound: axes
        for (axis, end) in self.pulse_end_slots.iter().enumerate() {
            let after = end.wrapping_add(1);
            if self.reversing_axes >> axis & 1 != 0 && is_not_before(after, slot) {
                slot = after;
            }
        }
        let slot = self.slots.add_direction_change(slot, self.directions);
        self.first_slot = slot.wrapping_sub(self.base_slot).wrapping_add(1);
        self.first_slot_reversing = self.first_slot + DIRECTION_SETUP_SLOTS - 1;
    }

    /// Returns how the segment does without slots, if [`Direct`] is possible.
    fn direct(&self) -> Option<Direct> {
        if self.reversing_axes != 0 || !self.moving_axes.is_power_of_two() {
            return None;
        }
        #[cfg(arc_machine)]
        if self.arc.has_steps() {
            return None;
        }
        let high = self.pulses_high();
        if high & !self.moving_axes != 0 {
            return None;
        }
        let steps = self.axes.get(self.dominant_axis)?;
        let end = *self.pulse_end_slots.get(self.dominant_axis)?;
        let low = self.slot_ticks(end.wrapping_add(PULSE_LOW_SLOTS));
        let last = self.cursor.last_ticks - self.offset_ticks.cast_signed();
        let earliest_ticks = low.max(last + SLOT_TICKS_SIGNED);
        Direct::is_possible(steps, self.pulse_ticks, earliest_ticks).then(|| Direct {
            axis_mask: self.moving_axes,
            pulse_end_ticks: (high != 0).then(|| self.slot_ticks(end)),
        })
    }

    /// Returns the axes whose pulses end in the segment.
    fn pulses_high(&self) -> u32 {
        let mut high = 0;
        // wcet-bound: axes
        for (axis, end) in self.pulse_end_slots.iter().enumerate() {
            high |= u32::from(is_not_before(*end, self.base_slot)) << axis;
        }
        high
    }

    /// Returns when a slot begins, ticks from the segment's start.
    fn slot_ticks(&self, slot: u32) -> i32 {
        let slots = slot.wrapping_sub(self.base_slot).cast_signed();
        slots * SLOT_TICKS_SIGNED - self.offset_ticks.cast_signed()
    }

    /// Pushes the steps of the only axis that has any.
    fn push_direct(&mut self, direct: Direct, events: &mut EventBatch<'_>) {
        let axes = self
            .axes
            .get(self.dominant_axis)
            .zip(self.pulse_end_slots.get_mut(self.dominant_axis));
        let Some((steps, pulse_end_slot)) = axes else {
            return;
        };
        if direct.pulse_end_ticks.is_some() {
            self.slots.remove(*pulse_end_slot);
        }
        let offset = self.offset_ticks.cast_signed();
        let mut cursor = self.cursor;
        cursor.last_ticks -= offset;
        let end_ticks = direct.push(*steps, self.pulse_ticks, &mut cursor, events);
        cursor.last_ticks += offset;
        // No event of another kind comes before the end of its slot.
        let slot = (cursor.last_ticks.max(0) / SLOT_TICKS_SIGNED).cast_unsigned();
        cursor.free_slot = self.base_slot.wrapping_add(slot + 1);
        self.cursor = cursor;
        self.last_step_slot = slot;
        let end_slots = (end_ticks + offset).max(0).cast_unsigned();
        *pulse_end_slot = self.base_slot.wrapping_add(end_slots.div_ceil(SLOT_TICKS));
        self.slots.add_pulse_end(*pulse_end_slot, direct.axis_mask);
    }

    /// Adds the steps of all axes to the slots. The dominant axis comes last and keeps its times,
    /// where an error weighs most; so does what follows the segment.
    fn add_steps(&mut self) {
        let mut axis = self.dominant_axis;
        // wcet-bound: axes
        for _ in 0..AXES {
            axis = if axis + 1 < AXES { axis + 1 } else { 0 };
            self.add_steps_of(axis);
        }
        #[cfg(arc_machine)]
        self.add_arc_steps();
        let end = self.offset_ticks + self.ticks;
        let slot = self.base_slot.wrapping_add(end / SLOT_TICKS);
        self.slots
            .move_neighbours_to_slot_start(slot, 1 << self.dominant_axis);
    }

    /// Adds the steps of an axis to the slots, and the ends of their pulses.
    #[inline]
    fn add_steps_of(&mut self, axis: usize) {
        let (Some(steps), Some(end)) = (self.axes.get(axis), self.pulse_end_slots.get_mut(axis))
        else {
            return;
        };
        if steps.remaining == 0 {
            return;
        }
        let axis_mask = 1 << axis;
        let first = if self.reversing_axes & axis_mask != 0 {
            self.first_slot_reversing
        } else {
            self.first_slot
        };
        let is_dominant = axis == self.dominant_axis;
        let base_slot = self.base_slot;
        let low = end.wrapping_add(PULSE_LOW_SLOTS).wrapping_sub(base_slot);
        let mut placement = Placement {
            base_slot,
            offset_ticks: self.offset_ticks,
            axis_mask,
            fixed_axes: if is_dominant { axis_mask } else { ALL_AXES },
            pulse_slots: pulse_slots(self.pulse_ticks),
            low_slots: PULSE_LOW_SLOTS,
            earliest_slot: first.cast_signed().max(low.cast_signed()).cast_unsigned(),
            last_step_slot: 0,
        };
        let slots = &mut self.slots;
        match placement.method(steps) {
            Method::Periodic if is_dominant => placement.add_periodic_dominant(slots, steps),
            Method::Periodic => placement.add_periodic(slots, steps),
            Method::Delayed => placement.add_delayed(slots, steps),
            Method::Solved => placement.add_solved(slots, steps),
        }
        *end = base_slot.wrapping_add(placement.earliest_slot - PULSE_LOW_SLOTS);
        self.last_step_slot = self.last_step_slot.max(placement.last_step_slot);
    }

    /// Pushes what is in the slots of the segment, and an event before its end if there is none.
    fn push_slots(&mut self, events: &mut EventBatch<'_>) {
        let mut end = ((self.offset_ticks + self.ticks) / SLOT_TICKS).max(self.last_step_slot + 1);
        if self.is_standstill {
            // wcet-bound: axes
            for last in &self.pulse_end_slots {
                let after = last.wrapping_add(1).wrapping_sub(self.base_slot);
                end = end.max(after.cast_signed().max(0).cast_unsigned());
            }
        }
        let (base, end) = (self.base_slot, self.base_slot.wrapping_add(end));
        if is_not_before(end, self.cursor.free_slot) {
            self.slots.drain(base, end, &mut self.cursor, events);
        }
        let before = end.wrapping_sub(1).wrapping_sub(base).cast_signed() * SLOT_TICKS_SIGNED;
        // The segment ends less than two slots after that.
        let is_early =
            before - self.cursor.last_ticks >= (END_SLOTS - 2).cast_signed() * SLOT_TICKS_SIGNED;
        if self.cursor.is_at_boundary || is_early && !self.is_standstill {
            let event = self.cursor.mark_boundary(StepEvent::NONE);
            events.push(self.cursor.schedule(before, event));
            events.publish();
            let slot = (self.cursor.last_ticks.max(0) / SLOT_TICKS_SIGNED).cast_unsigned();
            self.cursor.free_slot = base.wrapping_add(slot + 1);
        }
        // Events that have been delayed by others make the segment longer.
        let used = self.cursor.free_slot.wrapping_sub(base).wrapping_sub(1);
        let planned = (self.offset_ticks + self.ticks).cast_signed();
        let over = (used.cast_signed() * SLOT_TICKS_SIGNED - planned).max(0);
        self.ticks += over.cast_unsigned();
        self.clock_ticks = self.clock_ticks.wrapping_add(over.cast_unsigned());
        self.is_standstill = false;
        self.is_open = false;
    }
}
