//! The plan of the jerk-limited profile: a junction limit between each two blocks.
//!
//! See [`JunctionLimit`]. A pass over all blocks finds their accelerations and corner speeds from the
//! oldest on; a backward pass then finds the junction limits.

use super::{
    junctions::{BlockLimits, JunctionLimit, RunningMin, influence_mm},
    reference::{BlocksAhead, LeavingSample, ReferenceMotion, Sample},
};
use crate::{
    math,
    motion::{pass::Pass, queue::BlockQueue},
    path::AveragingWindow,
};

/// Blocks of one part of a pass.
pub const BLOCKS_PER_PART: usize = 2;
/// Share of the speed that the block's acceleration reaches within a window, below which a corner is
/// passed at a standstill: to keep a lower speed for a window on both sides takes longer.
const MIN_CORNER_SHARE: f32 = 0.25;

/// What is planned of a block.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct BlockPlan {
    /// Greatest speed at its beginning, mm/s; 0 for a standstill.
    corner_mm_s: f32,
    /// The greatest value of `corner_mm_s` so far, mm/s: the machine may still come as fast.
    fastest_mm_s: f32,
    /// Greatest acceleration, mm/s².
    acceleration_mm_s2: f32,
    /// Greatest acceleration within `trail_mm` behind its beginning, mm/s².
    trail_mm_s2: f32,
    /// Distance behind its beginning for which that holds, mm.
    trail_mm: f32,
    /// The junction at its beginning.
    junction: JunctionLimit,
}

impl BlockPlan {
    pub(in crate::motion) const NONE: Self = Self {
        corner_mm_s: 0.0,
        fastest_mm_s: 0.0,
        acceleration_mm_s2: 1.0,
        trail_mm_s2: 1.0,
        trail_mm: 0.0,
        junction: JunctionLimit::STOP,
    };
}

/// The plan as a whole.
#[derive(Debug)]
pub(in crate::motion) struct Plan {
    window: AveragingWindow,
    window_s: f32,
    /// Length of the blocks behind the one that the reference is in, mm.
    beyond_mm: f32,
    reference: ReferenceMotion,
    /// Least acceleration of the newest blocks, in a pass from the oldest on.
    running_min: RunningMin,
}

impl Plan {
    /// Without blocks, and with the reference at a standstill.
    pub(in crate::motion) fn new(window: AveragingWindow) -> Self {
        Self {
            window_s: window.seconds(),
            window,
            beyond_mm: 0.0,
            reference: ReferenceMotion::START,
            running_min: RunningMin::NONE,
        }
    }

    /// Sets the averaging window. At standstill only, and without blocks.
    pub(in crate::motion) fn set_window(&mut self, window: AveragingWindow) {
        self.window_s = window.seconds();
        self.window = window;
    }

    /// The reference motion.
    pub(in crate::motion) const fn reference(&self) -> &ReferenceMotion {
        &self.reference
    }

    /// Plans the newest block, which has just been added.
    pub(in crate::motion) fn push(&mut self, queue: &mut BlockQueue) {
        let newest = queue.len() - 1;
        if newest != 0 {
            self.beyond_mm += queue.get(newest).block.length_mm;
        }
        self.plan_block(queue, newest, None);
    }

    /// Follows the removal of the oldest block.
    pub(in crate::motion) fn pop(&mut self, queue: &BlockQueue) {
        if self.reference.number() == 0 && !queue.is_empty() {
            self.enter_block(queue, 0);
        }
        self.reference.block_removed();
    }

    /// Follows the removal of all blocks.
    pub(in crate::motion) fn clear(&mut self) {
        self.reference = ReferenceMotion::START;
        self.beyond_mm = 0.0;
    }

    /// The next sample of the reference.
    pub(in crate::motion) fn next_sample(
        &mut self,
        queue: &BlockQueue,
        stops: bool,
        leaving: LeavingSample,
    ) -> Sample {
        let before = self.reference.number();
        let sample = self
            .reference
            .next_sample(queue, stops, leaving, self.window_s);
        // From a standstill the reference does not come to the end of a block, so it enters one at most.
        let number = self.reference.number();
        if number != before {
            self.enter_block(queue, number);
        }
        sample
    }

