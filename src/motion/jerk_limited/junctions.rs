//! Junction limits: how fast a junction of two blocks may be passed with limits of jerk.
//!
//! A *target* is a speed at a distance ahead: a corner, or the end of the path. A motion is *safe* for a target if the
//! hardest braking reaches its speed within that distance, and ends there without an acceleration:
//!
//! ```text
//!  speed ──╮                       acceleration ──╮             ╭── 0
//!           ╲                                      ╲           ╱
//!            ╰── of the target                      ╰─────────╯
//! ```
//!
//! A motion that is safe for all targets ahead stays so under the hardest braking. A junction keeps few of them: a target
//! is left out if whoever is safe for another one passes the target more slowly.
//!
//! The acceleration that a block allows is there after the *ramp time*, the same for all blocks: the jerk is the one
//! divided by the other.

use core::hint::black_box;

use crate::{
    math,
    model::timing::SAMPLE_S,
    motion::limits::{MIN_DIVISOR_MM_S, NO_ACCELERATION_LIMIT_MM_S2, NO_SPEED_LIMIT_MM_S},
    path::Block,
};

/// Targets that a junction keeps. More of them at once, which closer corners at falling speeds need, make the
/// nearest one slower.
const TARGETS: usize = 2;
/// Targets of a sample: the nearest junction, and the targets of the next junction.
pub const TARGETS_AHEAD: usize = TARGETS + 1;
/// A distance that is never too short, mm.
const NO_DISTANCE_LIMIT_MM: f32 = 1.0e9;
/// Factor by which the greatest speed of a motion may exceed that of a target without being above it.
const SPEED_TOLERANCE: f32 = 1.0005;
/// Part of the distance travelled in the ramp time in which the accelerations of blocks count as the next block's: on the way
/// an acceleration becomes lower by that part.
const NEAR_PART: f32 = 0.3;
/// Part of the distance that a lower speed saves behind a target: accelerations there differ by a factor of √2 where
/// the direction changes.
const SAVED_PART: f32 = 0.6875;
/// Samples in addition to those in which an acceleration becomes lower: a sample, its end, and rounding.
const LOWERING_SAMPLES: f32 = 2.5;
/// Distance that braking aims to leave, for an acceleration of 1 mm/s², mm: the cost of an acceleration that comes to
/// its limit within a sample, t²/8.
pub(super) const AIMED_MM_PER_MM_S2: f32 = 0.125 * SAMPLE_S * SAMPLE_S;
/// Samples behind a junction in which jerk may still be as before the junction: a sample passes it, and the averaging
/// window follows.
const LATE_SAMPLES: f32 = 3.0;
/// Ratio of the accelerations before and behind a junction up to which they are told apart, as where an arc ends. Lines
/// that turn have 1/√2 at least: a safe motion has to stay safe when another block comes.
const LATE_RATIO: f32 = 0.5;
/// Steps of Newton's method for [`Braking::speed_before_mm_s`].
const CUBIC_STEPS: u32 = 3;

/// The limits of a block.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct BlockLimits {
    /// Length, mm.
    pub(in crate::motion) length_mm: f32,
    /// Greatest speed, mm/s.
    pub(in crate::motion) speed_mm_s: f32,
    /// Greatest acceleration along it, mm/s².
    pub(in crate::motion) acceleration_mm_s2: f32,
}

impl BlockLimits {
    /// The limits of a block.
    pub(in crate::motion) const fn of(block: &Block) -> Self {
        Self {
            length_mm: block.length_mm,
            speed_mm_s: block.nominal_mm_s,
            acceleration_mm_s2: block.acceleration_mm_s2,
        }
    }
}

/// Braking with an acceleration that is there after the ramp time.
#[derive(Debug, Clone, Copy)]
struct Braking {
    acceleration_mm_s2: f32,
    /// The inverse of the acceleration, s²/mm.
    per_mm_s2: f32,
    ramp_s: f32,
}

