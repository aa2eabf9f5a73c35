//! The generator after a halt or a fault: what has not been played is discarded.

use super::{
    super::{
        EventWriter, SegmentRing,
        placement::Cursor,
        position::{pulses_high_after, steps_after},
        step_times::NO_STEPS,
    },
    Generator,
};
use crate::{axis::AXES, model::timing::pulse_slots};

impl Generator {
    /// Discards what has not been played, after the step interrupt has been halted: the position is
    /// then exactly that of the steps output. A standstill must follow, which ends the pulses.
    pub fn discard_unplayed(&mut self, segments: &SegmentRing, events: &mut EventWriter<'_>) {
        let output = events.discard_pending();
        let high = pulses_high_after(output, events);
        if let Some(steps) = steps_after(output, segments, events) {
            self.set_steps(steps);
        }
        segments.discard_pending();
        self.clear_steps();
        for end in self.pulse_end_slots {
            self.slots.remove(end);
        }
        self.add_all_pulse_ends(high);
        // Slots go on from the event output last, as if that were at the end of a slot.
        let free = self.cursor.free_slot.wrapping_add(1);
        self.cursor = Cursor {
            free_slot: free,
            last_ticks: 0,
            is_at_boundary: false,
        };
        (self.base_slot, self.offset_ticks, self.ticks) = (free, 0, 0);
        self.is_open = false;
        self.is_standstill = false;
        // The segments ahead are gone; a later one must not begin at the same time as one of them.
        self.clock_ticks = segments.played_start_ticks().wrapping_add(1);
        self.next_event_number = output;
    }

    /// Discards the steps of the segment that has no events yet, after a fault: the position is then
    /// where the events end.
    pub fn discard_open_segment(&mut self) {
        if !self.is_open {
            return;
        }
        #[cfg(arc_machine)]
        self.withdraw_arc();
        for axis in 0..AXES {
            let is_negative = self.directions >> axis & 1 != 0;
            self.withdraw_steps(axis, is_negative, self.axes[axis].remaining);
        }
        self.clear_steps();
    }

    /// Leaves the segment without steps.
    fn clear_steps(&mut self) {
        self.axes = [NO_STEPS; AXES];
        #[cfg(arc_machine)]
        self.arc.clear_steps();
        (self.moving_axes, self.reversing_axes) = (0, 0);
    }

    /// Adds an end of the pulses of the axes in `high`, a whole pulse from now, and of no others.
    fn add_all_pulse_ends(&mut self, high: u32) {
        let free = self.cursor.free_slot.wrapping_add(1);
        let end = free.wrapping_add(pulse_slots(self.pulse_ticks));
        if high != 0 {
            self.slots.add_pulse_end(end, high);
        }
        for (axis, last) in self.pulse_end_slots.iter_mut().enumerate() {
            *last = if high >> axis & 1 == 0 { free } else { end };
        }
    }
}
