//! Homing, probing, parking and hard limits: what they do to the machine.

use super::{Activity, Motion};
use crate::{
    axis::Z,
    machine::{Event, Inputs},
    model::{Alarm, Levels, Notice, Power, Probing, State},
    motion::cycles::{
        parking::Reached,
        probing::{ProbingCycle, ProbingState},
    },
    path::Block,
    stepper::{EventWriter, SegmentRing, steps_after},
};

impl Motion {
    /// Whether an entry is in execution that moves have to wait for.
    pub(super) const fn is_occupied(&self) -> bool {
        match self.activity {
            Activity::TakeUp | Activity::Dwell(_) | Activity::Homing | Activity::Probing(_) => true,
            Activity::Path | Activity::Pause | Activity::ToolPause => false,
        }
    }

    /// Whether a homing cycle or a probing move is going on.
    pub(super) const fn is_in_cycle(&self) -> bool {
        matches!(self.activity, Activity::Homing | Activity::Probing(_))
    }

    /// Begins a homing cycle, at rest; returns whether the state allows it.
    pub(super) fn begin_homing(&mut self, axes: u8, inputs: &Inputs) -> bool {
        self.transition(Event::Home);
        if self.control.state != State::Home {
            return false;
        }
        self.activity = Activity::Homing;
        self.homing.begin(axes, inputs, &self.generator);
        self.prepare_drivers();
        true
    }

    /// Makes the next segment of homing: a laser is dark, as nothing is to be burnt.
    #[inline(never)]
    pub(super) fn homing_segment(&mut self, inputs: &Inputs) -> bool {
        let power = self.dark_power();
        let segment = &mut self.segment;
        self.homing
            .next(inputs, &mut self.generator, power, segment)
    }

    /// Returns the power at rest, but none of a laser.
    pub(super) fn dark_power(&self) -> Power {
        if self.accessories.is_laser() {
            Power::OFF
        } else {
            self.accessories.power_at_rest()
        }
    }

    /// Ends a homing cycle before its time: the axes slow down.
    pub(super) fn end_homing(&mut self, alarm: Alarm) {
        self.homing.stop();
        self.alarm(alarm);
    }

    /// Begins a probing move, at rest; returns whether it has begun.
    pub(super) fn begin_probe(&mut self, block: &Block, probing: Probing, inputs: &Inputs) -> bool {
        if !matches!(self.control.state, State::Idle | State::Tool) {
            return false;
        }
        self.published.probed.success = false;
        let Some(cycle) = ProbingCycle::begin(block, probing, inputs) else {
            self.alarm(Alarm::ProbeState);
            return false;
        };
        self.stopping_switches = self.stopping_switches & !cycle.switches();
        self.activity = Activity::Probing(cycle);
        self.plan.push(block);
        true
    }

    /// Whether the input interrupt has latched the contact that a cycle waits for.
    #[inline(never)]
    pub(super) fn has_latched(&self, inputs: &Inputs) -> bool {
        match &self.activity {
            Activity::Probing(cycle) => cycle.has_latched(inputs),
            Activity::Homing => self.homing.latched_switch(inputs).is_some(),
            Activity::Path
            | Activity::TakeUp
            | Activity::Dwell(_)
            | Activity::Pause
            | Activity::ToolPause => false,
        }
    }

    /// Takes over the position at which the probe or one limit switch changed. Precedes segments that
    /// are made in advance: these overwrite the events from which the position is computed.
    #[inline(never)]
    pub(super) fn latch_position(
        &mut self,
        inputs: &Inputs,
        segments: &SegmentRing,
        events: &EventWriter<'_>,
    ) {
        let switch = self.homing.latched_switch(inputs);
        let output = match (switch, &self.activity) {
            (Some(switch), _) => Some(inputs.limit_latch(switch)),
            (None, Activity::Probing(cycle)) => cycle.latched_output(inputs),
            (
                None,
                Activity::Path
                | Activity::TakeUp
                | Activity::Dwell(_)
                | Activity::Pause
                | Activity::ToolPause
                | Activity::Homing,
            ) => None,
        };
        let Some(output) = output else {
            if let Activity::Probing(cycle) = &mut self.activity {
                cycle.forget();
            }
            return;
        };
        let position = steps_after(output, segments, events);
        let position = position.unwrap_or_else(|| segments.position());
        match (switch, &mut self.activity) {
            (Some(switch), _) => self
                .homing
                .latch(switch, &position, segments, &self.generator),
            (None, Activity::Probing(cycle)) => cycle.latch(output, position),
            (
                None,
                Activity::Path
                | Activity::TakeUp
                | Activity::Dwell(_)
                | Activity::Pause
                | Activity::ToolPause
                | Activity::Homing,
            ) => {}
        }
    }

