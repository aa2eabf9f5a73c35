//! Step times: from a segment's motion to the events of the step interrupt.
//!
//! Within a segment each axis is a quadratic in time, q(τ) = vτ + aτ²/2 in steps, and step k falls
//! where q crosses half-way to it. The number of steps comes from exact integer positions, so
//! rounding moves an edge by a fraction of a tick and never adds or loses one. The axes' steps are
//! merged in time order; steps closer than [`EVENT_SPACING_TICKS`] share an event.
//!
//! Ends of pulses are events of the same list. An end may come late, and then shares the event of
//! the next step, as long as the axis stays low for [`PULSE_LOW_TICKS`] before its next pulse.

use super::{
    DIRECTION_SETUP_TICKS, EVENT_SPACING_TICKS, EventWriter, PULSE_LOW_TICKS, SegmentInfo,
    StepCounts, StepEvent, ring::EventBatch,
};
use crate::{
    axis::{AXES, Axes},
    math,
    units::{FineSteps, Steps, TICKS_PER_US},
};

/// Longest time that the end of a pulse waits to share an event, ticks.
const SHARE_TICKS: i32 = (10 * TICKS_PER_US).cast_signed();
/// Events that one step can need: ends of pulses before it, waits, and itself.
const EVENTS_PER_STEP: u32 = 8;
/// Binary places of a step's time at an even pace: 2 ms, the longest segment, fill the word, and a
/// thousand periods are off by a thirtieth of a tick at most.
const EVEN_BITS: u32 = 14;
/// What the times of steps at an even pace may be off the true ones, ticks.
const EVEN_ERROR_TICKS: f32 = 0.25;
/// A time before anything that still matters, ticks.
const LONG_AGO: i32 = 1 << 24;
/// [`EVENT_SPACING_TICKS`] and [`PULSE_LOW_TICKS`] as differences of times.
const SPACING: i32 = EVENT_SPACING_TICKS.cast_signed();
const LOW: i32 = PULSE_LOW_TICKS.cast_signed();
/// Relative change of speed from one step to the next above which a step time is computed by the
/// quadratic formula instead of from the step before.
const SLOW_CHANGE: f32 = 0.01;

/// The motion of one axis over a segment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AxisMotion {
    /// Exact position at the end.
    pub to: FineSteps,
    /// Acceleration, steps per tick².
    pub acceleration: f32,
}

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
}

/// The steps of one axis that are still to come in the segment.
#[derive(Debug, Clone, Copy, Default)]
struct AxisSteps {
    /// Steps left.
    left: u32,
    /// Time of the next step, ticks from the segment's start; `u32::MAX` when none is left.
    next: u32,
    /// Speed at the segment's start, steps per tick.
    speed: f32,
    /// Half the acceleration, steps per tick².
    half_acceleration: f32,
    /// Distance of the next step from the segment's start, steps.
    distance: f32,
    /// Exact time of the next step, ticks.
    time: f32,
    /// Inverse of the speed at that time, ticks per step.
    period: f32,
    /// The same two in [`Pace::Even`], with [`EVEN_BITS`] binary places.
    even_time: u32,
    even_period: u32,
    pace: Pace,
}

/// How the time of a step follows from the one before.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Pace {
    /// By the same period: the speed does not change.
    #[default]
    Even,
    /// By extrapolation: the speed changes little from step to step.
    Smooth,
    /// By the quadratic formula.
    Steep,
}

const NO_STEPS: AxisSteps = AxisSteps {
    left: 0,
    next: u32::MAX,
    speed: 0.0,
    half_acceleration: 0.0,
    distance: 0.0,
    time: 0.0,
    period: 0.0,
    even_time: 0,
    even_period: 0,
    pace: Pace::Even,
};

impl AxisSteps {
    /// The crossing at `distance` by the quadratic formula, in the form that never cancels.
    fn solve(&self) -> f32 {
        let square = self.speed * self.speed + 4.0 * self.half_acceleration * self.distance;
        2.0 * self.distance / math::max(self.speed + math::sqrt(square), 1.0e-12)
    }

    /// How many steps can follow alike, if any: at an even pace, slow enough for the pulses, the
    /// last one of the segment apart. The pulse before ends at `ended`.
    fn evenly(&self, ended: u32, pulse_ticks: u32) -> Option<u32> {
        let is_on_time = self.next == self.even_time >> EVEN_BITS
            && self.next.wrapping_sub(ended) < 1 << 30
            && self.next.wrapping_sub(ended) >= PULSE_LOW_TICKS;
        let is_slow = self.even_period >> EVEN_BITS >= pulse_ticks + PULSE_LOW_TICKS;
        let is_even = self.pace == Pace::Even && self.left > 1;
        (is_even && is_on_time && is_slow).then(|| self.left - 1)
    }

