//! How far along the path the reference goes in each cell of time.

use super::{
    average::{UNIT_MM, UNITS_PER_MM},
    junctions::{BlockLimits, JunctionLimit, influence_mm},
};
use crate::{math, model::timing::SAMPLE_S, motion::limits::NO_SPEED_LIMIT_MM_S};

/// Part of what a cell can brake that is gone through without braking before a place to be passed at
/// rest: what rounding leaves.
const FINAL_SAMPLE_TOLERANCE: f32 = 0.05;

/// What the way from a standstill to the next is shorter for the reference, units: so that rounding
/// never lets the machine be at its end before it is at rest, and all is even there.
const LENGTH_RESERVE_UNITS: u64 = 16;

/// Braking that is late may be so many times as hard as the block allows. Each cell's speed is rounded
/// alike: that adds up to some 20 nm, which the last cell would have to make up for.
const BRAKING_TOLERANCE: f32 = 1.001;

/// An acceleration that is so many times another is no greater: what a small turn makes of it.
const ACCELERATION_TOLERANCE: f32 = 1.005;

/// The blocks ahead, and the gates at their ends.
pub(in crate::motion) trait BlocksAhead {
    /// The leg with a number, the oldest is 0.
    fn limits(&self, number: usize) -> Option<BlockLimits>;
    /// The gate at its end.
    fn junction(&self, number: usize) -> &JunctionLimit;
    /// Greatest speed at its end, mm/s.
    fn corner_mm_s(&self, number: usize) -> f32;
}

/// What leaves the window.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct LeavingSample {
    /// The change of speed in the cell that does, mm/s.
    pub(in crate::motion) change: f32,
    /// There is no motion in the window.
    pub(in crate::motion) is_standstill: bool,
}

/// The way of a cell, and how fast its end is.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct Sample {
    /// The way, units.
    pub(in crate::motion) distance: u32,
    /// Speed at its end, mm/s.
    pub(in crate::motion) end_mm_s: f32,
}

impl Sample {
    /// No motion.
    pub(in crate::motion) const STANDSTILL: Self = Self {
        distance: 0,
        end_mm_s: 0.0,
    };
}

/// Where the reference is.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct ReferenceMotion {
    /// The block, counted from the oldest.
    number: usize,
    is_begun: bool,
    /// What is left of it, units, and what rounding ways to units left over, units.
    remaining: u64,
    carry: f32,
    /// What rounding lengths to units left over, units.
    length_remainder: f32,
    speed_mm_s: f32,
    /// Cells since it has accelerated.
    since_acceleration: usize,
    /// A speed that is not exceeded for a way behind slower places.
    cap_mm_s: f32,
    cap_mm: f32,
}

/// What a cell can do.
struct SampleLimits {
    /// Greatest speed at its end so that there is room to brake, and if it accelerates.
    brake: f32,
    free: f32,
    /// The lowest limit of the blocks.
    top: f32,
    /// The greatest change of speed by braking.
    hardest: f32,
}

impl ReferenceMotion {
    /// At the beginning of the oldest block.
    pub(in crate::motion) const START: Self = Self {
        number: 0,
        is_begun: false,
        remaining: 0,
        carry: 0.0,
        length_remainder: 0.0,
        speed_mm_s: 0.0,
        since_acceleration: usize::MAX,
        cap_mm_s: NO_SPEED_LIMIT_MM_S,
        cap_mm: 0.0,
    };

    /// Whether it moves.
    pub(in crate::motion) fn is_moving(&self) -> bool {
        self.speed_mm_s > 0.0
    }

    /// Its speed, mm/s.
    pub(in crate::motion) fn speed_mm_s(&self) -> f32 {
        self.speed_mm_s
    }

    /// The number of its block, the oldest is 0.
    pub(in crate::motion) fn number(&self) -> usize {
        self.number
    }

    /// Whether nothing of the oldest block is left for it.
    pub(in crate::motion) fn has_left_oldest(&self) -> bool {
        self.number > 0 || self.is_begun && self.remaining == 0
    }

    /// What is left of its block for it, mm.
    pub(in crate::motion) fn remaining_mm(&self) -> f32 {
        let high = (self.remaining >> 16) as u32 as f32;
        let low = (self.remaining as u32 & 0xffff) as f32;
        (high * 65_536.0 + low) * UNIT_MM
    }

    fn enter(&mut self, leg: &BlockLimits) {
        let high = leg.length_mm * (UNITS_PER_MM / 65_536.0);
        let whole = high as u32;
        let low = (high - whole as f32) * 65_536.0 + self.length_remainder;
        self.length_remainder = low - low as u32 as f32;
        self.remaining = (u64::from(whole) << 16) + u64::from(low as u32);
        self.is_begun = true;
    }

