//! Router: from commands in nanometres to blocks in steps, with geometry and limits.
//!
//! Owns the end of the last command and of the last block. A move without a step makes no block and becomes part of the
//! next move, so that no rounding accumulates. Runs in `interpret`, which has no deadline, so that `prepare` needs
//! single precision only.
//!
//! # Cost
//! A block has some 50 words. [`Router::route_to`] is inlined, so that the block of a line, as nearly all
//! are, is built in the queue; the others are copied. Arcs and `G64` are out of line, so that a line does
//! not save their registers.

mod arc;
mod arc_jerk;
mod backlash;
mod corner_arc;
mod limits;
#[cfg(arc_machine)]
mod step_arc;

use self::backlash::LastDirections;
pub(super) use self::corner_arc::to_axes;
pub(crate) use self::limits::Limits;

use core::f32::consts::FRAC_1_SQRT_2;

use super::{
    BlendOutput, Blender, Block, Curve, MoveKind, Work, programmed_speed::programmed_mm_s,
};
use crate::{
    axis::{AXES, Axes, LINEAR, Z},
    math,
    model::{Command, FeedRate, Laser, PathControl, Target, core_xy},
    settings::Settings,
    units::{FineSteps, Nm, Steps},
};

/// Greatest rotary displacement per mm of linear one of a path that is measured along the linear axes,
/// degrees. Beyond, the length is that over the rotary axes: with jerk limits a distance is counted in
/// nanometres, and steps were lost from 20 000 on (`a_turn_with_hardly_any_linear_distance_reaches_its_end`).
const MAX_ROTARY_PER_MM: f32 = 1.0e3;
/// The same for a feed rate along the linear axes: beyond, it counts along the rotary ones.
const MAX_ROTARY_PER_FEED_MM: f32 = 1.0e6;

/// Where a router's last command and last block ended.
#[derive(Debug, Default)]
pub(super) struct PathEnd {
    /// End of the last command.
    pub(super) position: Axes<Nm>,
    /// End of the last block, as a coordinate and in steps.
    block_end: Axes<Nm>,
    fine: Axes<FineSteps>,
    steps: Axes<Steps>,
    /// Direction there: movement of the axes per mm of path.
    pub(super) tangent: Axes<f32>,
    /// Curvature there, 1/mm, towards the centre.
    curvature: Axes<f32>,
}

/// The route from the end of one command to the end of the next.
#[derive(Debug)]
pub struct Router {
    settings: Settings,
    limits: Limits,
    at: PathEnd,
    /// State of the laser in the moves to come.
    laser: Laser,
    /// The moves to come end at a standstill (`G61.1`), and the last block does.
    is_exact_stop: bool,
    ended_in_exact_stop: bool,
    /// See [`Self::duration_ms`].
    duration_ms: u32,
    last_directions: LastDirections,
    /// The remainder of a command of which something has been made: see [`Self::work_before`].
    remainder: Option<Command>,
    /// An arc could not follow the rule of `$790`.
    #[cfg(arc_machine)]
    is_off_steps: bool,
}

/// End of a block, in steps.
#[derive(Debug, Clone, Copy)]
struct BlockEnd {
    steps: Axes<Steps>,
    fine: Axes<FineSteps>,
}

/// Geometry and limits of a block.
struct Geometry {
    length_mm: f32,
    steps_per_mm: Axes<f32>,
    /// Movement of the axes per mm of path, at the start and at the end.
    tangents: [Axes<f32>; 2],
    /// Curvature at the start and at the end, 1/mm, towards the centre; 0 where a jump of it is not limited.
    curvatures: [Axes<f32>; 2],
    limit_mm_s: f32,
    acceleration_mm_s2: f32,
    curve: Option<Curve>,
}

impl Router {
    /// A router at the origin.
    #[must_use]
    pub fn new(settings: &Settings) -> Self {
        Self {
            settings: *settings,
            limits: Limits::new(settings),
            at: PathEnd::default(),
            laser: Laser::None,
            is_exact_stop: false,
            ended_in_exact_stop: false,
            duration_ms: 0,
            last_directions: LastDirections::new(settings),
            remainder: None,
            #[cfg(arc_machine)]
            is_off_steps: false,
        }
    }

    /// Sets whether the moves to come end at a standstill each, as under `G61.1`; a jog never does.
    pub fn set_exact_stop(&mut self, is_exact_stop: bool) {
        self.is_exact_stop = is_exact_stop;
    }

