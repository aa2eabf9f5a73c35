//! Step times: from a segment's motion to the events of the step interrupt.
//!
//! The number of steps comes from exact integer positions, so rounding moves an edge by a fraction
//! of a tick and never adds or loses one. The axes' steps are merged in time order with the ends of
//! pulses; steps closer than [`EVENT_SPACING_TICKS`] share an event.

use super::{
    AxisMotion, DIRECTION_SETUP_TICKS, EVENT_SPACING_TICKS, EventWriter, SegmentInfo, StepCounts,
    StepEvent,
    axis_steps::{AxisSteps, EVEN_BITS, NO_STEPS, plan_axis},
    history::{high_after, steps_after},
    pulses::{Cursor, High, LOW, SPACING},
    ring::EventBatch,
};
use crate::{
    axis::{AXES, Axes},
    machine::Power,
    units::{FineSteps, TICKS_PER_US},
};

/// Events that one step can need: ends of pulses before it, waits, and itself.
const EVENTS_PER_STEP: u32 = 8;
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

/// Turns segments into events, resumable at any event.
#[derive(Debug)]
pub struct Generator {
    axes: [AxisSteps; AXES],
    /// Exact position of each axis at the segment's end.
    position: Axes<FineSteps>,
    /// The segment's duration, ticks.
    ticks: u32,
    cursor: Cursor,
    /// The segment is not finished.
    is_open: bool,
    /// The segment has no event yet.
    is_boundary: bool,
    /// Axes that reverse with the segment, which has no event yet.
    turns: u32,
    /// The axis with the most steps in the segment.
    leader: usize,
    /// The segment is the standstill after the last one.
    is_rest: bool,
    directions: u8,
    pulse_ticks: i32,
    /// End of everything generated, on the generator's clock.
    clock_ticks: u32,
    /// Number of the event that is put next.
    next_event: u32,
}

