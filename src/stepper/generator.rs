//! From a segment's motion to the events of the step interrupt.
//!
//! The number of steps comes from exact integer positions, so rounding moves an edge by a fraction
//! of a tick and never adds or loses one. [`Generator::begin`] finds the steps of each axis;
//! [`Generator::push_events`] makes events of them, by one of the methods in [`super::placement`].
//!
//! # Cost
//! The fields of [`Generator`] have a fixed order in memory: the slots, which are large, come last,
//! so that the others are within reach of one instruction.

use super::{
    EventWriter, Segment, SegmentInfo, SegmentRing, StepEvent,
    placement::{Cursor, Direct, Method, Placement, SLOT_TICKS_SIGNED, Slots},
    ring::EventBatch,
    step_times::{AxisSteps, NO_STEPS, plan_axis},
};
use crate::{
    axis::{AXES, Axes},
    model::{
        Power,
        queues::EVENT_RING,
        timing::{
            DIRECTION_SETUP_TICKS, EVENT_SPACING_TICKS, PULSE_LOW_SLOTS, SLOT_TICKS, pulse_slots,
        },
    },
    units::{FineSteps, TICKS_PER_US},
};

#[cfg(arc_machine)]
mod arc;
mod halted;

#[cfg(arc_machine)]
pub use arc::{MAX_ARC_STEPS, MAX_ARC_STRETCHES};

/// Bounds the events of a segment besides two for each step: a change of direction, the ends of
/// pulses that have begun before, and its end when the last of the others comes long before.
const OTHER_EVENTS: u32 = 2 + AXES as u32;
/// Bounds the slots from a segment's last event, with which the queue runs empty, to the segment's
/// end. The deadline of segments in `schedule.toml` relies on it, and
/// `the_last_event_of_a_segment_comes_shortly_before_its_end` tests it.
pub const END_SLOTS: u32 = 16;
/// A bit for each axis.
const ALL_AXES: u32 = (1 << AXES) - 1;

/// Slots from a change of direction to the next step of the axis: the change may come at the end of
/// its slot.
const DIRECTION_SETUP_SLOTS: u32 = 1 + DIRECTION_SETUP_TICKS.div_ceil(SLOT_TICKS);
/// Bounds how long the end of a pulse is remembered, in slots, as their numbers wrap: long enough
/// for the low time behind it.
const PAST_SLOTS: u32 = 16;
const _: () = assert!(PAST_SLOTS > PULSE_LOW_SLOTS);

/// Makes events of segments, a whole segment at a time.
#[derive(Debug)]
#[repr(C)]
pub struct Generator {
    /// Exact position of each axis at the segment's end.
    position: Axes<FineSteps>,
    /// The segment's duration, ticks.
    ticks: u32,
    /// The slot in which the segment begins.
    base_slot: u32,
    /// Start of the segment, ticks after the start of that slot.
    offset_ticks: u32,
    /// The end of the list of events.
    cursor: Cursor,
    /// The segment has begun, and its events have not been pushed.
    is_open: bool,
    /// Bounds the segment's events.
    max_events: u32,
    /// Axes that step in the segment, bit 0 = X.
    moving_axes: u32,
    /// The slot of the segment's last step, counted from the slot in which the segment begins.
    last_step_slot: u32,
    /// The first slot in which a step of an axis that reverses may be, counted likewise.
    first_slot_reversing: u32,
    /// The same of another axis.
    first_slot: u32,
    /// Axes that reverse in the segment, bit 0 = X.
    reversing_axes: u32,
    /// The direction outputs may have other levels: before the first motion, and after a standstill,
    /// in which settings may change.
    are_directions_unknown: bool,
    /// The axis with the most steps in the segment.
    dominant_axis: usize,
    /// The segment is the standstill after the last one.
    is_standstill: bool,
    /// Levels of the direction outputs, bit 0 = X.
    directions: u8,
    /// Length of a pulse, ticks.
    pulse_ticks: u32,
    /// The slot in which the last pulse of each axis ends.
    pulse_end_slots: [u32; AXES],
    /// End of all segments begun, on the generator's clock.
    clock_ticks: u32,
    /// Number of the event that is pushed next.
    next_event_number: u32,
    #[cfg(arc_machine)]
    arc: arc::ArcInSegments,
    axes: [AxisSteps; AXES],
    slots: Slots,
}