    /// Returns the duration of all moves so far, ms, wrapping: at nominal speeds without overrides and without
    /// acceleration.
    #[must_use]
    pub const fn duration_ms(&self) -> u32 {
        self.duration_ms
    }

    /// Returns the longest time that an axis takes to brake from its greatest speed, s. Lines that last so long at nominal
    /// speeds are longer than any braking distance, also under a feed override of 200 %; arcs may brake more slowly.
    #[must_use]
    pub fn longest_braking_s(&self) -> f32 {
        let limits = &self.limits;
        let braking_s = (limits.speed_mm_s).zip(limits.acceleration_mm_s2, |v, a| v / a);
        braking_s.iter().fold(0.0, |a, b| math::max(a, *b))
    }

    /// Applies new settings at a standstill, of which the steps are to be set.
    pub fn configure(&mut self, settings: &Settings) {
        self.settings = *settings;
        self.limits = Limits::new(settings);
        self.laser = Laser::None;
        self.last_directions = LastDirections::new(settings);
    }

    /// Returns the settings in effect.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Continues from a standstill at `steps` and returns the position.
    pub fn set_steps(&mut self, steps: Axes<i32>) -> Axes<Nm> {
        self.at.steps = steps.map(Steps);
        self.at.fine = steps.map(|steps| FineSteps(i64::from(steps) << 32));
        self.at.position = self.settings.position_of(steps);
        self.at.block_end = self.at.position;
        self.last_directions.forget();
        self.remainder = None;
        self.at.position
    }

    /// Returns the end of the last command.
    #[must_use]
    pub fn position(&self) -> Axes<Nm> {
        self.at.position
    }

    /// Returns the end of the last block, in steps: `prepare` goes on from there, to the last binary place.
    #[must_use]
    pub const fn block_end_steps(&self) -> &Axes<FineSteps> {
        &self.at.fine
    }

    /// Returns the distance of the end of the last block from a place in a straight line over the linear
    /// axes, mm.
    #[must_use]
    pub fn distance_from_mm(&self, steps: &Axes<i32>) -> f32 {
        let mut sum_sqr = 0.0;
        for axis in 0..LINEAR {
            let distance = self.at.steps[axis].0.wrapping_sub(steps[axis]) as f32;
            let mut distance_mm = distance / self.limits.steps_per_mm[axis];
            if self.limits.is_core_xy && axis != Z {
                // The sum of the squares of X + Y and X - Y is twice that of X and Y.
                distance_mm *= FRAC_1_SQRT_2;
            }
            sum_sqr += distance_mm * distance_mm;
        }
        math::sqrt(sum_sqr)
    }

    /// Returns the state of the laser in the moves to come.
    #[must_use]
    pub fn laser(&self) -> Laser {
        self.laser
    }

    /// Returns the work of a command; `None` for a move that makes no step, which becomes part of the
    /// next one, and for a change of the laser.
    ///
    /// Targets must not be beyond [`Settings::farthest`].
    pub fn route(&mut self, command: &Command) -> Option<Work> {
        let remainder = self.take_remainder();
        let command = remainder.as_ref().unwrap_or(command);
        self.route_to(command, |work| work)
    }

    /// Returns what `send` makes of the work of a command: see [`Self::route`].
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would take the work by a copy")]
    pub fn route_to<T>(&mut self, command: &Command, send: impl FnOnce(Work) -> T) -> Option<T> {
        Some(match command {
            Command::Line {
                target,
                feed_rate,
                line,
            } => send(Work::Move(self.line_block(target, *feed_rate, *line)?)),
            Command::Arc {
                target,
                circle,
                feed_rate,
                line,
            } => send(Work::Move(
                self.arc_block(target, circle, *feed_rate, *line)?,
            )),
            Command::Probe {
                target,
                feed_rate,
                probing,
                line,
            } => {
                let mut block = self.rare_line_block(target, *feed_rate, *line)?;
                block.kind = MoveKind::Fixed;
                send(Work::Probe(block, *probing))
            }
            Command::Power(laser) => {
                self.laser = *laser;
                return None;
            }
            Command::Dwell { milliseconds } => send(Work::Dwell(*milliseconds)),
            Command::Spindle { spindle, rpm } => {
                self.forget_speed();
                send(Work::Spindle(*spindle, *rpm))
            }
            Command::ReverseTap { spindle, rpm } => {
                self.forget_speed();
                send(Work::ReverseTap(*spindle, *rpm))
            }
            Command::Speed(rpm) => {
                self.laser = Laser::Constant(*rpm);
                send(Work::Speed(*rpm))
            }
            Command::Coolant(coolant) => send(Work::Coolant(*coolant)),
            Command::Overrides(switches) => send(Work::Overrides(*switches)),
            Command::Pause => send(Work::Pause),
            Command::ToolPause => send(Work::ToolPause),
        })
    }