    /// The next cell.
    pub(in crate::motion) fn next_sample(
        &mut self,
        road: &impl BlocksAhead,
        stops: bool,
        leaving: LeavingSample,
        window_s: f32,
    ) -> Sample {
        let way = self.next_distance(road, stops, leaving, window_s);
        Sample {
            distance: way,
            end_mm_s: self.speed_mm_s,
        }
    }

    fn next_distance(
        &mut self,
        road: &impl BlocksAhead,
        stops: bool,
        leaving: LeavingSample,
        window_s: f32,
    ) -> u32 {
        self.since_acceleration = self.since_acceleration.saturating_add(1);
        if !self.is_begun {
            let Some(leg) = road.limits(self.number) else {
                return 0;
            };
            self.enter(&leg);
            self.remaining = self.remaining.saturating_sub(LENGTH_RESERVE_UNITS);
        }
        if self.remaining == 0 && !self.start_block(road, leaving.is_standstill) {
            self.speed_mm_s = 0.0;
            return 0;
        }
        let Some(leg) = road.limits(self.number) else {
            return 0;
        };
        let gate = road.junction(self.number);
        let left_mm = self.remaining_mm();
        let v = self.speed_mm_s;
        let gain = gate.acceleration(&leg, left_mm) * SAMPLE_S;
        let reach = self.sample_limits(road, &leg, gain, window_s);
        let most = v + math::min(gain, math::max(leaving.change + gain, 0.0));
        let hardest = reach.hardest * BRAKING_TOLERANCE;
        let least = v + math::max(-hardest, math::min(leaving.change - hardest, 0.0));
        let mut reached = math::min(most, math::min(reach.top, self.cap_mm_s));
        if reached > v {
            reached = math::max(v, math::min(reached, reach.free));
        }
        reached = if stops {
            0.0
        } else {
            math::min(reached, reach.brake)
        };
        reached = math::max(reached, math::max(least, 0.0));
        let rest_mm = (0.5 * v + FINAL_SAMPLE_TOLERANCE * gain) * SAMPLE_S;
        if gate.is_stop() && v <= gain && left_mm <= rest_mm {
            // Less than a cell of braking is left.
            self.speed_mm_s = 0.0;
            self.carry = 0.0;
            return self.advance(road, self.remaining, window_s);
        }
        if reached > v {
            self.since_acceleration = 0;
        }
        self.speed_mm_s = reached;
        let way = 0.5 * (v + reached) * (SAMPLE_S * UNITS_PER_MM) + self.carry;
        let whole = way as u32;
        self.carry = way - whole as f32;
        self.advance(road, u64::from(whole), window_s)
    }

    /// What a cell can do, by the blocks that it may touch.
    fn sample_limits(
        &self,
        road: &impl BlocksAhead,
        leg: &BlockLimits,
        gain: f32,
        window_s: f32,
    ) -> SampleLimits {
        let far_mm = (self.speed_mm_s + 0.5 * gain) * SAMPLE_S;
        let gate = road.junction(self.number);
        let mut reach = SampleLimits {
            brake: NO_SPEED_LIMIT_MM_S,
            free: NO_SPEED_LIMIT_MM_S,
            top: leg.speed_mm_s,
            hardest: gain,
        };
        let mut way_mm = self.remaining_mm();
        let mut leg = *leg;
        let mut ahead = gate;
        if way_mm < far_mm
            && !gate.is_stop()
            && let Some(next) = road.limits(self.number + 1)
        {
            // It may come to the end of the block.
            [reach.brake, reach.free] = gate.speeds_at_junction();
            reach.top = math::min(reach.top, next.speed_mm_s);
            way_mm += next.length_mm;
            leg = next;
            ahead = road.junction(self.number + 1);
            let next_gain = ahead.acceleration(&leg, leg.length_mm) * SAMPLE_S;
            reach.hardest = math::max(reach.hardest, next_gain);
        }
        let (brake, free) = ahead.speeds(&leg, way_mm, self.speed_mm_s, SAMPLE_S, window_s);
        reach.brake = math::min(reach.brake, brake);
        reach.free = math::min(reach.free, free);
        reach
    }

    /// Whether it is faster than it may be by the gate ahead, in the leg that it is in.
    pub(in crate::motion) fn exceeds_junction(
        &self,
        road: &impl BlocksAhead,
        window: usize,
        window_s: f32,
    ) -> bool {
        let Some(leg) = road.limits(self.number) else {
            return false;
        };
        if !self.is_begun || !self.is_moving() {
            return self.is_begun && self.remaining == 0;
        }
        let gate = road.junction(self.number);
        let left_mm = self.remaining_mm();
        let (brake, free) = gate.speeds(&leg, left_mm, self.speed_mm_s, 0.0, window_s);
        let limit = if self.since_acceleration < window {
            free
        } else {
            brake
        };
        self.speed_mm_s > limit * 1.001
    }

