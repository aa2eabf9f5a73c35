//! How fast a place between two blocks may be passed when acceleration has to be continuous.
//!
//! What is planned here is the *reference*: a motion with accelerations of -a, 0 and +a, whose mean
//! over the last `window` is what the machine does. For that mean to keep a limit in one place, the
//! reference keeps it on both sides of the place for half of the way that the window takes at that
//! speed; for its jerk, it never brakes sooner than a window after it has accelerated.

use crate::{
    math,
    model::timing::SAMPLE_S,
    motion::limits::{MIN_DIVISOR_MM_S, NO_ACCELERATION_LIMIT_MM_S2, NO_SPEED_LIMIT_MM_S},
};

/// A block that is that many times as long as the place around its end is more than a part of it.
const LONG_BLOCK_INFLUENCES: f32 = 4.0;

/// How far before a place, and behind it, what holds for a mean that passes it at a speed does, mm.
pub(in crate::motion) fn influence_mm(speed_mm_s: f32, window_s: f32) -> f32 {
    0.5 * (window_s + SAMPLE_S) * speed_mm_s
}

/// What of a block matters to the reference.
#[derive(Debug, Clone, Copy)]
pub(in crate::motion) struct BlockLimits {
    /// Length, mm.
    pub(in crate::motion) length_mm: f32,
    /// Greatest speed, mm/s.
    pub(in crate::motion) speed_mm_s: f32,
    /// Greatest acceleration along it, mm/s².
    pub(in crate::motion) acceleration_mm_s2: f32,
    /// Where it begins, blocks before still have their say: a lower acceleration, mm/s², and how far, mm.
    pub(in crate::motion) trail_mm_s2: f32,
    pub(in crate::motion) trail_mm: f32,
}

impl BlockLimits {
    /// A leg behind another, of which the least acceleration is known that still counts for a way.
    pub(in crate::motion) fn behind(mut self, least: &RunningMin, reach_mm: f32) -> Self {
        let low = least.mm_s2();
        if low < self.acceleration_mm_s2 {
            if self.length_mm < LONG_BLOCK_INFLUENCES * reach_mm {
                self.acceleration_mm_s2 = low;
            } else {
                self.trail_mm_s2 = math::min(self.trail_mm_s2, low);
                self.trail_mm = math::max(self.trail_mm, reach_mm);
            }
        }
        self
    }

    /// Its acceleration so far before its end, mm/s².
    pub(in crate::motion) fn acceleration(&self, way_mm: f32) -> f32 {
        if way_mm > self.length_mm - self.trail_mm {
            math::min(self.acceleration_mm_s2, self.trail_mm_s2)
        } else {
            self.acceleration_mm_s2
        }
    }

    /// The part of a way before its end in which its own acceleration counts, mm.
    fn beyond_trail_mm(&self, way_mm: f32) -> f32 {
        math::min(way_mm, self.length_mm - self.trail_mm)
    }
}