impl Braking {
    fn new(acceleration_mm_s2: f32, ramp_s: f32) -> Self {
        Self {
            acceleration_mm_s2,
            per_mm_s2: 1.0 / acceleration_mm_s2,
            ramp_s,
        }
    }

    /// The inverse of the jerk, s³/mm.
    fn per_mm_s3(&self) -> f32 {
        self.ramp_s * self.per_mm_s2
    }

    /// Returns the distance between two speeds, without an acceleration at both, mm.
    fn distance_mm(&self, from_mm_s: f32, to_mm_s: f32) -> f32 {
        if from_mm_s <= to_mm_s {
            0.0
        } else {
            self.longer_mm(from_mm_s, to_mm_s)
        }
    }

    /// Returns the same where the first speed is not the lower one, mm.
    #[inline]
    fn longer_mm(&self, from_mm_s: f32, to_mm_s: f32) -> f32 {
        let change_s = (from_mm_s - to_mm_s) * self.per_mm_s2;
        let half_ramp_s = 0.5 * self.ramp_s;
        let half_s = if change_s <= self.ramp_s {
            2.0 * math::half_root_of_twice(change_s * half_ramp_s)
        } else {
            0.5 * change_s + half_ramp_s
        };
        (from_mm_s + to_mm_s) * half_s
    }

    /// Returns the same for a motion that brakes as hard as is possible already, mm.
    fn shortest_mm(&self, from_mm_s: f32, to_mm_s: f32) -> f32 {
        let change = from_mm_s - to_mm_s;
        let ended_mm_s = 0.5 * self.acceleration_mm_s2 * self.ramp_s;
        if change <= 0.0 {
            0.0
        } else if change <= ended_mm_s {
            let seconds = math::sqrt(2.0 * change * self.ramp_s * self.per_mm_s2);
            seconds * (to_mm_s + (1.0 / 3.0) * change)
        } else {
            let reached = to_mm_s + ended_mm_s;
            self.ramp_s * (to_mm_s + (1.0 / 3.0) * ended_mm_s)
                + 0.5 * (from_mm_s * from_mm_s - reached * reached) * self.per_mm_s2
        }
    }

    /// Returns a speed at a distance before another one, without an acceleration at both, mm/s: the greatest, or
    /// slightly less.
    ///
    /// With both ramps in full, the root of v² + aTv = (w - aT/2)² - (aT/2)² + 2as; without, v = w + jx² with the root x
    /// of jx³ + 2wx = s. Newton's method comes from above, and a last step to below the root.
    fn speed_before_mm_s(&self, to_mm_s: f32, distance_mm: f32) -> f32 {
        let half = 0.5 * self.acceleration_mm_s2 * self.ramp_s;
        let rest = to_mm_s - half;
        let speed = math::sqrt(rest * rest + 2.0 * self.acceleration_mm_s2 * distance_mm) - half;
        if speed >= to_mm_s + 2.0 * half {
            return speed;
        }
        let jerk = self.acceleration_mm_s2 / self.ramp_s;
        let double = 2.0 * to_mm_s;
        let mut x = math::min(
            self.ramp_s,
            distance_mm / math::max(double, MIN_DIVISOR_MM_S),
        );
        for _ in 0..CUBIC_STEPS {
            let cube = jerk * x * x;
            x = (2.0 * cube * x + distance_mm) / math::max(3.0 * cube + double, MIN_DIVISOR_MM_S);
        }
        let x = distance_mm / math::max(double + jerk * x * x, MIN_DIVISOR_MM_S);
        to_mm_s + jerk * x * x
    }

    /// Returns how much longer the braking distance is at least for a higher speed before, for each mm/s, s: to whatever
    /// speed.
    fn distance_per_speed_s(&self, speed_mm_s: f32) -> f32 {
        let seconds = speed_mm_s * self.per_mm_s2;
        SAVED_PART * (seconds + math::min(0.5 * self.ramp_s, 2.0 * seconds))
    }
}