impl Generator {
    /// Returns a generator that stands at zero, for pulses of 10 µs.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            axes: [NO_STEPS; AXES],
            position: Axes([FineSteps(0); AXES]),
            ticks: 0,
            base_slot: 0,
            offset_ticks: 0,
            cursor: Cursor {
                free_slot: 0,
                last_ticks: 0,
                is_at_boundary: false,
            },
            is_open: false,
            max_events: 0,
            moving_axes: 0,
            last_step_slot: 0,
            first_slot_reversing: 0,
            first_slot: 0,
            reversing_axes: 0,
            are_directions_unknown: true,
            dominant_axis: 0,
            is_standstill: false,
            directions: 0,
            pulse_ticks: 10 * TICKS_PER_US,
            pulse_end_slots: [0; AXES],
            clock_ticks: 0,
            next_event_number: 0,
            #[cfg(arc_machine)]
            arc: arc::ArcInSegments::NONE,
            slots: Slots::NONE,
        }
    }

    /// Sets the length of a pulse, µs: at least the shortest time between two events.
    pub fn set_pulse_us(&mut self, pulse_us: u8) {
        self.pulse_ticks = (u32::from(pulse_us) * TICKS_PER_US).max(EVENT_SPACING_TICKS);
    }

    /// Returns the exact position at the end of all segments begun.
    #[must_use]
    pub const fn position(&self) -> &Axes<FineSteps> {
        &self.position
    }

    /// Returns the whole steps at the end of all segments begun.
    #[must_use]
    pub fn steps(&self) -> Axes<i32> {
        self.position.map(|position| position.nearest().0)
    }

    /// Replaces the position, at a standstill. Reports show other whole steps once a standstill has
    /// been played with them: see [`Generator::begin_standstill`].
    pub fn set_position(&mut self, position: Axes<FineSteps>) {
        self.position = position;
    }

    /// Takes steps off the position of an axis that its motor has made without it.
    pub(crate) fn move_back(&mut self, axis: usize, steps: i32) {
        self.position[axis] = self.position[axis].minus_steps(steps);
    }

    /// Replaces the position by whole steps, at a standstill.
    pub fn set_steps(&mut self, steps: Axes<i32>) {
        self.set_position(steps.map(|steps| FineSteps(i64::from(steps) << 32)));
    }

    /// Takes steps that an axis will not make off its position.
    fn withdraw_steps(&mut self, axis: usize, is_negative: bool, missing: u32) {
        let missing = i64::from(missing) << 32;
        let missing = if is_negative { -missing } else { missing };
        let position = &mut self.position[axis].0;
        *position = position.wrapping_sub(missing);
    }

    /// Returns whether a segment has begun that has no events yet: [`Generator::push_events`] must
    /// return true before the next one.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }

    /// Returns the end of all segments begun, on the generator's clock, wrapping ticks.
    #[must_use]
    pub const fn clock_ticks(&self) -> u32 {
        self.clock_ticks
    }

    /// Begins a segment. The one before must be finished, and `segments` must have room.
    pub fn begin(&mut self, segment: &Segment, segments: &SegmentRing) {
        self.begin_at_end(segment.ticks);
        let slots = (self.offset_ticks + self.ticks) / SLOT_TICKS;
        let max_steps = slots / (pulse_slots(self.pulse_ticks) + PULSE_LOW_SLOTS) + 1;
        let duration = segment.ticks as f32;
        let rate = 1.0 / duration;
        let mut directions = self.directions;
        let mut dominant_steps = 0;
        let begin = self.steps();
        let latest = segment.ticks.saturating_sub(SLOT_TICKS);
        #[cfg(arc_machine)]
        {
            directions = self.begin_arc(directions);
        }
        for axis in 0..AXES {
            let motion = segment.axes[axis];
            #[cfg(arc_machine)]
            let motion = (self.arc).motion_off_arc(axis, self.position[axis], motion);
            let (mut steps, is_negative) =
                plan_axis(self.position[axis], motion, duration, rate, latest);
            self.position[axis] = motion.to;
            if steps.remaining != 0 {
                directions = directions & !(1 << axis) | u8::from(is_negative) << axis;
                self.moving_axes |= 1 << axis;
            }
            // Faster than pulses can be: the others come with the next segment. As the acceleration
            // is constant, the last step comes after the segment by a quarter of the segment and two
            // pulses at most.
            if steps.remaining > max_steps {
                self.withdraw_steps(axis, is_negative, steps.remaining - max_steps);
                steps.remaining = max_steps;
            }
            if steps.remaining > dominant_steps {
                dominant_steps = steps.remaining;
                self.dominant_axis = axis;
            }
            self.max_events += 2 * steps.remaining;
            self.axes[axis] = steps;
        }
        // Steps keep away from the segment's end, as the next one may follow at once; but those of
        // the dominant axis keep their times.
        if let Some(steps) = self.axes.get_mut(self.dominant_axis) {
            steps.set_latest(segment.ticks);
        }
        if self.moving_axes != 0 {
            self.reversing_axes = u32::from(directions ^ self.directions);
            if self.are_directions_unknown {
                self.reversing_axes = ALL_AXES;
            }
            self.are_directions_unknown = false;
            self.directions = directions;
        }
        segments.push(&SegmentInfo {
            start_ticks: self.clock_ticks,
            steps: begin,
            first_event: self.next_event_number,
            directions,
            is_standstill: false,
            feed_mm_min: segment.feed_mm_min,
            line: segment.line,
            duty: segment.power.duty,
            spindle_rpm: segment.power.rpm,
        });
        self.clock_ticks = self.clock_ticks.wrapping_add(segment.ticks);
    }

    /// Begins the standstill after the last segment: ends all pulses and lets the queue run empty.
    pub fn begin_standstill(&mut self, power: Power, segments: &SegmentRing) {
        for axis in &mut self.axes {
            *axis = NO_STEPS;
        }
        self.begin_at_end(SLOT_TICKS);
        self.is_standstill = true;
        self.are_directions_unknown = true;
        segments.push(&SegmentInfo {
            start_ticks: self.clock_ticks,
            steps: self.steps(),
            first_event: self.next_event_number,
            directions: self.directions,
            is_standstill: true,
            feed_mm_min: 0.0,
            line: 0,
            duty: power.duty,
            spindle_rpm: power.rpm,
        });
        self.clock_ticks = self.clock_ticks.wrapping_add(SLOT_TICKS);
    }

    /// Begins a segment at the end of the one before.
    fn begin_at_end(&mut self, ticks: u32) {
        let slots = (self.offset_ticks + self.ticks) / SLOT_TICKS;
        self.offset_ticks = self.offset_ticks + self.ticks - slots * SLOT_TICKS;
        self.base_slot = self.base_slot.wrapping_add(slots);
        let passed = slots.wrapping_mul(SLOT_TICKS).cast_signed();
        self.cursor.last_ticks = self.cursor.last_ticks.saturating_sub(passed);
        self.cursor.is_at_boundary = true;
        if !is_not_before(self.cursor.free_slot, self.base_slot) {
            self.cursor.free_slot = self.base_slot;
        }
        for end in &mut self.pulse_end_slots {
            if !is_not_before(*end, self.base_slot.wrapping_sub(PAST_SLOTS)) {
                *end = self.base_slot.wrapping_sub(PAST_SLOTS);
            }
        }
        self.ticks = ticks;
        self.is_open = true;
        self.max_events = OTHER_EVENTS;
        (self.moving_axes, self.reversing_axes) = (0, 0);
        self.last_step_slot = 0;
        self.first_slot = self.cursor.free_slot.wrapping_sub(self.base_slot);
        self.first_slot_reversing = self.first_slot;
    }
}

