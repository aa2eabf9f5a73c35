//! The look-ahead: the speeds at which the known path can be followed and ended at a standstill.
//!
//! Only braking is planned, from the newest block backwards; the executor accelerates as far as the
//! limits allow. A backward pass ends at the first block whose entry speed does not change, because
//! no entry speed before that block can change either.
//!
//! Passes are made in parts, and segments may be made between two parts. Behind a new block speeds
//! only rise. After a change of overrides speeds may fall, from the newest block back: a machine
//! that comes to a block before the pass does brakes as hard as the limits allow, which keeps it
//! within the plan before.
//!
//! The choice between the two profiles is made here, by [`Profile`]. Each plans its own part of a
//! [`QueuedBlock`](super::queue::QueuedBlock).
//!
//! # Cost
//!
//! The large queue comes last in memory, behind the small fields. A fence ends
//! [`LookAhead::continue_pass`]: without it calls become jumps under a condition, which the proof
//! charges to both branches. Parts of passes are out of line, so that registers are saved only
//! where they are used.

use core::sync::atomic::{Ordering::SeqCst, compiler_fence};

use super::{
    executor::{Executor, Goal, NextSegment},
    jerk_limited::{self, LeavingSample, MovingAverage, Sample},
    pass::{Pass, PassProgress},
    queue::{BLOCKS, BlockQueue},
    segment_rate::{duration_per_step_s, limit_block_rate, limit_segment_rate, min_duration_s},
    trapezoid,
};
use crate::{
    axis::Axes,
    math,
    model::Overrides,
    path::{Block, RampTime},
    stepper::Segment,
    units::FineSteps,
};

/// Blocks whose speeds one part of a pass plans.
const SPEEDS_PER_PART: usize = 32;

/// The speed profile in use, with its state of the plan as a whole.
#[derive(Debug)]
enum Profile {
    Trapezoid,
    JerkLimited(jerk_limited::Plan),
}

impl Profile {
    /// Limits the speed of a block so that `prepare` keeps up with its segments; returns the speed
    /// and the slack behind the block.
    #[inline]
    fn limit_rate(
        &self,
        block: &Block,
        speed_mm_s: f32,
        min_duration_s: f32,
        slack_s: f32,
    ) -> (f32, f32) {
        let (speed_mm_s, slack_s) = limit_segment_rate(block, speed_mm_s, min_duration_s, slack_s);
        match self {
            Self::Trapezoid => (speed_mm_s, slack_s),
            Self::JerkLimited(_) => (limit_block_rate(block, speed_mm_s), slack_s),
        }
    }
}

/// The blocks of a program and the speeds planned for them.
#[derive(Debug)]
#[repr(C)]
pub struct LookAhead<const ROOM: usize = BLOCKS> {
    overrides: Overrides,
    /// Time that the blocks up to the newest take longer than their segments need, s: see
    /// [`limit_segment_rate`].
    slack_s: f32,
    pass: Pass,
    /// What a step adds to the shortest duration of a line, s.
    duration_per_step_s: f32,
    profile: Profile,
    queue: BlockQueue<ROOM>,
}

impl<const ROOM: usize> LookAhead<ROOM> {
    /// The same as [`LookAhead::new`], with other room.
    pub(super) const fn with_room() -> Self {
        Self {
            overrides: Overrides::NONE,
            slack_s: 0.0,
            pass: Pass::Done,
            duration_per_step_s: duration_per_step_s(0),
            profile: Profile::Trapezoid,
            queue: BlockQueue::new(),
        }
    }
}

impl LookAhead {
    /// Empty, with the trapezoidal profile.
    #[must_use]
    pub const fn new() -> Self {
        Self::with_room()
    }

    /// Sets the greatest step rate of all axes together, Hz. At standstill only.
    pub(crate) const fn set_step_rate(&mut self, hz: u32) {
        self.duration_per_step_s = duration_per_step_s(hz);
    }