/// A speed that must not be exceeded at a distance behind a junction.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SpeedTarget {
    speed_mm_s: f32,
    distance_mm: f32,
    /// Distance behind the target in which an acceleration may end, of a motion that comes to the target's speed then:
    /// targets that were left out need the remainder.
    room_mm: f32,
}

impl SpeedTarget {
    const NONE: Self = Self {
        speed_mm_s: NO_SPEED_LIMIT_MM_S,
        distance_mm: 0.0,
        room_mm: NO_DISTANCE_LIMIT_MM,
    };

    fn is_none(&self) -> bool {
        self.speed_mm_s >= NO_SPEED_LIMIT_MM_S
    }

    /// Whether whoever is safe for this target, at a junction, is so for another target ahead; the room is the distance
    /// left then.
    fn covers(&mut self, other: &Self, braking: &Braking) -> bool {
        let needed_mm = braking.distance_mm(self.speed_mm_s, other.speed_mm_s);
        let covers = needed_mm <= other.distance_mm;
        if covers {
            let faster = other.speed_mm_s - self.speed_mm_s;
            let room_mm = if faster < 0.0 {
                other.distance_mm - needed_mm
            } else {
                let saved_s = braking.distance_per_speed_s(self.speed_mm_s);
                other.distance_mm + other.room_mm + faster * saved_s
            };
            self.room_mm = math::min(self.room_mm, room_mm);
        }
        covers
    }

    /// Makes this target, at a junction, slow enough for another one ahead to be left out.
    fn slow_down_for(&mut self, other: &Self, braking: &Braking) {
        let slow = braking.speed_before_mm_s(other.speed_mm_s, other.distance_mm);
        self.speed_mm_s = math::min(self.speed_mm_s, slow);
        self.room_mm = 0.0;
    }
}

/// How fast and where a motion along the path is when a sample begins.
#[derive(Debug, Clone, Copy)]
pub(super) struct SampleStart {
    pub(super) speed_mm_s: f32,
    /// Distance to the end of the block.
    pub(super) remaining_mm: f32,
}

/// The targets ahead of a sample, and the braking for them.
#[derive(Debug, Clone, Copy)]
pub(super) struct TargetsAhead {
    targets: [SpeedTarget; TARGETS_AHEAD],
    braking: Braking,
    /// The inverse of the jerk that ends an acceleration behind a target, s³/mm.
    rising_per_mm_s3: f32,
    /// The speed when the sample begins.
    speed_mm_s: f32,
    /// Distance to the end of the block after a sample at that speed, less what braking aims to leave.
    steady_mm: f32,
}

impl TargetsAhead {
    /// Targets in a block that ends at a junction, and in the next block with the junction at its end if the sample may
    /// come there.
    #[inline]
    pub(super) fn new(
        limits: &BlockLimits,
        junction: &JunctionLimit,
        next: Option<(BlockLimits, &JunctionLimit)>,
        ramp_s: f32,
        start: SampleStart,
    ) -> Self {
        let [nearest, second] = junction.targets;
        let mut targets = [nearest, second, SpeedTarget::NONE];
        let mut braking_mm_s2 = junction.braking_mm_s2(limits);
        let mut beyond_mm_s2 = junction.beyond.mm_s2();
        let aimed_mm = AIMED_MM_PER_MM_S2 * braking_mm_s2;
        if let Some((next, junction)) = next {
            // The nearest target is the junction, or one of these.
            let [_, farther @ ..] = &mut targets;
            for (target, at_end) in farther.iter_mut().zip(&junction.targets) {
                *target = SpeedTarget {
                    distance_mm: at_end.distance_mm + next.length_mm,
                    ..*at_end
                };
            }
            // From the end of an arc on, braking is much harder.
            let there_mm_s2 = junction.braking_mm_s2(&next);
            if braking_mm_s2 >= LATE_RATIO * there_mm_s2 {
                braking_mm_s2 = math::min(braking_mm_s2, there_mm_s2);
            } else {
                braking_mm_s2 = there_mm_s2;
            }
            beyond_mm_s2 = math::min(beyond_mm_s2, junction.beyond.mm_s2());
        }
        Self {
            targets,
            braking: Braking::new(braking_mm_s2, ramp_s),
            rising_per_mm_s3: ramp_s / math::min(braking_mm_s2, beyond_mm_s2),
            speed_mm_s: start.speed_mm_s,
            steady_mm: start.remaining_mm - (0.5 * SAMPLE_S) * start.speed_mm_s - aimed_mm,
        }
    }

