//! Makes segments for the step interrupt, and ends the motion after the last one.

use super::{Activity, Motion, delays::Restoring};
use crate::{
    machine::{Ending, Event, Inputs},
    model::{Levels, State, timing::SEGMENT_TICKS},
    motion::executor::{Goal, NextSegment},
    stepper::{EventWriter, Segment, SegmentRing},
};

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
        self.queue.full = (!is_done).then(|| segments.played_start_ticks());
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

    /// Whether there is a next segment.
    #[inline]
    pub(super) fn has_motion(&self) -> bool {
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

    /// Enters the state for which the machine was stopped, at rest.
    fn finish_stop(&mut self) {
        if self.parking.is_moving() && self.control.ending == Ending::None {
            self.next_parking_stage();
            return;
        }
        let before = self.control.ending;
        self.transition(Event::Stopped);
        if before != Ending::None {
            self.drop_plan();
        }
        if before == Ending::DropThenDoor {
            // The door was opened in a jog, which has just been dropped: Z is not parked.
            self.control = self.control.after(Event::Stopped).0;
            self.accessories.suspend();
        }
    }

    /// Ends what has been executed, at rest.
    #[inline(never)]
    fn end_motion(&mut self, inputs: &Inputs) {
        if matches!(self.activity, Activity::Dwell(0)) {
            self.finish_activity();
        }
        if let Some(alarm) = self.faults.at_standstill.take() {
            self.alarm(alarm);
        }
        self.finish_stop();
        self.end_cycles(inputs);
        if !self.has_path() {
            self.transition(Event::CycleStop);
        }
    }

    /// Enters the state of standstill, when everything has been played.
    #[inline(never)]
    pub(super) fn enter_standstill(&mut self, inputs: &Inputs) {
        self.end_motion(inputs);
        let is_door_open = self.inputs.has(Levels::DOOR);
        if core::mem::take(&mut self.faults.checks_door) && is_door_open {
            self.open_door();
        }
        if !is_door_open && self.control.state == State::DoorAjar {
            self.transition(Event::DoorClosed);
        }
        self.apply_state();
        if self.control.state == State::HoldComplete {
            self.accessories.stop_in_hold();
        }
        if !self.has_path() && !self.control.state.is_suspended() {
            self.accessories.apply_speed();
        }
        if self.delays.restoring != Restoring::None {
            self.restore();
        }
        self.watch_spindle();
        self.begin_moves();
        self.start_idle_delay();
    }

    /// Applies a new state at once, also in motion.
    #[inline]
    pub(super) fn apply_state(&mut self) {
        if self.is_held() {
            self.accessories.begin_hold();
        }
        self.begin_moves();
    }
}
