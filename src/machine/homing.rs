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

use super::{Alarm, Inputs, Levels, Power};
use crate::{
    axis::{AXES, Axes, Z},
    math,
    planner::{MIN_SPEED_MM_S, fastest_mm_s},
    settings::Settings,
    stepper::{
        AHEAD_TICKS, AxisMotion, EventWriter, Generator, SEGMENT_TICKS, Segment, StepCounts,
        steps_after,
    },
    units::{FineSteps, StepsPerMm, TICKS_PER_MS, TICKS_PER_SECOND},
};

/// How far a switch is searched, in travels, and located, in pull-offs, as in Grbl.
const SEARCH_TRAVELS: f32 = 1.5;
const LOCATE_PULL_OFFS: f32 = 5.0;
/// Time from the last segment of a motion to when it has been played and the switches have been
/// seen: what is prepared ahead, and the filter.
const SETTLE_TICKS: u64 = (AHEAD_TICKS + 3 * SEGMENT_TICKS) as u64;
/// Length of a segment, s.
const SEGMENT_S: f32 = SEGMENT_TICKS as f32 / TICKS_PER_SECOND as f32;
/// Per s² to per tick².
const PER_TICK_SQR: f32 = 1.0 / (TICKS_PER_SECOND as f32 * TICKS_PER_SECOND as f32);
/// The axes that a cycle homes unless it is told others: rotary axes have a switch only sometimes.
const ALL: u8 = 0b111;

/// What the cycle is made of, from the settings.
#[derive(Debug, Clone, Copy)]
struct Rules {
    /// Axes whose switch is at their negative end, bit 0 = X.
    negative: u8,
    /// Speeds, steps/s.
    search: Axes<f32>,
    locate: Axes<f32>,
    /// steps/s².
    acceleration: Axes<f32>,
    steps_per_mm: Axes<f32>,
    travel_mm: Axes<f32>,
    pull_off_mm: f32,
    debounce_ticks: u64,
}

impl Rules {
    const NONE: Self = Self {
        negative: 0,
        search: Axes([0.0; AXES]),
        locate: Axes([0.0; AXES]),
        acceleration: Axes([0.0; AXES]),
        steps_per_mm: Axes([1.0; AXES]),
        travel_mm: Axes([0.0; AXES]),
        pull_off_mm: 0.0,
        debounce_ticks: 0,
    };

    fn new(settings: &Settings) -> Self {
        let steps_per_mm = settings.steps_per_mm.map(StepsPerMm::to_f32);
        let at = |mm_min: f32| {
            let fastest = fastest_mm_s(settings);
            // `$24` and `$25` may be 0.
            let speed_mm_s = math::max(mm_min / 60.0, MIN_SPEED_MM_S);
            fastest.zip(steps_per_mm, |fastest, steps| {
                math::min(speed_mm_s, fastest) * steps
            })
        };
        Self {
            negative: settings.homing_direction,
            search: at(settings.homing_seek_mm_min),
            locate: at(settings.homing_feed_mm_min),
            acceleration: settings
                .acceleration_mm_s2
                .zip(steps_per_mm, |acceleration, steps| acceleration * steps),
            steps_per_mm,
            travel_mm: settings.max_travel_mm,
            pull_off_mm: settings.homing_pull_off_mm,
            debounce_ticks: u64::from(settings.homing_debounce_ms) * u64::from(TICKS_PER_MS),
        }
    }

    const fn is_negative(&self, axis: usize) -> bool {
        self.negative >> axis & 1 != 0
    }

    /// A way towards the switch, steps.
    fn towards(&self, axis: usize, mm: f32) -> i32 {
        let steps = round(mm * self.steps_per_mm[axis]);
        if self.is_negative(axis) {
            -steps
        } else {
            steps
        }
    }

    /// Where an axis is once it is homed, in Grbl's arithmetic.
    fn home(&self, axis: usize) -> i32 {
        let mm = if self.is_negative(axis) {
            self.pull_off_mm - self.travel_mm[axis]
        } else {
            -self.pull_off_mm
        };
        round(mm * self.steps_per_mm[axis])
    }
}

