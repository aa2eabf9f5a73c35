//! What a run of `prepare` does: it makes a segment, or a sample of the reference motion, or does a job, entries
//! among them. Another run follows while there is more to do.
//!
//! In order of precedence: what stops the machine; requests, but not again and again; a segment
//! that is due; positions to be latched; the plan; entries; a first segment; standstill. Whatever
//! comes meanwhile counts in the next run. At standstill no segment is due: [`Job::FirstSegment`]
//! has the next run make one.
//!
//! A run begins with one decision, [`NextRun`]. After a job `needs_segment` and `has_other_job` say whether
//! another run follows at once; after a segment, room in the queues takes the place of `needs_segment`.

use heapless::spsc::Consumer;

use super::{Activity, Motion};
use crate::{
    machine::{Ending, Event, Inputs},
    model::{
        Requests, State,
        timing::{QUEUED_AHEAD_TICKS, SEGMENT_TICKS},
    },
    motion::executor::{Goal, NextSegment},
    path::{Entry, MoveKind, Work},
    stepper::{EventWriter, Segment, SegmentRing},
    units::TICKS_PER_MS,
};

/// Least motion played between two runs that handle requests while a segment is due, ticks: bounds
/// how much a flood of bytes delays segments (`task.prepare.mode.requests` in schedule.toml). Other
/// requests wait until no segment is due.
pub const REQUEST_INTERVAL_TICKS: u32 = 5 * TICKS_PER_MS;

/// What a run does.
pub(super) enum NextRun {
    /// A segment, or the events of the last one.
    Segment,
    /// The sample of the reference that the next segment needs.
    Sample,
    /// The next [`Job`]: no segment is due.
    Job,
}

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

