//! The segments that are played, wait or have been played last: lock-free, one ring.
//!
//! `prepare` pushes each segment before its first event, with the steps at which it begins. The step
//! interrupt releases `segment_start` by the first event of each, which records that the segment has
//! begun. Every event is played exactly once, so nothing needs to be counted: the position is that of
//! the segment.

use super::{EventTap, SegmentInfo};
use crate::{
    atomic::{
        AtomicBool, AtomicI32, AtomicU32,
        Ordering::{Relaxed, SeqCst},
        compiler_fence,
    },
    axis::{AXES, Axes},
    model::{queues::SEGMENT_RING, timing::SPARSE_SEGMENT_TICKS},
};

/// A segment in the ring.
#[derive(Debug)]
struct RingEntry {
    /// Directions, [`IS_MOVING`], and from [`DUTY_SHIFT`] on the duty.
    flags: AtomicU32,
    /// The start, on the generator's clock.
    start_ticks: AtomicU32,
    /// The bits of the speed along the path, mm/min.
    feed_mm_min: AtomicU32,
    /// The bits of the spindle speed or laser power, rpm.
    spindle_rpm: AtomicU32,
    /// `N` word of the block, 0 without one.
    line: AtomicU32,
    /// Number of the first event, or of one before that begins no pulse.
    first_event: AtomicU32,
    /// Step count of each axis at the start.
    steps: [AtomicI32; AXES],
}

/// Flag of a segment that is no standstill.
const IS_MOVING: u32 = 1 << 8;
const DUTY_SHIFT: u32 = 16;

/// What is due at the start of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SegmentStart {
    /// Spindle PWM of the segment that has begun, 0 to [`crate::model::Outputs::FULL`].
    pub duty: Option<u16>,
    /// Another segment has begun meanwhile: `segment_start` must run again.
    pub has_more: bool,
}

/// Entries, a power of two: as many segments as may wait, and those played last.
const ENTRIES: usize = 2 * SEGMENT_RING;

/// The segments that the step interrupt plays.
///
/// `prepare` writes the pushed segments, `segment_start` the begun ones and underruns, and the tasks that start or stop
/// the step timer write `running`.
#[derive(Debug)]
pub struct SegmentRing {
    entries: [RingEntry; ENTRIES],
    /// Segments pushed so far, wrapping.
    pushed: AtomicU32,
    /// Segments begun so far, wrapping.
    begun: AtomicU32,
    /// Time at which the segment being played has begun, ticks of the motion's clock.
    begin_ticks: AtomicU32,
    /// The next segment is due when the generator's clock has been played up to here.
    due_ticks: AtomicU32,
    /// The flags in force: all, or all but the duty.
    flags_mask: AtomicU32,
    /// The step interrupt runs.
    running: AtomicBool,
    /// The step interrupt ran out of events in motion.
    underrun: AtomicBool,
    /// The step interrupt has been halted: written by `inputs`, cleared by `prepare`.
    halted: AtomicBool,
}

