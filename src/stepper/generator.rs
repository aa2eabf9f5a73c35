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
    position::{high_after, steps_after},
    ring::EventBatch,
    slots::{Cursor, SLOT, Slots},
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
const SETUP_SLOTS: u32 = 1 + DIRECTION_SETUP_TICKS.div_ceil(SLOT_TICKS);
/// So many slots ago, nothing matters any more.
const LONG_AGO: u32 = 16;

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
    base: u32,
    offset: u32,
    cursor: Cursor,
    /// The segment has begun, and its events have not been put.
    is_open: bool,
    /// It has so many events at most.
    most_events: u32,
    /// Axes that step in it.
    moving: u32,
    /// The slot in which the segment's last step is, from its first on.
    last_step: u32,
    /// The first slot, from the segment's first on, in which a step may be: that of an axis that
    /// reverses, and of another.
    first_turned: u32,
    first: u32,
    /// Axes that reverse in the segment.
    turns: u32,
    /// The direction outputs may be others: before the first motion, and after a standstill, in
    /// which settings may change.
    is_unsure: bool,
    /// The axis with the most steps in the segment.
    leader: usize,
    /// The segment is the standstill after the last one.
    is_rest: bool,
    directions: u8,
    pulse_ticks: u32,
    /// The slot in which the last pulse of each axis ends.
    ends: [u32; AXES],
    /// End of everything generated, on the generator's clock.
    clock_ticks: u32,
    /// Number of the event that is put next.
    next_event: u32,
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
            base: 0,
            offset: 0,
            cursor: Cursor {
                free: 0,
                last: 0,
                is_boundary: false,
            },
            is_open: false,
            most_events: 0,
            moving: 0,
            last_step: 0,
            first_turned: 0,
            first: 0,
            turns: 0,
            is_unsure: true,
            leader: 0,
            is_rest: false,
            directions: 0,
            pulse_ticks: 10 * TICKS_PER_US,
            ends: [0; AXES],
            clock_ticks: 0,
            next_event: 0,
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
        let high = high_after(output, events);
        if let Some(steps) = steps_after(output, segments, events) {
            self.set_steps(steps);
        }
        segments.discard_pending();
        self.forget();
        // wcet-bound: axes
        for end in self.ends {
            self.slots.clear(end);
        }
        self.end_all(high);
        // The time goes on from the event output last, which is as good as at a slot's end.
        let free = self.cursor.free.wrapping_add(1);
        self.cursor = Cursor {
            free,
            last: 0,
            is_boundary: false,
        };
        (self.base, self.offset, self.ticks) = (free, 0, 0);
        self.is_open = false;
        self.is_rest = false;
        // What was prepared ahead is no more; a later segment must not begin at the same time.
        self.clock_ticks = segments.played_start_ticks().wrapping_add(1);
        self.next_event = output;
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
            self.take_back(axis, is_negative, self.axes[axis].left);
        }
        self.forget();
    }

    /// The segment has no more steps.
    fn forget(&mut self) {
        self.axes = [NO_STEPS; AXES];
        (self.moving, self.turns) = (0, 0);
    }

    /// Ends these pulses, and no others, when the longest of them may end.
    fn end_all(&mut self, high: u32) {
        let free = self.cursor.free.wrapping_add(1);
        let end = free.wrapping_add(pulse_slots(self.pulse_ticks));
        if high != 0 {
            self.slots.end(end, high);
        }
        // wcet-bound: axes
        for (axis, last) in self.ends.iter_mut().enumerate() {
            *last = if high >> axis & 1 == 0 { free } else { end };
        }
    }

    /// The position of an axis without so many steps that it will not make.
    fn take_back(&mut self, axis: usize, is_negative: bool, missing: u32) {
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
        self.open(segment.ticks);
        let slots = (self.offset + self.ticks) / SLOT_TICKS;
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
            if steps.left != 0 {
                directions = directions & !(1 << axis) | u8::from(is_negative) << axis;
                self.moving |= 1 << axis;
            }
            // Faster than pulses can be: the others come with the next segment. As the pace changes
            // evenly, the last of these is behind the segment by a quarter of it and two pulses at
            // most.
            if steps.left > most {
                self.take_back(axis, is_negative, steps.left - most);
                steps.left = most;
            }
            if steps.left > leading {
                leading = steps.left;
                self.leader = axis;
            }
            self.most_events += 2 * steps.left;
            self.axes[axis] = steps;
        }
        // Axes keep clear of the segment's end: its next step may follow at once. But the one with
        // the most steps keeps its time.
        if let Some(leader) = self.axes.get_mut(self.leader) {
            leader.end_at(segment.ticks);
        }
        if self.moving != 0 {
            self.turns = u32::from(directions ^ self.directions);
            if self.is_unsure {
                self.turns = ALL_AXES;
            }
            self.is_unsure = false;
            self.directions = directions;
        }
        segments.push(&SegmentInfo {
            start_ticks: self.clock_ticks,
            steps: begin,
            first_event: self.next_event,
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
        self.open(SLOT_TICKS);
        self.is_rest = true;
        self.is_unsure = true;
        segments.push(&SegmentInfo {
            start_ticks: self.clock_ticks,
            steps: self.steps(),
            first_event: self.next_event,
            directions: self.directions,
            is_standstill: true,
            feed_mm_min: 0.0,
            line: 0,
            duty: power.duty,
            spindle_rpm: power.rpm,
        });
        self.clock_ticks = self.clock_ticks.wrapping_add(SLOT_TICKS);
    }

    fn open(&mut self, ticks: u32) {
        let slots = (self.offset + self.ticks) / SLOT_TICKS;
        self.offset = self.offset + self.ticks - slots * SLOT_TICKS;
        self.base = self.base.wrapping_add(slots);
        let passed = slots.wrapping_mul(SLOT_TICKS).cast_signed();
        self.cursor.last = self.cursor.last.saturating_sub(passed);
        self.cursor.is_boundary = true;
        if !is_ahead(self.cursor.free, self.base) {
            self.cursor.free = self.base;
        }
        // wcet-bound: axes
        for end in &mut self.ends {
            if !is_ahead(*end, self.base.wrapping_sub(LONG_AGO)) {
                *end = self.base.wrapping_sub(LONG_AGO);
            }
        }
        self.ticks = ticks;
        self.is_open = true;
        self.most_events = OTHER_EVENTS;
        (self.moving, self.turns) = (0, 0);
        self.last_step = 0;
        self.first = self.cursor.free.wrapping_sub(self.base);
        self.first_turned = self.first;
    }

    /// Puts a change of directions before the steps of the segment, or finds that one axis moves
    /// alone at an even pace.
    fn order(&mut self) -> Option<Alone> {
        let base = self.base;
        let mut high = 0;
        let mut slot = self.cursor.free;
        // wcet-bound: axes
        for (axis, end) in self.ends.iter().enumerate() {
            if is_ahead(*end, base) {
                high |= 1 << axis;
                let after = end.wrapping_add(1);
                if self.turns >> axis & 1 != 0 && is_ahead(after, slot) {
                    slot = after;
                }
            }
        }
        if self.turns != 0 {
            let turn = self.slots.turn(slot, self.directions);
            self.first = turn.wrapping_sub(base).wrapping_add(1);
            self.first_turned = self.first + SETUP_SLOTS - 1;
            return None;
        }
        if !self.moving.is_power_of_two() || high & !self.moving != 0 {
            return None;
        }
        let (steps, end) = (self.axes.get(self.leader)?, *self.ends.get(self.leader)?);
        // Nothing may come so shortly before the first step that this has to wait.
        let earliest = self.time_of(end.wrapping_add(PULSE_LOW_SLOTS));
        let earliest = earliest.max(self.cursor.last + SLOT - self.offset.cast_signed());
        if !steps.is_slow(self.pulse_ticks) || steps.next.cast_signed() < earliest {
            return None;
        }
        let due = (high != 0).then(|| {
            self.slots.clear(end);
            self.time_of(end)
        });
        Some(Alone {
            mask: self.moving,
            due,
        })
    }

    /// When a slot begins, ticks from the segment's start.
    fn time_of(&self, slot: u32) -> i32 {
        let slots = slot.wrapping_sub(self.base).cast_signed();
        slots * SLOT - self.offset.cast_signed()
    }

    /// Puts the events of the segment, which tells; or nothing, while there is no room for all. Room
    /// for 3.5 ms of events and a segment of 1.5 ms is there up to 200 000 steps per second of all axes
    /// together: the proof looks for no higher rate.
    pub fn push_events(&mut self, events: &mut EventWriter<'_>) -> bool {
        let mut events = events.begin();
        if events.room() < self.most_events.min(EVENT_RING as u32) {
            return false;
        }
        if let Some(alone) = self.order() {
            self.put_alone(alone, &mut events);
        } else if self.moving != 0 {
            self.place_all();
        }
        self.close(&mut events);
        self.next_event = events.number();
        true
    }

    /// The events of an axis that moves alone.
    fn put_alone(&mut self, alone: Alone, events: &mut EventBatch<'_>) {
        let axes = self
            .axes
            .get(self.leader)
            .zip(self.ends.get_mut(self.leader));
        let Some((steps, last)) = axes else {
            return;
        };
        let offset = self.offset.cast_signed();
        let mut cursor = self.cursor;
        cursor.last -= offset;
        let due = alone.put(*steps, self.pulse_ticks, &mut cursor, events);
        cursor.last += offset;
        // No event of another kind comes before the end of its slot.
        let slot = (cursor.last.max(0) / SLOT).cast_unsigned();
        cursor.free = self.base.wrapping_add(slot + 1);
        self.cursor = cursor;
        self.last_step = slot;
        let after = (due + offset).max(0).cast_unsigned().div_ceil(SLOT_TICKS);
        *last = self.base.wrapping_add(after);
        self.slots.end(*last, alone.mask);
    }

    /// Puts the steps of all axes into the slots. The one with the most steps comes last: it keeps
    /// its time, where an error weighs most. So does what follows the segment.
    fn place_all(&mut self) {
        let mut axis = self.leader;
        // wcet-bound: axes
        for _ in 0..AXES {
            axis = if axis + 1 < AXES { axis + 1 } else { 0 };
            self.place(axis);
        }
        let end = self.offset + self.ticks;
        let slot = self.base.wrapping_add(end / SLOT_TICKS);
        self.slots.hurry(slot, 1 << self.leader);
    }

    /// Puts the steps of an axis into the slots, and the ends of their pulses.
    #[inline]
    fn place(&mut self, axis: usize) {
        let (Some(steps), Some(end)) = (self.axes.get(axis), self.ends.get_mut(axis)) else {
            return;
        };
        if steps.left == 0 {
            return;
        }
        let mask = 1 << axis;
        let first = if self.turns & mask != 0 {
            self.first_turned
        } else {
            self.first
        };
        // What is in its way: for axes that others need not make way for, anything.
        let stop = if axis == self.leader { mask } else { ALL_AXES };
        let base = self.base;
        let low = end.wrapping_add(PULSE_LOW_SLOTS).wrapping_sub(base);
        let mut placing = Placing {
            base,
            offset: self.offset,
            mask,
            stop,
            pulse: pulse_slots(self.pulse_ticks),
            low: PULSE_LOW_SLOTS,
            earliest: first.cast_signed().max(low.cast_signed()).cast_unsigned(),
            slot: 0,
        };
        let apart = placing.pulse + placing.low;
        let slot = (self.offset + steps.next) / SLOT_TICKS;
        if steps.is_apart(apart * SLOT_TICKS) && slot >= placing.earliest {
            if axis == self.leader {
                placing.put_ahead(&mut self.slots, steps);
            } else {
                placing.put_behind(&mut self.slots, steps);
            }
        } else if steps.is_even() {
            placing.put_evenly(&mut self.slots, steps);
        } else {
            placing.put_exactly(&mut self.slots, steps);
        }
        *end = base.wrapping_add(placing.earliest - PULSE_LOW_SLOTS);
        self.last_step = self.last_step.max(placing.slot);
    }

    /// Puts what is in the slots of the segment, and an event before its end if there is none.
    fn close(&mut self, events: &mut EventBatch<'_>) {
        let mut end = ((self.offset + self.ticks) / SLOT_TICKS).max(self.last_step + 1);
        if self.is_rest {
            // wcet-bound: axes
            for last in &self.ends {
                let after = last.wrapping_add(1).wrapping_sub(self.base).cast_signed();
                end = end.max(after.max(0).cast_unsigned());
            }
        }
        let (base, end) = (self.base, self.base.wrapping_add(end));
        if is_ahead(end, self.cursor.free) {
            self.slots.sweep(base, end, &mut self.cursor, events);
        }
        let before = end.wrapping_sub(1).wrapping_sub(base).cast_signed() * SLOT;
        // The segment ends less than two slots after that.
        let is_early = before - self.cursor.last >= (END_SLOTS - 2).cast_signed() * SLOT;
        if self.cursor.is_boundary || is_early && !self.is_rest {
            let what = self.cursor.mark(StepEvent::NONE);
            events.put(self.cursor.next(before, what));
            events.publish();
            let slot = (self.cursor.last.max(0) / SLOT).cast_unsigned();
            self.cursor.free = base.wrapping_add(slot + 1);
        }
        // Events that had to wait for others stretch the segment.
        let used = self
            .cursor
            .free
            .wrapping_sub(base)
            .wrapping_sub(1)
            .cast_signed();
        let over = (used * SLOT - (self.offset + self.ticks).cast_signed()).max(0);
        self.ticks += over.cast_unsigned();
        self.clock_ticks = self.clock_ticks.wrapping_add(over.cast_unsigned());
        self.is_rest = false;
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
const fn is_ahead(slot: u32, other: u32) -> bool {
    slot.wrapping_sub(other).cast_signed() >= 0
}