    /// Moves on to the next step.
    #[inline]
    fn advance(&mut self, end: u32) {
        self.left -= 1;
        if self.left == 0 {
            self.next = u32::MAX;
            return;
        }
        if self.pace == Pace::Even {
            self.even_time = self.even_time.wrapping_add(self.even_period);
            self.next = (self.even_time >> EVEN_BITS).min(end);
            return;
        }
        self.distance += 1.0;
        if self.pace == Pace::Steep {
            self.time = self.solve();
        } else {
            // One Newton step for the inverse of the speed, one for the time.
            let speed = self.speed + 2.0 * self.half_acceleration * self.time;
            self.period *= 2.0 - speed * self.period;
            let guess = self.time + self.period;
            let reached = (self.speed + self.half_acceleration * guess) * guess;
            self.time = guess - (reached - self.distance) * self.period;
        }
        self.next = (self.time as u32).min(end);
    }
}

/// Pulses that are high and when they may end, in one word: mask and, above it, ticks from the
/// segment's start. Zero: none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct High(i32);

impl High {
    const NONE: Self = Self(0);
    const MASK_BITS: u32 = 6;

    #[inline]
    fn new(mask: u32, due: i32) -> Self {
        Self(due << Self::MASK_BITS | mask.cast_signed())
    }

    #[inline]
    fn mask(self) -> u32 {
        self.0.cast_unsigned() & ((1 << Self::MASK_BITS) - 1)
    }

    #[inline]
    fn due(self) -> i32 {
        self.0 >> Self::MASK_BITS
    }

    /// The same, counted from a start that is later by `ticks`.
    fn later_by(self, ticks: i32) -> Self {
        Self::new(self.mask(), self.due().saturating_sub(ticks).max(-LONG_AGO))
    }
}

/// Where the list of events has come to: copied into registers while a segment is filled.
#[derive(Debug, Clone, Copy)]
struct Cursor {
    /// Time of the last event, ticks from the segment's start; negative for an earlier segment.
    last: i32,
    /// Pulses that the last event ended. Those of the one before have been low for two spacings.
    ended: u32,
    /// Pulses that are high, the oldest first: three axes can overlap, each with its own end.
    oldest: High,
    middle: High,
    newest: High,
}

const _: () = assert!(LOW <= 2 * SPACING, "two events keep a pulse low");

impl Cursor {
    const NEW: Self = Self {
        last: 0,
        ended: 0,
        oldest: High::NONE,
        middle: High::NONE,
        newest: High::NONE,
    };

    /// All pulses that are high.
    #[inline]
    fn high(&self) -> u32 {
        High(self.oldest.0 | self.middle.0 | self.newest.0).mask()
    }

    /// Takes the pulses that have been high for the longest time.
    #[inline]
    fn take_oldest(&mut self) -> High {
        let oldest = self.oldest;
        self.oldest = self.middle;
        self.middle = self.newest;
        self.newest = High::NONE;
        oldest
    }

    /// Adds pulses that have just begun.
    #[inline]
    fn add_newest(&mut self, mask: u32, due: i32) {
        if self.oldest == High::NONE {
            self.oldest = High::new(mask, due);
        } else if self.middle == High::NONE {
            self.middle = High::new(mask, due);
        } else {
            self.newest = High::new(self.newest.mask() | mask, due);
        }
    }

    /// Puts one event, and waiting events before it where the time is long.
    #[inline]
    fn put(&mut self, time: i32, raise: u32, drop: u32, events: &mut EventBatch<'_>) {
        let mut ticks = (time - self.last).cast_unsigned();
        self.last = time;
        self.ended = drop;
        // wcet-bound: 2
        while ticks > StepEvent::MAX_TICKS {
            ticks -= StepEvent::MAX_TICKS;
            events.put(StepEvent::new(StepEvent::MAX_TICKS, 0, 0));
        }
        events.put(StepEvent::new(ticks, raise, drop));
    }

    /// Ends the oldest pulses with an event of their own.
    #[inline]
    fn end_oldest(&mut self, events: &mut EventBatch<'_>) {
        let ended = self.take_oldest();
        let time = ended.due().max(self.last + SPACING);
        self.put(time, 0, ended.mask(), events);
    }