    /// Follows the reference into a block.
    fn enter_block(&mut self, queue: &BlockQueue, number: usize) {
        self.beyond_mm = if number + 1 < queue.len() {
            self.beyond_mm - queue.get(number).block.length_mm
        } else {
            0.0
        };
    }

    /// Plans the limits of a block and its corner speed, from those of the blocks before it: in the
    /// order of the blocks.
    ///
    /// `ahead_mm` is how far ahead of the reference a block that is not new begins. The reference may
    /// have gone on by some samples since: the second window of the braking distance covers them.
    /// Accelerations of such a block only become lower: removed blocks before it, and earlier speeds, may still limit
    /// it. Its corner speed does not rise where the reference may already brake for it.
    fn plan_block(&mut self, queue: &mut BlockQueue, number: usize, ahead_mm: Option<f32>) {
        if number == 0 {
            self.running_min = RunningMin::NONE;
        }
        let before = queue.limits(number.wrapping_sub(1)).filter(|_| number != 0);
        let queued = queue.get(number);
        let old = queued.jerk_limited;
        let block = &queued.block;
        let mut corner_mm_s = math::sqrt(queued.limit_sqr);
        let mut limits = BlockLimits::of(block);
        let mut fastest_mm_s = corner_mm_s;
        if let Some(ahead_mm) = ahead_mm {
            let speed = self.reference.speed_mm_s();
            let a = before.map_or(block.acceleration_mm_s2, |before| before.acceleration_mm_s2);
            let a = math::min(a, block.acceleration_mm_s2);
            let braking_mm = speed * (2.0 * self.window_s + 0.5 * speed / a);
            if ahead_mm < influence_mm(corner_mm_s, self.window_s) + braking_mm {
                corner_mm_s = math::min(corner_mm_s, old.corner_mm_s);
            }
            fastest_mm_s = math::max(corner_mm_s, old.fastest_mm_s);
            limits.acceleration_mm_s2 = old.acceleration_mm_s2;
            limits.trail_mm_s2 = old.trail_mm_s2;
            limits.trail_mm = old.trail_mm;
        }
        if let Some(before) = before {
            let a = math::min(before.acceleration_mm_s2, limits.acceleration_mm_s2);
            let slow_mm_s = MIN_CORNER_SHARE * a * self.window_s;
            let is_slow = block.junction_sqr < slow_mm_s * slow_mm_s;
            let is_standstill = match ahead_mm {
                None => is_slow,
                Some(_) => old.corner_mm_s <= 0.0,
            };
            if is_standstill {
                corner_mm_s = 0.0;
                self.running_min = RunningMin::NONE;
            } else {
                let influence_mm = influence_mm(fastest_mm_s, self.window_s);
                let own = BlockLimits {
                    acceleration_mm_s2: queue.get(number - 1).block.acceleration_mm_s2,
                    ..before
                };
                self.running_min = self.running_min.after(&own, influence_mm);
                limits = limits.after(&self.running_min, influence_mm);
            }
        }
        queue.get_mut(number).jerk_limited = BlockPlan {
            corner_mm_s,
            fastest_mm_s,
            acceleration_mm_s2: limits.acceleration_mm_s2,
            trail_mm_s2: limits.trail_mm_s2,
            trail_mm: limits.trail_mm,
            junction: match ahead_mm {
                // The path has ended there.
                None => JunctionLimit::STOP,
                Some(_) => old.junction,
            },
        };
    }

    /// Plans a part of the pass from the oldest block on: from the block `from`, which begins
    /// `ahead_mm` ahead of the reference.
    #[inline(never)]
    pub(in crate::motion) fn plan_blocks_part(
        &mut self,
        queue: &mut BlockQueue,
        pass: &mut Pass,
        from: usize,
        mut ahead_mm: f32,
    ) {
        let end = queue.len().min(from + BLOCKS_PER_PART);
        for number in (from..end).take(BLOCKS_PER_PART) {
            self.plan_block(queue, number, Some(ahead_mm));
            let here = self.reference.number();
            if number == here {
                ahead_mm = self.reference.remaining_mm();
            } else if number > here {
                ahead_mm += queue.get(number).block.length_mm;
            }
        }
        *pass = if end == queue.len() {
            Pass::ALL_ENTRY_SPEEDS
        } else {
            Pass::BlockLimits {
                number: end,
                ahead_mm,
            }
        };
    }