    /// Returns by how much the distance to a target exceeds the braking distance at least after a sample of an
    /// acceleration, mm, and the number of the target: below 0 for a motion that is not safe.
    #[inline(never)]
    pub(super) fn least_slack_mm(&self, acceleration_mm_s2: f32) -> (f32, usize) {
        let motion = BrakingMotion::new(self, acceleration_mm_s2);
        let (mut least, mut nearest) = (NO_DISTANCE_LIMIT_MM, 0);
        let mut number = 0;
        // wcet-bound: TARGETS_AHEAD: each run is for a target
        while let Some(target) = self.targets.get(number) {
            let slack_mm = motion.slack_mm(target);
            if slack_mm < least {
                (least, nearest) = (slack_mm, number);
            }
            // Unrolled, the loop takes more lines of flash, and more time in the worst case.
            number = black_box(number + 1);
        }
        (least, nearest)
    }

    /// Returns the same for a target, mm.
    #[inline(never)]
    pub(super) fn slack_mm(&self, number: usize, acceleration_mm_s2: f32) -> f32 {
        let motion = BrakingMotion::new(self, acceleration_mm_s2);
        let target = self.targets.get(number);
        target.map_or(NO_DISTANCE_LIMIT_MM, |target| motion.slack_mm(target))
    }
}

/// A motion along the path that brakes as hard as is possible: the mean of a sample and the one before, at its end.
struct BrakingMotion {
    speed_mm_s: f32,
    acceleration_mm_s2: f32,
    remaining_mm: f32,
    braking: Braking,
    rising_per_mm_s3: f32,
    /// The speed at which its acceleration is 0, and the distance to there: behind it for a motion that brakes.
    reached_mm_s: f32,
    begun_mm: f32,
    /// The least speed of the targets that it passes below their speed.
    passed_mm_s: f32,
}

impl BrakingMotion {
    #[inline]
    fn new(ahead: &TargetsAhead, acceleration_mm_s2: f32) -> Self {
        let speed = ahead.speed_mm_s + (0.5 * SAMPLE_S) * acceleration_mm_s2;
        let passed_mm = (SAMPLE_S * SAMPLE_S / 6.0) * acceleration_mm_s2;
        let (begun_mm, rise) = ended(speed, acceleration_mm_s2, ahead.braking.per_mm_s3());
        let passed_mm_s = if acceleration_mm_s2 < 0.0 {
            speed - rise
        } else {
            let half = 0.5 * acceleration_mm_s2 * acceleration_mm_s2;
            (speed + half * ahead.rising_per_mm_s3) * (1.0 / SPEED_TOLERANCE)
        };
        Self {
            speed_mm_s: speed,
            acceleration_mm_s2,
            remaining_mm: ahead.steady_mm - passed_mm,
            braking: ahead.braking,
            rising_per_mm_s3: ahead.rising_per_mm_s3,
            reached_mm_s: speed + rise,
            begun_mm,
            passed_mm_s,
        }
    }

