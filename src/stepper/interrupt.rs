//! The body of the step interrupt: plays events, counts steps.
//!
//! The same instructions for any number of axes up to three (and twice the counting for four to
//! six): steps are counted in ten-bit lanes of one word and spread to the axes once per segment.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering::Relaxed};

use heapless::spsc::Consumer;

use super::{EventReader, SegmentInfo, StepEvent};
use crate::axis::{AXES, Axes};

/// Words of step counts: three lanes each.
const LANE_WORDS: usize = AXES.div_ceil(3);
/// Bits of a lane: a segment of 1 ms may hold 1023 steps of an axis.
const LANE_BITS: u32 = 10;
const LANE_MASK: u32 = (1 << LANE_BITS) - 1;

/// What the step interrupt tells the rest of the machine: written by it alone, read by anyone.
#[derive(Debug)]
pub struct StepCounts {
    position: [AtomicI32; AXES],
    pulses: [AtomicU32; AXES],
    late: AtomicU32,
    played_ticks: AtomicU32,
    feed_mm_min: AtomicU32,
    line: AtomicU32,
    running: AtomicBool,
    starved: AtomicBool,
}

impl StepCounts {
    /// Nothing played yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            position: [const { AtomicI32::new(0) }; AXES],
            pulses: [const { AtomicU32::new(0) }; AXES],
            late: AtomicU32::new(0),
            played_ticks: AtomicU32::new(0),
            feed_mm_min: AtomicU32::new(0),
            line: AtomicU32::new(0),
            running: AtomicBool::new(false),
            starved: AtomicBool::new(false),
        }
    }

    /// Step count of each axis when the segment being played began.
    #[must_use]
    pub fn position(&self) -> Axes<i32> {
        Axes::from_fn(|axis| self.position[axis].load(Relaxed))
    }

    /// Pulses of each axis in either direction, wrapping.
    #[must_use]
    pub fn pulses(&self) -> Axes<u32> {
        Axes::from_fn(|axis| self.pulses[axis].load(Relaxed))
    }

    /// Events whose time had passed before they could be set up.
    #[must_use]
    pub fn late(&self) -> u32 {
        self.late.load(Relaxed)
    }

    /// Counts a late event; called by the board's step timer, in the step interrupt.
    pub fn count_late(&self) {
        self.late.store(self.late().wrapping_add(1), Relaxed);
    }

    /// Start of the segment being played, on the generator's clock.
    #[must_use]
    pub fn played_ticks(&self) -> u32 {
        self.played_ticks.load(Relaxed)
    }

    /// Speed along the path in the segment being played, mm/min.
    #[must_use]
    pub fn feed_mm_min(&self) -> f32 {
        f32::from_bits(self.feed_mm_min.load(Relaxed))
    }

    /// `N` word of the block being played, 0 without.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.line.load(Relaxed)
    }

    /// Whether the step timer runs; when it does not, a new event needs its interrupt pended.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.running.load(Relaxed)
    }

    /// Takes the fault that the event queue ran empty in motion; for `prepare` alone.
    #[must_use]
    pub fn take_starved(&self) -> bool {
        let starved = self.starved.load(Relaxed);
        if starved {
            self.starved.store(false, Relaxed);
        }
        starved
    }
}

impl Default for StepCounts {
    fn default() -> Self {
        Self::new()
    }
}

/// What the step interrupt does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Advance {
    /// Ticks from this event to the next one; `None` stops the timer.
    pub wait: Option<u32>,
    /// Pulses to begin then, bit 0 = X.
    pub raise: u32,
    /// Pulses to end then.
    pub drop: u32,
    /// Direction outputs to be set now, bit 0 = X, 1 = negative.
    pub directions: Option<u8>,
}

impl Advance {
    /// Whether a segment has begun or the queue is empty: `prepare` has to run.
    #[must_use]
    pub const fn releases_prepare(&self) -> bool {
        self.directions.is_some() || self.wait.is_none()
    }
}

/// The step interrupt's own state.
#[derive(Debug)]
pub struct Stepper {
    /// Steps since the segment began, in lanes of [`LANE_BITS`].
    lanes: [u32; LANE_WORDS],
    /// Directions of the segment being played.
    directions: u8,
    is_rest: bool,
}

impl Stepper {
    /// At rest, with nothing to play.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            lanes: [0; LANE_WORDS],
            directions: 0,
            is_rest: true,
        }
    }

    /// Takes the next event if it belongs to the segment being played: nearly always so, and then
    /// this is all there is to do. Otherwise [`Stepper::advance`] has to be called.
    #[inline]
    pub fn advance_within(&mut self, events: &mut EventReader<'_>) -> Option<StepEvent> {
        let event = events.take_within_segment()?;
        self.count(event.raise());
        Some(event)
    }

    /// Takes the next event, once the pins have been set for the one before.
    ///
    /// Deadline: before the next event is due. A miss delays that event and is counted by the
    /// timer; no step is lost.
    #[inline]
    pub fn advance(
        &mut self,
        events: &mut EventReader<'_>,
        infos: &mut Consumer<'_, SegmentInfo>,
        counts: &StepCounts,
    ) -> Advance {
        let Some(event) = events.take() else {
            self.stop(counts);
            return Advance {
                wait: None,
                raise: 0,
                drop: 0,
                directions: None,
            };
        };
        let mut directions = None;
        if event.is_boundary() {
            directions = Some(self.begin_segment(infos, counts));
        }
        self.count(event.raise());
        Advance {
            wait: Some(event.ticks()),
            raise: event.raise(),
            drop: event.drop(),
            directions,
        }
    }

    /// Adds the steps of an event to the lanes.
    #[inline]
    fn count(&mut self, mut raise: u32) {
        // wcet-bound: 2
        for lanes in &mut self.lanes {
            *lanes += raise & 1;
            *lanes += (raise & 2) << (LANE_BITS - 1);
            *lanes += (raise & 4) << (2 * (LANE_BITS - 1));
            raise >>= 3;
        }
    }

    /// Publishes the steps of the segment that ends.
    fn publish(&mut self, counts: &StepCounts) {
        let mut directions = self.directions;
        // wcet-bound: 6
        for axis in 0..AXES {
            let lanes = &mut self.lanes[axis / 3];
            let steps = *lanes & LANE_MASK;
            *lanes >>= LANE_BITS;
            let moved = if directions & 1 == 0 {
                steps.cast_signed()
            } else {
                -steps.cast_signed()
            };
            directions >>= 1;
            let position = &counts.position[axis];
            position.store(position.load(Relaxed).wrapping_add(moved), Relaxed);
            let pulses = &counts.pulses[axis];
            pulses.store(pulses.load(Relaxed).wrapping_add(steps), Relaxed);
        }
    }

    fn begin_segment(&mut self, infos: &mut Consumer<'_, SegmentInfo>, counts: &StepCounts) -> u8 {
        self.publish(counts);
        if let Some(info) = infos.dequeue() {
            self.directions = info.directions;
            self.is_rest = info.is_rest;
            counts.played_ticks.store(info.start_ticks, Relaxed);
            counts
                .feed_mm_min
                .store(info.feed_mm_min.to_bits(), Relaxed);
            counts.line.store(info.line, Relaxed);
        }
        counts.running.store(true, Relaxed);
        self.directions
    }

    fn stop(&mut self, counts: &StepCounts) {
        self.publish(counts);
        counts.running.store(false, Relaxed);
        if !self.is_rest {
            counts.starved.store(true, Relaxed);
        }
    }
}

impl Default for Stepper {
    fn default() -> Self {
        Self::new()
    }
}
