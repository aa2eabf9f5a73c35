//! The plan where acceleration is continuous: the gates between blocks, see [`Gate`].

use super::{
    junctions::{BlockLimits, JunctionLimit, RunningMin, influence_mm},
    reference::{BlocksAhead, LeavingSample, ReferenceMotion, Sample},
};
use crate::{
    math,
    motion::{lookahead::Plan, pass::Pass},
};

/// Blocks that a part of a pass goes through.
const BLOCKS_PER_PART: usize = 2;

/// What the reference needs of a block besides the block.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct JunctionPlan {
    /// Greatest speed where it begins, mm/s; 0 where the machine comes to rest.
    corner_mm_s: f32,
    /// The greatest that this has ever been: the machine may still come as fast.
    fastest_mm_s: f32,
    /// Greatest acceleration, mm/s²; at its beginning for a way, mm.
    acceleration_mm_s2: f32,
    trail_mm_s2: f32,
    trail_mm: f32,
    /// Where it begins.
    junction: JunctionLimit,
}

impl JunctionPlan {
    pub(in crate::motion) const NONE: Self = Self {
        corner_mm_s: 0.0,
        fastest_mm_s: 0.0,
        acceleration_mm_s2: 1.0,
        trail_mm_s2: 1.0,
        trail_mm: 0.0,
        junction: JunctionLimit::STOP,
    };
}

/// The part of the speed that a window of acceleration makes below which a corner is passed at rest:
/// to keep so low a speed for so long would take longer.
const MIN_CORNER_SHARE: f32 = 0.25;

impl<const N: usize> Plan<N> {
    /// At rest: acceleration changes within a window from now on, of so many cells; 0 for at once.
    pub(in crate::motion) fn set_window(&mut self, cells: usize, seconds: f32) {
        self.window = cells;
        self.window_s = seconds;
    }

    /// Whether acceleration is continuous.
    pub(in crate::motion) const fn is_jerk_limited(&self) -> bool {
        self.window != 0
    }

    /// Where the reference is.
    pub(in crate::motion) const fn reference(&self) -> &ReferenceMotion {
        &self.reference
    }

    /// The next cell of the reference.
    pub(in crate::motion) fn next_sample(&mut self, stops: bool, leaving: LeavingSample) -> Sample {
        let mut pacer = self.reference;
        let cell = pacer.next_sample(self, stops, leaving, self.window_s);
        // From rest it does not come to the end of a block, so it enters one at most.
        if pacer.number() != self.reference.number() {
            self.enter_block(pacer.number());
        }
        self.reference = pacer;
        cell
    }

    /// The reference enters a block: it is no longer behind it.
    pub(in crate::motion) fn enter_block(&mut self, number: usize) {
        let length_mm = self.ring[self.index(number)].block.length_mm;
        self.beyond_mm = if number + 1 < self.count {
            self.beyond_mm - length_mm
        } else {
            0.0
        };
    }

    /// The leg that a block is, and how it is begun, by those before it: in the order of the blocks.
    ///
    /// Of a block that is not new, it is known how far ahead of the reference it begins, mm. That may
    /// have become less since by some cells, which is in the second window of the way to brake.
    /// Accelerations only become lower then: blocks before it that are no longer known, and speeds of
    /// before, may still have their say. Nor is it begun faster where the reference might have had to
    /// brake otherwise for that.
    pub(in crate::motion) fn plan_block(&mut self, number: usize, ahead_mm: Option<f32>) {
        let place = self.index(number);
        if number == 0 {
            self.running_min = RunningMin::NONE;
        }
        let before = self.limits(number.wrapping_sub(1)).filter(|_| number != 0);
        let planned = &self.ring[place];
        let old = planned.limits;
        let block = &planned.block;
        let mut corner_mm_s = math::sqrt(planned.limit_sqr);
        let mut leg = BlockLimits {
            length_mm: block.length_mm,
            speed_mm_s: block.nominal_mm_s,
            acceleration_mm_s2: block.acceleration_mm_s2,
            trail_mm_s2: block.acceleration_mm_s2,
            trail_mm: 0.0,
        };
        let mut fastest_mm_s = corner_mm_s;
        if let Some(ahead_mm) = ahead_mm {
            let speed = self.reference.speed_mm_s();
            let a = before.map_or(block.acceleration_mm_s2, |leg| leg.acceleration_mm_s2);
            let a = math::min(a, block.acceleration_mm_s2);
            let braking_mm = speed * (2.0 * self.window_s + 0.5 * speed / a);
            if ahead_mm < influence_mm(corner_mm_s, self.window_s) + braking_mm {
                corner_mm_s = math::min(corner_mm_s, old.corner_mm_s);
            }
            fastest_mm_s = math::max(corner_mm_s, old.fastest_mm_s);
            leg.acceleration_mm_s2 = old.acceleration_mm_s2;
            leg.trail_mm_s2 = old.trail_mm_s2;
            leg.trail_mm = old.trail_mm;
        }
        if let Some(before) = before {
            let a = math::min(before.acceleration_mm_s2, leg.acceleration_mm_s2);
            let slow_mm_s = MIN_CORNER_SHARE * a * self.window_s;
            let is_slow = block.junction_sqr < slow_mm_s * slow_mm_s;
            let is_rest = match ahead_mm {
                None => is_slow,
                Some(_) => old.corner_mm_s <= 0.0,
            };
            if is_rest {
                corner_mm_s = 0.0;
                self.running_min = RunningMin::NONE;
            } else {
                let reach_mm = influence_mm(fastest_mm_s, self.window_s);
                let own = BlockLimits {
                    acceleration_mm_s2: self.ring[self.index(number - 1)].block.acceleration_mm_s2,
                    ..before
                };
                self.running_min = self.running_min.after(&own, reach_mm);
                leg = leg.behind(&self.running_min, reach_mm);
            }
        }
        let pace = &mut self.ring[place].limits;
        if ahead_mm.is_none() {
            // The path has ended there.
            pace.junction = JunctionLimit::STOP;
        }
        pace.corner_mm_s = corner_mm_s;
        pace.fastest_mm_s = fastest_mm_s;
        pace.acceleration_mm_s2 = leg.acceleration_mm_s2;
        pace.trail_mm_s2 = leg.trail_mm_s2;
        pace.trail_mm = leg.trail_mm;
    }

