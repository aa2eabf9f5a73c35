//! What `prepare` is told of what has been played: lock-free, one ring.
//!
//! `prepare` announces each segment before its first event, with the steps at which it begins;
//! `segment_start`, which the step interrupt releases by the first event of each, says which one is played.
//! Every event is played exactly once, so nothing needs to be counted: the position is that of the
//! segment.

use core::sync::atomic::{
    AtomicBool, AtomicI32, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use super::{EventTap, SegmentInfo};
use crate::{
    axis::{AXES, Axes},
    model::queues::SEGMENT_RING,
};

/// A segment on its way.
#[derive(Debug)]
struct Slot {
    /// Its directions, [`IS_MOVING`], and from [`DUTY_SHIFT`] on the duty.
    flags: AtomicU32,
    start_ticks: AtomicU32,
    feed_mm_min: AtomicU32,
    spindle_rpm: AtomicU32,
    line: AtomicU32,
    /// Number of its first event, or of one before it that begins no pulse.
    first_event: AtomicU32,
    /// Step count of each axis where it begins.
    steps: [AtomicI32; AXES],
}

/// Flag of a segment in which not everything is at rest.
const IS_MOVING: u32 = 1 << 8;
const DUTY_SHIFT: u32 = 16;

/// What `segment_start` has to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SegmentStart {
    /// Spindle PWM of the segment that has begun, 0 to [`crate::model::Outputs::FULL`].
    pub duty: Option<u16>,
    /// Run again: another segment has begun meanwhile.
    pub has_more: bool,
}

/// Slots, a power of two: those of the segments that may wait, and of those played last.
const SLOTS: usize = 2 * SEGMENT_RING;

/// What the step interrupt plays.
///
/// Written by `prepare` (announcements) and by `segment_start` (what has begun, faults). `running` is written
/// by whoever starts or stops the timer.
#[derive(Debug)]
pub struct SegmentRing {
    slots: [Slot; SLOTS],
    /// Segments announced so far, wrapping.
    pushed: AtomicU32,
    /// Segments begun so far, wrapping.
    begun: AtomicU32,
    /// The part of the flags that counts: all, or no duty.
    mask: AtomicU32,
    running: AtomicBool,
    underrun: AtomicBool,
    /// The step interrupt has been stopped at once; written by `inputs`, cleared by `prepare`.
    halted: AtomicBool,
}