/// The least acceleration of the blocks passed within a way, or within twice that way.
///
/// Two at a time, each for at least the way: so that none has to be remembered longer.
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

    /// After a block with an acceleration.
    pub(in crate::motion) fn after(&self, leg: &BlockLimits, reach_mm: f32) -> Self {
        let passed_mm = self.passed_mm + leg.length_mm;
        let here = leg.acceleration_mm_s2;
        if leg.length_mm > reach_mm {
            return Self {
                before: here,
                now: here,
                passed_mm: 0.0,
            };
        }
        if passed_mm > reach_mm {
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

/// The reference's speeds before a place, seen from there backwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::motion) struct JunctionLimit {
    /// Greatest speed there, mm/s, and for how far before it does not change, mm.
    brake_mm_s: f32,
    brake_flat_mm: f32,
    /// Greatest speed there of a reference that has just accelerated, mm/s; the same.
    free_mm_s: f32,
    free_flat_mm: f32,
    /// A greater speed that is not exceeded for that far before, mm/s and mm; then it may brake to it.
    cap_mm_s: f32,
    cap_mm: f32,
    /// Accelerations behind the place, and for how far before it they hold too, mm.
    behind: RunningMin,
    reach_mm: f32,
    /// Accelerations with which the reference brakes behind the place.
    braking: RunningMin,
}

/// How a distance before a gate is gone through.
#[derive(Debug, Clone, Copy)]
struct Approach {
    acceleration_mm_s2: f32,
    /// Before the gate the speed does not change for that far, mm.
    flat_mm: f32,
}

impl JunctionLimit {
    /// The end of what is known, or a place that is passed at rest.
    pub(in crate::motion) const STOP: Self = Self {
        brake_mm_s: 0.0,
        brake_flat_mm: 0.0,
        free_mm_s: 0.0,
        free_flat_mm: 0.0,
        cap_mm_s: NO_SPEED_LIMIT_MM_S,
        cap_mm: 0.0,
        behind: RunningMin::NONE,
        reach_mm: 0.0,
        braking: RunningMin::NONE,
    };

    /// The greatest speeds in the place itself: braking, and of a reference that has just accelerated,
    /// mm/s.
    pub(in crate::motion) fn speeds_at_junction(&self) -> [f32; 2] {
        [self.brake_mm_s, self.free_mm_s]
    }

    /// Whether it has to be passed at rest.
    pub(in crate::motion) fn is_stop(&self) -> bool {
        self.brake_mm_s <= 0.0
    }

    /// The gate at the beginning of a leg of which this is the end; `corner_mm_s` is the greatest speed
    /// there, 0 for rest, and `reach_mm` how far before it accelerations behind it hold.
    pub(in crate::motion) fn before(
        &self,
        leg: &BlockLimits,
        corner_mm_s: f32,
        reach_mm: f32,
        window_s: f32,
    ) -> Self {
        if corner_mm_s <= 0.0 {
            return Self::STOP;
        }
        let gap_s = window_s + SAMPLE_S;
        let approach = self.approach(leg);
        let top = leg.speed_mm_s;
        let flat = math::max(self.brake_flat_mm, approach.flat_mm);
        let free_flat = self.free_flat(approach, gap_s);
        let capped = math::max(self.cap_mm, approach.flat_mm);
        let (brake, free) = self.speeds(leg, leg.length_mm, 0.0, 0.0, window_s);
        let brake = math::min(brake, top);
        let mut gate = Self {
            brake_mm_s: brake,
            brake_flat_mm: math::max(flat - leg.length_mm, 0.0),
            free_mm_s: math::min(free, top),
            free_flat_mm: math::max(free_flat - leg.length_mm, 0.0),
            cap_mm_s: self.cap_mm_s,
            cap_mm: capped - leg.length_mm,
            behind: self.behind.after(leg, 2.0 * self.reach_mm),
            reach_mm,
            braking: self.braking.after(
                &BlockLimits {
                    acceleration_mm_s2: approach.acceleration_mm_s2,
                    ..*leg
                },
                free * gap_s,
            ),
        };
        if leg.trail_mm > 0.0 {
            gate.free_flat_mm = math::max(gate.free_flat_mm, gate.free_mm_s * gap_s);
        }
        if gate.cap_mm + gate.cap_mm_s * (window_s + SAMPLE_S) < 0.0 {
            gate.cap_mm_s = NO_SPEED_LIMIT_MM_S;
            gate.cap_mm = 0.0;
        }
        gate.cap(top, approach.acceleration_mm_s2, window_s);
        gate.cap(corner_mm_s, approach.acceleration_mm_s2, window_s);
        gate
    }

    /// The acceleration in a leg before the gate.
    fn approach(&self, leg: &BlockLimits) -> Approach {
        let least = self.behind.mm_s2();
        if leg.acceleration_mm_s2 <= least {
            Approach {
                acceleration_mm_s2: leg.acceleration_mm_s2,
                flat_mm: 0.0,
            }
        } else if leg.length_mm < LONG_BLOCK_INFLUENCES * self.reach_mm {
            Approach {
                acceleration_mm_s2: least,
                flat_mm: 0.0,
            }
        } else {
            Approach {
                acceleration_mm_s2: leg.acceleration_mm_s2,
                flat_mm: self.reach_mm,
            }
        }
    }

    /// For how far before the gate the speed of a reference that has accelerated does not change, mm.
    fn free_flat(&self, approach: Approach, gap_s: f32) -> f32 {
        if approach.flat_mm > 0.0 {
            math::max(self.free_flat_mm, approach.flat_mm + self.free_mm_s * gap_s)
        } else {
            self.free_flat_mm
        }
    }

    /// A limit on both sides of the gate.
    fn cap(&mut self, speed_mm_s: f32, acceleration_mm_s2: f32, window_s: f32) {
        let half = 0.5 / acceleration_mm_s2;
        let limit_sqr = speed_mm_s * speed_mm_s;
        let reach_mm = influence_mm(speed_mm_s, window_s);
        // The way in which braking makes up a difference of squared speeds.
        let way = |sqr: f32| half * sqr;
        if speed_mm_s < self.free_mm_s {
            let cap_sqr = self.cap_mm_s * self.cap_mm_s;
            let flat_mm = math::max(
                self.brake_flat_mm
                    - way(math::max(
                        self.brake_mm_s * self.brake_mm_s - limit_sqr,
                        0.0,
                    )),
                self.cap_mm - way(cap_sqr - limit_sqr),
            );
            self.brake_flat_mm = math::max(reach_mm, flat_mm);
            let faster = self.free_mm_s - speed_mm_s;
            let free_flat_mm = self.free_flat_mm
                - way(self.free_mm_s * self.free_mm_s - limit_sqr)
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
            (speed_mm_s, reach_mm, self.cap_mm_s, self.cap_mm)
        } else {
            (self.cap_mm_s, self.cap_mm, speed_mm_s, reach_mm)
        };
        self.cap_mm = math::max(low_mm, high_mm - way(high * high - low * low));
        self.cap_mm_s = low;
        self.brake_mm_s = math::min(self.brake_mm_s, speed_mm_s);
    }

    /// The acceleration of the reference in a leg, so far before this gate at its end, mm/s².
    pub(in crate::motion) fn acceleration(&self, leg: &BlockLimits, way_mm: f32) -> f32 {
        let approach = self.approach(leg);
        let here = math::min(leg.acceleration(way_mm), approach.acceleration_mm_s2);
        if way_mm < approach.flat_mm {
            math::min(here, self.behind.mm_s2())
        } else {
            here
        }
    }

    /// Greatest speeds of the reference after a cell, in a leg with this gate so far ahead: braking,
    /// and when it accelerates, mm/s.
    ///
    /// The way until then is the mean speed times the cell's time, so that the speed v is the root of
    /// v² + (v₀ + v)·g = e² with the gain g in a cell, where e is what could be reached at once.
    #[inline(never)]
    pub(in crate::motion) fn speeds(
        &self,
        leg: &BlockLimits,
        way_mm: f32,
        speed_mm_s: f32,
        cell_s: f32,
        window_s: f32,
    ) -> (f32, f32) {
        let approach = self.approach(leg);
        let way_mm = leg.beyond_trail_mm(way_mm);
        let a = approach.acceleration_mm_s2;
        let gap_s = window_s + SAMPLE_S;
        let flat = |flat_mm: f32| math::max(flat_mm, approach.flat_mm);
        let passed_mm = 0.5 * cell_s * speed_mm_s;
        // The least of what two limits leave room for, each from a speed that is possible in any case.
        let most = |double: f32, time_s: f32, low: [f32; 2], high: [f32; 2]| {
            let half = 0.5 * double * (time_s + 0.5 * cell_s);
            let room = |[speed, way_mm]: [f32; 2]| {
                let begun = speed * (speed + double * time_s);
                let grown = begun + double * (way_mm - passed_mm);
                math::max(grown, speed * (speed + 2.0 * half))
            };
            let room = math::min(room(low), room(high));
            room / math::max(half + math::sqrt(half * half + room), MIN_DIVISOR_MM_S)
        };
        let low = [self.brake_mm_s, way_mm - flat(self.brake_flat_mm)];
        let high = [self.cap_mm_s, way_mm - flat(self.cap_mm)];
        let brake = most(2.0 * a, 0.0, low, high);
        // Cruising ends before the gate, ...
        let ends_here = math::max(way_mm - passed_mm, 0.0) / (gap_s + 0.5 * cell_s);
        let within = math::min(
            low[0] * low[0] + 2.0 * a * (low[1] - passed_mm),
            high[0] * high[0] + 2.0 * a * (high[1] - passed_mm),
        );
        let half = a * (gap_s + 0.5 * cell_s);
        let within = math::max(within, 0.0);
        let within = within / math::max(half + math::sqrt(half * half + within), MIN_DIVISOR_MM_S);
        let here = math::min(within, ends_here);
        // ... or behind it.
        let double = 2.0 * math::min(a, self.braking.mm_s2());
        let low = [self.free_mm_s, way_mm - self.free_flat(approach, gap_s)];
        let far_mm = flat(self.cap_mm) + self.cap_mm_s * gap_s;
        let there = most(double, gap_s, low, [self.cap_mm_s, way_mm - far_mm]);
        (brake, math::min(math::max(here, there), brake))
    }
}
