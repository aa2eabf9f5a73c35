//! The jobs of `prepare`: a run does one of them, or makes a segment, and another run follows while
//! there is more to do.
//!
//! In order of precedence: what stops the machine; requests, but not again and again; a segment
//! that is due; positions to be latched; the plan; entries; a first segment; standstill. Whatever
//! comes meanwhile counts in the next run. At standstill no segment is due: [`Job::FirstSegment`]
//! has the next run make one.

use heapless::spsc::Consumer;

use super::Motion;
use crate::{
    machine::Inputs,
    model::{Requests, timing::QUEUED_AHEAD_TICKS},
    path::Entry,
    stepper::SegmentRing,
    units::TICKS_PER_MS,
};

/// Motion played between two runs for requests that precede a segment which is due, ticks: bounds
/// how much a flood of bytes delays segments (`task.prepare.mode.requests` in schedule.toml). Other
/// requests wait until no segment is due.
const REQUEST_INTERVAL_TICKS: u32 = 5 * TICKS_PER_MS;

/// The work of a run that makes neither a segment nor a sample of the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Job {
    /// Nothing.
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

/// The state at the beginning of a run: each later change of it releases another run.
#[derive(Debug, Clone, Copy)]
pub(super) struct RunConditions {
    /// Start of the segment being played.
    pub(super) played: u32,
    /// The step timer runs.
    pub(super) is_running: bool,
    /// Something has been asked for.
    has_requests: bool,
}

impl Motion {
    /// Returns the state at the beginning of a run.
    #[inline]
    pub(super) fn conditions(&self, requests: &Requests, segments: &SegmentRing) -> RunConditions {
        RunConditions {
            played: segments.played_start_ticks(),
            is_running: segments.is_running(),
            has_requests: requests.reset_count() != self.handled.reset_count
                || requests.count() != self.handled.requests,
        }
    }

    /// Whether a segment is due, before any job.
    #[inline]
    pub(super) fn is_segment_due(&self, conditions: RunConditions, segments: &SegmentRing) -> bool {
        let precedes = if conditions.is_running || self.generator.is_open() {
            !conditions.has_requests || self.has_just_handled(conditions.played)
        } else {
            self.queue.is_first_next && !conditions.has_requests
        };
        let is_stopped = segments.has_underrun() || !conditions.is_running && segments.is_halted();
        precedes
            && !is_stopped
            && (self.is_in_motion() || self.queue.is_first_next)
            && self.has_room(conditions, segments)
    }

    /// Returns the job of a run in which no segment is due.
    #[inline]
    pub(super) fn next_job(
        &self,
        conditions: RunConditions,
        requests: &Requests,
        inputs: &Inputs,
        segments: &SegmentRing,
        entries: &Consumer<'_, Entry>,
    ) -> Job {
        if segments.has_underrun() {
            Job::Underrun
        } else if !conditions.is_running && segments.is_halted() {
            Job::Halted
        } else if requests.reset_count() != self.handled.reset_count {
            Job::Reset
        } else if conditions.has_requests {
            Job::Requests
        } else if self.is_in_cycle() && self.has_latched(inputs) {
            Job::LatchPosition
        } else if self.plan.is_unfinished() {
            Job::Plan
        } else if self.can_dequeue_next(conditions, entries) {
            Job::Dequeue
        } else if conditions.is_running || self.generator.is_open() {
            // A segment would be due.
            Job::None
        } else if self.needs_segment(conditions, segments) {
            if self.waits_before_motion() {
                Job::None
            } else {
                Job::FirstSegment
            }
        } else if self.is_at_standstill(conditions) {
            Job::Standstill
        } else {
            Job::None
        }
    }

    /// Whether requests wait for segments, as the last ones were handled a short time ago.
    #[inline]
    fn has_just_handled(&self, played: u32) -> bool {
        played.wrapping_sub(self.handled.ticks) < REQUEST_INTERVAL_TICKS
    }

    /// Keeps the last handled request from being older than matters, as the clock of the motion
    /// wraps. Once in a segment.
    #[inline]
    pub(super) fn age_handled(&mut self, played: u32) {
        if !self.has_just_handled(played) {
            self.handled.ticks = played.wrapping_sub(REQUEST_INTERVAL_TICKS);
        }
    }

    /// Whether there is another job, other than a first segment and standstill.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "most runs call it, and the call costs a third of it"
    )]
    pub(super) fn has_more(
        &self,
        conditions: RunConditions,
        inputs: &Inputs,
        entries: &Consumer<'_, Entry>,
    ) -> bool {
        conditions.has_requests
            || self.plan.is_unfinished()
            || self.is_in_cycle() && self.has_latched(inputs)
            || self.can_dequeue_next(conditions, entries)
    }

    /// Whether there is an entry that can be dequeued now.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `has_more`")]
    fn can_dequeue_next(&self, conditions: RunConditions, entries: &Consumer<'_, Entry>) -> bool {
        let Some(entry) = entries.peek() else {
            return false;
        };
        !self.is_move_without_room(entry)
            && self.can_dequeue(entry, self.is_at_standstill(conditions))
    }

    /// Whether the next segment needs another sample of the reference first.
    #[inline]
    pub(super) fn needs_sample(&self) -> bool {
        !self.generator.is_open() && self.average.needs_sample() && self.follows_plan()
    }

    /// Whether a segment can be made now, if there is motion for it.
    #[inline]
    pub(super) fn has_room(&self, conditions: RunConditions, segments: &SegmentRing) -> bool {
        if self.generator.is_open() {
            return self.queue.full != Some(conditions.played);
        }
        let ahead = self.generator.clock_ticks().wrapping_sub(conditions.played);
        // A segment may last longer than that, and still needs another after it.
        let is_ahead = ahead >= QUEUED_AHEAD_TICKS && conditions.played != self.queue.newest;
        !is_ahead && segments.has_room()
    }

    /// Whether another segment may have to be made after one: not after a standstill that is still to
    /// be played, so that the next motion begins with as much ahead as any start has.
    #[inline]
    pub(super) fn may_need_segment(
        &self,
        conditions: RunConditions,
        segments: &SegmentRing,
    ) -> bool {
        (self.is_in_motion() || !conditions.is_running) && self.has_room(conditions, segments)
    }

    /// Whether a segment can be made now, and there is motion for it.
    #[inline]
    pub(super) fn needs_segment(&self, conditions: RunConditions, segments: &SegmentRing) -> bool {
        self.may_need_segment(conditions, segments) && (self.is_in_motion() || self.has_motion())
    }

    /// Whether the last segment is not finished, or is none of standstill.
    #[inline]
    pub(super) const fn is_in_motion(&self) -> bool {
        self.generator.is_open() || self.queue.standstill.is_none()
    }
}
