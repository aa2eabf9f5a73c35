//! The reference motion: its distance along the path in each sample of 1 ms.

use super::junctions::{AIMED_MM_PER_MM_S2, BlockLimits, JunctionLimit, SampleStart, TargetsAhead};
use crate::{
    math,
    model::timing::SAMPLE_S,
    motion::limits::{MIN_DIVISOR_MM_S, NO_ACCELERATION_LIMIT_MM_S2},
};

/// Greatest speed before the last sample of a motion to a standstill, mm/s, unless a sample's jerk allows more.
const FINAL_MM_S: f32 = 0.02;
/// Part of the jerk that the last sample may have: the distance left adds to the jerk.
const FINAL_JERK_PART: f32 = 0.6;
/// How many times that distance may be left before a standstill.
const FINAL_AIMED_FACTOR: f32 = 3.0;
/// Distance that is made up for in a sample, mm; or more, a part of the remainder and of the distance that a sample's jerk
/// makes. None is seen as a jerk (tests in profile/tests.rs).
const FINAL_MM: f32 = 4.0e-5;
const MADE_UP_REMAINDER_SHARE: f32 = 0.33;
const MADE_UP_JERK_PART: f32 = 0.18;
/// Distance in two samples up to which a change by that is no jerk, mm.
const CREEP_MM: f32 = 4.0e-5;

/// Distance that the reference leaves out of the path between two standstills, units: rounding then never
/// lets the machine be at the end before it is at a standstill.
const LENGTH_RESERVE_UNITS: u64 = 64;

/// Factors by which braking, and its jerk, may exceed the plan's: accelerations change from sample to sample, where
/// the plan's may do so within a sample.
const BRAKING_TOLERANCE: f32 = 1.004;
const JERK_TOLERANCE: f32 = 1.01;

/// Greatest share of the difference between the lowest acceleration and an unsafe one that is tried. A target passed
/// more slowly is no target any more, so that little can be interpolated: with a share of 1, programs of short lines
/// take 1 % longer.
const MAX_INTERPOLATED_SHARE: f32 = 0.5;

/// Distance that a slack may be short of, mm and s of motion: braking with its tolerance makes up for it.
const SLACK_TOLERANCE_MM: f32 = 2.0e-4;
const SLACK_TOLERANCE_S: f32 = 1.0e-4;

/// Distance beyond which a slack is short because limits have changed, mm: braking suits the next blocks then, too, as a
/// limit is exceeded in any case.
const OVERSPEED_MM: f32 = 0.01;

/// Units of distance in a mm: a quarter of a nm.
pub(super) const UNITS_PER_MM: f32 = 4_194_304.0;
/// A unit of distance, mm.
pub(super) const UNIT_MM: f32 = 1.0 / UNITS_PER_MM;

/// The blocks ahead, and the junction limits at their ends.
pub(in crate::motion) trait BlocksAhead {
    /// The limits of a block by its number, the oldest is 0.
    fn limits(&self, number: usize) -> Option<BlockLimits>;
    /// The junction limit at its end.
    fn junction(&self, number: usize) -> &JunctionLimit;
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
    /// Acceleration in the newest sample, mm/s².
    acceleration_mm_s2: f32,
    /// Distances in the newest samples, units.
    newest: [u32; 2],
    /// It exceeds limits that have changed.
    is_overspeed: bool,
    /// Greatest accelerations of the blocks of the newest samples, mm/s²: the machine is behind the reference, and has
    /// their jerk.
    recent_limits_mm_s2: [f32; 2],
}

/// The part of the path that the next sample may touch.
struct SampleLimits {
    /// Of the block.
    speed_mm_s: f32,
    acceleration_mm_s2: f32,
    /// The hardest braking in the block, mm/s².
    braking_mm_s2: f32,
    start: SampleStart,
    /// Greatest change of the acceleration by the next sample, mm/s².
    change_mm_s2: f32,
    /// A sample's share of the ramp time.
    ramp_share: f32,
    ahead: TargetsAhead,
}

