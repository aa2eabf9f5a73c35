//! What `prepare` and the step interrupt tell each other of segments: lock-free, one ring.
//!
//! `prepare` announces each segment before its first event; the step interrupt says which one it
//! plays and leaves the steps of the one before, packed as it counted them. Spreading them over the
//! axes is `prepare`'s work: it has more time.

use core::sync::atomic::{
    AtomicBool, AtomicI32, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use super::{SEGMENT_RING, SegmentInfo};
use crate::axis::{AXES, Axes};

/// Words of step counts: three lanes each.
pub(super) const LANE_WORDS: usize = AXES.div_ceil(3);
/// Bits of a lane: a segment of 1 ms may hold 1023 steps of an axis.
pub(super) const LANE_BITS: u32 = 10;
const LANE_MASK: u32 = (1 << LANE_BITS) - 1;

/// A segment on its way.
#[derive(Debug)]
struct Slot {
    /// Its directions, and [`IS_MOVING`].
    flags: AtomicU32,
    start_ticks: AtomicU32,
    feed_mm_min: AtomicU32,
    line: AtomicU32,
    /// Steps of the segment before it.
    steps_before: [AtomicU32; LANE_WORDS],
}

/// Flag of a segment in which not everything is at rest.
const IS_MOVING: u32 = 1 << 8;

/// What the step interrupt plays and has counted.
///
/// Written by `prepare` (announcements, sums) and the step interrupt (the rest). Positions and
/// pulses are summed up as they are asked for, so one task alone may ask: `prepare`.
#[derive(Debug)]
pub struct StepCounts {
    slots: [Slot; SEGMENT_RING],
    /// Segments announced so far, wrapping.
    announced: AtomicU32,
    /// Segments begun so far, wrapping.
    begun: AtomicU32,
    /// Segments whose steps have been summed up, wrapping.
    summed: AtomicU32,
    position: [AtomicI32; AXES],
    pulses: [AtomicU32; AXES],
    late: AtomicU32,
    running: AtomicBool,
    starved: AtomicBool,
}

impl StepCounts {
    /// Nothing played yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            slots: [const {
                Slot {
                    flags: AtomicU32::new(0),
                    start_ticks: AtomicU32::new(0),
                    feed_mm_min: AtomicU32::new(0),
                    line: AtomicU32::new(0),
                    steps_before: [const { AtomicU32::new(0) }; LANE_WORDS],
                }
            }; SEGMENT_RING],
            announced: AtomicU32::new(0),
            begun: AtomicU32::new(0),
            summed: AtomicU32::new(0),
            position: [const { AtomicI32::new(0) }; AXES],
            pulses: [const { AtomicU32::new(0) }; AXES],
            late: AtomicU32::new(0),
            running: AtomicBool::new(false),
            starved: AtomicBool::new(false),
        }
    }

    #[inline]
    fn slot(&self, number: u32) -> &Slot {
        &self.slots[number as usize % SEGMENT_RING]
    }

    /// The segment being played, or played last.
    fn played(&self) -> &Slot {
        self.slot(self.begun.load(Relaxed).wrapping_sub(1))
    }

    /// Whether a segment can be announced. Segments must have been summed up since they were
    /// played: [`StepCounts::position`] does it.
    #[must_use]
    pub fn has_room(&self) -> bool {
        // The slot before the first that waits is still in use.
        let waiting = self
            .announced
            .load(Relaxed)
            .wrapping_sub(self.summed.load(Relaxed));
        waiting < SEGMENT_RING as u32 - 1
    }

    /// Announces a segment, before its first event; there must be room.
    pub(super) fn announce(&self, info: &SegmentInfo) {
        let number = self.announced.load(Relaxed);
        let slot = self.slot(number);
        let moving = if info.is_rest { 0 } else { IS_MOVING };
        slot.flags
            .store(u32::from(info.directions) | moving, Relaxed);
        slot.start_ticks.store(info.start_ticks, Relaxed);
        slot.feed_mm_min.store(info.feed_mm_min.to_bits(), Relaxed);
        slot.line.store(info.line, Relaxed);
        // The step interrupt comes here by the segment's first event only, which is put later.
        compiler_fence(SeqCst);
        self.announced.store(number.wrapping_add(1), Relaxed);
    }

    /// The step interrupt begins the next segment, and leaves the steps of the one before. Returns
    /// the directions, and whether anything moves.
    #[inline]
    pub(super) fn begin(&self, steps_before: &mut [u32; LANE_WORDS]) -> (u8, bool) {
        let number = self.begun.load(Relaxed);
        let slot = self.slot(number);
        // wcet-bound: 2
        for (to, from) in slot.steps_before.iter().zip(steps_before) {
            to.store(*from, Relaxed);
            *from = 0;
        }
        compiler_fence(SeqCst);
        self.begun.store(number.wrapping_add(1), Relaxed);
        self.running.store(true, Relaxed);
        let flags = slot.flags.load(Relaxed);
        (flags as u8, flags & IS_MOVING != 0)
    }

    /// The step interrupt has stopped: a fault if anything moved.
    #[inline]
    pub(super) fn stop(&self, is_moving: bool) {
        self.running.store(false, Relaxed);
        if is_moving {
            self.starved.store(true, Relaxed);
        }
    }

    /// Sums up the steps of the segments that have ended.
    fn sum_up(&self) {
        let begun = self.begun.load(Relaxed);
        let mut number = self.summed.load(Relaxed);
        // wcet-bound: 32
        while number != begun {
            let flags = self.slot(number.wrapping_sub(1)).flags.load(Relaxed);
            let lanes = &self.slot(number).steps_before;
            // wcet-bound: 6
            for axis in 0..AXES {
                let shift = LANE_BITS * (axis as u32 % 3);
                let steps = lanes[axis / 3].load(Relaxed) >> shift & LANE_MASK;
                let is_negative = flags >> axis & 1 != 0;
                let moved = steps.cast_signed();
                let moved = if is_negative { -moved } else { moved };
                let position = &self.position[axis];
                position.store(position.load(Relaxed).wrapping_add(moved), Relaxed);
                let pulses = &self.pulses[axis];
                pulses.store(pulses.load(Relaxed).wrapping_add(steps), Relaxed);
            }
            number = number.wrapping_add(1);
        }
        self.summed.store(number, Relaxed);
    }

    /// Step count of each axis when the segment being played began.
    #[must_use]
    pub fn position(&self) -> Axes<i32> {
        self.sum_up();
        Axes::from_fn(|axis| self.position[axis].load(Relaxed))
    }

    /// Pulses of each axis in either direction, wrapping, before the segment being played.
    #[must_use]
    pub fn pulses(&self) -> Axes<u32> {
        self.sum_up();
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
        self.played().start_ticks.load(Relaxed)
    }

    /// Speed along the path in the segment being played, mm/min.
    #[must_use]
    pub fn feed_mm_min(&self) -> f32 {
        f32::from_bits(self.played().feed_mm_min.load(Relaxed))
    }

    /// `N` word of the block being played, 0 without.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.played().line.load(Relaxed)
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

