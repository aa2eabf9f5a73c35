//! The plan of the jerk-limited profile: a junction limit between each two blocks, found from the newest backwards.

use super::{
    junctions::{BlockLimits, JunctionLimit},
    reference::{BlocksAhead, LeavingSample, ReferenceMotion, Sample},
};
use crate::{
    math,
    model::timing::SAMPLE_S,
    motion::{pass::Pass, queue::BlockQueue},
    path::RampTime,
};

/// Blocks of one part of a pass.
pub const BLOCKS_PER_PART: usize = 2;
/// Share of the ramp time: a corner is passed at a standstill if the block's acceleration reaches its speed within that,
/// or within a sample. A stop takes hardly longer, and samples would not show the corner.
const MIN_CORNER_SHARE: f32 = 0.03;

/// What is planned of a block: the junction at its beginning.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct BlockPlan {
    junction: JunctionLimit,
}

impl BlockPlan {
    /// The path has ended where the block begins.
    pub(in crate::motion) const NONE: Self = Self {
        junction: JunctionLimit::STOP,
    };
}

/// Makes the path end behind the newest block, whenever another one is the newest. In a full queue, nothing reads what
/// is planned of the oldest block's beginning.
pub(in crate::motion) fn end_path(queue: &mut BlockQueue) {
    queue.get_mut(queue.len()).jerk_limited.junction.stop();
}

/// The plan as a whole.
#[derive(Debug)]
pub(in crate::motion) struct Plan {
    ramp_s: f32,
    reference: ReferenceMotion,
}

impl Plan {
    /// Without blocks, and with the reference at a standstill.
    pub(in crate::motion) fn new(ramp_time: RampTime) -> Self {
        Self {
            ramp_s: ramp_time.seconds(),
            reference: ReferenceMotion::START,
        }
    }

    /// Sets the ramp time. At standstill only, and without blocks.
    pub(in crate::motion) fn set_ramp_time(&mut self, ramp_time: RampTime) {
        self.ramp_s = ramp_time.seconds();
    }

    /// The reference motion.
    pub(in crate::motion) const fn reference(&self) -> &ReferenceMotion {
        &self.reference
    }

    /// Follows the removal of the oldest block.
    pub(in crate::motion) fn pop(&mut self) {
        self.reference.block_removed();
    }

    /// Follows the removal of all blocks.
    pub(in crate::motion) fn clear(&mut self) {
        self.reference = ReferenceMotion::START;
    }

    /// The next sample of the reference.
    pub(in crate::motion) fn next_sample(
        &mut self,
        queue: &BlockQueue,
        stops: bool,
        leaving: LeavingSample,
    ) -> Sample {
        self.reference
            .next_sample(queue, stops, leaving, self.ramp_s)
    }

    /// The greatest speed at the beginning of a block that comes behind one of an acceleration, mm/s; 0 for a standstill.
    fn corner_mm_s(&self, queue: &BlockQueue, number: usize, before: f32) -> f32 {
        let queued = queue.get(number);
        let acceleration = math::min(before, queued.block.acceleration_mm_s2);
        let slow_mm_s = acceleration * math::max(MIN_CORNER_SHARE * self.ramp_s, SAMPLE_S);
        if queued.block.junction_sqr < slow_mm_s * slow_mm_s {
            0.0
        } else {
            math::sqrt(queued.limit_sqr)
        }
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
            let before = queue.get(number.wrapping_sub(1)).block.acceleration_mm_s2;
            let corner_mm_s = self.corner_mm_s(queue, number, before);
            let junction = queue
                .junction(number)
                .before(&limits, corner_mm_s, before, self.ramp_s);
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

    /// Makes the newest junction a standstill if its block came too late: if it asks for softer braking than the
    /// reference has kept to. The junctions behind the block `number` are new.
    fn stop_if_too_fast(&self, queue: &mut BlockQueue, pass: &mut Pass, number: usize) {
        if number > self.reference.number() {
            return;
        }
        let newest = queue.len().wrapping_sub(1);
        let is_ahead = newest > self.reference.number() && !queue.is_empty();
        let is_stop = queue.get(newest).jerk_limited.junction.is_stop();
        if !is_ahead || is_stop || !self.reference.is_too_fast(queue, self.ramp_s) {
            return;
        }
        let queued = queue.get_mut(newest);
        queued.block.junction_sqr = 0.0;
        queued.limit_sqr = 0.0;
        *pass = Pass::NEWEST_ENTRY_SPEEDS;
    }
}

impl BlocksAhead for BlockQueue {
    #[inline]
    fn limits(&self, number: usize) -> Option<BlockLimits> {
        (number < self.len()).then(|| BlockLimits::of(&self.get(number).block))
    }

    /// Behind the newest block, the path has ended: see [`end_path`].
    #[inline]
    fn junction(&self, number: usize) -> &JunctionLimit {
        &self.get(number + 1).jerk_limited.junction
    }
}
