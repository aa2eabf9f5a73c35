//! The reference motion: its distance along the path in each sample of 1 ms.

use super::junctions::{BlockLimits, JunctionLimit, PathState, TargetsAhead};
use crate::{math, model::timing::SAMPLE_S, motion::limits::NO_ACCELERATION_LIMIT_MM_S2};

/// Greatest speed before the last sample of a motion to a standstill, mm/s, unless a sample's jerk allows more.
const FINAL_MM_S: f32 = 0.02;
/// Part of the jerk that the last sample may have: the distance left adds to the jerk.
const FINAL_JERK_PART: f32 = 0.6;
/// Distance that braking aims to leave, for an acceleration of 1 mm/s², mm: the cost of an acceleration that comes to
/// its limit within a sample, t²/8.
const AIMED_MM_PER_MM_S2: f32 = 0.125 * SAMPLE_S * SAMPLE_S;
/// How many times that distance may be left before a standstill.
const FINAL_TIMES: f32 = 3.0;
/// Distance that is made up for in a sample, mm; or more, a part of the remainder and of the distance that a sample's jerk
/// makes. None is seen as a jerk (tests in profile/tests.rs).
const FINAL_MM: f32 = 4.0e-5;
const FINAL_SHARE: f32 = 0.33;
const FINAL_PART: f32 = 0.18;
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
const MOST_SHARE: f32 = 0.5;

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
struct SampleLimits<'a> {
    limits: BlockLimits,
    junction: &'a JunctionLimit,
    remaining_mm: f32,
    /// Jerk of the next sample, mm/s³.
    jerk_mm_s3: f32,
    /// What braking aims to leave of a distance, mm.
    aimed_mm: f32,
    ahead: TargetsAhead,
    /// The inverse of the ramp time, 1/s.
    per_ramp_s: f32,
}