#[cfg(test)]
mod tests {
    use super::*;

    fn announce(counts: &StepCounts, directions: u8) {
        counts.announce(&SegmentInfo {
            directions,
            ..SegmentInfo::default()
        });
    }

    #[test]
    fn steps_are_summed_up_in_the_directions_of_their_own_segment() {
        let counts = StepCounts::new();
        let mut lanes = [0; LANE_WORDS];
        for (directions, steps) in [(0b001, 1023), (0b000, 5), (0b101, 7)] {
            announce(&counts, directions);
            counts.begin(&mut lanes);
            lanes[0] = steps | steps << LANE_BITS | 2 << (2 * LANE_BITS);
        }
        announce(&counts, 0);
        counts.begin(&mut lanes);
        assert_eq!(counts.position().0[..3], [-1023 + 5 - 7, 1035, 2 + 2 - 2]);
        assert_eq!(counts.pulses().0[..3], [1035, 1035, 6]);
    }

    #[test]
    fn no_slot_is_announced_that_is_still_to_be_summed_up() {
        let counts = StepCounts::new();
        let mut announced = 0;
        while counts.has_room() {
            announce(&counts, announced);
            announced += 1;
        }
        assert_eq!(usize::from(announced), SEGMENT_RING - 1);
        counts.begin(&mut [0; LANE_WORDS]);
        assert!(!counts.has_room());
        let _ = counts.position();
        assert!(counts.has_room());
    }
}