    #[inline]
    fn slack_mm(&self, target: &SpeedTarget) -> f32 {
        let there_mm = self.remaining_mm + target.distance_mm;
        if target.speed_mm_s < self.passed_mm_s {
            let braking_mm = (self.braking).longer_mm(self.reached_mm_s, target.speed_mm_s);
            return there_mm - (self.begun_mm + braking_mm);
        }
        let needed_mm = if self.acceleration_mm_s2 < 0.0 {
            self.needed_in_braking_mm(target)
        } else {
            self.needed_after_rise_mm(target)
        };
        if needed_mm > 0.0 || target.speed_mm_s <= 0.0 {
            there_mm - needed_mm
        } else {
            NO_DISTANCE_LIMIT_MM
        }
    }

    /// Distance needed until its speed is a target's, while it brakes as it does, mm.
    #[inline]
    fn needed_in_braking_mm(&self, target: &SpeedTarget) -> f32 {
        let (from, to) = (self.speed_mm_s, target.speed_mm_s);
        let double = math::max(-2.0 * self.acceleration_mm_s2, MIN_DIVISOR_MM_S);
        (from * (1.0 / SPEED_TOLERANCE) - to) * (from + to) / double
    }

    /// Distance needed until its acceleration has ended, mm: faster targets need less.
    #[inline]
    fn needed_after_rise_mm(&self, target: &SpeedTarget) -> f32 {
        let (risen_mm, rise) = ended(
            self.speed_mm_s,
            self.acceleration_mm_s2,
            self.rising_per_mm_s3,
        );
        let risen = self.speed_mm_s + rise;
        let per_speed_s = self.braking.distance_per_speed_s(risen);
        (risen - target.speed_mm_s) * per_speed_s + (risen_mm - target.room_mm)
    }
}

/// Returns how far a motion comes until its acceleration has ended, mm, and how much faster it is then, mm/s. Both for
/// the time before, and the distance negative, with an acceleration below 0.
#[inline]
fn ended(speed_mm_s: f32, acceleration_mm_s2: f32, per_mm_s3: f32) -> (f32, f32) {
    let seconds = acceleration_mm_s2 * per_mm_s3;
    let rise = 0.5 * acceleration_mm_s2 * seconds;
    (seconds * (speed_mm_s + (2.0 / 3.0) * rise), rise)
}

/// Returns how late braking comes behind a junction, s, from the ratio of the accelerations before and behind it.
fn late_s(ratio: f32) -> f32 {
    if ratio < LATE_RATIO {
        (1.0 - ratio) * (LATE_SAMPLES * SAMPLE_S)
    } else {
        0.0
    }
}

/// What a junction keeps of its own speed and the targets ahead, the nearest first.
struct KeptTargets {
    /// The junction itself.
    corner: SpeedTarget,
    farther: [SpeedTarget; TARGETS],
    count: usize,
    /// Time by which braking behind the junction comes late, s.
    late_s: f32,
    /// Whoever is safe for a farther target passes the junction below its speed.
    is_passed_slower: bool,
}

impl KeptTargets {
    /// Adds a target if it counts beside the junction.
    #[inline(never)]
    fn add(&mut self, target: &SpeedTarget, braking: &Braking) {
        if !self.is_passed_slower {
            if self.corner.covers(target, braking) {
                self.brake_in_time(target, braking);
                return;
            }
            let shortest_mm = braking.shortest_mm(self.corner.speed_mm_s, target.speed_mm_s);
            self.is_passed_slower = shortest_mm >= target.distance_mm;
        }
        if let Some(entry) = self.farther.get_mut(self.count) {
            *entry = *target;
        }
        self.count += 1;
    }

    /// Makes the junction slow enough for a slower target that it covers, if braking comes late.
    fn brake_in_time(&mut self, target: &SpeedTarget, braking: &Braking) {
        let late_mm = self.late_s * self.corner.speed_mm_s;
        let in_time = SpeedTarget {
            distance_mm: math::max(target.distance_mm - late_mm, 0.0),
            ..*target
        };
        let needed_mm = braking.distance_mm(self.corner.speed_mm_s, target.speed_mm_s);
        if needed_mm > in_time.distance_mm {
            self.corner.slow_down_for(&in_time, braking);
        }
    }