/// The accelerations that the next sample may have, mm/s².
struct AccelerationRange {
    /// The greatest, if it is safe.
    wanted: f32,
    /// The hardest braking.
    lowest: f32,
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
        acceleration_mm_s2: 0.0,
        newest: [0; 2],
        is_overspeed: false,
        recent_limits_mm_s2: [NO_ACCELERATION_LIMIT_MM_S2; 2],
    };

    /// Whether the reference moves.
    pub(in crate::motion) fn is_moving(&self) -> bool {
        self.speed_mm_s > 0.0
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
        ramp_s: f32,
    ) -> Sample {
        let is_between = !self.is_begun || self.remaining == 0;
        let distance = if is_between {
            self.begin_distance(blocks, stops, leaving, ramp_s)
        } else {
            self.next_distance(blocks, stops, ramp_s)
        };
        if self.speed_mm_s <= 0.0 {
            self.acceleration_mm_s2 = 0.0;
        }
        self.newest = [distance, self.newest[0]];
        Sample {
            distance,
            end_mm_s: self.speed_mm_s,
        }
    }

    /// The distance of the next sample where a block may begin. That and slow motion have functions of their own, so
    /// that the longest path is in neither.
    #[inline(never)]
    fn begin_distance(
        &mut self,
        blocks: &impl BlocksAhead,
        stops: bool,
        leaving: LeavingSample,
        ramp_s: f32,
    ) -> u32 {
        let Some(limits) = self.start_block(blocks, leaving.is_standstill) else {
            self.speed_mm_s = 0.0;
            return 0;
        };
        let path = self.sample_limits(blocks, &limits, ramp_s);
        self.slow_distance(blocks, &path, stops)
    }

    /// The distance of the next sample within a block.
    #[inline]
    fn next_distance(&mut self, blocks: &impl BlocksAhead, stops: bool, ramp_s: f32) -> u32 {
        let Some(limits) = blocks.limits(self.number) else {
            return 0;
        };
        let path = self.sample_limits(blocks, &limits, ramp_s);
        let final_mm_s = FINAL_JERK_PART * SAMPLE_S * path.change_mm_s2;
        if self.speed_mm_s <= math::max(final_mm_s, FINAL_MM_S) {
            return self.slow_distance(blocks, &path, stops);
        }
        let range = self.acceleration_range(blocks.junction(self.number), &path, stops);
        let acceleration = self.next_acceleration(&path.ahead, &range);
        self.go_on(blocks, &path, acceleration)
    }

    /// The distance of the next sample at a standstill, or so slowly that a standstill may be next: with the lowest
    /// acceleration where the wanted one is not safe.
    #[inline(never)]
    fn slow_distance(
        &mut self,
        blocks: &impl BlocksAhead,
        path: &SampleLimits,
        stops: bool,
    ) -> u32 {
        let junction = blocks.junction(self.number);
        let before = self.speed_mm_s;
        let change = FINAL_JERK_PART * path.change_mm_s2;
        let final_mm = 0.5 * before * SAMPLE_S;
        let final_change = (before * (1.0 / SAMPLE_S) + self.acceleration_mm_s2).abs();
        let is_final = before <= change * SAMPLE_S && final_change <= change;
        let aimed_mm = AIMED_MM_PER_MM_S2 * path.braking_mm_s2;
        if junction.is_stop()
            && (is_final || before <= FINAL_MM_S)
            && path.start.remaining_mm <= final_mm + FINAL_AIMED_FACTOR * aimed_mm
        {
            return self.creep(blocks, path, final_mm);
        }
        let range = self.acceleration_range(junction, path, stops);
        let (slack, nearest) = path.ahead.least_slack_mm(range.wanted);
        let mut acceleration = range.wanted;
        if slack < 0.0 || self.is_overspeed && before > 0.0 {
            if before > 0.0 {
                let least = path.ahead.slack_mm(nearest, range.lowest);
                self.is_overspeed = least < -OVERSPEED_MM;
                acceleration = range.lowest;
            } else if stops {
                acceleration = 0.0;
            } else {
                // Less is left, of one block or several, than braking aims to leave.
                return self.creep(blocks, path, 0.0);
            }
        } else {
            self.is_overspeed = false;
        }
        self.go_on(blocks, path, acceleration)
    }

    /// Goes on by a sample of this acceleration.
    #[inline]
    fn go_on(&mut self, blocks: &impl BlocksAhead, path: &SampleLimits, acceleration: f32) -> u32 {
        self.recent_limits_mm_s2 = [path.acceleration_mm_s2, self.recent_limits_mm_s2[0]];
        let before = self.speed_mm_s;
        let after = math::max(before + acceleration * SAMPLE_S, 0.0);
        self.acceleration_mm_s2 = acceleration;
        self.speed_mm_s = after;
        let distance = (before + after) * (0.5 * SAMPLE_S * UNITS_PER_MM) + self.carry;
        let whole = distance as u32;
        self.carry = distance - whole as f32;
        self.advance(blocks, u64::from(whole))
    }

    /// Goes on by what is left before a standstill, or a part of that.
    #[inline(never)]
    fn creep(&mut self, blocks: &impl BlocksAhead, path: &SampleLimits, final_mm: f32) -> u32 {
        self.speed_mm_s = 0.0;
        self.carry = 0.0;
        let most_mm = math::max(final_mm, self.made_up_mm(path));
        let most = (most_mm * UNITS_PER_MM) as u32;
        self.advance(blocks, self.remaining.min(u64::from(most.max(1))))
    }

    /// Returns what is made up for in a sample before a standstill, mm.
    fn made_up_mm(&self, path: &SampleLimits) -> f32 {
        let by_jerk_mm = path.change_mm_s2 * (SAMPLE_S * SAMPLE_S);
        let part_mm = math::min(
            MADE_UP_JERK_PART * by_jerk_mm,
            MADE_UP_REMAINDER_SHARE * path.start.remaining_mm,
        );
        let most_mm = math::max(FINAL_MM, part_mm);
        let [newest_mm, older_mm] = self.newest.map(|distance| distance as f32 * UNIT_MM);
        if newest_mm + older_mm <= CREEP_MM {
            most_mm
        } else {
            math::min(most_mm, 2.0 * newest_mm - older_mm + by_jerk_mm)
        }
    }

    /// The part of the path that the next sample may touch.
    #[inline(never)]
    fn sample_limits(
        &self,
        blocks: &impl BlocksAhead,
        limits: &BlockLimits,
        ramp_s: f32,
    ) -> SampleLimits {
        let junction = blocks.junction(self.number);
        let start = SampleStart {
            speed_mm_s: self.speed_mm_s,
            remaining_mm: self.remaining_mm(),
        };
        let farthest_mm = (self.speed_mm_s + limits.acceleration_mm_s2 * SAMPLE_S) * SAMPLE_S;
        let next = if start.remaining_mm < farthest_mm && !junction.is_stop() {
            let next = blocks.limits(self.number + 1);
            next.map(|next| (next, blocks.junction(self.number + 1)))
        } else {
            None
        };
        let [newest, older] = self.recent_limits_mm_s2;
        let recent = math::min(newest, older);
        let ramp_share = SAMPLE_S / ramp_s;
        SampleLimits {
            speed_mm_s: limits.speed_mm_s,
            acceleration_mm_s2: limits.acceleration_mm_s2,
            braking_mm_s2: junction.braking_mm_s2(limits),
            start,
            change_mm_s2: math::min(limits.acceleration_mm_s2, recent) * ramp_share,
            ramp_share,
            ahead: TargetsAhead::new(limits, junction, next, ramp_s, start),
        }
    }

    /// The accelerations that the next sample may have before a junction.
    #[inline]
    fn acceleration_range(
        &self,
        junction: &JunctionLimit,
        path: &SampleLimits,
        stops: bool,
    ) -> AccelerationRange {
        let (speed, before) = (path.start.speed_mm_s, self.acceleration_mm_s2);
        let change = path.change_mm_s2;
        let is_braking = stops || self.is_overspeed && speed > 0.0;
        // A standstill may come in a block of less jerk.
        let ending_mm_s2 = if is_braking {
            math::min(path.braking_mm_s2, junction.ending_mm_s2())
        } else {
            path.braking_mm_s2
        };
        let ending_change = math::min(change, ending_mm_s2 * path.ramp_share);
        let lowest = math::max(
            before - JERK_TOLERANCE * change,
            -BRAKING_TOLERANCE * path.braking_mm_s2,
        );
        let has_to_end = speed > 0.0
            && lowest < 0.0
            && lowest * (lowest - ending_change) * SAMPLE_S > 2.0 * ending_change * speed;
        let to_limit = path.speed_mm_s - speed;
        // One of both is near, as a rule: the standstill, or the greatest speed. Only that one costs a root.
        let (difference, change_there) = if has_to_end {
            (-speed, ending_change)
        } else {
            (to_limit, change)
        };
        let per_change = 1.0 / change_there;
        let evenly = approach(difference, change_there, per_change);
        let (lowest, evenly) = if has_to_end {
            // A chord of the parabola of `approach` is below its root.
            let share = math::min(to_limit, speed) / math::max(speed, MIN_DIVISOR_MM_S);
            (math::max(lowest, evenly), -evenly * share)
        } else {
            (lowest, evenly)
        };
        let most = math::min(before + change, path.acceleration_mm_s2);
        let lowest = math::min(lowest, before + change);
        let wanted = if is_braking {
            lowest
        } else {
            math::min(most, evenly)
        };
        let wanted = junction.lowered_for_next(wanted, path.start, before, [change, per_change]);
        AccelerationRange {
            wanted: math::max(wanted, lowest),
            lowest,
        }
    }

    /// The acceleration of the next sample, mm/s²: the greatest of a safe motion.
    #[inline]
    fn next_acceleration(&mut self, ahead: &TargetsAhead, range: &AccelerationRange) -> f32 {
        let &AccelerationRange { wanted, lowest } = range;
        let was_overspeed = self.is_overspeed;
        let (slack, nearest) = ahead.least_slack_mm(wanted);
        if slack >= 0.0 && !was_overspeed {
            return wanted;
        }
        let least = ahead.slack_mm(nearest, lowest);
        self.is_overspeed = least < -OVERSPEED_MM;
        if was_overspeed {
            return wanted;
        }
        if least <= 0.0 {
            return lowest;
        }
        let share = math::min(least / (least - slack), MAX_INTERPOLATED_SHARE);
        let tried = lowest + share * (wanted - lowest);
        let is_safe = ahead.least_slack_mm(tried).0 >= 0.0;
        if is_safe { tried } else { lowest }
    }

    /// Whether the reference cannot keep what the blocks ahead ask for.
    pub(in crate::motion) fn is_too_fast(&self, blocks: &impl BlocksAhead, ramp_s: f32) -> bool {
        if !self.is_begun || !self.is_moving() {
            return self.is_begun && self.remaining == 0;
        }
        let Some(limits) = blocks.limits(self.number) else {
            return false;
        };
        let path = self.sample_limits(blocks, &limits, ramp_s);
        let lowest = math::max(
            self.acceleration_mm_s2 - path.change_mm_s2,
            -path.braking_mm_s2,
        );
        let tolerance_mm = SLACK_TOLERANCE_MM + SLACK_TOLERANCE_S * self.speed_mm_s;
        path.ahead.least_slack_mm(lowest).0 < -tolerance_mm
    }

    /// Goes on by a distance at most; returns how far.
    fn advance(&mut self, blocks: &impl BlocksAhead, distance: u64) -> u32 {
        let here = distance.min(self.remaining);
        self.remaining -= here;
        if self.remaining != 0 {
            return distance as u32;
        }
        if !self.pass_junction(blocks) {
            self.speed_mm_s = 0.0;
            return here as u32;
        }
        // A block takes a sample at lowest: no more than one end is passed. The excess over the next
        // block by rounding is left out, so that its end is passed in motion, too.
        let there = (distance - here).min(self.remaining.saturating_sub(1));
        self.remaining -= there;
        (here + there) as u32
    }

    /// Passes the end of a block in motion; returns whether that is allowed.
    fn pass_junction(&mut self, blocks: &impl BlocksAhead) -> bool {
        let next = blocks.limits(self.number + 1);
        let Some(next) = next.filter(|_| !blocks.junction(self.number).is_stop()) else {
            return false;
        };
        self.number += 1;
        self.enter(&next);
        true
    }

    /// Begins the oldest block, or the next one from a standstill; returns its limits if there is one.
    fn start_block(
        &mut self,
        blocks: &impl BlocksAhead,
        is_standstill: bool,
    ) -> Option<BlockLimits> {
        let number = self.number + usize::from(self.is_begun);
        let may_begin = is_standstill || !self.is_begun;
        let next = blocks.limits(number).filter(|_| may_begin)?;
        self.number = number;
        self.enter(&next);
        self.remaining = self.remaining.saturating_sub(LENGTH_RESERVE_UNITS);
        Some(next)
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

/// Returns the acceleration with which a difference of speed is made up for when it ends evenly, of either sign, mm/s²:
/// with that of the next sample included, the root of a²/(2j) + a·t/2 = Δv. The change of acceleration in a sample is
/// j·t; its inverse is given, too.
#[inline]
fn approach(difference_mm_s: f32, change_mm_s2: f32, per_change: f32) -> f32 {
    let steps = (4.0 / SAMPLE_S) * difference_mm_s.abs() * per_change;
    (change_mm_s2 * (math::half_root_of_twice(0.5 + steps) - 0.5)).copysign(difference_mm_s)
}
