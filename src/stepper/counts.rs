//! What `prepare` and the step interrupt tell each other of segments: lock-free, one ring.
//!
//! `prepare` announces each segment before its first event, with the steps at which it begins; the
//! step interrupt says which one it plays. It plays every event exactly once, so nothing needs to be
//! counted: the position is that of the segment.

use core::sync::atomic::{
    AtomicBool, AtomicI32, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use super::{SEGMENT_RING, SegmentInfo};
use crate::axis::{AXES, Axes};

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

/// What the step interrupt has to do at the first event of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Begun {
    /// Direction outputs, bit 0 = X, 1 = negative.
    pub directions: u8,
    /// Spindle PWM, 0 to [`crate::machine::Outputs::FULL`].
    pub duty: u16,
    /// Whether anything moves.
    pub(super) is_moving: bool,
}

/// Slots, a power of two: those of the segments that may wait, and of those played last.
const SLOTS: usize = 2 * SEGMENT_RING;

/// What the step interrupt plays.
///
/// Written by `prepare` (announcements) and the step interrupt (the rest). `running` is written by
/// whoever can: by `prepare` while the timer stands, by the step interrupt while it runs.
#[derive(Debug)]
pub struct StepCounts {
    slots: [Slot; SLOTS],
    /// Segments announced so far, wrapping.
    announced: AtomicU32,
    /// Segments begun so far, wrapping.
    begun: AtomicU32,
    late: AtomicU32,
    /// The part of the flags that counts: all, or no duty.
    mask: AtomicU32,
    running: AtomicBool,
    starved: AtomicBool,
    /// The step interrupt is to stop, or has stopped, at once; written by `inputs`, cleared by
    /// `prepare` when it stands.
    cut: AtomicBool,
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
                    spindle_rpm: AtomicU32::new(0),
                    line: AtomicU32::new(0),
                    first_event: AtomicU32::new(0),
                    steps: [const { AtomicI32::new(0) }; AXES],
                }
            }; SLOTS],
            announced: AtomicU32::new(0),
            begun: AtomicU32::new(0),
            late: AtomicU32::new(0),
            mask: AtomicU32::new(u32::MAX),
            running: AtomicBool::new(false),
            starved: AtomicBool::new(false),
            cut: AtomicBool::new(false),
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
            .announced
            .load(Relaxed)
            .wrapping_sub(self.begun.load(Relaxed));
        waiting < SEGMENT_RING as u32 - 1
    }

    /// Announces a segment, before its first event; there must be room.
    pub(super) fn announce(&self, info: &SegmentInfo) {
        let number = self.announced.load(Relaxed);
        let slot = self.slot(number);
        let moving = if info.is_rest { 0 } else { IS_MOVING };
        let duty = u32::from(info.duty) << DUTY_SHIFT;
        slot.flags
            .store(u32::from(info.directions) | moving | duty, Relaxed);
        slot.start_ticks.store(info.start_ticks, Relaxed);
        slot.feed_mm_min.store(info.feed_mm_min.to_bits(), Relaxed);
        slot.spindle_rpm.store(info.spindle_rpm.to_bits(), Relaxed);
        slot.line.store(info.line, Relaxed);
        slot.first_event.store(info.first_event, Relaxed);
        // wcet-bound: 6
        for (to, from) in slot.steps.iter().zip(&info.steps) {
            to.store(*from, Relaxed);
        }
        // The step interrupt comes here by the segment's first event only, which is put later.
        compiler_fence(SeqCst);
        self.announced.store(number.wrapping_add(1), Relaxed);
    }

    /// The step interrupt begins the next segment.
    #[inline]
    pub(super) fn begin(&self) -> Begun {
        let number = self.begun.load(Relaxed);
        self.begun.store(number.wrapping_add(1), Relaxed);
        let flags = self.slot(number).flags.load(Relaxed) & self.mask.load(Relaxed);
        Begun {
            directions: flags as u8,
            duty: (flags >> DUTY_SHIFT) as u16,
            is_moving: flags & IS_MOVING != 0,
        }
    }

    /// The step interrupt has stopped: a fault if anything moved and nobody wanted it.
    #[inline]
    pub(super) fn stop(&self, is_moving: bool) {
        self.running.store(false, Relaxed);
        if is_moving && !self.is_cut() {
            self.starved.store(true, Relaxed);
        }
    }

    /// Asks the step interrupt to stop at once; see [`EventTap::cut`](super::EventTap::cut).
    pub(super) fn ask_cut(&self) {
        self.cut.store(true, Relaxed);
    }

    /// Whether the step interrupt has been asked to stop at once and nobody has seen to it yet.
    #[inline]
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.cut.load(Relaxed)
    }

    /// The directions that the pins have: those of the segment being played.
    pub(super) fn directions(&self) -> u8 {
        self.played().flags.load(Relaxed) as u8
    }

    /// Drops the segments that have not begun; ends a cut. For `prepare`, while the step interrupt
    /// stands.
    pub(super) fn drop_waiting(&self) {
        self.announced.store(self.begun.load(Relaxed), Relaxed);
        self.starved.store(false, Relaxed);
        self.cut.store(false, Relaxed);
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

    /// Step count of each axis when the segment being played began.
    #[must_use]
    pub fn position(&self) -> Axes<i32> {
        let played = self.played();
        Axes::from_fn(|axis| played.steps[axis].load(Relaxed))
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

    /// Spindle speed or laser power in the segment being played, rpm.
    #[must_use]
    pub fn spindle_rpm(&self) -> f32 {
        f32::from_bits(self.played().spindle_rpm.load(Relaxed))
    }

    /// Spindle PWM in the segment being played.
    #[must_use]
    pub fn duty(&self) -> u16 {
        let flags = self.played().flags.load(Relaxed) & self.mask.load(Relaxed);
        (flags >> DUTY_SHIFT) as u16
    }

    /// `N` word of the block being played, 0 without.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.played().line.load(Relaxed)
    }

    /// Whether segments, also those that wait, have no duty from now on; for `prepare` alone.
    pub(crate) fn mute(&self, is_mute: bool) {
        let mask = if is_mute {
            (1 << DUTY_SHIFT) - 1
        } else {
            u32::MAX
        };
        self.mask.store(mask, Relaxed);
    }

    /// `prepare` is about to start the step timer, which stands.
    ///
    /// Not left to the step interrupt: after a fault the first event may be in the middle of a
    /// segment, and a timer that runs must not be started.
    pub(crate) fn start(&self) {
        self.running.store(true, Relaxed);
    }

    /// Whether the step timer runs; when it does not, a new event needs it started.
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

    fn announce(counts: &StepCounts, steps: i32) {
        counts.announce(&SegmentInfo {
            steps: Axes::all(steps),
            directions: steps as u8,
            duty: 1020,
            ..SegmentInfo::default()
        });
    }

    #[test]
    fn the_position_is_that_of_the_segment_being_played() {
        let counts = StepCounts::new();
        for number in 0..100 {
            announce(&counts, number);
            assert_eq!(counts.position(), Axes::all((number - 1).max(0)));
            let begun = counts.begin();
            assert_eq!((begun.directions, begun.duty), (number as u8, 1020));
            assert!(begun.is_moving);
            assert_eq!(counts.position(), Axes::all(number));
        }
    }

    #[test]
    fn no_segment_is_announced_over_one_that_is_played_or_waits() {
        let counts = StepCounts::new();
        let mut announced = 0;
        while counts.has_room() {
            announce(&counts, announced);
            announced += 1;
        }
        assert_eq!(announced, SEGMENT_RING.cast_signed() as i32 - 1);
        counts.begin();
        assert!(counts.has_room());
    }
}