    /// Leaves a spindle as it has been switched in the moves to come.
    fn forget_speed(&mut self) {
        if !self.settings.laser {
            self.laser = Laser::None;
        }
    }

    /// As [`Self::route`], for an output of the blender.
    pub fn route_blended(&mut self, output: &BlendOutput) -> Option<Work> {
        match output {
            BlendOutput::Command(command) => self.route(command),
            BlendOutput::CornerArc(arc) => self.corner_arc_block(arc).map(Work::Move),
        }
    }

    /// Passes a command to the blender; [`Blender::front`] has what comes of it.
    #[inline(never)]
    pub fn blend(&self, blender: &mut Blender, control: PathControl, command: &Command) {
        blender.push(control, &self.at, &self.limits, command);
    }

    /// Flushes what the blender holds back.
    #[inline]
    pub fn flush(&self, blender: &mut Blender) {
        if blender.has_pending() {
            self.flush_pending(blender);
        }
    }

    #[inline(never)]
    fn flush_pending(&self, blender: &mut Blender) {
        blender.flush(&self.limits);
    }

    /// As [`Self::line_block`], for moves that are rare.
    #[inline(never)]
    fn rare_line_block(
        &mut self,
        target: &Target,
        feed_rate: FeedRate,
        line: u32,
    ) -> Option<Block> {
        self.line_block(target, feed_rate, line)
    }

    /// Returns the block of a line; `None` for one that makes no step.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    fn line_block(&mut self, target: &Target, feed_rate: FeedRate, line: u32) -> Option<Block> {
        let end = self.block_end(target);
        if end.steps == self.at.steps {
            self.at.position = target.position;
            return None;
        }
        let displacement = target
            .position
            .zip(self.at.block_end, |to, from| (to - from).to_mm());
        let makes_linear_steps =
            AXES == LINEAR || (0..LINEAR).any(|axis| end.steps[axis] != self.at.steps[axis]);
        let (length_mm, per_feed_mm) = length(&displacement, makes_linear_steps);
        let per_mm = 1.0 / length_mm;
        let direction = displacement.map(|distance| distance * per_mm);
        let limits = &self.limits;
        let of_motors = limits.motors_of(direction);
        let steps_per_mm = of_motors.zip(limits.steps_per_mm, |share, steps| share * steps);
        let axes_mm_s = math::min(
            Limits::along(&limits.speed_mm_s, &of_motors),
            limits.step_rate_mm_s(&steps_per_mm),
        );
        let geometry = Geometry {
            length_mm,
            steps_per_mm,
            tangents: [direction; 2],
            curvatures: [Axes::all(0.0); 2],
            limit_mm_s: limits.whole_steps_mm_s(self.steps_to(&end) as f32, length_mm, axes_mm_s),
            acceleration_mm_s2: limits.acceleration_along(&of_motors),
            curve: None,
        };
        let feed_rate = scaled(feed_rate, per_feed_mm);
        Some(self.block(target.position, end, &geometry, feed_rate, line))
    }

    /// Makes a block and continues from its end.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    fn block(
        &mut self,
        target: Axes<Nm>,
        end: BlockEnd,
        geometry: &Geometry,
        feed_rate: FeedRate,
        line: u32,
    ) -> Block {
        let limit_mm_s = geometry.limit_mm_s;
        let programmed_mm_s = programmed_mm_s(feed_rate, geometry.length_mm, limit_mm_s);
        let nominal_mm_s = math::min(programmed_mm_s, limit_mm_s);
        let duration_ms = (1_000.0 * geometry.length_mm / nominal_mm_s) as u32;
        self.duration_ms = self.duration_ms.wrapping_add(duration_ms);
        let [tangent, end_tangent] = geometry.tangents;
        let [curvature, end_curvature] = geometry.curvatures;
        let block = Block {
            delta: end.fine.zip(self.at.fine, |to, from| to.0 - from.0),
            steps_per_mm: geometry.steps_per_mm,
            length_mm: geometry.length_mm,
            nominal_mm_s,
            programmed_mm_s,
            limit_mm_s,
            kind: kind(feed_rate),
            laser: self.laser,
            acceleration_mm_s2: geometry.acceleration_mm_s2,
            junction_sqr: self.junction_sqr(&tangent, &curvature),
            curve: geometry.curve,
            line,
        };
        self.at = PathEnd {
            position: target,
            block_end: target,
            fine: end.fine,
            steps: end.steps,
            tangent: end_tangent,
            curvature: end_curvature,
        };
        self.ended_in_exact_stop = self.is_exact_stop;
        block
    }

    /// Returns the steps of all axes to the end of a block.
    fn steps_to(&self, end: &BlockEnd) -> u32 {
        let steps = end
            .steps
            .zip(self.at.steps, |to, from| to.0.wrapping_sub(from.0));
        { steps.iter() }.fold(0, |sum, steps| steps.unsigned_abs().saturating_add(sum))
    }

    /// Returns the end of a move to `target`, in steps.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    fn block_end(&self, target: &Target) -> BlockEnd {
        if self.limits.is_core_xy {
            self.core_xy_end(target)
        } else {
            self.end_from(target, &self.at.block_end)
        }
    }

    /// The same on a `CoreXY` machine.
    #[inline(never)]
    fn core_xy_end(&self, target: &Target) -> BlockEnd {
        let motors = core_xy::motors_of(target.position).into();
        self.end_from(&motors, &core_xy::motors_of(self.at.block_end))
    }

    /// Returns the end of a move of the motors to `target`, in steps; `from` is where the last block ended.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    fn end_from(&self, target: &Target, from: &Axes<Nm>) -> BlockEnd {
        let mut end = BlockEnd {
            steps: self.at.steps,
            fine: self.at.fine,
        };
        for axis in 0..AXES {
            if target.position[axis] != from[axis] {
                (end.steps[axis], end.fine[axis]) = self.settings.steps_per_mm[axis]
                    .steps_as_grbl(target.position[axis], target.single_mm[axis]);
            }
        }
        end
    }

    /// Returns the limit of the squared speed at the junction with the last block, (mm/s)².
    fn junction_sqr(&self, tangent: &Axes<f32>, curvature: &Axes<f32>) -> f32 {
        if self.ended_in_exact_stop {
            return 0.0;
        }
        let corner_sqr = self.limits.junction_sqr(&self.at.tangent, tangent);
        let change = curvature.zip(self.at.curvature, |after, before| after - before);
        math::min(corner_sqr, self.limits.curvature_sqr(&change))
    }
}

