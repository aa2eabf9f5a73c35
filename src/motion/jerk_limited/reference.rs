//! The reference motion: its distance along the path in each sample of 1 ms.

use super::junctions::{BlockLimits, JunctionLimit, influence_mm};
use crate::{math, model::timing::SAMPLE_S, motion::limits::NO_SPEED_LIMIT_MM_S};

/// Share of a sample's change of speed by which the last sample before a standstill may be too long:
/// it bounds the remainder of rounding (tests in profile/tests.rs).
const FINAL_SAMPLE_TOLERANCE: f32 = 0.05;

/// Distance that the reference leaves out of the path between two standstills, units: rounding then never
/// lets the machine be at the end before it is at a standstill.
const LENGTH_RESERVE_UNITS: u64 = 16;

/// Factor by which late braking may exceed the block's acceleration. Each sample's speed is rounded in
/// one direction: that adds up to some 20 nm, which the last sample would have to make up for.
const BRAKING_TOLERANCE: f32 = 1.001;

/// Factor up to which an acceleration is no lower than another: a small change of direction makes no
/// more of a difference.
const ACCELERATION_TOLERANCE: f32 = 1.005;

/// Units of distance in a mm: 1 nm.
pub(super) const UNITS_PER_MM: f32 = 1_048_576.0;
/// A unit of distance, mm.
pub(super) const UNIT_MM: f32 = 1.0 / UNITS_PER_MM;

/// The blocks ahead, and the junction limits at their ends.
pub(in crate::motion) trait BlocksAhead {
    /// The limits of a block by its number, the oldest is 0.
    fn limits(&self, number: usize) -> Option<BlockLimits>;
    /// The junction limit at its end.
    fn junction(&self, number: usize) -> &JunctionLimit;
    /// Greatest speed at its end, mm/s.
    fn corner_mm_s(&self, number: usize) -> f32;
}

/// The sample that leaves the averaging window.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct LeavingSample {
    /// Its change of speed, mm/s.
    pub(in crate::motion) change: f32,
    /// No motion is in the window.
    pub(in crate::motion) is_standstill: bool,
}

/// A sample of the reference motion.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct Sample {
    /// Distance, units.
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

/// The position and speed of the reference.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct ReferenceMotion {
    /// The block, counted from the oldest.
    number: usize,
    is_begun: bool,
    /// Remainder of the block, units.
    remaining: u64,
    /// Remainder of rounding distances to units, units.
    carry: f32,
    /// Remainder of rounding lengths to units, units.
    length_remainder: f32,
    speed_mm_s: f32,
    /// Samples since the reference has accelerated.
    since_acceleration: usize,
    /// Greatest speed for `cap_mm` behind slower points.
    cap_mm_s: f32,
    cap_mm: f32,
}

/// The limits of the next sample.
struct SampleLimits {
    /// Greatest speed at its end that leaves the distance to brake, mm/s.
    brake: f32,
    /// The same if the sample accelerates, mm/s.
    free: f32,
    /// Lowest speed limit of the blocks, mm/s.
    top: f32,
    /// Greatest change of speed by braking, mm/s.
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

    /// Whether the reference moves.
    pub(in crate::motion) fn is_moving(&self) -> bool {
        self.speed_mm_s > 0.0
    }

    /// The speed of the reference, mm/s.
    pub(in crate::motion) fn speed_mm_s(&self) -> f32 {
        self.speed_mm_s
    }

    /// The number of the block that the reference is in, the oldest is 0.
    pub(in crate::motion) fn number(&self) -> usize {
        self.number
    }

    /// Whether the reference has come to the end of the oldest block.
    pub(in crate::motion) fn has_left_oldest(&self) -> bool {
        self.number > 0 || self.is_begun && self.remaining == 0
    }

    /// The remainder of the block that the reference is in, mm.
    pub(in crate::motion) fn remaining_mm(&self) -> f32 {
        let high = (self.remaining >> 16) as u32 as f32;
        let low = (self.remaining as u32 & 0xffff) as f32;
        (high * 65_536.0 + low) * UNIT_MM
    }

    fn enter(&mut self, limits: &BlockLimits) {
        let high = limits.length_mm * (UNITS_PER_MM / 65_536.0);
        let whole = high as u32;
        let low = (high - whole as f32) * 65_536.0 + self.length_remainder;
        self.length_remainder = low - low as u32 as f32;
        self.remaining = (u64::from(whole) << 16) + u64::from(low as u32);
        self.is_begun = true;
    }

    /// The next sample. With `stops` it brakes to a standstill.
    pub(in crate::motion) fn next_sample(
        &mut self,
        blocks: &impl BlocksAhead,
        stops: bool,
        leaving: LeavingSample,
        window_s: f32,
    ) -> Sample {
        let distance = self.next_distance(blocks, stops, leaving, window_s);
        Sample {
            distance,
            end_mm_s: self.speed_mm_s,
        }
    }