/// The nearest whole number, halves away from zero.
fn round(value: f32) -> i32 {
    (if value < 0.0 {
        value - 0.5
    } else {
        value + 0.5
    }) as i32
}

/// The motion of one axis: to a target, at most at a speed.
#[derive(Debug, Clone, Copy)]
struct Run {
    target: FineSteps,
    /// steps/s, now and at most.
    speed: f32,
    limit: f32,
    /// The switch has been found, and where.
    is_found: bool,
    switch: i32,
}

impl Run {
    const NONE: Self = Self {
        target: FineSteps(0),
        speed: 0.0,
        limit: 0.0,
        is_found: false,
        switch: 0,
    };

    /// Ends the motion as soon as the acceleration (steps/s²) allows.
    fn brake(&mut self, from: FineSteps, acceleration: f32) {
        let way = self.speed * self.speed / (2.0 * acceleration);
        let way = fine(way);
        let is_negative = self.target.0 < from.0;
        self.target = FineSteps(from.0.wrapping_add(if is_negative { -way } else { way }));
    }

    /// The next segment's motion.
    fn advance(&mut self, from: FineSteps, acceleration: f32) -> AxisMotion {
        let way = self.target.0.wrapping_sub(from.0);
        let sign = if way < 0 { -1.0 } else { 1.0 };
        let left = steps(way.wrapping_abs());
        // The speed from which what is left after the segment is just enough to brake:
        // v²/2a = left - (speed + v)·T/2.
        let half = 0.5 * acceleration * SEGMENT_S;
        let room = acceleration * (2.0 * left - self.speed * SEGMENT_S);
        let brake = math::sqrt(half * half + room) - half;
        let end = math::min(self.speed + 2.0 * half, math::min(self.limit, brake));
        let mean = 0.5 * (self.speed + end);
        if end <= 0.0 || mean * SEGMENT_S >= left {
            self.speed = 0.0;
            return AxisMotion {
                to: self.target,
                acceleration: -2.0 * sign * left / (SEGMENT_S * SEGMENT_S) * PER_TICK_SQR,
            };
        }
        let acceleration = (end - self.speed) / SEGMENT_S;
        self.speed = end;
        let way = fine(mean * SEGMENT_S);
        AxisMotion {
            to: FineSteps(from.0.wrapping_add(if sign < 0.0 { -way } else { way })),
            acceleration: sign * acceleration * PER_TICK_SQR,
        }
    }
}

/// A positive number of steps to 32 binary places.
fn fine(steps: f32) -> i64 {
    let whole = steps as i32;
    let part = steps - whole as f32;
    (i64::from(whole) << 32) + (i64::from((part * 1_073_741_824.0) as i32) << 2)
}

/// A positive number of steps with 32 binary places in floating point.
fn steps(fine: i64) -> f32 {
    if fine >> 43 == 0 {
        (fine >> 12) as i32 as f32 * (1.0 / 1_048_576.0)
    } else {
        (fine >> 32) as i32 as f32
    }
}

/// What the axes are doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
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

impl Stage {
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
    rules: Rules,
    axes: [Run; AXES],
    /// Axes that are homed now, and those to be homed after them.
    group: u8,
    later: u8,
    stage: Stage,
    /// Standstill generated since the last motion, ticks.
    rest_ticks: u64,
    /// What is left of the pause before the next stage, ticks.
    pause_ticks: u64,
    failure: Option<Alarm>,
}