impl Generator {
    /// At rest at zero, for pulses of 10 µs.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            axes: [NO_STEPS; AXES],
            position: Axes([FineSteps(0); AXES]),
            ticks: 0,
            cursor: Cursor::NEW,
            is_open: false,
            is_boundary: false,
            turns: 0,
            leader: 0,
            is_rest: false,
            directions: 0,
            pulse_ticks: (10 * TICKS_PER_US).cast_signed(),
            clock_ticks: 0,
            next_event: 0,
        }
    }

    /// Sets the length of a pulse, µs. A shorter one than events are apart lasts as long as that.
    pub fn set_pulse_us(&mut self, pulse_us: u8) {
        self.pulse_ticks = (u32::from(pulse_us) * TICKS_PER_US)
            .cast_signed()
            .max(SPACING);
    }

    /// Exact position at the end of all segments begun.
    #[must_use]
    pub fn position(&self) -> Axes<FineSteps> {
        self.position
    }

    /// Whole steps at the end of all segments begun.
    #[must_use]
    pub fn steps(&self) -> Axes<i32> {
        self.position.map(|position| position.nearest().0)
    }

    /// Replaces the position, at rest. Other whole steps are known everywhere once a standstill has
    /// been played with them: see [`Generator::rest`].
    pub fn settle(&mut self, position: Axes<FineSteps>) {
        self.position = position;
    }

    /// Settles on whole steps, at rest.
    pub fn settle_on(&mut self, steps: Axes<i32>) {
        self.settle(steps.map(|steps| FineSteps(i64::from(steps) << 32)));
    }

    /// Ends a cut, when the step interrupt has stopped: what it has not played is dropped, and the
    /// position is exactly that of the steps output. A standstill must follow, which ends the
    /// pulses.
    pub fn cut_off(&mut self, counts: &StepCounts, events: &mut EventWriter<'_>) {
        let output = events.drop_waiting();
        if let Some(steps) = steps_after(output, counts, events) {
            self.settle_on(steps);
        }
        self.directions = counts.directions();
        counts.drop_waiting();
        self.axes = [NO_STEPS; AXES];
        self.cursor = Cursor::cut_off(high_after(output, events), self.pulse_ticks);
        self.ticks = 0;
        self.turns = 0;
        self.is_open = false;
        self.is_boundary = false;
        self.is_rest = false;
        // What was prepared ahead is no more; a later segment must not begin at the same time.
        self.clock_ticks = counts.played_ticks().wrapping_add(1);
        self.next_event = output;
    }

    /// Drops the steps that the segment has not come to, after a fault: the position is where the
    /// events end.
    pub fn cut(&mut self) {
        // wcet-bound: 6
        for (index, axis) in self.axes.iter_mut().enumerate() {
            let is_negative = self.directions >> index & 1 != 0;
            let missing = i64::from(axis.left) << 32;
            let missing = if is_negative { -missing } else { missing };
            let position = &mut self.position[index].0;
            *position = position.wrapping_sub(missing);
            *axis = NO_STEPS;
        }
    }

    /// Whether a segment is unfinished: call [`Generator::fill`] before the next.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }

    /// End of everything generated, on the generator's clock, wrapping ticks.
    #[must_use]
    pub const fn clock_ticks(&self) -> u32 {
        self.clock_ticks
    }

    /// Begins a segment. The one before must be finished, and `counts` must have room.
    pub fn begin(&mut self, segment: &Segment, counts: &StepCounts) {
        let duration = segment.ticks as f32;
        let rate = 1.0 / duration;
        let mut directions = self.directions;
        let mut most = 0;
        let begin = self.steps();
        // wcet-bound: 6
        for axis in 0..AXES {
            let motion = segment.axes[axis];
            let (steps, is_negative) =
                plan_axis(self.position[axis], motion, duration, rate, segment.ticks);
            if steps.left != 0 {
                directions = directions & !(1 << axis) | u8::from(is_negative) << axis;
            }
            if steps.left > most {
                most = steps.left;
                self.leader = axis;
            }
            self.axes[axis] = steps;
            self.position[axis] = motion.to;
        }
        self.open(segment.ticks, directions);
        counts.announce(&SegmentInfo {
            start_ticks: self.clock_ticks,
            steps: begin,
            first_event: self.next_event,
            directions,
            is_rest: false,
            feed_mm_min: segment.feed_mm_min,
            line: segment.line,
            duty: segment.power.duty,
            spindle_rpm: segment.power.rpm,
        });
        self.clock_ticks = self.clock_ticks.wrapping_add(segment.ticks);
    }

    /// Begins the standstill after the last segment: ends all pulses and lets the queue run empty.
    pub fn rest(&mut self, power: Power, counts: &StepCounts) {
        // wcet-bound: 6
        for axis in &mut self.axes {
            *axis = NO_STEPS;
        }
        self.open(EVENT_SPACING_TICKS, self.directions);
        self.is_rest = true;
        counts.announce(&SegmentInfo {
            start_ticks: self.clock_ticks,
            steps: self.steps(),
            first_event: self.next_event,
            directions: self.directions,
            is_rest: true,
            feed_mm_min: 0.0,
            line: 0,
            duty: power.duty,
            spindle_rpm: power.rpm,
        });
        self.clock_ticks = self.clock_ticks.wrapping_add(EVENT_SPACING_TICKS);
    }

    fn open(&mut self, ticks: u32, directions: u8) {
        self.cursor.later_by(self.ticks.cast_signed());
        self.ticks = ticks;
        self.is_open = true;
        self.is_boundary = true;
        self.turns = u32::from(directions ^ self.directions);
        self.directions = directions;
    }

    /// Generates events until the segment is finished, which it tells, or the queue is full.
    pub fn fill(&mut self, events: &mut EventWriter<'_>) -> bool {
        let mut events = events.begin();
        if events.room() < EVENTS_PER_STEP {
            return false;
        }
        if self.turns != 0 {
            self.turn(&mut events);
        }
        if self.is_boundary {
            self.first_step(&mut events);
        }
        let mut cursor = self.cursor;
        let (end, pulse_ticks) = (self.ticks, self.pulse_ticks);
        let is_done = match self.alone(&cursor) {
            Some(axis) => fill_one(axis, &mut cursor, end, pulse_ticks, &mut events),
            None => self.fill_all(&mut cursor, &mut events),
        };
        self.cursor = cursor;
        let closes = is_done && events.room() >= EVENTS_PER_STEP;
        if closes {
            self.close(&mut events);
        }
        self.next_event = events.number();
        closes
    }

    /// The first event of a segment, if it has a step.
    fn first_step(&mut self, events: &mut EventBatch<'_>) {
        if let Some((time, mask)) = self.next_steps() {
            let first = events.number();
            let pulse_ticks = self.pulse_ticks;
            self.cursor.step(time, mask, pulse_ticks, events);
            self.publish_first(first, events);
        }
    }

    fn publish_first(&mut self, first: u32, events: &mut EventBatch<'_>) {
        events.mark_boundary(first);
        events.publish();
        self.is_boundary = false;
    }

    /// The only axis with steps left, if no pulse of another one is high: with the axis's mask.
    fn alone(&mut self, cursor: &Cursor) -> Option<(&mut AxisSteps, u32)> {
        let mut mask = 0;
        // wcet-bound: 6
        for (index, axis) in self.axes.iter().enumerate() {
            mask |= u32::from(axis.left != 0) << index;
        }
        let others = cursor.high() & !mask;
        if !mask.is_power_of_two() || others != 0 {
            return None;
        }
        let axis = self.axes.get_mut(mask.trailing_zeros() as usize)?;
        Some((axis, mask))
    }

    /// All axes' events in time order.
    #[inline(never)]
    fn fill_all(&mut self, cursor: &mut Cursor, events: &mut EventBatch<'_>) -> bool {
        let (mut here, mut out) = (*cursor, *events);
        let mut is_done = false;
        // Steps that are not apart share an event: `SEGMENT_EVENTS`, and the end.
        // wcet-bound: 1334
        while !is_done && out.room() >= EVENTS_PER_STEP {
            match self.next_steps() {
                Some((time, mask)) => {
                    here.step(time, mask, self.pulse_ticks, &mut out);
                    out.publish();
                }
                None => is_done = true,
            }
        }
        (*cursor, *events) = (here, out);
        is_done
    }

    /// The axes that step next, moved on, and when.
    #[inline]
    fn next_steps(&mut self) -> Option<(i32, u32)> {
        let mut first = u32::MAX;
        // wcet-bound: 6
        for axis in &self.axes {
            first = first.min(axis.next);
        }
        if first == u32::MAX {
            return None;
        }
        // The axis with the most steps keeps its time, where an error weighs most. The others keep
        // clear of the segment's end: its next step may follow at once.
        let leading = self.axes.get(self.leader).map_or(first, |axis| axis.next);
        let time = if leading.wrapping_sub(first) < EVENT_SPACING_TICKS {
            leading
        } else {
            first.min(self.ticks.saturating_sub(EVENT_SPACING_TICKS))
        };
        let mut mask = 0;
        // wcet-bound: 6
        for (index, axis) in self.axes.iter_mut().enumerate() {
            // The time of an axis without steps, wrapped, is never that near.
            if axis.next.wrapping_sub(first) < EVENT_SPACING_TICKS {
                mask |= 1 << index;
                axis.advance(self.ticks);
            }
        }
        Some((time.cast_signed(), mask))
    }

    /// Ends the pulses of axes that reverse, still in the segment before, and holds their steps
    /// back. Directions change when the event before the segment's first one is played.
    #[inline(never)]
    fn turn(&mut self, events: &mut EventBatch<'_>) {
        if self.cursor.high() & self.turns != 0 {
            self.cursor.end_all(events);
            // Whatever becomes of the segment: a pulse whose end were lost would never end.
            events.publish();
        }
        // An axis that shares an event may step earlier than it would alone.
        let earliest = self.cursor.last + DIRECTION_SETUP_TICKS.cast_signed() + SPACING;
        let earliest = earliest.max(0).cast_unsigned();
        // wcet-bound: 6
        for (index, axis) in self.axes.iter_mut().enumerate() {
            if self.turns >> index & 1 != 0 && axis.left != 0 {
                axis.next = axis.next.max(earliest);
            }
        }
        self.turns = 0;
    }

    /// Finishes the segment: one without steps still has an event, at its end.
    #[inline(never)]
    fn close(&mut self, events: &mut EventBatch<'_>) {
        let end = self.ticks.cast_signed();
        if self.is_rest {
            self.is_rest = false;
            self.cursor.end_all(events);
        }
        if self.is_boundary {
            let time = end.max(self.cursor.last + SPACING);
            let first = events.number();
            self.cursor.put(time, 0, 0, events);
            self.publish_first(first, events);
        }
        // What comes next may come late: pulses do not wait for another segment to end, unless they
        // would be in the way of its first step.
        // wcet-bound: 3
        while self.cursor.oldest != High::NONE && self.cursor.oldest.due() < end - SPACING {
            self.cursor.end_oldest(events);
        }
        events.publish();
        // Events that had to wait for others stretch the segment.
        let over = self.cursor.last.saturating_sub(end).max(0).cast_unsigned();
        self.ticks += over;
        self.clock_ticks = self.clock_ticks.wrapping_add(over);
        self.is_open = false;
    }
}