/// The events of the segment that has begun: into the ring, all of them or none.
impl Generator {
    /// Pushes the events of the segment and returns true, or returns false while the ring has no
    /// room for all of them. Room for what is queued ahead and the longest segment is there up to
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
    /// where an error weighs most; so does what follows the segment. The proof counts its calls: a segment makes one.
    #[inline(never)]
    fn add_steps(&mut self) {
        let mut axis = self.dominant_axis;
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
    fn add_steps_of(&mut self, axis: usize) {
        let (Some(steps), Some(end)) = (self.axes.get(axis), self.pulse_end_slots.get_mut(axis))
        else {
            return;
        };
        if steps.remaining == 0 {
            return;
        }
        let axis_mask = 1 << axis;
        // An axis that reverses waits until its driver has seen the new direction.
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
            // For the dominant axis others move, but not its own pulses; for another axis none do.
            fixed_axes: if is_dominant { axis_mask } else { ALL_AXES },
            pulse_slots: pulse_slots(self.pulse_ticks),
            low_slots: PULSE_LOW_SLOTS,
            // Not before the last pulse of the axis, which may be one of the segment before, has been low.
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

impl Default for Generator {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns whether a slot is the same as another or behind it.
const fn is_not_before(slot: u32, other: u32) -> bool {
    slot.wrapping_sub(other).cast_signed() >= 0
}
