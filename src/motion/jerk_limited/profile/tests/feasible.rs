//! A feasible plan with limits of jerk, to judge the plan of programs by: slow to compute, and simple.
//!
//! In each sample the acceleration is the greatest from which the hardest braking still comes to the speed of every corner
//! ahead, and ends there. Nothing of the firmware is used but the limits of the blocks.

use std::vec::Vec;

use super::CREEP;
use crate::path::Block;

const SAMPLE_S: f64 = 1.0e-3;
/// What braking may leave of the path, mm.
const REMAINDER_TOLERANCE_MM: f64 = 2.0e-4;

/// A block as a plan sees it.
#[derive(Debug, Clone, Copy)]
struct PathPart {
    length: f64,
    speed: f64,
    acceleration: f64,
    /// Greatest speed at its beginning.
    corner: f64,
}

/// The blocks of a program, from and to a standstill.
fn parts(blocks: &[Block]) -> Vec<PathPart> {
    let mut before = 0.0;
    let part = |block: &Block| {
        let length = f64::from(block.length_mm);
        // A block takes a sample at least.
        let speed = f64::from(block.nominal_mm_s).min(length / SAMPLE_S);
        let corner = f64::from(block.junction_sqr).sqrt().min(speed).min(before);
        before = speed;
        PathPart {
            length,
            speed,
            acceleration: f64::from(block.acceleration_mm_s2),
            corner,
        }
    };
    blocks.iter().map(part).collect()
}

/// Braking from a speed to another with an acceleration that takes `ramp` to be there, without one before and after.
fn distance(from: f64, to: f64, acceleration: f64, ramp: f64) -> f64 {
    let change = ((from - to) / acceleration).max(0.0);
    let seconds = if change <= ramp {
        2.0 * (change * ramp).sqrt()
    } else {
        change + ramp
    };
    0.5 * (from + to) * seconds
}

/// A motion along the path.
#[derive(Debug, Clone, Copy)]
struct FeasibleMotion {
    speed: f64,
    acceleration: f64,
}

impl FeasibleMotion {
    /// The distance of the hardest braking to a speed, 0 for a motion that does not exceed it.
    fn braking(self, to: f64, greatest: f64, ramp: f64) -> f64 {
        let seconds = self.acceleration.abs() * ramp / greatest;
        let change = 0.5 * self.acceleration.abs() * seconds;
        let changed = seconds * (self.speed + change * 2.0 / 3.0);
        if self.acceleration >= 0.0 {
            if self.speed + change <= to {
                return 0.0;
            }
            return changed + distance(self.speed + change, to, greatest, ramp);
        }
        let faster = self.speed - to;
        if faster <= 0.0 {
            0.0
        } else if faster <= change {
            0.5 * (self.speed + to) * faster / -self.acceleration
        } else {
            distance(self.speed + change, to, greatest, ramp) - changed
        }
    }
}

/// The acceleration that makes up for a difference of speed and ends then.
fn approach(difference: f64, jerk: f64) -> f64 {
    let half = 0.5 * SAMPLE_S;
    let root = (half * half + 2.0 * difference.abs() / jerk).sqrt();
    (jerk * (root - half)).copysign(difference)
}

/// The feasible plan of a path.
struct FeasiblePlan<'a> {
    parts: &'a [PathPart],
    ramp: f64,
    number: usize,
    remaining: f64,
    state: FeasibleMotion,
}