impl SegmentRing {
    /// Returns a ring that nothing has been played from.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            entries: [const {
                RingEntry {
                    flags: AtomicU32::new(0),
                    start_ticks: AtomicU32::new(0),
                    feed_mm_min: AtomicU32::new(0),
                    spindle_rpm: AtomicU32::new(0),
                    line: AtomicU32::new(0),
                    first_event: AtomicU32::new(0),
                    steps: [const { AtomicI32::new(0) }; AXES],
                }
            }; ENTRIES],
            pushed: AtomicU32::new(0),
            begun: AtomicU32::new(0),
            begin_ticks: AtomicU32::new(0),
            due_ticks: AtomicU32::new(0),
            flags_mask: AtomicU32::new(u32::MAX),
            running: AtomicBool::new(false),
            underrun: AtomicBool::new(false),
            halted: AtomicBool::new(false),
        }
    }

    fn entry(&self, number: u32) -> &RingEntry {
        &self.entries[number as usize % ENTRIES]
    }

    /// Returns the segment being played, or played last.
    fn played(&self) -> &RingEntry {
        self.entry(self.begun.load(Relaxed).wrapping_sub(1))
    }

    /// Returns whether a segment can be pushed.
    #[must_use]
    pub fn has_room(&self) -> bool {
        // The other entries hold the segments being played and played last.
        let waiting = self
            .pushed
            .load(Relaxed)
            .wrapping_sub(self.begun.load(Relaxed));
        waiting < SEGMENT_RING as u32 - 1
    }

    /// Pushes a segment, before its first event; there must be room.
    pub(super) fn push(&self, info: &SegmentInfo) {
        let number = self.pushed.load(Relaxed);
        let entry = self.entry(number);
        let moving = if info.is_standstill { 0 } else { IS_MOVING };
        let duty = u32::from(info.duty) << DUTY_SHIFT;
        entry
            .flags
            .store(u32::from(info.directions) | moving | duty, Relaxed);
        entry.start_ticks.store(info.start_ticks, Relaxed);
        entry.feed_mm_min.store(info.feed_mm_min.to_bits(), Relaxed);
        entry.spindle_rpm.store(info.spindle_rpm.to_bits(), Relaxed);
        entry.line.store(info.line, Relaxed);
        entry.first_event.store(info.first_event, Relaxed);
        for (to, from) in entry.steps.iter().zip(&info.steps) {
            to.store(*from, Relaxed);
        }
        // `segment_start` must not see the number before the entry.
        compiler_fence(SeqCst);
        self.pushed.store(number.wrapping_add(1), Relaxed);
    }

    /// The body of `segment_start`: begins the segment whose first event is set up, and records an
    /// underrun if the step interrupt has stopped while something moved.
    ///
    /// Deadline: before two more segments begin. Until it has run, the segment before
    /// counts as the one being played.
    pub fn start_segment(&self, events: EventTap<'_>) -> SegmentStart {
        let (taken, is_running) = events.committed(self);
        let (number, pushed) = (self.begun.load(Relaxed), self.pushed.load(Relaxed));
        // An event of the segment is among those that have been output or set up.
        let has_begun = |number: u32| {
            let first = self.entry(number).first_event.load(Relaxed);
            number != pushed && taken.wrapping_sub(first).cast_signed() > 0
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
        let (entry, next) = (self.entry(number), number.wrapping_add(1));
        self.begun.store(next, Relaxed);
        let again = has_begun(next);
        if !is_running && !again {
            self.record_underrun(entry);
        }
        SegmentStart {
            duty: Some(self.duty_of(entry.flags.load(Relaxed))),
            has_more: again,
        }
    }

    /// Records the time at which a segment has begun; for `segment_start` alone.
    pub fn set_begin(&self, now_ticks: u32) {
        self.begin_ticks.store(now_ticks, Relaxed);
    }

    /// Returns the time that the segment being played has been played for at least, ticks: 0 while the step timer
    /// stands.
    ///
    /// `played_start_ticks` is read before, and not after: of a segment that begins in between, too little is known
    /// and not too much.
    #[must_use]
    pub(crate) fn elapsed_ticks(&self, now_ticks: u32) -> u32 {
        if !self.is_running() {
            return 0;
        }
        // Later than now if a segment has begun since the clock was read.
        let elapsed = now_ticks
            .wrapping_sub(self.begin_ticks.load(Relaxed))
            .cast_signed();
        elapsed.clamp(0, SPARSE_SEGMENT_TICKS.cast_signed()) as u32
    }

    /// Sets when the next segment is due, on the generator's clock; for `prepare` alone.
    pub(crate) fn set_next_due(&self, due_ticks: u32) {
        self.due_ticks.store(due_ticks, Relaxed);
    }

    /// Returns whether the next segment is due while steps are played.
    #[must_use]
    pub(crate) fn is_next_due(&self, now_ticks: u32) -> bool {
        let played = self.played_start_ticks();
        let played = played.wrapping_add(self.elapsed_ticks(now_ticks));
        let late = played.wrapping_sub(self.due_ticks.load(Relaxed));
        self.is_running() && late.cast_signed() > 0
    }

    /// Records an underrun, after the step interrupt has stopped in a segment, if something moved and
    /// nobody has halted it.
    fn record_underrun(&self, entry: &RingEntry) {
        if entry.flags.load(Relaxed) & IS_MOVING != 0 && !self.is_halted() {
            self.underrun.store(true, Relaxed);
        }
    }

    /// Records that the step interrupt has stopped, for want of events.
    pub fn stop(&self) {
        self.running.store(false, Relaxed);
    }

    /// Records that the step interrupt has been halted: see [`EventTap::halt`].
    pub(super) fn halt(&self) {
        self.running.store(false, Relaxed);
        self.halted.store(true, Relaxed);
    }

    /// Returns whether the step interrupt has been halted and `prepare` has not acted on it.
    #[must_use]
    pub fn is_halted(&self) -> bool {
        self.halted.load(Relaxed)
    }

    /// Discards the segments that have not begun, and clears a halt. For `prepare`, while the step
    /// interrupt is stopped.
    pub(super) fn discard_pending(&self) {
        self.pushed.store(self.begun.load(Relaxed), Relaxed);
        self.underrun.store(false, Relaxed);
        self.halted.store(false, Relaxed);
    }

    /// Returns the steps at the start, the directions, and the number of the first event of the
    /// segment in which `events` had been output; `None` when that is too long ago.
    pub(super) fn segment_at(&self, events: u32) -> Option<(Axes<i32>, u8, u32)> {
        let begun = self.begun.load(Relaxed);
        for back in 0..SEGMENT_RING as u32 {
            let entry = self.entry(begun.wrapping_sub(back + 1));
            let first = entry.first_event.load(Relaxed);
            let since = events.wrapping_sub(first);
            if since.cast_signed() >= 0 {
                let steps = Axes::from_fn(|axis| entry.steps[axis].load(Relaxed));
                return Some((steps, entry.flags.load(Relaxed) as u8, first));
            }
        }
        None
    }

    /// Returns what a report shows of the segment being played: the step count of each axis at its
    /// start, the speed along the path, mm/min, and the `N` word of its block, 0 without.
    #[must_use]
    pub fn status(&self) -> (Axes<i32>, f32, u32) {
        let played = self.played();
        (
            Axes::from_fn(|axis| played.steps[axis].load(Relaxed)),
            f32::from_bits(played.feed_mm_min.load(Relaxed)),
            played.line.load(Relaxed),
        )
    }

    /// Returns the step count of each axis at the start of the segment being played.
    #[must_use]
    pub fn position(&self) -> Axes<i32> {
        let played = self.played();
        Axes::from_fn(|axis| played.steps[axis].load(Relaxed))
    }

    /// Returns the numbers of the newest segment and of the one being played, wrapping.
    #[must_use]
    pub fn numbers(&self) -> (u32, u32) {
        let newest = |count: &AtomicU32| count.load(Relaxed).wrapping_sub(1);
        (newest(&self.pushed), newest(&self.begun))
    }

    /// Returns the start of the segment being played, on the generator's clock.
    #[must_use]
    pub fn played_start_ticks(&self) -> u32 {
        self.played().start_ticks.load(Relaxed)
    }

    /// Returns the spindle speed or laser power in the segment being played, rpm.
    #[must_use]
    pub fn spindle_rpm(&self) -> f32 {
        f32::from_bits(self.played().spindle_rpm.load(Relaxed))
    }

    /// Returns the spindle PWM in the segment being played.
    #[must_use]
    pub fn duty(&self) -> u16 {
        self.duty_of(self.played().flags.load(Relaxed))
    }

    fn duty_of(&self, flags: u32) -> u16 {
        ((flags & self.flags_mask.load(Relaxed)) >> DUTY_SHIFT) as u16
    }

    /// Returns the `N` word of the block being played, 0 without.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.played().line.load(Relaxed)
    }

    /// Takes the duty off all segments, also waiting ones, or gives it back; for `prepare` alone.
    pub(crate) fn inhibit_spindle(&self, is_inhibited: bool) {
        let mask = if is_inhibited {
            (1 << DUTY_SHIFT) - 1
        } else {
            u32::MAX
        };
        self.flags_mask.store(mask, Relaxed);
    }

    /// Records that `prepare` starts the step timer, which is stopped.
    pub fn start(&self) {
        self.running.store(true, Relaxed);
    }

    /// Returns whether the step timer runs.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.running.load(Relaxed)
    }

    /// Returns whether the event ring ran empty in motion and `prepare` has not acted on it.
    #[must_use]
    pub fn has_underrun(&self) -> bool {
        self.underrun.load(Relaxed)
    }

    /// Clears the underrun; for `prepare` alone.
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