    fn next_distance(
        &mut self,
        blocks: &impl BlocksAhead,
        stops: bool,
        leaving: LeavingSample,
        window_s: f32,
    ) -> u32 {
        self.since_acceleration = self.since_acceleration.saturating_add(1);
        if !self.is_begun {
            let Some(limits) = blocks.limits(self.number) else {
                return 0;
            };
            self.enter(&limits);
            self.remaining = self.remaining.saturating_sub(LENGTH_RESERVE_UNITS);
        }
        if self.remaining == 0 && !self.start_block(blocks, leaving.is_standstill) {
            self.speed_mm_s = 0.0;
            return 0;
        }
        let Some(limits) = blocks.limits(self.number) else {
            return 0;
        };
        let junction = blocks.junction(self.number);
        let remaining_mm = self.remaining_mm();
        let v = self.speed_mm_s;
        let gain = junction.acceleration(&limits, remaining_mm) * SAMPLE_S;
        let bounds = self.sample_limits(blocks, &limits, gain, window_s);
        let most = v + math::min(gain, math::max(leaving.change + gain, 0.0));
        let hardest = bounds.hardest * BRAKING_TOLERANCE;
        let lowest = v + math::max(-hardest, math::min(leaving.change - hardest, 0.0));
        let mut reached = math::min(most, math::min(bounds.top, self.cap_mm_s));
        if reached > v {
            reached = math::max(v, math::min(reached, bounds.free));
        }
        reached = if stops {
            0.0
        } else {
            math::min(reached, bounds.brake)
        };
        reached = math::max(reached, math::max(lowest, 0.0));
        let last_mm = (0.5 * v + FINAL_SAMPLE_TOLERANCE * gain) * SAMPLE_S;
        if junction.is_stop() && v <= gain && remaining_mm <= last_mm {
            // Less than a sample of braking is left.
            self.speed_mm_s = 0.0;
            self.carry = 0.0;
            return self.advance(blocks, self.remaining, window_s);
        }
        if reached > v {
            self.since_acceleration = 0;
        }
        self.speed_mm_s = reached;
        let distance = 0.5 * (v + reached) * (SAMPLE_S * UNITS_PER_MM) + self.carry;
        let whole = distance as u32;
        self.carry = distance - whole as f32;
        self.advance(blocks, u64::from(whole), window_s)
    }

    /// The limits of the next sample, from the blocks that it may touch.
    fn sample_limits(
        &self,
        blocks: &impl BlocksAhead,
        limits: &BlockLimits,
        gain: f32,
        window_s: f32,
    ) -> SampleLimits {
        let far_mm = (self.speed_mm_s + 0.5 * gain) * SAMPLE_S;
        let junction = blocks.junction(self.number);
        let mut bounds = SampleLimits {
            brake: NO_SPEED_LIMIT_MM_S,
            free: NO_SPEED_LIMIT_MM_S,
            top: limits.speed_mm_s,
            hardest: gain,
        };
        let mut distance_mm = self.remaining_mm();
        let mut limits = *limits;
        let mut ahead = junction;
        if distance_mm < far_mm
            && !junction.is_stop()
            && let Some(next) = blocks.limits(self.number + 1)
        {
            // The sample may come to the end of the block.
            [bounds.brake, bounds.free] = junction.speeds_at_junction();
            bounds.top = math::min(bounds.top, next.speed_mm_s);
            distance_mm += next.length_mm;
            limits = next;
            ahead = blocks.junction(self.number + 1);
            let next_gain = ahead.acceleration(&limits, limits.length_mm) * SAMPLE_S;
            bounds.hardest = math::max(bounds.hardest, next_gain);
        }
        let (brake, free) = ahead.speeds(&limits, distance_mm, self.speed_mm_s, SAMPLE_S, window_s);
        bounds.brake = math::min(bounds.brake, brake);
        bounds.free = math::min(bounds.free, free);
        bounds
    }

    /// Whether the reference is faster than the junction limit ahead allows.
    pub(in crate::motion) fn exceeds_junction(
        &self,
        blocks: &impl BlocksAhead,
        window: usize,
        window_s: f32,
    ) -> bool {
        let Some(limits) = blocks.limits(self.number) else {
            return false;
        };
        if !self.is_begun || !self.is_moving() {
            return self.is_begun && self.remaining == 0;
        }
        let junction = blocks.junction(self.number);
        let remaining_mm = self.remaining_mm();
        let (brake, free) = junction.speeds(&limits, remaining_mm, self.speed_mm_s, 0.0, window_s);
        let limit = if self.since_acceleration < window {
            free
        } else {
            brake
        };
        self.speed_mm_s > limit * 1.001
    }