impl FeasiblePlan<'_> {
    /// The speed at the end of a block.
    fn corner(&self, number: usize) -> f64 {
        self.parts.get(number + 1).map_or(0.0, |part| part.corner)
    }

    /// By how much the distance to any corner ahead exceeds what braking needs, after a sample with an acceleration.
    fn slack(&self, acceleration: f64) -> f64 {
        let speed = self.state.speed;
        let gain = acceleration * SAMPLE_S;
        let state = FeasibleMotion {
            speed: speed + 0.5 * gain,
            acceleration,
        };
        let mut ahead = self.remaining - (0.5 * speed + gain / 6.0) * SAMPLE_S;
        let mut greatest = f64::MAX;
        let mut slack = 1.0e9_f64;
        for (number, part) in self.parts.iter().enumerate().skip(self.number) {
            greatest = greatest.min(part.acceleration);
            if number > self.number {
                ahead += part.length;
            }
            let corner = self.corner(number);
            let braking = state.braking(corner, greatest, self.ramp);
            if braking > 0.0 || corner <= 0.0 {
                slack = slack.min(ahead - braking);
            }
            let stopping = state.braking(0.0, greatest, self.ramp);
            if corner <= 0.0 || ahead > 2.0 * stopping {
                break;
            }
        }
        slack
    }

    /// The greatest acceleration up to one that the blocks ahead allow where the machine comes to them.
    fn for_blocks(&self, wanted: f64) -> f64 {
        let here = self.parts[self.number].acceleration;
        let mut ahead = self.remaining;
        let mut allowed = wanted.abs();
        for part in &self.parts[self.number + 1..] {
            let excess = allowed - part.acceleration;
            let needed = self.ramp * excess / here + SAMPLE_S;
            if excess > 0.0 && ahead < self.state.speed * needed {
                allowed = part.acceleration;
            }
            ahead += part.length;
            if ahead > self.state.speed * (self.ramp + SAMPLE_S) {
                break;
            }
        }
        allowed.copysign(wanted)
    }

    /// The acceleration of the next sample.
    fn acceleration(&self) -> f64 {
        let part = &self.parts[self.number];
        let FeasibleMotion {
            speed,
            acceleration,
        } = self.state;
        let jerk = part.acceleration / self.ramp;
        let change = jerk * SAMPLE_S;
        let hardest = self.for_blocks((acceleration - change).max(-part.acceleration));
        let lowest = hardest
            .max(acceleration - change)
            .max(approach(-speed, jerk));
        let lowest = lowest.min(acceleration + change);
        let highest = (acceleration + change).min(part.acceleration);
        let highest = highest.min(approach(part.speed - speed, jerk));
        let highest = self.for_blocks(highest).max(lowest);
        let [low, high] = [lowest, highest].map(|acceleration| self.slack(acceleration));
        if high >= 0.0 {
            highest
        } else if low <= 0.0 {
            lowest
        } else {
            lowest + (highest - lowest) * low / (low - high)
        }
    }

    /// The time to the end of the path.
    fn seconds(&mut self) -> f64 {
        let mut seconds = 0.0;
        while self.number < self.parts.len() {
            let acceleration = self.acceleration();
            let before = self.state.speed;
            let speed = (before + acceleration * SAMPLE_S).max(0.0);
            self.state = FeasibleMotion {
                speed,
                acceleration,
            };
            self.remaining -= 0.5 * (before + speed) * SAMPLE_S;
            seconds += SAMPLE_S;
            assert!(seconds < 3600.0, "stuck at {}", self.number);
            self.leave_blocks();
        }
        seconds
    }

    /// Leaves the blocks whose end has been reached.
    fn leave_blocks(&mut self) {
        let at_rest = FeasibleMotion {
            speed: 0.0,
            acceleration: 0.0,
        };
        while self.number < self.parts.len() {
            let stops = self.corner(self.number) <= 0.0;
            let is_left = if stops && self.state.speed <= CREEP {
                self.remaining <= REMAINDER_TOLERANCE_MM
            } else {
                self.remaining <= 0.0
            };
            if !is_left {
                break;
            }
            self.number += 1;
            let next = self.parts.get(self.number).map_or(0.0, |part| part.length);
            if stops {
                (self.state, self.remaining) = (at_rest, next);
            } else {
                self.remaining += next;
            }
        }
    }
}

/// The time that the feasible plan of blocks takes, s.
pub(super) fn feasible_s(blocks: &[Block], ramp: f64) -> f64 {
    let parts = parts(blocks);
    let mut plan = FeasiblePlan {
        remaining: parts[0].length,
        parts: &parts,
        ramp,
        number: 0,
        state: FeasibleMotion {
            speed: 0.0,
            acceleration: 0.0,
        },
    };
    plan.seconds()
}