impl Homing {
    /// Nothing to do.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            rules: Rules::NONE,
            axes: [Run::NONE; AXES],
            group: 0,
            later: 0,
            stage: Stage::Idle,
            rest_ticks: 0,
            pause_ticks: 0,
            failure: None,
        }
    }

    /// Takes over the settings.
    pub fn configure(&mut self, settings: &Settings) {
        self.rules = Rules::new(settings);
    }

    /// Begins a cycle, at rest: these axes together, bit 0 = X; with 0, Z and then X and Y.
    pub fn begin(&mut self, axes: u8, inputs: &Inputs, generator: &Generator) {
        self.failure = None;
        if axes == 0 {
            self.group = 1 << Z;
            self.later = ALL & !self.group;
        } else {
            self.group = axes & ((1 << AXES) - 1);
            self.later = 0;
        }
        self.enter(Stage::Search, inputs, generator);
    }

    /// Whether a cycle is going on.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.stage != Stage::Idle
    }

    /// Ends the cycle as soon as the axes can come to rest: a reset, or the door.
    pub fn stop(&mut self, generator: &Generator) {
        if !self.is_active() {
            return;
        }
        self.stage = Stage::Stop;
        let position = generator.position();
        // wcet-bound: 6
        for (axis, run) in self.axes.iter_mut().enumerate() {
            run.brake(position[axis], self.rules.acceleration[axis]);
        }
    }

    /// Looks at the switches: whatever axis has come to its own slows down. Once in each run of
    /// `prepare`, before segments are generated.
    pub fn watch(
        &mut self,
        inputs: &Inputs,
        counts: &StepCounts,
        generator: &Generator,
        events: &EventWriter<'_>,
    ) {
        if !self.stage.is_approach() || self.is_found() {
            return;
        }
        let active = inputs.active();
        let position = generator.position();
        // wcet-bound: 6
        for (axis, run) in self.axes.iter_mut().enumerate() {
            let is_group = self.group >> axis & 1 != 0;
            if is_group && !run.is_found && active.has(Levels::limits(1 << axis)) {
                let there = steps_after(inputs.reached(axis), counts, events);
                run.switch = there.unwrap_or_else(|| counts.position())[axis];
                run.is_found = true;
                run.brake(position[axis], self.rules.acceleration[axis]);
            }
        }
        if self.is_found() {
            // It was found while this much was already prepared.
            let ahead = generator.clock_ticks().wrapping_sub(counts.played_ticks());
            let pause = self.rules.debounce_ticks.saturating_sub(ahead.into());
            self.pause_ticks = pause;
        }
    }

    /// Whether every axis of the group has found its switch.
    fn is_found(&self) -> bool {
        // wcet-bound: 6
        self.axes
            .iter()
            .enumerate()
            .all(|(axis, run)| run.is_found || self.group >> axis & 1 == 0)
    }

    /// Ends the cycle at once: after a fault.
    pub fn abandon(&mut self) {
        self.stage = Stage::Idle;
        self.failure = None;
    }

    /// The next segment, with the power that the spindle has; `None` at the end of the cycle. Sets
    /// the position of axes that are homed.
    pub fn next(
        &mut self,
        inputs: &Inputs,
        generator: &mut Generator,
        power: Power,
    ) -> Option<Segment> {
        if !self.is_moving(generator) {
            self.turn(inputs, generator);
        }
        if self.stage == Stage::Idle || self.stage == Stage::Stop && !self.is_moving(generator) {
            self.stage = Stage::Idle;
            return None;
        }
        let is_moving = self.is_moving(generator);
        if is_moving {
            self.rest_ticks = 0;
        } else {
            self.rest_ticks += u64::from(SEGMENT_TICKS);
        }
        // From when the switches closed, or from rest.
        if self.is_found() && (self.stage.is_approach() || !is_moving) {
            let pause = self.pause_ticks.saturating_sub(SEGMENT_TICKS.into());
            self.pause_ticks = pause;
        }
        Some(self.segment(generator, power))
    }

    /// Takes why the cycle that has ended failed.
    #[must_use]
    pub fn take_failure(&mut self) -> Option<Alarm> {
        self.failure.take()
    }

    fn is_moving(&self, generator: &Generator) -> bool {
        let position = generator.position();
        // wcet-bound: 6
        let mut axes = self.axes.iter().zip(&position);
        axes.any(|(run, position)| run.target != *position)
    }

    fn segment(&mut self, generator: &Generator, power: Power) -> Segment {
        let position = generator.position();
        let mut axes = position.map(|to| AxisMotion {
            to,
            acceleration: 0.0,
        });
        let mut speed_sqr = 0.0;
        // wcet-bound: 6
        for (axis, run) in self.axes.iter_mut().enumerate() {
            if run.target != position[axis] {
                axes[axis] = run.advance(position[axis], self.rules.acceleration[axis]);
                let speed_mm_s = run.speed / self.rules.steps_per_mm[axis];
                speed_sqr += speed_mm_s * speed_mm_s;
            }
        }
        Segment {
            ticks: SEGMENT_TICKS,
            axes,
            feed_mm_min: math::sqrt(speed_sqr) * 60.0,
            line: 0,
            power,
        }
    }

    /// Goes on to the next stage, if that is due. The axes stand.
    fn turn(&mut self, inputs: &Inputs, generator: &mut Generator) {
        if self.rest_ticks < SETTLE_TICKS {
            return;
        }
        let is_closed = inputs.active().has(Levels::limits(self.group));
        if self.stage.is_approach() && !self.is_found() {
            self.fail(Alarm::HomingNotFound);
        }
        if self.stage.is_pull_off() && is_closed {
            self.fail(Alarm::HomingPullOff);
        }
        if self.pause_ticks > 0 {
            return;
        }
        match self.stage {
            Stage::Idle | Stage::Stop => {}
            Stage::Search => self.enter(Stage::Clear, inputs, generator),
            Stage::Clear => self.enter(Stage::Locate, inputs, generator),
            Stage::Locate => self.enter(Stage::PullOff, inputs, generator),
            Stage::PullOff => self.finish(inputs, generator),
        }
    }

    fn fail(&mut self, alarm: Alarm) {
        self.failure = Some(alarm);
        self.stage = Stage::Stop;
    }

    /// The axes of the group are at home; the next ones follow.
    fn finish(&mut self, inputs: &Inputs, generator: &mut Generator) {
        let mut steps = generator.steps();
        // wcet-bound: 6
        for (axis, steps) in steps.iter_mut().enumerate() {
            if self.group >> axis & 1 != 0 {
                *steps = self.rules.home(axis);
            }
        }
        generator.settle_on(steps);
        self.group = self.later;
        self.later = 0;
        let next = if self.group == 0 {
            Stage::Idle
        } else {
            Stage::Search
        };
        self.enter(next, inputs, generator);
    }

    /// Begins a stage: gives every axis its target.
    fn enter(&mut self, stage: Stage, inputs: &Inputs, generator: &Generator) {
        self.stage = stage;
        self.rest_ticks = 0;
        self.pause_ticks = self.rules.debounce_ticks;
        let position = generator.position();
        let farthest_mm = self.farthest_mm();
        let active = inputs.active();
        let rules = self.rules;
        // wcet-bound: 6
        for (axis, run) in self.axes.iter_mut().enumerate() {
            let here = position[axis].nearest().0;
            let is_group = self.group >> axis & 1 != 0;
            let is_closed = active.has(Levels::limits(1 << axis));
            if stage.is_approach() {
                run.is_found = is_closed;
                run.switch = here;
            }
            let target = match stage {
                Stage::Search if !is_closed => {
                    here.saturating_add(rules.towards(axis, farthest_mm))
                }
                Stage::Locate if !is_closed => {
                    here.wrapping_add(rules.towards(axis, LOCATE_PULL_OFFS * rules.pull_off_mm))
                }
                Stage::Clear | Stage::PullOff => run
                    .switch
                    .wrapping_sub(rules.towards(axis, rules.pull_off_mm)),
                Stage::Search | Stage::Locate | Stage::Idle | Stage::Stop => here,
            };
            run.speed = 0.0;
            run.limit = if stage == Stage::Locate {
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

    /// How far the switches of the group are searched, mm: as far as the longest axis needs.
    fn farthest_mm(&self) -> f32 {
        let mut travel_mm = 0.0;
        // wcet-bound: 6
        for (axis, travel) in self.rules.travel_mm.iter().enumerate() {
            if self.group >> axis & 1 != 0 {
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
