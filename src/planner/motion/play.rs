//! Keeps the step interrupt's queue filled, and follows what it has played.

use super::{Motion, rest::Restoring};
use crate::{
    machine::{Ending, Event, Inputs, Levels, State},
    planner::executor::Goal,
    stepper::{
        AHEAD_TICKS, AxisMotion, EventWriter, SEGMENT_RING, SEGMENT_TICKS, Segment, StepCounts,
    },
};

impl Motion {
    pub(super) fn generate(
        &mut self,
        inputs: &Inputs,
        counts: &StepCounts,
        events: &mut EventWriter<'_>,
    ) {
        // wcet-bound: 32
        for _ in 0..SEGMENT_RING {
            if self.generator.is_open() && !self.generator.fill(events) {
                return;
            }
            let ahead = self
                .generator
                .clock_ticks()
                .wrapping_sub(counts.played_ticks());
            // A segment that had to be stretched may last longer than that, and still needs another.
            let is_ahead = ahead >= AHEAD_TICKS && counts.played_ticks() != self.newest;
            if is_ahead || !counts.has_room() {
                return;
            }
            let start = self.generator.clock_ticks();
            if self.next_segment(inputs) {
                self.rest = None;
                self.generator.begin(&self.segment, counts);
            } else if self.rest.is_none() {
                self.rest = Some(start);
                let power = self.accessories.power_at_rest();
                self.generator.rest(power, counts);
            } else {
                return;
            }
            self.newest = start;
        }
    }

    /// Makes the next segment, in [`Motion::segment`]; false when there is none.
    fn next_segment(&mut self, inputs: &Inputs) -> bool {
        if self.homing.is_active() {
            return self.next_of_homing(inputs);
        }
        if self.parking.is_moving() {
            return self.parking_segment();
        }
        let executes = self.control.executes() && !self.probe.is_touched();
        if self.dwell_ticks != 0 && executes {
            self.stand_still();
            return true;
        }
        let goal = if executes { Goal::Run } else { Goal::Stop };
        let blocks = self.plan.len();
        let position = self.generator.position();
        let (plan, segment) = (&mut self.plan, &mut self.segment);
        if !self.executor.next(plan, &position, goal, segment) {
            return false;
        }
        let done = if self.probe.is_active() {
            0
        } else {
            blocks - self.plan.len()
        };
        self.finished = self.finished.wrapping_add(done as u32);
        let (laser, part) = self.executor.beam();
        self.accessories.begin(laser);
        self.segment.power = self.accessories.power_in_motion(laser, part);
        self.need_drivers();
        true
    }

    /// A piece of a dwell.
    #[inline(never)]
    fn stand_still(&mut self) {
        let ticks = self.dwell_ticks.min(u64::from(SEGMENT_TICKS)) as u32;
        self.dwell_ticks -= u64::from(ticks);
        self.segment = Segment {
            ticks,
            axes: self.generator.position().map(|to| AxisMotion {
                to,
                acceleration: 0.0,
            }),
            feed_mm_min: 0.0,
            line: 0,
            power: self.accessories.power_at_rest(),
        };
    }

    /// The machine is at rest: what it was stopped for.
    fn stop(&mut self) {
        if self.parking.is_moving() && self.control.ending == Ending::None {
            self.go_on_parking();
            return;
        }
        let before = self.control.ending;
        self.on(Event::Stopped);
        if before == Ending::DropThenDoor {
            // The door was opened in a jog, which has just been dropped: Z is not parked.
            self.control = self.control.after(Event::Stopped).0;
            self.accessories.cut();
        }
    }

    /// What ends, or begins, when the machine is at rest.
    #[inline(never)]
    fn come_to_rest(&mut self) {
        if self.is_dwelling && self.dwell_ticks == 0 {
            self.is_dwelling = false;
            self.finished = self.finished.wrapping_add(1);
        }
        if let Some(alarm) = self.fault.take() {
            self.alarm(alarm);
        }
        self.stop();
        self.end_cycles();
        if self.plan.is_empty() {
            self.on(Event::Done);
        }
    }

    /// The state that follows from what has been played.
    #[inline]
    pub(super) fn settle(&mut self, counts: &StepCounts) {
        let is_still = self.is_still(counts);
        if is_still {
            self.come_to_rest();
        }
        let is_door_open = self.inputs.has(Levels::DOOR);
        if is_still && core::mem::take(&mut self.looks_at_door) && is_door_open {
            self.open_door();
        }
        if !is_door_open && self.control.state == State::DoorAjar {
            self.on(Event::DoorShut);
        }
        if self.is_held() {
            self.accessories.begin_hold();
        }
        if self.control.state == State::HoldComplete {
            self.accessories.rest_in_hold();
        }
        if self.restoring != Restoring::No {
            self.restore();
        }
        self.begin_moves();
        if is_still {
            self.rest_drivers();
        }
    }
}