    /// Sets the ramp time, and with it the profile. At standstill only, and without blocks.
    pub(crate) fn set_ramp_time(&mut self, ramp_time: RampTime) {
        match &mut self.profile {
            _ if !ramp_time.is_jerk_limited() => self.profile = Profile::Trapezoid,
            Profile::Trapezoid => {
                self.profile = Profile::JerkLimited(jerk_limited::Plan::new(ramp_time));
                jerk_limited::end_path(&mut self.queue);
            }
            Profile::JerkLimited(plan) => plan.set_ramp_time(ramp_time),
        }
    }

    /// The number of blocks, the one in execution included.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.queue.len()
    }

    /// Whether no block is left.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    /// The number of blocks for which there is room.
    #[must_use]
    pub const fn free(&self) -> usize {
        self.queue.free()
    }

    /// The block in execution.
    #[must_use]
    pub fn current(&self) -> Option<&Block> {
        self.queue.current()
    }

    /// The squared speed at which the block in execution may be left: 0 when no other follows.
    #[must_use]
    pub fn exit_sqr(&self) -> f32 {
        self.queue.exit_sqr()
    }

    /// Adds a block, if there is room, and begins the pass that follows from it. The pass before must
    /// be finished.
    pub fn push(&mut self, block: &Block) {
        if self.queue.free() == 0 {
            return;
        }
        let before_mm_s = self.queue.newest().map(|newest| newest.block.nominal_mm_s);
        let queued = self.queue.enqueue(block);
        if self.overrides != Overrides::NONE {
            queued.block.nominal_mm_s = block.nominal_under(self.overrides);
        }
        queued.min_duration_s = min_duration_s(block, self.duration_per_step_s);
        let (speed_mm_s, slack_s) = self.profile.limit_rate(
            &queued.block,
            queued.block.nominal_mm_s,
            queued.min_duration_s,
            self.slack_s,
        );
        queued.block.nominal_mm_s = speed_mm_s;
        self.slack_s = slack_s;
        queued.limit_sqr = match before_mm_s {
            None => 0.0,
            Some(before_mm_s) => {
                let slower = math::min(speed_mm_s, before_mm_s);
                math::min(block.junction_sqr, slower * slower)
            }
        };
        match &mut self.profile {
            Profile::Trapezoid => {
                queued.trapezoid = trapezoid::BrakingPlan::new(block);
                trapezoid::plan_part(&mut self.queue, &mut self.pass, 1, 0.0, false);
            }
            Profile::JerkLimited(_) => {
                jerk_limited::end_path(&mut self.queue);
                self.pass = Pass::NEWEST_ENTRY_SPEEDS;
            }
        }
    }

    /// Removes the block in execution.
    pub fn pop(&mut self) {
        if self.queue.is_empty() {
            return;
        }
        self.queue.dequeue();
        if let Profile::JerkLimited(plan) = &mut self.profile {
            plan.pop();
        }
        if let Pass::Speeds { number, .. } = &mut self.pass {
            *number = number.saturating_sub(1);
        }
    }

    /// Removes all blocks.
    pub fn clear(&mut self) {
        self.queue.clear();
        self.slack_s = 0.0;
        self.pass = Pass::Done;
        if let Profile::JerkLimited(plan) = &mut self.profile {
            plan.clear();
            jerk_limited::end_path(&mut self.queue);
        }
    }

    /// Makes the next segment of the plan from `position`, as [`NextSegment`] says. Removes a block
    /// with its last segment. The moving average must need no sample.
    #[inline]
    pub(super) fn next_segment(
        &mut self,
        executor: &mut Executor,
        average: &mut MovingAverage,
        position: &Axes<FineSteps>,
        goal: Goal,
        segment: &mut Segment,
    ) -> NextSegment {
        let queue = &self.queue;
        let next = match &self.profile {
            Profile::Trapezoid => executor.next_trapezoid(queue, position, goal, segment),
            Profile::JerkLimited(plan) => {
                let reference = plan.reference();
                executor.next_jerk_limited(queue, reference, average, position, goal, segment)
            }
        };
        if next == NextSegment::EndsBlock {
            self.pop();
        }
        next
    }

    /// The next sample of the reference motion, for the moving average.
    pub(super) fn next_sample(&mut self, stops: bool, leaving: LeavingSample) -> Sample {
        match &mut self.profile {
            Profile::Trapezoid => Sample::STANDSTILL,
            Profile::JerkLimited(plan) => plan.next_sample(&self.queue, stops, leaving),
        }
    }

    /// Whether a pass is unfinished: [`LookAhead::continue_pass`] makes its next part.
    #[must_use]
    pub const fn is_unfinished(&self) -> bool {
        !matches!(self.pass, Pass::Done)
    }

    /// Whether the unfinished pass follows from other overrides: the machine may be faster than
    /// planned.
    #[must_use]
    pub const fn changes_speeds(&self) -> bool {
        match self.pass {
            Pass::Done => false,
            Pass::Speeds { .. } => true,
            Pass::EntrySpeeds { is_new, .. } => is_new,
        }
    }

    /// Puts all blocks, and those to come, under other overrides, and begins to plan anew.
    ///
    /// The block in execution adds no slack, because its remainder is unknown; the others add no
    /// more than at the speed before, and none while the machine is faster than planned.
    pub(in crate::motion) fn replan(&mut self, overrides: Overrides, progress: PassProgress) {
        self.overrides = overrides;
        self.pass = Pass::Speeds {
            number: 0,
            before_mm_s: 0.0,
            progress: if self.changes_speeds() {
                PassProgress::Braking
            } else {
                progress
            },
        };
    }

    /// Makes the next part of the pass.
    #[inline(never)]
    pub fn continue_pass(&mut self) {
        let (queue, pass) = (&mut self.queue, &mut self.pass);
        match (*pass, &mut self.profile) {
            (Pass::Done, _) => {}
            (
                Pass::Speeds {
                    number,
                    before_mm_s,
                    progress,
                },
                _,
            ) => self.plan_speeds_part(number, before_mm_s, progress),
            (
                Pass::EntrySpeeds {
                    back,
                    exit_sqr,
                    is_new,
                },
                Profile::Trapezoid,
            ) => trapezoid::plan_part(queue, pass, back, exit_sqr, is_new),
            (Pass::EntrySpeeds { back, is_new, .. }, Profile::JerkLimited(plan)) => {
                plan.plan_junctions_part(queue, pass, back, is_new);
            }
        }
        compiler_fence(SeqCst);
    }

    /// Plans speeds of blocks under the overrides, and the limits of entry speeds that follow.
    #[inline(never)]
    fn plan_speeds_part(&mut self, from: usize, mut before_mm_s: f32, progress: PassProgress) {
        let end = self.queue.len().min(from + SPEEDS_PER_PART);
        let mut slack_s = if from == 0 { 0.0 } else { self.slack_s };
        for number in (from..end).take(SPEEDS_PER_PART) {
            let queued = self.queue.get_mut(number);
            let block = &mut queued.block;
            let (speed_mm_s, left_s) = self.profile.limit_rate(
                block,
                block.nominal_under(self.overrides),
                queued.min_duration_s,
                slack_s,
            );
            let adds_slack = number != 0 && progress == PassProgress::Followed;
            slack_s = if adds_slack { left_s } else { 0.0 };
            block.nominal_mm_s = speed_mm_s;
            let slower = math::min(speed_mm_s, before_mm_s);
            queued.limit_sqr = math::min(block.junction_sqr, slower * slower);
            before_mm_s = speed_mm_s;
        }
        self.slack_s = slack_s;
        self.pass = if end < self.queue.len() {
            Pass::Speeds {
                number: end,
                before_mm_s,
                progress,
            }
        } else {
            Pass::ALL_ENTRY_SPEEDS
        };
    }
}

impl Default for LookAhead {
    fn default() -> Self {
        Self::new()
    }
}
