//! The units of work of `prepare`: a run does one of them, and another run follows while there is
//! more to do.
//!
//! So a run lasts as long as its longest unit, not as long as all of them, and whatever comes is
//! looked at between two. In order of precedence: what stops the machine; what has been asked for, but
//! not again and again; a segment that is needed; what the switches say; the plan; entries; a first
//! segment; what follows from being at rest.

use heapless::spsc::Consumer;

use super::Motion;
use crate::{
    machine::Inputs,
    planner::Entry,
    protocol::realtime::Requests,
    stepper::{AHEAD_TICKS, StepCounts},
    units::TICKS_PER_MS,
};

/// Motion played from one look at what has been asked for to the next that comes before a segment which
/// is needed, ticks: so a flood of bytes does not have the queue run dry. Others come where there is time.
const PATIENCE_TICKS: u32 = 5 * TICKS_PER_MS;

/// What a run does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unit {
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
    /// One cell of the reference, which the next segment needs.
    Pace,
    /// One segment.
    Segment,
    /// The state that follows from being at rest.
    Settle,
}

impl Motion {
    /// What is to be done first, when it is known whether the step timer runs.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "twice in a run, and a call costs a quarter of it"
    )]
    pub(super) fn next_unit(
        &self,
        is_running: bool,
        requests: &Requests,
        inputs: &Inputs,
        counts: &StepCounts,
        entries: &Consumer<'_, Entry>,
    ) -> Unit {
        if counts.is_starved() {
            return Unit::Fail;
        }
        if !is_running && counts.is_cut() {
            return Unit::Cut;
        }
        let played = counts.played_ticks();
        let ahead = self.generator.clock_ticks().wrapping_sub(played);
        let makes = self.makes_segment(ahead, played, is_running, counts);
        let is_due = makes && (is_running || self.generator.is_open());
        let asked = self.asked(requests);
        let waits = self.has_just_heard(played);
        if is_due && (asked.is_none() || waits) {
            return self.segment_unit();
        }
        if let Some(unit) = asked {
            return unit;
        }
        if self.is_in_cycle() && self.has_found(inputs) {
            return Unit::Find;
        }
        if self.plan.is_unfinished() {
            return Unit::Plan;
        }
        let is_still = self.is_still(is_running, counts);
        if let Some(entry) = entries.peek()
            && !self.has_no_place(entry)
            && self.takes(entry, is_still)
        {
            return Unit::Take;
        }
        if makes {
            self.segment_unit()
        } else if is_still {
            Unit::Settle
        } else {
            Unit::Nothing
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

    /// What has been asked for.
    #[inline]
    fn asked(&self, requests: &Requests) -> Option<Unit> {
        if requests.epoch() != self.epoch {
            Some(Unit::Reset)
        } else if requests.asked() != self.heard {
            Some(Unit::Obey)
        } else {
            None
        }
    }

    /// Whether another run has to follow one that did this unit, when this one is the next.
    #[inline]
    pub(super) fn goes_on(&self, unit: Unit, next: Unit) -> bool {
        match next {
            Unit::Nothing => false,
            // Z may have to stop nowhere on its way, so that nothing was to be played.
            Unit::Settle => unit != Unit::Settle || self.parking.is_moving() || self.is_unsettled,
            Unit::Fail
            | Unit::Cut
            | Unit::Reset
            | Unit::Obey
            | Unit::Find
            | Unit::Plan
            | Unit::Take
            | Unit::Pace
            | Unit::Segment => true,
        }
    }

    /// What makes the next segment: the segment, or a cell for it first.
    #[inline]
    fn segment_unit(&self) -> Unit {
        if !self.generator.is_open() && self.smooth.needs_cell() && self.follows_plan() {
            Unit::Pace
        } else {
            Unit::Segment
        }
    }

    /// Whether a segment can be made now, and is to be. Behind a standstill that is still to be played
    /// none is: what follows begins with as much ahead as any start has.
    #[inline]
    fn makes_segment(
        &self,
        ahead: u32,
        played: u32,
        is_running: bool,
        counts: &StepCounts,
    ) -> bool {
        if self.generator.is_open() {
            return self.full != Some(played);
        }
        // A segment that had to be stretched may last longer than that, and still needs another.
        let is_ahead = ahead >= AHEAD_TICKS && played != self.newest;
        !is_ahead && counts.has_room() && (self.rest.is_none() || !is_running && self.has_motion())
    }
}