    /// A part of the pass in the order of the blocks, of which the first begins so far ahead of the
    /// reference, mm.
    #[inline(never)]
    pub(in crate::motion) fn plan_blocks_part(&mut self, from: usize, mut ahead_mm: f32) {
        let end = self.count.min(from + BLOCKS_PER_PART);
        // wcet-bound: 2
        for number in from..end {
            self.plan_block(number, Some(ahead_mm));
            let here = self.reference.number();
            if number == here {
                ahead_mm = self.reference.remaining_mm();
            } else if number > here {
                ahead_mm += self.ring[self.index(number)].block.length_mm;
            }
        }
        self.pass = if end == self.count {
            Pass::ALL_ENTRIES
        } else {
            Pass::BlockLimits {
                number: end,
                ahead_mm,
            }
        };
    }

    /// A part of the backward pass.
    #[inline(never)]
    pub(in crate::motion) fn plan_junctions_part(&mut self, from: usize, is_new: bool) {
        self.pass = Pass::Done;
        let end = self.count.min(from + BLOCKS_PER_PART);
        // wcet-bound: 2
        for back in from..end {
            let number = self.count - back;
            let place = self.index(number);
            let Some(leg) = self.limits(number) else {
                return;
            };
            let pace = &self.ring[place].limits;
            let reach_mm = influence_mm(pace.fastest_mm_s, self.window_s);
            let corner_mm_s = pace.corner_mm_s;
            let gate = self
                .junction(number)
                .before(&leg, corner_mm_s, reach_mm, self.window_s);
            let pace = &mut self.ring[place].limits;
            if gate == pace.junction && !is_new {
                self.stop_if_too_fast(number);
                return;
            }
            pace.junction = gate;
        }
        if end < self.count {
            self.pass = Pass::Brake {
                back: end,
                exit_sqr: 0.0,
                is_new,
            };
        } else if !is_new {
            self.stop_if_too_fast(0);
        }
    }

    /// A block that came late may ask for lower speeds before it, or softer braking, than the end of the
    /// path did: then the machine comes to rest there all the same. The gates behind a number are new.
    fn stop_if_too_fast(&mut self, number: usize) {
        if number > self.reference.number() {
            return;
        }
        let newest = self.index(self.count.wrapping_sub(1));
        let is_stop = self.ring[newest].limits.corner_mm_s <= 0.0;
        let is_over = self.reference.is_over(self, self.window, self.window_s);
        if is_stop || !is_over && !self.exceeded_newest_corner(newest) {
            return;
        }
        self.ring[newest].block.junction_sqr = 0.0;
        self.ring[newest].limit_sqr = 0.0;
        self.ring[newest].limits.corner_mm_s = 0.0;
        self.pass = Pass::NEWEST_ENTRIES;
    }

    /// Whether the reference has been too fast for the newest corner.
    fn exceeded_newest_corner(&self, newest: usize) -> bool {
        let planned = &self.ring[newest];
        let ahead_mm = self.reference.remaining_mm() + self.beyond_mm - planned.block.length_mm;
        let corner_mm_s = planned.limits.corner_mm_s;
        (self.reference).exceeded_corner(self, ahead_mm, corner_mm_s, self.window_s)
    }

    const fn index(&self, number: usize) -> usize {
        self.first.wrapping_add(number) & (N - 1)
    }
}

impl<const N: usize> BlocksAhead for Plan<N> {
    #[inline]
    fn limits(&self, number: usize) -> Option<BlockLimits> {
        let planned = &self.ring[self.index(number)];
        (number < self.count).then_some(BlockLimits {
            length_mm: planned.block.length_mm,
            speed_mm_s: planned.block.nominal_mm_s,
            acceleration_mm_s2: planned.limits.acceleration_mm_s2,
            trail_mm_s2: planned.limits.trail_mm_s2,
            trail_mm: planned.limits.trail_mm,
        })
    }

    #[inline]
    fn junction(&self, number: usize) -> &JunctionLimit {
        if number + 1 < self.count {
            &self.ring[self.index(number + 1)].limits.junction
        } else {
            &JunctionLimit::STOP
        }
    }

    #[inline]
    fn corner_mm_s(&self, number: usize) -> f32 {
        self.ring[self.index(number + 1)].limits.corner_mm_s
    }
}