impl SegmentRing {
    /// Nothing played yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            slots: [const {
                Slot {
                    flags: AtomicU32::new(0),
                    start_ticks: AtomicU32::new(0),
                    feed_mm_min: AtomicU32::new(0),
                    spindle_rpm: AtomicU32::new(0),
                    line: AtomicU32::new(0),
                    first_event: AtomicU32::new(0),
                    steps: [const { AtomicI32::new(0) }; AXES],
                }
            }; SLOTS],
            pushed: AtomicU32::new(0),
            begun: AtomicU32::new(0),
            mask: AtomicU32::new(u32::MAX),
            running: AtomicBool::new(false),
            underrun: AtomicBool::new(false),
            halted: AtomicBool::new(false),
        }
    }

    #[inline]
    fn slot(&self, number: u32) -> &Slot {
        &self.slots[number as usize % SLOTS]
    }

    /// The segment being played, or played last.
    fn played(&self) -> &Slot {
        self.slot(self.begun.load(Relaxed).wrapping_sub(1))
    }

    /// Whether a segment can be announced.
    #[must_use]
    pub fn has_room(&self) -> bool {
        // The others are those played last, or being played.
        let waiting = self
            .pushed
            .load(Relaxed)
            .wrapping_sub(self.begun.load(Relaxed));
        waiting < SEGMENT_RING as u32 - 1
    }

    /// Announces a segment, before its first event; there must be room.
    pub(super) fn push(&self, info: &SegmentInfo) {
        let number = self.pushed.load(Relaxed);
        let slot = self.slot(number);
        let moving = if info.is_standstill { 0 } else { IS_MOVING };
        let duty = u32::from(info.duty) << DUTY_SHIFT;
        slot.flags
            .store(u32::from(info.directions) | moving | duty, Relaxed);
        slot.start_ticks.store(info.start_ticks, Relaxed);
        slot.feed_mm_min.store(info.feed_mm_min.to_bits(), Relaxed);
        slot.spindle_rpm.store(info.spindle_rpm.to_bits(), Relaxed);
        slot.line.store(info.line, Relaxed);
        slot.first_event.store(info.first_event, Relaxed);
        // wcet-bound: axes
        for (to, from) in slot.steps.iter().zip(&info.steps) {
            to.store(*from, Relaxed);
        }
        // `segment_start` must not see the number before the rest.
        compiler_fence(SeqCst);
        self.pushed.store(number.wrapping_add(1), Relaxed);
    }

    /// The body of `segment_start`: begins the segment whose first event is set up, and looks whether
    /// the step interrupt has stopped while something moved.
    ///
    /// Deadline: before two more segments begin. Until it has run, what is played seems to be the
    /// segment before.
    #[inline]
    pub fn start_segment(&self, events: EventTap<'_>) -> SegmentStart {
        let (taken, is_running) = events.committed(self);
        let (number, announced) = (self.begun.load(Relaxed), self.pushed.load(Relaxed));
        // Whether an event of a segment is among those that have been output or set up.
        let has_begun = |number: u32| {
            let first = self.slot(number).first_event.load(Relaxed);
            number != announced && taken.wrapping_sub(first).cast_signed() > 0
        };
        if !has_begun(number) {
            if !is_running {
                self.record_underrun(self.played());
            }
            return SegmentStart {
                duty: None,
                has_more: false,
            };
        }
        let (slot, next) = (self.slot(number), number.wrapping_add(1));
        self.begun.store(next, Relaxed);
        let again = has_begun(next);
        if !is_running && !again {
            self.record_underrun(slot);
        }
        SegmentStart {
            duty: Some(self.duty_of(slot.flags.load(Relaxed))),
            has_more: again,
        }
    }

    /// The step interrupt has stopped in a segment: a fault if something moved, and nobody stopped it.
    #[inline]
    fn record_underrun(&self, slot: &Slot) {
        if slot.flags.load(Relaxed) & IS_MOVING != 0 && !self.is_halted() {
            self.underrun.store(true, Relaxed);
        }
    }

    /// The step interrupt has stopped, for want of events.
    #[inline]
    pub fn stop(&self) {
        self.running.store(false, Relaxed);
    }

    /// The step interrupt has been stopped; see [`EventTap::halt`].
    pub(super) fn halt(&self) {
        self.running.store(false, Relaxed);
        self.halted.store(true, Relaxed);
    }

    /// Whether the step interrupt has been stopped at once and nobody has seen to it yet.
    #[inline]
    #[must_use]
    pub fn is_halted(&self) -> bool {
        self.halted.load(Relaxed)
    }

    /// Drops the segments that have not begun; ends a cut. For `prepare`, while the step interrupt
    /// stands.
    pub(super) fn discard_pending(&self) {
        self.pushed.store(self.begun.load(Relaxed), Relaxed);
        self.underrun.store(false, Relaxed);
        self.halted.store(false, Relaxed);
    }

    /// The segment in which so many events had been output: where it begins, its directions, and
    /// how many events before its first that was. `None` when that is too long ago.
    pub(super) fn segment_at(&self, events: u32) -> Option<(Axes<i32>, u8, u32)> {
        let begun = self.begun.load(Relaxed);
        // wcet-bound: 32
        for back in 1..=SEGMENT_RING as u32 {
            let slot = self.slot(begun.wrapping_sub(back));
            let first = slot.first_event.load(Relaxed);
            let since = events.wrapping_sub(first);
            if since.cast_signed() >= 0 {
                let steps = Axes::from_fn(|axis| slot.steps[axis].load(Relaxed));
                return Some((steps, slot.flags.load(Relaxed) as u8, first));
            }
        }
        None
    }

    /// Of the segment being played: the step count of each axis when it began, the speed along the
    /// path, mm/min, and the `N` word of its block, 0 without.
    #[inline]
    #[must_use]
    pub fn status(&self) -> (Axes<i32>, f32, u32) {
        let played = self.played();
        (
            Axes::from_fn(|axis| played.steps[axis].load(Relaxed)),
            f32::from_bits(played.feed_mm_min.load(Relaxed)),
            played.line.load(Relaxed),
        )
    }

    /// Step count of each axis when the segment being played began.
    #[must_use]
    pub fn position(&self) -> Axes<i32> {
        let played = self.played();
        Axes::from_fn(|axis| played.steps[axis].load(Relaxed))
    }

    /// Start of the segment being played, on the generator's clock.
    #[must_use]
    pub fn played_start_ticks(&self) -> u32 {
        self.played().start_ticks.load(Relaxed)
    }

    /// Speed along the path in the segment being played, mm/min.
    #[must_use]
    pub fn feed_mm_min(&self) -> f32 {
        f32::from_bits(self.played().feed_mm_min.load(Relaxed))
    }

    /// Spindle speed or laser power in the segment being played, rpm.
    #[must_use]
    pub fn spindle_rpm(&self) -> f32 {
        f32::from_bits(self.played().spindle_rpm.load(Relaxed))
    }

    /// Spindle PWM in the segment being played.
    #[must_use]
    pub fn duty(&self) -> u16 {
        self.duty_of(self.played().flags.load(Relaxed))
    }

    #[inline]
    fn duty_of(&self, flags: u32) -> u16 {
        ((flags & self.mask.load(Relaxed)) >> DUTY_SHIFT) as u16
    }

    /// `N` word of the block being played, 0 without.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.played().line.load(Relaxed)
    }

    /// Whether segments, also those that wait, have no duty from now on; for `prepare` alone.
    pub(crate) fn inhibit_spindle(&self, is_mute: bool) {
        let mask = if is_mute {
            (1 << DUTY_SHIFT) - 1
        } else {
            u32::MAX
        };
        self.mask.store(mask, Relaxed);
    }

    /// `prepare` starts the step timer, which stands.
    pub fn start(&self) {
        self.running.store(true, Relaxed);
    }

    /// Whether the step timer runs; when it does not, a new event needs it started.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.running.load(Relaxed)
    }

    /// Whether the event queue ran empty in motion, and nobody has seen to it yet.
    #[inline]
    #[must_use]
    pub fn has_underrun(&self) -> bool {
        self.underrun.load(Relaxed)
    }

    /// Takes the fault that the event queue ran empty in motion; for `prepare` alone.
    pub(crate) fn clear_underrun(&self) {
        self.underrun.store(false, Relaxed);
    }
}

impl Default for SegmentRing {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