    /// As many as there is space for.
    fn targets(&self, braking: &Braking) -> [SpeedTarget; TARGETS] {
        let [first, second] = self.farther;
        let mut corner = self.corner;
        if self.is_passed_slower {
            self.farther
        } else if self.count < TARGETS {
            [corner, first]
        } else {
            corner.slow_down_for(&first, braking);
            [corner, second]
        }
    }
}

/// The running minimum of the accelerations of blocks, over one to two distances.
///
/// Two minima, of which each covers the distance at least, instead of the accelerations.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RunningMin {
    before: f32,
    now: f32,
    passed_mm: f32,
}

impl RunningMin {
    const NONE: Self = Self {
        before: NO_ACCELERATION_LIMIT_MM_S2,
        now: NO_ACCELERATION_LIMIT_MM_S2,
        passed_mm: 0.0,
    };

    fn mm_s2(&self) -> f32 {
        math::min(self.before, self.now)
    }

    /// The running minimum with another block.
    fn with(&self, limits: &BlockLimits, distance_mm: f32) -> Self {
        let passed_mm = self.passed_mm + limits.length_mm;
        let here = limits.acceleration_mm_s2;
        if limits.length_mm > distance_mm {
            return Self {
                before: here,
                now: here,
                passed_mm: 0.0,
            };
        }
        if passed_mm > distance_mm {
            return Self {
                before: math::min(self.now, here),
                now: here,
                passed_mm: 0.0,
            };
        }
        Self {
            before: self.before,
            now: math::min(self.now, here),
            passed_mm,
        }
    }
}

/// The acceleration of a block, and the distance from a junction to it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LowAcceleration {
    mm_s2: f32,
    distance_mm: f32,
}

impl LowAcceleration {
    const NONE: Self = Self {
        mm_s2: NO_ACCELERATION_LIMIT_MM_S2,
        distance_mm: 0.0,
    };

    /// The lowest acceleration with another block before it, within a distance.
    fn before(self, limits: &BlockLimits, within_mm: f32) -> Self {
        let distance_mm = self.distance_mm + limits.length_mm;
        if self.mm_s2 < limits.acceleration_mm_s2 && distance_mm < within_mm {
            Self {
                distance_mm,
                ..self
            }
        } else {
            Self {
                mm_s2: limits.acceleration_mm_s2,
                distance_mm: 0.0,
            }
        }
    }
}

/// What limits the motion before a junction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::motion) struct JunctionLimit {
    /// The nearest first: the farther, the slower.
    targets: [SpeedTarget; TARGETS],
    /// Least acceleration of the blocks up to the farthest target.
    acceleration_mm_s2: f32,
    /// Accelerations of the nearest blocks behind the junction, and of those in which an acceleration ends.
    near: RunningMin,
    beyond: RunningMin,
    /// The lowest acceleration behind it that may have to be come down to.
    lowest: LowAcceleration,
}

impl JunctionLimit {
    /// The end of the path, or a junction that is passed at a standstill.
    pub(in crate::motion) const STOP: Self = Self {
        targets: [
            SpeedTarget {
                speed_mm_s: 0.0,
                ..SpeedTarget::NONE
            },
            SpeedTarget::NONE,
        ],
        acceleration_mm_s2: NO_ACCELERATION_LIMIT_MM_S2,
        near: RunningMin::NONE,
        beyond: RunningMin::NONE,
        lowest: LowAcceleration::NONE,
    };

    /// Makes it a junction that is passed at a standstill: a few words are set in place of copying all.
    pub(in crate::motion) fn stop(&mut self) {
        for target in &mut self.targets {
            target.speed_mm_s = NO_SPEED_LIMIT_MM_S;
        }
        let [nearest, ..] = &mut self.targets;
        *nearest = SpeedTarget {
            speed_mm_s: 0.0,
            ..SpeedTarget::NONE
        };
        self.acceleration_mm_s2 = NO_ACCELERATION_LIMIT_MM_S2;
        self.near = RunningMin::NONE;
        self.beyond = RunningMin::NONE;
        self.lowest = LowAcceleration::NONE;
    }