    /// Whether a corner `ahead_mm` ahead that was not known asks for a lower speed within its influence
    /// than the reference may have had, or for a lower acceleration.
    pub(in crate::motion) fn exceeded_corner(
        &self,
        blocks: &impl BlocksAhead,
        ahead_mm: f32,
        corner_mm_s: f32,
        window_s: f32,
    ) -> bool {
        let within_mm = influence_mm(corner_mm_s, window_s) - ahead_mm;
        let Some(limits) = blocks.limits(self.number) else {
            return false;
        };
        if !self.is_moving() || within_mm <= 0.0 {
            return false;
        }
        let remaining_mm = self.remaining_mm();
        let junction = blocks.junction(self.number);
        let is_softer = junction.acceleration(&limits, remaining_mm) * ACCELERATION_TOLERANCE
            < limits.acceleration(remaining_mm);
        let gained = 2.0 * limits.acceleration_mm_s2 * within_mm;
        let fastest_sqr = self.speed_mm_s * self.speed_mm_s + gained;
        is_softer || fastest_sqr > corner_mm_s * corner_mm_s
    }

    /// Goes on by a distance at most; returns how far.
    fn advance(&mut self, blocks: &impl BlocksAhead, distance: u64, window_s: f32) -> u32 {
        let here = distance.min(self.remaining);
        self.remaining -= here;
        self.consume_cap(here);
        if self.remaining != 0 {
            return distance as u32;
        }
        if !self.pass_junction(blocks, window_s) {
            self.speed_mm_s = 0.0;
            return here as u32;
        }
        // A block takes a sample at lowest: no more than one end is passed. The excess over the next
        // block by rounding is left out, so that its end is passed in motion, too.
        let there = (distance - here).min(self.remaining.saturating_sub(1));
        self.remaining -= there;
        self.consume_cap(there);
        (here + there) as u32
    }

    #[inline(never)]
    fn consume_cap(&mut self, distance: u64) {
        self.cap_mm -= distance as u32 as f32 * UNIT_MM;
        if self.cap_mm <= 0.0 {
            self.cap_mm_s = NO_SPEED_LIMIT_MM_S;
            self.cap_mm = 0.0;
        }
    }

    /// Passes the end of a block in motion; returns whether that is allowed.
    fn pass_junction(&mut self, blocks: &impl BlocksAhead, window_s: f32) -> bool {
        let (Some(limits), Some(next)) =
            (blocks.limits(self.number), blocks.limits(self.number + 1))
        else {
            return false;
        };
        if blocks.junction(self.number).is_stop() {
            return false;
        }
        let half = 0.5 / math::min(limits.acceleration_mm_s2, next.acceleration_mm_s2);
        // After a change of overrides the reference may be faster than the new limits: then the old
        // ones hold around the junction.
        let limits = [limits.speed_mm_s, blocks.corner_mm_s(self.number)];
        let [speed, corner] = limits.map(|limit| math::max(limit, self.speed_mm_s));
        self.cap(speed, half, window_s);
        self.cap(corner, half, window_s);
        self.number += 1;
        self.enter(&next);
        true
    }

    /// Begins the next block from a standstill; returns whether there is one.
    fn start_block(&mut self, blocks: &impl BlocksAhead, is_standstill: bool) -> bool {
        let Some(next) = blocks.limits(self.number + 1).filter(|_| is_standstill) else {
            return false;
        };
        self.cap_mm_s = NO_SPEED_LIMIT_MM_S;
        self.number += 1;
        self.enter(&next);
        self.remaining = self.remaining.saturating_sub(LENGTH_RESERVE_UNITS);
        true
    }

    /// Keeps a speed limit for its influence behind the junction; `half` of the inverse acceleration there.
    #[inline(never)]
    fn cap(&mut self, speed_mm_s: f32, half: f32, window_s: f32) {
        let influence_mm = influence_mm(speed_mm_s, window_s);
        let (low, low_mm, high, high_mm) = if speed_mm_s <= self.cap_mm_s {
            (speed_mm_s, influence_mm, self.cap_mm_s, self.cap_mm)
        } else {
            (self.cap_mm_s, self.cap_mm, speed_mm_s, influence_mm)
        };
        let distance_mm = high_mm - half * (high * high - low * low);
        self.cap_mm = math::max(low_mm, distance_mm);
        self.cap_mm_s = low;
    }

    /// Follows the removal of the oldest block.
    pub(in crate::motion) fn block_removed(&mut self) {
        if self.number == 0 {
            // The remainder of it was rounding.
            self.is_begun = false;
        } else {
            self.number -= 1;
        }
    }
}