impl Default for Generator {
    fn default() -> Self {
        Self::new()
    }
}

/// The events of an axis that moves alone: every pulse ends before the next begins.
fn fill_one(
    (axis, mask): (&mut AxisSteps, u32),
    cursor: &mut Cursor,
    end: u32,
    pulse_ticks: i32,
    events: &mut EventBatch<'_>,
) -> bool {
    let mut steps = *axis;
    if cursor.oldest == High::NONE {
        cursor.step(steps.next.cast_signed(), mask, pulse_ticks, events);
        steps.advance(end);
    }
    let pulse_end = StepEvent::new(pulse_ticks.cast_unsigned(), 0, mask);
    let mut last = cursor.last;
    let mut out = *events;
    let many = steps.evenly(
        (last + pulse_ticks).cast_unsigned(),
        pulse_ticks.cast_unsigned(),
    );
    if let Some(many) = many {
        let count = many.min((out.room() / 2).saturating_sub(EVENTS_PER_STEP / 2));
        last = put_evenly(&mut steps, count, last, pulse_end, &mut out);
    }
    // wcet-bound: 512
    while steps.left != 0 && out.room() >= EVENTS_PER_STEP {
        let ended = last + pulse_ticks;
        let time = steps.next.cast_signed().max(ended + LOW);
        out.put(pulse_end);
        out.put(StepEvent::new((time - ended).cast_unsigned(), mask, 0));
        out.publish();
        last = time;
        steps.advance(end);
    }
    *events = out;
    events.publish();
    *axis = steps;
    cursor.last = last;
    cursor.ended = 0;
    cursor.oldest = High::new(mask, last + pulse_ticks);
    steps.left == 0
}

/// Steps at an even pace, all alike: each ends the pulse before it. The time of the last one.
fn put_evenly(
    steps: &mut AxisSteps,
    count: u32,
    last: i32,
    pulse_end: StepEvent,
    out: &mut EventBatch<'_>,
) -> i32 {
    let mask = pulse_end.drop();
    let pulse_ticks = pulse_end.ticks();
    let (mut fine, period) = (steps.even_time, steps.even_period);
    let mut last = last.cast_unsigned();
    let mut batch = *out;
    // wcet-bound: 511
    for _ in 0..count {
        let time = fine >> EVEN_BITS;
        let low_ticks = time.wrapping_sub(last).wrapping_sub(pulse_ticks);
        batch.put(pulse_end);
        batch.put(StepEvent::new(low_ticks, mask, 0));
        batch.publish();
        last = time;
        fine = fine.wrapping_add(period);
    }
    *out = batch;
    steps.left -= count;
    steps.even_time = fine;
    steps.next = fine >> EVEN_BITS;
    last.cast_signed()
}