/// What a segment is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SegmentSource {
    Homing,
    Parking,
    /// A dwell, with what is left of it, ticks.
    Dwell(u64),
    TakeUp,
    Plan,
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

    /// Returns what the run does.
    #[inline]
    pub(super) fn next_run(&self, conditions: RunConditions, segments: &SegmentRing) -> NextRun {
        let precedes = if conditions.is_running || self.generator.is_open() {
            !conditions.has_requests || self.has_just_handled(conditions.played)
        } else {
            self.queue.is_first_next && !conditions.has_requests
        };
        let is_stopped = segments.has_underrun() || !conditions.is_running && segments.is_halted();
        let moves = self.is_in_motion() || self.queue.is_first_next;
        let is_due = precedes && !is_stopped && moves && self.has_queue_room(conditions, segments);
        if !is_due {
            NextRun::Job
        } else if !self.generator.is_open() && self.average.needs_sample() && self.follows_plan() {
            NextRun::Sample
        } else {
            NextRun::Segment
        }
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
            // In motion, `next_run` has found that no segment is due.
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

    /// Whether another job follows a run, other than a first segment and standstill. Most runs ask, and a
    /// call would be a third of the cost.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "for most runs")]
    pub(super) fn has_other_job(
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
    #[expect(clippy::inline_always, reason = "as for `has_other_job`")]
    fn can_dequeue_next(&self, conditions: RunConditions, entries: &Consumer<'_, Entry>) -> bool {
        let Some(entry) = entries.peek() else {
            return false;
        };
        !self.is_move_without_room(entry)
            && self.can_dequeue(entry, self.is_at_standstill(conditions))
    }

    /// Whether the queues have room for a segment, if there is motion for it.
    #[inline]
    pub(super) fn has_queue_room(&self, conditions: RunConditions, segments: &SegmentRing) -> bool {
        if self.generator.is_open() {
            return self.queue.full != Some(conditions.played);
        }
        let mut ahead = self.generator.clock_ticks().wrapping_sub(conditions.played);
        if ahead >= QUEUED_AHEAD_TICKS {
            ahead = ahead.saturating_sub(segments.elapsed_ticks(self.now_ticks));
        }
        // A segment may last longer than that, and still needs another after it.
        let is_ahead = ahead >= QUEUED_AHEAD_TICKS && conditions.played != self.queue.newest;
        !is_ahead && segments.has_room()
    }

    /// Whether a segment can follow a job, and there is something to make it of. None follows a standstill
    /// that is still to be played, so that the next motion begins with as much ahead as any start has.
    #[inline]
    pub(super) fn needs_segment(&self, conditions: RunConditions, segments: &SegmentRing) -> bool {
        self.has_queue_room(conditions, segments)
            && (self.is_in_motion() || !conditions.is_running && self.has_source())
    }

    /// Whether the last segment is not finished, or is none of standstill.
    #[inline]
    pub(super) const fn is_in_motion(&self) -> bool {
        self.generator.is_open() || self.queue.standstill.is_none()
    }
}

/// Entries of `interpret`, and the beginning of their work.
impl Motion {
    /// Whether an entry is a move for which the plan has no room, as it is most of the time.
    #[inline]
    pub(super) fn is_move_without_room(&self, entry: &Entry) -> bool {
        self.plan.free() == 0 && matches!(entry.work, Work::Move(_)) && !self.is_void(entry)
    }

    /// Whether an entry can be dequeued now: its work can begin, or is void.
    #[inline(never)]
    pub(super) fn can_dequeue(&self, entry: &Entry, is_still: bool) -> bool {
        let is_ending = self.control.ending != Ending::None;
        if matches!(entry.work, Work::Move(_)) {
            let waits = is_ending || self.is_occupied();
            return !waits && self.plan.free() != 0 || self.is_void(entry);
        }
        if self.is_void(entry) {
            return true;
        }
        match entry.work {
            Work::Move(_) | Work::Fault(_) => true,
            Work::Speed(_) => !is_ending && !self.is_occupied(),
            Work::TakeUp(_) => {
                let is_on_path = matches!(self.activity, Activity::Path);
                !is_ending && self.plan.is_empty() && is_on_path && !self.is_occupied()
            }
            // A hold that comes while they are on their way does not keep the old ones in effect.
            Work::Configure(_) if self.control.state == State::HoldComplete => {
                is_still && !is_ending && self.plan.is_empty() && !self.is_occupied()
            }
            Work::Dwell(_)
            | Work::Probe(..)
            | Work::Spindle(..)
            | Work::ReverseTap(..)
            | Work::Coolant(_)
            | Work::Overrides(_)
            | Work::Drivers(_)
            | Work::Pause
            | Work::ToolPause
            | Work::Unlock
            | Work::Home(_)
            | Work::Check
            | Work::Sleep
            | Work::EndOverrides
            | Work::Configure(_) => is_still && !is_ending && !self.is_busy(),
        }
    }

    /// Whether something has to end before work other than a move begins.
    fn is_busy(&self) -> bool {
        // A machine that has just come to rest has to enter the state of standstill first.
        let is_settled = !matches!(self.control.state, State::Run | State::Jog);
        let is_waiting = self.is_occupied() || !is_settled;
        !self.plan.is_empty() || is_waiting || self.control.state.is_suspended()
    }

    /// Whether an entry comes too late: after a reset, a cancelled motion or an alarm.
    #[inline]
    fn is_void(&self, entry: &Entry) -> bool {
        // Settings are never void: the session has taken them over already, at rest.
        let is_old = entry.cancellation_count
            != self
                .handled
                .reset_count
                .wrapping_add(self.published.cancelled_motions);
        let is_move = matches!(entry.work, Work::Move(_));
        let is_locked = self.faults.has_underrun || is_move && self.control.state == State::Alarm;
        (is_old || is_locked) && !matches!(entry.work, Work::Configure(_))
    }

    /// Dequeues one entry, for which that is possible.
    #[inline(never)]
    pub(super) fn dequeue_entry(&mut self, entries: &mut Consumer<'_, Entry>, inputs: &Inputs) {
        let Some(entry) = entries.peek() else {
            return;
        };
        if self.is_void(entry) {
            self.finish_entries(1);
        } else if let Work::Move(block) = &entry.work {
            self.plan.push(block);
        } else if let Work::Speed(rpm) = entry.work {
            self.accessories.queue_speed(rpm);
            self.finish_entries(1);
        } else if let Work::TakeUp(take_up) = entry.work {
            self.begin_take_up(take_up);
        } else {
            // What the moves before have not brought with them comes before this.
            self.accessories.apply_speed();
            self.begin_work(&entry.work, inputs);
        }
        let _ = entries.dequeue();
        self.apply_state();
    }

    /// Applies a new state at once, also in motion.
    #[inline]
    pub(super) fn apply_state(&mut self) {
        if self.is_held() {
            self.accessories.begin_hold();
        }
        self.begin_moves();
    }

    /// Leaves the idle state as soon as there is something to execute.
    pub(super) fn begin_moves(&mut self) {
        if self.is_dwelling() || !matches!(self.control.state, State::Idle | State::Tool) {
            return;
        }
        if let Some(block) = self.plan.current() {
            self.delays.disables_drivers = false;
            let is_jog = block.kind == MoveKind::Jog;
            self.transition(if is_jog { Event::Jog } else { Event::Move });
        }
    }
}

/// Segments for the step interrupt.
impl Motion {
    /// Makes a segment and its events, or the events of the last one for which there was no room.
    #[inline(never)]
    pub(super) fn make_segment(
        &mut self,
        inputs: &Inputs,
        segments: &SegmentRing,
        events: &mut EventWriter<'_>,
    ) {
        if !self.generator.is_open() && !self.begin_segment(inputs, segments) {
            return;
        }
        let is_done = self.generator.push_events(events);
        segments.set_next_due(self.next_due());
        self.queue.full = (!is_done).then(|| segments.played_start_ticks());
    }

    /// Returns when the next segment is due, on the generator's clock: not soon when the machine comes to a standstill.
    #[inline]
    const fn next_due(&self) -> u32 {
        let clock = self.generator.clock_ticks();
        if self.is_in_motion() {
            clock.wrapping_sub(QUEUED_AHEAD_TICKS)
        } else {
            clock.wrapping_add(1 << 30)
        }
    }

    /// Begins a segment, or the standstill after the last one; returns false when there is neither.
    #[inline]
    fn begin_segment(&mut self, inputs: &Inputs, segments: &SegmentRing) -> bool {
        self.queue.is_first_next = false;
        let start = self.generator.clock_ticks();
        self.age_handled(segments.played_start_ticks());
        if self.next_segment(inputs) {
            self.queue.standstill = None;
            #[cfg(arc_machine)]
            self.pass_step_arc();
            self.generator.begin(&self.segment, segments);
        } else if self.queue.standstill.is_none() {
            self.queue.standstill = Some(start);
            let power = self.accessories.power_at_rest();
            self.generator.begin_standstill(power, segments);
        } else {
            return false;
        }
        self.queue.newest = start;
        true
    }

    /// Passes on what the segment has of an arc in whole steps.
    #[cfg(arc_machine)]
    fn pass_step_arc(&mut self) {
        let of_segment = &mut self.executor.step_arc;
        if let Some(arc) = of_segment.entered.take() {
            self.generator.enter_arc(&arc);
        }
        self.generator.set_arc_steps(of_segment.steps.take());
    }

    /// What the next segment is made of.
    #[inline]
    fn source(&self) -> SegmentSource {
        if self.homing.is_active() {
            SegmentSource::Homing
        } else if self.parking.is_moving() {
            SegmentSource::Parking
        } else if let Activity::Dwell(ticks @ 1..) = self.activity
            && self.executes()
        {
            SegmentSource::Dwell(ticks)
        } else if self.takes_up_backlash() {
            SegmentSource::TakeUp
        } else {
            SegmentSource::Plan
        }
    }

    /// Whether something is left that a segment can be made of.
    #[inline]
    fn has_source(&self) -> bool {
        match self.source() {
            SegmentSource::Homing | SegmentSource::Dwell(_) => true,
            SegmentSource::Parking => self.parking.has_segment(self.control.ending),
            SegmentSource::TakeUp => self.has_take_up_segment(),
            SegmentSource::Plan => {
                !self.plan.is_empty() && (self.executes() || self.executor.is_moving())
            }
        }
    }

    /// Whether the next segment follows the plan.
    #[inline]
    pub(super) fn follows_plan(&self) -> bool {
        self.source() == SegmentSource::Plan && !self.plan.is_empty()
    }

    /// Whether something is to be executed of the path.
    #[inline]
    pub(super) const fn has_path(&self) -> bool {
        !self.plan.is_empty() || self.takes_up_backlash()
    }

    pub(super) fn executes(&self) -> bool {
        let is_touched = match &self.activity {
            Activity::Probing(cycle) => cycle.is_stopping(),
            Activity::Path
            | Activity::TakeUp
            | Activity::Dwell(_)
            | Activity::Pause
            | Activity::ToolPause
            | Activity::Homing => false,
        };
        self.control.executes() && !is_touched
    }

    /// Makes the next sample of the reference.
    #[inline(never)]
    pub(super) fn sample_reference(&mut self) {
        let leaving = self.average.leaving_sample();
        let sample = self.plan.next_sample(!self.executes(), leaving);
        self.average.push(sample, leaving);
    }

    /// Makes the next segment, in `Motion::segment`; returns false when there is none.
    fn next_segment(&mut self, inputs: &Inputs) -> bool {
        match self.source() {
            SegmentSource::Homing => self.homing_segment(inputs),
            SegmentSource::Parking => self.parking_segment(),
            SegmentSource::Dwell(ticks) => self.dwell_segment(ticks),
            SegmentSource::TakeUp => self.take_up_segment(),
            SegmentSource::Plan => self.plan_segment(),
        }
    }

    /// Makes the next segment of the plan.
    #[inline]
    fn plan_segment(&mut self) -> bool {
        let goal = if self.executes() {
            Goal::Run
        } else {
            Goal::Stop
        };
        let position = self.generator.position();
        let (executor, average) = (&mut self.executor, &mut self.average);
        let segment = &mut self.segment;
        match (self.plan).next_segment(executor, average, position, goal, segment) {
            NextSegment::Standstill => return false,
            NextSegment::WithinBlock => {}
            NextSegment::EndsBlock => {
                if !self.is_probing() {
                    self.finish_entries(1);
                }
            }
        }
        let (laser, part) = self.executor.laser();
        self.accessories.begin_block(laser);
        self.segment.power = self.accessories.power_in_motion(laser, part);
        self.enable_drivers();
        true
    }

    /// Makes the next segment of a dwell that has these ticks left.
    #[inline(never)]
    fn dwell_segment(&mut self, left: u64) -> bool {
        let ticks = left.min(u64::from(SEGMENT_TICKS)) as u32;
        self.activity = Activity::Dwell(left - u64::from(ticks));
        self.segment = Segment {
            power: self.accessories.power_at_rest(),
            ..Segment::standstill(ticks, self.generator.position())
        };
        true
    }
}
