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
//! The axes of a group move together, by one straight move. One that finds its switch leaves the move
//! and slows down while the others go on; a switch stops nothing dead. How far it is pulled off counts
//! from where the switch closed.
//! On a `CoreXY` machine the cycle moves the axes, and its segments become those of the motors.
//! Axes of `$788` have no switch: they do not move, and are at the end of their travel where they stand.
//! A pause of `$26` follows each motion, as in Grbl: from when the last switch closed, so that braking
//! is part of it, or from the end of the pull-off. Read with Grbl 1.1 `limits.c`, `limits_go_home`.
//!
//! # Cost
//!
//! A path is set to zero by stores: of five axes it would be filled by a function whose loops have no bound.

mod parameters;
mod squaring;

use core::hint::black_box;

use self::{parameters::HomingParameters, squaring::Squaring};
use super::cycle_move::CycleMove;
use crate::{
    axis::{AXES, Axes, Z},
    machine::{Inputs, SAMPLE_TICKS, SAMPLES},
    math,
    model::{
        Alarm, HAS_SECOND_MOTORS, Levels, Power,
        timing::{QUEUED_AHEAD_TICKS, SEGMENT_TICKS},
    },
    motion::executor::Goal,
    settings::Settings,
    stepper::{AxisMotion, Generator, Segment, SegmentRing},
    units::FineSteps,
};

/// How far a switch is searched, in travels, and located, in pull-offs, as in Grbl.
const SEARCH_TRAVELS: f32 = 1.5;
const LOCATE_PULL_OFFS: f32 = 5.0;
/// Time from the last segment of a motion to the end of its playing and the reading of the switches: the motion
/// prepared ahead, the segment made meanwhile, and the filter.
const LATENCY_TICKS: u32 = QUEUED_AHEAD_TICKS + 4 * SEGMENT_TICKS;
/// The axes that a cycle homes unless others are named: rotary axes have a switch only sometimes.
const LINEAR_AXES: u8 = 0b111;

/// A bit for each axis.
const ALL_AXES: u8 = (1 << AXES) - 1;

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
    /// The motors that have not come to their own switch approach it, slowly.
    Square,
    /// The same motors become as far from it as the others of their axes.
    Align,
    /// Away from it, to the home position.
    PullOff,
    /// Coming to rest: the cycle has failed.
    Stop,
}

impl HomingStage {
    const fn is_approach(self) -> bool {
        match self {
            Self::Search | Self::Locate | Self::Square => true,
            Self::Idle | Self::Clear | Self::Align | Self::PullOff | Self::Stop => false,
        }
    }

    const fn is_pull_off(self) -> bool {
        match self {
            Self::Clear | Self::PullOff => true,
            Self::Idle | Self::Search | Self::Locate | Self::Square | Self::Align | Self::Stop => {
                false
            }
        }
    }

    /// Whether only one motor moves of each axis that has two.
    const fn is_squaring(self) -> bool {
        HAS_SECOND_MOTORS && matches!(self, Self::Square | Self::Align)
    }
}

/// The homing cycle.
#[derive(Debug)]
pub struct Homing {
    parameters: HomingParameters,
    cycle_move: CycleMove,
    /// The axes that are homed now, and the axes that follow, bit 0 = X.
    current_axes: u8,
    later_axes: u8,
    /// The axes that are at home where they stand, bit 0 = X.
    marked_axes: u8,
    /// The axes that have been pulled off from their switches in this cycle, bit 0 = X.
    homed_axes: u8,
    /// Position of each switch, steps.
    switches: Axes<i32>,
    /// The axes that are not in the move: each slows down to a standstill by itself. In an approach,
    /// those that have found their switch.
    stopping_axes: u8,
    /// Their speeds, steps per tick.
    stopping_speeds: Axes<f32>,
    squaring: Squaring,
    stage: HomingStage,
    /// Standstill generated since the last motion, ticks.
    standstill_ticks: u32,
    /// Remainder of the pause of `$26` before the next stage, ticks.
    debounce_ticks: u32,
    alarm: Option<Alarm>,
}