impl SampleLimits<'_> {
    /// Jerk of a standstill, which may come in a block of less of it, mm/s³.
    fn ending_jerk_mm_s3(&self) -> f32 {
        math::min(
            self.jerk_mm_s3,
            self.junction.ending_mm_s2() * self.per_ramp_s,
        )
    }
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
        let distance = self.next_distance(blocks, stops, leaving, ramp_s);
        if self.speed_mm_s <= 0.0 {
            self.acceleration_mm_s2 = 0.0;
        }
        self.newest = [distance, self.newest[0]];
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
        ramp_s: f32,
    ) -> u32 {
        let is_between = !self.is_begun || self.remaining == 0;
        if is_between && !self.start_block(blocks, leaving.is_standstill) {
            self.speed_mm_s = 0.0;
            return 0;
        }
        let Some(limits) = blocks.limits(self.number) else {
            return 0;
        };
        let path = self.sample_limits(blocks, &limits, ramp_s);
        let before = self.speed_mm_s;
        let change = FINAL_JERK_PART * path.jerk_mm_s3 * SAMPLE_S;
        let final_mm = 0.5 * before * SAMPLE_S;
        let final_change = (before * (1.0 / SAMPLE_S) + self.acceleration_mm_s2).abs();
        let is_final = before <= change * SAMPLE_S && final_change <= change;
        if path.junction.is_stop()
            && (is_final || before <= FINAL_MM_S)
            && path.remaining_mm <= final_mm + FINAL_TIMES * path.aimed_mm
        {
            return self.creep(blocks, &path, final_mm);
        }
        let Some(acceleration) = self.next_acceleration(&path, stops) else {
            return self.creep(blocks, &path, 0.0);
        };
        self.recent_limits_mm_s2 = [path.limits.acceleration_mm_s2, self.recent_limits_mm_s2[0]];
        let after = math::max(before + acceleration * SAMPLE_S, 0.0);
        self.acceleration_mm_s2 = acceleration;
        self.speed_mm_s = after;
        let distance = 0.5 * (before + after) * (SAMPLE_S * UNITS_PER_MM) + self.carry;
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
        let by_jerk_mm = path.jerk_mm_s3 * (SAMPLE_S * SAMPLE_S * SAMPLE_S);
        let part_mm = math::min(FINAL_PART * by_jerk_mm, FINAL_SHARE * path.remaining_mm);
        let most_mm = math::max(FINAL_MM, part_mm);
        let [newest_mm, older_mm] = self.newest.map(|distance| distance as f32 * UNIT_MM);
        if newest_mm + older_mm <= CREEP_MM {
            most_mm
        } else {
            math::min(most_mm, 2.0 * newest_mm - older_mm + by_jerk_mm)
        }
    }

    /// The part of the path that the next sample may touch.
    fn sample_limits<'a>(
        &self,
        blocks: &'a impl BlocksAhead,
        limits: &BlockLimits,
        ramp_s: f32,
    ) -> SampleLimits<'a> {
        let junction = blocks.junction(self.number);
        let remaining_mm = self.remaining_mm();
        let farthest_mm = (self.speed_mm_s + limits.acceleration_mm_s2 * SAMPLE_S) * SAMPLE_S;
        let next = if remaining_mm < farthest_mm && !junction.is_stop() {
            let next = blocks.limits(self.number + 1);
            next.map(|next| (next, blocks.junction(self.number + 1)))
        } else {
            None
        };
        let [newest, older] = self.recent_limits_mm_s2;
        let recent = math::min(newest, older);
        let per_ramp_s = 1.0 / ramp_s;
        SampleLimits {
            ahead: TargetsAhead::new(limits, junction, next, ramp_s),
            jerk_mm_s3: math::min(limits.acceleration_mm_s2, recent) * per_ramp_s,
            per_ramp_s,
            aimed_mm: AIMED_MM_PER_MM_S2 * junction.braking_mm_s2(limits),
            limits: *limits,
            junction,
            remaining_mm,
        }
    }

    /// The acceleration of the next sample, mm/s²: the greatest of a safe motion. None if less is left, of one block or
    /// several, than braking aims to leave.
    fn next_acceleration(&mut self, path: &SampleLimits, stops: bool) -> Option<f32> {
        let (limits, speed, before) = (&path.limits, self.speed_mm_s, self.acceleration_mm_s2);
        let jerk = path.jerk_mm_s3;
        let change = jerk * SAMPLE_S;
        let braking = path.junction.braking_mm_s2(limits);
        let hardest_end = approach(-speed, math::min(jerk, braking * path.per_ramp_s));
        let lowest = math::max(
            before - JERK_TOLERANCE * change,
            -BRAKING_TOLERANCE * braking,
        );
        let lowest = math::min(math::max(lowest, hardest_end), before + change);
        let is_overspeed = self.is_overspeed && speed > 0.0;
        let (difference, ending) = if stops || is_overspeed {
            (-speed, path.ending_jerk_mm_s3())
        } else {
            (limits.speed_mm_s - speed, jerk)
        };
        let evenly = approach(difference, ending);
        let most = math::min(before + change, limits.acceleration_mm_s2);
        let (wanted, least) = if is_overspeed {
            (lowest, evenly)
        } else {
            (math::min(most, evenly), lowest)
        };
        let state = PathState {
            speed_mm_s: speed,
            acceleration_mm_s2: before,
            remaining_mm: path.remaining_mm,
        };
        let wanted = path.junction.lowered_for_next(wanted, &state, jerk);
        let wanted = math::max(wanted, least);
        let ahead = &path.ahead;
        let after = |acceleration| Self::state_after(speed, path, acceleration);
        let (slack, nearest) = ahead.least_slack_mm(&after(wanted));
        if slack >= 0.0 && !is_overspeed {
            self.is_overspeed = false;
            return Some(wanted);
        }
        if speed <= 0.0 {
            return stops.then_some(0.0);
        }
        let least = ahead.slack_mm(nearest, &after(lowest));
        self.is_overspeed = least < -OVERSPEED_MM;
        if is_overspeed {
            return Some(wanted);
        }
        if least <= 0.0 {
            return Some(lowest);
        }
        let share = math::min(least / (least - slack), MOST_SHARE);
        let tried = lowest + share * (wanted - lowest);
        let is_safe = ahead.least_slack_mm(&after(tried)).0 >= 0.0;
        Some(if is_safe { tried } else { lowest })
    }

    /// Where the mean of the next sample and the one before it is at its end, with an acceleration in the next.
    fn state_after(speed_mm_s: f32, path: &SampleLimits, acceleration_mm_s2: f32) -> PathState {
        let gain = acceleration_mm_s2 * SAMPLE_S;
        let passed_mm = (0.5 * speed_mm_s + (1.0 / 6.0) * gain) * SAMPLE_S;
        PathState {
            speed_mm_s: speed_mm_s + 0.5 * gain,
            acceleration_mm_s2,
            remaining_mm: path.remaining_mm - passed_mm - path.aimed_mm,
        }
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
        let change = path.jerk_mm_s3 * SAMPLE_S;
        let hardest = -path.junction.braking_mm_s2(&path.limits);
        let lowest = math::max(self.acceleration_mm_s2 - change, hardest);
        let tolerance_mm = SLACK_TOLERANCE_MM + SLACK_TOLERANCE_S * self.speed_mm_s;
        let state = Self::state_after(self.speed_mm_s, &path, lowest);
        path.ahead.least_slack_mm(&state).0 < -tolerance_mm
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

    /// Begins the oldest block, or the next one from a standstill; returns whether there is one.
    fn start_block(&mut self, blocks: &impl BlocksAhead, is_standstill: bool) -> bool {
        let number = self.number + usize::from(self.is_begun);
        let may_begin = is_standstill || !self.is_begun;
        let Some(next) = blocks.limits(number).filter(|_| may_begin) else {
            return false;
        };
        self.number = number;
        self.enter(&next);
        self.remaining = self.remaining.saturating_sub(LENGTH_RESERVE_UNITS);
        true
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
/// with that of the next sample included, the root of a²/(2j) + a·t/2 = Δv.
fn approach(difference_mm_s: f32, jerk_mm_s3: f32) -> f32 {
    let half_s = 0.5 * SAMPLE_S;
    let square = half_s * half_s + 2.0 * difference_mm_s.abs() / jerk_mm_s3;
    (jerk_mm_s3 * (math::sqrt(square) - half_s)).copysign(difference_mm_s)
}
