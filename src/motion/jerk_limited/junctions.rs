//! Junction limits: how fast a junction of two blocks may be passed with continuous acceleration.
//!
//! The limits are those of the *reference*: a motion with accelerations of -a, 0 and +a, whose mean
//! over the averaging window is the machine's. For the mean to keep a limit at a point, the reference keeps it within
//! the *influence distance* on both sides: half of the window's length at that speed. For the jerk, the reference never
//! brakes sooner than a window after it has accelerated. A sample is added to either, as the point, or the change, may
//! lie anywhere in one.

use crate::{
    math,
    model::timing::SAMPLE_S,
    motion::limits::{MIN_DIVISOR_MM_S, NO_ACCELERATION_LIMIT_MM_S2, NO_SPEED_LIMIT_MM_S},
    path::Block,
};

/// Influence distances from which a block keeps its own acceleration outside of them: the lower one of
/// its neighbours holds for all of a shorter block.
const LONG_BLOCK_INFLUENCES: f32 = 4.0;

/// The influence distance of a point that the mean passes at a speed, mm.
pub(in crate::motion) fn influence_mm(speed_mm_s: f32, window_s: f32) -> f32 {
    0.5 * (window_s + SAMPLE_S) * speed_mm_s
}

/// The limits of a block.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct BlockLimits {
    /// Length, mm.
    pub(in crate::motion) length_mm: f32,
    /// Greatest speed, mm/s.
    pub(in crate::motion) speed_mm_s: f32,
    /// Greatest acceleration along it, mm/s².
    pub(in crate::motion) acceleration_mm_s2: f32,
    /// Lower acceleration at its beginning, within the influence of blocks before it, mm/s².
    pub(in crate::motion) trail_mm_s2: f32,
    /// Distance behind its beginning for which that holds, mm.
    pub(in crate::motion) trail_mm: f32,
}

impl BlockLimits {
    /// The limits of a block by itself.
    pub(in crate::motion) const fn of(block: &Block) -> Self {
        Self {
            length_mm: block.length_mm,
            speed_mm_s: block.nominal_mm_s,
            acceleration_mm_s2: block.acceleration_mm_s2,
            trail_mm_s2: block.acceleration_mm_s2,
            trail_mm: 0.0,
        }
    }

    /// The limits behind blocks whose least acceleration holds for an influence distance.
    pub(in crate::motion) fn after(mut self, least: &RunningMin, influence_mm: f32) -> Self {
        let low = least.mm_s2();
        if low < self.acceleration_mm_s2 {
            if self.length_mm < LONG_BLOCK_INFLUENCES * influence_mm {
                self.acceleration_mm_s2 = low;
            } else {
                self.trail_mm_s2 = math::min(self.trail_mm_s2, low);
                self.trail_mm = math::max(self.trail_mm, influence_mm);
            }
        }
        self
    }

    /// The acceleration at a distance before its end, mm/s².
    pub(in crate::motion) fn acceleration(&self, distance_mm: f32) -> f32 {
        if distance_mm > self.length_mm - self.trail_mm {
            math::min(self.acceleration_mm_s2, self.trail_mm_s2)
        } else {
            self.acceleration_mm_s2
        }
    }

    /// The part of a distance before its end in which its own acceleration holds, mm.
    fn beyond_trail_mm(&self, distance_mm: f32) -> f32 {
        math::min(distance_mm, self.length_mm - self.trail_mm)
    }
}

/// The running minimum of the accelerations of blocks, over one to two influence distances.
///
/// Two minima, of which each covers the distance at least, instead of the accelerations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::motion) struct RunningMin {
    before: f32,
    now: f32,
    passed_mm: f32,
}

impl RunningMin {
    pub(in crate::motion) const NONE: Self = Self {
        before: NO_ACCELERATION_LIMIT_MM_S2,
        now: NO_ACCELERATION_LIMIT_MM_S2,
        passed_mm: 0.0,
    };

