//! Step times: from a segment's motion to the events of the step interrupt.
//!
//! The number of steps comes from exact integer positions, so rounding moves an edge by a fraction
//! of a tick and never adds or loses one. Steps and ends of pulses are put into the slots of the
//! segment and become events from there: see [`Slots`]. An axis that moves alone at an even pace needs
//! no slots: its events are in order as they come.

use super::{
    AxisMotion, EventWriter, SegmentInfo, SegmentRing, StepEvent,
    alone::Alone,
    placing::Placing,
    position::{pulses_high_after, steps_after},
    ring::EventBatch,
    slots::{Cursor, SLOT_TICKS_SIGNED, Slots},
    step_times::{AxisSteps, NO_STEPS, plan_axis},
};
use crate::{
    axis::{AXES, Axes},
    model::{
        Power,
        queues::EVENT_RING,
        timing::{DIRECTION_SETUP_TICKS, PULSE_LOW_SLOTS, SLOT_TICKS, pulse_slots},
    },
    units::{FineSteps, TICKS_PER_US},
};

/// Events of a segment besides two for each step: a change of direction, the ends of pulses that
/// have begun before, and its end when the last of the others comes long before.
const OTHER_EVENTS: u32 = 2 + AXES as u32;
/// The queue runs dry with a segment's last event: so that comes less than so many slots before the
/// segment's end. The deadline of segments in `schedule.toml` counts with it.
const END_SLOTS: u32 = 16;
/// A bit for each axis.
const ALL_AXES: u32 = (1 << AXES) - 1;

/// A stretch of motion with constant acceleration on every axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Its duration, at least 1 tick.
    pub ticks: u32,
    /// Where each axis goes.
    pub axes: Axes<AxisMotion>,
    /// Speed along the path at its end, mm/min.
    pub feed_mm_min: f32,
    /// `N` word of its block, 0 without.
    pub line: u32,
    /// Spindle or laser in it.
    pub power: Power,
}

impl Segment {
    /// A standstill at zero.
    pub const NONE: Self = Self {
        ticks: 1,
        axes: Axes(
            [AxisMotion {
                to: FineSteps(0),
                acceleration: 0.0,
            }; AXES],
        ),
        feed_mm_min: 0.0,
        line: 0,
        power: Power::OFF,
    };
}

/// Slots from a change of direction to the next step of the axis.
const DIRECTION_SETUP_SLOTS: u32 = 1 + DIRECTION_SETUP_TICKS.div_ceil(SLOT_TICKS);
/// So many slots ago, nothing matters any more.
const PAST_SLOTS: u32 = 16;

/// Turns segments into events, a whole one at a time.
///
/// In this order in memory: the slots, which are large, come last.
#[derive(Debug)]
#[repr(C)]
pub struct Generator {
    /// Exact position of each axis at the segment's end.
    position: Axes<FineSteps>,
    /// The segment's duration, ticks.
    ticks: u32,
    /// The slot in which the segment begins, and how many ticks after that slot.
    base_slot: u32,
    offset_ticks: u32,
    cursor: Cursor,
    /// The segment has begun, and its events have not been put.
    is_open: bool,
    /// It has so many events at most.
    max_events: u32,
    /// Axes that step in it.
    moving_axes: u32,
    /// The slot in which the segment's last step is, from its first on.
    last_step_slot: u32,
    /// The first slot, from the segment's first on, in which a step may be: that of an axis that
    /// reverses, and of another.
    first_slot_reversing: u32,
    first_slot: u32,
    /// Axes that reverse in the segment.
    reversing_axes: u32,
    /// The direction outputs may be others: before the first motion, and after a standstill, in
    /// which settings may change.
    directions_unknown: bool,
    /// The axis with the most steps in the segment.
    dominant_axis: usize,
    /// The segment is the standstill after the last one.
    is_standstill: bool,
    directions: u8,
    pulse_ticks: u32,
    /// The slot in which the last pulse of each axis ends.
    pulse_end_slots: [u32; AXES],
    /// End of everything generated, on the generator's clock.
    clock_ticks: u32,
    /// Number of the event that is put next.
    next_event_number: u32,
    axes: [AxisSteps; AXES],
    slots: Slots,
}