    /// Whether the junction is passed at a standstill.
    pub(in crate::motion) fn is_stop(&self) -> bool {
        let [nearest, ..] = &self.targets;
        nearest.speed_mm_s <= 0.0 && nearest.distance_mm <= 0.0
    }

    /// The junction limit at the beginning of a block that ends at this one, behind a block of an acceleration;
    /// `corner_mm_s` is the greatest speed there, 0 for a standstill.
    pub(in crate::motion) fn before(
        &self,
        limits: &BlockLimits,
        corner_mm_s: f32,
        acceleration_before_mm_s2: f32,
        ramp_s: f32,
    ) -> Self {
        if corner_mm_s <= 0.0 {
            return Self::STOP;
        }
        let braking = Braking::new(self.braking_mm_s2(limits), ramp_s);
        let mut kept = KeptTargets {
            corner: SpeedTarget {
                speed_mm_s: corner_mm_s,
                ..SpeedTarget::NONE
            },
            farther: [SpeedTarget::NONE; TARGETS],
            count: 0,
            late_s: late_s(acceleration_before_mm_s2 * braking.per_mm_s2),
            is_passed_slower: false,
        };
        for old in &self.targets {
            if !old.is_none() {
                let target = SpeedTarget {
                    distance_mm: old.distance_mm + limits.length_mm,
                    ..*old
                };
                kept.add(&target, &braking);
            }
        }
        let reach_mm = limits.speed_mm_s * ramp_s;
        Self {
            targets: kept.targets(&braking),
            acceleration_mm_s2: if kept.count == 0 {
                NO_ACCELERATION_LIMIT_MM_S2
            } else {
                braking.acceleration_mm_s2
            },
            near: self.near.with(limits, NEAR_PART * reach_mm),
            beyond: self.beyond.with(limits, reach_mm),
            lowest: self.lowest.before(limits, reach_mm),
        }
    }

    /// The acceleration of the hardest braking in a block that ends at the junction, mm/s².
    pub(super) fn braking_mm_s2(&self, limits: &BlockLimits) -> f32 {
        math::min(limits.acceleration_mm_s2, self.acceleration_mm_s2)
    }

    /// The acceleration of the blocks behind the junction in which an acceleration may end, mm/s².
    pub(super) fn ending_mm_s2(&self) -> f32 {
        self.beyond.mm_s2()
    }

    /// Returns the acceleration of the next sample, of either sign, mm/s². A wanted acceleration is lowered to the ones of
    /// the blocks behind the junction if there would be no time to lower it on the way there; from the one before by
    /// no more than the jerk changes an acceleration in a sample, which comes with its inverse.
    #[inline]
    pub(super) fn lowered_for_next(
        &self,
        wanted_mm_s2: f32,
        start: SampleStart,
        before_mm_s2: f32,
        [change_mm_s2, per_change]: [f32; 2],
    ) -> f32 {
        let size = wanted_mm_s2.abs();
        let near = LowAcceleration {
            mm_s2: self.near.mm_s2(),
            distance_mm: 0.0,
        };
        let mut lowered = size;
        for low in [near, self.lowest] {
            let excess = size - low.mm_s2;
            let seconds = (excess * per_change + LOWERING_SAMPLES) * SAMPLE_S;
            let passed_mm = (start.speed_mm_s + 0.5 * size * seconds) * seconds;
            if excess > 0.0 && start.remaining_mm + low.distance_mm < passed_mm {
                lowered = math::min(lowered, low.mm_s2);
            }
        }
        let lowest = before_mm_s2.abs() - change_mm_s2;
        math::min(math::max(lowered, lowest), size).copysign(wanted_mm_s2)
    }
}
