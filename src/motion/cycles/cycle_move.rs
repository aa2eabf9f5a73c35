//! A straight move of a motion cycle, from standstill to standstill, by the trapezoidal profile.
//!
//! No override applies to it, and the plan of the program is untouched. It is a move of the axes: on a `CoreXY` machine
//! the motors have the limits, and who makes it turns its segments into theirs.

use crate::{
    axis::{AXES, Axes},
    math,
    model::{Laser, core_xy},
    motion::executor::{Executor, Goal, NextSegment},
    path::{Block, Limits, MoveKind},
    settings::Settings,
    stepper::Segment,
    units::{FineSteps, StepsPerMm},
};

/// The limits of the axes: jerk has none here.
#[derive(Debug)]
pub(in crate::motion) struct CycleLimits {
    pub(super) steps_per_mm: Axes<f32>,
    speed_mm_s: Axes<f32>,
    pub(super) acceleration_mm_s2: Axes<f32>,
    /// Greatest step rate of all axes together.
    steps_per_s: f32,
    /// Speeds and accelerations in the places of X and Y are those of the motors of `CoreXY`.
    pub(super) is_core_xy: bool,
}

impl CycleLimits {
    pub(in crate::motion) const NONE: Self = Self {
        steps_per_mm: Axes([1.0; AXES]),
        speed_mm_s: Axes([0.0; AXES]),
        acceleration_mm_s2: Axes([0.0; AXES]),
        steps_per_s: 0.0,
        is_core_xy: false,
    };

    /// Takes over the settings.
    pub(in crate::motion) fn configure(&mut self, settings: &Settings) {
        let axis_steps_per_s = settings.greatest_step_rate_hz();
        self.steps_per_mm = settings.steps_per_mm.map(StepsPerMm::to_f32);
        self.speed_mm_s = (settings.max_rate_mm_min).zip(self.steps_per_mm, |mm_min, steps| {
            math::min(mm_min / 60.0, axis_steps_per_s / steps)
        });
        self.acceleration_mm_s2 = settings.acceleration_mm_s2;
        self.steps_per_s = settings.step_rate.hz() as f32;
        self.is_core_xy = settings.core_xy;
    }

    /// Returns the greatest speed along a direction of the axes, mm/s, in which each of them has `axis_mm_s` at most.
    fn speed_along(&self, direction: &Axes<f32>, axis_mm_s: f32) -> f32 {
        if self.is_core_xy {
            let of_motors = core_xy::motors_of(*direction);
            return math::min(
                Limits::along(&Axes::all(axis_mm_s), direction),
                Limits::along(&self.speed_mm_s, &of_motors),
            );
        }
        let axes_mm_s = self.speed_mm_s.map(|limit| math::min(limit, axis_mm_s));
        Limits::along(&axes_mm_s, direction)
    }

    /// Returns the movement of the motors for one of the axes.
    fn motors_of(&self, movement: Axes<f32>) -> Axes<f32> {
        if self.is_core_xy {
            core_xy::motors_of(movement)
        } else {
            movement
        }
    }
}

/// The move in execution, if there is one.
#[derive(Debug)]
pub(in crate::motion) struct CycleMove {
    block: Option<Block>,
    executor: Executor,
}

impl CycleMove {
    pub(in crate::motion) const fn new() -> Self {
        Self {
            block: None,
            executor: Executor::new(),
        }
    }

    /// Begins a move, at standstill: a displacement of each axis, steps with 32 binary places, at
    /// `axis_mm_s` for each axis at most.
    pub(in crate::motion) fn begin(
        &mut self,
        delta: Axes<i64>,
        axis_mm_s: f32,
        limits: &CycleLimits,
    ) {
        self.abandon();
        let displacement = delta
            .map(|delta| FineSteps(delta).to_f32())
            .zip(limits.steps_per_mm, |steps, per_mm| steps / per_mm);
        let length_mm = math::sqrt(math::dot(&displacement.0, &displacement.0));
        if length_mm <= 0.0 {
            return;
        }
        let direction = displacement.map(|mm| mm / length_mm);
        let steps_per_mm = direction.zip(limits.steps_per_mm, |share, steps| share * steps);
        let of_motors = limits.motors_of(steps_per_mm);
        let all_steps_per_mm: f32 = of_motors.iter().map(|steps| steps.abs()).sum();
        let speed_mm_s = math::min(
            limits.speed_along(&direction, axis_mm_s),
            limits.steps_per_s / all_steps_per_mm,
        );
        self.block = Some(Block {
            delta,
            steps_per_mm,
            length_mm,
            nominal_mm_s: speed_mm_s,
            programmed_mm_s: speed_mm_s,
            limit_mm_s: speed_mm_s,
            kind: MoveKind::Fixed,
            laser: Laser::None,
            acceleration_mm_s2: Limits::along(
                &limits.acceleration_mm_s2,
                &limits.motors_of(direction),
            ),
            junction_sqr: 0.0,
            curve: None,
            line: 0,
        });
    }

    /// Makes the next segment, from `position`; returns false when there is none.
    pub(in crate::motion) fn next(
        &mut self,
        position: &Axes<FineSteps>,
        goal: Goal,
        segment: &mut Segment,
    ) -> bool {
        let Some(block) = &self.block else {
            return false;
        };
        match (self.executor).next_single_line(block, position, goal, segment) {
            NextSegment::Standstill => return false,
            NextSegment::WithinBlock => {}
            NextSegment::EndsBlock => self.block = None,
        }
        true
    }

    /// Has the move, as far as it is left, end so many steps of an axis farther back.
    pub(in crate::motion) fn move_back(&mut self, axis: usize, steps: i32) {
        self.executor.start[axis] = self.executor.start[axis].minus_steps(steps);
    }

    /// Ends the move: at standstill, or for axes that go on by themselves.
    pub(in crate::motion) fn abandon(&mut self) {
        self.block = None;
        self.executor.abandon();
    }

    /// Whether the move has not come to its end.
    pub(in crate::motion) const fn is_active(&self) -> bool {
        self.block.is_some()
    }

    /// Whether the last segment ends in motion.
    pub(in crate::motion) fn is_moving(&self) -> bool {
        self.executor.is_moving()
    }

    /// Returns the speed of each axis at the end of the last segment, steps per tick.
    pub(super) fn axis_speeds(&self) -> Axes<f32> {
        if self.is_moving() {
            self.executor.axis_speed
        } else {
            Axes::all(0.0)
        }
    }
}