    /// Whether a corner so far ahead that was not known asks for what it has not done: for less speed near
    /// it, as far as it may have braked in its leg, or for less acceleration.
    pub(in crate::motion) fn exceeded_corner(
        &self,
        road: &impl BlocksAhead,
        ahead_mm: f32,
        corner_mm_s: f32,
        window_s: f32,
    ) -> bool {
        let within_mm = influence_mm(corner_mm_s, window_s) - ahead_mm;
        let Some(leg) = road.limits(self.number) else {
            return false;
        };
        if !self.is_moving() || within_mm <= 0.0 {
            return false;
        }
        let left_mm = self.remaining_mm();
        let gate = road.junction(self.number);
        let is_softer =
            gate.acceleration(&leg, left_mm) * ACCELERATION_TOLERANCE < leg.acceleration(left_mm);
        let gained = 2.0 * leg.acceleration_mm_s2 * within_mm;
        let fastest_sqr = self.speed_mm_s * self.speed_mm_s + gained;
        is_softer || fastest_sqr > corner_mm_s * corner_mm_s
    }

    /// Goes on by a way, and tells how far that was.
    fn advance(&mut self, road: &impl BlocksAhead, way: u64, window_s: f32) -> u32 {
        let here = way.min(self.remaining);
        self.remaining -= here;
        self.consume_cap(here);
        if self.remaining != 0 {
            return way as u32;
        }
        if !self.pass_junction(road, window_s) {
            self.speed_mm_s = 0.0;
            return here as u32;
        }
        // A block takes a cell at least: not more than one is passed. What rounding makes longer
        // than the block is left out, so that its end is passed in motion, too.
        let there = (way - here).min(self.remaining.saturating_sub(1));
        self.remaining -= there;
        self.consume_cap(there);
        (here + there) as u32
    }

    #[inline(never)]
    fn consume_cap(&mut self, way: u64) {
        self.cap_mm -= way as u32 as f32 * UNIT_MM;
        if self.cap_mm <= 0.0 {
            self.cap_mm_s = NO_SPEED_LIMIT_MM_S;
            self.cap_mm = 0.0;
        }
    }

    /// Goes through the end of a block, if that may be.
    fn pass_junction(&mut self, road: &impl BlocksAhead, window_s: f32) -> bool {
        let (Some(leg), Some(next)) = (road.limits(self.number), road.limits(self.number + 1))
        else {
            return false;
        };
        if road.junction(self.number).is_stop() {
            return false;
        }
        let half = 0.5 / math::min(leg.acceleration_mm_s2, next.acceleration_mm_s2);
        // After a change of overrides it may be faster than what holds now: then it could not brake, and
        // what held before still does around the place.
        let limits = [leg.speed_mm_s, road.corner_mm_s(self.number)];
        let [speed, corner] = limits.map(|limit| math::max(limit, self.speed_mm_s));
        self.cap(speed, half, window_s);
        self.cap(corner, half, window_s);
        self.number += 1;
        self.enter(&next);
        true
    }

    /// Begins the next block, from rest, if there is one.
    fn start_block(&mut self, road: &impl BlocksAhead, is_rest: bool) -> bool {
        let Some(next) = road.limits(self.number + 1).filter(|_| is_rest) else {
            return false;
        };
        self.cap_mm_s = NO_SPEED_LIMIT_MM_S;
        self.number += 1;
        self.enter(&next);
        self.remaining = self.remaining.saturating_sub(LENGTH_RESERVE_UNITS);
        true
    }

    /// A limit that holds behind the place too; `half` of the inverse acceleration there.
    #[inline(never)]
    fn cap(&mut self, speed_mm_s: f32, half: f32, window_s: f32) {
        let reach_mm = influence_mm(speed_mm_s, window_s);
        let (low, low_mm, high, high_mm) = if speed_mm_s <= self.cap_mm_s {
            (speed_mm_s, reach_mm, self.cap_mm_s, self.cap_mm)
        } else {
            (self.cap_mm_s, self.cap_mm, speed_mm_s, reach_mm)
        };
        let way_mm = high_mm - half * (high * high - low * low);
        self.cap_mm = math::max(low_mm, way_mm);
        self.cap_mm_s = low;
    }

    /// The oldest block has been removed.
    pub(in crate::motion) fn block_removed(&mut self) {
        if self.number == 0 {
            // Rounding: what was left of it is nothing.
            self.is_begun = false;
        } else {
            self.number -= 1;
        }
    }
}
