//! The homing cycle: finds the limit switches and sets the machine position.
//!
//! ```text
//!   search, $25        |switch|    pull-off, $25       locate, $24       pull-off, $25
//!   ------------------>|---\  |
//!                      |<--/--|------------------>
//!                      |      |                   ---->|\
//!                      |<-----|-----------------------/ ------> $27 from the switch
//! ```
//!
//! Each axis has a speed of its own, so that one that finds its switch slows down while the others
//! go on; a switch stops nothing dead. How far it is pulled off counts from where the switch closed.
//! A pause of `$26` follows each motion, as in Grbl: from when the last switch closed, so that braking
//! is part of it, or from the end of the pull-off. Read with Grbl 1.1 `limits.c`, `limits_go_home`.

mod axis_profile;
mod parameters;

use self::{axis_profile::AxisProfile, parameters::HomingParameters};
use crate::{
    axis::{AXES, Z},
    machine::{Inputs, SAMPLE_TICKS, SAMPLES},
    math,
    model::{
        Alarm, Levels, Power,
        timing::{QUEUED_AHEAD_TICKS, SEGMENT_TICKS},
    },
    settings::Settings,
    stepper::{AxisMotion, Generator, Segment, SegmentRing},
    units::FineSteps,
};

/// How far a switch is searched, in travels, and located, in pull-offs, as in Grbl.
const SEARCH_TRAVELS: f32 = 1.5;
const LOCATE_PULL_OFFS: f32 = 5.0;
/// Time from the last segment of a motion to when it has been played and the switches have been
/// seen: what is prepared ahead, and the filter.
const LATENCY_TICKS: u64 = (QUEUED_AHEAD_TICKS + 3 * SEGMENT_TICKS) as u64;
/// The axes that a cycle homes unless others are named: rotary axes have a switch only sometimes.
const LINEAR_AXES: u8 = 0b111;

/// The motion that the axes make.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HomingStage {
    /// Nothing.
    Idle,
    /// Approaching the switch.
    Search,
    /// Away from it, to come back slowly.
    Clear,
    /// Approaching it again, slowly.
    Locate,
    /// Away from it, to the home position.
    PullOff,
    /// Coming to rest: the cycle has failed.
    Stop,
}

impl HomingStage {
    const fn is_approach(self) -> bool {
        match self {
            Self::Search | Self::Locate => true,
            Self::Idle | Self::Clear | Self::PullOff | Self::Stop => false,
        }
    }

    const fn is_pull_off(self) -> bool {
        match self {
            Self::Clear | Self::PullOff => true,
            Self::Idle | Self::Search | Self::Locate | Self::Stop => false,
        }
    }
}

/// The homing cycle.
#[derive(Debug)]
pub struct Homing {
    parameters: HomingParameters,
    axes: [AxisProfile; AXES],
    /// The axes that are homed now, and those that follow.
    current_axes: u8,
    later_axes: u8,
    stage: HomingStage,
    /// Standstill generated since the last motion, ticks.
    standstill_ticks: u64,
    /// Remainder of the pause of `$26` before the next stage, ticks.
    debounce_ticks: u64,
    alarm: Option<Alarm>,
}