    /// Ends cycles that are over. The machine is at rest.
    #[inline(never)]
    pub(super) fn end_cycles(&mut self, inputs: &Inputs) {
        if matches!(self.activity, Activity::Homing) && !self.homing.is_active() {
            self.finish_activity();
            self.backlash.home(self.homing.homed_axes());
            if self.control.state == State::Home {
                match self.homing.take_alarm() {
                    Some(alarm) => self.alarm(alarm),
                    None => self.transition(Event::Unlock),
                }
            }
        }
        let is_done = self.plan.is_empty();
        if let Activity::Probing(cycle) = &mut self.activity
            && (is_done || cycle.is_stopping())
            && matches!(self.control.state, State::Idle | State::Run | State::Tool)
            && cycle.at_rest(is_done, inputs) == ProbingState::Ended
        {
            let alarm = cycle.finish(self.generator.steps(), &mut self.published.probed);
            self.has_probed |= self.published.probed.success && !cycle.awaits_a_switch();
            self.end_probe(alarm);
        }
    }

    fn end_probe(&mut self, alarm: Option<Alarm>) {
        self.finish_activity();
        if let Some(alarm) = alarm {
            self.alarm(alarm);
        }
        self.published.notices.push(Notice::Probed);
        // The remainder of the move has been counted with it.
        self.plan.clear();
        self.executor.abandon();
        self.average.reset();
        self.snap_to_steps();
    }

    /// Sets whether limit switches stop the machine from now on: not while homing, nor at rest in
    /// alarm. A machine that slows down in alarm is stopped.
    pub(super) fn arm_hard_limits(&self, inputs: &Inputs, is_still: bool) {
        let is_locked = self.control.state == State::Alarm;
        let is_safe =
            self.control.state == State::Home || is_locked && (self.homing.is_active() || is_still);
        inputs.arm_limits(if is_safe {
            Levels::NONE
        } else {
            self.stopping_switches
        });
    }

    /// Handles a limit switch that has stopped the step interrupt: everything is void, and the position
    /// is where the steps ended.
    #[cold]
    #[inline(never)]
    pub(super) fn handle_halted(&mut self, segments: &SegmentRing, events: &mut EventWriter<'_>) {
        self.generator.discard_unplayed(segments, events);
        self.homing.abandon();
        self.cancel_pause();
        self.drop_plan();
        // A standstill that ends the pulses.
        self.queue.standstill = None;
        if !self.faults.is_critical {
            self.alarm(Alarm::HardLimit);
        }
    }

    /// The door is open and the machine at rest: parks, or only switches everything off.
    pub(super) fn park(&mut self) {
        if self.parking.begin(self.generator.position()[Z]) {
            // Spindle and coolant stay on until Z is out of the work.
            self.control = self.control.after(Event::Park).0;
        } else {
            self.accessories.suspend();
        }
    }

    /// Continues parking where Z has come to rest.
    pub(super) fn next_parking_stage(&mut self) {
        match self.parking.next_stage(self.generator.position()[Z]) {
            None => {}
            Some(Reached::PulledOut) => self.accessories.suspend(),
            Some(Reached::Target) => self.transition(Event::Parked),
            Some(Reached::Waypoint) => self.begin_restoring(),
            Some(Reached::Work) => self.transition(Event::Restored),
        }
    }

    /// Makes the next segment of parking.
    #[inline(never)]
    pub(super) fn parking_segment(&mut self) -> bool {
        let ending = self.control.ending;
        if self.parking.begins_move(ending) {
            self.backlash.begin(&self.generator);
        }
        let of_motor = self.parking.of_motor();
        self.backlash.follow(&mut self.generator, of_motor);
        let position = self.generator.position();
        let lead = self.backlash.of_z();
        if !(self.parking).next(position, ending, lead, &mut self.segment) {
            return false;
        }
        self.segment.power = self.accessories.power_at_rest();
        self.enable_drivers();
        true
    }

    /// A reset while Z moves is one in motion, also on the way back.
    pub(super) fn reset_parking(&mut self) {
        if self.parking.is_moving() {
            self.control.state = State::DoorRetracting;
        }
    }
}
