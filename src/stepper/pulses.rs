//! The ends of pulses, and where they go in the list of events.
//!
//! An end may come late, and then shares the event of the next step, as long as the axis stays low
//! for [`PULSE_LOW_TICKS`] before its next pulse.

use super::{EVENT_SPACING_TICKS, PULSE_LOW_TICKS, StepEvent, ring::EventBatch};
use crate::units::TICKS_PER_US;

/// Longest time that the end of a pulse waits to share an event, ticks.
const SHARE_TICKS: i32 = (10 * TICKS_PER_US).cast_signed();
/// A time before anything that still matters, ticks.
const LONG_AGO: i32 = 1 << 24;
/// [`EVENT_SPACING_TICKS`] and [`PULSE_LOW_TICKS`] as differences of times.
pub(super) const SPACING: i32 = EVENT_SPACING_TICKS.cast_signed();
pub(super) const LOW: i32 = PULSE_LOW_TICKS.cast_signed();
/// Pulses that are high and when they may end, in one word: mask and, above it, ticks from the
/// segment's start. Zero: none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct High(i32);

impl High {
    pub(super) const NONE: Self = Self(0);
    const MASK_BITS: u32 = 6;

    #[inline]
    pub(super) fn new(mask: u32, due: i32) -> Self {
        Self(due << Self::MASK_BITS | mask.cast_signed())
    }

    #[inline]
    fn mask(self) -> u32 {
        self.0.cast_unsigned() & ((1 << Self::MASK_BITS) - 1)
    }

    #[inline]
    pub(super) fn due(self) -> i32 {
        self.0 >> Self::MASK_BITS
    }

    /// The same, counted from a start that is later by `ticks`.
    fn later_by(self, ticks: i32) -> Self {
        Self::new(self.mask(), self.due().saturating_sub(ticks).max(-LONG_AGO))
    }
}

/// Where the list of events has come to: copied into registers while a segment is filled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor {
    /// Time of the last event, ticks from the segment's start; negative for an earlier segment.
    pub(super) last: i32,
    /// Pulses that the last event ended. Those of the one before have been low for two spacings.
    pub(super) ended: u32,
    /// Pulses that are high, the oldest first: three axes can overlap, each with its own end.
    pub(super) oldest: High,
    middle: High,
    newest: High,
}

const _: () = assert!(LOW <= 2 * SPACING, "two events keep a pulse low");

impl Cursor {
    pub(super) const NEW: Self = Self {
        last: 0,
        ended: 0,
        oldest: High::NONE,
        middle: High::NONE,
        newest: High::NONE,
    };

    /// After a cut: these pulses are high, and end after their whole length.
    pub(super) fn cut_off(mask: u32, pulse_ticks: i32) -> Self {
        let oldest = if mask == 0 {
            High::NONE
        } else {
            High::new(mask, pulse_ticks)
        };
        Self {
            oldest,
            ..Self::NEW
        }
    }

    /// All pulses that are high.
    #[inline]
    pub(super) fn high(&self) -> u32 {
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
    pub(super) fn put(&mut self, time: i32, raise: u32, drop: u32, events: &mut EventBatch<'_>) {
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
    pub(super) fn end_oldest(&mut self, events: &mut EventBatch<'_>) {
        let ended = self.take_oldest();
        let time = ended.due().max(self.last + SPACING);
        self.put(time, 0, ended.mask(), events);
    }

    /// Puts a step of the axes in `mask`, and the ends of pulses that have to come before it.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "keeps the cursor in registers")]
    pub(super) fn step(
        &mut self,
        time: i32,
        mask: u32,
        pulse_ticks: i32,
        events: &mut EventBatch<'_>,
    ) {
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
    pub(super) fn end_all(&mut self, events: &mut EventBatch<'_>) {
        // wcet-bound: 3
        while self.oldest != High::NONE {
            self.end_oldest(events);
        }
    }

    /// The same times, counted from a start that is later by `ticks`.
    pub(super) fn later_by(&mut self, ticks: i32) {
        self.last = self.last.saturating_sub(ticks);
        // wcet-bound: 3
        for high in [&mut self.oldest, &mut self.middle, &mut self.newest] {
            if *high != High::NONE {
                *high = high.later_by(ticks);
            }
        }
    }
}