    /// Puts a step of the axes in `mask`, and the ends of pulses that have to come before it.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "keeps the cursor in registers")]
    fn step(&mut self, time: i32, mask: u32, pulse_ticks: i32, events: &mut EventBatch<'_>) {
        // wcet-bound: 3
        while self.oldest != High::NONE
            && (self.high() & mask != 0 || time > self.oldest.due() + SHARE_TICKS)
        {
            self.end_oldest(events);
        }
        let gap = if self.ended & mask == 0 { SPACING } else { LOW };
        let time = time.max(self.last + gap);
        let mut drop = 0;
        // wcet-bound: 3
        while self.oldest != High::NONE && time >= self.oldest.due() {
            drop |= self.take_oldest().mask();
        }
        self.put(time, mask, drop, events);
        self.add_newest(mask, time + pulse_ticks);
    }

    /// Ends all pulses.
    fn end_all(&mut self, events: &mut EventBatch<'_>) {
        // wcet-bound: 3
        while self.oldest != High::NONE {
            self.end_oldest(events);
        }
    }

    /// The same times, counted from a start that is later by `ticks`.
    fn later_by(&mut self, ticks: i32) {
        self.last = self.last.saturating_sub(ticks);
        // wcet-bound: 3
        for high in [&mut self.oldest, &mut self.middle, &mut self.newest] {
            if *high != High::NONE {
                *high = high.later_by(ticks);
            }
        }
    }
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

    /// Replaces the position by another with the same whole steps, at rest.
    pub fn settle(&mut self, position: Axes<FineSteps>) {
        self.position = position;
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
            directions,
            is_rest: false,
            feed_mm_min: segment.feed_mm_min,
            line: segment.line,
        });
        self.clock_ticks = self.clock_ticks.wrapping_add(segment.ticks);
    }

    /// Begins the standstill after the last segment: ends all pulses and lets the queue run empty.
    pub fn rest(&mut self, counts: &StepCounts) {
        // wcet-bound: 6
        for axis in &mut self.axes {
            *axis = NO_STEPS;
        }
        self.open(EVENT_SPACING_TICKS, self.directions);
        self.is_rest = true;
        counts.announce(&SegmentInfo {
            start_ticks: self.clock_ticks,
            steps: self.steps(),
            directions: self.directions,
            is_rest: true,
            feed_mm_min: 0.0,
            line: 0,
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
        // wcet-bound: 1024
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

/// The steps of an axis that goes from one position to another, and whether backwards.
fn plan_axis(
    from: FineSteps,
    motion: AxisMotion,
    duration: f32,
    rate: f32,
    end: u32,
) -> (AxisSteps, bool) {
    let Steps(begin) = from.nearest();
    let steps = motion.to.nearest().0.wrapping_sub(begin);
    if steps == 0 {
        return (NO_STEPS, false);
    }
    let sign = if steps < 0 { -1.0 } else { 1.0 };
    let way = to_f32(motion.to.0.wrapping_sub(from.0)) * sign;
    let offset = to_f32(from.0.wrapping_sub(i64::from(begin) << 32)) * sign;
    let mut acceleration = motion.acceleration * sign;
    let mut speed = way * rate - 0.5 * acceleration * duration;
    if speed < 0.0 {
        speed = 0.0;
        acceleration = 2.0 * way * rate * rate;
    } else if speed + acceleration * duration < 0.0 {
        speed = 2.0 * way * rate;
        acceleration = -speed * rate;
    }
    // A parabola is off its chord by at most a·T²/8.
    let mean_period = 1.0 / math::max(way * rate, 1.0e-12);
    if acceleration.abs() * duration * duration * mean_period < 8.0 * EVEN_ERROR_TICKS {
        let scale = mean_period * (1 << EVEN_BITS) as f32;
        let even_time = ((0.5 - offset) * scale) as u32;
        let axis = AxisSteps {
            left: steps.unsigned_abs(),
            next: (even_time >> EVEN_BITS).min(end),
            even_time,
            even_period: scale as u32,
            ..NO_STEPS
        };
        return (axis, steps < 0);
    }
    let slowest = math::min(speed, speed + acceleration * duration);
    let mut axis = AxisSteps {
        left: steps.unsigned_abs(),
        speed,
        half_acceleration: 0.5 * acceleration,
        distance: 0.5 - offset,
        pace: if acceleration.abs() > SLOW_CHANGE * slowest * slowest {
            Pace::Steep
        } else {
            Pace::Smooth
        },
        ..NO_STEPS
    };
    axis.time = axis.solve();
    axis.period = 1.0 / math::max(speed + acceleration * axis.time, 1.0e-12);
    axis.next = (axis.time as u32).min(end);
    (axis, steps < 0)
}

/// A fixed-point distance of at most 2048 steps in floating point, to 24 bits where it is small.
fn to_f32(fine: i64) -> f32 {
    if fine >> 31 == fine >> 63 {
        fine as i32 as f32 * (1.0 / 4_294_967_296.0)
    } else {
        (fine >> 12) as i32 as f32 * (1.0 / 1_048_576.0)
    }
}