impl Generator {
    /// At rest at zero, for pulses of 10 µs.
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
            directions_unknown: true,
            dominant_axis: 0,
            is_standstill: false,
            directions: 0,
            pulse_ticks: 10 * TICKS_PER_US,
            pulse_end_slots: [0; AXES],
            clock_ticks: 0,
            next_event_number: 0,
            slots: Slots::NONE,
        }
    }

    /// Sets the length of a pulse, µs. A shorter one than events are apart lasts as long as that.
    pub fn set_pulse_us(&mut self, pulse_us: u8) {
        self.pulse_ticks = (u32::from(pulse_us) * TICKS_PER_US).max(SLOT_TICKS);
    }

    /// Exact position at the end of all segments begun.
    #[must_use]
    pub const fn position(&self) -> &Axes<FineSteps> {
        &self.position
    }

    /// Whole steps at the end of all segments begun.
    #[must_use]
    pub fn steps(&self) -> Axes<i32> {
        self.position.map(|position| position.nearest().0)
    }

    /// Replaces the position, at rest. Other whole steps are known everywhere once a standstill has
    /// been played with them: see [`Generator::begin_standstill`].
    pub fn set_position(&mut self, position: Axes<FineSteps>) {
        self.position = position;
    }

    /// Settles on whole steps, at rest.
    pub fn set_steps(&mut self, steps: Axes<i32>) {
        self.set_position(steps.map(|steps| FineSteps(i64::from(steps) << 32)));
    }

    /// Ends a cut, when the step interrupt has stopped: what it has not played is dropped, and the
    /// position is exactly that of the steps output. A standstill must follow, which ends the
    /// pulses.
    pub fn discard_unplayed(&mut self, segments: &SegmentRing, events: &mut EventWriter<'_>) {
        let output = events.discard_pending();
        let high = pulses_high_after(output, events);
        if let Some(steps) = steps_after(output, segments, events) {
            self.set_steps(steps);
        }
        segments.discard_pending();
        self.clear_steps();
        // wcet-bound: axes
        for end in self.pulse_end_slots {
            self.slots.remove(end);
        }
        self.add_all_pulse_ends(high);
        // The time goes on from the event output last, which is as good as at a slot's end.
        let free = self.cursor.free_slot.wrapping_add(1);
        self.cursor = Cursor {
            free_slot: free,
            last_ticks: 0,
            is_at_boundary: false,
        };
        (self.base_slot, self.offset_ticks, self.ticks) = (free, 0, 0);
        self.is_open = false;
        self.is_standstill = false;
        // What was prepared ahead is no more; a later segment must not begin at the same time.
        self.clock_ticks = segments.played_start_ticks().wrapping_add(1);
        self.next_event_number = output;
    }

    /// Drops the steps of the segment that has no events yet, after a fault: the position is where
    /// the events end.
    pub fn discard_open_segment(&mut self) {
        if !self.is_open {
            return;
        }
        // wcet-bound: axes
        for axis in 0..AXES {
            let is_negative = self.directions >> axis & 1 != 0;
            self.withdraw_steps(axis, is_negative, self.axes[axis].remaining);
        }
        self.clear_steps();
    }

    /// The segment has no more steps.
    fn clear_steps(&mut self) {
        self.axes = [NO_STEPS; AXES];
        (self.moving_axes, self.reversing_axes) = (0, 0);
    }

    /// Ends these pulses, and no others, when the longest of them may end.
    fn add_all_pulse_ends(&mut self, high: u32) {
        let free = self.cursor.free_slot.wrapping_add(1);
        let end = free.wrapping_add(pulse_slots(self.pulse_ticks));
        if high != 0 {
            self.slots.add_pulse_end(end, high);
        }
        // wcet-bound: axes
        for (axis, last) in self.pulse_end_slots.iter_mut().enumerate() {
            *last = if high >> axis & 1 == 0 { free } else { end };
        }
    }

    /// The position of an axis without so many steps that it will not make.
    fn withdraw_steps(&mut self, axis: usize, is_negative: bool, missing: u32) {
        let missing = i64::from(missing) << 32;
        let missing = if is_negative { -missing } else { missing };
        let position = &mut self.position[axis].0;
        *position = position.wrapping_sub(missing);
    }

    /// Whether a segment has begun that has no events yet: call [`Generator::push_events`] before the next.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }

    /// End of everything generated, on the generator's clock, wrapping ticks.
    #[must_use]
    pub const fn clock_ticks(&self) -> u32 {
        self.clock_ticks
    }

    /// Begins a segment. The one before must be finished, and `segments` must have room.
    pub fn begin(&mut self, segment: &Segment, segments: &SegmentRing) {
        self.begin_at_end(segment.ticks);
        let slots = (self.offset_ticks + self.ticks) / SLOT_TICKS;
        let most = slots / (pulse_slots(self.pulse_ticks) + PULSE_LOW_SLOTS) + 1;
        let duration = segment.ticks as f32;
        let rate = 1.0 / duration;
        let mut directions = self.directions;
        let mut leading = 0;
        let begin = self.steps();
        let latest = segment.ticks.saturating_sub(SLOT_TICKS);
        // wcet-bound: axes
        for axis in 0..AXES {
            let motion = segment.axes[axis];
            let (mut steps, is_negative) =
                plan_axis(self.position[axis], motion, duration, rate, latest);
            self.position[axis] = motion.to;
            if steps.remaining != 0 {
                directions = directions & !(1 << axis) | u8::from(is_negative) << axis;
                self.moving_axes |= 1 << axis;
            }
            // Faster than pulses can be: the others come with the next segment. As the pace changes
            // evenly, the last of these is behind the segment by a quarter of it and two pulses at
            // most.
            if steps.remaining > most {
                self.withdraw_steps(axis, is_negative, steps.remaining - most);
                steps.remaining = most;
            }
            if steps.remaining > leading {
                leading = steps.remaining;
                self.dominant_axis = axis;
            }
            self.max_events += 2 * steps.remaining;
            self.axes[axis] = steps;
        }
        // Axes keep clear of the segment's end: its next step may follow at once. But the one with
        // the most steps keeps its time.
        if let Some(leader) = self.axes.get_mut(self.dominant_axis) {
            leader.set_latest(segment.ticks);
        }
        if self.moving_axes != 0 {
            self.reversing_axes = u32::from(directions ^ self.directions);
            if self.directions_unknown {
                self.reversing_axes = ALL_AXES;
            }
            self.directions_unknown = false;
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
        // wcet-bound: axes
        for axis in &mut self.axes {
            *axis = NO_STEPS;
        }
        self.begin_at_end(SLOT_TICKS);
        self.is_standstill = true;
        self.directions_unknown = true;
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
        // wcet-bound: axes
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

    /// Puts a change of directions before the steps of the segment, or finds that one axis moves
    /// alone at an even pace.
    fn order(&mut self) -> Option<Alone> {
        let base = self.base_slot;
        let mut high = 0;
        let mut slot = self.cursor.free_slot;
        // wcet-bound: axes
        for (axis, end) in self.pulse_end_slots.iter().enumerate() {
            if is_not_before(*end, base) {
                high |= 1 << axis;
                let after = end.wrapping_add(1);
                if self.reversing_axes >> axis & 1 != 0 && is_not_before(after, slot) {
                    slot = after;
                }
            }
        }
        if self.reversing_axes != 0 {
            let turn = self.slots.add_direction_change(slot, self.directions);
            self.first_slot = turn.wrapping_sub(base).wrapping_add(1);
            self.first_slot_reversing = self.first_slot + DIRECTION_SETUP_SLOTS - 1;
            return None;
        }
        if !self.moving_axes.is_power_of_two() || high & !self.moving_axes != 0 {
            return None;
        }
        let (steps, end) = (
            self.axes.get(self.dominant_axis)?,
            *self.pulse_end_slots.get(self.dominant_axis)?,
        );
        // Nothing may come so shortly before the first step that this has to wait.
        let earliest = self.time_of(end.wrapping_add(PULSE_LOW_SLOTS));
        let earliest = earliest
            .max(self.cursor.last_ticks + SLOT_TICKS_SIGNED - self.offset_ticks.cast_signed());
        if !steps.is_slow(self.pulse_ticks) || steps.next_ticks.cast_signed() < earliest {
            return None;
        }
        let due = (high != 0).then(|| {
            self.slots.remove(end);
            self.time_of(end)
        });
        Some(Alone {
            mask: self.moving_axes,
            due,
        })
    }

    /// When a slot begins, ticks from the segment's start.
    fn time_of(&self, slot: u32) -> i32 {
        let slots = slot.wrapping_sub(self.base_slot).cast_signed();
        slots * SLOT_TICKS_SIGNED - self.offset_ticks.cast_signed()
    }

    /// Puts the events of the segment, which tells; or nothing, while there is no room for all. Room
    /// for 3.5 ms of events and a segment of 1.5 ms is there up to 200 000 steps per second of all axes
    /// together: the proof looks for no higher rate.
    pub fn push_events(&mut self, events: &mut EventWriter<'_>) -> bool {
        let mut events = events.begin();
        if events.room() < self.max_events.min(EVENT_RING as u32) {
            return false;
        }
        if let Some(alone) = self.order() {
            self.put_alone(alone, &mut events);
        } else if self.moving_axes != 0 {
            self.place_all();
        }
        self.close(&mut events);
        self.next_event_number = events.number();
        true
    }

    /// The events of an axis that moves alone.
    fn put_alone(&mut self, alone: Alone, events: &mut EventBatch<'_>) {
        let axes = self
            .axes
            .get(self.dominant_axis)
            .zip(self.pulse_end_slots.get_mut(self.dominant_axis));
        let Some((steps, last)) = axes else {
            return;
        };
        let offset = self.offset_ticks.cast_signed();
        let mut cursor = self.cursor;
        cursor.last_ticks -= offset;
        let due = alone.put(*steps, self.pulse_ticks, &mut cursor, events);
        cursor.last_ticks += offset;
        // No event of another kind comes before the end of its slot.
        let slot = (cursor.last_ticks.max(0) / SLOT_TICKS_SIGNED).cast_unsigned();
        cursor.free_slot = self.base_slot.wrapping_add(slot + 1);
        self.cursor = cursor;
        self.last_step_slot = slot;
        let after = (due + offset).max(0).cast_unsigned().div_ceil(SLOT_TICKS);
        *last = self.base_slot.wrapping_add(after);
        self.slots.add_pulse_end(*last, alone.mask);
    }

    /// Puts the steps of all axes into the slots. The one with the most steps comes last: it keeps
    /// its time, where an error weighs most. So does what follows the segment.
    fn place_all(&mut self) {
        let mut axis = self.dominant_axis;
        // wcet-bound: axes
        for _ in 0..AXES {
            axis = if axis + 1 < AXES { axis + 1 } else { 0 };
            self.place(axis);
        }
        let end = self.offset_ticks + self.ticks;
        let slot = self.base_slot.wrapping_add(end / SLOT_TICKS);
        self.slots
            .move_neighbours_to_slot_start(slot, 1 << self.dominant_axis);
    }

    /// Puts the steps of an axis into the slots, and the ends of their pulses.
    #[inline]
    fn place(&mut self, axis: usize) {
        let (Some(steps), Some(end)) = (self.axes.get(axis), self.pulse_end_slots.get_mut(axis))
        else {
            return;
        };
        if steps.remaining == 0 {
            return;
        }
        let mask = 1 << axis;
        let first = if self.reversing_axes & mask != 0 {
            self.first_slot_reversing
        } else {
            self.first_slot
        };
        // What is in its way: for axes that others need not make way for, anything.
        let stop = if axis == self.dominant_axis {
            mask
        } else {
            ALL_AXES
        };
        let base = self.base_slot;
        let low = end.wrapping_add(PULSE_LOW_SLOTS).wrapping_sub(base);
        let mut placing = Placing {
            base,
            offset: self.offset_ticks,
            mask,
            stop,
            pulse: pulse_slots(self.pulse_ticks),
            low: PULSE_LOW_SLOTS,
            earliest: first.cast_signed().max(low.cast_signed()).cast_unsigned(),
            slot: 0,
        };
        let apart = placing.pulse + placing.low;
        let slot = (self.offset_ticks + steps.next_ticks) / SLOT_TICKS;
        if steps.is_apart(apart * SLOT_TICKS) && slot >= placing.earliest {
            if axis == self.dominant_axis {
                placing.put_ahead(&mut self.slots, steps);
            } else {
                placing.put_behind(&mut self.slots, steps);
            }
        } else if steps.is_periodic() {
            placing.put_evenly(&mut self.slots, steps);
        } else {
            placing.put_exactly(&mut self.slots, steps);
        }
        *end = base.wrapping_add(placing.earliest - PULSE_LOW_SLOTS);
        self.last_step_slot = self.last_step_slot.max(placing.slot);
    }

    /// Puts what is in the slots of the segment, and an event before its end if there is none.
    fn close(&mut self, events: &mut EventBatch<'_>) {
        let mut end = ((self.offset_ticks + self.ticks) / SLOT_TICKS).max(self.last_step_slot + 1);
        if self.is_standstill {
            // wcet-bound: axes
            for last in &self.pulse_end_slots {
                let after = last
                    .wrapping_add(1)
                    .wrapping_sub(self.base_slot)
                    .cast_signed();
                end = end.max(after.max(0).cast_unsigned());
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
            let what = self.cursor.mark_boundary(StepEvent::NONE);
            events.push(self.cursor.schedule(before, what));
            events.publish();
            let slot = (self.cursor.last_ticks.max(0) / SLOT_TICKS_SIGNED).cast_unsigned();
            self.cursor.free_slot = base.wrapping_add(slot + 1);
        }
        // Events that had to wait for others stretch the segment.
        let used = self
            .cursor
            .free_slot
            .wrapping_sub(base)
            .wrapping_sub(1)
            .cast_signed();
        let over =
            (used * SLOT_TICKS_SIGNED - (self.offset_ticks + self.ticks).cast_signed()).max(0);
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

/// Whether a slot is not before another.
#[inline]
const fn is_not_before(slot: u32, other: u32) -> bool {
    slot.wrapping_sub(other).cast_signed() >= 0
}