    pub(in crate::motion) fn mm_s2(&self) -> f32 {
        math::min(self.before, self.now)
    }

    /// The running minimum after a block.
    pub(in crate::motion) fn after(&self, limits: &BlockLimits, influence_mm: f32) -> Self {
        let passed_mm = self.passed_mm + limits.length_mm;
        let here = limits.acceleration_mm_s2;
        if limits.length_mm > influence_mm {
            return Self {
                before: here,
                now: here,
                passed_mm: 0.0,
            };
        }
        if passed_mm > influence_mm {
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

/// The limits of the reference before a junction, from there backwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::motion) struct JunctionLimit {
    /// Greatest speed there, mm/s.
    brake_mm_s: f32,
    /// Distance before the junction in which that does not change, mm.
    brake_flat_mm: f32,
    /// Greatest speed there of a reference that has just accelerated, mm/s.
    free_mm_s: f32,
    /// Distance before the junction in which that does not change, mm.
    free_flat_mm: f32,
    /// A greater speed that is not exceeded within `cap_mm` before, mm/s; the reference may brake down to it there.
    cap_mm_s: f32,
    /// Distance before the junction in which `cap_mm_s` holds, mm.
    cap_mm: f32,
    /// Accelerations behind the junction.
    beyond: RunningMin,
    /// Influence distance before the junction, in which those hold too, mm.
    influence_mm: f32,
    /// Accelerations with which the reference brakes behind the junction.
    braking: RunningMin,
}

/// The motion in the block before a junction.
#[derive(Debug, Clone, Copy)]
struct IncomingMotion {
    /// Acceleration of the reference, mm/s².
    acceleration_mm_s2: f32,
    /// Distance before the junction in which the speed does not change, mm.
    flat_mm: f32,
}

impl JunctionLimit {
    /// The end of the path, or a junction that is passed at a standstill.
    pub(in crate::motion) const STOP: Self = Self {
        brake_mm_s: 0.0,
        brake_flat_mm: 0.0,
        free_mm_s: 0.0,
        free_flat_mm: 0.0,
        cap_mm_s: NO_SPEED_LIMIT_MM_S,
        cap_mm: 0.0,
        beyond: RunningMin::NONE,
        influence_mm: 0.0,
        braking: RunningMin::NONE,
    };

    /// The greatest speeds at the junction, mm/s: braking, and of a reference that has just accelerated.
    pub(in crate::motion) fn speeds_at_junction(&self) -> [f32; 2] {
        [self.brake_mm_s, self.free_mm_s]
    }

    /// Whether the junction is passed at a standstill.
    pub(in crate::motion) fn is_stop(&self) -> bool {
        self.brake_mm_s <= 0.0
    }

    /// The junction limit at the beginning of a block that ends at this one; `corner_mm_s` is the
    /// greatest speed there, 0 for a standstill, and `influence_mm` its influence distance.
    pub(in crate::motion) fn before(
        &self,
        limits: &BlockLimits,
        corner_mm_s: f32,
        influence_mm: f32,
        window_s: f32,
    ) -> Self {
        if corner_mm_s <= 0.0 {
            return Self::STOP;
        }
        let gap_s = window_s + SAMPLE_S;
        let incoming = self.incoming_motion(limits);
        let top = limits.speed_mm_s;
        let flat = math::max(self.brake_flat_mm, incoming.flat_mm);
        let free_flat = self.free_flat(incoming, gap_s);
        let capped = math::max(self.cap_mm, incoming.flat_mm);
        let (brake, free) = self.speeds(limits, limits.length_mm, 0.0, 0.0, window_s);
        let brake = math::min(brake, top);
        let mut junction = Self {
            brake_mm_s: brake,
            brake_flat_mm: math::max(flat - limits.length_mm, 0.0),
            free_mm_s: math::min(free, top),
            free_flat_mm: math::max(free_flat - limits.length_mm, 0.0),
            cap_mm_s: self.cap_mm_s,
            cap_mm: capped - limits.length_mm,
            beyond: self.beyond.after(limits, 2.0 * self.influence_mm),
            influence_mm,
            braking: self.braking.after(
                &BlockLimits {
                    acceleration_mm_s2: incoming.acceleration_mm_s2,
                    ..*limits
                },
                free * gap_s,
            ),
        };
        if limits.trail_mm > 0.0 {
            junction.free_flat_mm = math::max(junction.free_flat_mm, junction.free_mm_s * gap_s);
        }
        if junction.cap_mm + junction.cap_mm_s * (window_s + SAMPLE_S) < 0.0 {
            junction.cap_mm_s = NO_SPEED_LIMIT_MM_S;
            junction.cap_mm = 0.0;
        }
        junction.cap(top, incoming.acceleration_mm_s2, window_s);
        junction.cap(corner_mm_s, incoming.acceleration_mm_s2, window_s);
        junction
    }

    /// The motion in the block before the junction.
    fn incoming_motion(&self, limits: &BlockLimits) -> IncomingMotion {
        let least = self.beyond.mm_s2();
        if limits.acceleration_mm_s2 <= least {
            IncomingMotion {
                acceleration_mm_s2: limits.acceleration_mm_s2,
                flat_mm: 0.0,
            }
        } else if limits.length_mm < LONG_BLOCK_INFLUENCES * self.influence_mm {
            IncomingMotion {
                acceleration_mm_s2: least,
                flat_mm: 0.0,
            }
        } else {
            IncomingMotion {
                acceleration_mm_s2: limits.acceleration_mm_s2,
                flat_mm: self.influence_mm,
            }
        }
    }

    /// The distance before the junction in which the speed of a reference that has accelerated does not
    /// change, mm.
    fn free_flat(&self, incoming: IncomingMotion, gap_s: f32) -> f32 {
        if incoming.flat_mm > 0.0 {
            math::max(self.free_flat_mm, incoming.flat_mm + self.free_mm_s * gap_s)
        } else {
            self.free_flat_mm
        }
    }

    /// Adds a speed limit on both sides of the junction.
    #[inline]
    fn cap(&mut self, speed_mm_s: f32, acceleration_mm_s2: f32, window_s: f32) {
        let half = 0.5 / acceleration_mm_s2;
        let limit_sqr = speed_mm_s * speed_mm_s;
        let influence_mm = influence_mm(speed_mm_s, window_s);
        // The distance in which braking changes the squared speed by `sqr`.
        let braking_mm = |sqr: f32| half * sqr;
        if speed_mm_s < self.free_mm_s {
            let cap_sqr = self.cap_mm_s * self.cap_mm_s;
            let flat_mm = math::max(
                self.brake_flat_mm
                    - braking_mm(math::max(
                        self.brake_mm_s * self.brake_mm_s - limit_sqr,
                        0.0,
                    )),
                self.cap_mm - braking_mm(cap_sqr - limit_sqr),
            );
            self.brake_flat_mm = math::max(influence_mm, flat_mm);
            let faster = self.free_mm_s - speed_mm_s;
            let free_flat_mm = self.free_flat_mm
                - braking_mm(self.free_mm_s * self.free_mm_s - limit_sqr)
                - faster * window_s;
            let gap_s = window_s + SAMPLE_S;
            self.free_flat_mm = math::max(self.brake_flat_mm + speed_mm_s * gap_s, free_flat_mm);
            self.free_mm_s = speed_mm_s;
            self.brake_mm_s = math::min(self.brake_mm_s, speed_mm_s);
            self.cap_mm_s = NO_SPEED_LIMIT_MM_S;
            self.cap_mm = 0.0;
            return;
        }
        let (low, low_mm, high, high_mm) = if speed_mm_s <= self.cap_mm_s {
            (speed_mm_s, influence_mm, self.cap_mm_s, self.cap_mm)
        } else {
            (self.cap_mm_s, self.cap_mm, speed_mm_s, influence_mm)
        };
        self.cap_mm = math::max(low_mm, high_mm - braking_mm(high * high - low * low));
        self.cap_mm_s = low;
        self.brake_mm_s = math::min(self.brake_mm_s, speed_mm_s);
    }

    /// The acceleration of the reference in a block, at a distance before this junction at its end,
    /// mm/s².
    pub(in crate::motion) fn acceleration(&self, limits: &BlockLimits, distance_mm: f32) -> f32 {
        let incoming = self.incoming_motion(limits);
        let here = math::min(
            limits.acceleration(distance_mm),
            incoming.acceleration_mm_s2,
        );
        if distance_mm < incoming.flat_mm {
            math::min(here, self.beyond.mm_s2())
        } else {
            here
        }
    }

    /// Greatest speeds of the reference after a sample of `sample_s`, in a block with this junction
    /// `distance_mm` ahead: braking, and when it accelerates, mm/s.
    ///
    /// The distance until then is the mean speed times the sample's time, so that the speed v is the root of
    /// v² + (v₀ + v)·g = e² with the gain g in a sample, where e is the speed that could be reached at once.
    #[inline(never)]
    pub(in crate::motion) fn speeds(
        &self,
        limits: &BlockLimits,
        distance_mm: f32,
        speed_mm_s: f32,
        sample_s: f32,
        window_s: f32,
    ) -> (f32, f32) {
        let incoming = self.incoming_motion(limits);
        let distance_mm = limits.beyond_trail_mm(distance_mm);
        let a = incoming.acceleration_mm_s2;
        let gap_s = window_s + SAMPLE_S;
        let flat = |flat_mm: f32| math::max(flat_mm, incoming.flat_mm);
        let passed_mm = 0.5 * sample_s * speed_mm_s;
        // The lower of the speeds that two limits allow, each from a speed that is possible in any case.
        let most = |double: f32, time_s: f32, low: [f32; 2], high: [f32; 2]| {
            let half = 0.5 * double * (time_s + 0.5 * sample_s);
            let room = |[speed, distance_mm]: [f32; 2]| {
                let begun = speed * (speed + double * time_s);
                let grown = begun + double * (distance_mm - passed_mm);
                math::max(grown, speed * (speed + 2.0 * half))
            };
            let room = math::min(room(low), room(high));
            room / math::max(half + math::sqrt(half * half + room), MIN_DIVISOR_MM_S)
        };
        let low = [self.brake_mm_s, distance_mm - flat(self.brake_flat_mm)];
        let high = [self.cap_mm_s, distance_mm - flat(self.cap_mm)];
        let brake = most(2.0 * a, 0.0, low, high);
        // Cruising ends before the junction, ...
        let ends_here = math::max(distance_mm - passed_mm, 0.0) / (gap_s + 0.5 * sample_s);
        let within = math::min(
            low[0] * low[0] + 2.0 * a * (low[1] - passed_mm),
            high[0] * high[0] + 2.0 * a * (high[1] - passed_mm),
        );
        let half = a * (gap_s + 0.5 * sample_s);
        let within = math::max(within, 0.0);
        let within = within / math::max(half + math::sqrt(half * half + within), MIN_DIVISOR_MM_S);
        let here = math::min(within, ends_here);
        // ... or behind it.
        let double = 2.0 * math::min(a, self.braking.mm_s2());
        let low = [
            self.free_mm_s,
            distance_mm - self.free_flat(incoming, gap_s),
        ];
        let far_mm = flat(self.cap_mm) + self.cap_mm_s * gap_s;
        let there = most(double, gap_s, low, [self.cap_mm_s, distance_mm - far_mm]);
        (brake, math::min(math::max(here, there), brake))
    }
}
