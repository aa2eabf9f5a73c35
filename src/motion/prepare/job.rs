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
//! ([`Motion::run_job`]). At rest no segment is due: one of the others says that the next run makes one.

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
const REQUEST_INTERVAL_TICKS: u32 = 5 * TICKS_PER_MS;

/// What a run does that makes neither a segment nor a cell of the reference for one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Job {
    /// There is nothing to do.
    None,
    /// The step interrupt ran out of events in motion.
    Underrun,
    /// A limit switch has stopped the step interrupt.
    Halted,
    /// A reset.
    Reset,
    /// Requests.
    Requests,
    /// The position where the probe, or a limit switch, has changed.
    LatchPosition,
    /// A part of planning anew.
    Plan,
    /// One entry.
    Dequeue,
    /// A first segment comes next.
    FirstSegment,
    /// The state that follows from being at rest.
    Standstill,
}

/// What a run finds at its beginning: whoever changes it later releases another run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Context {
    /// Start of the segment being played.
    pub(super) played: u32,
    /// The step timer runs.
    pub(super) is_running: bool,
    /// Something has been asked for.
    has_requests: bool,
}

impl Context {
    /// Whether the step timer is to be started: not before as much is ahead as can be, so that no
    /// short segment ends while others are made.
    #[inline]
    pub(super) fn starts_steps(self, again: bool, events: &EventWriter<'_>) -> bool {
        !self.is_running && !again && events.has_pending()
    }
}

impl Motion {
    /// What a run begins with.
    #[inline]
    pub(super) fn context(&self, requests: &Requests, segments: &SegmentRing) -> Context {
        Context {
            played: segments.played_start_ticks(),
            is_running: segments.is_running(),
            has_requests: requests.reset_count() != self.handled.reset_count
                || requests.asked() != self.handled.requests,
        }
    }

    /// Whether a segment is needed, before everything else.
    #[inline]
    pub(super) fn is_segment_due(&self, context: Context, segments: &SegmentRing) -> bool {
        let precedes = if context.is_running || self.generator.is_open() {
            !context.has_requests || self.has_just_handled(context.played)
        } else {
            self.queue.is_first_next && !context.has_requests
        };
        let is_stopped = segments.has_underrun() || !context.is_running && segments.is_halted();
        precedes
            && !is_stopped
            && (self.is_in_motion() || self.queue.is_first_next)
            && self.has_room(context, segments)
    }

    /// What is to be done when no segment is due.
    #[inline]
    pub(super) fn next_job(
        &self,
        context: Context,
        requests: &Requests,
        inputs: &Inputs,
        segments: &SegmentRing,
        entries: &Consumer<'_, Entry>,
    ) -> Job {
        if segments.has_underrun() {
            Job::Underrun
        } else if !context.is_running && segments.is_halted() {
            Job::Halted
        } else if requests.reset_count() != self.handled.reset_count {
            Job::Reset
        } else if context.has_requests {
            Job::Requests
        } else if self.is_in_cycle() && self.has_latched(inputs) {
            Job::LatchPosition
        } else if self.plan.is_unfinished() {
            Job::Plan
        } else if self.can_dequeue_next(context, entries) {
            Job::Dequeue
        } else if context.is_running || self.generator.is_open() {
            // It would be due.
            Job::None
        } else if self.needs_segment(context, segments) {
            Job::FirstSegment
        } else if self.is_at_standstill(context) {
            Job::Standstill
        } else {
            Job::None
        }
    }

    /// Whether what is asked for waits for segments.
    #[inline]
    fn has_just_handled(&self, played: u32) -> bool {
        played.wrapping_sub(self.handled.ticks) < REQUEST_INTERVAL_TICKS
    }

    /// Lets the last request seem no longer ago than matters: the clock of the motion comes round. Once
    /// in a segment.
    #[inline]
    pub(super) fn age_handled(&mut self, played: u32) {
        if !self.has_just_handled(played) {
            self.handled.ticks = played.wrapping_sub(REQUEST_INTERVAL_TICKS);
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
        context: Context,
        inputs: &Inputs,
        entries: &Consumer<'_, Entry>,
    ) -> bool {
        context.has_requests
            || self.plan.is_unfinished()
            || self.is_in_cycle() && self.has_latched(inputs)
            || self.can_dequeue_next(context, entries)
    }

    /// Whether there is an entry that can be taken now.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `has_more`")]
    fn can_dequeue_next(&self, context: Context, entries: &Consumer<'_, Entry>) -> bool {
        let Some(entry) = entries.peek() else {
            return false;
        };
        !self.is_move_without_room(entry) && self.can_dequeue(entry, self.is_at_standstill(context))
    }

    /// Whether a cell has to be made for the next segment first.
    #[inline]
    pub(super) fn needs_sample(&self) -> bool {
        !self.generator.is_open() && self.smooth.needs_sample() && self.follows_plan()
    }

    /// Whether a segment can be made now, if there is motion for it.
    #[inline]
    pub(super) fn has_room(&self, context: Context, segments: &SegmentRing) -> bool {
        if self.generator.is_open() {
            return self.queue.full != Some(context.played);
        }
        let ahead = self.generator.clock_ticks().wrapping_sub(context.played);
        // A segment that had to be stretched may last longer than that, and still needs another.
        let is_ahead = ahead >= QUEUED_AHEAD_TICKS && context.played != self.queue.newest;
        !is_ahead && segments.has_room()
    }

    /// Whether another segment may have to be made after one: not behind a standstill that is still to
    /// be played, so that what follows begins with as much ahead as any start has.
    #[inline]
    pub(super) fn may_need_segment(&self, context: Context, segments: &SegmentRing) -> bool {
        (self.is_in_motion() || !context.is_running) && self.has_room(context, segments)
    }

    /// Whether a segment can be made now, and is to be.
    #[inline]
    pub(super) fn needs_segment(&self, context: Context, segments: &SegmentRing) -> bool {
        self.may_need_segment(context, segments) && (self.is_in_motion() || self.has_motion())
    }

    /// Whether the last segment has been begun only, or is none of standstill.
    #[inline]
    const fn is_in_motion(&self) -> bool {
        self.generator.is_open() || self.queue.standstill.is_none()
    }
}