impl Homing {
    /// Nothing to do.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            parameters: HomingParameters::NONE,
            cycle_move: CycleMove::new(),
            current_axes: 0,
            later_axes: 0,
            marked_axes: 0,
            homed_axes: 0,
            switches: Axes([0; AXES]),
            stopping_axes: 0,
            stopping_speeds: Axes([0.0; AXES]),
            squaring: Squaring::new(),
            stage: HomingStage::Idle,
            standstill_ticks: 0,
            debounce_ticks: 0,
            alarm: None,
        }
    }

    /// Takes over the settings.
    pub fn configure(&mut self, settings: &Settings) {
        self.parameters.configure(settings);
    }

    /// Begins a cycle, at rest: these axes together, bit 0 = X; with 0, Z and then X and Y.
    pub fn begin(&mut self, axes: u8, inputs: &Inputs, generator: &Generator) {
        self.alarm = None;
        self.homed_axes = 0;
        let ganged = self.parameters.of_own_motors(inputs.ganged_axes());
        self.squaring.begin(ganged);
        let by_marks = self.parameters.by_marks & ALL_AXES;
        if axes == 0 {
            self.marked_axes = by_marks;
            self.current_axes = 1 << Z & !by_marks;
            self.later_axes = LINEAR_AXES & !(1 << Z) & !by_marks;
        } else {
            self.marked_axes = axes & by_marks;
            self.current_axes = axes & ALL_AXES & !by_marks;
            self.later_axes = 0;
        }
        if self.current_axes == 0 {
            self.current_axes = core::mem::take(&mut self.later_axes);
        }
        let first = if self.current_axes == 0 {
            HomingStage::PullOff
        } else {
            HomingStage::Search
        };
        self.enter(first, inputs, generator);
    }

    /// Returns the axes that have been pulled off from their switches in the last cycle, bit 0 = X.
    pub(crate) const fn homed_axes(&self) -> u8 {
        self.homed_axes
    }

    /// Whether a cycle is going on.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.stage != HomingStage::Idle
    }

    /// Ends the cycle as soon as the axes can come to rest: a reset, or the door.
    pub fn stop(&mut self) {
        if self.is_active() {
            self.stage = HomingStage::Stop;
            self.stop_axes(ALL_AXES);
        }
    }

    /// Returns a switch, by its number, to which its motor has come, at a position that is not known yet.
    #[inline]
    #[must_use]
    pub fn latched_switch(&self, inputs: &Inputs) -> Option<usize> {
        if !self.stage.is_approach() {
            return None;
        }
        let active = inputs.active();
        let searching = self.current_axes & !self.stopping_axes & !self.squaring.axes();
        let first = (0..AXES)
            .find(|axis| searching >> axis & 1 != 0 && active.has(Levels::limits(1 << axis)));
        if HAS_SECOND_MOTORS {
            first.or_else(|| self.squaring.latched_switch(self.current_axes, inputs))
        } else {
            first
        }
    }

    /// Takes over the position of all axes where a switch has closed, by its number: its axis slows down.
    pub fn latch(
        &mut self,
        switch: usize,
        steps: &Axes<i32>,
        segments: &SegmentRing,
        generator: &Generator,
    ) {
        let axis = if switch < AXES { switch } else { switch - AXES };
        let steps = self.parameters.axis_steps_of(steps);
        if let (Some(place), Some(position)) = (self.switches.0.get_mut(axis), steps.0.get(axis)) {
            self.squaring.record(switch, *position);
            if HAS_SECOND_MOTORS && self.stopping_axes >> axis & 1 != 0 {
                // The other motor has come to its switch before.
                return;
            }
            if !self.stage.is_squaring() {
                *place = *position;
            }
        }
        self.stop_axes(1 << axis);
        if self.is_found() {
            // Since the switch closed, the filter's time and the motion prepared ahead have passed.
            let ahead = generator
                .clock_ticks()
                .wrapping_sub(segments.played_start_ticks());
            let passed = ahead.saturating_add(SAMPLES * SAMPLE_TICKS);
            self.debounce_ticks = self.parameters.debounce_ticks.saturating_sub(passed);
        }
    }

    /// Whether every axis of the group has found its switch in this approach.
    const fn is_found(&self) -> bool {
        self.stage.is_approach() && self.current_axes & !self.stopping_axes == 0
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
        if self.is_moving() {
            let position = self.parameters.axes_of(generator.position());
            self.move_axes(&position, segment);
            self.parameters.drive_motors(segment);
            self.standstill_ticks = 0;
            if self.is_found() {
                self.shorten_pause(segment.ticks);
            }
        } else {
            // A run that begins a move makes none of its segments.
            self.standstill_ticks += SEGMENT_TICKS;
            self.shorten_pause(SEGMENT_TICKS);
            self.next_stage(inputs, generator);
            let is_over = match self.stage {
                HomingStage::Idle => true,
                HomingStage::Stop => self.do_motors_follow(inputs),
                _ => false,
            };
            if is_over {
                self.stage = HomingStage::Idle;
                return false;
            }
            *segment = Segment::standstill(SEGMENT_TICKS, generator.position());
        }
        segment.power = power;
        true
    }

    /// Takes the alarm of a cycle that has failed.
    #[must_use]
    pub fn take_alarm(&mut self) -> Option<Alarm> {
        self.alarm.take()
    }

    fn shorten_pause(&mut self, ticks: u32) {
        self.debounce_ticks = self.debounce_ticks.saturating_sub(ticks);
    }

    fn is_moving(&self) -> bool {
        let is_stopping = |speed: &f32| *speed != 0.0;
        self.cycle_move.is_active() || self.stopping_speeds.iter().any(is_stopping)
    }

    /// Takes axes out of the move, each at the speed that it has.
    #[inline]
    fn stop_axes(&mut self, axes: u8) {
        let speeds = self.cycle_move.axis_speeds();
        for axis in 0..AXES {
            if axes & !self.stopping_axes & 1 << axis != 0 {
                self.stopping_speeds[axis] = speeds[axis];
            }
        }
        self.stopping_axes |= axes;
        if self.current_axes & !self.stopping_axes == 0 {
            self.cycle_move.abandon();
        }
    }

    /// Makes a segment of the move and of the axes that slow down.
    fn move_axes(&mut self, position: &Axes<FineSteps>, segment: &mut Segment) {
        if !self.cycle_move.next(position, Goal::Run, segment) {
            *segment = Segment::standstill(SEGMENT_TICKS, position);
        }
        let ticks = segment.ticks as f32;
        let rate = 1.0 / ticks;
        for axis in 0..AXES {
            if self.stopping_axes >> axis & 1 != 0 {
                let speed = self.stopping_speeds[axis];
                let most = self.parameters.deceleration(axis) * ticks;
                let change = math::max(math::min(speed, most), -most);
                let distance = (speed - 0.5 * change) * ticks;
                self.stopping_speeds[axis] = speed - change;
                segment.axes[axis] = AxisMotion {
                    to: position[axis].moved_by(distance),
                    acceleration: -change * rate,
                };
            }
        }
    }

    /// Enters the next stage, if that is due. The axes are at standstill.
    fn next_stage(&mut self, inputs: &Inputs, generator: &mut Generator) {
        if self.standstill_ticks < LATENCY_TICKS {
            return;
        }
        let is_closed = inputs.active().has(Levels::limits(self.current_axes));
        if self.stage.is_approach() && !self.is_found() {
            self.fail(if self.stage.is_squaring() {
                Alarm::HomingDualAxis
            } else {
                Alarm::HomingNotFound
            });
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
            HomingStage::Locate => self.end_approach(inputs, generator),
            HomingStage::Square => self.enter(HomingStage::Align, inputs, generator),
            HomingStage::Align => self.end_squaring(inputs, generator),
            HomingStage::PullOff => self.finish(inputs, generator),
        }
    }

    fn fail(&mut self, alarm: Alarm) {
        self.alarm = Some(alarm);
        self.stage = HomingStage::Stop;
    }

    /// The axes of the group are at home; the next ones follow.
    fn finish(&mut self, inputs: &Inputs, generator: &mut Generator) {
        let mut steps = self.parameters.axis_steps_of(&generator.steps());
        for (axis, steps) in steps.iter_mut().enumerate() {
            if (self.current_axes | self.marked_axes) >> axis & 1 != 0 {
                *steps = self.parameters.home(axis);
            }
        }
        generator.set_steps(self.parameters.motor_steps_of(steps));
        self.homed_axes |= self.current_axes;
        self.current_axes = self.later_axes;
        self.later_axes = 0;
        let next = if self.current_axes == 0 {
            HomingStage::Idle
        } else {
            HomingStage::Search
        };
        self.enter(next, inputs, generator);
    }

    /// Begins a stage: the move of the group.
    fn enter(&mut self, stage: HomingStage, inputs: &Inputs, generator: &Generator) {
        self.stage = stage;
        self.standstill_ticks = 0;
        self.debounce_ticks = self.parameters.debounce_ticks;
        self.stopping_axes = 0;
        self.stopping_speeds = Axes::all(0.0);
        if matches!(stage, HomingStage::Search | HomingStage::Locate) {
            self.squaring.begin_approach();
        }
        let rules = &self.parameters;
        let (towards_switch_mm, speed_mm_s) = match stage {
            HomingStage::Search => (self.search_mm(), rules.search_mm_s),
            HomingStage::Locate => (LOCATE_PULL_OFFS * rules.pull_off_mm, rules.locate_mm_s),
            HomingStage::Clear | HomingStage::PullOff => (-rules.pull_off_mm, rules.search_mm_s),
            HomingStage::Square | HomingStage::Align => (0.0, rules.locate_mm_s),
            HomingStage::Idle | HomingStage::Stop => return,
        };
        let closed = inputs.active();
        let position = self.parameters.axes_of(generator.position());
        let mut delta = Axes([black_box(0); AXES]);
        for axis in 0..AXES {
            if self.current_axes >> axis & 1 == 0 {
                continue;
            }
            let here = position[axis];
            if stage.is_squaring() {
                let target = self.squaring_target(axis);
                match target {
                    Some(target) => delta[axis] = (i64::from(target) << 32).saturating_sub(here.0),
                    None => self.stopping_axes |= 1 << axis,
                }
                continue;
            }
            if stage.is_approach() {
                // Where the switch is is not known yet.
                self.switches[axis] = here.nearest().0;
                if closed.has(Levels::limits(1 << axis)) {
                    self.stopping_axes |= 1 << axis;
                    (self.squaring).record_closed(axis, self.switches[axis], inputs);
                    continue;
                }
            }
            let mut towards_switch_mm = towards_switch_mm;
            if stage.is_pull_off() {
                towards_switch_mm -= rules.backlash_mm[axis];
            } else if stage == HomingStage::Locate {
                // Back over it, and once more where the motor was on the other side of it when the switch was left.
                towards_switch_mm += 2.0 * rules.backlash_mm[axis];
            }
            let steps = rules.towards_switch(axis, towards_switch_mm);
            let target = self.switches[axis].saturating_add(steps);
            delta[axis] = (i64::from(target) << 32).saturating_sub(here.0);
        }
        self.cycle_move.begin(delta, speed_mm_s, &rules.limits);
    }

    /// Returns how far the switches are searched, mm: as far as the longest axis needs.
    fn search_mm(&self) -> f32 {
        let mut travel_mm = 0.0;
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