/// Returns the length of a displacement, and that length per mm of feed.
///
/// The length is measured over the linear axes; over the rotary ones where only they make steps, or where
/// the linear displacement is too short to divide by. The feed is along the linear axes where these
/// make steps: NIST RS274NGC 2.1.2.5.
fn length(displacement: &Axes<f32>, makes_linear_steps: bool) -> (f32, f32) {
    let linear_mm = linear_length(displacement);
    if AXES == LINEAR {
        return (linear_mm, 1.0);
    }
    let rotary_sqr = displacement.iter().skip(LINEAR).map(|angle| angle * angle);
    let rotary = math::sqrt(rotary_sqr.sum());
    if rotary <= 0.0 || makes_linear_steps && rotary <= MAX_ROTARY_PER_MM * linear_mm {
        (linear_mm, 1.0)
    } else if makes_linear_steps && rotary <= MAX_ROTARY_PER_FEED_MM * linear_mm {
        (rotary, rotary / linear_mm)
    } else {
        (rotary, 1.0)
    }
}

/// Returns the length of a displacement over the linear axes, mm.
fn linear_length(displacement: &Axes<f32>) -> f32 {
    let linear_sqr = displacement.iter().take(LINEAR).map(|part| part * part);
    math::sqrt(linear_sqr.sum())
}

/// Returns the feed rate along a path of `per_feed_mm` per mm of feed.
fn scaled(feed_rate: FeedRate, per_feed_mm: f32) -> FeedRate {
    match feed_rate {
        FeedRate::Feed(mm_min) => FeedRate::Feed(mm_min * per_feed_mm),
        FeedRate::Jog(mm_min) => FeedRate::Jog(mm_min * per_feed_mm),
        FeedRate::Rapid | FeedRate::InverseTime(_) => feed_rate,
    }
}

fn kind(feed_rate: FeedRate) -> MoveKind {
    match feed_rate {
        FeedRate::Rapid => MoveKind::Rapid,
        FeedRate::Feed(_) | FeedRate::InverseTime(_) => MoveKind::Feed,
        FeedRate::Jog(_) => MoveKind::Jog,
    }
}