impl Homing {
    /// Nothing to do.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            parameters: HomingParameters::NONE,
            axes: [AxisProfile::NONE; AXES],
            current_axes: 0,
            later_axes: 0,
            stage: HomingStage::Idle,
            standstill_ticks: 0,
            debounce_ticks: 0,
            alarm: None,
        }
    }

    /// Takes over the settings.
    pub fn configure(&mut self, settings: &Settings) {
        self.parameters = HomingParameters::new(settings);
    }

    /// Begins a cycle, at rest: these axes together, bit 0 = X; with 0, Z and then X and Y.
    pub fn begin(&mut self, axes: u8, inputs: &Inputs, generator: &Generator) {
        self.alarm = None;
        if axes == 0 {
            self.current_axes = 1 << Z;
            self.later_axes = LINEAR_AXES & !self.current_axes;
        } else {
            self.current_axes = axes & ((1 << AXES) - 1);
            self.later_axes = 0;
        }
        self.enter(HomingStage::Search, inputs, generator);
    }

    /// Whether a cycle is going on.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.stage != HomingStage::Idle
    }

    /// Ends the cycle as soon as the axes can come to rest: a reset, or the door.
    pub fn stop(&mut self, generator: &Generator) {
        if !self.is_active() {
            return;
        }
        self.stage = HomingStage::Stop;
        let position = generator.position();
        // wcet-bound: axes
        for (axis, run) in self.axes.iter_mut().enumerate() {
            run.brake(position[axis], self.parameters.acceleration[axis]);
        }
    }

    /// Returns an axis that has come to its switch, at a position that is not known yet.
    #[must_use]
    pub fn latched_axis(&self, inputs: &Inputs) -> Option<usize> {
        if !self.stage.is_approach() {
            return None;
        }
        let active = inputs.active();
        // wcet-bound: axes
        self.axes.iter().enumerate().position(|(axis, run)| {
            let is_group = self.current_axes >> axis & 1 != 0;
            is_group && !run.is_found && active.has(Levels::limits(1 << axis))
        })
    }

    /// Takes over the position of the switch of an axis that has come to it: the axis slows down.
    pub fn latch(
        &mut self,
        axis: usize,
        switch: i32,
        segments: &SegmentRing,
        generator: &Generator,
    ) {
        let position = generator.position();
        let acceleration = self.parameters.acceleration;
        if let Some(run) = self.axes.get_mut(axis) {
            run.switch = switch;
            run.is_found = true;
            run.brake(position[axis], acceleration[axis]);
        }
        if self.is_found() {
            // Since the switch closed, the filter's time and the motion prepared ahead have passed.
            let ahead = generator
                .clock_ticks()
                .wrapping_sub(segments.played_start_ticks());
            let passed = u64::from(ahead) + u64::from(SAMPLES * SAMPLE_TICKS);
            self.debounce_ticks = self.parameters.debounce_ticks.saturating_sub(passed);
        }
    }

    /// Whether every axis of the group has found its switch.
    fn is_found(&self) -> bool {
        // wcet-bound: axes
        self.axes
            .iter()
            .enumerate()
            .all(|(axis, run)| run.is_found || self.current_axes >> axis & 1 == 0)
    }

    /// Ends the cycle at once: after a fault.
    pub fn abandon(&mut self) {
        self.stage = HomingStage::Idle;
        self.alarm = None;
    }

    /// Makes the next segment, with the power that the spindle has; returns false at the end of the
    /// cycle. Sets the position of axes that are homed.
    pub fn next(
        &mut self,
        inputs: &Inputs,
        generator: &mut Generator,
        power: Power,
        segment: &mut Segment,
    ) -> bool {
        if !self.is_moving(generator) {
            self.next_stage(inputs, generator);
        }
        if self.stage == HomingStage::Idle
            || self.stage == HomingStage::Stop && !self.is_moving(generator)
        {
            self.stage = HomingStage::Idle;
            return false;
        }
        let is_moving = self.is_moving(generator);
        if is_moving {
            self.standstill_ticks = 0;
        } else {
            self.standstill_ticks += u64::from(SEGMENT_TICKS);
        }
        // From when the switches closed, or from rest.
        if self.is_found() && (self.stage.is_approach() || !is_moving) {
            let pause = self.debounce_ticks.saturating_sub(SEGMENT_TICKS.into());
            self.debounce_ticks = pause;
        }
        segment.power = power;
        self.move_axes(generator, segment);
        true
    }

    /// Takes the alarm of a cycle that has failed.
    #[must_use]
    pub fn take_alarm(&mut self) -> Option<Alarm> {
        self.alarm.take()
    }

    fn is_moving(&self, generator: &Generator) -> bool {
        let position = generator.position();
        // wcet-bound: axes
        let mut axes = self.axes.iter().zip(position);
        axes.any(|(run, position)| run.target != *position)
    }

    fn move_axes(&mut self, generator: &Generator, segment: &mut Segment) {
        let position = generator.position();
        let mut speed_sqr = 0.0;
        // wcet-bound: axes
        for (axis, run) in self.axes.iter_mut().enumerate() {
            segment.axes[axis] = AxisMotion {
                to: position[axis],
                acceleration: 0.0,
            };
            if run.target != position[axis] {
                segment.axes[axis] =
                    run.advance(position[axis], self.parameters.acceleration[axis]);
                let speed_mm_s = run.speed / self.parameters.steps_per_mm[axis];
                speed_sqr += speed_mm_s * speed_mm_s;
            }
        }
        segment.ticks = SEGMENT_TICKS;
        segment.feed_mm_min = math::sqrt(speed_sqr) * 60.0;
        segment.line = 0;
    }

    /// Enters the next stage, if that is due. The axes are at standstill.
    fn next_stage(&mut self, inputs: &Inputs, generator: &mut Generator) {
        if self.standstill_ticks < LATENCY_TICKS {
            return;
        }
        let is_closed = inputs.active().has(Levels::limits(self.current_axes));
        if self.stage.is_approach() && !self.is_found() {
            self.fail(Alarm::HomingNotFound);
        }
        if self.stage.is_pull_off() && is_closed {
            self.fail(Alarm::HomingPullOff);
        }
        if self.debounce_ticks > 0 {
            return;
        }
        match self.stage {
            HomingStage::Idle | HomingStage::Stop => {}
            HomingStage::Search => self.enter(HomingStage::Clear, inputs, generator),
            HomingStage::Clear => self.enter(HomingStage::Locate, inputs, generator),
            HomingStage::Locate => self.enter(HomingStage::PullOff, inputs, generator),
            HomingStage::PullOff => self.finish(inputs, generator),
        }
    }

    fn fail(&mut self, alarm: Alarm) {
        self.alarm = Some(alarm);
        self.stage = HomingStage::Stop;
    }

    /// The axes of the group are at home; the next ones follow.
    fn finish(&mut self, inputs: &Inputs, generator: &mut Generator) {
        let mut steps = generator.steps();
        // wcet-bound: axes
        for (axis, steps) in steps.iter_mut().enumerate() {
            if self.current_axes >> axis & 1 != 0 {
                *steps = self.parameters.home(axis);
            }
        }
        generator.set_steps(steps);
        self.current_axes = self.later_axes;
        self.later_axes = 0;
        let next = if self.current_axes == 0 {
            HomingStage::Idle
        } else {
            HomingStage::Search
        };
        self.enter(next, inputs, generator);
    }

    /// Begins a stage: gives every axis its target.
    fn enter(&mut self, stage: HomingStage, inputs: &Inputs, generator: &Generator) {
        self.stage = stage;
        self.standstill_ticks = 0;
        self.debounce_ticks = self.parameters.debounce_ticks;
        let position = generator.position();
        let farthest_mm = self.search_mm();
        let active = inputs.active();
        let rules = self.parameters;
        // wcet-bound: axes
        for (axis, run) in self.axes.iter_mut().enumerate() {
            let here = position[axis].nearest().0;
            let is_group = self.current_axes >> axis & 1 != 0;
            let is_closed = active.has(Levels::limits(1 << axis));
            if stage.is_approach() {
                run.is_found = is_closed;
                run.switch = here;
            }
            let target = if stage.is_pull_off() {
                run.switch
                    .wrapping_sub(rules.towards_switch(axis, rules.pull_off_mm))
            } else if is_closed {
                here
            } else if stage == HomingStage::Search {
                here.saturating_add(rules.towards_switch(axis, farthest_mm))
            } else if stage == HomingStage::Locate {
                here.wrapping_add(rules.towards_switch(axis, LOCATE_PULL_OFFS * rules.pull_off_mm))
            } else {
                here
            };
            run.speed = 0.0;
            run.limit = if stage == HomingStage::Locate {
                rules.locate[axis]
            } else {
                rules.search[axis]
            };
            run.target = if is_group {
                FineSteps(i64::from(target) << 32)
            } else {
                position[axis]
            };
        }
    }

    /// Returns how far the switches are searched, mm: as far as the longest axis needs.
    fn search_mm(&self) -> f32 {
        let mut travel_mm = 0.0;
        // wcet-bound: axes
        for (axis, travel) in self.parameters.travel_mm.iter().enumerate() {
            if self.current_axes >> axis & 1 != 0 {
                travel_mm = math::max(travel_mm, *travel);
            }
        }
        SEARCH_TRAVELS * travel_mm
    }
}

impl Default for Homing {
    fn default() -> Self {
        Self::new()
    }
}