    /// Plans a part of the backward pass: junctions from that of the block `from` on backwards, the
    /// newest is 1. With `is_new` an unchanged junction does not end the pass.
    #[inline(never)]
    pub(in crate::motion) fn plan_junctions_part(
        &mut self,
        queue: &mut BlockQueue,
        pass: &mut Pass,
        from: usize,
        is_new: bool,
    ) {
        *pass = Pass::Done;
        let end = queue.len().min(from + BLOCKS_PER_PART);
        // wcet-bound: BLOCKS_PER_PART: `end` is no farther from `from`
        for back in from..end {
            let number = queue.len() - back;
            let Some(limits) = queue.limits(number) else {
                return;
            };
            let plan = &queue.get(number).jerk_limited;
            let influence_mm = influence_mm(plan.fastest_mm_s, self.window_s);
            let corner_mm_s = plan.corner_mm_s;
            let junction =
                queue
                    .junction(number)
                    .before(&limits, corner_mm_s, influence_mm, self.window_s);
            let plan = &mut queue.get_mut(number).jerk_limited;
            if junction == plan.junction && !is_new {
                self.stop_if_too_fast(queue, pass, number);
                return;
            }
            plan.junction = junction;
        }
        if end < queue.len() {
            *pass = Pass::EntrySpeeds {
                back: end,
                exit_sqr: 0.0,
                is_new,
            };
        } else if !is_new {
            self.stop_if_too_fast(queue, pass, 0);
        }
    }

    /// Makes the newest junction a standstill if its block came too late: if it asks for lower speeds
    /// before it, or softer braking, than the reference has kept to. The junctions behind the block
    /// `number` are new.
    fn stop_if_too_fast(&self, queue: &mut BlockQueue, pass: &mut Pass, number: usize) {
        if number > self.reference.number() {
            return;
        }
        let newest = queue.len().wrapping_sub(1);
        let is_stop = queue.get(newest).jerk_limited.corner_mm_s <= 0.0;
        let is_over = self
            .reference
            .exceeds_junction(queue, self.window.samples, self.window_s);
        if is_stop || !is_over && !self.exceeded_corner(queue, newest) {
            return;
        }
        let queued = queue.get_mut(newest);
        queued.block.junction_sqr = 0.0;
        queued.limit_sqr = 0.0;
        queued.jerk_limited.corner_mm_s = 0.0;
        *pass = Pass::NEWEST_ENTRY_SPEEDS;
    }

    /// Whether the reference has been too fast for the newest corner.
    fn exceeded_corner(&self, queue: &BlockQueue, newest: usize) -> bool {
        let queued = queue.get(newest);
        let ahead_mm = self.reference.remaining_mm() + self.beyond_mm - queued.block.length_mm;
        let corner_mm_s = queued.jerk_limited.corner_mm_s;
        self.reference
            .exceeded_corner(queue, ahead_mm, corner_mm_s, self.window_s)
    }
}

impl BlocksAhead for BlockQueue {
    #[inline]
    fn limits(&self, number: usize) -> Option<BlockLimits> {
        let queued = self.get(number);
        let plan = &queued.jerk_limited;
        (number < self.len()).then_some(BlockLimits {
            length_mm: queued.block.length_mm,
            speed_mm_s: queued.block.nominal_mm_s,
            acceleration_mm_s2: plan.acceleration_mm_s2,
            trail_mm_s2: plan.trail_mm_s2,
            trail_mm: plan.trail_mm,
        })
    }

    #[inline]
    fn junction(&self, number: usize) -> &JunctionLimit {
        if number + 1 < self.len() {
            &self.get(number + 1).jerk_limited.junction
        } else {
            &JunctionLimit::STOP
        }
    }

    #[inline]
    fn corner_mm_s(&self, number: usize) -> f32 {
        self.get(number + 1).jerk_limited.corner_mm_s
    }
}
