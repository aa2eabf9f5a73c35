//! The units of work of `prepare`: a run does one of them, and another run follows while there is
//! more to do.
//!
//! So a run lasts as long as its longest unit, not as long as all of them, and whatever comes is
//! looked at between two. In order of precedence: what stops the machine; what has been asked for, but
//! not again and again; a segment that is needed; what the switches say; the plan; entries; a first
//! segment; what follows from being at rest.
//!
//! Segments are what most runs make, and what the proof of the timing is about. So these runs look at
//! little besides ([`Motion::is_segment_due`]) and publish little; all others are one function apart
//! ([`Motion::attend`]). At rest no segment is due: one of the others says that the next run makes one.

use heapless::spsc::Consumer;

use super::Motion;
use crate::{
    machine::Inputs,
    model::{Requests, timing::QUEUED_AHEAD_TICKS},
    path::Entry,
    stepper::{EventWriter, SegmentRing},
    units::TICKS_PER_MS,
};

/// Motion played from one look at what has been asked for to the next that comes before a segment which
/// is needed, ticks: so a flood of bytes does not have the queue run dry. Others come where there is time.
const PATIENCE_TICKS: u32 = 5 * TICKS_PER_MS;

/// What a run does that makes neither a segment nor a cell of the reference for one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Job {
    /// There is nothing to do.
    Nothing,
    /// The step interrupt ran out of events in motion.
    Fail,
    /// A limit switch has stopped the step interrupt.
    Cut,
    /// A reset.
    Reset,
    /// Requests.
    Obey,
    /// The position where the probe, or a limit switch, has changed.
    Find,
    /// A part of planning anew.
    Plan,
    /// One entry.
    Take,
    /// A first segment comes next.
    Begin,
    /// The state that follows from being at rest.
    Settle,
}

/// What a run finds at its beginning: whoever changes it later releases another run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Context {
    /// Start of the segment being played.
    pub(super) played: u32,
    /// The step timer runs.
    pub(super) is_running: bool,
    /// Something has been asked for.
    is_asked: bool,
}

impl Context {
    /// Whether the step timer is to be started: not before as much is ahead as can be, so that no
    /// short segment ends while others are made.
    #[inline]
    pub(super) fn starts(self, again: bool, events: &EventWriter<'_>) -> bool {
        !self.is_running && !again && events.has_pending()
    }
}

impl Motion {
    /// What a run begins with.
    #[inline]
    pub(super) fn look(&self, requests: &Requests, segments: &SegmentRing) -> Context {
        Context {
            played: segments.played_start_ticks(),
            is_running: segments.is_running(),
            is_asked: requests.reset_count() != self.reset_count || requests.asked() != self.heard,
        }
    }

    /// Whether a segment is needed, before everything else.
    #[inline]
    pub(super) fn is_segment_due(&self, look: Context, segments: &SegmentRing) -> bool {
        let precedes = if look.is_running || self.generator.is_open() {
            !look.is_asked || self.has_just_heard(look.played)
        } else {
            self.begins && !look.is_asked
        };
        let is_stopped = segments.has_underrun() || !look.is_running && segments.is_halted();
        precedes && !is_stopped && (self.is_begun() || self.begins) && self.has_room(look, segments)
    }

    /// What is to be done when no segment is due.
    #[inline]
    pub(super) fn next_unit(
        &self,
        look: Context,
        requests: &Requests,
        inputs: &Inputs,
        segments: &SegmentRing,
        entries: &Consumer<'_, Entry>,
    ) -> Job {
        if segments.has_underrun() {
            Job::Fail
        } else if !look.is_running && segments.is_halted() {
            Job::Cut
        } else if requests.reset_count() != self.reset_count {
            Job::Reset
        } else if look.is_asked {
            Job::Obey
        } else if self.is_in_cycle() && self.has_found(inputs) {
            Job::Find
        } else if self.plan.is_unfinished() {
            Job::Plan
        } else if self.takes_next(look, entries) {
            Job::Take
        } else if look.is_running || self.generator.is_open() {
            // It would be due.
            Job::Nothing
        } else if self.makes_segment(look, segments) {
            Job::Begin
        } else if self.is_still(look) {
            Job::Settle
        } else {
            Job::Nothing
        }
    }

    /// Whether what is asked for waits for segments.
    #[inline]
    fn has_just_heard(&self, played: u32) -> bool {
        played.wrapping_sub(self.heard_ticks) < PATIENCE_TICKS
    }

    /// Lets the last request seem no longer ago than matters: the clock of the motion comes round. Once
    /// in a segment.
    #[inline]
    pub(super) fn forget_heard(&mut self, played: u32) {
        if !self.has_just_heard(played) {
            self.heard_ticks = played.wrapping_sub(PATIENCE_TICKS);
        }
    }

    /// Whether there is more to be done, but for segments and what follows from being at rest.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "most runs call it, and the call costs a third of it"
    )]
    pub(super) fn has_more(
        &self,
        look: Context,
        inputs: &Inputs,
        entries: &Consumer<'_, Entry>,
    ) -> bool {
        look.is_asked
            || self.plan.is_unfinished()
            || self.is_in_cycle() && self.has_found(inputs)
            || self.takes_next(look, entries)
    }

    /// Whether there is an entry that can be taken now.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `has_more`")]
    fn takes_next(&self, look: Context, entries: &Consumer<'_, Entry>) -> bool {
        let Some(entry) = entries.peek() else {
            return false;
        };
        !self.has_no_place(entry) && self.takes(entry, self.is_still(look))
    }

    /// Whether a cell has to be made for the next segment first.
    #[inline]
    pub(super) fn needs_cell(&self) -> bool {
        !self.generator.is_open() && self.smooth.needs_cell() && self.follows_plan()
    }

    /// Whether a segment can be made now, if there is motion for it.
    #[inline]
    pub(super) fn has_room(&self, look: Context, segments: &SegmentRing) -> bool {
        if self.generator.is_open() {
            return self.full != Some(look.played);
        }
        let ahead = self.generator.clock_ticks().wrapping_sub(look.played);
        // A segment that had to be stretched may last longer than that, and still needs another.
        let is_ahead = ahead >= QUEUED_AHEAD_TICKS && look.played != self.newest;
        !is_ahead && segments.has_room()
    }

    /// Whether another segment may have to be made after one: not behind a standstill that is still to
    /// be played, so that what follows begins with as much ahead as any start has.
    #[inline]
    pub(super) fn goes_on(&self, look: Context, segments: &SegmentRing) -> bool {
        (self.is_begun() || !look.is_running) && self.has_room(look, segments)
    }

    /// Whether a segment can be made now, and is to be.
    #[inline]
    pub(super) fn makes_segment(&self, look: Context, segments: &SegmentRing) -> bool {
        self.goes_on(look, segments) && (self.is_begun() || self.has_motion())
    }

    /// Whether the last segment has been begun only, or is none of standstill.
    #[inline]
    const fn is_begun(&self) -> bool {
        self.generator.is_open() || self.rest.is_none()
    }
}
